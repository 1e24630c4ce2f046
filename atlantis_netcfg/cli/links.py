"""Commands that measure links: `links` and `measure satellite`.

`provision links`: the state of every link of a site, the active link, and the problems.

`provision measure satellite`: whether the satellite allows exactly the traffic in the inventory.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli.base import syntax
from atlantis_netcfg.cli.base.output import json_text
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, join, msg

if TYPE_CHECKING:
    from atlantis_netcfg.cli.base.session import CommandSession
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.links import LinkFinding
    from atlantis_netcfg.links.cost import Bill, Preview
    from atlantis_netcfg.operations import Request
    from atlantis_netcfg.operations.allow_list_test.prove import Proof
    from atlantis_netcfg.operations.links.collect import LinksStatus
    from atlantis_netcfg.runs.report.links import LinksReport


LINKS = syntax.CommandSpec(
    "links",
    "show link states; route the traffic over one of them",
    words=(
        syntax.Word("site", "the site", is_required=True, example="coastal"),
        syntax.DEVICES,
        syntax.VIA,
        syntax.INVENTORY,
    ),
    flags=(
        syntax.Flag("rehearse", "use emulated devices of the site, configured first"),
        syntax.PROFILE,
        syntax.ACCEPT_COST,
        syntax.ASK_VAULT_PASS,
        syntax.JSON,
    ),
    details=(
        "Nothing is changed, and nothing is sent over a satellite link. Exit code 0: all links work, possibly "
        "with warnings, 6: a link fails or its state is unknown, or a device does not respond, 7: no device was "
        "contacted."
    ),
)


def run_links(arguments: syntax.Arguments) -> ExitCode:
    """Run `links`: read all devices of the site's links at once, and report."""
    from atlantis_netcfg.cli.base.session import session

    _require_one_site(arguments.word("site"))
    with session(arguments, rehearse=arguments.flag("rehearse"), via=arguments.optional("via")) as site_session:
        if site_session.rehearsal is not None:
            site_session.configure_emulators()
        report = _report(site_session, read_links(site_session))
    print(json_text(report.as_json()) if site_session.as_json else translate(report.as_text()))
    return report.exit


def _require_one_site(site: str) -> None:
    from atlantis_netcfg.core.errors import UsageError
    from atlantis_netcfg.inventory import ALL

    if site == ALL:
        raise UsageError("`provision links` takes one site at a time", hint="type its name: `site=coastal`")


def read_links(session: CommandSession) -> LinksStatus:
    """Read the links, after consent to the cost."""
    import asyncio

    from atlantis_netcfg.cli.base.output import progress
    from atlantis_netcfg.operations import Mode
    from atlantis_netcfg.operations.common.request import refuse_examples
    from atlantis_netcfg.operations.links.collect import collect_links

    refuse_examples(session.inventory, is_rehearsal=session.is_rehearsal)
    request = session.confirm_cost(session.request(Mode.DRIFT))
    with progress(quiet=session.as_json) as notify:
        return asyncio.run(collect_links(session.inventory, session.site, session.hosts, request, notify))


def _report(session: CommandSession, status: LinksStatus) -> LinksReport:
    title = session.inventory.sites[session.site].title
    emulators = session.rehearsal
    missing = emulators.not_rehearsed if emulators is not None else ()
    zone = session.inventory.pilot.time_zone
    return status.report(session.site, title, is_rehearsal=session.is_rehearsal, not_rehearsed=missing, time_zone=zone)


_NOT_REHEARSED = (
    "the network beyond the satellite: a local OpenVPN acts as VPN server; TCP and time servers are missing"
)

PROVE = syntax.CommandSpec(
    "measure satellite",
    "test the satellite allow-list with packets (up to 20 kB)",
    words=(
        syntax.Word("site", "the site", is_required=True, example="coastal"),
        syntax.Word("link", "satellite link (optional if the site has only one)", example="satellite"),
        syntax.Word("backup", "exported backup of the terminal, to compare", example="vesselink.bin"),
        syntax.VIA,
        syntax.INVENTORY,
    ),
    flags=(
        syntax.Flag("open-filter", "open the router's filter per host, to test the terminal's own filter"),
        syntax.Flag(
            "try-all",
            "also test the VPN over an idle link, TCP targets and time (rows under safe mode, removed afterwards)",
        ),
        syntax.Flag("rehearse", "use an emulated router, configured first", harmless=True),
        syntax.PROFILE,
        syntax.ACCEPT_COST,
        syntax.ASK_VAULT_PASS,
        syntax.JSON,
    ),
    details=(
        "The router pings from the satellite link's address, and only targets of yours. A target counts as "
        "silent after 90 s, because outages of 70 s are normal. Exit code 0: all is proved, 6: a test failed or "
        "proved nothing, 7: nothing was tested."
    ),
    changes=True,
    again="run the same command again: the router's safe mode removes the added rows when their session ends",
)


def run_prove(arguments: syntax.Arguments) -> ExitCode:
    """Run `measure satellite`: ask for consent to the cost, probe, report."""
    from atlantis_netcfg.cli.base.session import session
    from atlantis_netcfg.inventory import choose
    from atlantis_netcfg.operations.allow_list_test.site import satellite_of
    from atlantis_netcfg.runs.report.summary import count_limits

    def choose_hosts(inventory: Inventory) -> tuple[Host, ...]:
        choose(inventory, arguments.word("site"), ())
        return (satellite_of(inventory, arguments.word("site"), arguments.optional("link")).router,)

    with session(
        arguments,
        rehearse=arguments.flag("rehearse"),
        via=arguments.optional("via"),
        choose_hosts=choose_hosts,
    ) as site_session:
        proof, cost_previews, bills_by_link = _prove(site_session)
    beyond = (_NOT_REHEARSED,) if site_session.is_rehearsal else ()
    if site_session.as_json:
        document = {
            "rehearsed": site_session.is_rehearsal,
            "not_rehearsed": beyond,
            "expected": [item.as_dict() for item in cost_previews],
            "cost": bills_by_link[proof.link].as_dict(),
            "costs": {name: bill.as_dict() for name, bill in bills_by_link.items()},
        }
        print(json_text({**proof.as_json(), **document}))
    else:
        would = "would have " if site_session.is_rehearsal else ""
        costs = [msg(f"  {arg(would)}cost over {arg(name)}: {arg(bill.words)}") for name, bill in bills_by_link.items()]
        limits = [msg(f"  {arg(count_limits(len(beyond)))}")] if beyond else []
        print(translate(join("\n", [proof.as_text(), *costs, *limits])))
    return proof.exit


def _prove(session: CommandSession) -> tuple[Proof, tuple[Preview, ...], dict[str, Bill]]:
    """Return the test result, the maximum expected cost, and the actual cost of metered links."""
    import time
    from contextlib import ExitStack
    from dataclasses import replace

    from atlantis_netcfg.cli.base.output import as_typed, carried_words, progress
    from atlantis_netcfg.operations.allow_list_test.site import bills, previews, satellite_of, try_out
    from atlantis_netcfg.operations.allow_list_test.vpn import vpn_trial
    from atlantis_netcfg.operations.common.request import refuse_examples

    satellite = satellite_of(session.inventory, session.site, session.arguments.optional("link"))
    refuse_examples(session.inventory, is_rehearsal=session.is_rehearsal)
    evidence = _evidence_findings(session, satellite.terminal)
    with ExitStack() as stack:
        notify = stack.enter_context(progress(quiet=session.as_json))
        if session.rehearsal is not None:
            session.configure_emulators(strict=True)
        proving = satellite.proving(
            session.inventory,
            open_filter=session.arguments.flag("open-filter"),
            try_all=session.arguments.flag("try-all"),
            is_rehearsal=session.is_rehearsal,
            via=session.arguments.optional("via"),
        )
        proving.notify = notify
        if proving.try_all:
            trial = vpn_trial(session.inventory, satellite.router, satellite.link, _request(session), session.rehearsal)
            proving.vpn = stack.enter_context(trial)
        cost_previews = tuple(preview for preview in previews(session.inventory, proving) if preview.link.is_metered)
        _pay(session, cost_previews)
        if proving.open_filter or proving.try_all:
            stack.enter_context(session.store.lock(session.site, f"provision measure satellite site={session.site}"))
        start = time.monotonic()
        proof = try_out(session.inventory, satellite.router, _request(session), proving)
        if proof.vpn_answered:
            session.store.keep_proof(session.site, satellite.link.name)
    bills_by_link = bills(session.inventory, proof, time.monotonic() - start)
    dear = {name: bill for name, bill in bills_by_link.items() if name == proof.link or _is_metered(session, name)}
    words = [f"site={session.site}", *carried_words(session.arguments)]

    def complete_hint(finding: LinkFinding) -> LinkFinding:
        return replace(finding, hint=finding.hint and as_typed(finding.hint, words))

    judgements = tuple((attempt, complete_hint(finding)) for attempt, finding in proof.results)
    return (
        replace(proof, results=judgements, findings=tuple(map(complete_hint, (*proof.findings, *evidence)))),
        cost_previews,
        dear,
    )


def _is_metered(session: CommandSession, name: str) -> bool:
    from atlantis_netcfg.operations.common.site_links import link_of

    return link_of(session.inventory, session.site, name).is_metered


def _evidence_findings(session: CommandSession, terminal: Host) -> tuple[LinkFinding, ...]:
    """Return findings on the terminal's evidence and the allow-list's names; a rehearsal looks up no names."""
    from datetime import UTC, datetime
    from pathlib import Path

    from atlantis_netcfg.operations.allow_list_test.site import names_of
    from atlantis_netcfg.operations.common.terminals import judge_terminal

    backup = session.arguments.optional("backup")
    today = datetime.now(UTC).astimezone().date()
    backup_path = None if backup is None else Path(backup)
    evidence = judge_terminal(session.inventory, terminal, session.store, today=today, backup=backup_path)
    names = (
        () if session.is_rehearsal else names_of(session.inventory, session.site, session.arguments.optional("link"))
    )
    return (*evidence.findings, *names)


def _request(session: CommandSession) -> Request:
    from atlantis_netcfg.operations import Mode

    return session.request(Mode.DRIFT)


def _pay(session: CommandSession, cost_previews: tuple[Preview, ...]) -> None:
    """Show the cost and ask for consent. Raises CostRefusal; a rehearsal costs nothing."""
    from atlantis_netcfg.cli.base.consent import pay

    words = [item.words for item in cost_previews]
    if session.is_rehearsal:
        if words and not session.as_json:
            print(translate(f"a real test asks first: {arg(join('; ', words))}"))
        return
    for item in cost_previews:
        if item.over_cap:
            raise item.refusal()
    pay(words, is_accepted=session.arguments.flag(syntax.ACCEPT_COST.name), as_json=session.as_json)
