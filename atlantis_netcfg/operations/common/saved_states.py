"""Runs whose saved states are restored, and the start state of a rehearsal of that.

A rehearsal uses the runs of the real site or, without any, those of earlier rehearsals; a real run only real ones. An
emulated device starts freshly adopted: before a rollback or a resumed run can be rehearsed on it, the same engine
brings it to a state that represents the real device, and reads it back.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg import runs
from atlantis_netcfg.core.errors import NoMatchError
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.operations.common.kinds import is_supported
from atlantis_netcfg.operations.restore import LATEST

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Sequence
    from pathlib import Path

    from atlantis_netcfg.inventory import Host


@dataclass(frozen=True, slots=True)
class StartState:
    """The start state of an emulated device: before a run, as read back by a run, or as in the inventory."""

    host: str
    words: str
    """Description of the state."""
    gap: str
    """What the state does not cover."""
    back_to: str | None = None
    restore: str | None = None
    is_ready: bool = False
    """The device already has this state; nothing is changed."""


_LIST_HINT = "`provision report runs` lists the runs"


def hosts_of_run(hosts: Iterable[Host], names: Collection[str]) -> tuple[Host, ...]:
    """Return the hosts that a run concerns; raise NoMatchError if there are none."""
    result = tuple(host for host in hosts if host.name in names)
    if not result:
        raise NoMatchError("nothing to do for any device of that run", hint=_LIST_HINT)
    return result


def stores(state: Path, *, is_rehearsal: bool) -> tuple[runs.Store, ...]:
    """Return the stores in which runs are searched, in this order."""
    return tuple(
        runs.Store(state, is_rehearsal=is_emulated) for is_emulated in ((False, True) if is_rehearsal else (False,))
    )


def saved_run(state: Path, site: str, name: str, hosts: Iterable[str] = (), *, is_rehearsal: bool = False) -> runs.Run:
    """Find the run whose saved state is restored; `latest` is the newest that saved a state of these hosts.

    Rollbacks are skipped: repeating `run=latest` stays at the same state instead of undoing the rollback. So are runs
    that only prepared the emulated devices of a rehearsal. Raises NoMatchError, NoSuchRun.
    """
    places = stores(state, is_rehearsal=is_rehearsal)
    if name != LATEST:
        return _find_run(places, site, name)
    devices = tuple(hosts)
    for store in places:
        for run in reversed(store.runs(site)):
            if run.start_record is not None and (run.start_record.back_to is not None or run.start_record.prepares):
                continue
            if run.damage or any(run.before(device) is not None for device in devices):
                return run
    raise NoMatchError(f"no run of {arg(site)} has a saved state of {arg(join(', ', devices))}", hint=_LIST_HINT)


def hosts_to_restore(run: runs.Run, hosts: Sequence[Host], *, is_explicit: bool) -> tuple[Host, ...]:
    """Return the hosts whose state before a run is restored; `is_explicit`: a person selected them by name.

    Raises DamagedStateError if the journal does not contain the end of one of the others; then a person must name those
    to restore. Raises NoMatchError if none is left.
    """
    saved_hosts = tuple(host for host in hosts if run.before(host.name) is not None)
    known_hosts = run.start_record.hosts if run.start_record is not None else [host.name for host in hosts]
    settled_hosts = run.settled_devices
    unknown = [
        host.name
        for host in hosts
        if host not in saved_hosts and host.name in known_hosts and host.name not in settled_hosts
    ]
    rest = ",".join(host.name for host in saved_hosts)
    hint = "choose another run: `provision report runs` lists them"
    if rest:
        hint = msg(
            f"restore only what was saved: `provision recover rollback site={arg(hosts[0].site)} run={arg(run.id)} "
            f"device={arg(rest)}`"
        )
    if run.damage and not (is_explicit and saved_hosts):
        raise run.damage_error(hint)
    if unknown:
        raise runs.DamagedStateError(
            f"the journal of run {arg(run.id)} does not record the outcome for {arg(join(', ', unknown))}", hint=hint
        )
    return hosts_of_run(hosts, [host.name for host in saved_hosts])


def _find_run(places: Sequence[runs.Store], site: str, name: str) -> runs.Run:
    """Return the run of that name; raise NoSuchRun, which lists the runs of the first store that has any."""
    candidates = [store for store in places if site in store.sites()] or [*places]
    for store in candidates:
        with suppress(runs.NoSuchRun):
            return store.run(site, name)
    return candidates[0].run(site, name)


def before_rollback(state: Path, hosts: Sequence[Host], run: runs.Run) -> list[StartState]:
    """Return the current states of the devices: the last one read back, else that of the inventory."""
    return [
        _state_read_back(host, last)
        if (last := _last_confirmed(state, host, run)) is not None
        else StartState(
            host.name,
            "never verified by a run: the inventory is applied first",
            msg(f"current state of {arg(host.name)}: the inventory is used instead"),
        )
        for host in hosts
    ]


def before_resuming(state: Path, hosts: Sequence[Host], broken: runs.Run) -> list[StartState]:
    """Return the states of the devices after the interrupted run, if they have rolled its changes back."""
    return [_state_before_resuming(state, host, broken) for host in hosts]


def _state_before_resuming(state: Path, host: Host, broken: runs.Run) -> StartState:
    if not is_supported(host):
        return StartState(
            host.name,
            "factory state: no state of such a device is saved",
            msg(f"what run {arg(broken.id)} left on {arg(host.name)}: the factory state is used instead"),
            is_ready=True,
        )
    if broken.before(host.name) is not None:
        confirmed_count = len(broken.confirmed_actions(host.name))
        again = msg(
            f"; the {arg(confirmed_count)} actions that it had confirmed are repeated" if confirmed_count else ""
        )
        return StartState(
            host.name,
            msg(f"starts from the state before run {arg(broken.id)}{arg(again)}"),
            msg(
                f"what run {arg(broken.id)} left pending or kept on {arg(host.name)}: the state before it is used "
                "instead"
            ),
            back_to=broken.id,
        )
    last = _last_confirmed(state, host, broken)
    if last is not None:
        return _state_read_back(host, last)
    return StartState(
        host.name,
        "no run has a saved state of it: starts as after adoption",
        msg(f"the earlier state of {arg(host.name)}: it starts as after adoption"),
        is_ready=True,
    )


def _last_confirmed(state: Path, host: Host, run: runs.Run) -> runs.SavedState | None:
    """Return the last state read back by runs of the same kind: emulated states never represent real ones."""
    is_rehearsal = run.start_record is not None and run.start_record.rehearsed
    return runs.Store(state, is_rehearsal=is_rehearsal).last_confirmed(host.site, (host.name,)).get(host.name)


def _state_read_back(host: Host, last: runs.SavedState) -> StartState:
    return StartState(
        host.name,
        msg(f"starts from the state verified by run {arg(last.run)} at {arg(last.at):%Y-%m-%d %H:%M} UTC"),
        msg(f"changes on {arg(host.name)} since run {arg(last.run)} verified it"),
        restore=last.run,
    )
