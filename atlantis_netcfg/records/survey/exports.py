"""Export a survey to GeoJSON (RFC 7946) and CSV (RFC 4180), from the survey file alone."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.messages import arg
from atlantis_netcfg.records.survey.points import SurveyPoint

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.records.survey.points import Survey

GEOJSON_FILE: Final = "survey.geojson"
CSV_FILE: Final = "survey.csv"
COLUMNS: Final = tuple(name for name in SurveyPoint.model_fields if name != "kind")


def geojson(survey: Survey) -> bytes:
    """Return one feature per point (longitude, latitude); a point without a position has no geometry (3.2)."""
    positions = [point.position for point in survey.placed_points if point.position is not None]
    document: dict[str, Any] = {"type": "FeatureCollection"}
    if positions:
        latitudes, longitudes = zip(*positions, strict=True)
        document["bbox"] = [min(longitudes), min(latitudes), max(longitudes), max(latitudes)]
    document["features"] = [_feature(point) for point in survey.points]
    document["survey"] = survey.header.model_dump(mode="json", exclude={"kind"}) | {"ended": survey.reason}
    return (json.dumps(document, ensure_ascii=False, indent=1) + "\n").encode()


def _feature(point: SurveyPoint) -> dict[str, Any]:
    values = point.model_dump(mode="json", exclude={"kind", "latitude", "longitude"})
    geometry = None
    if point.position is not None:
        geometry = {"type": "Point", "coordinates": [point.longitude, point.latitude]}
    return {"type": "Feature", "id": point.number, "geometry": geometry, "properties": values}


def csv_table(survey: Survey) -> bytes:
    """Return one row per point; an unknown value is an empty cell."""
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(COLUMNS)
    for point in survey.points:
        values = point.model_dump(mode="json")
        writer.writerow("" if values[name] is None else _escape_formula(values[name]) for name in COLUMNS)
    return text.getvalue().encode()


def _escape_formula(value: Any) -> Any:  # noqa: ANN401 - of a cell
    """Prefix text that a spreadsheet would read as a formula with an apostrophe; numbers are unchanged."""
    return f"'{value}" if isinstance(value, str) and value[:1] in {"=", "+", "-", "@", "\t", "\r"} else value


@dataclass(frozen=True, slots=True)
class Coast:
    """Coastlines to draw on the map, each a sequence of (longitude, latitude)."""

    name: str
    lines: tuple[tuple[tuple[float, float], ...], ...]


SHIPPED_COAST: Final = "natural-earth"
_SHIPPED_FILE: Final = Path(__file__).with_name("data") / "coast-viana.json"


def find_coast(name: str) -> Coast:
    """Return the coastline given by `coast=`: the built-in one or a file. Raises UsageError."""
    if name != SHIPPED_COAST:
        return read_coast(Path(name))
    return Coast("Natural Earth 1:10 million, up to about 1 km off", read_coast(_SHIPPED_FILE).lines)


_DEPTHS: Final = {
    "LineString": 1,
    "Polygon": 2,
    "MultiLineString": 2,
    "MultiPolygon": 3,
}
"""Number of nested arrays around a position (RFC 7946, 3.1)."""


def read_coast(path: Path) -> Coast:
    """Read the lines and polygon outlines of a GeoJSON file. Raises UsageError, with the reason."""
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        lines = tuple(_outlines(document))
    except OSError as error:
        raise UsageError(
            f"`coast={arg(path)}` cannot be read: {arg(error.strerror)}", hint="name a GeoJSON file"
        ) from error
    except (ValueError, TypeError, KeyError, IndexError, AttributeError, RecursionError) as error:
        raise UsageError(
            f"`coast={arg(path)}` is not GeoJSON", hint="export the coast line as GeoJSON, WGS 84"
        ) from error
    if not lines:
        raise UsageError(f"`coast={arg(path)}` contains no line and no polygon", hint="points cannot draw a coast line")
    return Coast(path.name, lines)


def _outlines(item: Any) -> Iterator[tuple[tuple[float, float], ...]]:  # noqa: ANN401 - JSON of any shape
    kind = item["type"]
    if kind == "FeatureCollection":
        for feature in item["features"]:
            yield from _outlines(feature)
    elif kind == "Feature" and item["geometry"] is not None:
        yield from _outlines(item["geometry"])
    elif kind == "GeometryCollection":
        for geometry in item["geometries"]:
            yield from _outlines(geometry)
    elif kind in _DEPTHS:
        yield from _parts(item["coordinates"], _DEPTHS[kind])


def _parts(coordinates: Any, depth: int) -> Iterator[tuple[tuple[float, float], ...]]:  # noqa: ANN401 - as above
    if depth > 1:
        for part in coordinates:
            yield from _parts(part, depth - 1)
    else:
        yield tuple((float(position[0]), float(position[1])) for position in coordinates)
