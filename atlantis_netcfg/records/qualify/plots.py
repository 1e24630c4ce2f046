"""Plots of a measured link as SVG: round trips over time and by share, gaps, loss each way, rates and sizes.

Each is self-contained: title, description as text, axes with units, and a notice if the run was over an emulated link.
Shapes and dashes repeat what colours show. Everything is set by attributes, so that a page that allows no inline style
shows it, and fpdf2 prints the same drawing. pygal was tried and rejected: its charts contain a script and a style
sheet, which such a page refuses and fpdf2 does not read; leather has neither descriptions, nor types, nor a difference
of series other than colour.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.links.qualify.compare import loss_shares
from atlantis_netcfg.links.qualify.figures import round_trips
from atlantis_netcfg.runs.report import signs
from atlantis_netcfg.runs.report.drift import clean

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from atlantis_netcfg.links.qualify.figures import TrainFigures
    from atlantis_netcfg.links.qualify.record import MeasuredRate, QualifyRecord
    from atlantis_netcfg.links.qualify.samples import Sample

WIDTH, HEIGHT = 560.0, 250.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 58.0, 16.0, 46.0, 40.0
_INK, _FAINT, _RULE, _PAPER = "#1c2730", "#4b5863", "#d5dbe0", "#ffffff"
_FIRST, _SECOND, _LOSS = "#0b4470", "#a85400", "#8c0c12"
_DASHES: Final = "5 3"
_LOG_FROM: Final = 20.0
"""Minimum ratio of largest to smallest value for a logarithmic axis."""
_STEPS: Final = (1.0, 2.0, 5.0, 10.0)
_STEPS_LOG: Final = (1.0, 2.0, 5.0)
_TICKS: Final = 6
_DOT: Final = 2.0
"""Height of the mark for a single value in its column."""
FAMILY_ON_PAGE: Final = "system-ui, 'DejaVu Sans', sans-serif"


@dataclass(frozen=True, slots=True)
class Plot:
    """A drawing; `words` describes its content in sentences."""

    name: str
    title: str
    words: str
    root: ET.Element
    height: float
    width: float = WIDTH

    def svg(self, family: str = FAMILY_ON_PAGE, *, has_description: bool = True) -> str:
        """Return the SVG text; `has_description`: with title and description, which fpdf2 does not support."""
        root = ET.fromstring(ET.tostring(self.root))  # noqa: S314 - a copy of what was made here
        root.set("font-family", family)
        for child in [*root]:
            if not has_description and child.tag.rpartition("}")[2] in {"title", "desc"}:
                root.remove(child)
        ET.register_namespace("", "http://www.w3.org/2000/svg")
        return ET.tostring(root, encoding="unicode", short_empty_elements=True)


def plots(record: QualifyRecord, samples: Sequence[Sample]) -> list[Plot]:
    """Draw what the run has measured; other plots are left out."""
    result: list[Plot] = []
    trains = (("idle", "without load", record.idle), ("loaded", "under load", record.under_load))
    for stream, words, train in trains:
        points = round_trips(samples, stream)
        if train is not None and points:
            result.append(_over_time(record, f"{stream}-time", words, points))
    series = [
        (words, [rtt for _, rtt in round_trips(samples, stream) if rtt is not None]) for stream, words, _ in trains
    ]
    if any(values for _, values in series):
        result.append(_shares(record, [(words, sorted(values)) for words, values in series if values]))
    if record.idle is not None:
        result.append(_gaps(record, record.idle))
        result.append(_losses(record, [(words, train) for _, words, train in trains if train is not None]))
    for name, title, rows in (
        ("telemetry", "Small telemetry: sizes and rates", record.telemetry),
        ("images", "Images: sizes and rates", record.images),
    ):
        if rows:
            result.append(_grid(record, name, title, rows))
    return result


@dataclass(slots=True)
class _Axis:
    """A scale from values to the drawing; logarithmic if the values span a large range."""

    low: float
    high: float
    begin: float
    end: float
    log: bool = False
    ticks: list[float] = field(default_factory=list)

    @classmethod
    def build(  # noqa: PLR0913 - what a scale is made of
        cls, low: float, high: float, begin: float, end: float, *, may_be_log: bool = False, whole: bool = False
    ) -> _Axis:
        if may_be_log and low > 0 and high / low > _LOG_FROM:
            decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
            every = [step * 10.0**decade for decade in decades for step in _STEPS_LOG]
            low = max((tick for tick in every if tick <= low), default=low)
            high = min((tick for tick in every if tick >= high), default=high)
            return cls(low, high, begin, end, True, [tick for tick in every if low <= tick <= high])
        step = max(_nice((high or 1.0) / _TICKS), 1.0 if whole else 0.0)
        count = max(1, math.ceil(round((high or 1.0) / step, 6)))
        return cls(0.0, count * step, begin, end, False, [step * number for number in range(count + 1)])

    def at(self, value: float) -> float:
        """Return the position of a value; values below the axis are at its start."""
        if self.log:
            share = math.log(max(value, self.low) / self.low) / math.log(self.high / self.low)
        else:
            share = (value - self.low) / (self.high - self.low)
        return self.begin + share * (self.end - self.begin)


def _nice(step: float) -> float:
    """Round a step up to the next of 1, 2, 5, 10 …."""
    power = 10.0 ** math.floor(math.log10(step))
    return next(power * nice for nice in _STEPS if power * nice >= step * 0.999)


class _Chart:
    """A drawing with a title and its elements."""

    def __init__(self, record: QualifyRecord, title: str, height: float = HEIGHT) -> None:
        self.height = height
        self.title = translate(title)
        self.emulated = translate("EMULATED LINK") if record.run.emulated else ""
        self.root = ET.Element(
            "svg",
            {"xmlns": "http://www.w3.org/2000/svg", "viewBox": f"0 0 {WIDTH:g} {height:g}", "role": "img"},
        )
        self.root.append(ET.Element("title"))
        self.root.append(ET.Element("desc"))
        self.shape("rect", x=0.5, y=0.5, width=WIDTH - 1, height=height - 1, fill=_PAPER, stroke=_RULE)
        self.text(10, 18, self.title, size=12, anchor="start", weight="bold")
        if self.emulated:
            self.text(WIDTH - 10, 18, self.emulated, size=11, anchor="end", weight="bold", fill=_LOSS)

    def shape(self, tag: str, **attributes: str | float) -> ET.Element:
        svg_attributes = {
            name.replace("_", "-"): value if isinstance(value, str) else f"{value:.2f}".rstrip("0").rstrip(".")
            for name, value in attributes.items()
        }
        return ET.SubElement(self.root, tag, svg_attributes)

    def text(  # noqa: PLR0913 - what a text is made of
        self,
        x: float,
        y: float,
        words: str,
        *,
        size: float = 10,
        anchor: str = "middle",
        weight: str = "normal",
        fill: str = _INK,
    ) -> None:
        element = self.shape(
            "text", x=x, y=y, font_size=size, text_anchor=anchor, font_weight=weight, fill=fill, stroke="none"
        )
        element.text = clean(words)

    def path(self, steps: Iterable[str], colour: str, *, dashes: str = "", width: float = 1.6) -> None:
        data = "".join(steps)
        if data:
            more = {"stroke_dasharray": dashes} if dashes else {}
            self.shape("path", d=data, fill="none", stroke=colour, stroke_width=width, **more)

    def axes(self, x: _Axis, y: _Axis, x_title: str, y_title: str, y_label: str = "{:g}") -> None:
        for tick in y.ticks:
            at = y.at(tick)
            self.shape("line", x1=x.begin, y1=at, x2=x.end, y2=at, stroke=_RULE, stroke_width=0.8)
            self.text(x.begin - 5, at + 3.5, y_label.format(round(tick, 9)), anchor="end", fill=_FAINT)
        for tick in x.ticks:
            at = x.at(tick)
            self.shape("line", x1=at, y1=y.begin, x2=at, y2=y.begin + 4, stroke=_FAINT, stroke_width=0.8)
            self.text(at, y.begin + 15, f"{round(tick, 9):g}", fill=_FAINT)
        self.shape("line", x1=x.begin, y1=y.begin, x2=x.end, y2=y.begin, stroke=_FAINT, stroke_width=0.8)
        self.text((x.begin + x.end) / 2, self.height - 8, translate(x_title), fill=_FAINT)
        self.text(10, 34, translate(y_title), anchor="start", fill=_FAINT)

    def plot(self, name: str, words: Sequence[str]) -> Plot:
        sentences = " ".join([*([f"{self.emulated}."] if self.emulated else []), *map(translate, words)])
        self.root[0].text, self.root[1].text = clean(self.title), clean(sentences)
        return Plot(name, self.title, sentences, self.root, self.height)


def _frame(height: float = HEIGHT) -> tuple[float, float, float, float]:
    """Return left, right, bottom and top of the plot area."""
    return _LEFT, WIDTH - _RIGHT, height - _BOTTOM, _TOP


def _over_time(record: QualifyRecord, name: str, load: str, points: Sequence[tuple[float, float | None]]) -> Plot:
    """Draw round trips over time; each column spans the minimum and maximum of its time, so that no peak is lost."""
    chart = _Chart(record, msg(f"Round trips over time, {arg(load)}"))
    left, right, bottom, top = _frame()
    answered_points = [(at, rtt) for at, rtt in points if rtt is not None]
    silent = [at for at, rtt in points if rtt is None]
    x = _Axis.build(0, max(points[-1][0], 1.0), left, right)
    y = _Axis.build(0, max((rtt for _, rtt in answered_points), default=1.0), bottom, top + 8)
    chart.axes(x, y, "seconds since the first packet", "seconds")
    columns: dict[int, tuple[float, float]] = {}
    for at, rtt in answered_points:
        low, high = columns.get(round(x.at(at)), (rtt, rtt))
        columns[round(x.at(at))] = min(low, rtt), max(high, rtt)
    chart.path((_column(place, y.at(low), y.at(high)) for place, (low, high) in columns.items()), _FIRST)
    ticks = dict.fromkeys(round(x.at(at)) for at in silent)
    chart.path((f"M{place},{top}V{top + 6}" for place in ticks), _LOSS)
    words = msg(f"{arg(len(answered_points))} of {arg(len(points))} packets got a response.")
    if silent:
        chart.text(right, 34, translate(f"no response: {arg(len(silent))}, ticks at the top"), anchor="end", fill=_LOSS)
    return chart.plot(name, [words, *_percentile_words(sorted(rtt for _, rtt in answered_points))])


def _column(place: int, low: float, high: float) -> str:
    middle, half = (low + high) / 2, max(abs(low - high), _DOT) / 2
    return f"M{place},{middle - half:.1f}V{middle + half:.1f}"


def _percentile_words(sorted_values: Sequence[float]) -> list[str]:
    if not sorted_values:
        return []
    return [msg(f"Shortest round trip {arg(sorted_values[0]):.3f} s, longest {arg(sorted_values[-1]):.3f} s.")]


def _shares(record: QualifyRecord, series: Sequence[tuple[str, Sequence[float]]]) -> Plot:
    """Draw the empirical distribution: the share of round trips up to each value."""
    chart = _Chart(record, "Round trips: cumulative share")
    left, right, bottom, top = _frame()
    low, high = min(values[0] for _, values in series), max(values[-1] for _, values in series)
    x = _Axis.build(low, high, left, right, may_be_log=True)
    y = _Axis(0, 100, bottom, top + 8, ticks=[0, 25, 50, 75, 90, 100])
    chart.axes(x, y, "seconds", "%")
    words = []
    for number, (load, values) in enumerate(series):
        colour, dashes = ((_FIRST, ""), (_SECOND, _DASHES))[number % 2]
        chart.path(_steps(values, x, y), colour, dashes=dashes)
        place = left + 12 + number * 150
        chart.path([f"M{place},30h24"], colour, dashes=dashes)
        chart.text(place + 30, 34, translate(load), anchor="start", fill=colour)
        middle, most = values[math.ceil(0.5 * len(values)) - 1], values[math.ceil(0.95 * len(values)) - 1]
        words.append(
            msg(
                f"{arg(load)}: half of {arg(len(values))} round trips within {arg(middle):.3f} s, 95 % within "
                f"{arg(most):.3f} s."
            )
        )
    return chart.plot("shares", words)


def _steps(sorted_values: Sequence[float], x: _Axis, y: _Axis) -> Iterable[str]:
    """Yield a step curve with one step per column of the drawing."""
    yield f"M{x.at(sorted_values[0]):.1f},{y.at(0):.1f}"
    last: dict[int, int] = {}
    for number, value in enumerate(sorted_values, start=1):
        last[round(x.at(value))] = number
    for place, number in last.items():
        yield f"H{place}V{y.at(100 * number / len(sorted_values)):.1f}"


def _bars(chart: _Chart, bars: Sequence[tuple[str, float | None, str]], y: _Axis) -> None:
    """Draw bars with their values above; None: unknown, with the text in place of the bar."""
    left, right, bottom, _ = _frame(chart.height)
    slot = (right - left) / len(bars)
    for number, (label, value, words) in enumerate(bars):
        middle = left + (number + 0.5) * slot
        if value:
            top = y.at(value)
            chart.shape(
                "rect", x=middle - slot / 4, y=top, width=slot / 2, height=bottom - top, fill="#c9dcec", stroke=_FIRST
            )
        chart.text(middle, (y.at(value) if value else bottom) - 4, words)
        chart.text(middle, bottom + 15, label, fill=_FAINT)


def _gaps(record: QualifyRecord, train: TrainFigures) -> Plot:
    chart = _Chart(record, "Gaps without packets, without load")
    left, right, bottom, top = _frame()
    above = [*train.gaps.above, (None, 0)]
    bars: list[tuple[str, float | None, str]] = []
    for (limit, count), (upper, more) in pairwise(above):
        label = msg(f"{arg(limit)} to {arg(upper)} s" if upper is not None else f"more than {arg(limit)} s")
        bars.append((translate(label), float(count - more), str(count - more)))
    y = _Axis.build(0, max((value or 0 for _, value, _ in bars), default=0), bottom, top + 14, whole=True)
    chart.axes(_Axis(0, 1, left, right), y, "length of the gap", "number")
    _bars(chart, bars, y)
    end = " It was still open when the packet train ended." if train.gaps.open_end and train.gaps.above[0][1] else ""
    longest = msg(f"The longest gap lasted {arg(train.gaps.longest_s):.2f} s.{arg(end)}")
    return chart.plot("gaps", [longest, *(msg(f"{arg(label)}: {arg(words)}.") for label, _, words in bars)])


def _losses(record: QualifyRecord, trains: Sequence[tuple[str, TrainFigures]]) -> Plot:
    chart = _Chart(record, "Loss each way")
    left, right, bottom, top = _frame()
    bars: list[tuple[str, float | None, str]] = []
    for load, train in trains:
        up, down, both = loss_shares(train)
        words_of_load = translate(load)
        ways = [(msg(f"up, {arg(words_of_load)}"), up), (msg(f"down, {arg(words_of_load)}"), down)]
        for way, share in ways if up is not None else [(msg(f"both ways, {arg(words_of_load)}"), both)]:
            percent = None if share is None else 100 * share
            words = translate("unknown") if percent is None else f"{percent:.2f} %"
            bars.append((translate(way), percent, words))
    y = _Axis.build(0, max((value or 0 for _, value, _ in bars), default=0) or 1.0, bottom, top + 14)
    chart.axes(_Axis(0, 1, left, right), y, "direction of the packets", "%")
    _bars(chart, bars, y)
    return chart.plot("loss", [msg(f"{arg(label)}: {arg(words)}.") for label, _, words in bars])


_ROW, _HEAD = 34.0, 92.0


def _grid(record: QualifyRecord, name: str, title: str, rows: Sequence[MeasuredRate]) -> Plot:
    """Draw a cell for each size at each rate: the verdict by symbol, text and colour, and the 95th percentile."""
    sizes = list(dict.fromkeys((row.octets, row.label) for row in sorted(rows, key=lambda row: row.octets)))
    rates = sorted({row.rate_hz for row in rows})
    chart = _Chart(record, title, _TOP + 22 + _ROW * len(sizes) + 12)
    cells = {(row.octets, row.label, row.rate_hz): row for row in rows}
    slot = (WIDTH - _RIGHT - _HEAD) / len(rates)
    for column, rate in enumerate(rates):
        chart.text(_HEAD + (column + 0.5) * slot, _TOP + 12, f"{rate:g} Hz", weight="bold")
    words = []
    for line, (octets, label) in enumerate(sizes):
        y = _TOP + 20 + line * _ROW
        chart.text(8, y + 13, label, anchor="start", weight="bold", size=9.5)
        if label != f"{octets} B":
            chart.text(8, y + 25, f"{octets} B", anchor="start", fill=_FAINT, size=9)
        for column, rate in enumerate(rates):
            row = cells.get((octets, label, rate))
            _draw_cell(chart, row, _HEAD + column * slot + 2, y, slot - 4)
            if row is not None:
                words.append(msg(f"{arg(label)} at {arg(rate):g} Hz: {arg(row.verdict.value)}, {arg(row.reason)}."))
    return chart.plot(name, words)


def _draw_cell(chart: _Chart, row: MeasuredRate | None, x: float, y: float, width: float) -> None:
    tint = signs.TINTS[None if row is None else signs.ShownState(row.verdict.value)]
    chart.shape("rect", x=x, y=y, width=width, height=_ROW - 4, fill=tint.paper, stroke=tint.edge)
    if row is None:
        chart.text(x + width / 2, y + 18, translate("not measured"), size=9, fill=_FAINT)
        return
    state = signs.ShownState(row.verdict.value)
    chart.text(x + width / 2, y + 12, f"{signs.SYMBOLS[state]} {state}", weight="bold", size=9.5, fill=tint.ink)
    detail = "" if row.p95_s is None else f"{row.p95_s:.2f} s"
    if row.reason != "sustained":
        detail = f"{detail}, {translate(row.reason)}" if detail else translate(row.reason)
    room = int(width / 4.9)
    chart.text(
        x + width / 2, y + 24, detail if len(detail) <= room else f"{detail[: room - 1]}…", size=8.5, fill=tint.ink
    )
