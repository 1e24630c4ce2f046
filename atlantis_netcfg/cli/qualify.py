"""`provision measure link`: measure whether a link of a site carries the mission."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli.base import syntax
from atlantis_netcfg.cli.base.output import json_text
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, join, msg

if TYPE_CHECKING:
    from decimal import Decimal

    from atlantis_netcfg.cli.base.session import CommandSession
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.core.events import Subscriber
    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.inventory.model import Link
    from atlantis_netcfg.links.cost import Preview
    from atlantis_netcfg.links.qualify.measured_run import BudgetLimits, Selection
    from atlantis_netcfg.operations import Request
    from atlantis_netcfg.operations.qualify.far_end import MeasuredFarEnd
    from atlantis_netcfg.operations.qualify.result import QualifyResult
    from atlantis_netcfg.operations.qualify.several import SeveralResults

QUALIFY = syntax.CommandSpec(
    "measure link",
    "measure delay, loss and rates of a link",
    words=(
        syntax.Word(
            "site",
            "site in whose LAN or management network you are",
            is_required=True,
            example="coastal",
        ),
        syntax.Word("link", "the link, or `all` (optional if the site has only one)", example="satellite"),
        syntax.Word(
            "profile",
            "test traffic, by default telemetry",
            choices=("telemetry", "images", "throughput", "all"),
        ),
        syntax.Word("over", "`vpn`: through this computer's tunnel over the link", choices=("vpn",)),
        syntax.Word(
            "far",
            "STAMP reflector (RFC 8762) as far end; telemetry only",
            example="192.0.2.7",
        ),
        syntax.INVENTORY,
    ),
    flags=(
        syntax.Flag("max-mb", "stop before N MB (10^6 bytes), both directions together", takes="N"),
        syntax.Flag("max-eur", "stop before it costs X EUR (needs the link's tariff in EUR)", takes="X"),
        syntax.Flag("max-minutes", "stop after M minutes at most", takes="M"),
        syntax.Flag(
            "rehearse",
            "use emulated router, link and far end (takes minutes)",
            harmless=True,
        ),
        syntax.PROFILE,
        syntax.ACCEPT_COST,
        syntax.ASK_VAULT_PASS,
        syntax.JSON,
    ),
    details=(
        "The site's traffic keeps its link. Only for this computer's test packets (`over=vpn`: its tunnel) the "
        "router gets a routing rule and counter rows under safe mode; they are removed afterwards. Exit code 0: "
        "every criterion passed, and the router's counters prove the link; 6: a criterion failed or is not "
        "proved; 7: nothing was sent. `provision measure show`, `compare` and `history` show stored measurements."
    ),
    changes=True,
    again="run the same command again: the router's safe mode removes the added rows when their session ends",
)


_LED_ALONG = "other traffic in this computer's tunnel also uses the link and is not limited: close what you can"


def run_qualify(arguments: syntax.Arguments) -> ExitCode:
    """Run `measure link`: show the cost, measure the links one after the other, report."""
    from atlantis_netcfg.cli.base.session import session
    from atlantis_netcfg.inventory import choose
    from atlantis_netcfg.operations.qualify.run import links_of_site, router_of
    from atlantis_netcfg.runs.report.summary import count_limits

    limits = _limits(arguments)

    def choose_hosts(inventory: Inventory) -> tuple[Host, ...]:
        site = arguments.word("site")
        choose(inventory, site, ())
        links = links_of_site(inventory, site, arguments.optional("link"))
        outside = () if _is_over_vpn(arguments) else links
        _far_end(inventory, arguments).refuse(_selection(arguments), outside, inventory)
        router = router_of(inventory, site)
        return (router, *(unit for link in links if (unit := _unit(inventory, link)) is not None))

    with session(arguments, rehearse=arguments.flag("rehearse"), via="lan", choose_hosts=choose_hosts) as site_session:
        results = _measure(site_session, limits)
    not_rehearsed = _not_rehearsed(site_session)
    code = results.exit
    if site_session.as_json:
        document = {
            "site": site_session.site,
            "exit": int(code),
            "rehearsed": site_session.is_rehearsal,
            "not_rehearsed": not_rehearsed,
            "links": [each.as_json() for each in results.results],
            "not_measured": [each.as_json() for each in results.not_measured],
        }
        print(json_text(document))
    else:
        missing = (each.line() for each in results.not_measured)
        limit_lines = [msg(f"  {arg(count_limits(len(not_rehearsed)))}")] if not_rehearsed else []
        for line in (*(line for each in results.results for line in each.lines()), *missing, *limit_lines):
            print(translate(line))
    return code


def _unit(inventory: Inventory, link: Link) -> Host | None:
    """Return the device of a 4G link; None if there is none, or it cannot be read."""
    from atlantis_netcfg.inventory.model import LinkKind, LteDriver, LteRouter

    host = inventory.hosts.get(link.device or "") if link.kind is LinkKind.LTE else None
    device = None if host is None else host.device
    return host if isinstance(device, LteRouter) and device.driver is not LteDriver.MANUAL else None


def _facts(session: CommandSession, link: Link, request: Request) -> dict[str, str]:
    """Return the data of a 4G link's device, read without using the link itself."""
    from atlantis_netcfg.records.survey.radio import UnitRadio, facts_of

    unit = _unit(session.inventory, link)
    return {} if unit is None else facts_of(UnitRadio(session.inventory, unit, request, session.store).read())


def _not_rehearsed(session: CommandSession) -> tuple[str, ...]:
    if session.rehearsal is None:
        return ()
    from atlantis_netcfg.operations.qualify.emulation import not_rehearsed

    over_vpn = _is_over_vpn(session.arguments)
    return not_rehearsed(session.rehearsal, over_vpn=over_vpn)


def _is_over_vpn(arguments: syntax.Arguments) -> bool:
    return arguments.optional("over") is not None


def _far_end(inventory: Inventory, arguments: syntax.Arguments) -> MeasuredFarEnd:
    """Return the remote end of the measurement. Raises NothingToQualify, UsageError."""
    from atlantis_netcfg.operations.qualify.far_end import far_end_of

    return far_end_of(inventory, over_vpn=_is_over_vpn(arguments), other=arguments.optional("far"))


def _selection(arguments: syntax.Arguments) -> Selection:
    from atlantis_netcfg.links.qualify.measured_run import Selection

    return Selection(arguments.optional("profile") or Selection.TELEMETRY)


def _limits(arguments: syntax.Arguments) -> BudgetLimits:
    """Return the user's limits for all links together. Raises UsageError."""
    from decimal import Decimal

    from atlantis_netcfg.links.qualify.measured_run import BudgetLimits

    mb, eur, minutes = (_number(arguments, name) for name in ("max-mb", "max-eur", "max-minutes"))
    return BudgetLimits(
        max_bytes=None if mb is None else int(mb * 1_000_000),
        max_price=None if eur is None else Decimal(eur),
        max_seconds=None if minutes is None else float(minutes * 60),
    )


def _number(arguments: syntax.Arguments, name: str) -> Decimal | None:
    from decimal import Decimal, InvalidOperation

    from atlantis_netcfg.core.errors import UsageError

    text = arguments.flags.get(name)
    if text is None:
        return None
    try:
        number = Decimal(text)
    except InvalidOperation:
        number = Decimal(0)
    if not number.is_finite() or number <= 0:
        raise UsageError(f"`--{arg(name)} {arg(text)}`: not a number above 0", hint=f"example: `--{arg(name)} 2.5`")
    return number


def _measure(session: CommandSession, limits: BudgetLimits) -> SeveralResults:
    """Measure the links one after the other. If there is only one, its error is raised."""
    from contextlib import ExitStack

    from atlantis_netcfg.cli.base.output import progress
    from atlantis_netcfg.operations import Mode
    from atlantis_netcfg.operations.common.request import refuse_examples
    from atlantis_netcfg.operations.qualify.far_end import open_far_end
    from atlantis_netcfg.operations.qualify.run import links_of_site
    from atlantis_netcfg.operations.qualify.several import measure_each

    refuse_examples(session.inventory, is_rehearsal=session.is_rehearsal)
    links = links_of_site(session.inventory, session.site, session.arguments.optional("link"))
    selection = _selection(session.arguments)
    _pay(session, links, selection, limits)
    with ExitStack() as stack:
        notify = stack.enter_context(progress(quiet=session.as_json))
        if session.rehearsal is not None:
            session.configure_emulators(strict=True)
        elif _far_end(session.inventory, session.arguments).is_ours:
            open_far_end(session.inventory, session.request(Mode.DRIFT))
        stack.enter_context(session.store.lock(session.site, f"provision measure link site={session.site}"))
        result = measure_each(
            links,
            limits,
            lambda link, remaining_limits: _qualify_link(session, link, selection, remaining_limits, notify),
        )
    if len(links) == 1 and result.results[0].failure is not None:
        raise result.results[0].failure
    return result


def _qualify_link(
    session: CommandSession, link: Link, selection: Selection, limits: BudgetLimits, notify: Subscriber
) -> QualifyResult:
    from contextlib import ExitStack
    from datetime import UTC, datetime

    from atlantis_netcfg.core.errors import NetcfgError
    from atlantis_netcfg.links.qualify.archive import folder_of
    from atlantis_netcfg.links.qualify.measured_run import RUN_FILE
    from atlantis_netcfg.operations import Mode
    from atlantis_netcfg.operations.qualify.emulation import emulated_link
    from atlantis_netcfg.operations.qualify.result import QualifyResult
    from atlantis_netcfg.operations.qualify.run import LinkRun
    from atlantis_netcfg.records.qualify import write_pages
    from atlantis_netcfg.runs import make_private, new_run, os_errors_as

    now = datetime.now(UTC)
    runs_folder = folder_of(session.store, session.site)
    with os_errors_as("the measurement", runs_folder):
        folder = new_run(make_private(runs_folder), now, f"{link.name}-{now:%Y%m%dT%H%M%SZ}")
    with ExitStack() as stack:
        over_vpn = _is_over_vpn(session.arguments)
        far, emulation = _far_end(session.inventory, session.arguments), None
        if session.rehearsal is not None:
            emulation = stack.enter_context(emulated_link(link, far.key, session.rehearsal, over_vpn=over_vpn))
        request = session.request(Mode.DRIFT)
        run = LinkRun(
            session.inventory,
            session.site,
            link,
            selection,
            _cap_limits(session, link, limits),
            folder,
            far,
            over_vpn=over_vpn,
            emulated_link=emulation,
            notify=notify,
            facts=_facts(session, link, request),
        )
        failure = None
        try:
            run.measure(request)
        except NetcfgError as error:
            if not (folder / RUN_FILE).is_file():
                raise
            failure = error
    return QualifyResult(write_pages(folder), folder, failure)


def _cap_limits(session: CommandSession, site_link: Link, limits: BudgetLimits) -> BudgetLimits:
    """Restrict the limits to the cap of a metered link; a limit in EUR applies only to metered links."""
    from atlantis_netcfg.operations.common.site_links import link_of

    link = link_of(session.inventory, session.site, site_link.name)
    bounds = [each for each in (limits.max_bytes, link.cap_bytes) if each is not None]
    price = limits.max_price if link.is_metered else None
    return limits.model_copy(update={"max_bytes": min(bounds, default=None), "max_price": price})


def _pay(session: CommandSession, links: tuple[Link, ...], selection: Selection, limits: BudgetLimits) -> None:
    """Show data volume, duration and cost, and ask for consent. Raises CostRefusal."""
    from atlantis_netcfg.cli.base.consent import pay

    previews = [_preview(session, link, selection, limits) for link in links]
    if not session.as_json:
        for each in previews:
            print(
                translate(f"{arg(each.words)}, in about {arg(max(1, round(each.bill.seconds / 60)))} min"), flush=True
            )
        if _is_over_vpn(session.arguments):
            print(translate(_LED_ALONG), flush=True)
    dear = [each.words for each in previews if each.link.is_metered]
    if session.is_rehearsal:
        if dear and not session.as_json:
            print(translate(f"a real measurement asks first: {arg(join('; ', dear))}"))
        return
    pay(dear, is_accepted=session.arguments.flag(syntax.ACCEPT_COST.name), as_json=session.as_json)


def _preview(session: CommandSession, site_link: Link, selection: Selection, limits: BudgetLimits) -> Preview:
    """Estimate the maximum cost of a link: of the whole plan, or of the limits if lower. Raises CostRefusal."""
    from atlantis_netcfg.core.errors import UsageError
    from atlantis_netcfg.links.cost import preview
    from atlantis_netcfg.operations.common.site_links import link_of
    from atlantis_netcfg.operations.qualify.plan import build_plan

    link = link_of(session.inventory, session.site, site_link.name)
    far = _far_end(session.inventory, session.arguments)
    over_vpn = _is_over_vpn(session.arguments)
    plan = build_plan(site_link, selection, is_rehearsal=session.is_rehearsal, over_vpn=over_vpn, confirms=far.is_ours)
    if limits.max_price is not None and link.is_metered and (link.tariff is None or link.tariff.currency != "EUR"):
        raise UsageError(
            f"`--max-eur`: the tariff of `{arg(link.name)}` in the inventory is not in EUR",
            hint=f"set {arg(link.tariff_key)} in the inventory",
        )
    nbytes = plan.bytes if limits.max_bytes is None else min(plan.bytes, limits.max_bytes)
    seconds = plan.seconds if limits.max_seconds is None else min(plan.seconds, limits.max_seconds)
    result = preview(nbytes, seconds, link, at_most=True)
    if result.over_cap and not session.is_rehearsal:
        cap = (link.cap_bytes or 0) / 1_000_000
        refusal = result.refusal()
        refusal.hint = msg(f"add `--max-mb {arg(cap):g}`: results until then are kept; or raise {arg(link.cap_key)}")
        raise refusal
    return result
