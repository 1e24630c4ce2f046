"""`provision prove`: whether the satellite lets through what is declared, and nothing else."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli._arguments import ACCEPT_COST, INVENTORY, JSON, VIA, Command, Flag, Word

if TYPE_CHECKING:
    from atlantis_netcfg.bearers import Finding
    from atlantis_netcfg.bearers.cost import Bill
    from atlantis_netcfg.cli._arguments import Arguments
    from atlantis_netcfg.cli._session import Session
    from atlantis_netcfg.errors import ExitCode
    from atlantis_netcfg.operations import Request
    from atlantis_netcfg.operations.proving import Proof, Proving
    from atlantis_netcfg.site import Host

__all__ = ["COMMAND", "run"]

_NOT_REHEARSED = "what is beyond the satellite: nobody answers there, no TCP connection is tried, nobody tells the time"

COMMAND = Command(
    "prove",
    "try what the satellite lets through, and what it must not, within 20 kB",
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
            "try-all", "also try TCP targets and the time, for which rows are added under safe mode and removed again"
        ),
        Flag("rehearse", "the same with an emulated router, configured first", harmless=True),
        ACCEPT_COST,
        JSON,
    ),
    details=(
        "The router pings from the satellite's own address, targets of yours only. Silence counts after 90 s, "
        "because gaps of 70 s are ordinary. Exit code 0: proved, 6: something failed, 7: nothing could be proved."
    ),
    changes=True,
)


def run(arguments: Arguments) -> ExitCode:
    """Ask what it may cost, probe, tell."""
    import json

    from atlantis_netcfg.cli._session import session

    with session(
        arguments, rehearse=arguments.flag("rehearse"), via=arguments.optional("via"), only=(), unsealed=True
    ) as opened:
        proof, bill = _prove(opened)
    beyond = (_NOT_REHEARSED,) if opened.rehearsed else ()
    if opened.as_json:
        told = {"rehearsed": opened.rehearsed, "not_rehearsed": beyond, "cost": bill.as_dict()}
        print(json.dumps({**proof.as_json(), **told}, ensure_ascii=False))
    else:
        cost = f"  {'would have ' if opened.rehearsed else ''}cost over {proof.bearer}: {bill.words}"
        print("\n".join([proof.as_text(), cost, *(f"  not rehearsed: {one}" for one in beyond)]))
    return proof.exit


def _prove(opened: Session) -> tuple[Proof, Bill]:
    import time
    from contextlib import ExitStack
    from dataclasses import replace

    from atlantis_netcfg.bearers.cost import preview
    from atlantis_netcfg.cli._progress import progress
    from atlantis_netcfg.operations.costs import link_of
    from atlantis_netcfg.operations.examples import refuse_examples
    from atlantis_netcfg.operations.proving import satellite_of, try_out

    found = satellite_of(opened.declaration, opened.site, opened.arguments.optional("bearer"))
    opened.hosts = (found.router,)
    refuse_examples(opened.declaration, rehearsed=opened.rehearsed)
    declared = _declared(opened, found.terminal)
    with ExitStack() as stack:
        notify = stack.enter_context(progress(quiet=opened.as_json))
        if opened.rehearsal is not None:
            _configure(opened)
        proving = found.proving(
            opened.declaration,
            open_filter=opened.arguments.flag("open-filter"),
            try_all=opened.arguments.flag("try-all"),
            rehearsed=opened.rehearsed,
        )
        proving.notify = notify
        _pay(opened, proving)
        if proving.open_filter or proving.try_all:
            stack.enter_context(opened.store.lock(opened.site, f"provision prove site={opened.site}"))
        begun = time.monotonic()
        proof = try_out(opened.declaration, found.router, _request(opened), proving)
    link = link_of(opened.declaration, opened.site, proof.bearer)
    bill = preview(proof.bytes_counted, time.monotonic() - begun, link).bill
    return replace(proof, findings=(*proof.findings, *declared)), bill


def _declared(opened: Session, terminal: Host) -> tuple[Finding, ...]:
    """What the terminal's evidence and the names of the allow-list say; in a rehearsal no name is asked for."""
    from datetime import UTC, datetime
    from pathlib import Path

    from atlantis_netcfg.operations.proving import names_of
    from atlantis_netcfg.operations.terminals import look

    backup = opened.arguments.optional("backup")
    today = datetime.now(UTC).astimezone().date()
    named = None if backup is None else Path(backup)
    seen = look(opened.declaration, terminal, opened.store, today=today, backup=named)
    names = () if opened.rehearsed else names_of(opened.declaration, opened.site, opened.arguments.optional("bearer"))
    return (*seen.findings, *names)


def _configure(opened: Session) -> None:
    """Bring the emulated router to its declared state: fresh from `provision adopt` it has no filter."""
    from atlantis_netcfg.errors import ExitCode, NetcfgError
    from atlantis_netcfg.operations import Mode

    report = opened.perform(Mode.APPLY)
    if report.exit is not ExitCode.DONE:
        raise NetcfgError(f"the emulated router could not be configured:\n{report.as_text()}")


def _request(opened: Session) -> Request:
    from atlantis_netcfg.operations import Mode

    return opened.request(Mode.DRIFT)


def _pay(opened: Session, proving: Proving) -> None:
    """Tell what it costs, and return when somebody pays. Raises CostRefused; a rehearsal costs nothing."""
    from atlantis_netcfg.bearers.cost import preview
    from atlantis_netcfg.cli._consent import pays
    from atlantis_netcfg.operations.costs import gate, link_of

    # The session to the router may go over a link that is paid by the byte as well.
    gate(opened.declaration, opened.hosts, _request(opened))
    link = link_of(opened.declaration, opened.site, proving.bearer.name)
    estimate = preview(proving.expected_bytes, proving.seconds, link)
    if opened.rehearsed:
        if not opened.as_json:
            print(f"a real proof asks first: {estimate.words}")
        return
    if estimate.over_cap:
        raise estimate.refusal()
    if opened.arguments.flag(ACCEPT_COST.name):
        if not opened.as_json:
            print(f"This goes {estimate.words}", flush=True)
        return
    if estimate.link.metered:
        pays([estimate.words], ask=not opened.as_json)
