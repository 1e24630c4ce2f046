"""Where things stand in the drawing, what it says in words, and that it is the site of the declaration."""

import xml.etree.ElementTree as ET
from dataclasses import replace
from functools import cache
from itertools import combinations
from pathlib import Path

import checklist_example as made
import pytest
from checklist_strategies import DRAWINGS, hostile
from hypothesis import given, settings

from atlantis_netcfg.checklist import Checklist, plan
from atlantis_netcfg.checklist.plan import drawing
from atlantis_netcfg.checklist.report import Document, Drawing, DrawnLink, DrawnNode, drawing_svg
from atlantis_netcfg.checklist.report._shapes import ASCII, Badge, DrawnBox
from atlantis_netcfg.checklist.report._svg import describe_drawing, layout
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.runs.report.signs import DARK, SYMBOLS, TINTS, ShownState, Tint

INVENTORY = Path(__file__).parents[4] / "inventory"
SVG = "{http://www.w3.org/2000/svg}"


@cache
def declaration() -> Inventory:
    return load(INVENTORY)


@cache
def listed(site: str) -> Checklist:
    return plan(declaration(), site)


def drawn(site: str) -> Document:
    checklist = listed(site)
    items = tuple(entry.item for entry in checklist.entries)
    return made.green(items=items, rows=checklist.rows, drawing=drawing(declaration(), checklist))


def apart(one: DrawnBox | Badge, other: DrawnBox | Badge, heights: tuple[float, float]) -> bool:
    return (
        one.x + one.width <= other.x
        or other.x + other.width <= one.x
        or one.y + heights[0] <= other.y
        or other.y + heights[1] <= one.y
    )


SITES = ["coastal", "te4sea", "scc"]


@pytest.mark.parametrize("wide", [False, True], ids=["narrow", "wide"])
@pytest.mark.parametrize("site", SITES)
def test_no_shapes_overlap(site: str, wide: bool) -> None:  # noqa: FBT001 - two layouts
    shapes = layout(drawn(site), wide=wide)
    sized = [(box, box.height) for box in shapes.boxes] + [(badge, 16.0) for badge in shapes.badges]
    for (one, high), (other, low) in combinations(sized, 2):
        assert apart(one, other, (high, low)), (one, other)
    assert all(one.x >= 0 and one.x + one.width <= shapes.width and one.y >= 0 for one, _ in sized)
    assert all(one.y + height <= shapes.height for one, height in sized)


def _spoken_of(made_of: Drawing) -> list[tuple[str, ...]]:
    return [node.items for node in made_of.nodes] + [link.items for link in made_of.links]


@pytest.mark.parametrize("site", SITES)
def test_every_item_of_the_site_is_in_its_drawing(site: str) -> None:
    made_of = drawn(site).drawing
    told = {item for items in _spoken_of(made_of) for item in items}
    assert told == {entry.item.id for entry in listed(site).entries}


@pytest.mark.parametrize("site", SITES)
def test_every_link_has_its_ends(site: str) -> None:
    made_of = drawn(site).drawing
    keys = [node.key for node in made_of.nodes]
    assert len(keys) == len(set(keys))
    assert {end for link in made_of.links for end in (link.a, link.b)} == set(keys)


def test_drawing_matches_the_inventory() -> None:
    made_of = drawn("coastal").drawing
    assert [(node.key, node.kind) for node in made_of.nodes] == [
        ("scc-vpn", "vpn_server"),
        ("partners", "partner"),
        ("scc", "site"),
        ("coastal-router", "router"),
        ("coastal-cpe", "cpe"),
        ("coastal-4g", "lte_router"),
        ("coastal-sat", "satellite_terminal"),
        ("coastal-gateway", "gateway"),
        *((key, "vehicle") for key in made.NAMES),
    ]
    ends = {(link.a, link.b, link.label) for link in made_of.links}
    assert ends >= {
        ("coastal-cpe", "scc", "Wi-Fi"),
        ("coastal-4g", "scc", "4G"),
        ("coastal-sat", "scc", "Satellite"),
        ("coastal-router", "coastal-sat", "ether3, PoE"),
        ("coastal-router", "coastal-gateway", "LAN"),
        ("coastal-router", "scc-vpn", "VPN"),
        ("sparus", "coastal-gateway", "Wi-Fi"),
        ("zarco", "coastal-router", "Wi-Fi"),
        ("stork", "coastal-gateway", "RC RF"),
        ("eca-rov", "coastal-gateway", "USBL"),
    }
    assert drawing(declaration(), listed("coastal")) == made_of


GONE = [
    (),
    ("coastal-router",),
    ("coastal-gateway",),
    ("coastal-cpe", "coastal-4g"),
    ("coastal-router", "coastal-gateway"),
]


@pytest.mark.parametrize("gone", GONE, ids=lambda gone: "+".join(gone) or "none")
def test_site_without_some_devices_is_still_drawn(gone: tuple[str, ...]) -> None:
    hosts = {name: host for name, host in declaration().hosts.items() if name not in gone}
    smaller = replace(declaration(), hosts=hosts)
    checklist = plan(smaller, "coastal")
    made_of = drawing(smaller, checklist)
    keys = {node.key for node in made_of.nodes}
    assert keys.isdisjoint(gone)
    assert {link.a for link in made_of.links} >= set(made.NAMES)
    assert {end for link in made_of.links for end in (link.a, link.b)} <= keys
    assert layout(made.green(items=(), drawing=made_of)).height > 0


def test_wide_layout_has_the_same_content() -> None:
    narrow, wide = layout(made.example()), layout(made.example(), wide=True)
    assert wide.height / wide.width < 0.5 < narrow.height / narrow.width
    assert {(box.label, box.state) for box in wide.boxes} == {(box.label, box.state) for box in narrow.boxes}
    assert sorted(badge.text for badge in wide.badges) == sorted(badge.text for badge in narrow.badges)


def test_drawing_is_described_in_text() -> None:
    told = describe_drawing(made.example())
    assert "Control centre." in told
    assert "Sparus, coastal-gateway: Wi-Fi, FAIL." in told
    assert "coastal-router, scc-vpn: VPN, PASS." in told
    assert describe_drawing(made.empty()) == ["The inventory has nothing here."]


def test_the_worst_item_gives_colour_and_sign() -> None:
    node = DrawnNode(key="r", label="router", kind="router", items=("sparus/gps", "sparus/wifi", "nobody"))
    other = DrawnNode(key="o", label="other", kind="gateway")
    link = DrawnLink(a="r", b="o", label="LAN", kind="ethernet", items=("sparus/gps",))
    document = made.example(drawing=Drawing(nodes=(node, other), links=(link,)))
    root = ET.fromstring(drawing_svg(document))  # noqa: S314 - ours
    groups = [(group.get("class"), "".join(group.itertext())) for group in root.iter(f"{SVG}g")]
    assert groups == [
        ("wire s-pass", ""),
        ("box s-fail", "✗ routerrouter"),
        ("box s-none", "othergateway"),
        ("badge s-pass", "✓ LAN"),
    ]


@pytest.mark.parametrize("document", [made.example(), made.empty(), hostile()], ids=["example", "empty", "hostile"])
def test_svg_is_well_formed_and_has_no_external_references(document: Document) -> None:
    text = drawing_svg(document)
    root = ET.fromstring(text)  # noqa: S314 - ours
    assert {one.tag.removeprefix(SVG) for one in root.iter()} <= {
        "svg",
        "title",
        "desc",
        "g",
        "rect",
        "polyline",
        "text",
    }
    assert {name for one in root.iter() for name in one.keys()}.isdisjoint({"href", "style", "onload"})  # noqa: SIM118
    assert text == drawing_svg(document)


@given(DRAWINGS)
@settings(max_examples=60)
def test_any_drawing_can_be_drawn(made_of: Drawing) -> None:
    document = made.example(drawing=made_of)
    shapes = layout(document)
    assert len(shapes.boxes) == len({node.key for node in made_of.nodes})
    assert all(one.y + 16 <= shapes.height for one in shapes.badges)
    ET.fromstring(drawing_svg(document))  # noqa: S314 - ours


# Contrast by the formula of WCAG 2.2, and that no colour says what a sign does not.


PAGES = {"light": (TINTS, "#ffffff"), "dark": (DARK, "#12181f")}
CASES = [
    pytest.param(tint, page, id=f"{name}-{state}")
    for name, (all_, page) in PAGES.items()
    for state, tint in all_.items()
]


def luminance(colour: str) -> float:
    parts = [part / 255 for part in bytes.fromhex(colour[1:])]
    red, green, blue = (part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def contrast(one: str, other: str) -> float:
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize(("tint", "page"), CASES)
def test_contrast_of_text_and_edges_is_sufficient(tint: Tint, page: str) -> None:
    assert contrast(tint.ink, tint.paper) >= 4.5
    assert contrast(tint.edge, page) >= 3


@pytest.mark.parametrize("signs", [SYMBOLS, ASCII], ids=["page", "console"])
def test_every_state_has_a_distinct_sign(signs: dict[ShownState, str]) -> None:
    assert signs.keys() == set(ShownState)
    assert len(set(signs.values())) == len(ShownState)


def test_every_state_has_colours() -> None:
    assert TINTS.keys() == DARK.keys() == {None, *ShownState}
