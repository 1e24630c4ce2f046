"""Modem status: `monitor once` and `show-capabilities`.

Fields and their units: Manual, LTE/5G; all names are among those that the console of 7.21.5 offers for
`monitor proplist`. The identities belong to no real device: IMEI of the test range, SIM of network 001-01.
"""

from __future__ import annotations

from atlantis_netcfg.emulator.routeros.answers import Trap
from atlantis_netcfg.emulator.routeros.commands._checks import MissingArgument, no_such_item
from atlantis_netcfg.emulator.routeros.core import Call, CallResult, Core
from atlantis_netcfg.emulator.routeros.modem import ModemPhase, ModemSettings, phase_of, settings_of
from atlantis_netcfg.emulator.routeros.spec import Deviation
from atlantis_netcfg.emulator.routeros.values import id_text, interval

_Row = dict[str, str]
_BOX = {"manufacturer": "Quectel", "model": "EG18-EA", "revision": "EG18EAPAR01A12M4G", "imei": "001017000000000"}
_CARD = {"imsi": "001010000000000", "iccid": "8900101000000000000"}
_ANY = (".id", "number", "numbers")


def monitor(core: Core, call: Call) -> CallResult:
    """Emulate `monitor <interface> once`."""
    mine = _find_modem(core, call, "numbers")
    if "once" not in call.arguments:
        raise Trap(f"not rehearsed by the twin: {call.path} without once")
    row = _status_row(core, mine)
    if "pin-status" in row and core.deviates(Deviation.PIN_WORDS):
        row["pin-status"] = "CHV1 state 7"
    proplist = call.arguments.get("proplist", call.arguments.get(".proplist"))
    names = set(proplist.split(",")) if proplist else set(row)
    return CallResult(rows=[{name: value for name, value in row.items() if name in names}])


def capabilities(core: Core, call: Call) -> CallResult:
    """Emulate `show-capabilities <interface>`: the modem's features. Assumption: lte-pin-once."""
    _find_modem(core, call, "number")
    return CallResult(rows=[{"cell-scan": "yes", "passthrough": "yes", "roaming-barring": "yes"}])


def _find_modem(core: Core, call: Call, argument: str) -> ModemSettings:
    selector = next((call.arguments[name] for name in _ANY if name in call.arguments), None)
    if selector is None:
        raise MissingArgument(argument)
    mine = settings_of(core)
    if mine is None or selector not in {mine.name, id_text(mine.item.id)}:
        raise no_such_item()
    return mine


def _status_row(core: Core, mine: ModemSettings) -> _Row:
    phase = phase_of(core, mine)
    if phase is ModemPhase.OFF:
        return {"status": "disabled"}
    if phase is ModemPhase.NO_SIM:
        return dict(_BOX)
    if phase is ModemPhase.PUK:
        return {"pin-status": "SIM PUK required", "functionality": "full", **_BOX}
    if phase is ModemPhase.PIN:
        text = "wrong PIN" if core.sim.is_refused else "SIM PIN required"
        return {"pin-status": text, "functionality": "full", **_BOX}
    words = {ModemPhase.SEARCHING: "searching", ModemPhase.DENIED: "denied", ModemPhase.REGISTERED: "registered"}
    row = {"pin-status": "no password required", "status": words.get(phase, "connected"), **_BOX, **_CARD}
    return row if phase in {ModemPhase.SEARCHING, ModemPhase.DENIED} else row | _cell(core, phase)


def _cell(core: Core, phase: ModemPhase) -> _Row:
    modem = core.spec.modem
    if modem is None or modem.cell is None or modem.sim is None:
        return {}
    cell = modem.cell
    row = {
        "current-operator": cell.operator,
        "current-cellid": str(cell.cell_id),
        "data-class": "LTE",
        "roaming": "no" if modem.sim.home == cell.plmn else "yes",
        "primary-band": f"B{cell.bands[0]}@20Mhz earfcn: 1300 phy-cellid: 480",
        "rssi": f"{cell.rsrp_dbm + 29}dBm",
        "rsrp": f"{cell.rsrp_dbm}dBm",
        "rsrq": f"{cell.rsrq_db}dB",
        "sinr": f"{cell.sinr_db}dB",
    }
    since = core.sim.connected_since
    if phase is ModemPhase.CONNECTED and since is not None:
        row["session-uptime"] = interval(int(core.now() - since))
    return row
