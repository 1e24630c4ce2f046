"""Radio rows of a bridge, and the check that its two ends would still connect after both plans.

Also here: the effective settings of a radio, and how a radio reports that it is connected.

Manual, Wireless Interface (protocols, nv2); Manual, Wireless Station Modes; Manual, WiFi. A value that cannot be read
(a hidden key) is not compared; what is not understood counts against the plan.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.routeros import _types
from atlantis_netcfg.routeros.api import Command

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence


LEGACY, WIFI = "/interface/wireless", "/interface/wifi"
_PARTS = ("channel", "security", "datapath")
MENUS = (
    LEGACY,
    f"{LEGACY}/security-profiles",
    f"{LEGACY}/connect-list",
    f"{LEGACY}/access-list",
    WIFI,
    *(f"{WIFI}/{part}" for part in ("configuration", *_PARTS)),
)
"""Menus in which both ends must agree."""
_IDLE = frozenset({"comment", "name", "arp", "arp-timeout"})
"""Properties that do not affect the radio's operation."""
_LISTS = (f"{LEGACY}/connect-list", f"{LEGACY}/access-list")


@dataclass(frozen=True, slots=True)
class PairRadio:
    """One radio; `values` includes inherited values, by the names of `/interface/wifi`."""

    menu: str
    name: str
    """Factory name of the radio."""
    mac: str
    values: Mapping[str, str]

    def get(self, name: str, default: str = "") -> str:
        """Return one property."""
        return self.values.get(name, default)


def touches_radio(actions: Sequence[_types.Action]) -> bool:
    """Return True if any action of a plan may interrupt the link."""
    return any(drops_link(action) for action in actions)


def drops_link(action: _types.Action) -> bool:
    """Return True if an action may interrupt the link: settings of a radio or profile, and access or connect lists.

    A new profile is harmless until something refers to it.
    """
    if action.menu not in MENUS:
        return False
    if action.verb is _types.Verb.ADD:
        return action.menu in _LISTS
    return action.verb is not _types.Verb.SET or any(name.lstrip("!") not in _IDLE for name, _ in action.values)


def radio_of(rows: Mapping[str, tuple[_types.Row, ...]], name: str = "") -> PairRadio | None:
    """Return the radio with this factory name, else the first one of the device; None if it has none."""
    for menu, resolve in ((LEGACY, _legacy), (WIFI, _wifi)):
        for row in rows.get(menu, ()):
            if row.get("default-name") and name in ("", row["default-name"]):
                return PairRadio(menu, row["default-name"], row.get("mac-address", ""), resolve(rows, row))
    return None


def _legacy(rows: Mapping[str, tuple[_types.Row, ...]], row: _types.Row) -> Mapping[str, str]:
    """Return the radio's row, and its security profile's with `security.` before the names."""
    profile_name = row.get("security-profile", "default")
    profiles = rows.get(f"{LEGACY}/security-profiles", ())
    profile = next((each for each in profiles if each.get("name") == profile_name), {})
    return {**{f"security.{name}": value for name, value in profile.items()}, **row}


def _wifi(rows: Mapping[str, tuple[_types.Row, ...]], row: _types.Row) -> Mapping[str, str]:
    """Resolve inheritance: interface, its profiles, its configuration profile, profiles of that (Manual, WiFi)."""
    configuration = _find_profile(rows, "configuration", row)
    inside = {
        (name if "." in name or name in _PARTS else f"configuration.{name}"): value
        for name, value in configuration.items()
    }
    layers = [*_profiles(rows, configuration), inside, *_profiles(rows, row), row]
    return {name: value for layer in layers for name, value in layer.items()}


def _profiles(rows: Mapping[str, tuple[_types.Row, ...]], row: _types.Row) -> list[Mapping[str, str]]:
    return [{f"{part}.{name}": value for name, value in _find_profile(rows, part, row).items()} for part in _PARTS]


def _find_profile(rows: Mapping[str, tuple[_types.Row, ...]], part: str, row: _types.Row) -> _types.Row:
    name = row.get(part, "")
    return next((each for each in rows.get(f"{WIFI}/{part}", ()) if name and each.get("name") == name), {})


def registrations(menu: str) -> Command:
    """Return the command that lists the peers of a menu's radios."""
    return Command(f"{menu}/registration-table/print", ((".proplist", "interface,mac-address,signal-strength,signal"),))


def level_dbm(row: _types.Row) -> float | None:
    """Parse a signal level: `-48dBm@6Mbps` (older driver) or `-48` (newer); None if not given."""
    # Neither form is recorded. Assumption: radio-levels
    text = row.get("signal-strength") or row.get("signal", "")
    number = text.partition("dBm")[0]
    try:
        return float(number)
    except ValueError:
        return None


_APS = ("ap", "ap-bridge", "bridge")
_ALL = frozenset({"802.11", "nstreme", "nv2"})
_PROTOCOLS = {
    "any": _ALL,
    "unspecified": frozenset({"802.11", "nstreme"}),
    "nv2-nstreme": frozenset({"nv2", "nstreme"}),
    "nv2-nstreme-802.11": _ALL,
}
"""Protocols to which a station connects, by its `wireless-protocol`."""


def disagreements(near: PairRadio | None, far: PairRadio | None, names: tuple[str, str]) -> tuple[str, ...]:
    """Return the differences that would prevent a link between two radios, one sentence each."""
    if near is None or far is None:
        return (msg(f"{arg(names[near is not None])} has no radio with a supported driver"),)
    if near.menu != far.menu:
        return ("the two ends have different drivers, but station-bridge works only between equal ones",)
    return tuple(_modes(near, far, names)) or tuple(_values(near, far, names))


def _word(radio: PairRadio, name: str) -> str:
    """Return a property by the name of the older driver."""
    if radio.menu == LEGACY:
        return radio.get(name)
    return radio.get({"channel-width": "channel.width", "band": "channel.band"}.get(name, f"configuration.{name}"))


def _mode(radio: PairRadio) -> str:
    return radio.get("mode", "station") if radio.menu == LEGACY else radio.get("configuration.mode", "ap")


def _modes(near: PairRadio, far: PairRadio, names: tuple[str, str]) -> Iterator[str]:
    for radio, name in zip((near, far), names, strict=True):
        if radio.get("disabled") in ("yes", "true"):
            yield msg(f"the radio of {arg(name)} would be disabled")
    aps = [_mode(radio) in _APS for radio in (near, far)]
    if all(aps) or not any(aps):
        yield msg(
            f"{arg(names[0])} would be {arg(_mode(near))} and {arg(names[1])} {arg(_mode(far))}: one has to be the "
            "access point"
        )
        return
    station, who = (far, names[1]) if aps[0] else (near, names[0])
    if _mode(station) != "station-bridge":
        yield msg(f"{arg(who)} would be {arg(_mode(station))}: only station-bridge carries a bridge")


def _values(near: PairRadio, far: PairRadio, names: tuple[str, str]) -> Iterator[str]:
    ap, station = (near, far) if _mode(near) in _APS else (far, near)
    for name in ("ssid", "channel-width", "country"):
        here, there = _word(near, name), _word(far, name)
        if here != there:
            yield msg(
                f"{arg(name)} would be {arg(here or 'unset')} on {arg(names[0])} and {arg(there or 'unset')} on "
                f"{arg(names[1])}"
            )
    if _word(near, "band")[:4] != _word(far, "band")[:4] and _word(near, "band") and _word(far, "band"):
        yield msg(
            f"band would be {arg(_word(near, 'band'))} on {arg(names[0])} and {arg(_word(far, 'band'))} on "
            f"{arg(names[1])}"
        )
    if ap.menu == LEGACY and _ap_protocol(ap) not in _station_protocols(station):
        words = (near.get("wireless-protocol"), far.get("wireless-protocol"))
        yield msg(
            f"wireless-protocol would be {arg(words[0])} on {arg(names[0])} and {arg(words[1])} on {arg(names[1])}"
        )
    elif not _is_same_key(ap, station):
        yield msg(f"the keys of {arg(names[0])} and {arg(names[1])} would differ")


def _ap_protocol(ap: PairRadio) -> str:
    word = ap.get("wireless-protocol", "any")
    return "nv2" if word.startswith("nv2") else "802.11" if word in ("any", "unspecified") else word


def _station_protocols(station: PairRadio) -> frozenset[str]:
    word = station.get("wireless-protocol", "any")
    return _PROTOCOLS.get(word, frozenset({word}))


def _is_same_key(ap: PairRadio, station: PairRadio) -> bool:
    if ap.menu == LEGACY and _ap_protocol(ap) == "nv2":
        if ap.get("nv2-security", "disabled") != station.get("nv2-security", "disabled"):
            return False
        return ap.get("nv2-security") != "enabled" or _equal(ap, station, "nv2-preshared-key")
    if ap.menu != LEGACY:
        return _has_common_word(ap, station, "security.authentication-types") and _equal(
            ap, station, "security.passphrase"
        )
    if ap.get("security.mode", "none") != station.get("security.mode", "none"):
        return False
    if ap.get("security.mode", "none") != "dynamic-keys":
        return True
    common = _words(ap, "security.authentication-types") & _words(station, "security.authentication-types")
    keys = {"wpa-psk": "security.wpa-pre-shared-key", "wpa2-psk": "security.wpa2-pre-shared-key"}
    return any(kind not in keys or _equal(ap, station, keys[kind]) for kind in common)


def _words(radio: PairRadio, name: str) -> frozenset[str]:
    return frozenset(word for word in radio.get(name).split(",") if word)


def _has_common_word(ap: PairRadio, station: PairRadio, name: str) -> bool:
    ours, theirs = _words(ap, name), _words(station, name)
    return bool(ours & theirs) or ours == theirs


def _equal(ap: PairRadio, station: PairRadio, name: str) -> bool:
    """Compare secrets; a hidden one (absent, or stars) counts as equal."""
    values = [radio.values.get(name) for radio in (ap, station)]
    return values[0] == values[1] or any(value is None or (value and not value.strip("*")) for value in values)
