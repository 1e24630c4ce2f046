"""What clients are asked, what they must find, and what they tamper with: the same for all of them."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from stand import text

from atlantis_netcfg.routeros import desired

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from stand import Stand

    Rows = Mapping[str, Sequence[Mapping[str, Any]]]

SECRET = "password"
"""A field that is compared like any other: a user of group `full` may read it."""
MENUS = tuple(desired.read(text()).items)
"""Every menu that the template emits."""
NOT_IN_COMMUNITY = {"/interface/wifi": ("configuration.installation",)}
"""Menu -> fields which RouterOS has from 7.17 on, and the tables of community.routeros do not have."""
TAMPERED = {
    "added": "only for today",
    "renamed": "atlantis: 4g",
    "comment": "4G, new",
    "removed": "atlantis: vpn.example.org",
    "moved": "atlantis: ping over wifi-ptp, to test it",
    "before": "atlantis: ping from the LAN",
}
"""A rule more, a comment altered, a name removed, a rule moved."""
_MOVED = (
    'add action=accept chain=input comment="atlantis: ping from the LAN" in-interface-list=LAN protocol=icmp '
    "src-address=10.64.1.0/24"
)
DRIFT = {
    '- add action=accept chain=input comment="only for today" src-address=10.9.9.9',
    f"- {_MOVED}",
    f"+ {_MOVED}",
    '- set [ find address=10.10.1.2/29 ] comment="4G, new"',
    '+ set [ find address=10.10.1.2/29 ] comment="atlantis: 4g"',
    '+ add address=203.0.113.2 comment="atlantis: vpn.example.org" name=vpn.example.org',
}
"""What our plan shows of it, and nothing else; the order is said by putting the rule back behind its neighbour."""
PINGS = [
    "atlantis: ping from management",
    "atlantis: ping from management by the VPN",
    "atlantis: ping from the LAN",
    "atlantis: ping over wifi-ptp, to test it",
]
RULES = 47
"""So many rows has the filter: a number written down here, so that a row that nobody sees is missed."""
TEXTS = ("Ærø ñ €", "", 'a=b "q" $x ? \\ ;', " pad ", "x" * 300)
"""Beyond ASCII, empty, everything that a console would quote, blanks at the ends, a length of two bytes."""
CALLS: tuple[tuple[str, dict[str, str]], ...] = (
    ("/ip/address/remove", {".id": "*FFFF"}),
    ("/ip/nonsense/print", {}),
    ("/ip/address/add", {"address": "nonsense", "interface": "ether1"}),
    ("/ip/address/add", {"address": "10.9.9.1/24", "interface": "ether99"}),
    ("/ip/address/add", {"interface": "ether1"}),
    ("/ip/address/add", {"address": "10.9.9.1/24", "interface": "ether1", "colour": "red"}),
    ("/interface/bridge/add", {"name": "bridge-lan"}),
)
REFUSALS = (
    "no such item",
    "no such command prefix",
    "invalid value for argument address",
    "input does not match any value of interface",
    "missing =address=",
    "unknown parameter colour",
    "failure: already have interface with such name",
)
"""The router's words for each of the calls."""


def shortfalls(found: Rows, beyond: Mapping[str, Sequence[str]] | None = None) -> list[str]:
    """Declared rows that a client has not seen as they are declared; the order counts where it means something.

    `beyond`: menu -> fields that the client has no name for.
    """
    state = desired.read(text())
    told = []
    for menu, items in state.items.items():
        rows = [_plain(row) for row in found[menu]]
        at = 0
        for item in items:
            unnamed = (beyond or {}).get(menu, ())
            wanted = _plain({name: value for name, value in item.values.items() if name not in unnamed})
            hit = next((index for index, row in enumerate(rows) if wanted.items() <= row.items()), None)
            if hit is None:
                near = min(rows, key=lambda row: len(wanted.items() - row.items()), default={})
                told.append(f"{menu}: {sorted(wanted.items() - near.items())} of {item.values}")
            elif menu in ORDERED:
                told += [f"{menu}: {item.values} stands too early"] if hit < at else []
                at = hit
    return told


ORDERED = ("/ip/firewall/filter", "/ip/firewall/nat", "/ip/firewall/mangle", "/routing/rule")


def _plain(row: Mapping[str, Any]) -> dict[str, str]:
    plain = {_name(name): _value(value) for name, value in row.items()}
    return plain | ({"blackhole": "true"} if plain.get("blackhole") == "" else {})


def _name(name: str) -> str:
    return name.lstrip(".").replace("_", "-")


def _value(value: object) -> str:
    """One spelling: truth as `true`, an empty value for a flag that is merely there."""
    if value is None or value == "":
        return ""
    word = str(value).lower() if isinstance(value, bool) else str(value)
    return {"yes": "true", "no": "false"}.get(word, word)


def drifted(diff: str) -> set[str]:
    """Lines of a plan that change something."""
    return {re.sub(r"\s+", " ", line) for line in diff.splitlines() if line[:1] in "+-"}


def is_put_right(stand: Stand, before: str) -> None:
    """Our plan shows exactly what was tampered with, our run puts it right, and the export is what it was."""
    assert drifted(stand.drift()) == DRIFT
    stand.put_right()
    assert stand.export() == before
