"""From answers to rows and addresses; whatever is no whole answer becomes the finding that says so."""

from __future__ import annotations

import json
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv4Interface
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.checklist.probes.results import Looked, Offered, Ran, Rows
from atlantis_netcfg.checklist.probes.site_checks.findings import silent, unknown, unreadable

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from atlantis_netcfg.checklist.probes.results import Answer, Offer

__all__ = ["Held", "Neighbour", "addresses", "is_address", "look", "neighbours", "offers", "printed", "rows", "yes"]


_TRUE = frozenset({"true", "yes"})
_GONE = frozenset({"FAILED", "INCOMPLETE"})
_STALE = "STALE"
"""The words of the kernel for an entry, which are RouterOS' `status` as well, there in small letters."""


@dataclass(frozen=True, slots=True)
class Held:
    """An address that an interface has."""

    interface: str
    address: IPv4Interface
    leased: bool
    """A DHCP server gave it, and may take it back."""
    dead: bool = False
    """Disabled, or invalid."""
    flags: tuple[str, ...] = ()
    """Those that a declared address does not have."""


@dataclass(frozen=True, slots=True)
class Neighbour:
    """Who has answered for an address."""

    address: str
    mac: str
    """In lower case."""
    interface: str
    seen_by: str
    fresh: bool = True
    """False: so it was some time ago, and nobody has asked since."""


def yes(row: Mapping[str, str], flag: str) -> bool:
    """Whether a row says so."""
    return row.get(flag) in _TRUE


def is_address(text: str) -> bool:
    """Whether it is an IPv4 address."""
    try:
        IPv4Address(text)
    except ValueError:
        return False
    return True


def rows(answer: Answer, who: str, what: str, key: str) -> tuple[Mapping[str, str], ...] | Finding:
    """Rows of a RouterOS menu; rows none of which has its `key` are not of that menu."""
    if not isinstance(answer, Rows):
        return unreadable(who, what)
    if answer.trouble is not None:
        return silent(who, answer.trouble, answer.words)
    if answer.rows is None:
        text = f": {answer.words}" if answer.words else ""
        hint = f"this version of RouterOS may not have it: look at {who} by hand"
        return unknown("refused", f"{who} does not tell {what}{text}", hint)
    if answer.rows and not any(key in row for row in answer.rows):
        return unreadable(who, what)
    return answer.rows


def printed(answer: Answer, who: str) -> str | Finding:
    """What a program printed that has ended well."""
    if not isinstance(answer, Ran):
        return unreadable(who, "itself")
    if answer.trouble is not None:
        return silent(who, answer.trouble, answer.words)
    if answer.rc != 0:
        text = (answer.err.strip().splitlines() or [f"exit {answer.rc}"])[-1]
        return unknown("program-failed", f"a program on {who} failed: {text[:160]}", f"try the same on {who} by hand")
    return answer.out


def parsed(answer: Answer, who: str, what: str) -> list[dict[str, Any]] | Finding:
    """Read the JSON of iproute2: a list of objects."""
    text = printed(answer, who)
    if isinstance(text, Finding):
        return text
    try:
        found = json.loads(text or "[]")
    except (ValueError, RecursionError):
        return unreadable(who, what)
    if not isinstance(found, list) or not all(isinstance(item, dict) for item in found):
        return unreadable(who, what)
    return found


def addresses(answer: Answer, who: str) -> tuple[Held, ...] | Finding:
    """Addresses of a computer (`ip -j addr show`), or of a router (`/ip/address`); whoever answers has one at least."""
    result: Iterable[Mapping[str, Any]] | Finding
    if isinstance(answer, Rows):
        result = rows(answer, who, "its addresses", "address")
        current = () if isinstance(result, Finding) else tuple(_of_router(result))
    else:
        result = parsed(answer, who, "its addresses")
        current = () if isinstance(result, Finding) else tuple(_of_computer(result))
    if isinstance(result, Finding):
        return result
    known = tuple(item for item in current if item is not None)
    return known if known and len(known) == len(current) else unreadable(who, "its addresses")


def _of_router(found: Iterable[Mapping[str, str]]) -> Iterable[Held | None]:
    """None: a row that is not understood."""
    for row in found:
        address = _interface(row.get("address"))
        if address is None:
            yield None
        else:
            flags = tuple(flag for flag in ("disabled", "invalid", "dynamic") if yes(row, flag))
            dead = "disabled" in flags or "invalid" in flags
            yield Held(row.get("interface", "?"), address, "dynamic" in flags, dead=dead, flags=flags)


def _of_computer(result: list[dict[str, Any]]) -> Iterable[Held | None]:
    for row in result:
        for entry in row.get("addr_info") or ():
            if isinstance(entry, dict) and entry.get("family") == "inet":
                address = _interface(f"{entry.get('local')}/{entry.get('prefixlen')}")
                known = Held(str(row.get("ifname", "?")), address, entry.get("dynamic") is True) if address else None
                yield known


def _interface(text: str | None) -> IPv4Interface | None:
    try:
        return IPv4Interface(text or "")
    except ValueError:
        return None


def neighbours(answer: Answer, who: str) -> tuple[Neighbour, ...] | Finding:
    """Who has answered: of a computer `ip -j neigh show`, of a router `/ip/arp`."""
    if isinstance(answer, Rows):
        found = rows(answer, who, "its table of ARP", "address")
        return found if isinstance(found, Finding) else tuple(_arp(found, who))
    result = parsed(answer, who, "its neighbours")
    return result if isinstance(result, Finding) else tuple(_neigh(result, who))


def _arp(found: Iterable[Mapping[str, str]], who: str) -> Iterable[Neighbour]:
    for row in found:
        address, mac = row.get("address", ""), row.get("mac-address", "")
        status = row.get("status", "").upper()
        gone = yes(row, "disabled") or yes(row, "invalid") or row.get("complete") in {"false", "no"} or status in _GONE
        if mac and not gone and is_address(address):
            yield Neighbour(address, mac.lower(), row.get("interface", "?"), who, status != _STALE)


def _neigh(result: list[dict[str, Any]], who: str) -> Iterable[Neighbour]:
    for row in result:
        address, mac, state = str(row.get("dst", "")), row.get("lladdr"), row.get("state") or ()
        if isinstance(mac, str) and is_address(address) and not _GONE & set(state):
            yield Neighbour(address, mac.lower(), str(row.get("dev", "?")), who, _STALE not in state)


def offers(answer: Answer, who: str) -> tuple[Offer, ...] | Finding:
    """Who hands out addresses."""
    if not isinstance(answer, Offered):
        return unreadable(who, "DHCP servers")
    if answer.trouble is not None:
        return silent(who, answer.trouble, answer.words)
    return answer.offers


def look(answer: Answer, who: str) -> Mapping[str, Any] | Finding:
    """How a bearer is."""
    if not isinstance(answer, Looked):
        return unreadable(who, "its links")
    if answer.trouble is not None:
        return silent(who, answer.trouble, answer.words)
    if answer.bearer is None:
        return unreadable(who, "its links")
    return answer.bearer
