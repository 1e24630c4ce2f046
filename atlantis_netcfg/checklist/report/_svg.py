"""The drawing of a site as SVG: with a title, with all of it in words, and without anything from outside.

Colours stand at each shape for whoever shows the file alone; a page may replace them by its own for the same classes.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.report._colours import TINTS, css_class
from atlantis_netcfg.checklist.report._layout import layout, states
from atlantis_netcfg.checklist.report._shapes import BADGE_HEIGHT, letters_of
from atlantis_netcfg.checklist.report._states import SYMBOLS
from atlantis_netcfg.report._xml import clean

if TYPE_CHECKING:
    from atlantis_netcfg.checklist.report._shapes import Badge, Box, Wire
    from atlantis_netcfg.checklist.report._states import State
    from atlantis_netcfg.checklist.report.document import Document

__all__ = ["described", "drawing_svg"]

_KINDS = {
    "cpe": "Wi-Fi bridge",
    "lte_router": "4G router",
    "satellite_terminal": "satellite",
    "vpn_server": "VPN server",
    "control_centre": "control centre",
    "site": "",
    "vehicle": "",
}


def drawing_svg(document: Document) -> str:
    """The drawing of a document, to stand alone or inside a page."""
    shapes = layout(document)
    root = ET.Element(
        "svg",
        {
            "xmlns": "http://www.w3.org/2000/svg",
            "viewBox": f"0 0 {shapes.width:g} {shapes.height:g}",
            "role": "img",
            "aria-labelledby": "drawing-title drawing-words",
            "class": "drawing",
            "font-family": "system-ui, 'DejaVu Sans', sans-serif",
        },
    )
    ET.SubElement(root, "title", id="drawing-title").text = clean(f"Drawing of {document.title}")
    ET.SubElement(root, "desc", id="drawing-words").text = clean("\n".join(described(document)))
    for wire in shapes.wires:
        _wire(root, wire)
    for box in shapes.boxes:
        _box(root, box)
    for badge in shapes.badges:
        _badge(root, badge)
    return ET.tostring(root, encoding="unicode", short_empty_elements=True)


def described(document: Document) -> list[str]:
    """What the drawing shows, in sentences."""
    nodes, links = states(document)
    labels = {node.key: node.label for node in document.drawing.nodes}
    result = []
    for node in document.drawing.nodes:
        found = nodes[node.key]
        result.append(f"{node.label}{_beside(node.detail)}{_beside(str(found) if found is not None else '')}.")
    for link, found in links:
        ends = f"{labels.get(link.a, link.a)} to {labels.get(link.b, link.b)}"
        result.append(f"{ends}: {link.label}{_beside(str(found) if found is not None else '')}.")
    return result or ["Nothing is declared."]


def _beside(words: str) -> str:
    return f", {words}" if words else ""


def _group(root: ET.Element, state: State | None, kind: str) -> ET.Element:
    return ET.SubElement(root, "g", {"class": f"{kind} {css_class(state)}"})


def _wire(root: ET.Element, wire: Wire) -> None:
    points = " ".join(f"{x:g},{y:g}" for x, y in wire.points)
    tint = TINTS[wire.state]
    given = {"points": points, "fill": "none", "stroke": tint.edge, "stroke-width": "1.6", "class": "line"}
    if wire.dashed:
        given["stroke-dasharray"] = "4 3"
    ET.SubElement(_group(root, wire.state, "wire"), "polyline", given)


def _box(root: ET.Element, box: Box) -> None:
    tint = TINTS[box.state]
    group = _group(root, box.state, "box")
    shape = {"x": f"{box.x:g}", "y": f"{box.y:g}", "width": f"{box.width:g}", "height": f"{box.height:g}", "rx": "5"}
    ET.SubElement(group, "rect", shape | {"fill": tint.paper, "stroke": tint.edge, "class": "face"})
    sign = f"{SYMBOLS[box.state]} " if box.state is not None else ""
    detail = box.detail or _KINDS.get(box.kind, box.kind)
    size = min(11.0, (box.width - 6) / (0.66 * max(letters_of(sign + box.label), 1)))
    name = {"font-size": f"{size:.2f}", "font-weight": "bold", "fill": tint.ink}
    _write(group, f"{sign}{box.label}", (box.middle, box.y + (16 if detail else 23)), name)
    if detail:
        _write(group, detail, (box.middle, box.y + 30), {"font-size": "9", "fill": tint.ink})


def _badge(root: ET.Element, badge: Badge) -> None:
    tint = TINTS[badge.state]
    group = _group(root, badge.state, "badge")
    shape = {"x": f"{badge.x:g}", "y": f"{badge.y:g}", "width": f"{badge.width:g}", "height": f"{BADGE_HEIGHT:g}"}
    ET.SubElement(group, "rect", shape | {"rx": "8", "fill": tint.paper, "stroke": tint.edge, "class": "face"})
    _write(group, badge.text, (badge.x + badge.width / 2, badge.y + 11.6), {"font-size": "10", "fill": tint.ink})


def _write(group: ET.Element, text: str, at: tuple[float, float], how: dict[str, str]) -> None:
    given = {"x": f"{at[0]:g}", "y": f"{at[1]:g}", "text-anchor": "middle", **how}
    ET.SubElement(group, "text", given).text = clean(text)
