"""A confirmed state of one device, to be put on another one in its place: where it is found, and what it lacks."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.errors import NothingMatched
from atlantis_netcfg.journal import Store
from atlantis_netcfg.near import nearest
from atlantis_netcfg.routeros import snapshot
from atlantis_netcfg.routeros.replacement import for_replacement

if TYPE_CHECKING:
    from pathlib import Path

    from atlantis_netcfg.journal import Confirmed
    from atlantis_netcfg.routeros.desired import Desired
    from atlantis_netcfg.site import Host

__all__ = ["LATEST", "confirmed_state", "restored"]

LATEST = "latest"
"""Instead of a run: the last one that confirmed a state of the device."""

_SHOWN = 5


def confirmed_state(state: Path, host: Host, run: str, *, rehearsed: bool = False) -> Confirmed:
    """Find what a run has read back of a device. Raises NothingMatched naming the runs that have.

    A rehearsal takes real states, and where there are none those of earlier rehearsals; a real run only real ones.
    """
    known: dict[str, Confirmed] = {}
    for emulated in (False, True) if rehearsed else (False,):
        known = known or _known(Store(state, rehearsed=emulated), host)
    if not known:
        raise NothingMatched(
            f"no run has confirmed a state of {host.name}",
            hint=f"`provision site={host.site}` keeps what it reads back at its end; `provision runs` lists all runs",
        )
    found = known[max(known)] if run == LATEST else known.get(run)
    if found is None:
        near = nearest(run, [*known, LATEST])
        listed = f"these have: {', '.join(sorted(known)[-_SHOWN:])}; or type `to={LATEST}`"
        raise NothingMatched(
            f"run {run} has confirmed no state of {host.name}",
            hint=f"did you mean `to={near}`? {listed}" if near else listed,
        )
    return found


def restored(confirmed: Confirmed, declared: Desired) -> Desired:
    """Read a confirmed state as what a replacement shall be. Raises StateDamaged, RscError."""
    saved = snapshot.read(confirmed.text(), f"the state that run {confirmed.run} confirmed")
    return for_replacement(saved, declared)


def _known(store: Store, host: Host) -> dict[str, Confirmed]:
    states = (run.confirmed_state(host.name) for run in store.runs(host.site))
    return {state.run: state for state in states if state is not None}
