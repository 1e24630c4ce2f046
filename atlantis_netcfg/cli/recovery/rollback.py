"""`provision recover rollback`: restore a device's state before a run, protected like any other change."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli.base import syntax
from atlantis_netcfg.cli.base.inventory_names import Values
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, msg

if TYPE_CHECKING:
    from atlantis_netcfg.cli.base.session import CommandSession
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.runs import Run
    from atlantis_netcfg.runs.report.run import RunReport

ROLLBACK = syntax.CommandSpec(
    "recover rollback",
    "restore a site's devices to their state before a run",
    words=(
        syntax.Word("site", "the site of the run", is_required=True, example="coastal"),
        syntax.Word(
            "run",
            "run to undo, as in `provision report runs`, or `latest`: the newest with a saved state, except rollbacks",
            is_required=True,
            example="latest",
            values=Values.RUN_OR_LATEST,
        ),
        syntax.DEVICES,
        syntax.INVENTORY,
    ),
    flags=(
        syntax.Flag("plan", "show changes and their cost, change nothing", harmless=True),
        syntax.Flag(
            "rehearse",
            "use emulated devices, in the last state read from the real",
            harmless=True,
        ),
        syntax.YES,
        *syntax.CHANGE,
    ),
    details=(
        "The saved state has no secrets: those on the device are kept. A rehearsal uses runs of the real site "
        "or, if there are none, of earlier rehearsals. Later changes on the real device are not included: "
        "`--plan` shows them."
    ),
    changes=True,
    plays=True,
)


def run_rollback(arguments: syntax.Arguments) -> ExitCode:
    """Run `recover rollback`: show the changes, ask, then roll back every device with a state saved by the run."""
    from atlantis_netcfg.cli.base.rehearsal import announce
    from atlantis_netcfg.cli.base.session import session

    runs: list[Run] = []
    is_rehearsal = arguments.flag("rehearse")

    def choose_hosts(inventory: Inventory) -> tuple[Host, ...]:
        run, hosts = _choose_run(inventory, arguments)
        runs.append(run)
        return hosts

    with session(arguments, rehearse=is_rehearsal, choose_hosts=choose_hosts) as site_session:
        (run,) = runs
        site_session.back_to = run.id
        if is_rehearsal:
            announce(site_session)
        _tell(site_session, run)
        report = _rehearse(site_session, run) if is_rehearsal else _roll_back_devices(site_session)
    return site_session.close(report)


def _choose_run(inventory: Inventory, arguments: syntax.Arguments) -> tuple[Run, tuple[Host, ...]]:
    """Return the run, and those of the hosts with a state saved by it. Raises NoMatchError."""
    from atlantis_netcfg.cli.base.session import require_handled
    from atlantis_netcfg.core import paths
    from atlantis_netcfg.inventory import choose
    from atlantis_netcfg.operations.common.kinds import is_supported
    from atlantis_netcfg.operations.common.saved_states import hosts_to_restore, saved_run

    site = arguments.word("site")
    only = arguments.many("device")
    site_hosts = choose(inventory, site, only)
    require_handled(site_hosts, only, arguments.command.name)
    hosts = tuple(host for host in site_hosts if is_supported(host))
    names = [host.name for host in hosts]
    run = saved_run(paths.state_dir(), site, arguments.word("run"), names, is_rehearsal=arguments.flag("rehearse"))
    return run, hosts_to_restore(run, hosts, is_explicit=bool(only))


def _tell(session: CommandSession, run: Run) -> None:
    """Print the run before which the state was saved, because `latest` does not identify it."""
    if session.as_json:
        return
    start = run.start_record
    when = f"{run.at:%Y-%m-%d %H:%M} UTC" if run.at is not None else ""
    print(translate(f"back to the state before run {arg(run.id)} ({arg(when)}, exit {arg(run.exit)})"), flush=True)
    if start is not None:
        print(f"  {start.command}", flush=True)
    if start is not None and start.rehearsed:
        print(f"  {translate('this was a rehearsal with emulated devices')}", flush=True)
    for host, outcome in run.outcomes.items():
        if run.before(host) is None:
            note = translate(f"{arg(host)} is not changed: the run saved no state of it")
            print(msg(f"  {arg(note)} ({arg(outcome.status)})"), flush=True)


def _roll_back_devices(session: CommandSession) -> RunReport:
    if session.arguments.flag("plan"):
        return session.plan()
    return session.change(ask=not session.arguments.flag("yes"))


def _rehearse(session: CommandSession, run: Run) -> RunReport:
    """Restore the run's saved state on emulated devices; repeated runs over each link must change nothing."""
    from atlantis_netcfg.cli.base.rehearsal import rehearse
    from atlantis_netcfg.cli.recovery._rehearsed import rehearse_from
    from atlantis_netcfg.operations.common.saved_states import before_rollback

    def go_on() -> RunReport:
        if session.arguments.flag("plan") or session.rehearsal is None:
            return session.plan()
        return rehearse(session, session.rehearsal)

    start = before_rollback(session.state, session.hosts, run)
    return rehearse_from(session, start, go_on, msg(f"the rollback of run {arg(run.id)}"))
