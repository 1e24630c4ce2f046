"""Commands of runs: `run` (the default, `provision site=…`), `runs`, `resume`, `rollback`.

`provision runs`: what ran, how it ended, and what is still open.

`provision resume`: go on with a run that was killed, or that lost the link before its outcome was known.

`provision rollback`: put back what a device was before a run, guarded like any other change.

`provision site=coastal`: plan, ask, change, verify.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from atlantis_netcfg.cli._arguments import (
    ACCEPT_COST,
    ASK_VAULT_PASS,
    INVENTORY,
    JSON,
    ONLY,
    REMOVE_FOREIGN,
    STREAM,
    UNPROTECTED,
    VERBOSE,
    VIA,
    Arguments,
    CommandSpec,
    Flag,
    Group,
    Values,
    Word,
)
from atlantis_netcfg.core.errors import ExitCode, NothingMatched, UsageError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from atlantis_netcfg.cli._session import CommandSession
    from atlantis_netcfg.journal import Run, Store
    from atlantis_netcfg.report.run import RunReport


RUNS = CommandSpec(
    "runs",
    "list the runs that changed something or tried to, and what is still open",
    group=Group.FIRST,
    words=(Word("site", "only the runs of this site", example="coastal"),),
    flags=(
        Flag("rehearsed", "the runs of rehearsals instead of real ones"),
        Flag("all", "also those that were put aside, since nothing is open in them and later ones followed"),
        JSON,
    ),
)


def run_runs(arguments: Arguments) -> ExitCode:
    """List them, oldest first; exit 7 when there is none."""
    import json

    from atlantis_netcfg.core import paths
    from atlantis_netcfg.journal import Store

    store = Store(paths.state_dir(), rehearsed=arguments.flag("rehearsed"))
    sites = _sites(store, arguments.optional("site"))
    aside = {site: store.archived(site) for site in sites}
    everything = arguments.flag("all")
    listed = [row for site in sites for row in _rows(store, site, aside[site] if everything else ())]
    archived = sum(map(len, aside.values()))
    if not listed:
        raise NothingMatched("there are no runs", hint="`provision site=NAME` makes the first one")
    if arguments.flag("json"):
        print(
            json.dumps(
                {"exit": int(ExitCode.DONE), "errors": [], "runs": listed, "archived": archived}, ensure_ascii=False
            )
        )
    else:
        print("\n".join(_line(row) for row in listed))
        if archived and not everything:
            print(f"{archived} older runs are put aside: `provision runs --all` lists them too")
    return ExitCode.DONE


def _sites(store: Store, site: str | None) -> tuple[str, ...]:
    known = store.sites()
    if site is None:
        return known
    if site not in known:
        raise NothingMatched(
            f"there are no runs of `{site}`", hint=f"there are runs of: {', '.join(known) or 'no site'}"
        )
    return (site,)


def _rows(store: Store, site: str, archived: Sequence[str]) -> Iterator[dict[str, Any]]:
    """One row a run; each journal is read once."""
    from atlantis_netcfg.journal import unfinished

    runs = store.runs(site)
    open_runs = {run.id for run in unfinished(runs)}
    for item in sorted((*(store.run(site, name) for name in archived), *runs), key=lambda run: run.id):
        yield _row(item, site, unfinished=item.id in open_runs)


def _row(run: Run, site: str, *, unfinished: bool) -> dict[str, Any]:
    started = run.started
    hosts = started.hosts if started else ()
    return {
        "run": run.id,
        "site": site,
        "exit": run.exit,
        "unfinished": unfinished,
        "command": started.command if started else "",
        "next": run.next_command if unfinished else None,
        "devices": {
            host: {
                "status": outcome.status if (outcome := run.outcomes.get(host)) else "not reached",
                "confirmed": len(run.confirmed(host)),
                "saved_state": run.before(host) is not None,
                "confirmed_state": run.confirmed_state(host) is not None,
            }
            for host in hosts
        },
    }


def _line(row: dict[str, Any]) -> str:
    end = f"UNFINISHED, go on: `{row['next']}`" if row["unfinished"] else f"exit {row['exit']}"
    devices = ", ".join(_device(name, outcome) for name, outcome in row["devices"].items())
    return f"{row['run']}  {row['site']:<10} {end}  {devices}"


def _device(name: str, outcome: dict[str, Any]) -> str:
    """How it ended, how many actions were confirmed, and whether `provision restore` can take its state."""
    kept = ", state kept" if outcome["confirmed_state"] else ""
    return f"{name} {outcome['status']} ({outcome['confirmed']}{kept})"


RESUME = CommandSpec(
    "resume",
    "go on with a run that was interrupted, from what the devices have kept",
    group=Group.TROUBLE,
    words=(
        Word("site", "the site of the run", required=True, example="coastal"),
        Word(
            "run",
            "the run, as `provision runs` lists it; the latest unfinished one if left out",
            values=Values.RUN,
        ),
        INVENTORY,
    ),
    flags=(ACCEPT_COST, UNPROTECTED, REMOVE_FOREIGN, ASK_VAULT_PASS, JSON, VERBOSE),
    changes=True,
    plays=True,
)


def run_resume(arguments: Arguments) -> ExitCode:
    """Wait until the devices have taken back what the broken run left open, then bring them to the declared state."""
    from atlantis_netcfg.cli._session import session

    with session(arguments) as opened:
        try:
            broken = _broken(opened, arguments.optional("run"))
        except NothingMatched as nothing:
            report = _left_by_others(opened, arguments.optional("run"), nothing)
        else:
            report = _resumed(opened, broken)
    return opened.close(report)


def _broken(opened: CommandSession, name: str | None) -> Run:
    """The run that was named, or the latest unfinished one. Raises NothingMatched."""
    from atlantis_netcfg.journal import Purpose

    store = opened.store
    if name is not None:
        return store.run(opened.site, name)
    unfinished = store.unfinished(opened.site)
    if not unfinished:
        raise NothingMatched(f"no run of {opened.site} is unfinished", hint="`provision runs` lists all of them")
    return next((run for run in reversed(unfinished) if run.purpose is Purpose.CONFIGURE), unfinished[-1])


def _resumed(opened: CommandSession, broken: Run) -> RunReport:
    """Go on with a run of this computer: also on devices whose turn had not come, or which were as before again."""
    from atlantis_netcfg.operations import Mode

    _refuse_others(broken)
    _refuse_settled(broken)
    _tell(opened, broken)
    opened.narrow(broken.undone)
    if broken.started is not None:
        opened.back_to, opened.restore = broken.started.back_to, broken.started.restore
    return opened.perform(Mode.RESUME, run=broken.id)


def _left_by_others(opened: CommandSession, name: str | None, nothing: NothingMatched) -> RunReport:
    """The journal here knows of nothing: look on the devices for what a run of another computer has left open.

    Raises `nothing` where there is nothing on them either.
    """
    from atlantis_netcfg.operations import Mode

    if opened.declaration.pilot.example_values or not opened.asked:
        raise nothing
    opened.narrow([host.name for host in opened.asked])
    if not opened.as_json:
        print(f"{nothing}; looking on its devices", flush=True)
    report = opened.perform(Mode.PLAN)
    busy = {device: str(result["busy"]) for device, result in report.devices.items() if result.get("busy")}
    if name is not None:
        busy = {device: words for device, words in busy.items() if f"run {name} of " in words}
    if busy:
        opened.narrow([*busy])
        return opened.perform(Mode.RESUME, run=name)
    if report.exit is ExitCode.CHANGES:
        raise NothingMatched(
            f"{nothing}, and nothing is open on its devices, which are not as declared",
            hint=f"to bring them there, type:  provision site={opened.site}",
        )
    if report.exit is ExitCode.DONE:
        raise nothing
    return report


def _refuse_others(broken: Run) -> None:
    """What is no run of the engine is repeated, and goes on by what the device says. Raises UsageError."""
    from atlantis_netcfg.journal import Purpose

    repeated = {
        Purpose.ADOPT: "a first contact",
        Purpose.UPGRADE: "an upgrade",
        Purpose.INSTALL: "an import of a VPN identity",
    }
    if broken.purpose in repeated:
        what = repeated[broken.purpose]
        raise UsageError(f"run {broken.id} was {what}", hint=f"repeat it: `{broken.next_command}`")


def _refuse_settled(broken: Run) -> None:
    """What has left nothing open may still not have come to its end everywhere. Raises NothingMatched."""
    if broken.unsettled or broken.started is None or not broken.started.command.startswith("provision "):
        return
    raise NothingMatched(
        f"run {broken.id} has left nothing open on any device",
        hint=f"to bring them to where it was going, type its command again:  {broken.started.command}",
    )


def _tell(opened: CommandSession, broken: Run) -> None:
    if opened.as_json:
        return
    print(f"run {broken.id}: {broken.started.command if broken.started else 'killed before it had begun'}")
    for host in broken.undone:
        progress = (
            f"{len(broken.confirmed(host))} actions were confirmed, {len(broken.acknowledged(host))} acknowledged"
        )
        print(f"  {host:<18} {progress}")
    started = broken.started
    if started is not None and (started.back_to or started.restore):
        print(f"  it goes on towards the saved state of run {started.back_to or started.restore}")
    elif started is not None and started.revision != opened.declaration.revision:
        print("  the inventory has changed since then: the devices are brought to what it declares now")


ROLLBACK = CommandSpec(
    "rollback",
    "put a site's devices back to what they were before a run",
    group=Group.TROUBLE,
    words=(
        Word("site", "the site of the run", required=True, example="coastal"),
        Word(
            "to",
            "the run, as `provision runs` lists it: its saved state is put back; `latest` is the newest that has one",
            required=True,
            example="latest",
            values=Values.RUN_OR_LATEST,
        ),
        ONLY,
        INVENTORY,
    ),
    flags=(
        Flag("yes", "do not ask before changing devices"),
        ACCEPT_COST,
        UNPROTECTED,
        REMOVE_FOREIGN,
        ASK_VAULT_PASS,
        JSON,
        VERBOSE,
    ),
    details="Secrets are not in the saved state: what the device holds of them stays.",
    changes=True,
    plays=True,
)


def run_rollback(arguments: Arguments) -> ExitCode:
    """Show the way back, ask, then roll back every device of which the run has saved a state."""
    from atlantis_netcfg.cli._session import session

    with session(arguments) as opened:
        saved = opened.store.run(opened.site, arguments.word("to"))
        opened.narrow([host.name for host in opened.hosts if saved.before(host.name) is not None])
        opened.back_to = saved.id
        report = opened.change(ask=not arguments.flag("yes"))
    return opened.close(report)


SITE = CommandSpec(
    "run",
    "bring a site to its declared state, guarded, and read back what came of it",
    group=Group.FIRST,
    words=(
        Word("site", "the site, or `all`", required=True, example="coastal"),
        ONLY,
        VIA,
        INVENTORY,
    ),
    flags=(
        Flag("plan", "show what would change and what it costs, change nothing", harmless=True),
        Flag("rehearse", "the same run against emulated devices of the site", harmless=True),
        Flag("offline", "gateways take packages and sources from this bundle alone", takes="BUNDLE"),
        Flag("yes", "do not ask before changing devices"),
        ACCEPT_COST,
        UNPROTECTED,
        REMOVE_FOREIGN,
        ASK_VAULT_PASS,
        JSON,
        STREAM,
        VERBOSE,
    ),
    changes=True,
    plays=True,
)


def run_site(arguments: Arguments) -> ExitCode:
    """Plan, ask, apply, read back."""
    from atlantis_netcfg.cli._session import session

    bundle = _bundle(arguments)
    with session(arguments, rehearse=arguments.flag("rehearse"), via=arguments.optional("via")) as opened:
        opened.offline = bundle
        if arguments.flag("plan"):
            report = opened.plan()
        elif opened.rehearsal is not None:
            from atlantis_netcfg.cli._rehearse import rehearse

            report = rehearse(opened, opened.rehearsal)
        else:
            report = opened.change(ask=not arguments.flag("yes"))
    return opened.close(report)


def _bundle(arguments: Arguments) -> Path | None:
    """The bundle that was named. Raises UsageError where it cannot be used."""
    from pathlib import Path

    from atlantis_netcfg.core.errors import UsageError

    named = arguments.value("offline")
    if named is not None and arguments.flag("rehearse"):
        raise UsageError(
            "`--offline` with `--rehearse`: the gateways of a rehearsal are not the systems that a bundle is made for",
            hint="leave one of them out; `--plan` shows what would be taken from the bundle",
        )
    return Path(named).absolute() if named is not None else None
