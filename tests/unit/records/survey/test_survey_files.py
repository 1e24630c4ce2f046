"""A survey's file, and what is made of it."""

import csv
import io
import json
import re
from pathlib import Path

import pytest
from survey_examples import header, point, survey

from atlantis_netcfg.checklist.probes.gps.judge import distance_m
from atlantis_netcfg.core.errors import ExitCode, NoMatchError, UsageError
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.core.stored_messages import marked_texts
from atlantis_netcfg.records.survey.archive import evaluate_survey, export, find_survey
from atlantis_netcfg.records.survey.exports import COLUMNS, csv_table, find_coast, geojson, read_coast
from atlantis_netcfg.records.survey.page import KINDS, SCALES, SHAPES, BandScale, MapFrame, layers, render_page
from atlantis_netcfg.records.survey.points import (
    SURVEY_FILE,
    Survey,
    SurveyEnd,
    SurveyUnreadable,
    SurveyWriter,
    read_survey,
)

HERE = {"latitude": 41.6864, "longitude": -8.8388}
HEARD = {"registration": "registered_home", "technology": "lte", "cell": "3103242", "rsrp_dbm": -95.0}
TESTED = {"sent": 5, "lost": 0, "rtt_median_s": 0.1, "goodput_up_bps": 2e6, "test_bytes": 12992, "carried_by": "4g"}


def example() -> Survey:
    return survey(
        point(1, **HERE, **HEARD, **TESTED),
        point(2, latitude=41.69, longitude=-8.85, rsrp_dbm=-112.0, cell="3103499", no_test="the hourly budget"),
        point(3, no_position="no fix", **HEARD, no_test="no response", sent=5, lost=5),
        point(4, latitude=41.7, longitude=-8.86, no_radio="te4sea-4g does not respond", place="=pier <b>"),
    )


def write(path: Path, made: Survey) -> Path:
    with path.open("a", encoding="utf-8") as file:
        writer = SurveyWriter(file)
        for line in (made.header, *made.points, made.end):
            if line is not None:
                writer(line)
    return path


def test_survey_file_round_trips(tmp_path: Path) -> None:
    made = example()
    assert read_survey(write(tmp_path / SURVEY_FILE, made)) == made


def test_stored_survey_keeps_the_values_of_its_messages(tmp_path: Path) -> None:
    why = msg(f"{arg('te4sea-4g')} does not respond within {arg(5)} s")
    stored = read_survey(write(tmp_path / SURVEY_FILE, survey(point(1, no_radio=why))))
    assert stored.points[0].no_radio == why
    assert marked_texts(stored.points) == marked_texts([why])


def test_truncated_survey_is_read_without_its_last_line(tmp_path: Path) -> None:
    path = write(tmp_path / SURVEY_FILE, survey(point(1, **HERE), point(2, **HERE), reason=None))
    path.write_bytes(path.read_bytes()[:-5])
    found = read_survey(path)
    assert ([item.number for item in found.points], found.end, found.reason) == ([1], None, "cut off")
    assert b"its end is missing" in render_page(found)


@pytest.mark.parametrize("line", ["{}", "x", '{"kind":"point","number":1,"more":2}', "[]"])
def test_invalid_survey_is_refused_with_its_line(tmp_path: Path, line: str) -> None:
    path = tmp_path / SURVEY_FILE
    path.write_text(header().model_dump_json() + f"\n{line}\n", encoding="utf-8")
    with pytest.raises(SurveyUnreadable, match=r"survey\.jsonl:2: "):
        read_survey(path)
    path.write_text(SurveyEnd(at=header().begun, reason="done").model_dump_json() + "\n", encoding="utf-8")
    with pytest.raises(SurveyUnreadable, match="this is not the start of a survey"):
        read_survey(path)


def test_geojson_has_longitude_first_and_no_geometry_without_a_position() -> None:
    document = json.loads(geojson(example()))
    assert document["type"] == "FeatureCollection"
    assert document["bbox"] == [-8.86, 41.6864, -8.8388, 41.7]
    first, _, third, _ = document["features"]
    assert first["geometry"] == {"type": "Point", "coordinates": [-8.8388, 41.6864]}
    assert (first["type"], first["id"]) == ("Feature", 1)
    assert (first["properties"]["rsrp_dbm"], first["properties"]["sinr_db"]) == (-95.0, None)
    assert third["geometry"] is None
    assert third["properties"]["no_position"] == "no fix"
    assert "latitude" not in first["properties"]


def test_csv_has_a_row_for_each_point_and_empty_cells_for_what_is_unknown() -> None:
    rows = list(csv.DictReader(io.StringIO(csv_table(example()).decode())))
    assert len(rows) == 4
    assert tuple(rows[0]) == COLUMNS
    assert (rows[0]["latitude"], rows[0]["rsrp_dbm"], rows[0]["sinr_db"]) == ("41.6864", "-95.0", "")
    assert (rows[2]["latitude"], rows[2]["no_position"]) == ("", "no fix")
    assert rows[3]["place"] == "'=pier <b>", "no formula for a spreadsheet"


def test_the_page_shows_each_value_with_its_shape_and_its_limits() -> None:
    page = render_page(example()).decode()
    assert page.count('type="radio"') == page.count('class="layer"') == len(SCALES) + len(KINDS) == 7
    assert "-115 to -105 dBm" in page
    assert "below -115 dBm" in page
    assert "1 points without a position: no fix" in page
    assert "=pier &lt;b&gt;" in page
    assert "<script" not in page
    assert not re.findall(r'(?:src|href)="(?!#)', page), "it asks for nothing"
    for number in range(7):
        assert f"#by-{number}:checked ~ #layer-{number}" in page


def test_point_without_a_value_shows_the_reason() -> None:
    made = example()
    by_name = {layer.key: layer for layer in layers(made, MapFrame.around([(41.68, -8.83), (41.7, -8.86)]))}
    assert [mark.band for mark in by_name["rsrp_dbm"].marks] == [1, 3, None]
    assert [mark.band for mark in by_name["cell"].marks] == [0, 1, None]
    assert by_name["goodput_up_bps"].marks[1].words.endswith("no value: the hourly budget")
    assert by_name["rsrp_dbm"].marks[2].words.endswith("no value: te4sea-4g does not respond")
    assert by_name["sinr_db"].marks[0].words.endswith("no value: the unit does not report it")
    for layer in by_name.values():
        assert sum(row.count for row in layer.legend) == len(layer.marks) == 3


@pytest.mark.parametrize("scale", SCALES, ids=lambda scale: scale.name)
def test_bands_match_their_labels(scale: BandScale) -> None:
    assert len(list(scale.words())) == len(scale.limits) + 1 <= len(SHAPES)
    better = 0.01 if scale.is_higher_better else -0.01
    assert [scale.band(limit + better) for limit in scale.limits] == list(range(len(scale.limits)))
    assert [scale.band(limit - better) for limit in scale.limits] == list(range(1, len(scale.limits) + 1))


def test_north_is_up_and_scale_is_equal_in_both_directions() -> None:
    degree = 1000 / 111_195.0
    frame = MapFrame.around([(41.6864, -8.8388), (41.7064, -8.8688)])
    x, y = frame.to_sheet(41.69, -8.85)
    north = frame.to_sheet(41.69 + degree, -8.85)
    east = frame.to_sheet(41.69, -8.85 + degree / frame.narrowing)
    assert y - north[1] == pytest.approx(east[0] - x, abs=0.2)
    assert (north[0], east[1]) == (x, y)
    assert frame.bar[1] == "500 m"
    assert frame.bar[0] == pytest.approx(500 * frame.per_metre, abs=0.1)


def test_single_point_or_no_position_can_be_drawn() -> None:
    assert b"<svg" in render_page(survey(point(1, **HERE)))
    assert b"No point has a position" in render_page(survey(point(1)))
    assert b"No point has a position" in render_page(survey())


def test_coast_is_drawn_where_it_crosses_the_map(tmp_path: Path) -> None:
    path = tmp_path / "coast.geojson"
    line = {"type": "LineString", "coordinates": [[-8.87, 41.68], [-8.83, 41.7], [10, 50], [11, 51]]}
    shape = {"type": "MultiPolygon", "coordinates": [[[[-8.85, 41.69], [-8.84, 41.69], [-8.85, 41.69]]]]}
    features = [{"type": "Feature", "geometry": item, "properties": {}} for item in (line, shape, None)]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}), encoding="utf-8")
    coast = read_coast(path)
    assert len(coast.lines) == 2
    page = render_page(example(), coast).decode()
    drawn = re.search(r'class="coast" d="([^"]*)"', page)
    assert drawn is not None
    assert drawn[1].count("M") == 3, "what lies far away is left out"
    assert "coast.geojson" in page
    assert 'class="coast"' not in render_page(example()).decode()


def test_shipped_coast_is_near_viana_and_states_its_accuracy() -> None:
    coast = find_coast("natural-earth")
    places = [place for line in coast.lines for place in line]
    assert 80 < len(places) < 200
    assert min(distance_m(41.6864, -8.8388, latitude, longitude) for longitude, latitude in places) < 2000.0
    far = survey(point(1, latitude=41.6, longitude=-9.1), point(2, latitude=41.8, longitude=-8.8))
    page = render_page(far, coast).decode()
    assert 'class="coast"' in page
    assert "up to about 1 km off" in page


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x", "` is not GeoJSON"),
        ('{"type":"Feature"}', "` is not GeoJSON"),
        ('{"type":"Point","coordinates":[1,2]}', "no line"),
    ],
)
def test_invalid_coast_is_refused(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "coast.geojson"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(UsageError, match=words):
        read_coast(path)
    with pytest.raises(UsageError, match="cannot be read"):
        read_coast(tmp_path / "missing.geojson")


def test_exports_are_regenerated_from_the_survey_file(tmp_path: Path) -> None:
    kept = tmp_path / "20261120T101500Z"
    kept.mkdir()
    write(kept / SURVEY_FILE, example())
    assert export(find_survey(tmp_path, kept.name), to=tmp_path / "to" / "here") == example()
    there = {path.name for path in (tmp_path / "to" / "here").iterdir()}
    assert there == {"survey.html", "survey.geojson", "survey.csv", "survey.jsonl"}
    assert (kept / "survey.html").read_bytes() == render_page(example())
    with pytest.raises(NoMatchError, match="there is no saved survey `") as refused:
        find_survey(tmp_path, "20261120T101501Z")
    assert kept.name in str(refused.value.hint)


def test_survey_without_measurements_fails() -> None:
    whole = point(1, **HERE, **HEARD, **TESTED)
    assert evaluate_survey(survey(whole)).exit is ExitCode.DONE
    assert evaluate_survey(survey(point(1, **HERE, **HEARD), far_end=None)).exit is ExitCode.DONE
    assert evaluate_survey(survey()).exit is ExitCode.NOTHING
    for without, words in (
        ({"latitude": None, "no_position": "no fix"}, "no point has a position (no fix)"),
        ({"rsrp_dbm": None, "no_radio": "it is off"}, "the unit reported no level (it is off)"),
        ({"rtt_median_s": None, "no_test": "no response"}, "no test over the link got a response (no response)"),
    ):
        found = evaluate_survey(survey(whole.model_copy(update=without)))
        assert (found.exit, found.words) == (ExitCode.CHECKS_FAILED, words)
