"""`provision links use`: route a site's traffic over one link for a limited time; the router ends it by itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli.base import syntax
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, conjunction, msg

if TYPE_CHECKING:
    from atlantis_netcfg.cli.base.session import CommandSession
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.operations.use import UseRequest
    from atlantis_netcfg.runs.report.run import RunReport

USE = syntax.CommandSpec(
    "links use",
    "route a site's traffic over one link for a limited time",
    words=(
        syntax.Word("site", "the site", is_required=True, example="coastal"),
        syntax.Word("link", "the link to use", example="4g"),
        syntax.Word("for", "duration, from 1 minute to 24 hours", example="30m"),
        syntax.Word("order", "`end`: return to the link order of the inventory now", choices=("end",), bare=True),
        syntax.VIA,
        syntax.INVENTORY,
    ),
    flags=(
        syntax.Flag("unproved", "allow a link that is down or not tested yet"),
        syntax.Flag("plan", "show changes and their cost, change nothing", harmless=True),
        syntax.Flag("rehearse", "use an emulated router, including the automatic return", harmless=True),
        syntax.PROFILE,
        syntax.Flag("yes", "do not ask before changing the router"),
        syntax.ACCEPT_COST,
        syntax.WITHOUT_PROTECTION,
        syntax.ASK_VAULT_PASS,
        syntax.JSON,
        syntax.VERBOSE,
    ),
    details=(
        "The router ends it by itself with a scheduler job (it must be allowed to run them); a restart ends it,"
        " too. Failover stays active: if the link fails, the next one in the inventory takes over. Run it again"
        " to change the duration or the link."
    ),
    changes=True,
    plays=True,
)


def run_use(arguments: syntax.Arguments) -> ExitCode:
    """Run `links use`: read the link, show changes and possible cost, ask, change, and print when it ends."""
    from atlantis_netcfg.cli.base.session import session
    from atlantis_netcfg.operations.common.request import refuse_examples
    from atlantis_netcfg.operations.common.site_links import link_named
    from atlantis_netcfg.operations.use import UseRequest, router_of

    site, allow_unproved = arguments.word("site"), arguments.flag("unproved")
    for_s = _for_s(arguments)
    requests: list[UseRequest] = []

    def choose_hosts(inventory: Inventory) -> tuple[Host, ...]:
        router = router_of(inventory, site)
        if for_s is not None:
            requests.append(
                UseRequest(site, link_named(inventory, site, arguments.word("link")), for_s, allow_unproved)
            )
        return (router,)

    with session(
        arguments, rehearse=arguments.flag("rehearse"), via=arguments.optional("via"), choose_hosts=choose_hosts
    ) as site_session:
        refuse_examples(site_session.inventory, is_rehearsal=site_session.is_rehearsal)
        if site_session.rehearsal is not None:
            _settle(site_session)
        report = _begin(site_session, requests[0]) if requests else _end(site_session)
    return site_session.close(report)


def _for_s(arguments: syntax.Arguments) -> int | None:
    """Return the duration; None ends the current use. Raises UsageError for arguments that exclude each other."""
    from atlantis_netcfg.core.errors import UsageError
    from atlantis_netcfg.operations.use import span_s

    site, span = arguments.word("site"), arguments.optional("for")
    given_names = [name for name in ("link", "for") if arguments.optional(name) is not None]
    whole = msg(
        f"run `provision links use site={arg(site)} link=4g for=30m`, or `provision links use site={arg(site)} end`"
    )
    if arguments.optional("order") is None:
        if span is None or len(given_names) < 2:  # noqa: PLR2004 - both words
            missing = conjunction(f"`{name}=`" for name in ("link", "for") if name not in given_names)
            raise UsageError(f"{arg(missing)} {'are' if len(given_names) == 0 else 'is'} missing", hint=whole)
        return span_s(span)
    if given_names:
        raise UsageError("`end` ends any temporary use: it accepts neither a link nor a duration", hint=whole)
    if arguments.flag("rehearse"):
        raise UsageError(
            "`end` has no effect on an emulated router",
            hint="use `link=` and `for=`: that also rehearses the end",
        )
    return None


def _settle(session: CommandSession) -> None:
    """Configure the emulated router, and wait until it has judged its links."""
    from atlantis_netcfg.cli.base.rehearsal import announce
    from atlantis_netcfg.routeros.link_use import SETTLED_S

    announce(session)
    session.configure_emulators(strict=True)
    _wait(session, SETTLED_S)


def _wait(session: CommandSession, seconds: float) -> None:
    """Advance the clock of the emulated router."""
    assert session.rehearsal is not None  # noqa: S101 - only a rehearsal comes here
    session.rehearsal.emulators.do(session.hosts[0].name, "wait", seconds=seconds)


def _begin(session: CommandSession, use_request: UseRequest) -> RunReport:
    from atlantis_netcfg.cli.links import read_links

    order = use_request.order(read_links(session), proof=session.store.proof(session.site, use_request.link.name))
    _pay(session, use_request)
    session.use = order
    if session.arguments.flag("plan"):
        return session.plan()
    if session.rehearsal is not None:
        return _rehearse(session, use_request)
    report = session.change(ask=not session.arguments.flag("yes"))
    if not report.exit and not session.as_json and order.until is not None:
        from atlantis_netcfg.core.times import time_text

        until = time_text(order.until, session.inventory.pilot.time_zone)
        print(translate(f"{arg(order.link)} carries the traffic of {arg(session.site)} until {arg(until)}"), flush=True)
    return report


def _end(session: CommandSession) -> RunReport:
    from atlantis_netcfg.cli.links import read_links
    from atlantis_netcfg.operations.use import ended_order

    session.use = ended_order(session.site, read_links(session))
    if session.arguments.flag("plan"):
        return session.plan()
    return session.change(ask=not session.arguments.flag("yes"))


def _pay(session: CommandSession, use_request: UseRequest) -> None:
    """Show the possible cost of the site's traffic over the link, and ask for consent. Raises CostRefusal."""
    from atlantis_netcfg.cli.base.consent import pay
    from atlantis_netcfg.operations.common.site_links import link_of

    link = link_of(session.inventory, session.site, use_request.link.name)
    if not link.is_metered or session.arguments.flag("plan"):
        return
    words = msg(f"{arg(use_request.cost(link).words)}: all traffic of the site within that time")
    if session.is_rehearsal:
        if not session.as_json:
            print(translate(f"a real run asks first: {arg(words)}"))
        return
    pay([words], is_accepted=session.arguments.flag(syntax.ACCEPT_COST.name), as_json=session.as_json)


def _rehearse(session: CommandSession, use_request: UseRequest) -> RunReport:
    """Rehearse: the link carries the traffic, a run changes nothing, and at the end the order is restored."""
    from atlantis_netcfg.operations import Mode

    report = session.perform(Mode.APPLY)
    if report.exit:
        return report
    _see(session, use_request.link.name, "it is in use instead of the order in the inventory")
    session.use = None
    again = session.perform(Mode.APPLY)
    if again.exit or any(result["planned"] for result in again.devices.values()):
        return again
    _tell(session, "a run of the site does not change this")
    _wait(session, use_request.for_s)
    _see(
        session,
        session.inventory.sites[session.site].bearers[0].name,
        "the router has restored the order of the inventory",
    )
    return report


def _see(session: CommandSession, link: str, words: str) -> None:
    """Check that the link carries the emulated router's traffic, and print this. Raises NetcfgError."""
    from atlantis_netcfg.cli.links import read_links
    from atlantis_netcfg.core.errors import NetcfgError

    active = [status.name for status in read_links(session).links if status.active]
    if active != [link]:
        raise NetcfgError(f"{arg(link)} does not carry the traffic of the emulated router: it uses {arg(active)}")
    _tell(session, msg(f"{arg(link)} carries the traffic: {arg(words)}"))


def _tell(session: CommandSession, words: str) -> None:
    if not session.as_json:
        print(translate(words), flush=True)
