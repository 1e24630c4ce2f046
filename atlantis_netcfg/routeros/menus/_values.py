"""Comparison of two texts of one value, which differ between user input, export and API.

`yes` is printed as `true`, `10m` as `00:10:00` by older versions, `10.0.0.1/32` as `10.0.0.1`; most lists have no
significant order. These forms are only used for comparisons; the text of the inventory is sent unchanged.
"""

from __future__ import annotations

import re
from enum import Enum, auto
from functools import lru_cache
from ipaddress import ip_interface


class PropertyKind(Enum):
    """The syntax of a value, as far as needed to compare two values."""

    TEXT = auto()
    BOOLEAN = auto()
    """`yes`/`no` in text, `true`/`false` from the API."""
    FLAG = auto()
    """Present or absent: `export` prints the bare name, the API an empty value (`fib`, `blackhole`)."""
    NUMBER = auto()
    """Decimal or hexadecimal."""
    TIME = auto()
    """`10m`, `600s`, `600`, `0:10` and `00:10:00` are the same; `2.2` is `2s200ms`."""
    SIZE = auto()
    """`4096`, `4096KiB` and `4MiB` are the same."""
    RATE = auto()
    """Bits per second: `280k` and `280000` are the same."""
    MAC = auto()
    PREFIX = auto()
    """An address, a prefix that keeps its host part, or a range of addresses."""
    NETWORK = auto()
    """A prefix whose host part the device clears."""
    SET = auto()
    """Words in any order."""
    PREFIXES = auto()
    """Prefixes in any order."""
    SEQUENCE = auto()
    """Words whose order matters."""
    POLICY = auto()
    """Policies of a user group: `!name` is the same as omitting it."""
    INTERFACE = auto()
    """Names of interfaces; updated when an interface is renamed."""
    GATEWAY = auto()
    """Addresses, interfaces or `address%interface`, in order; interfaces are updated when renamed."""


_TRUE = frozenset({"yes", "true", "on"})
_FALSE = frozenset({"no", "false", "off"})
_UNITS_MS = {"w": 604_800_000, "d": 86_400_000, "h": 3_600_000, "m": 60_000, "s": 1000, "ms": 1}
_UNITS = re.compile(r"(\d+)(ms|[wdhms])")
_SPAN = re.compile(r"(?:\d+(?:ms|[wdhms]))+")
_CLOCK = re.compile(r"(?:(\d+)w)?(?:(\d+)d)?(\d+):(\d\d)(?::(\d\d)(?:\.(\d{1,3}))?)?")
_FRACTION = re.compile(r"(\d+)\.(\d{1,3})")
_SIZE = re.compile(r"(\d+(?:\.\d+)?)(|KiB|MiB|GiB)")
_RATE = re.compile(r"(\d+)([kMG]?)")
_BITS = {"": 1, "k": 1000, "M": 1000_000, "G": 1000_000_000}
_KIB = {"": 1, "KiB": 1, "MiB": 1024, "GiB": 1024 * 1024}


def canonical(kind: PropertyKind, text: str) -> str:
    """Return the canonical form shared by all spellings of a value; text that is not of the kind is unchanged."""
    return text if kind is PropertyKind.TEXT else _canonical(kind, text)


@lru_cache(maxsize=16384)
def _canonical(kind: PropertyKind, text: str) -> str:
    """Return the canonical form; cached, because menus have few different values, shared by many routers."""
    if text.startswith("!") and kind is not PropertyKind.POLICY:
        return "!" + canonical(kind, text[1:])
    return _FORMS[kind](text)


def _boolean(text: str) -> str:
    return "yes" if text in _TRUE else "no" if text in _FALSE else text


def _flag(text: str) -> str:
    return "no" if text in _FALSE else "yes"


def _number(text: str) -> str:
    try:
        return str(int(text, 16 if text.lower().startswith("0x") else 10))
    except ValueError:
        return text


def _time(text: str) -> str:
    if text.isdecimal():
        return f"{int(text) * 1000}ms"
    if clock := _CLOCK.fullmatch(text):
        weeks, days, hours, minutes, seconds = (int(part or 0) for part in clock.groups()[:5])
        total = (((weeks * 7 + days) * 24 + hours) * 60 + minutes) * 60 + seconds
        return f"{total * 1000 + int((clock[6] or '0').ljust(3, '0'))}ms"
    if fraction := _FRACTION.fullmatch(text):
        return f"{int(fraction[1]) * 1000 + int(fraction[2].ljust(3, '0'))}ms"
    if _SPAN.fullmatch(text):
        return f"{sum(int(count) * _UNITS_MS[unit] for count, unit in _UNITS.findall(text))}ms"
    return text


def _size(text: str) -> str:
    match = _SIZE.fullmatch(text)
    return f"{float(match[1]) * _KIB[match[2]]:g}KiB" if match else text


def _rate(text: str) -> str:
    match = _RATE.fullmatch(text)
    return str(int(match[1]) * _BITS[match[2]]) if match else text


def _mac(text: str) -> str:
    return text.upper()


def _prefix(text: str) -> str:
    try:
        interface = ip_interface(text)
    except ValueError:
        return text
    return str(interface.ip) if interface.network.prefixlen == interface.max_prefixlen else str(interface)


def _network(text: str) -> str:
    try:
        network = ip_interface(text).network
    except ValueError:
        return text
    return str(network)


def _set(text: str) -> str:
    return ",".join(sorted({word.strip() for word in text.split(",")}))


def _prefixes(text: str) -> str:
    return ",".join(sorted({_prefix(word.strip()) for word in text.split(",")}))


def _sequence(text: str) -> str:
    return ",".join(word.strip() for word in text.split(","))


def _policy(text: str) -> str:
    return ",".join(sorted({word for word in text.split(",") if not word.startswith("!")}))


_FORMS = {
    PropertyKind.BOOLEAN: _boolean,
    PropertyKind.FLAG: _flag,
    PropertyKind.NUMBER: _number,
    PropertyKind.TIME: _time,
    PropertyKind.SIZE: _size,
    PropertyKind.RATE: _rate,
    PropertyKind.MAC: _mac,
    PropertyKind.PREFIX: _prefix,
    PropertyKind.NETWORK: _network,
    PropertyKind.SET: _set,
    PropertyKind.PREFIXES: _prefixes,
    PropertyKind.SEQUENCE: _sequence,
    PropertyKind.POLICY: _policy,
    PropertyKind.INTERFACE: _sequence,
    PropertyKind.GATEWAY: _sequence,
}
