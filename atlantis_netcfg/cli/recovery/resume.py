"""`provision resume`: go on with a run that was killed, or that lost the link before its outcome was known."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli.base.arguments import CHANGE, INVENTORY, Arguments, CommandSpec, Flag, Group, Word
from atlantis_netcfg.cli.base.inventory_names import Values
from atlantis_netcfg.core.errors import ExitCode, NothingMatched, UsageError

if TYPE_CHECKING:
    from pathlib import Path

    from atlantis_netcfg.cli.base.session import CommandSession
    from atlantis_netcfg.inventory import Declaration, Host
    from atlantis_netcfg.runs import Run
    from atlantis_netcfg.runs.report.run import RunReport

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
    flags=(
        Flag("plan", "show what would change and what it costs, change nothing, wait for nothing", harmless=True),
        Flag(
            "rehearse", "the same against emulated devices, first brought to their states before the run", harmless=True
        ),
        *CHANGE,
    ),
    details=(
        "What a broken run has left open on a device is waited for first. `--plan` does not wait: it shows what "
        "differs now, which the device itself may still take back.\n"
        "In a rehearsal nothing is open: the emulated device has the state before the run, as if the real one had "
        "taken everything back. It takes the runs of the real site; where none is unfinished, those of earlier "
        "rehearsals."
    ),
    changes=True,
    plays=True,
)


def run_resume(arguments: Arguments) -> ExitCode:
    """Wait until the devices have taken back what the broken run left open, then bring them to the declared state."""
    from atlantis_netcfg.cli.base.session import session

    if arguments.flag("rehearse"):
        return _run_rehearsed(arguments)
    with session(arguments) as opened:
        try:
            broken = _broken(opened.state, opened.site, arguments.optional("run"))
        except NothingMatched as nothing:
            report = _left_by_others(opened, arguments.optional("run"), nothing)
        else:
            report = _resumed(opened, broken)
    return opened.close(report)


def _run_rehearsed(arguments: Arguments) -> ExitCode:
    """The same against emulated devices; the run is found before any of them is started."""
    from atlantis_netcfg.cli.base.rehearsal import announce
    from atlantis_netcfg.cli.base.session import session
    from atlantis_netcfg.core import paths
    from atlantis_netcfg.inventory import choose
    from atlantis_netcfg.operations.common.saved_states import hosts_of_run

    found: list[Run] = []

    def chosen(declaration: Declaration) -> tuple[Host, ...]:
        site = arguments.word("site")
        named = choose(declaration, site)
        broken = _broken(paths.state_dir(), site, arguments.optional("run"), rehearsed=True)
        _refuse_others(broken)
        _refuse_settled(broken)
        found.append(broken)
        return hosts_of_run(named, broken.undone)

    with session(arguments, rehearse=True, chosen=chosen) as opened:
        (broken,) = found
        announce(opened)
        _aim(opened, broken)
        report = _rehearsed(opened, broken)
    return opened.close(report)


def _rehearsed(opened: CommandSession, broken: Run) -> RunReport:
    """Go on as the real command would; again over each bearer, nothing may be left to change."""
    from atlantis_netcfg.cli.base.rehearsal import rehearse
    from atlantis_netcfg.cli.recovery._rehearsed import rehearse_from
    from atlantis_netcfg.operations import Mode
    from atlantis_netcfg.operations.common.saved_states import before_resuming

    def go_on() -> RunReport:
        if opened.arguments.flag("plan") or opened.rehearsal is None:
            return opened.plan()
        return rehearse(opened, opened.rehearsal, mode=Mode.RESUME, run=broken.id)

    start = before_resuming(opened.state, opened.hosts, broken)
    return rehearse_from(opened, start, go_on, f"how run {broken.id} goes on")


def _broken(state: Path, site: str, name: str | None, *, rehearsed: bool = False) -> Run:
    """The run that was named, or the latest unfinished one. Raises NothingMatched."""
    from atlantis_netcfg.operations.common.saved_states import saved_run, stores
    from atlantis_netcfg.runs import Purpose

    if name is not None:
        named = saved_run(state, site, name, rehearsed=rehearsed)
        if named.started is None and named.damage:
            raise named.damage_error("the run cannot be resumed: type its command again")
        return named
    unfinished = next((runs for store in stores(state, rehearsed=rehearsed) if (runs := store.unfinished(site))), ())
    if not unfinished:
        raise NothingMatched(f"no run of {site} is unfinished", hint="`provision runs` lists all of them")
    return next((run for run in reversed(unfinished) if run.purpose is Purpose.CONFIGURE), unfinished[-1])


def _resumed(opened: CommandSession, broken: Run) -> RunReport:
    """Go on with a run of this computer: also on devices whose turn had not come, or which were as before again."""
    from atlantis_netcfg.operations import Mode

    _refuse_others(broken)
    _refuse_settled(broken)
    opened.narrow(broken.undone)
    _aim(opened, broken)
    if opened.arguments.flag("plan"):
        return opened.plan()
    return opened.perform(Mode.RESUME, run=broken.id)


def _aim(opened: CommandSession, broken: Run) -> None:
    """Go where the run was going, and say it."""
    _tell(opened, broken)
    if broken.started is not None:
        opened.back_to, opened.restore = broken.started.back_to, broken.started.restore


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
    if busy and opened.arguments.flag("plan"):
        opened.show_plan(report)
        return report
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
    from atlantis_netcfg.runs import Purpose

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
