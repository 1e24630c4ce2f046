"""Would the two ends still find each other after the plan? Asked of the rows as both plans would leave them.

Manual, Wireless Interface (protocols, nv2); Manual, Wireless Station Modes; Manual, WiFi. What cannot be read (a
hidden key) is not compared; what is not understood counts against the plan.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.routeros.pair._radio import LEGACY, Radio

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["disagreements"]

_APS = ("ap", "ap-bridge", "bridge")
_ALL = frozenset({"802.11", "nstreme", "nv2"})
_UNDERSTOOD = {
    "any": _ALL,
    "unspecified": frozenset({"802.11", "nstreme"}),
    "nv2-nstreme": frozenset({"nv2", "nstreme"}),
    "nv2-nstreme-802.11": _ALL,
}
"""What a station connects to, by its `wireless-protocol`."""


def disagreements(near: Radio | None, far: Radio | None, names: tuple[str, str]) -> tuple[str, ...]:
    """Return in what two radios would differ so that no link comes about, one sentence each."""
    if near is None or far is None:
        return (f"{names[near is not None]} has no radio that can be driven",)
    if near.menu != far.menu:
        return ("the two ends have different drivers, and station-bridge works only between equal ones",)
    return tuple(_modes(near, far, names)) or tuple(_values(near, far, names))


def _word(radio: Radio, name: str) -> str:
    """Return a property by the name of the older driver."""
    if radio.menu == LEGACY:
        return radio.get(name)
    return radio.get({"channel-width": "channel.width", "band": "channel.band"}.get(name, f"configuration.{name}"))


def _mode(radio: Radio) -> str:
    return radio.get("mode", "station") if radio.menu == LEGACY else radio.get("configuration.mode", "ap")


def _modes(near: Radio, far: Radio, names: tuple[str, str]) -> Iterator[str]:
    for radio, name in zip((near, far), names, strict=True):
        if radio.get("disabled") in ("yes", "true"):
            yield f"the radio of {name} would be disabled"
    aps = [_mode(radio) in _APS for radio in (near, far)]
    if all(aps) or not any(aps):
        yield f"{names[0]} would be {_mode(near)} and {names[1]} {_mode(far)}: one has to be the access point"
        return
    station, who = (far, names[1]) if aps[0] else (near, names[0])
    if _mode(station) != "station-bridge":
        yield f"{who} would be {_mode(station)}: only station-bridge carries a bridge"


def _values(near: Radio, far: Radio, names: tuple[str, str]) -> Iterator[str]:
    ap, station = (near, far) if _mode(near) in _APS else (far, near)
    for name in ("ssid", "channel-width", "country"):
        here, there = _word(near, name), _word(far, name)
        if here != there:
            yield f"{name} would be {here or 'unset'} on {names[0]} and {there or 'unset'} on {names[1]}"
    if _word(near, "band")[:4] != _word(far, "band")[:4] and _word(near, "band") and _word(far, "band"):
        yield f"band would be {_word(near, 'band')} on {names[0]} and {_word(far, 'band')} on {names[1]}"
    if ap.menu == LEGACY and _spoken(ap) not in _understood(station):
        words = (near.get("wireless-protocol"), far.get("wireless-protocol"))
        yield f"wireless-protocol would be {words[0]} on {names[0]} and {words[1]} on {names[1]}"
    elif not _same_key(ap, station):
        yield f"the keys of {names[0]} and {names[1]} would differ"


def _spoken(ap: Radio) -> str:
    word = ap.get("wireless-protocol", "any")
    return "nv2" if word.startswith("nv2") else "802.11" if word in ("any", "unspecified") else word


def _understood(station: Radio) -> frozenset[str]:
    word = station.get("wireless-protocol", "any")
    return _UNDERSTOOD.get(word, frozenset({word}))


def _same_key(ap: Radio, station: Radio) -> bool:
    if ap.menu == LEGACY and _spoken(ap) == "nv2":
        if ap.get("nv2-security", "disabled") != station.get("nv2-security", "disabled"):
            return False
        return ap.get("nv2-security") != "enabled" or _equal(ap, station, "nv2-preshared-key")
    if ap.menu != LEGACY:
        return _share(ap, station, "security.authentication-types") and _equal(ap, station, "security.passphrase")
    if ap.get("security.mode", "none") != station.get("security.mode", "none"):
        return False
    if ap.get("security.mode", "none") != "dynamic-keys":
        return True
    common = _words(ap, "security.authentication-types") & _words(station, "security.authentication-types")
    keys = {"wpa-psk": "security.wpa-pre-shared-key", "wpa2-psk": "security.wpa2-pre-shared-key"}
    return any(kind not in keys or _equal(ap, station, keys[kind]) for kind in common)


def _words(radio: Radio, name: str) -> frozenset[str]:
    return frozenset(word for word in radio.get(name).split(",") if word)


def _share(ap: Radio, station: Radio, name: str) -> bool:
    ours, theirs = _words(ap, name), _words(station, name)
    return bool(ours & theirs) or ours == theirs


def _equal(ap: Radio, station: Radio, name: str) -> bool:
    """Compare secrets; one that is kept from us (absent, or stars) may be equal."""
    values = [radio.values.get(name) for radio in (ap, station)]
    return values[0] == values[1] or any(value is None or (value and not value.strip("*")) for value in values)
