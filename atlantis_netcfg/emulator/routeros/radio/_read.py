"""Settings of a radio from the router's rows, including inheritance between the newer driver's profiles.

A property's value is that of the interface, else of a profile assigned to the interface, else of its configuration
profile, else of a profile assigned to that (Manual, WiFi, Configuration profiles).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.radio._settings import Driver, RadioSettings
from atlantis_netcfg.emulator.routeros.values import references

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from atlantis_netcfg.emulator.routeros.core import Core
    from atlantis_netcfg.emulator.routeros.spec import Radio
    from atlantis_netcfg.emulator.routeros.store import RowStore, StoredItem, Table


LEGACY, WIFI = "/interface/wireless", "/interface/wifi"
_CONFIGURATION = "configuration"
_PARTS = ("channel", "security", "datapath")
_IDLE = ("comment", "name", "arp", "arp-timeout")
"""Properties that do not restart the radio; a change of any other does. Assumption: radio-restart"""
_USUAL_REACH_KM = 2.0
"""Range in km without `configuration.distance` (Manual, Configuring outdoor CPE to AP links)."""


def radio_item(core: Core, name: str) -> tuple[Table, StoredItem] | None:
    """Return the row of the radio with this factory name, or None without an installed driver."""
    for path in (LEGACY, WIFI):
        if not core.schema.has_menu(path):
            continue
        table = core.store.table(path)
        for item in table.items:
            if item.factory is not None and item.factory.get("name") == name:
                return table, item
    return None


def radio_spec(core: Core, name: str) -> Radio:
    """Return the spec of a radio."""
    return next(radio for radio in core.spec.radios if radio.name == name)


def settings_of(core: Core, name: str) -> RadioSettings | None:
    """Return the settings of the radio with this factory name, or None without a driver."""
    radio = radio_item(core, name)
    if radio is None:
        return None
    table, item = radio
    return _legacy(core, table, item) if table.menu.path == LEGACY else _wifi(core, table, item)


def _legacy(core: Core, table: Table, item: StoredItem) -> RadioSettings:
    store = core.store

    def text(name: str) -> str:
        return store.text(table, item, name) or ""

    profiles = store.table(f"{LEGACY}/security-profiles")
    number = store.target(table, item, "security-profile")
    profile = None if number is None else profiles.find(number)
    keys = {} if profile is None else _keys(store, profiles, profile)
    refuses, admits = _lists(core, item)
    frequency = text("frequency")
    fixed_power = text("tx-power-mode") == "all-rates-fixed" and text("tx-power")
    card = radio_spec(core, (item.factory or {})["name"])
    return RadioSettings(
        driver=Driver.WIRELESS,
        mac=text("mac-address"),
        radio_name=text("radio-name"),
        is_enabled=text("disabled") != "yes",
        mode=text("mode"),
        bridges_stations=text("bridge-mode") == "enabled",
        protocol=text("wireless-protocol"),
        ssid=text("ssid"),
        band=text("band"),
        width=text("channel-width"),
        frequency=int(frequency) if frequency.isdecimal() else None,
        scans=_ranges(text("scan-list")),
        country=text("country"),
        outdoor=text("installation") == "outdoor",
        lawless=text("frequency-mode") == "superchannel",
        authentication=frozenset(keys),
        passphrase=",".join(f"{kind}={key}" for kind, key in sorted(keys.items())),
        nv2_key=text("nv2-preshared-key") if text("nv2-security") == "enabled" else None,
        reach_km=float(text("nv2-cell-radius")),
        power_dbm=float(text("tx-power")) if fixed_power else card.power_dbm,
        gain_dbi=card.gain_dbi,
        refuses=refuses,
        admits=admits,
        rest=_restart_values(item.values),
    )


def _restart_values(values: Mapping[str, str]) -> frozenset[tuple[str, str]]:
    return frozenset((name, value) for name, value in values.items() if name not in _IDLE)


def _keys(store: RowStore, table: Table, profile: StoredItem) -> Mapping[str, str]:
    """Return a profile's authentication types with their keys; empty: an open network."""
    if store.text(table, profile, "mode") != "dynamic-keys":
        return {}
    kinds = [kind for kind in (store.text(table, profile, "authentication-types") or "").split(",") if kind]
    names = {"wpa-psk": "wpa-pre-shared-key", "wpa2-psk": "wpa2-pre-shared-key"}
    return {kind: store.text(table, profile, names[kind]) or "" if kind in names else kind for kind in kinds}


def _lists(core: Core, radio: StoredItem) -> tuple[frozenset[str], frozenset[str]]:
    """Return the MAC addresses that access and connect list refuse and allow; the first matching row decides.

    Only MAC addresses are evaluated, neither signal ranges nor times.
    """
    store = core.store
    table = store.table(LEGACY)
    refuses, admits = set[str](), set[str]()
    for menu, verdict in (("access-list", "authentication"), ("connect-list", "connect")):
        rows = store.table(f"{LEGACY}/{menu}")
        for item in rows.items:
            number = store.target(rows, item, "interface")
            if store.text(rows, item, "disabled") == "yes" or number not in (None, radio.id):
                continue
            mac = store.text(rows, item, "mac-address") or ""
            who = "*" if mac == "00:00:00:00:00:00" else mac
            if not {who, "*"} & (refuses | admits):
                (admits if store.text(rows, item, verdict) == "yes" else refuses).add(who)
    if store.text(table, radio, "default-authentication") != "yes" and "*" not in admits:
        refuses.add("*")
    return frozenset(refuses), frozenset(admits)


def _wifi(core: Core, table: Table, item: StoredItem) -> RadioSettings:
    values = {name: value for name, value in inherited_values(core.store, table, item).items() if value is not None}
    local = core.store.text
    kinds = frozenset(kind for kind in values.get("security.authentication-types", "").split(",") if kind)
    mode = values.get("configuration.mode", "ap")
    ranges = _ranges(values.get("channel.frequency", "default"))
    card = radio_spec(core, (item.factory or {})["name"])
    power = values.get("configuration.tx-power")
    return RadioSettings(
        driver=Driver.WIFI,
        mac=local(table, item, "mac-address") or "",
        radio_name=core.spec.name,
        is_enabled=local(table, item, "disabled") != "yes",
        mode=mode,
        bridges_stations=True,
        protocol="802.11",
        ssid=values.get("configuration.ssid", ""),
        band=values.get("channel.band", ""),
        width=values.get("channel.width", ""),
        frequency=ranges[0][0] if ranges else None,
        scans=ranges if mode != "ap" else None,
        country=values.get("configuration.country", "Latvia"),
        outdoor=values.get("configuration.installation") == "outdoor",
        lawless=values.get("configuration.country") == "Superchannel",
        authentication=kinds,
        passphrase=values.get("security.passphrase", ""),
        nv2_key=None,
        reach_km=float(values.get("configuration.distance", _USUAL_REACH_KM)),
        power_dbm=card.power_dbm if power is None else min(card.power_dbm, float(power)),
        gain_dbi=card.gain_dbi,
        refuses=frozenset(),
        admits=frozenset(),
        rest=_restart_values(values),
    )


def _ranges(text: str) -> tuple[tuple[int, int], ...] | None:
    """Parse `5500,5520-5560/20`; None for `default` and for channel names that only the card knows."""
    parts = [part.partition("/")[0] for part in text.split(",")]
    if not all(part.replace("-", "").isdecimal() for part in parts):
        return None
    ends = (part.partition("-") for part in parts)
    return tuple((int(low), int(high or low)) for low, _, high in ends)


def inherited_values(store: RowStore, table: Table, item: StoredItem) -> dict[str, str | None]:
    """Return all effective properties of a row by full name, in the format of exports."""
    result: dict[str, str | None] = {}
    for name, value in _layers(store, table, item):
        result.setdefault(name, value)
    return result


def _layers(store: RowStore, table: Table, item: StoredItem) -> Iterator[tuple[str, str | None]]:
    """Yield properties by priority; those of a configuration profile have its name as prefix."""
    inside = table.menu.path == f"{WIFI}/{_CONFIGURATION}"
    for name in table.args:
        if name in item.values:
            full = f"{_CONFIGURATION}.{name}" if inside and "." not in name and name not in _PARTS else name
            yield full, store.text(table, item, name)
    for part in _PARTS:
        yield from _profile_values(store, table, item, part)
    if not inside:
        profile = _profile(store, table, item, _CONFIGURATION)
        if profile is not None:
            yield from _layers(store, *profile)


def _profile_values(store: RowStore, table: Table, item: StoredItem, part: str) -> Iterator[tuple[str, str | None]]:
    profile = _profile(store, table, item, part)
    if profile is not None:
        rows, row = profile
        yield from ((f"{part}.{name}", store.text(rows, row, name)) for name in rows.args if name in row.values)


def _profile(store: RowStore, table: Table, item: StoredItem, part: str) -> tuple[Table, StoredItem] | None:
    if part not in table.args:
        return None
    number = next((each for _, each in references(item.values.get(part, ""))), None)
    rows = store.table(f"{WIFI}/{part}")
    row = None if number is None else rows.find(number)
    return None if row is None else (rows, row)
