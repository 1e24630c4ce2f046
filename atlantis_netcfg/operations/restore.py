"""Restore a confirmed state of one device onto its replacement: where the state is found, and what it lacks."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import NothingMatched
from atlantis_netcfg.core.suggest import nearest
from atlantis_netcfg.journal import NoSuchRun, Store
from atlantis_netcfg.routeros import snapshot
from atlantis_netcfg.routeros.rma import for_replacement

if TYPE_CHECKING:
    from pathlib import Path

    from atlantis_netcfg.declaration import Host
    from atlantis_netcfg.journal import Confirmed
    from atlantis_netcfg.routeros.desired import Desired

LATEST = "latest"
"""Instead of a run: the last one that confirmed a state of the device."""

_SHOWN = 5


def confirmed_state(state: Path, host: Host, run: str, *, rehearsed: bool = False) -> Confirmed:
    """Find what a run has read back of a device. Raises NothingMatched naming the runs that have.

    A rehearsal takes real states, and where there are none those of earlier rehearsals; a real run only real ones.
    """
    stores = [Store(state, rehearsed=emulated) for emulated in ((False, True) if rehearsed else (False,))]
    latest = {store: states for store in stores if (states := store.last_confirmed(host.site, (host.name,)))}
    if not latest:
        raise NothingMatched(
            f"no run has confirmed a state of {host.name}",
            hint=f"`provision site={host.site}` keeps what it reads back at its end; `provision runs` lists all runs",
        )
    store = next(iter(latest))
    found = latest[store][host.name] if run == LATEST else _state_of(store, host, run)
    if found is None:
        known = [item.id for item in store.runs(host.site) if item.confirmed_state(host.name) is not None]
        near = nearest(run, [*known, LATEST])
        listed = f"these have: {', '.join(known[-_SHOWN:])}; or type `to={LATEST}`"
        raise NothingMatched(
            f"run {run} has confirmed no state of {host.name}",
            hint=f"did you mean `to={near}`? {listed}" if near else listed,
        )
    return found


def restored(confirmed: Confirmed, declared: Desired) -> Desired:
    """Read a confirmed state as what a replacement shall be. Raises StateDamaged, RscError."""
    saved = snapshot.read(confirmed.text(), f"the state that run {confirmed.run} confirmed")
    return for_replacement(saved, declared)


def _state_of(store: Store, host: Host, run: str) -> Confirmed | None:
    with suppress(NoSuchRun):
        return store.run(host.site, run).confirmed_state(host.name)
    return None
