"""The figures of a run against the emulated link that it was measured over, and what may not pass."""

import json
from collections.abc import Iterator
from dataclasses import replace
from datetime import timedelta
from decimal import Decimal
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from example_runs import BEGUN, LARGE, SMALL, idle_text, measured_run, put_run, samples_text
from tolerances import tolerances

from atlantis_netcfg.cli.base.output import json_text
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.core.stored_messages import marked_texts
from atlantis_netcfg.links.qualify.archive import (
    RECORD_FILE,
    find_run,
    folder_of,
    keep_record,
    record_json,
    record_of,
    samples_of,
    stored_runs,
)
from atlantis_netcfg.links.qualify.grids import SHAPE_UNKNOWN
from atlantis_netcfg.links.qualify.judgement import profile
from atlantis_netcfg.links.qualify.measured_run import RUN_FILE, SAMPLES_FILE, Selection
from atlantis_netcfg.links.qualify.record import QualifyRecord, make_record
from atlantis_netcfg.links.qualify.samples import SamplesUnreadable, read
from atlantis_netcfg.links.qualify.search import RateLimit
from atlantis_netcfg.operations.qualify.result import QualifyResult
from atlantis_netcfg.runs import DamagedStateError, NoSuchRun, Store


def made(text: str, **changes: Any) -> QualifyRecord:  # noqa: ANN401 - fields of MeasuredRun
    return make_record(measured_run(**changes), read(text.splitlines(keepends=True)))


def lines(text: str, *, without: str) -> Iterator[str]:
    """Yield samples of all streams but those whose name begins so."""
    for line in text.splitlines(keepends=True):
        if not json.loads(line)["stream"].startswith(without):
            yield line


def test_figures_match_the_link() -> None:
    record = made(samples_text())
    assert record.idle is not None
    assert record.idle.rtt is not None
    # 200 octets (172 and headers) at both rates, twice the delay, and the medians of two half-normal jitters.
    wire_s = 200 * 8 / 352_000 + 200 * 8 / 704_000
    assert record.idle.rtt.min >= 2 * 0.28 + wire_s
    assert record.idle.rtt.p50 == pytest.approx(2 * 0.28 + wire_s + 2 * 0.0145, abs=0.01)
    (up,) = record.load
    assert up.way == "up"
    # Of 352 kbit/s, chunks of 1015 octets and more carry 1000 of payload; tail drop spoils messages, not octets.
    assert up.goodput_bps is not None
    assert 0.7 * 352_000 < up.goodput_bps < 352_000
    assert up.sent == up.received + up.lost + up.in_flight
    assert record.rpm_under_load is not None
    assert record.under_load is not None
    assert record.under_load.rtt is not None
    assert record.rpm_under_load < 60 / record.idle.rtt.p50, "round trips are longer beside a load"
    assert record.verdict is Verdict.PASS
    assert record.mb_per_hour == pytest.approx(2.0 * 6), "2 MB in ten minutes"


def test_grid_rows_state_the_cost_per_hour() -> None:
    rows = {(row.octets, row.rate_hz): row for row in made(samples_text()).telemetry}
    # An authenticated packet of at least 112 octets and 28 of headers, both ways, 4 a second.
    assert rows[32, 4.0].mb_per_hour == pytest.approx(2 * (112 + 28) * 4 * 3600 / 1e6)
    assert rows[32, 4.0].price_per_hour == Decimal(8) * 2 * (112 + 28) * 4 * 3600 / 1_000_000
    assert rows[512, 10.0].verdict is Verdict.PASS
    assert rows[512, 10.0].reason == "sustained"


def test_images_are_sustained_up_to_what_the_link_carries() -> None:
    rows = {(row.label, row.rate_hz): row.verdict for row in made(samples_text()).images}
    assert rows[SMALL.label, 1.0] is Verdict.PASS
    assert rows[LARGE.label, 2.0] is Verdict.FAIL, "614 kbit/s of payload over 352"


def test_highest_rate_is_reproduced_from_the_samples() -> None:
    (found,) = made(samples_text()).highest_rates
    wire_bits = 8 * (1440 + 2 * (84 + 28 + 60))
    can_carry = 352_000 / wire_bits
    assert found.label == SMALL.label
    assert found.proved
    assert found.limited_by in {RateLimit.LOSS, RateLimit.LATENCY, RateLimit.QUEUE}
    assert found.rate_hz is not None
    below = 1 - tolerances()["rate_below_share"]
    assert below * can_carry < found.rate_hz < (1 + tolerances()["rate_above_share"]) * 352_000 / (8 * 1440)
    assert [step.rate_hz for step in found.steps][:5] == [0.5, 1, 2, 4, 8]
    assert next(step.rate_hz for step in found.steps if step.failed) == 32


def test_search_ended_by_the_budget_proves_nothing() -> None:
    text = "".join(
        line for line in samples_text().splitlines(keepends=True) if '"rate 1440 ' not in line or " 0.5" in line
    )
    (found,) = made(text, reason="bytes").highest_rates
    assert (found.rate_hz, found.limited_by, found.proved) == (0.5, RateLimit.BUDGET, False)
    (found,) = made(text).highest_rates
    assert (found.limited_by, found.proved) == (RateLimit.HIGHEST, False), "the run went to its end"


def test_nothing_passes_without_an_idle_train() -> None:
    record = made("".join(lines(samples_text(), without="idle")))
    assert record.idle is None
    assert record.verdict is Verdict.INCONCLUSIVE
    assert record.judgements == ()
    assert {row.verdict for row in record.telemetry} == {Verdict.INCONCLUSIVE}
    assert all("no measurement without load to compare with" in row.reason for row in record.telemetry)


def test_truncated_stream_does_not_pass() -> None:
    kept = [
        line
        for line in samples_text().splitlines(keepends=True)
        if not ('"telemetry 32 1"' in line and json.loads(line)["kind"] == "end")
    ]
    rows = {row.rate_hz: row for row in made("".join(kept)).telemetry if row.octets == 32}
    assert (rows[1.0].verdict, rows[1.0].reason) == (Verdict.INCONCLUSIVE, "ended early: cut off")
    assert rows[4.0].verdict is Verdict.PASS


def test_stopped_run_does_not_pass() -> None:
    assert made(samples_text(), reason="stopped").verdict is Verdict.INCONCLUSIVE


def test_load_is_judged_only_when_it_was_selected() -> None:
    names = [item.criterion for item in made(idle_text(), selection=Selection.TELEMETRY).judgements]
    assert not [name for name in names if name.startswith("buffer delay")]
    record = made(idle_text())
    assert record.judgements[-1].criterion.startswith("buffer delay")
    assert record.verdict is Verdict.INCONCLUSIVE


@pytest.mark.parametrize("way", [Verdict.FAIL, Verdict.INCONCLUSIVE])
def test_run_over_an_unproved_route_does_not_pass(way: Verdict) -> None:
    assert made(samples_text(), way=way, way_reason="3 packets left by 4g").verdict is way


def test_other_thresholds_may_be_applied_later() -> None:
    samples = [*read(samples_text().splitlines(keepends=True))]
    record = make_record(measured_run(), samples, thresholds=("wifi", profile("wifi")))
    assert record.thresholds_name == "wifi"
    assert record.run.thresholds_name == "satellite"
    assert record.verdict is Verdict.FAIL
    assert record.idle == make_record(measured_run(), samples).idle


def test_the_gap_of_a_satellite_is_counted() -> None:
    record = made(idle_text(gap_at_s=40.0))
    assert record.idle is not None
    assert record.idle.gaps.longest_s == pytest.approx(70.0, abs=2 * 0.25 + 0.1)
    assert record.idle.gaps.above == ((1, 1), (5, 1), (20, 1), (60, 1))
    verdicts = {item.criterion: item.verdict for item in record.judgements}
    assert verdicts["longest gap"] is Verdict.PASS, "90 s are allowed"
    assert verdicts["AVAIL"] is Verdict.FAIL, "70 of 150 s"
    assert record.verdict is Verdict.FAIL


def test_empty_run_has_an_inconclusive_record() -> None:
    record = made("", ended=None, reason="stopped")
    assert record.verdict is Verdict.INCONCLUSIVE
    assert record.mb_per_hour is None
    assert not any((record.load, record.telemetry, record.images, record.highest_rates))


def test_the_json_is_stable_and_as_its_schema_says() -> None:
    record = made(samples_text())
    data = record_json(record)
    assert data == record_json(made(samples_text()))
    schema = QualifyRecord.model_json_schema(mode="serialization")
    found = json.loads(data)
    jsonschema.validate(found, schema)
    assert QualifyRecord.model_validate_json(data) == record
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({**found, "verdict": "GREEN"}, schema)
    assert found["grid_note"] == SHAPE_UNKNOWN
    assert list(found) == [
        *("version", "samples_sha256", "run", "thresholds_name", "thresholds", "idle", "under_load"),
        *("rpm_under_load", "load", "telemetry", "images", "highest_rates", "grid_note", "wire_bytes"),
        *("mb_per_hour", "judgements", "verdict"),
    ]


def test_result_with_prices_is_valid_json() -> None:
    record = made(samples_text())
    found = json.loads(json_text(QualifyResult(record, Path("kept")).as_json()))
    prices = [row["price_per_hour"] for row in found["rows"]]
    assert prices == [str(row.price_per_hour) for row in (*record.telemetry, *record.images)]
    assert "32.256" in prices
    with pytest.raises(TypeError, match="Path is not JSON serializable"):
        json_text({"folder": Path("kept")})


def test_stored_runs_are_found(tmp_path: Path) -> None:
    store = Store(tmp_path)
    folder = folder_of(store, "coastal")
    assert folder == tmp_path / "real" / "coastal" / "qualify"
    assert stored_runs(store, "coastal") == []
    later = measured_run(id="4g-20261121T093000Z", link="4g", begun=BEGUN + timedelta(days=1))
    for each in (later, measured_run()):
        put_run(folder, each, "")
    (folder / "left-by-a-kill").mkdir()
    assert [item.run.link for item in stored_runs(store, "coastal")] == ["satellite", "4g"]
    assert [item.run.id for item in stored_runs(store, "coastal", "4g")] == [later.id]
    assert find_run(store, "coastal", later.id).run == later
    with pytest.raises(NoSuchRun) as caught:
        find_run(store, "coastal", "4g-20261121T093000")
    assert "did you mean `4g-20261121T093000Z`?" in (caught.value.hint or "")
    (folder / later.id / RUN_FILE).write_text("{}")
    with pytest.raises(DamagedStateError):
        stored_runs(store, "coastal")


def test_stored_run_and_figures_keep_the_values_of_their_messages(tmp_path: Path) -> None:
    why = msg(f"{arg(3)} packets left by {arg('ether2')}")
    place = put_run(tmp_path / "real" / "coastal" / "qualify", measured_run(way_reason=why))
    saved_run = find_run(Store(tmp_path), "coastal", place.name)
    assert marked_texts(saved_run.run) == marked_texts([why])
    record = record_of(saved_run)
    row = replace(record.load[0], doubt=msg(f"{arg(3)} samples are missing"))
    keep_record(place, record.model_copy(update={"load": (row,)}))
    stored = record_of(saved_run)
    assert stored.load == (row,)
    assert marked_texts(stored.load) == marked_texts([row.doubt])


def test_stored_figures_are_used_only_for_their_own_samples(tmp_path: Path) -> None:
    place = put_run(tmp_path / "real" / "coastal" / "qualify")
    kept = find_run(Store(tmp_path), "coastal", place.name)
    record = record_of(kept)
    keep_record(place, record.model_copy(update={"mb_per_hour": 99.0}))
    assert record_of(kept).mb_per_hour == 99.0, "they are read, not made again"
    text = (place / SAMPLES_FILE).read_text()
    (place / SAMPLES_FILE).write_text("".join(text.splitlines(keepends=True)[:-1]))
    assert record_of(kept).mb_per_hour == record.mb_per_hour
    (place / RECORD_FILE).write_text("not JSON")
    assert record_of(kept).mb_per_hour == record.mb_per_hour
    assert record_of(kept, ("lte", profile("lte"))).verdict is Verdict.FAIL


def test_missing_and_damaged_samples(tmp_path: Path) -> None:
    place = put_run(tmp_path)
    (place / SAMPLES_FILE).write_text('{"kind":"sent"}\n')
    with pytest.raises(SamplesUnreadable, match=r"samples\.jsonl:1"):
        samples_of(place)
    (place / SAMPLES_FILE).unlink()
    assert samples_of(place) == []
