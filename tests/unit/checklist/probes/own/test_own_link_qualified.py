"""The item of a measured link: green only for a real measurement, not an old one, that proves all of it."""

import asyncio
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from hints_said import advised

from atlantis_netcfg.checklist.probes import Answer, Cell, LinkRecordRequest, LinkRecordResult, Place, Step, Trouble
from atlantis_netcfg.checklist.probes.site_checks import steps
from atlantis_netcfg.checklist.runner import RealTransport
from atlantis_netcfg.checklist.runner.simulated._world import healthy
from atlantis_netcfg.checklist.runner.simulated.environment import RehearsedTransport
from atlantis_netcfg.checklist.runner.simulated.measured_links import MeasuredLink
from atlantis_netcfg.cli import main
from atlantis_netcfg.cli.base.commands import COMMANDS, choose
from atlantis_netcfg.cli.base.commands import load as load_command
from atlantis_netcfg.cli.base.syntax import parse
from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.inventory.model import LinkKind
from atlantis_netcfg.links.qualify.archive import RECORD_FILE, folder_of, record_json
from atlantis_netcfg.links.qualify.measured_run import SAMPLES_FILE, write_run
from atlantis_netcfg.links.qualify.record import QualifyRecord, make_record
from atlantis_netcfg.links.qualify.samples import SampleWriter
from atlantis_netcfg.operations.common.request import Mode, Request
from atlantis_netcfg.runs import Store

SHIPPED = load(Path(__file__).parents[5] / "inventory")
NOW = datetime(2026, 11, 22, 10, 0, tzinfo=UTC)
SATELLITE = MeasuredLink("satellite", LinkKind.SATELLITE)


def declared(**settings: Any) -> Inventory:  # noqa: ANN401 - fields of the checklist's settings
    """The shipped pilot, with other settings of the checklist."""
    site = SHIPPED.sites["coastal"]
    site = site.model_copy(update={"checklist": site.checklist.model_copy(update=settings)})
    return replace(SHIPPED, sites={**SHIPPED.sites, "coastal": site})


def item(declaration: Inventory, link: str = "satellite") -> Step:
    made = steps(Cell(declaration, "coastal", None, "site"))
    return next(step for step in made if step.name == f"link-qualified-{link}")


def judged(answer: Answer, **settings: Any) -> tuple[Verdict, dict[str, Verdict], str]:  # noqa: ANN401 - as above
    probe = item(declared(**settings)).probe
    assert probe is not None
    found = probe.judge({"record": answer})
    assert all(finding.hint for finding in found.findings if finding.verdict is not Verdict.PASS)
    return found.verdict, {each.code: each.verdict for each in found.findings}, found.findings[0].message


def real(link: MeasuredLink = SATELLITE, **changes: Any) -> QualifyRecord:  # noqa: ANN401 - fields of MeasuredRun
    record = link.record("coastal", NOW)
    return record.model_copy(update={"run": record.run.model_copy(update={"emulated": False, **changes})})


def answer(record: QualifyRecord | None) -> LinkRecordResult:
    return LinkRecordResult(None, "", record, NOW)


def test_foreign_far_end_qualifies_no_link() -> None:
    end = real().run.far_end.model_copy(update={"name": "192.0.2.7", "authenticated": False})
    verdict, codes, message = judged(answer(real(far_end=end)))
    assert (verdict, codes) == (Verdict.INCONCLUSIVE, {"other-far-end": Verdict.INCONCLUSIVE})
    assert message == "192.0.2.7, which responded to the measurement of satellite, is not an authenticated far end"


def test_each_link_has_an_item_if_measurements_are_declared() -> None:
    without = replace(SHIPPED, pilot=SHIPPED.pilot.model_copy(update={"qualify": None}))
    assert not [step for step in steps(Cell(without, "coastal", None, "site")) if "qualified" in step.name]
    names = [step.name for step in steps(Cell(declared(), "coastal", None, "site")) if "qualified" in step.name]
    assert names == [f"link-qualified-{bearer.name}" for bearer in SHIPPED.sites["coastal"].bearers]
    made = item(declared())
    assert made.probe is not None
    assert made.probe.asks() == (LinkRecordRequest("record", "coastal", "satellite"),)
    assert made.concerns == ("coastal-router", "coastal-sat")


def test_valid_measurement_passes_with_its_evidence() -> None:
    probe = item(declared()).probe
    assert probe is not None
    found = probe.judge({"record": answer(real())})
    assert [(each.verdict, each.code) for each in found.findings] == [(Verdict.PASS, "qualified")]
    assert found.findings[0].message == "satellite meets all 8 criteria of `satellite`, measured yesterday"
    assert found.evidence[0].value == "satellite-20261121T100000Z, started 2026-11-21 10:00 UTC"
    assert any(each.what == "FTD, round trip, 95 %" and "PASS" in (each.value or "") for each in found.evidence)


def test_missing_or_unreadable_measurement_is_inconclusive() -> None:
    assert judged(answer(None))[:2] == (Verdict.INCONCLUSIVE, {"never-measured": Verdict.INCONCLUSIVE})
    broken = LinkRecordResult(Trouble.MISSING, "EXAMPLE cannot be read", None, NOW)
    assert judged(broken)[:2] == (Verdict.INCONCLUSIVE, {"not-readable": Verdict.INCONCLUSIVE})


@pytest.mark.parametrize(
    ("age", "days", "code"),
    [
        (timedelta(days=30), 30, "qualified"),
        (timedelta(days=30, seconds=1), 30, "stale"),
        (timedelta(days=8), 7, "stale"),
        (timedelta(days=8), 9, "qualified"),
        (-timedelta(minutes=4), 30, "qualified"),
        (-timedelta(minutes=6), 30, "of-the-future"),
    ],
)
def test_old_or_future_measurement_proves_nothing(age: timedelta, days: int, code: str) -> None:
    verdict, codes, _ = judged(answer(real(replace(SATELLITE, age=age))), qualified_within_days=days)
    assert [*codes] == [code]
    assert verdict is (Verdict.PASS if code == "qualified" else Verdict.INCONCLUSIVE)


def test_default_validity_is_thirty_days() -> None:
    assert SHIPPED.sites["coastal"].checklist.qualified_within_days == 30


@pytest.mark.parametrize(
    ("record", "verdict", "codes"),
    [
        (real(replace(SATELLITE, slower=1.2)), Verdict.FAIL, {"beyond-the-limit"}),
        (real(replace(SATELLITE, slower=1.2, age=timedelta(days=60))), Verdict.FAIL, {"beyond-the-limit", "stale"}),
        (real(way=Verdict.FAIL), Verdict.FAIL, {"other-link"}),
        (real(way=Verdict.INCONCLUSIVE), Verdict.INCONCLUSIVE, {"way-not-proved"}),
        (real(reason="bytes"), Verdict.INCONCLUSIVE, {"cut-short"}),
        (real(kind="lte"), Verdict.INCONCLUSIVE, {"other-kind"}),
        (real().model_copy(update={"judgements": ()}), Verdict.INCONCLUSIVE, {"not-proved"}),
        (make_record(real().run, []), Verdict.INCONCLUSIVE, {"not-proved"}),
        (real(emulated=True), Verdict.INCONCLUSIVE, {"emulated"}),
    ],
)
def test_unproved_link_is_not_green(record: QualifyRecord, verdict: Verdict, codes: set[str]) -> None:
    found = judged(answer(record))
    assert (found[0], {*found[1]}) == (verdict, codes)


def test_open_criterion_is_inconclusive() -> None:
    record = real()
    open_ = replace(record.judgements[0], verdict=Verdict.INCONCLUSIVE)
    verdict, codes, message = judged(answer(record.model_copy(update={"judgements": (open_, *record.judgements[1:])})))
    assert (verdict, [*codes]) == (Verdict.INCONCLUSIVE, ["not-proved"])
    assert message == "the measurement of satellite does not decide: FTD, round trip, 95 %"


def test_advised_commands_can_be_typed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The figures are shown, and the list names what cannot be read; nothing is measured here."""
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path))
    place = put(tmp_path, replace(SATELLITE, slower=1.2))
    probe = item(declared()).probe
    assert probe is not None
    shown = probe.judge({"record": ask(tmp_path)}).findings[0]
    assert shown.code == "beyond-the-limit"
    (words,) = advised(shown.hint or "")
    assert main(words) == ExitCode.CHECKS_FAILED
    assert place.name in capsys.readouterr().out
    (place / "run.json").write_text("{}")
    unread = probe.judge({"record": ask(tmp_path)}).findings[0]
    assert unread.code == "not-readable"
    (words,) = advised(unread.hint or "")
    assert main(words) == ExitCode.FAILED
    assert str(place) in capsys.readouterr().err
    never = probe.judge({"record": answer(None)}).findings[0]
    (words,) = advised(never.hint or "")
    assert words == ["measure", "link", "site=coastal", "link=satellite"]
    name, rest = choose(words, COMMANDS)
    assert parse(load_command(name, COMMANDS).command, rest).word("site") == "coastal"


def put(state: Path, link: MeasuredLink, *, emulated: bool = False, rehearsed: bool = False) -> Path:
    """Write a measurement as the command writes it."""
    now = datetime.now(UTC)
    record = link.record("coastal", now)
    place = folder_of(Store(state, is_rehearsal=rehearsed), "coastal") / record.run.id
    place.mkdir(parents=True)
    with (place / SAMPLES_FILE).open("w", encoding="utf-8") as file:
        writer = SampleWriter(file)
        for sample in link.samples(now):
            writer(sample)
    write_run(place, record.run.model_copy(update={"emulated": emulated}))
    return place


def ask(state: Path, declaration: Inventory = SHIPPED) -> LinkRecordResult:
    request = Request(state=state, mode=Mode.DRIFT, rehearsed=False)
    ears = RealTransport(declaration, "coastal", request)
    heard: list[str] = []
    question = LinkRecordRequest("record", "coastal", "satellite")
    found = asyncio.run(ears.ask(Place.LAPTOP, None, [("key", question)], lambda key, _: heard.append(key)))
    assert heard == ["key"]
    result = found["key"]
    assert isinstance(result, LinkRecordResult)
    return result


def test_newest_real_measurement_is_judged_from_its_samples(tmp_path: Path) -> None:
    assert ask(tmp_path).record is None
    put(tmp_path, replace(SATELLITE, age=timedelta(days=3)), rehearsed=True)
    put(tmp_path, replace(SATELLITE, age=timedelta(hours=1)), emulated=True)
    put(tmp_path, replace(SATELLITE, name="4g", kind=LinkKind.LTE))
    assert ask(tmp_path).record is None, "nothing of it is a real measurement of this link"
    put(tmp_path, replace(SATELLITE, age=timedelta(days=9)))
    newest = put(tmp_path, replace(SATELLITE, age=timedelta(days=2), slower=1.2))
    good = SATELLITE.record("coastal", datetime.now(UTC))
    (newest / RECORD_FILE).write_bytes(record_json(good))
    record = ask(tmp_path).record
    assert record is not None
    assert record.run.id == newest.name
    assert record.verdict is Verdict.FAIL, "a file of figures proves nothing"
    (newest / "run.json").write_text("{}")
    broken = ask(tmp_path)
    assert broken.trouble is Trouble.MISSING
    assert "is damaged" in broken.words


def test_measurement_is_judged_by_the_current_inventory(tmp_path: Path) -> None:
    put(tmp_path, SATELLITE)
    assert ask(tmp_path).record is not None
    site = SHIPPED.sites["coastal"]
    stricter = tuple(
        bearer.model_copy(update={"qualify": bearer.qualify.model_copy(update={"ftd_s": 0.1})})
        for bearer in site.bearers
    )
    declaration = replace(SHIPPED, sites={**SHIPPED.sites, "coastal": site.model_copy(update={"bearers": stricter})})
    record = ask(tmp_path, declaration).record
    assert record is not None
    assert record.verdict is Verdict.FAIL
    assert record.thresholds_name == "satellite, with its own ftd_s"
    assert record.run.thresholds_name == "satellite"


def test_rehearsal_passes_no_link() -> None:
    """What is made up shows a fault; it never passes, and is evidence of nothing."""
    world = healthy(SHIPPED, "coastal")
    world.link("4g", age=timedelta(days=60))
    world.link("wifi-ptp", slower=1.5)
    request = Request(state=Path("/EXAMPLE"), mode=Mode.DRIFT, rehearsed=True)
    ears = RehearsedTransport(RealTransport(SHIPPED, "coastal", request), None, (), "coastal", world.links)
    for link, code in (("satellite", "not-measured"), ("4g", "stale"), ("wifi-ptp", "beyond-the-limit")):
        probe = item(declared(), link).probe
        assert probe is not None
        (question,) = probe.asks()
        found = asyncio.run(ears.ask(Place.LAPTOP, None, [("key", question)], lambda *_: None))
        result = probe.judge({"record": found["key"]})
        assert [each.code for each in result.findings] == [code]
        assert result.evidence == ()
        if code == "not-measured":
            assert result.verdict is Verdict.SKIP
            assert result.findings[0].message == "satellite was not measured: a checklist rehearsal measures no link"
        else:
            assert result.findings[0].hint == f"`provision measure link site=coastal link={link}` measures it", (
                "none is kept"
            )


def test_simulated_measurement_passes_for_every_kind_of_link() -> None:
    for kind in LinkKind:
        assert MeasuredLink("EXAMPLE", kind).record("coastal", NOW).verdict is Verdict.PASS
