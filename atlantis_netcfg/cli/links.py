"""Commands that measure links: `links` and `prove`.

`provision links`: how every link of a site is, which one carries the traffic, and what is wrong.

`provision prove`: whether the satellite lets through what is declared, and nothing else.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli.base.arguments import (
    ACCEPT_COST,
    ASK_VAULT_PASS,
    INVENTORY,
    JSON,
    ONLY,
    PROFILE,
    VIA,
    CommandSpec,
    Flag,
    Group,
    Word,
)
from atlantis_netcfg.cli.base.output import json_text
from atlantis_netcfg.core.language import translate

if TYPE_CHECKING:
    from atlantis_netcfg.cli.base.arguments import Arguments
    from atlantis_netcfg.cli.base.session import CommandSession
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.inventory import Declaration, Host
    from atlantis_netcfg.links import BearerFinding
    from atlantis_netcfg.links.cost import Bill, Preview
    from atlantis_netcfg.operations import Request
    from atlantis_netcfg.operations.allow_list_test.prove import Proof
    from atlantis_netcfg.operations.links.collect import LinksStatus
    from atlantis_netcfg.runs.report.links import LinksReport


LINKS = CommandSpec(
    "links",
    "say how every link of a site is, which one carries the traffic, and what is wrong",
    group=Group.FIRST,
    words=(
        Word("site", "the site", required=True, example="coastal"),
        ONLY,
        VIA,
        INVENTORY,
    ),
    flags=(
        Flag("rehearse", "the same with emulated devices of the site, configured first"),
        PROFILE,
        ACCEPT_COST,
        ASK_VAULT_PASS,
        JSON,
    ),
    details=(
        "Nothing is changed, and nothing is sent over a satellite. Exit code 6 says that a link fails or cannot be "
        "seen, or a device does not answer, 0 that all is well but for warnings, 7 that nobody was asked."
    ),
)


def run_links(arguments: Arguments) -> ExitCode:
    """Ask every box of the site's links at once, and tell."""
    from atlantis_netcfg.cli.base.session import session

    _one_site(arguments.word("site"))
    with session(arguments, rehearse=arguments.flag("rehearse"), via=arguments.optional("via")) as opened:
        if opened.rehearsal is not None:
            opened.configure_twins()
        report = _report(opened, seen(opened))
    print(json_text(report.as_json()) if opened.as_json else translate(report.as_text()))
    return report.exit


def _one_site(site: str) -> None:
    from atlantis_netcfg.core.errors import UsageError
    from atlantis_netcfg.inventory import ALL

    if site == ALL:
        raise UsageError("`provision links` looks at one site at a time", hint="type its name: `site=coastal`")


def seen(opened: CommandSession) -> LinksStatus:
    """Look, once it is agreed what the looking may cost."""
    import asyncio

    from atlantis_netcfg.cli.base.output import progress
    from atlantis_netcfg.operations import Mode
    from atlantis_netcfg.operations.common.request import refuse_examples
    from atlantis_netcfg.operations.links.collect import look

    refuse_examples(opened.declaration, rehearsed=opened.rehearsed)
    request = opened.paid(opened.request(Mode.DRIFT))
    with progress(quiet=opened.as_json) as notify:
        return asyncio.run(look(opened.declaration, opened.site, opened.hosts, request, notify))


def _report(opened: CommandSession, status: LinksStatus) -> LinksReport:
    title = opened.declaration.sites[opened.site].title
    twins = opened.rehearsal
    missing = twins.not_rehearsed if twins is not None else ()
    zone = opened.declaration.pilot.time_zone
    return status.report(opened.site, title, rehearsed=opened.rehearsed, not_rehearsed=missing, time_zone=zone)


_NOT_REHEARSED = (
    "what is beyond the satellite: an OpenVPN here answers for the VPN server, nobody takes TCP or tells the time"
)

PROVE = CommandSpec(
    "prove",
    "try what the satellite lets through, and what it must not, within 20 kB",
    group=Group.LINKS,
    words=(
        Word("site", "the site", required=True, example="coastal"),
        Word("bearer", "the satellite link; may be left out where there is one", example="satellite"),
        Word("backup", "a backup that the terminal has exported, to be compared", example="vesselink.bin"),
        VIA,
        INVENTORY,
    ),
    flags=(
        Flag("open-filter", "open the router's filter for one host at a time: does the terminal enforce anything?"),
        Flag(
            "try-all",
            "also try the VPN over an idle link, TCP targets and the time: rows are added under safe mode and removed",
        ),
        Flag("rehearse", "the same with an emulated router, configured first", harmless=True),
        PROFILE,
        ACCEPT_COST,
        ASK_VAULT_PASS,
        JSON,
    ),
    details=(
        "The router pings from the satellite's own address, targets of yours only. Silence counts after 90 s, "
        "because gaps of 70 s are ordinary. Exit code 0: all is proved, 6: something failed or could not be proved, "
        "7: nothing was tried."
    ),
    changes=True,
    again="type the same again: rows that it has added go with its session, by the safe mode of the router",
)


def run_prove(arguments: Arguments) -> ExitCode:
    """Ask what it may cost, probe, tell."""
    from atlantis_netcfg.cli.base.session import session
    from atlantis_netcfg.inventory import choose
    from atlantis_netcfg.operations.allow_list_test.site import satellite_of

    def chosen(declaration: Declaration) -> tuple[Host, ...]:
        choose(declaration, arguments.word("site"), ())
        return (satellite_of(declaration, arguments.word("site"), arguments.optional("bearer")).router,)

    with session(
        arguments,
        rehearse=arguments.flag("rehearse"),
        via=arguments.optional("via"),
        chosen=chosen,
    ) as opened:
        proof, expected, paid = _prove(opened)
    beyond = (_NOT_REHEARSED,) if opened.rehearsed else ()
    if opened.as_json:
        document = {
            "rehearsed": opened.rehearsed,
            "not_rehearsed": beyond,
            "expected": [item.as_dict() for item in expected],
            "cost": paid[proof.bearer].as_dict(),
            "costs": {name: bill.as_dict() for name, bill in paid.items()},
        }
        print(json_text({**proof.as_json(), **document}))
    else:
        would = "would have " if opened.rehearsed else ""
        costs = [f"  {would}cost over {name}: {bill.words}" for name, bill in paid.items()]
        print(translate("\n".join([proof.as_text(), *costs, *(f"  not rehearsed: {entry}" for entry in beyond)])))
    return proof.exit


def _prove(opened: CommandSession) -> tuple[Proof, tuple[Preview, ...], dict[str, Bill]]:
    """The proof, what it was expected to cost at most, and by link what it did: only what is paid by the byte."""
    import time
    from contextlib import ExitStack
    from dataclasses import replace

    from atlantis_netcfg.cli.base.output import as_typed, carried, progress
    from atlantis_netcfg.operations.allow_list_test.site import bills, previews, satellite_of, try_out
    from atlantis_netcfg.operations.allow_list_test.vpn import vpn_trial
    from atlantis_netcfg.operations.common.request import refuse_examples

    found = satellite_of(opened.declaration, opened.site, opened.arguments.optional("bearer"))
    refuse_examples(opened.declaration, rehearsed=opened.rehearsed)
    declared = _declared(opened, found.terminal)
    with ExitStack() as stack:
        notify = stack.enter_context(progress(quiet=opened.as_json))
        if opened.rehearsal is not None:
            opened.configure_twins(strict=True)
        proving = found.proving(
            opened.declaration,
            open_filter=opened.arguments.flag("open-filter"),
            try_all=opened.arguments.flag("try-all"),
            rehearsed=opened.rehearsed,
            via=opened.arguments.optional("via"),
        )
        proving.notify = notify
        if proving.try_all:
            trial = vpn_trial(opened.declaration, found.router, found.bearer, _request(opened), opened.rehearsal)
            proving.vpn = stack.enter_context(trial)
        expected = tuple(preview for preview in previews(opened.declaration, proving) if preview.link.metered)
        _pay(opened, expected)
        if proving.open_filter or proving.try_all:
            stack.enter_context(opened.store.lock(opened.site, f"provision prove site={opened.site}"))
        begun = time.monotonic()
        proof = try_out(opened.declaration, found.router, _request(opened), proving)
        if proof.vpn_answered:
            opened.store.keep_proof(opened.site, found.bearer.name)
    paid = bills(opened.declaration, proof, time.monotonic() - begun)
    dear = {name: bill for name, bill in paid.items() if name == proof.bearer or _metered(opened, name)}
    words = [f"site={opened.site}", *carried(opened.arguments)]

    def completed(finding: BearerFinding) -> BearerFinding:
        return replace(finding, hint=finding.hint and as_typed(finding.hint, words))

    judged = tuple((attempt, completed(finding)) for attempt, finding in proof.judged)
    return replace(proof, judged=judged, findings=tuple(map(completed, (*proof.findings, *declared)))), expected, dear


def _metered(opened: CommandSession, name: str) -> bool:
    from atlantis_netcfg.operations.common.site_links import link_of

    return link_of(opened.declaration, opened.site, name).metered


def _declared(opened: CommandSession, terminal: Host) -> tuple[BearerFinding, ...]:
    """What the terminal's evidence and the names of the allow-list say; in a rehearsal no name is asked for."""
    from datetime import UTC, datetime
    from pathlib import Path

    from atlantis_netcfg.operations.allow_list_test.site import names_of
    from atlantis_netcfg.operations.common.terminals import look

    backup = opened.arguments.optional("backup")
    today = datetime.now(UTC).astimezone().date()
    named = None if backup is None else Path(backup)
    seen = look(opened.declaration, terminal, opened.store, today=today, backup=named)
    names = () if opened.rehearsed else names_of(opened.declaration, opened.site, opened.arguments.optional("bearer"))
    return (*seen.findings, *names)


def _request(opened: CommandSession) -> Request:
    from atlantis_netcfg.operations import Mode

    return opened.request(Mode.DRIFT)


def _pay(opened: CommandSession, expected: tuple[Preview, ...]) -> None:
    """Tell what it costs, and return when somebody pays. Raises CostRefused; a rehearsal costs nothing."""
    from atlantis_netcfg.cli.base.consent import pay

    words = [item.words for item in expected]
    if opened.rehearsed:
        if words and not opened.as_json:
            print(translate(f"a real proof asks first: {'; '.join(words)}"))
        return
    for item in expected:
        if item.over_cap:
            raise item.refusal()
    pay(words, accepted=opened.arguments.flag(ACCEPT_COST.name), as_json=opened.as_json)
