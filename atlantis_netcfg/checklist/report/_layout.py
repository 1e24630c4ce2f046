"""Where the things of a drawing stand: far ends above, what carries the site below them, vehicles at the bottom.

The drawing is narrow and tall, so that a telephone shows it whole. Nodes stand in rows by what they are; links between
neighbouring rows run over a common line in the gap, longer ones along the left margin. Each vehicle has a line of its
own, with its links as badges, which ends at the line of whoever sees it on the right.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from itertools import groupby
from typing import TYPE_CHECKING, TypeAlias

from atlantis_netcfg.checklist.report._shapes import (
    BADGE_HEIGHT,
    Badge,
    Box,
    Layout,
    Wire,
    badge_text,
    badge_width,
    cut,
)
from atlantis_netcfg.checklist.report._states import State, worst_state

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from atlantis_netcfg.checklist.report.document import Document, DrawnLink, DrawnNode, Item

__all__ = ["layout", "states"]

_WIDTH = 380.0
_LEFT, _RIGHT = 18.0, 24.0
"""Margins in which long lines run."""
_BOX_WIDTH, _BOX_HEIGHT, _GAP = 106.0, 38.0, 10.0
_IN_A_ROW = 3
_VEHICLE_WIDTH = 92.0
_SLOT = BADGE_HEIGHT + 3
_RANKS = {
    "partner": 0,
    "vpn_server": 0,
    "site": 0,
    "cpe": 1,
    "lte_router": 1,
    "satellite_terminal": 1,
    "router": 2,
    "gateway": 3,
}
"""From the top; all else stands with the gateway, and so does a VPN server on a cable of this router."""
_LOCAL = 3
_VEHICLE = "vehicle"
_THROUGH = frozenset({"vpn", "acoustic", "usbl"})
_NAME_LETTERS, _DETAIL_LETTERS, _BADGE_LETTERS = 15, 19, 30


@dataclass(frozen=True, slots=True)
class _Place:
    """Where a node stands."""

    row: int
    box: Box


@dataclass(slots=True)
class _Sheet:
    """What is drawn so far."""

    items: dict[str, Item]
    places: dict[str, _Place] = field(default_factory=dict)
    wires: list[Wire] = field(default_factory=list)
    badges: list[Badge] = field(default_factory=list)
    buses: list[float] = field(default_factory=list)
    """The common line below each row: above it hang badges of that row, below it stand those of the next."""

    def state(self, named: Iterable[str]) -> State | None:
        """The worst of some items; None where there are none of them."""
        known = [self.items[name] for name in named if name in self.items]
        return worst_state(known) if known else None


def states(document: Document) -> tuple[dict[str, State | None], list[tuple[DrawnLink, State | None]]]:
    """How each node and each link is, for words beside the drawing."""
    sheet = _Sheet({item.id: item for item in document.items})
    nodes = {node.key: sheet.state(node.items) for node in document.drawing.nodes}
    return nodes, [(link, sheet.state(link.items)) for link in document.drawing.links]


def layout(document: Document) -> Layout:
    """Arrange the drawing of a document; the same for the same document."""
    sheet = _Sheet({item.id: item for item in document.items})
    nodes = {node.key: node for node in document.drawing.nodes}
    vehicles = [node for node in nodes.values() if node.kind == _VEHICLE]
    devices = [node for node in nodes.values() if node.kind != _VEHICLE]
    links = document.drawing.links
    inner = [link for link in links if link.a != link.b and {link.a, link.b} <= {device.key for device in devices}]
    bottom = _devices(sheet, devices, inner)
    height = _vehicles(sheet, vehicles, links, bottom)
    height = max([height, *(badge.y + BADGE_HEIGHT + 4 for badge in sheet.badges)])
    boxes = tuple(place.box for place in sheet.places.values())
    return Layout(_WIDTH, height, tuple(sheet.wires), boxes, tuple(sheet.badges))


def _others(link: DrawnLink, ends: set[str]) -> set[str]:
    """The ends of a link whose other end is one of some nodes."""
    return {far for near, far in ((link.a, link.b), (link.b, link.a)) if near in ends}


def _rows(nodes: Sequence[DrawnNode], links: Sequence[DrawnLink]) -> list[list[DrawnNode]]:
    """Rows of at most three, from the top."""
    routers = {node.key for node in nodes if node.kind == "router"}
    cabled = {key for link in links if link.kind == "ethernet" for key in _others(link, routers)}

    def rank(node: DrawnNode) -> int:
        own_server = node.kind == "vpn_server" and node.key in cabled
        return _LOCAL if own_server else _RANKS.get(node.kind, _LOCAL)

    ranked = [list(some) for _, some in groupby(sorted(nodes, key=rank), key=rank)]
    return [some[start : start + _IN_A_ROW] for some in ranked for start in range(0, len(some), _IN_A_ROW)]


def _devices(sheet: _Sheet, nodes: Sequence[DrawnNode], links: Sequence[DrawnLink]) -> float:
    """Place all but the vehicles, and wire them; the bottom of it."""
    rows = _rows(nodes, links)
    row_of = {node.key: number for number, row in enumerate(rows) for node in row}
    slots = _slots(links, row_of)
    y = 4.0
    for number, row in enumerate(rows):
        y += _tallest(slots, row, _Side.ABOVE) + 4
        left = _LEFT + (_WIDTH - _LEFT - _RIGHT - len(row) * _BOX_WIDTH - (len(row) - 1) * _GAP) / 2
        for place, node in enumerate(row):
            box = _box(sheet, node, left + place * (_BOX_WIDTH + _GAP), y, _BOX_WIDTH)
            sheet.places[node.key] = _Place(number, box)
        y += _BOX_HEIGHT + _tallest(slots, row, _Side.BELOW) + 8
        sheet.buses.append(y)
    _wire(sheet, slots, row_of)
    return y


class _Side(Enum):
    """Where a badge stands."""

    ABOVE = "above"
    BELOW = "below"
    BESIDE = "beside"
    """On the line that comes from the left margin."""


_Slots: TypeAlias = "dict[tuple[str, _Side], list[DrawnLink]]"


def _tallest(slots: _Slots, row: Sequence[DrawnNode], side: _Side) -> float:
    return max((len(slots.get((node.key, side), ())) for node in row), default=0) * _SLOT


def _slots(links: Sequence[DrawnLink], row_of: dict[str, int]) -> _Slots:
    """At which node the badge of each link stands."""
    slots: _Slots = {}
    for link in links:
        upper, lower = _ends(link, row_of)
        slots.setdefault(_slot(links, upper, lower, row_of), []).append(link)
    return slots


def _slot(links: Sequence[DrawnLink], upper: str, lower: str, row_of: dict[str, int]) -> tuple[str, _Side]:
    """At the end that has fewer links towards the other's row; of a long line beside the lower end, if it has room."""
    distance = row_of[lower] - row_of[upper]
    if distance > 1 and list(row_of.values()).count(row_of[lower]) == 1:
        return lower, _Side.BESIDE
    spread = _fan(links, lower, row_of, row_of[upper]) > 1 and _fan(links, upper, row_of, row_of[lower]) == 1
    return (upper, _Side.BELOW) if distance == 1 and spread else (lower, _Side.ABOVE)


def _ends(link: DrawnLink, row_of: dict[str, int]) -> tuple[str, str]:
    """The upper one first; of one row, the one that is placed first."""
    order = list(row_of)
    upper, lower = sorted((link.a, link.b), key=lambda key: (row_of[key], order.index(key)))
    return upper, lower


def _fan(links: Sequence[DrawnLink], key: str, row_of: dict[str, int], row: int) -> int:
    """How many nodes of a row a node is linked to."""
    others = {link.b if link.a == key else link.a for link in links if key in {link.a, link.b}}
    return len([other for other in others if row_of[other] == row])


def _box(sheet: _Sheet, node: DrawnNode, x: float, y: float, width: float) -> Box:
    label, detail = cut(node.label, _NAME_LETTERS), cut(node.detail, _DETAIL_LETTERS)
    return Box(x, y, width, _BOX_HEIGHT, label, detail, node.kind, sheet.state(node.items))


def _wire(sheet: _Sheet, slots: _Slots, row_of: dict[str, int]) -> None:
    for (key, side), links in slots.items():
        box = sheet.places[key].box
        for number, link in enumerate(links):
            state = sheet.state(link.items)
            badge = _badge(link, state, *_spot(box, side, number))
            route = _route(sheet, *_ends(link, row_of), badge.y + BADGE_HEIGHT / 2)
            sheet.wires.append(Wire(route, state, link.kind in _THROUGH))
            if link.label.strip():
                sheet.badges.append(badge)


def _spot(box: Box, side: _Side, number: int) -> tuple[float, float]:
    """Middle and top of the n-th badge at a node."""
    if side is _Side.BESIDE:
        return (_LEFT / 2 + box.x) / 2, box.y + 2 + _SLOT * number
    if side is _Side.BELOW:
        return box.middle, box.y + box.height + 3 + _SLOT * number
    return box.middle, box.y - _SLOT * (number + 1)


def _badge(link: DrawnLink, state: State | None, middle: float, y: float) -> Badge:
    label = cut(link.label, _BADGE_LETTERS)
    width = badge_width(label, state)
    x = min(max(middle - width / 2, 1), max(_WIDTH - width - 1, 1))
    return Badge(x, y, width, badge_text(label, state), state)


def _route(sheet: _Sheet, upper: str, lower: str, badge: float) -> tuple[tuple[float, float], ...]:
    place, other = sheet.places[upper], sheet.places[lower]
    a, b = place.box, other.box
    if place.row == other.row:
        return ((a.middle, a.y), (a.middle, badge), (b.middle, badge), (b.middle, b.y))
    if other.row - place.row == 1:
        y = sheet.buses[place.row]
        return ((a.middle, a.y + a.height), (a.middle, y), (b.middle, y), (b.middle, b.y))
    x, start = _LEFT / 2, a.y + a.height / 2
    end = badge if b.y < badge < b.y + b.height else b.y + b.height / 2
    return ((a.x, start), (x, start), (x, end), (b.x, end))


def _vehicles(sheet: _Sheet, vehicles: Sequence[DrawnNode], links: Sequence[DrawnLink], y: float) -> float:
    """Place the vehicles, one below the other; the bottom of the drawing."""
    lanes: dict[str, float] = {}
    for node in vehicles:
        y += 6
        local = [link for link in links if node.key in {link.a, link.b}]
        box = _box(sheet, node, 4, y, _VEHICLE_WIDTH)
        sheet.places[node.key] = _Place(-1, box)
        low = _flow(sheet, [link for link in local if link.label.strip()], y + (_BOX_HEIGHT - BADGE_HEIGHT) / 2)
        middle = y + _BOX_HEIGHT / 2
        ends = dict.fromkeys(link.b if link.a == node.key else link.a for link in local)
        for end in ends:
            if end in sheet.places and sheet.places[end].row >= 0:
                lane = lanes.setdefault(end, _WIDTH - 8 - 5 * (len(lanes) % 3))
                both = [item for link in local if end in {link.a, link.b} for item in link.items]
                sheet.wires.append(Wire(((box.x + box.width, middle), (lane, middle)), sheet.state(both)))
                sheet.wires.append(Wire(_down(sheet.places[end].box, lane, middle), None))
        y = max(y + _BOX_HEIGHT, low)
    return y + 6


def _flow(sheet: _Sheet, links: Sequence[DrawnLink], y: float) -> float:
    """Set badges side by side, and in a new line where there is no room; the bottom of the last."""
    start = x = _VEHICLE_WIDTH + 12
    for link in links:
        state = sheet.state(link.items)
        width = badge_width(cut(link.label, _BADGE_LETTERS), state)
        if x > start and x + width > _WIDTH - _RIGHT:
            x, y = start, y + _SLOT
        sheet.badges.append(_badge(link, state, x + width / 2, y))
        x += width + 4
    return y + _SLOT + (_BOX_HEIGHT - BADGE_HEIGHT) / 2


def _down(box: Box, lane: float, y: float) -> tuple[tuple[float, float], ...]:
    start = box.y + box.height / 2
    return ((box.x + box.width, start), (lane, start), (lane, y))
