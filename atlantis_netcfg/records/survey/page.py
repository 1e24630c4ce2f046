"""The HTML page of a survey: one file without scripts or requests, with one coloured track per value.

Colour is never the only sign: each band also has a shape, and the legend gives the limits in numbers. The colours are
the Okabe-Ito palette, which is safe for colour-blind readers. Limits of RSRP, RSRQ and SINR are the warning limits
of `provision links`, with the steps above them (rules of thumb of modem makers). Those of round trip and goodput
are a proposal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.core.times import time_text
from atlantis_netcfg.links.lte import judge
from atlantis_netcfg.runs.report import page_frame

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from jinja2 import Environment

    from atlantis_netcfg.records.survey.exports import Coast
    from atlantis_netcfg.records.survey.points import Survey, SurveyPoint

PAGE_FILE: Final = "survey.html"
_WIDTH: Final = 760.0
_MARGIN: Final = 46.0
_TALLEST: Final = 900.0
_METRES: Final = 111_195.0
_LEAST_M: Final = 50.0
"""Minimum extent of the map in metres on the longer side of the track."""
SHAPES: Final = ("square", "circle", "triangle", "diamond", "cross", "bar")


@dataclass(frozen=True, slots=True)
class BandScale:
    """A value and the limits of its bands, best band first."""

    name: str
    """Name of the field of a point."""
    title: str
    unit: str
    limits: tuple[float, ...]
    """Limits between the bands, from good to poor."""
    factor: float = 1.0
    digits: int = 0
    """Number of digits that are shown."""

    @property
    def is_higher_better(self) -> bool:
        """True if a higher value is better."""
        return self.limits[0] > self.limits[-1]

    def band(self, value: float) -> int:
        """Return the band number of a displayed value."""
        return sum(1 for limit in self.limits if (value < limit if self.is_higher_better else value > limit))

    def words(self) -> Iterator[str]:
        """Yield the limits of each band as text."""
        best, last, unit = self.limits[0], self.limits[-1], self.unit
        yield msg(f"from {arg(best):g} {arg(unit)}" if self.is_higher_better else f"up to {arg(best):g} {arg(unit)}")
        for first, second in pairwise(self.limits):
            low, high = sorted((first, second))
            yield msg(f"{arg(low):g} to {arg(high):g} {arg(unit)}")
        yield msg(f"below {arg(last):g} {arg(unit)}" if self.is_higher_better else f"above {arg(last):g} {arg(unit)}")

    def get_value(self, point: SurveyPoint) -> float | None:
        """Return the value of a point in the unit of the scale; None if missing."""
        value = getattr(point, self.name)
        return None if value is None else float(value) * self.factor


SCALES: Final = (
    BandScale("rsrp_dbm", "RSRP", "dBm", (-90.0, -100.0, judge.WEAK_RSRP_DBM, -115.0)),
    BandScale("rsrq_db", "RSRQ", "dB", (-10.0, -12.0, judge.WEAK_RSRQ_DB), digits=1),
    BandScale("sinr_db", "SINR", "dB", (13.0, 7.0, judge.WEAK_SINR_DB)),
    BandScale("rtt_median_s", "Round trip", "ms", (60.0, 120.0, 250.0, 800.0), factor=1000.0),
    BandScale("goodput_up_bps", "Goodput up", "Mbit/s", (10.0, 4.0, 1.0, 0.3), factor=1e-6, digits=2),
)
KINDS: Final = (("cell", "Serving cell"), ("technology", "Radio technology"))
"""Values that are names: each has its own shape, in the order of first occurrence."""


@dataclass(frozen=True, slots=True)
class TrackMark:
    """A survey point on the map."""

    x: float
    y: float
    band: int | None
    words: str


@dataclass(frozen=True, slots=True)
class LegendRow:
    """A band and its text in the legend."""

    band: int | None
    words: str
    count: int


@dataclass(frozen=True, slots=True)
class ValueLayer:
    """The track coloured by one value."""

    key: str
    title: str
    marks: tuple[TrackMark, ...]
    legend: tuple[LegendRow, ...]


@dataclass(frozen=True, slots=True)
class MapFrame:
    """Area and scale of the map: a plane tangent to the Earth in the middle of the area."""

    south: float
    west: float
    per_metre: float
    height: float
    narrowing: float
    """Metres per degree of longitude, divided by metres per degree of latitude."""

    @classmethod
    def around(cls, positions: Sequence[tuple[float, float]]) -> MapFrame:
        """Return the frame that contains all positions; the longer side fills the sheet."""
        latitudes, longitudes = zip(*positions, strict=True)
        narrowing = max(0.01, math.cos(math.radians((min(latitudes) + max(latitudes)) / 2)))
        wide = (max(longitudes) - min(longitudes)) * _METRES * narrowing
        high = (max(latitudes) - min(latitudes)) * _METRES
        inner = _WIDTH - 2 * _MARGIN
        per_metre = min(inner / max(wide, _LEAST_M), (_TALLEST - 2 * _MARGIN) / max(high, _LEAST_M))
        height = max(240.0, high * per_metre + 2 * _MARGIN)
        spare_x, spare_y = (inner - wide * per_metre) / 2, (height - 2 * _MARGIN - high * per_metre) / 2
        west = min(longitudes) - spare_x / per_metre / _METRES / narrowing
        return cls(min(latitudes) - spare_y / per_metre / _METRES, west, per_metre, height, narrowing)

    def to_sheet(self, latitude: float, longitude: float) -> tuple[float, float]:
        """Convert a position to sheet coordinates."""
        x = _MARGIN + (longitude - self.west) * _METRES * self.narrowing * self.per_metre
        y = self.height - _MARGIN - (latitude - self.south) * _METRES * self.per_metre
        return round(x, 1), round(y, 1)

    @property
    def bar(self) -> tuple[float, str]:
        """Length of the scale bar on the sheet, and its label: a round number of metres."""
        most = (_WIDTH - 2 * _MARGIN) / 3 / self.per_metre
        power = 10.0 ** math.floor(math.log10(most))
        metres = next(step * power for step in (5, 2, 1) if step * power <= most)
        return round(metres * self.per_metre, 1), msg(
            f"{arg(metres / 1000):g} km" if metres >= 1000 else f"{arg(metres):g} m"  # noqa: PLR2004 - from there on in km
        )


def layers(survey: Survey, frame: MapFrame) -> tuple[ValueLayer, ...]:
    """Return one layer for each value that can be shown."""
    return (
        *(_scale_layer(survey, frame, scale) for scale in SCALES),
        *(_category_layer(survey, frame, *kind) for kind in KINDS),
    )


def _scale_layer(survey: Survey, frame: MapFrame, scale: BandScale) -> ValueLayer:
    marks = []
    for point in survey.placed_points:
        value = scale.get_value(point)
        words = msg(
            f"no value: {arg(_missing_reason(point, scale.name))}"
            if value is None
            else f"{arg(value):.{scale.digits}f} {arg(scale.unit)}"
        )
        marks.append(_mark(frame, point, None if value is None else scale.band(value), words))
    return ValueLayer(scale.name, scale.title, tuple(marks), _legend(marks, [*scale.words()]))


def _category_layer(survey: Survey, frame: MapFrame, name: str, title: str) -> ValueLayer:
    values = list(dict.fromkeys(value for point in survey.placed_points if (value := getattr(point, name)) is not None))
    marks = []
    for point in survey.placed_points:
        value = getattr(point, name)
        words = msg(f"no value: {arg(_missing_reason(point, name))}") if value is None else str(value)
        marks.append(_mark(frame, point, None if value is None else min(values.index(value), len(SHAPES) - 1), words))
    names = values[: len(SHAPES) - 1] + ([join(", ", values[len(SHAPES) - 1 :])] if len(values) >= len(SHAPES) else [])
    return ValueLayer(name, title, tuple(marks), _legend(marks, names))


def _mark(frame: MapFrame, point: SurveyPoint, band: int | None, words: str) -> TrackMark:
    x, y = frame.to_sheet(*(point.position or (0.0, 0.0)))
    place = msg(f"{arg(point.place)}, " if point.place else "")
    title = translate(f"point {arg(point.number)}, {arg(place)}{arg(point.at):%H:%M:%S} UTC: {arg(words)}")
    return TrackMark(x, y, band, title)


def _missing_reason(point: SurveyPoint, name: str) -> str:
    """Return the reason why a value is missing."""
    if name in {"rtt_median_s", "goodput_up_bps"}:
        return point.no_test or "nothing was received"
    return point.no_radio or "the unit does not report it"


def _legend(marks: Sequence[TrackMark], words: Sequence[str]) -> tuple[LegendRow, ...]:
    rows = [LegendRow(band, text, sum(mark.band == band for mark in marks)) for band, text in enumerate(words)]
    return (*rows, LegendRow(None, "no value", sum(mark.band is None for mark in marks)))


def coast_paths(coast: Coast | None, frame: MapFrame) -> tuple[str, ...]:
    """Return the parts of a coastline that cross the sheet, as SVG paths."""
    if coast is None:
        return ()
    paths = []
    for line in coast.lines:
        places = [frame.to_sheet(latitude, longitude) for longitude, latitude in line]
        paths += [
            f"M{a[0]} {a[1]}L{b[0]} {b[1]}"
            for a, b in pairwise(places)
            if max(a[0], b[0]) >= 0 and min(a[0], b[0]) <= _WIDTH and max(a[1], b[1]) >= 0
            if min(a[1], b[1]) <= frame.height
        ]
    return tuple(paths)


_EMULATION: Final = "REHEARSAL: track, unit, coverage and link were emulated. Nothing here describes a real place."
_ENDS: Final = {
    "done": "it ran until its time was over or a person ended it",
    "stopped": "it was interrupted; all data up to then is here",
    "cut off": "its end is missing: the program was killed, or the survey is still running",
}


def summary(survey: Survey) -> tuple[str, ...]:
    """Summarise the survey in sentences."""
    points = survey.points
    levels = sum(point.rsrp_dbm is not None for point in points)
    test_count = sum(point.sent is not None for point in points)
    answer_count = sum(point.rtt_median_s is not None for point in points)
    unproved_count = sum(point.sent is not None and point.carried_by is None for point in points)
    byte_count = sum(point.test_bytes for point in points)
    lines = [
        msg(f"{arg(len(points))} points, {arg(len(survey.placed_points))} of them with a position"),
        msg(f"{arg(levels)} points with a level of the unit"),
        msg(
            f"{arg(test_count)} tests over the link, {arg(answer_count)} of them with a response, "
            f"{arg(byte_count / 1000):.1f} kB sent and received"
        ),
    ]
    if unproved_count and not survey.header.emulated:
        lines.append(
            msg(
                f"for {arg(unproved_count)} tests it is not known which link carried them: the router did not report it"
            )
        )
    lines += [msg(f"{arg(count)} points without a position: {arg(reason)}") for reason, count in count_unplaced(survey)]
    return (*lines, _ENDS[survey.reason])


def count_unplaced(survey: Survey) -> tuple[tuple[str, int], ...]:
    """Count the points without a position, by reason."""
    reasons = [point.no_position for point in survey.points if point.position is None]
    return tuple((reason, reasons.count(reason)) for reason in dict.fromkeys(reasons))


def render_page(survey: Survey, coast: Coast | None = None) -> bytes:
    """Render the page; the result depends on the survey and the coastline alone."""
    header = survey.header
    positions = [point.position for point in survey.placed_points if point.position is not None]
    frame = MapFrame.around(positions) if positions else None
    return page_frame.page(
        _environment(),
        "survey.html.j2",
        page_frame.PageHeader(
            msg(f"Coverage along a track: {arg(header.title)} ({arg(header.site)})"),
            msg(f"survey {arg(header.id)}, {arg(time_text(header.begun, header.time_zone))}"),
            _EMULATION if header.emulated else "",
        ),
        source=msg(f"link {arg(header.link)}, read from {arg(header.unit)}, positions from {arg(header.positions_by)}"),
        frame=frame,
        width=_WIDTH,
        layers=layers(survey, frame) if frame is not None else (),
        track=" ".join(f"{x},{y}" for x, y in (frame.to_sheet(*position) for position in positions)) if frame else "",
        coast_words=None if coast is None else msg(f"The coast line is that of {arg(coast.name)}"),
        coast_paths=coast_paths(coast, frame) if frame is not None else (),
        summary=summary(survey),
    )


@cache
def _environment() -> Environment:
    result = page_frame.environment("atlantis_netcfg.records.survey")
    result.globals.update(shapes=SHAPES)
    return result
