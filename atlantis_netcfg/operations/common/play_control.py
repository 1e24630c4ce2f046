"""The link between a playbook in this process and its caller: stop requests and interruption.

Ansible creates callback plugins itself and passes them nothing. So the play that `provision` runs is registered here
while it runs; in plain `ansible-playbook` there is none. Tasks run in forked children, which see what was registered
when they started.

Also the results of hosts for which Ansible returned none, from the journal, which is written in advance.
"""

from __future__ import annotations

import os
import signal
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core.crash_report import write_log
from atlantis_netcfg.core.errors import ExitCode, NetcfgError
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.core.processes import stop_signals
from atlantis_netcfg.operations.common.kinds import is_supported
from atlantis_netcfg.routeros.apply import DeviceResult, Status
from atlantis_netcfg.runs import Run, Store
from atlantis_netcfg.runs.records import DeviceObservation, PlanRecord, StateBackup

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
    from types import FrameType

    from atlantis_netcfg.inventory import Inventory
    from atlantis_netcfg.operations.common.request import Request


@dataclass(slots=True)
class PlayControl:
    """One play: the first stop signal makes its workers finish safely, the next one ends them."""

    workers: Callable[[], list[int]] = list
    """Process ids of the running tasks."""
    stopped_by: str = ""
    """Name of the signal, like `SIGINT`; empty: not stopped."""
    cleanups: list[Callable[[str], None]] = field(default_factory=list)
    """Functions called with the reason if Ansible ended without reporting it."""
    _ignored_signals: tuple[int, ...] = ()

    @contextmanager
    def current(self) -> Iterator[PlayControl]:
        """Register this play for plugins and handle stop signals during the context; main thread only."""
        before = stop_signals.handlers()
        self._ignored_signals = tuple(number for number, handler in before.items() if handler is signal.SIG_IGN)
        _current.append(self)
        try:
            yield self
        finally:
            _current.remove(self)
            stop_signals.restore(before)

    def take_signals(self) -> None:
        """Handle the stop signals from now on; Ansible sets its own handlers when it creates a play.

        A signal that this process ignores (`nohup`) stays ignored. Raises KeyboardInterrupt if one arrived during the
        import of a module: nothing has started yet.
        """
        if name := stop_signals.pending_stop():
            raise KeyboardInterrupt(name)
        for number in stop_signals.STOP_SIGNALS:
            signal.signal(number, signal.SIG_IGN if number in self._ignored_signals else self._stop)

    def _stop(self, number: int, _frame: FrameType | None) -> None:
        """Forward the signal to the workers as SIGINT: the first lets them finish safely, the second ends them."""
        self.stopped_by = self.stopped_by or signal.Signals(number).name
        for worker in self.workers():
            with suppress(ProcessLookupError):
                os.kill(worker, signal.SIGINT)

    def cut_off(self, reason: str) -> None:
        """Call the cleanups: Ansible ended in the middle of a play, and open results must be closed."""
        for cleanup in self.cleanups:
            cleanup(reason)


_current: list[PlayControl] = []


def refuse_after_stop() -> None:
    """Raise KeyboardInterrupt if a person has stopped the play, so that no further task starts."""
    if _current and _current[-1].stopped_by:
        raise KeyboardInterrupt(_current[-1].stopped_by)


def on_interrupt(cleanup: Callable[[str], None]) -> None:
    """Register a cleanup that is called, with the reason, if the play ends without its last event."""
    if _current:
        _current[-1].cleanups.append(cleanup)


_READING = (DeviceObservation, StateBackup, PlanRecord)
"""Records made while nothing was changed or armed yet: changing and arming are recorded before they are sent."""


def results_from_journal(  # noqa: PLR0913, PLR0917 - one call, from one place
    names: Sequence[str],
    requested_names: Collection[str],
    inventory: Inventory,
    request: Request,
    runs: Mapping[str, Mapping[str, str]],
    reason: NetcfgError | str,
    output: str,
) -> dict[str, dict[str, Any]]:
    """Return a result from the journal for each host without one; requested were these and the other bridge ends.

    The status is `left-as-found` (4), `unknown` (5), or the end that the journal records: that is not green (6), since
    the end of the run was not observed.

    `reason` is why they have none, as far as known; `output` is what Ansible printed. It is saved in a log file, except
    after a refusal by this toolkit, which is complete by itself.
    """
    if not names:
        return {}
    note, results = [] if isinstance(reason, NetcfgError) else _log_output(output, request), {}
    others = other_ends(names, inventory, request)
    for name in names:
        site = inventory.hosts[name].site
        run, recorded_run = _journal(name, site, runs.get(site, {}).values(), request)
        # The far end of a bridge was reached from the site of the near one.
        start = name if name in requested_names else others.get(name, name)
        hint = f"provision recover resume site={inventory.hosts[start].site} run={run}"
        if is_supported(inventory.hosts[name]):
            hint = msg(f"{arg(_TAKES_BACK)}; then:  {arg(hint)}")
        result = _unreached_result(name, run, recorded_run, str(reason) or "it ended without a result", hint, request)
        if isinstance(reason, NetcfgError) and result.status is Status.LEFT_AS_FOUND:
            # A refusal has a code of its own (an inventory that cannot be used: 3), but nothing of it is green.
            result = DeviceResult(name, result.status, reason.exit or ExitCode.FAILED, str(reason), reason.hint)
        results[name] = {**result.as_dict(), "notes": note, "other_end": others.get(name)}
    return results


def other_ends(names: Sequence[str], inventory: Inventory, request: Request) -> dict[str, str]:
    """Return both ends of every bridge that has one of these hosts as an end, each with the other one."""
    from atlantis_netcfg.operations.common.schedule import members_of  # noqa: PLC0415 - what plays nothing needs no pairs

    try:
        members = members_of(inventory, [name for name in names if is_supported(inventory.hosts[name])], request)
    except NetcfgError:  # then nothing was begun on any of them
        return {}
    bridges = [member.bridge.ends for member in members if member.bridge is not None]
    return {end.name: other.name for ends in bridges for end, other in (ends, ends[::-1])}


def _unreached_result(  # noqa: PLR0913, PLR0917 - as above
    name: str, run: str, recorded_run: Run | None, reason: str, hint: str, request: Request
) -> DeviceResult:
    if request.mode.reads_only:
        return DeviceResult(name, Status.LEFT_AS_FOUND, ExitCode.FAILED, msg(f"not read: {arg(reason)}"), _AGAIN)
    if recorded_run is not None and name in recorded_run.settled_devices:
        return _recorded_result(recorded_run, name, reason)
    if (run and recorded_run is None) or (recorded_run is not None and _is_touched(recorded_run, name)):
        return DeviceResult(name, Status.UNKNOWN, ExitCode.UNKNOWN, msg(f"the outcome is unknown: {arg(reason)}"), hint)
    return DeviceResult(name, Status.LEFT_AS_FOUND, ExitCode.FAILED, msg(f"nothing was changed: {arg(reason)}"), _AGAIN)


_AGAIN = "run the same command again"
_TAKES_BACK = "the device itself undoes unconfirmed changes, within ten minutes if the link is lost"


def _journal(name: str, site: str, runs: Iterable[str], request: Request) -> tuple[str, Run | None]:
    """Find and read the run started for this host among those of its site; an empty name means none was started.

    A name without a journal: the journal is missing, which proves nothing.
    """
    store = Store(request.state, is_rehearsal=request.rehearsed)
    for run_id in dict.fromkeys(filter(None, runs)):
        try:
            recorded_run = store.run(site, run_id)
        except NetcfgError:
            return run_id, None
        if recorded_run.start_record is None:
            return run_id, None
        if name in recorded_run.start_record.hosts:
            return run_id, recorded_run
    return "", None


def _is_touched(recorded_run: Run, name: str) -> bool:
    """Return whether anything that changes the device was, or may have been, sent."""
    records = recorded_run.log.records
    return any(getattr(record, "device", None) == name and not isinstance(record, _READING) for record in records)


def _recorded_result(recorded_run: Run, name: str, reason: str) -> DeviceResult:
    """Return the recorded end of a device whose process died after writing it; `resume` has nothing to do."""
    outcome = recorded_run.outcomes[name]
    message, code = msg(f"{arg(outcome.message)}; then: {arg(reason)}"), ExitCode(outcome.exit).unproven_code
    confirmed_actions = len(recorded_run.confirmed_actions(name))
    return DeviceResult(name, Status(outcome.status), code, message, _AGAIN, confirmed_count=confirmed_actions)


def _log_output(output: str, request: Request) -> list[str]:
    """Save Ansible's output in a log file and return a note with its name."""
    if not output:
        return []
    try:
        return [msg(f"the output of Ansible is in {arg(write_log(output + chr(10), request.command, request.state))}")]
    except (NetcfgError, OSError) as error:
        return [msg(f"cannot write a log file: {arg(error)}")]
