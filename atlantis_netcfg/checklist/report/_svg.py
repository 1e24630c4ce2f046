"""The drawing of a site as SVG: with a title and a full text description, and without external resources.

Colours are set on each shape, so that the file can be shown alone; a page may override them through the classes.

Arrangement: remote ends at the top, the site's links below them, vehicles at the bottom.

On a telephone the drawing is narrow and tall; otherwise the vehicles are beside the devices. Nodes are in rows by type;
links between neighbouring rows share a line in the gap, longer ones run along the left margin. Each vehicle has its own
line, with its links as badges, which ends at the line of the host that sees it, right of the devices.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from enum import Enum
from itertools import groupby
from typing import TYPE_CHECKING, TypeAlias

from atlantis_netcfg.checklist.report import _shapes
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.runs.report import signs
from atlantis_netcfg.runs.report.drift import clean

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from atlantis_netcfg.checklist.report.document import Document, DrawnLink, DrawnNode, Item


_WIDTH = 380.0
_LEFT, _RIGHT = 18.0, 24.0
"""Margins in which long lines run."""
_BOX_WIDTH, _BOX_HEIGHT, _GAP = 106.0, 38.0, 10.0
_IN_A_ROW = 3
_VEHICLE_WIDTH = 92.0
_SLOT = _shapes.BADGE_HEIGHT + 3
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
"""Row from the top; all other kinds are beside the gateway, as is a VPN server on a cable of this router."""
_LOCAL = 3
_VEHICLE = "vehicle"
_THROUGH = frozenset({"vpn", "acoustic", "usbl"})
_NAME_LETTERS, _DETAIL_LETTERS, _BADGE_LETTERS = 15, 19, 30


@dataclass(frozen=True, slots=True)
class _DrawnPlace:
    """Position of a node."""

    row: int
    box: _shapes.DrawnBox


@dataclass(slots=True)
class _SvgSheet:
    """The shapes placed so far."""

    items: dict[str, Item]
    places: dict[str, _DrawnPlace] = field(default_factory=dict)
    wires: list[_shapes.DrawnWire] = field(default_factory=list)
    badges: list[_shapes.Badge] = field(default_factory=list)
    buses: list[float] = field(default_factory=list)
    """The common line below each row: above it hang badges of that row, below it stand those of the next."""

    def state(self, names: Iterable[str]) -> signs.ShownState | None:
        """Return the worst state of some items; None if none of them exists."""
        known_items = [self.items[name] for name in names if name in self.items]
        return _shapes.worst_state(known_items) if known_items else None


def states(
    document: Document,
) -> tuple[dict[str, signs.ShownState | None], list[tuple[DrawnLink, signs.ShownState | None]]]:
    """Return the state of each node and each link, for the description of the drawing."""
    sheet = _SvgSheet({item.id: item for item in document.items})
    nodes = {node.key: sheet.state(node.items) for node in document.drawing.nodes}
    return nodes, [(link, sheet.state(link.items)) for link in document.drawing.links]


def layout(document: Document, *, wide: bool = False) -> _shapes.DrawingLayout:
    """Arrange the drawing of a document; the same document always gives the same result.

    `wide`: vehicles are beside the devices, not below them, for a page wider than a telephone.
    """
    sheet = _SvgSheet({item.id: item for item in document.items})
    nodes = {node.key: node for node in document.drawing.nodes}
    vehicles = [node for node in nodes.values() if node.kind == _VEHICLE]
    devices = [node for node in nodes.values() if node.kind != _VEHICLE]
    links = document.drawing.links
    inner = [link for link in links if link.a != link.b and {link.a, link.b} <= {device.key for device in devices}]
    bottom = _devices(sheet, devices, inner)
    wide = wide and bool(vehicles) and bool(devices)
    left, top = (_WIDTH, 0.0) if wide else (0.0, bottom)
    height = max(bottom, _vehicles(sheet, vehicles, links, left, top))
    height = max([height, *(badge.y + _shapes.BADGE_HEIGHT + 4 for badge in sheet.badges)])
    boxes = tuple(place.box for place in sheet.places.values())
    return _shapes.DrawingLayout(left + _WIDTH, height, tuple(sheet.wires), boxes, tuple(sheet.badges))


def _others(link: DrawnLink, ends: set[str]) -> set[str]:
    """Return the ends of a link whose opposite end is in a set of nodes."""
    return {far for near, far in ((link.a, link.b), (link.b, link.a)) if near in ends}


def _rows(nodes: Sequence[DrawnNode], links: Sequence[DrawnLink]) -> list[list[DrawnNode]]:
    """Return rows of at most three nodes, from the top."""
    routers = {node.key for node in nodes if node.kind == "router"}
    cabled_keys = {key for link in links if link.kind == "ethernet" for key in _others(link, routers)}

    def rank(node: DrawnNode) -> int:
        own_server = node.kind == "vpn_server" and node.key in cabled_keys
        return _LOCAL if own_server else _RANKS.get(node.kind, _LOCAL)

    row_groups = [list(some) for _, some in groupby(sorted(nodes, key=rank), key=rank)]
    return [some[start : start + _IN_A_ROW] for some in row_groups for start in range(0, len(some), _IN_A_ROW)]


def _devices(sheet: _SvgSheet, nodes: Sequence[DrawnNode], links: Sequence[DrawnLink]) -> float:
    """Place all nodes except vehicles, and their wires; return the bottom edge."""
    rows = _rows(nodes, links)
    row_of = {node.key: number for number, row in enumerate(rows) for node in row}
    slots = _slots(links, row_of)
    y = 4.0
    for number, row in enumerate(rows):
        y += _max_slot_height(slots, row, _Side.ABOVE) + 4
        left = _LEFT + (_WIDTH - _LEFT - _RIGHT - len(row) * _BOX_WIDTH - (len(row) - 1) * _GAP) / 2
        for place, node in enumerate(row):
            box = _layout_box(sheet, node, left + place * (_BOX_WIDTH + _GAP), y, _BOX_WIDTH)
            sheet.places[node.key] = _DrawnPlace(number, box)
        y += _BOX_HEIGHT + _max_slot_height(slots, row, _Side.BELOW) + 8
        sheet.buses.append(y)
    _layout_wire(sheet, slots, row_of)
    return y


class _Side(Enum):
    """Position of a badge relative to its node."""

    ABOVE = "above"
    BELOW = "below"
    BESIDE = "beside"
    """On the line that comes from the left margin."""


_Slots: TypeAlias = "dict[tuple[str, _Side], list[DrawnLink]]"


def _max_slot_height(slots: _Slots, row: Sequence[DrawnNode], side: _Side) -> float:
    return max((len(slots.get((node.key, side), ())) for node in row), default=0) * _SLOT


def _slots(links: Sequence[DrawnLink], row_of: dict[str, int]) -> _Slots:
    """Return the badges' links by node and side."""
    slots: _Slots = {}
    for link in links:
        upper, lower = _ends(link, row_of)
        slots.setdefault(_slot(links, upper, lower, row_of), []).append(link)
    return slots


def _slot(links: Sequence[DrawnLink], upper: str, lower: str, row_of: dict[str, int]) -> tuple[str, _Side]:
    """Return node and side of a link's badge: the end with fewer links; beside the lower end for a long line."""
    distance = row_of[lower] - row_of[upper]
    if distance > 1 and list(row_of.values()).count(row_of[lower]) == 1:
        return lower, _Side.BESIDE
    spread = _fan(links, lower, row_of, row_of[upper]) > 1 and _fan(links, upper, row_of, row_of[lower]) == 1
    return (upper, _Side.BELOW) if distance == 1 and spread else (lower, _Side.ABOVE)


def _ends(link: DrawnLink, row_of: dict[str, int]) -> tuple[str, str]:
    """Return the ends of a link, the upper one first; in one row, the one placed first."""
    order = list(row_of)
    upper, lower = sorted((link.a, link.b), key=lambda key: (row_of[key], order.index(key)))
    return upper, lower


def _fan(links: Sequence[DrawnLink], key: str, row_of: dict[str, int], row: int) -> int:
    """Return the number of nodes in a row to which a node is linked."""
    others = {link.b if link.a == key else link.a for link in links if key in {link.a, link.b}}
    return len([other for other in others if row_of[other] == row])


def _layout_box(sheet: _SvgSheet, node: DrawnNode, x: float, y: float, width: float) -> _shapes.DrawnBox:
    words = node.detail or _kind(node.kind)
    label, detail = _shapes.cut(node.label, _NAME_LETTERS), _shapes.cut(words, _DETAIL_LETTERS)
    return _shapes.DrawnBox(x, y, width, _BOX_HEIGHT, label, detail, node.kind, sheet.state(node.items))


def _layout_wire(sheet: _SvgSheet, slots: _Slots, row_of: dict[str, int]) -> None:
    for (key, side), links in slots.items():
        box = sheet.places[key].box
        for number, link in enumerate(links):
            state = sheet.state(link.items)
            badge = _layout_badge(link, state, _spot(box, side, number), (0.0, _WIDTH))
            route = _route(sheet, *_ends(link, row_of), badge.y + _shapes.BADGE_HEIGHT / 2)
            sheet.wires.append(_shapes.DrawnWire(route, state, link.kind in _THROUGH))
            if link.label.strip():
                sheet.badges.append(badge)


def _spot(box: _shapes.DrawnBox, side: _Side, number: int) -> tuple[float, float]:
    """Return centre and top of the n-th badge at a node."""
    if side is _Side.BESIDE:
        return (_LEFT / 2 + box.x) / 2, box.y + 2 + _SLOT * number
    if side is _Side.BELOW:
        return box.middle, box.y + box.height + 3 + _SLOT * number
    return box.middle, box.y - _SLOT * (number + 1)


def _layout_badge(
    link: DrawnLink, state: signs.ShownState | None, spot: tuple[float, float], edges: tuple[float, float]
) -> _shapes.Badge:
    """Place a badge. `spot`: its centre and top; `edges`: its horizontal limits."""
    label = _shapes.cut(translate(link.label), _BADGE_LETTERS)
    width = _shapes.badge_width(label, state)
    left, right = edges
    x = min(max(spot[0] - width / 2, left + 1), max(right - width - 1, left + 1))
    return _shapes.Badge(x, spot[1], width, _shapes.badge_text(label, state), state)


def _route(sheet: _SvgSheet, upper: str, lower: str, badge: float) -> tuple[tuple[float, float], ...]:
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


def _vehicles(
    sheet: _SvgSheet, vehicles: Sequence[DrawnNode], links: Sequence[DrawnLink], left: float, y: float
) -> float:
    """Place the vehicles below each other, starting at `left`; return the bottom edge of the last."""
    lanes: dict[str, float] = {}
    for node in vehicles:
        y += 6
        local = [link for link in links if node.key in {link.a, link.b}]
        box = _layout_box(sheet, node, left + 4, y, _VEHICLE_WIDTH)
        sheet.places[node.key] = _DrawnPlace(-1, box)
        low = _flow(
            sheet, [link for link in local if link.label.strip()], left, y + (_BOX_HEIGHT - _shapes.BADGE_HEIGHT) / 2
        )
        middle = y + _BOX_HEIGHT / 2
        ends = dict.fromkeys(link.b if link.a == node.key else link.a for link in local)
        for end in ends:
            if end in sheet.places and sheet.places[end].row >= 0:
                lane = lanes.setdefault(end, _WIDTH - 8 - 5 * (len(lanes) % 3))
                both = [item for link in local if end in {link.a, link.b} for item in link.items]
                if left and sheet.badges:
                    sheet.wires.append(
                        _shapes.DrawnWire(((box.x + box.width, middle), (box.x + box.width + 12, middle)), None)
                    )
                side = box.x if left else box.x + box.width
                sheet.wires.append(_shapes.DrawnWire(((side, middle), (lane, middle)), sheet.state(both)))
                sheet.wires.append(_shapes.DrawnWire(_lane_points(sheet.places[end].box, lane, middle), None))
        y = max(y + _BOX_HEIGHT, low)
    return y + 6


def _flow(sheet: _SvgSheet, links: Sequence[DrawnLink], left: float, y: float) -> float:
    """Place badges side by side, wrapping to a new line; return the bottom edge of the last."""
    start = x = left + _VEHICLE_WIDTH + 12
    edges = (left, left + _WIDTH)
    for link in links:
        state = sheet.state(link.items)
        width = _shapes.badge_width(_shapes.cut(translate(link.label), _BADGE_LETTERS), state)
        if x > start and x + width > left + _WIDTH - _RIGHT:
            x, y = start, y + _SLOT
        sheet.badges.append(_layout_badge(link, state, (x + width / 2, y), edges))
        x += width + 4
    return y + _SLOT + (_BOX_HEIGHT - _shapes.BADGE_HEIGHT) / 2


def _lane_points(box: _shapes.DrawnBox, lane: float, y: float) -> tuple[tuple[float, float], ...]:
    start = box.y + box.height / 2
    return ((box.x + box.width, start), (lane, start), (lane, y))


_KINDS = {
    "cpe": "Wi-Fi bridge",
    "router": "router",
    "switch": "switch",
    "gateway": "gateway",
    "partner": "partners",
    "lte_router": "4G router",
    "satellite_terminal": "satellite",
    "vpn_server": "VPN server",
    "control_centre": "control centre",
    "site": "",
    "vehicle": "",
}


def _kind(kind: str) -> str:
    """Return the label of a node type; empty for those that need none."""
    words = _KINDS.get(kind, kind)
    return translate(words) if words else ""


def drawing_svg(document: Document, *, wide: bool = False) -> str:
    """Return the drawing, alone or for use inside a page; `wide`: for a page wider than a telephone."""
    shapes = layout(document, wide=wide)
    name = "drawing-wide" if wide else "drawing-narrow"
    root = ET.Element(
        "svg",
        {
            "xmlns": "http://www.w3.org/2000/svg",
            "viewBox": f"0 0 {shapes.width:g} {shapes.height:g}",
            "role": "img",
            "aria-labelledby": f"{name}-title {name}-words",
            "class": msg(f"drawing {arg(name)}"),
            "font-family": "system-ui, 'DejaVu Sans', sans-serif",
        },
    )
    ET.SubElement(root, "title", id=f"{name}-title").text = clean(translate(f"Drawing of {arg(document.title)}"))
    ET.SubElement(root, "desc", id=f"{name}-words").text = clean("\n".join(describe_drawing(document)))
    for wire in shapes.wires:
        _wire(root, wire)
    for box in shapes.boxes:
        _box(root, box)
    for badge in shapes.badges:
        _badge(root, badge)
    return ET.tostring(root, encoding="unicode", short_empty_elements=True)


def describe_drawing(document: Document) -> list[str]:
    """Describe the drawing in sentences."""
    nodes, links = states(document)
    labels = {node.key: node.label for node in document.drawing.nodes}
    result = []
    for node in document.drawing.nodes:
        shown_state = nodes[node.key]
        result.append(
            f"{node.label}{_with_comma(node.detail)}{_with_comma(str(shown_state) if shown_state is not None else '')}."
        )
    for link, shown_state in links:
        label = translate(link.label) if link.label.strip() else ""
        ends = msg(f"{arg(labels.get(link.a, link.a))}, {arg(labels.get(link.b, link.b))}")
        result.append(
            msg(f"{arg(ends)}: {arg(label)}{arg(_with_comma(str(shown_state) if shown_state is not None else ''))}.")
        )
    return result or [translate("The inventory has nothing here.")]


def _with_comma(words: str) -> str:
    return msg(f", {arg(words)}" if words else "")


def _group(root: ET.Element, state: signs.ShownState | None, kind: str) -> ET.Element:
    return ET.SubElement(root, "g", {"class": f"{kind} {signs.css_class(state)}"})


def _wire(root: ET.Element, wire: _shapes.DrawnWire) -> None:
    points = " ".join(f"{x:g},{y:g}" for x, y in wire.points)
    tint = signs.TINTS[wire.state]
    attributes = {"points": points, "fill": "none", "stroke": tint.edge, "stroke-width": "1.6", "class": "line"}
    if wire.is_dashed:
        attributes["stroke-dasharray"] = "4 3"
    ET.SubElement(_group(root, wire.state, "wire"), "polyline", attributes)


def _box(root: ET.Element, box: _shapes.DrawnBox) -> None:
    tint = signs.TINTS[box.state]
    group = _group(root, box.state, "box")
    shape = {"x": f"{box.x:g}", "y": f"{box.y:g}", "width": f"{box.width:g}", "height": f"{box.height:g}", "rx": "5"}
    ET.SubElement(group, "rect", shape | {"fill": tint.paper, "stroke": tint.edge, "class": "face"})
    sign = f"{signs.SYMBOLS[box.state]} " if box.state is not None else ""
    detail = box.detail
    size = min(11.0, (box.width - 6) / (0.66 * max(_shapes.letters_of(sign + box.label), 1)))
    name = {"font-size": f"{size:.2f}", "font-weight": "bold", "fill": tint.ink}
    _write(group, f"{sign}{box.label}", (box.middle, box.y + (16 if detail else 23)), name)
    if detail:
        _write(group, detail, (box.middle, box.y + 30), {"font-size": "9", "fill": tint.ink})


def _badge(root: ET.Element, badge: _shapes.Badge) -> None:
    tint = signs.TINTS[badge.state]
    group = _group(root, badge.state, "badge")
    shape = {
        "x": f"{badge.x:g}",
        "y": f"{badge.y:g}",
        "width": f"{badge.width:g}",
        "height": f"{_shapes.BADGE_HEIGHT:g}",
    }
    ET.SubElement(group, "rect", shape | {"rx": "8", "fill": tint.paper, "stroke": tint.edge, "class": "face"})
    _write(group, badge.text, (badge.x + badge.width / 2, badge.y + 11.6), {"font-size": "10", "fill": tint.ink})


def _write(group: ET.Element, text: str, at: tuple[float, float], how: dict[str, str]) -> None:
    attributes = {"x": f"{at[0]:g}", "y": f"{at[1]:g}", "text-anchor": "middle", **how}
    ET.SubElement(group, "text", attributes).text = clean(text)
