"""Radio status: `monitor once`, the registration tables, and rows with inherited values.

Names of fields: Manual, Wireless Interface (monitor, registration table); Manual, WiFi. Rates, CCQ and counters are
those of a good link; only the levels are computed (radio/_link.py).
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.answers import Trap
from atlantis_netcfg.emulator.routeros.commands import _checks
from atlantis_netcfg.emulator.routeros.core import Call, CallResult, Core
from atlantis_netcfg.emulator.routeros.radio import _read, _settings
from atlantis_netcfg.emulator.routeros.radio._law import why_silent
from atlantis_netcfg.emulator.routeros.values import id_text, interval

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.emulator.routeros.spec import NearbyStation
    from atlantis_netcfg.emulator.routeros.store import StoredItem, Table

_Row = dict[str, str]
_ALONE = _settings.RadioState("searching-for-network")
_SELECTORS = (".id", "numbers")


def monitor(core: Core, call: Call) -> CallResult:
    """Emulate `monitor <radio> once`."""
    for name in call.arguments:
        if name not in (*_SELECTORS, "once", "proplist", ".proplist"):
            raise _checks.unknown(name)
    selector = next((call.arguments[name] for name in _SELECTORS if name in call.arguments), None)
    if selector is None:
        raise _checks.MissingArgument("numbers")
    if "once" not in call.arguments:
        raise Trap(f"not rehearsed by the twin: {call.path} without once")
    radios = [(item, mine) for item, mine in _radios(core, call.menu) if selector in _names(core, call.menu, item)]
    if not radios:
        raise _checks.no_such_item()
    return CallResult(rows=[_MONITORS[call.menu](core, *radio) for radio in radios])


def _radios(core: Core, menu: str) -> Iterator[tuple[StoredItem, _settings.RadioSettings]]:
    for item in core.store.table(menu).items:
        if item.factory is not None and (mine := _read.settings_of(core, item.factory["name"])) is not None:
            yield item, mine


def _names(core: Core, menu: str, item: StoredItem) -> tuple[str, ...]:
    return id_text(item.id), core.store.text(core.store.table(menu), item, "name") or ""


def _state(core: Core, item: StoredItem, mine: _settings.RadioSettings) -> _settings.RadioState:
    """Return the state of a radio; without an emulated peer it is alone."""
    name = (item.factory or {})["name"]
    alone = _settings.RadioState("running-ap") if mine.is_ap else _ALONE
    return core.radios.get(name, alone) if mine.is_enabled else _settings.RadioState("disabled")


def _legacy(core: Core, item: StoredItem, mine: _settings.RadioSettings) -> _Row:
    state = _state(core, item, mine)
    row = {"status": state.status}
    peer = state.peer
    if state.status == "running-ap" or peer is not None:
        channel = mine.channel_mhz if peer is None else peer.channel_mhz
        row["channel"] = f"{channel}/{mine.width.removesuffix('mhz')}/{'an' if 'n' in mine.band else 'a'}"
        row["wireless-protocol"] = mine.speaks if peer is None or mine.is_ap else peer.settings.speaks
        row["noise-floor"] = str(_settings.NOISE_DBM)
    if mine.is_ap and state.status == "running-ap":
        clients = str(len(_stations(core, mine)) + (peer is not None))
        return row | {"registered-clients": clients, "authenticated-clients": clients, "overall-tx-ccq": "90"}
    if peer is None:
        return row
    return row | {
        "ssid": peer.settings.ssid,
        "bssid": peer.settings.mac,
        "radio-name": peer.settings.radio_name,
        "signal-strength": f"{peer.signal_dbm:.0f}",
        "tx-signal-strength": f"{peer.theirs_dbm:.0f}",
        "signal-to-noise": f"{peer.signal_dbm - _settings.NOISE_DBM:.0f}",
        "tx-rate": "130Mbps-20MHz/2S",
        "rx-rate": "130Mbps-20MHz/2S",
        "tx-ccq": "90",
        "rx-ccq": "90",
        "current-distance": str(peer.distance_km),
    }


def _wifi(core: Core, item: StoredItem, mine: _settings.RadioSettings) -> _Row:
    state = _state(core, item, mine)
    words = {"running-ap": "running", "connected-to-ess": "connected", "searching-for-network": "searching"}
    row = {"state": words.get(state.status, state.status)}
    if state.peer is not None or state.status == "running-ap":
        channel = mine.channel_mhz if state.peer is None else state.peer.channel_mhz
        row["channel"] = f"{channel}/{mine.band.partition('-')[2] or 'ax'}"
        row["tx-power"] = f"{mine.power_dbm:.0f}"
    if mine.is_ap:
        number = str(len(_stations(core, mine)) + (state.peer is not None))
        row |= {"registered-peers": number, "authorized-peers": number}
    return row


_MONITORS = {_read.LEGACY: _legacy, _read.WIFI: _wifi}


def registrations(core: Core, call: Call) -> list[_Row]:
    """Return the rows of `registration-table`: the peers of each radio."""
    menu = call.menu.removesuffix("/registration-table")
    rows: list[_Row] = []
    for item, mine in _radios(core, menu):
        if (peer := _state(core, item, mine).peer) is not None:
            rows.append(_REGISTRATIONS[menu](core, menu, item, mine, peer))
        rows += [_station_row(menu, _names(core, menu, item)[1], mine, station) for station in _stations(core, mine)]
    return [{".id": id_text(number), **row} for number, row in enumerate(rows, start=1)]


def _stations(core: Core, mine: _settings.RadioSettings) -> list[NearbyStation]:
    """Return nearby clients that a radio serves; their wait for the radar check is not emulated."""
    if not (mine.is_enabled and mine.is_ap and mine.speaks == "802.11") or why_silent(mine, _settings.Air()):
        return []
    keys = {part.partition("=")[2] if mine.driver is _settings.Driver.WIRELESS else part for part in _passphrases(mine)}
    return [
        station
        for station in core.spec.around.stations
        if station.ssid == mine.ssid
        and station.passphrase in keys
        and (station.mac.upper() in mine.admits or not mine.refuses & {station.mac.upper(), "*"})
    ]


def _passphrases(mine: _settings.RadioSettings) -> list[str]:
    """Return the passphrases; the older driver has one per authentication type, and they may contain commas."""
    if mine.driver is _settings.Driver.WIFI or not mine.authentication:
        return [mine.passphrase] if mine.authentication else [""]
    kinds = "|".join(map(re.escape, sorted(mine.authentication)))
    return re.split(rf",(?=(?:{kinds})=)", mine.passphrase)


def _station_row(menu: str, interface: str, mine: _settings.RadioSettings, station: NearbyStation) -> _Row:
    kind = min(mine.authentication, default="none")
    row = {"interface": interface, "mac-address": station.mac.upper(), "uptime": "10m", "last-activity": "0ms"}
    if menu == _read.WIFI:
        rate = {"tx-rate": "286.8Mbps-20MHz/2S", "rx-rate": "286.8Mbps-20MHz/2S"}
        radio_values = {"ssid": mine.ssid, "signal": f"{station.signal_dbm:.0f}", "auth-type": kind}
        return {**row, **radio_values, "band": mine.band or "5ghz-ax", **rate, "authorized": "true"}
    level = {"signal-strength": f"{station.signal_dbm:.0f}dBm@6Mbps"}
    level |= {"signal-to-noise": f"{station.signal_dbm - _settings.NOISE_DBM:.0f}", "authentication-type": kind}
    rate = {"rx-rate": "130Mbps-20MHz/2S", "tx-rate": "130Mbps-20MHz/2S", "802.1x-port-enabled": "true"}
    return {**row, "ap": "false", "wds": "false", "bridge": "false", **rate, **level}


def _legacy_registration(
    core: Core, menu: str, item: StoredItem, mine: _settings.RadioSettings, peer: _settings.Peer
) -> _Row:
    protocol = mine.speaks if mine.is_ap else peer.settings.speaks
    row = {
        "interface": _names(core, menu, item)[1],
        "radio-name": peer.settings.radio_name,
        "mac-address": peer.settings.mac,
        "ap": "true" if peer.settings.is_ap else "false",
        "wds": "false",
        "bridge": "true",
        "rx-rate": "130Mbps-20MHz/2S",
        "tx-rate": "130Mbps-20MHz/2S",
        "uptime": _uptime(core, peer),
        "last-activity": "0ms",
        "signal-strength": f"{peer.signal_dbm:.0f}dBm@6Mbps",
        "signal-to-noise": f"{peer.signal_dbm - _settings.NOISE_DBM:.0f}",
        "tx-signal-strength": f"{peer.theirs_dbm:.0f}",
        "tx-ccq": "90",
        "rx-ccq": "90",
        "p-throughput": "96000",
        "distance": str(peer.distance_km),
        "routeros-version": core.spec.version,
        "last-ip": "",
        "802.1x-port-enabled": "true",
        "wmm-enabled": "false",
    }
    if protocol != "nv2" and mine.authentication:
        row["authentication-type"] = min(mine.authentication & peer.settings.authentication, default="none")
    return row


def _wifi_registration(
    core: Core, menu: str, item: StoredItem, mine: _settings.RadioSettings, peer: _settings.Peer
) -> _Row:
    band = (mine if mine.is_ap else peer.settings).band or "5ghz-ax"
    return {
        "interface": _names(core, menu, item)[1],
        "ssid": (mine if mine.is_ap else peer.settings).ssid,
        "mac-address": peer.settings.mac,
        "uptime": _uptime(core, peer),
        "last-activity": "0ms",
        "signal": f"{peer.signal_dbm:.0f}",
        "auth-type": min(mine.authentication & peer.settings.authentication, default=""),
        "band": band,
        "tx-rate": "286.8Mbps-20MHz/2S",
        "rx-rate": "286.8Mbps-20MHz/2S",
        "authorized": "true",
    }


def _uptime(core: Core, peer: _settings.Peer) -> str:
    return interval(max(0, int(core.now() - max(peer.since, core.started))))


_REGISTRATIONS = {_read.LEGACY: _legacy_registration, _read.WIFI: _wifi_registration}


def add_inherited(core: Core, menu: str, rows: list[_Row]) -> list[_Row]:
    """Add inherited values to rows of the newer driver, as `print` does (`print config` does not; Manual, WiFi)."""
    if menu not in (_read.WIFI, f"{_read.WIFI}/configuration"):
        return rows
    table = core.store.table(menu)
    return [_with_inherited(core, table, row) for row in rows]


def _with_inherited(core: Core, table: Table, row: _Row) -> _Row:
    item = next((each for each in table.items if id_text(each.id) == row.get(".id")), None)
    if item is None:
        return row
    local = {
        name.removeprefix("configuration.") if table.menu.path != _read.WIFI else name: value
        for name, value in _read.inherited_values(core.store, table, item).items()
        if value is not None
    }
    texts = {name: table.args[name].kind.show(value) for name, value in local.items() if name in table.args}
    return {**{name: value for name, value in texts.items() if not table.args[name].secret}, **row}
