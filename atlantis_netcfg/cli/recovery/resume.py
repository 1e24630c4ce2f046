"""`provision recover resume`: continue a run that was interrupted, or whose outcome is unknown."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli.base import syntax
from atlantis_netcfg.cli.base.inventory_names import Values
from atlantis_netcfg.core import errors
from atlantis_netcfg.core.messages import arg, msg

if TYPE_CHECKING:
    from pathlib import Path

    from atlantis_netcfg.cli.base.session import CommandSession
    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.runs import Run
    from atlantis_netcfg.runs.report.run import RunReport

RESUME = syntax.CommandSpec(
    "recover resume",
    "resume an interrupted run",
    words=(
        syntax.Word("site", "the site of the run", is_required=True, example="coastal"),
        syntax.Word(
            "run",
            "run from `provision report runs` (default: latest unfinished)",
            values=Values.RUN,
        ),
        syntax.INVENTORY,
    ),
    flags=(
        syntax.Flag("plan", "show changes and their cost; change nothing, do not wait", harmless=True),
        syntax.Flag("rehearse", "use emulated devices, in their state before the run", harmless=True),
        *syntax.CHANGE,
    ),
    details=(
        "First waits until changes that an interrupted run left unconfirmed on a device are settled. `--plan` "
        "does not wait: it shows the current differences, which the device itself may still undo.\nIn a "
        "rehearsal no change is pending: the emulated device starts from the state before the run, as if the "
        "real device had undone everything. It uses runs of the real site or, if none is unfinished, those of "
        "earlier rehearsals."
    ),
    changes=True,
    plays=True,
)


def run_resume(arguments: syntax.Arguments) -> errors.ExitCode:
    """Wait until the devices have rolled back what the broken run left open, then bring them to the desired state."""
    from atlantis_netcfg.cli.base.session import session

    if arguments.flag("rehearse"):
        return _run_rehearsed(arguments)
    with session(arguments) as site_session:
        try:
            broken = _broken(site_session.state, site_session.site, arguments.optional("run"))
        except errors.NoMatchError as nothing:
            report = _left_by_others(site_session, arguments.optional("run"), nothing)
        else:
            report = _resume(site_session, broken)
    return site_session.close(report)


def _run_rehearsed(arguments: syntax.Arguments) -> errors.ExitCode:
    """Run `recover resume` with emulated devices; the run is located before any of them is started."""
    from atlantis_netcfg.cli.base.rehearsal import announce
    from atlantis_netcfg.cli.base.session import session
    from atlantis_netcfg.core import paths
    from atlantis_netcfg.inventory import choose
    from atlantis_netcfg.operations.common.saved_states import hosts_of_run

    runs: list[Run] = []

    def choose_hosts(inventory: Inventory) -> tuple[Host, ...]:
        site = arguments.word("site")
        site_hosts = choose(inventory, site)
        broken = _broken(paths.state_dir(), site, arguments.optional("run"), is_rehearsal=True)
        _refuse_others(broken)
        _refuse_settled(broken)
        runs.append(broken)
        return hosts_of_run(site_hosts, broken.undone)

    with session(arguments, rehearse=True, choose_hosts=choose_hosts) as site_session:
        (broken,) = runs
        announce(site_session)
        _aim(site_session, broken)
        report = _rehearse(site_session, broken)
    return site_session.close(report)


def _rehearse(session: CommandSession, broken: Run) -> RunReport:
    """Continue like the real command; the repeated runs over each link must change nothing."""
    from atlantis_netcfg.cli.base.rehearsal import rehearse
    from atlantis_netcfg.cli.recovery._rehearsed import rehearse_from
    from atlantis_netcfg.operations import Mode
    from atlantis_netcfg.operations.common.saved_states import before_resuming

    def go_on() -> RunReport:
        if session.arguments.flag("plan") or session.rehearsal is None:
            return session.plan()
        return rehearse(session, session.rehearsal, mode=Mode.RESUME, run=broken.id)

    start = before_resuming(session.state, session.hosts, broken)
    return rehearse_from(session, start, go_on, msg(f"how to continue run {arg(broken.id)}"))


def _broken(state: Path, site: str, name: str | None, *, is_rehearsal: bool = False) -> Run:
    """Return the run given by name, or the latest unfinished one. Raises NoMatchError."""
    from atlantis_netcfg.operations.common.saved_states import saved_run, stores
    from atlantis_netcfg.runs import Purpose

    if name is not None:
        named_run = saved_run(state, site, name, is_rehearsal=is_rehearsal)
        if named_run.start_record is None and named_run.damage:
            raise named_run.damage_error("the run cannot be resumed: run its command again")
        return named_run
    open_runs = next(
        (runs for store in stores(state, is_rehearsal=is_rehearsal) if (runs := store.unfinished_runs(site))), ()
    )
    if not open_runs:
        raise errors.NoMatchError(f"{arg(site)} has no unfinished run", hint="`provision report runs` lists all runs")
    return next((run for run in reversed(open_runs) if run.purpose is Purpose.CONFIGURE), open_runs[-1])


def _resume(session: CommandSession, broken: Run) -> RunReport:
    """Continue a run of this computer, also on devices that it had not started, or that were rolled back."""
    from atlantis_netcfg.operations import Mode

    _refuse_others(broken)
    _refuse_settled(broken)
    session.narrow(broken.undone)
    _aim(session, broken)
    if session.arguments.flag("plan"):
        return session.plan()
    return session.perform(Mode.RESUME, run=broken.id)


def _aim(session: CommandSession, broken: Run) -> None:
    """Use the target state of the broken run, and print it."""
    _print_broken_run(session, broken)
    if broken.start_record is not None:
        session.back_to, session.restore = broken.start_record.back_to, broken.start_record.restore


def _left_by_others(session: CommandSession, name: str | None, nothing: errors.NoMatchError) -> RunReport:
    """Without a run in this journal, look on the devices for an unfinished run of another computer.

    Raises `nothing` if there is none on them either.
    """
    from atlantis_netcfg.operations import Mode

    if session.inventory.pilot.example_values or not session.handled_hosts:
        raise nothing
    session.narrow([host.name for host in session.handled_hosts])
    if not session.as_json:
        print(msg(f"{arg(nothing)}; checking its devices"), flush=True)
    report = session.perform(Mode.PLAN)
    busy = {device: str(result["busy"]) for device, result in report.devices.items() if result.get("busy")}
    if name is not None:
        busy = {device: words for device, words in busy.items() if f"run {name} of " in words}
    if busy and session.arguments.flag("plan"):
        session.show_plan(report)
        return report
    if busy:
        session.narrow([*busy])
        return session.perform(Mode.RESUME, run=name)
    if report.exit is errors.ExitCode.CHANGES:
        raise errors.NoMatchError(
            f"{arg(nothing)}; no change is pending on its devices, but they differ from the inventory",
            hint=f"to apply the inventory, run:  provision site={arg(session.site)}",
        )
    if report.exit is errors.ExitCode.DONE:
        raise nothing
    return report


def _refuse_others(broken: Run) -> None:
    """Raise UsageError for runs of other commands, which are repeated and continue from the device's state."""
    from atlantis_netcfg.runs import Purpose

    repeatable = {
        Purpose.ADOPT: "an adoption",
        Purpose.UPGRADE: "an upgrade",
        Purpose.INSTALL: "an import of a VPN identity",
    }
    if broken.purpose in repeatable:
        what = repeatable[broken.purpose]
        raise errors.UsageError(
            f"run {arg(broken.id)} was {arg(what)}", hint=f"repeat it: `{arg(broken.next_command)}`"
        )


def _refuse_settled(broken: Run) -> None:
    """Raise NoMatchError if the run left nothing open, although it may not be complete on all devices."""
    if (
        broken.unsettled_devices
        or broken.start_record is None
        or not broken.start_record.command.startswith("provision ")
    ):
        return
    raise errors.NoMatchError(
        f"run {arg(broken.id)} has left nothing pending on any device",
        hint=f"to complete it, run its command again:  {arg(broken.start_record.command)}",
    )


def _print_broken_run(session: CommandSession, broken: Run) -> None:
    if session.as_json:
        return
    print(
        msg(
            f"run {arg(broken.id)}: "
            f"{arg(broken.start_record.command if broken.start_record else 'killed before it started')}"
        )
    )
    for host in broken.undone:
        progress = msg(
            f"{arg(len(broken.confirmed_actions(host)))} actions were confirmed, "
            f"{arg(len(broken.acknowledged_actions(host)))} acknowledged"
        )
        print(msg(f"  {arg(host):<18} {arg(progress)}"))
    start = broken.start_record
    if start is not None and (start.back_to or start.restore):
        print(msg(f"  it continues towards the saved state of run {arg(start.back_to or start.restore)}"))
    elif start is not None and start.revision != session.inventory.revision:
        print("  the inventory has changed since then: the current inventory is applied")
