"""The 4G modem of an emulated router: SIM, surrounding network, and the output of `/interface/lte`.

Sources: Manual, LTE/5G (`allow-roaming`, `use-network-apn` for MBIM modems, `show-capabilities`), and published logs.
Levels are constants; cells, SMS and eSIM are not emulated.

Assumption: lte-pin-words
Assumption: lte-pin-once
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.emulator.routeros.values import id_text

if TYPE_CHECKING:
    from collections.abc import Mapping

    from pydantic import BaseModel

    from atlantis_netcfg.emulator.routeros.core import Core
    from atlantis_netcfg.emulator.routeros.spec import ModemSpec, SimSpec
    from atlantis_netcfg.emulator.routeros.store import StoredItem


__all__ = []


LTE, APN = "/interface/lte", "/interface/lte/apn"


class ModemPhase(Enum):
    """Phase of the modem's connection."""

    OFF = auto()
    NO_SIM = auto()
    PIN = auto()
    PUK = auto()
    SEARCHING = auto()
    DENIED = auto()
    REGISTERED = auto()
    """Registered without data: roaming is not allowed, or the network does not know the APN."""
    CONNECTED = auto()


@dataclass(frozen=True, slots=True)
class ModemSettings:
    """Row of the interface, with the APN profile it uses."""

    item: StoredItem
    name: str
    is_enabled: bool
    pin: str
    allow_roaming: bool
    bands: frozenset[int]
    modes: frozenset[str]
    operator: str
    apn: str
    network_apn: bool
    default_route: bool
    distance: str


def settings_of(core: Core) -> ModemSettings | None:
    """Return the modem's settings; None if the board has no modem."""
    if core.spec.modem is None or not core.schema.has_menu(LTE):
        return None
    table = core.store.table(LTE)
    item = next((row for row in table.items if (row.factory or {}).get("name") == core.spec.modem.name), None)
    if item is None:
        return None
    values = {name: core.store.text(table, item, name) or "" for name in table.args}
    profile = _profile(core, values.get("apn-profiles", "").split(",")[0])
    return ModemSettings(
        item=item,
        name=values["name"],
        is_enabled=values.get("disabled") != "yes",
        pin=values.get("pin", ""),
        allow_roaming=values.get("allow-roaming") == "yes",
        bands=frozenset(int(entry) for entry in values.get("band", "").split(",") if entry),
        modes=frozenset(word for word in values.get("network-mode", "").split(",") if word),
        operator=values.get("operator", ""),
        apn=profile.get("apn", ""),
        network_apn=profile.get("use-network-apn") == "yes",
        default_route=profile.get("add-default-route") == "yes",
        distance=profile.get("default-route-distance", "2"),
    )


def _profile(core: Core, name: str) -> dict[str, str]:
    table = core.store.table(APN)
    for item in table.items:
        if core.store.text(table, item, "name") == name:
            return {arg: core.store.text(table, item, arg) or "" for arg in table.args}
    return {}


def phase_of(core: Core, mine: ModemSettings) -> ModemPhase:
    """Return the phase that the modem reaches with these settings."""
    modem, state = core.spec.modem, core.sim
    if modem is None or not mine.is_enabled:
        return ModemPhase.OFF
    if modem.sim is None:
        return ModemPhase.NO_SIM
    if modem.sim.pin and not state.is_unlocked:
        return ModemPhase.PUK if state.tries_left == 0 else ModemPhase.PIN
    return _registration_phase(modem, modem.sim, mine)


def _registration_phase(modem: ModemSpec, sim: SimSpec, mine: ModemSettings) -> ModemPhase:
    cell = modem.cell
    allowed_bands = mine.bands or frozenset(modem.bands)
    deaf = cell is None or not allowed_bands & set(cell.bands) & set(modem.bands)
    if cell is None or deaf or (mine.modes and "lte" not in mine.modes) or mine.operator not in {"", cell.plmn}:
        return ModemPhase.SEARCHING
    if cell.denies:
        return ModemPhase.DENIED
    if sim.home != cell.plmn and not mine.allow_roaming:
        return ModemPhase.REGISTERED
    apn = cell.own_apn if modem.mbim and mine.network_apn else mine.apn
    return ModemPhase.CONNECTED if not cell.apns or apn in cell.apns else ModemPhase.REGISTERED


def settle(core: Core) -> None:
    """Update the modem after a change of its settings: enter a new PIN, connect or disconnect."""
    mine = settings_of(core)
    if mine is None or core.spec.modem is None:
        return
    state, sim = core.sim, core.spec.modem.sim
    if not mine.is_enabled:
        state.restart()
    elif not mine.pin:
        state.tried_pin, state.is_refused = None, False
    elif sim is not None and sim.pin and mine.pin and mine.pin != state.tried_pin:
        state.enter(mine.pin, sim.pin)
        _tell(core, f"{mine.name}: rcvd +CME ERROR: 16" if state.is_refused else "")
    phase = phase_of(core, mine)
    answer = {
        ModemPhase.NO_SIM: "+CME ERROR: 10",
        ModemPhase.PIN: "+CPIN: SIM PIN",
        ModemPhase.PUK: "+CPIN: SIM PUK",
    }.get(phase)
    if answer is not None:
        _tell(core, f"{mine.name}: rcvd {answer}", request_line=f"{mine.name}: sent AT+CPIN?")
    _connect(core, mine, up=phase is ModemPhase.CONNECTED)


def update_modem(core: Core, changes: Mapping[str, Any]) -> dict[str, Any]:
    """Change the card (`sim`) or network (`cell`) of a running modem; None removes it. Return the new state.

    Omitted properties are kept. Raises LookupError if the board has no modem, ValueError for invalid values.
    """
    modem = core.spec.modem
    if modem is None:
        raise LookupError(f"{core.spec.name} has no modem")
    parts = {name: _merge_part(getattr(modem, name, None), part) for name, part in changes.items()}
    new_modem = type(modem).model_validate({**modem.model_dump(), **parts})
    core.spec = core.spec.model_copy(update={"modem": new_modem})
    if "sim" in changes:
        core.sim.swap(new_modem.sim.tries if new_modem.sim is not None else 0)
    settle(core)
    mine = settings_of(core)
    phase = ModemPhase.OFF if mine is None else phase_of(core, mine)
    return {"phase": phase.name.lower(), "tries_left": core.sim.tries_left, "pins_entered": core.sim.pins_entered}


def _merge_part(before: BaseModel | None, changes: Mapping[str, Any] | None) -> dict[str, Any] | None:
    if changes is None:
        return None
    return {**(before.model_dump() if before is not None else {}), **changes}


def _tell(core: Core, line: str, *, request_line: str | None = None) -> None:
    """Write the modem's response to the log, once for each response."""
    if not line or line == core.sim.last_line:
        return
    core.sim.last_line = line
    for text in (request_line, line):
        if text is not None:
            core.note("lte,async", text)


def _connect(core: Core, mine: ModemSettings, *, up: bool) -> None:
    number = mine.item.id
    if up is (number in core.linked):
        return
    core.linked = core.linked | {number} if up else core.linked - {number}
    core.sim.connected_since = core.now() if up else None
    core.store.revision += 1
    core.note("interface,info", f"{mine.name} link {'up' if up else 'down'}")


def modem_rows(core: Core, path: str) -> list[dict[str, str]]:
    """Return the address and default route that exist while the modem is connected."""
    mine = settings_of(core) if path in {"/ip/address", "/ip/route"} else None
    modem = core.spec.modem
    if mine is None or modem is None or modem.cell is None or phase_of(core, mine) is not ModemPhase.CONNECTED:
        return []
    number = id_text(core.store.dynamic_id(path, "lte", mine.item.id))
    flags = {"dynamic": "true", "disabled": "false"}
    if path == "/ip/address":
        local = {"address": f"{modem.cell.address}/32", "network": modem.cell.address, "interface": mine.name}
        return [{".id": number, **local, "actual-interface": mine.name, "invalid": "false", "slave": "false", **flags}]
    if not mine.default_route:
        return []
    way = {"dst-address": "0.0.0.0/0", "routing-table": "main", "gateway": mine.name, "distance": mine.distance}
    return [{".id": number, **way, "scope": "30", "target-scope": "10", "active": "true", "inactive": "false", **flags}]
