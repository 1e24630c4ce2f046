"""Restoring of a device's confirmed state, on the device or its replacement: the state and its omissions."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

from atlantis_netcfg import runs
from atlantis_netcfg.core.errors import NoMatchError, nearest
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.routeros import _items, snapshot
from atlantis_netcfg.routeros.menus import MENUS

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from atlantis_netcfg.inventory import Host
    from atlantis_netcfg.routeros._items import RowItem
    from atlantis_netcfg.routeros.desired import DesiredState


_UNIT = {"/ip/service": frozenset({"certificate"})}
"""Properties by menu that keep their value on the replacement device."""


def for_replacement(saved_state: _items.DesiredState, desired_state: _items.DesiredState) -> _items.DesiredState:
    """Return the saved state with the inventory's secrets, and without what belongs to the old device.

    What the device sets itself (addresses of its hardware, capabilities of its ports) is never in a saved state.
    Removed here are the certificate of its services, which the replacement got at adoption, and secrets, which a saved
    state never has: they come from the inventory, if it has them.
    """
    items = {
        path: tuple(_with_secrets(_mark_unit_values_unknown(item), _emulators(item, desired_state)) for item in rows)
        for path, rows in saved_state.items.items()
    }
    return replace(saved_state, items=items, notes=(*saved_state.notes, *_newer(saved_state, desired_state)))


def for_any_box(saved_state: _items.DesiredState) -> _items.DesiredState:
    """Return the saved state without what belongs to the device it was read from: an emulator has its own."""
    return replace(
        saved_state,
        items={path: tuple(map(_mark_unit_values_unknown, rows)) for path, rows in saved_state.items.items()},
    )


def _newer(saved_state: _items.DesiredState, desired_state: _items.DesiredState) -> tuple[str, ...]:
    """Return a note on menus that the inventory has by now and the saved state does not."""
    menus = [MENUS[path] for path in desired_state.menus if path not in saved_state.items]
    titles = join(", ", (menu.title for menu in menus if menu.is_exported and not menu.readonly))
    return (msg(f"not in the saved state and left unchanged: {arg(titles)}"),) if titles else ()


def _mark_unit_values_unknown(item: RowItem) -> RowItem:
    local = _UNIT.get(item.menu, frozenset())
    values = {name: value for name, value in item.values.items() if name not in local}
    return replace(item, values=values, unknown=item.unknown | local)


def _emulators(item: RowItem, desired_state: _items.DesiredState) -> list[RowItem]:
    """Return the inventory's rows that match the saved one; rows without keys have no secrets."""
    if not MENUS[item.menu].keys:
        return []
    return [other for other in desired_state.items.get(item.menu, ()) if other.identity == item.identity]


def _with_secrets(item: RowItem, emulators: list[RowItem]) -> RowItem:
    known_values: Mapping[str, str | None] = {
        name: emulator.values[name] for emulator in emulators for name in item.unknown if emulator.values.get(name)
    }
    secrets = {name: value for name, value in known_values.items() if name in MENUS[item.menu].secrets}
    return replace(item, values={**item.values, **secrets}, unknown=item.unknown - secrets.keys())


LATEST = "latest"
"""Instead of a run: selects the last one that confirmed a state of the device."""

_MAX_RUNS = 5


def confirmed_state(state: Path, host: Host, run: str, *, is_rehearsal: bool = False) -> runs.SavedState:
    """Return the state of a device that a run confirmed; raise NoMatchError, which names runs that have one.

    A rehearsal uses real states or, without any, those of earlier rehearsals; a real run only real ones.
    """
    stores = [
        runs.Store(state, is_rehearsal=is_emulated) for is_emulated in ((False, True) if is_rehearsal else (False,))
    ]
    latest = {store: states for store in stores if (states := store.last_confirmed(host.site, (host.name,)))}
    if not latest:
        raise NoMatchError(
            f"no run has confirmed a state of {arg(host.name)}",
            hint=(
                f"`provision site={arg(host.site)}` stores the verified state at its end; `provision report runs` "
                "lists all runs"
            ),
        )
    store = next(iter(latest))
    matches = (_state_of(each, host, run) for each in latest)
    saved_state = latest[store][host.name] if run == LATEST else next(filter(None, matches), None)
    if saved_state is None:
        run_ids = [item.id for item in store.runs(host.site) if item.confirmed_state(host.name) is not None]
        near = nearest(run, [*run_ids, LATEST])
        choices = msg(f"runs with a state: {arg(join(', ', run_ids[-_MAX_RUNS:]))}; or type `run={arg(LATEST)}`")
        raise NoMatchError(
            f"run {arg(run)} has confirmed no state of {arg(host.name)}",
            hint=f"did you mean `run={arg(near)}`? {arg(choices)}" if near else choices,
        )
    if run == LATEST and (damage := store.damage_since(host.site, saved_state.run)):
        raise runs.DamagedStateError(
            f"{arg(damage)}; a later state of {arg(host.name)} may be lost",
            hint=f"to use the last readable one, type `run={arg(saved_state.run)}`",
        )
    return saved_state


def read_replacement(saved_state: runs.SavedState, desired_state: DesiredState) -> DesiredState:
    """Parse a confirmed state as the desired state of a replacement; raise DamagedStateError or RscError."""
    replacement = snapshot.read(saved_state.text(), msg(f"the state that run {arg(saved_state.run)} confirmed"))
    return for_replacement(replacement, desired_state)


def _state_of(store: runs.Store, host: Host, run: str) -> runs.SavedState | None:
    with suppress(runs.NoSuchRun):
        return store.run(host.site, run).confirmed_state(host.name)
    return None
