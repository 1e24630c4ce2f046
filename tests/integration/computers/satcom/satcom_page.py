"""docs/engineers/satcom.md and its pictures, made of what a campaign has measured and of nothing else."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import TYPE_CHECKING

from atlantis_netcfg.links.qualify.figures import percentile
from atlantis_netcfg.links.qualify.grids import SHAPE_UNKNOWN

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from satcom_campaign import Campaign, DdsRow

    from atlantis_netcfg.emulator.udp_link import LinkShape
    from atlantis_netcfg.links.qualify.grids import RateRow

ROUND_TRIPS, RECEIVED = "satcom-round-trips.svg", "satcom-received.svg"
_WIDTH, _HEIGHT, _LEFT, _BOTTOM, _TOP, _RIGHT = 640, 360, 60, 50, 40, 30
_COLOURS = ("#1f5fa8", "#b3451c")
Series = tuple[str, list[tuple[float, float]]]


_HEAD = """\
# Satellite tests over an emulated link

<!-- Written by `make satcom`: run it again in place of editing. -->

**Everything on this page is emulated.** No satellite carried a byte of it. Real are OpenVPN with the product's own
files, Cyclone DDS with the profile of `provision robot dds`, and test packets of `provision measure link`; the link is
a relay. Measured on {day} by `make satcom`, on a computer with other work.
"""
_IMAGES = """\
Random octets, as many as a JPEG of that size and quality may have. Nothing is sent again: an image of which one
fragment is lost is lost, so where packets are lost, large images seldom arrive whole, at any rate.
"""
_AGAIN = """\
`make satcom ARGS='--cell-s 60 --write'` needs root and an hour and a half; without `--write` it prints this page. With
`--profile FOLDER` the link is a run that `provision measure link` measured,
[replayed](../measuring.md#rehearse-over-a-measured-link). CI sends one size at one rate of each table
(`tests/integration/computers/satcom`).
"""
_ASSUMED = """\
Assumed of a Certus link, not measured on one. Not in it: gaps (real ones last up to 70 s), loss in bursts, a rate that
changes, and the satellite's own priorities.
"""


def page(done: Campaign) -> list[str]:
    """Give the page, line by line."""
    return [
        *_HEAD.format(day=f"{done.at:%Y-%m-%d}").splitlines(),
        "",
        *_assumptions(done),
        "",
        "## The round trip without load",
        "",
        *_idle(done),
        "",
        f"![Share of round trips up to a length, through the emulated link](../pictures/{ROUND_TRIPS})",
        "",
        "## Small telemetry (Table 33)",
        "",
        SHAPE_UNKNOWN,
        f"Each cell lasted {done.cell_s:g} s, or five messages where that takes longer. Of loss, so few say little:",
        "where some of fewer than a hundred were lost, and it does not fail, the verdict is INCONCLUSIVE.",
        "",
        *_packets(done, "telemetry"),
        "",
        *_samples(done, "telemetry"),
        "",
        "## Images (Table 34)",
        "",
        *_IMAGES.splitlines(),
        "",
        *_packets(done, "image"),
        "",
        *_samples(done, "image"),
        "",
        f"![Share of messages received, by the rate offered, through the emulated link](../pictures/{RECEIVED})",
        "",
        "## How to make it again",
        "",
        *_AGAIN.splitlines(),
    ]


def write_page(done: Campaign, docs: Path | None) -> list[str]:
    """Write the page and its pictures below `docs`; None: only give the page."""
    lines = page(done)
    if docs is not None:
        (docs / "engineers" / "satcom.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
        ordered = sorted(done.round_trips_s)
        ecdf = [(value * 1000, 100 * (n + 1) / len(ordered)) for n, value in enumerate(ordered)]
        pictures = docs / "pictures"
        packets = [("test packets", ecdf)]
        _chart(pictures / ROUND_TRIPS, "Round trip, no load", ("ms", "% of packets"), packets, joined=True)
        series = [*_offered(done.packets, "packets"), *_offered_samples(done.dds)]
        axes = ("kbit/s offered, without headers", "% received")
        _chart(pictures / RECEIVED, "Messages received", axes, series, joined=False)
    return lines


def _assumptions(done: Campaign) -> list[str]:
    if done.link:
        return [f"The link is run `{done.link}`, replayed ([how](../measuring.md#rehearse-over-a-measured-link))."]
    up, down = done.shapes
    return [
        "| Direction | Rate | Delay | Jitter (half-normal) | Loss | Queue |",
        "|---|---|---|---|---|---|",
        *(f"| {name} | {_shape(shape)} |" for name, shape in (("up", up), ("down", down))),
        "",
        *_ASSUMED.splitlines(),
    ]


def _shape(shape: LinkShape) -> str:
    return (
        f"{(shape.rate_bps or 0) / 1000:g} kbit/s | {shape.delay_s * 1000:g} ms | {shape.jitter_s * 1000:g} ms "
        f"| {shape.loss * 100:g} % | {shape.queue_bytes / 1000:g} kB"
    )


def _idle(done: Campaign) -> list[str]:
    rtt, loss = done.idle.rtt, done.idle.loss
    if rtt is None:
        return ["Nothing was answered."]
    ways = "" if loss.up is None else f": {loss.up} up, {loss.down} down"
    return [
        "| packets | min | p50 | p90 | p95 | p99 | max | lost |",
        "|---|---|---|---|---|---|---|---|",
        f"| {loss.sent} | "
        + " | ".join(f"{value * 1000:.0f} ms" for value in (rtt.min, rtt.p50, rtt.p90, rtt.p95, rtt.p99, rtt.max))
        + f" | {loss.lost}{ways} |",
        "",
        f"In all {done.up_bytes / 1e6:.1f} MB left by the gateway's port, and {done.down_bytes / 1e6:.1f} MB came.",
    ]


def _packets(done: Campaign, kind: str) -> Iterator[str]:
    """Yield the table of test packets; telemetry has a loss each way, images only one."""
    small = kind == "telemetry"
    yield f"As test packets; {'round trip' if small else 'from the first packet to the word that all of it came'}:"
    yield ""
    yield "| Size | Octets | Hz | Sent | Received | Lost up | Lost down | p50 | p95 | Verdict |"
    yield "|---|---|---|---|---|---|---|---|---|---|"
    for row in done.packets:
        if row.label.endswith(" B") == small:
            numbers = (row.octets, f"{row.rate_hz:g}", row.sent, row.received, _percent(row.loss_up))
            rest = (_percent(row.loss_down), _seconds(row.p50_s), _seconds(row.p95_s))
            yield f"| {row.label} | {' | '.join(map(str, (*numbers, *rest)))} | {_verdict(row)} |"


def _verdict(row: RateRow) -> str:
    """Say what the grid says."""
    return row.verdict.value if row.reason == "sustained" else f"{row.verdict.value} ({row.reason})"


def _samples(done: Campaign, kind: str) -> Iterator[str]:
    yield "As DDS samples, best effort; the delay is one way:"
    yield ""
    yield "| Size | Octets | Hz | Sent | Received | Lost | p50 | p95 |"
    yield "|---|---|---|---|---|---|---|---|"
    for row in done.dds:
        if row.cell.kind == kind:
            label = f"{row.cell.label} B" if kind == "telemetry" else row.cell.label
            ordered = sorted(row.delays_s)
            p50, p95 = (percentile(ordered, share) if ordered else None for share in (0.5, 0.95))
            lost = _percent(1 - len(ordered) / row.sent)
            yield (
                f"| {label} | {row.cell.octets} | {row.cell.rate_hz:g} | {row.sent} | {len(ordered)} | {lost} "
                f"| {_seconds(p50)} | {_seconds(p95)} |"
            )


def _percent(share: float | None) -> str:
    return "not known" if share is None else f"{100 * share:.1f} %"


def _seconds(value: float | None) -> str:
    return "none" if value is None else f"{value:.2f} s"


def _offered(rows: Sequence[RateRow], what: str) -> list[Series]:
    points = sorted((row.octets * row.rate_hz * 8 / 1000, 100 * row.received / row.sent) for row in rows if row.sent)
    return [(f"test {what}", points)]


def _offered_samples(rows: Sequence[DdsRow]) -> list[Series]:
    points = [(row.cell.octets * row.cell.rate_hz * 8 / 1000, 100 * len(row.delays_s) / row.sent) for row in rows]
    return [("DDS samples", sorted(points))]


def _chart(path: Path, title: str, axes: tuple[str, str], series: Sequence[Series], *, joined: bool) -> None:
    """Draw series over a common ground; the picture says itself that the link was emulated."""
    across, along = axes
    every = [point for _, points in series for point in points]
    low, high = min(x for x, _ in every), max(x for x, _ in every)
    low = 0.0 if low < high / 2 else low
    root = ET.Element(
        "svg", {"xmlns": "http://www.w3.org/2000/svg", "viewBox": f"0 0 {_WIDTH} {_HEIGHT}", "role": "img"}
    )
    ET.SubElement(root, "title").text = f"{title} (emulated link)"
    ET.SubElement(root, "rect", {"width": str(_WIDTH), "height": str(_HEIGHT), "fill": "#ffffff"})
    _text(root, _LEFT, 22, f"{title}: EMULATED link", anchor="start")

    def place(x: float, y: float) -> tuple[float, float]:
        right = _LEFT + (x - low) / ((high - low) or 1) * (_WIDTH - _LEFT - _RIGHT)
        return right, _HEIGHT - _BOTTOM - y / 100 * (_HEIGHT - _BOTTOM - _TOP)

    for percent in range(0, 101, 25):
        (left, height), (right, _) = place(low, percent), place(high, percent)
        _line(root, [(left, height), (right, height)], "#cccccc")
        _text(root, left - 8, height + 4, f"{percent}", anchor="end")
    for step in range(5):
        value = low + (high - low) * step / 4
        _text(root, place(value, 0)[0], _HEIGHT - _BOTTOM + 18, f"{value:.0f}")
    _text(root, _WIDTH / 2, _HEIGHT - 10, across)
    _text(root, _WIDTH - _RIGHT, 22, along, anchor="end")
    for number, (name, points) in enumerate(series):
        legend = _HEIGHT / 2 + 20 * number
        spots = [(_WIDTH - 150.0, legend), *(place(*point) for point in points)]
        if joined:
            _line(root, spots[1:], _COLOURS[number], 2)
        for x, y in spots[:1] if joined else spots:
            _spot(root, x, y, number)
        _text(root, _WIDTH - 138, legend + 4, name, anchor="start")
    ET.indent(root, " ")
    path.write_text(ET.tostring(root, encoding="unicode") + "\n", encoding="utf-8")


def _text(root: ET.Element, x: float, y: float, text: str, *, anchor: str = "middle") -> None:
    style = {"font-family": "sans-serif", "font-size": "12", "text-anchor": anchor, "fill": "#222222"}
    ET.SubElement(root, "text", {"x": f"{x:.1f}", "y": f"{y:.1f}", **style}).text = text


def _line(root: ET.Element, points: Sequence[tuple[float, float]], colour: str, width: int = 1) -> None:
    style = {"fill": "none", "stroke": colour, "stroke-width": str(width)}
    ET.SubElement(root, "polyline", {"points": " ".join(f"{x:.1f},{y:.1f}" for x, y in points), **style})


def _spot(root: ET.Element, x: float, y: float, number: int) -> None:
    """Draw a disc for the first series, an open square for the second."""
    if number:
        place = {"x": f"{x - 4:.1f}", "y": f"{y - 4:.1f}", "width": "8", "height": "8"}
        ET.SubElement(root, "rect", {**place, "fill": "none", "stroke": _COLOURS[number], "stroke-width": "1.5"})
    else:
        ET.SubElement(root, "circle", {"cx": f"{x:.1f}", "cy": f"{y:.1f}", "r": "3.5", "fill": _COLOURS[number]})
