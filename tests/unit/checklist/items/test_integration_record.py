"""The integration record of one robot: a list by itself, with a signature and a page of its own."""

import json
import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest
from checklist_bench import HEAD, NAME, Clock

from atlantis_netcfg.checklist import Checklist, ChecklistSession, ChecklistUsageError, Confirmation, Scope, books, plan
from atlantis_netcfg.checklist.report import Document, ItemKind, Phase, lines, pages
from atlantis_netcfg.cli import main
from atlantis_netcfg.core.errors import ExitCode, NoMatchError, UsageError
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.inventory.model import VehicleChecklist

ROOT = Path(__file__).parents[4]
PROBED = ("vpn", "discovery", "booleans", "numbers", "pose", "gps", "images")
PEOPLE = ("ros1-bridge", "bag-record", "bag-replay", "plan", "commands")


def record_of(declaration: Inventory, vehicle: str) -> Checklist:
    return plan(declaration, "coastal", Scope(vehicles=(vehicle,), phases=(Phase.INTEGRATION,)))


def names(listed: Checklist, kind: ItemKind | None = None) -> list[str]:
    return [entry.item.id.partition("/integration/")[2] for entry in listed.entries if kind in {None, entry.item.kind}]


@pytest.fixture(scope="module")
def sparus(declaration: Inventory) -> Checklist:
    return record_of(declaration, "sparus")


def test_record_has_the_tested_items_and_nothing_of_table_3(sparus: Checklist) -> None:
    assert names(sparus, ItemKind.AUTOMATIC) == list(PROBED)
    assert names(sparus, ItemKind.PERSON) == list(PEOPLE)
    assert [(row.key, row.table3, row.beside) for row in sparus.rows] == [("sparus", (), ("integration",))]
    assert (sparus.columns, sparus.left_out, sparus.notes) == ((), (), ())
    assert {entry.item.phase for entry in sparus.entries} == {Phase.INTEGRATION}
    assert not [entry for entry in sparus.entries if entry.item.table3]


def test_kind_that_the_file_does_not_name_is_omitted(declaration: Inventory) -> None:
    rov = record_of(declaration, "eca-rov")
    assert names(rov, ItemKind.AUTOMATIC) == ["vpn", "discovery", "booleans", "numbers"]
    assert names(rov, ItemKind.PERSON) == ["pose", "video", *PEOPLE], "its pose goes through the library"


def test_pre_test_checklist_has_no_integration_items(declaration: Inventory) -> None:
    listed = plan(declaration, "coastal")
    assert not [entry for entry in listed.entries if entry.item.endpoint == "integration"]
    assert not [row for row in listed.rows if "integration" in row.beside]
    assert "sparus/integration/plan" in listed.beyond, "a file of answers may hold both"


@pytest.mark.parametrize(
    ("scope", "message"),
    [
        (Scope(phases=(Phase.INTEGRATION,)), "an integration record is for one robot"),
        (Scope(vehicles=("sparus", "zarco"), phases=(Phase.INTEGRATION,)), "an integration record is for one robot"),
        (
            Scope(vehicles=("sparus",), phases=(Phase.QUAY, Phase.INTEGRATION)),
            "the items of integration are a separate checklist",
        ),
        (Scope(phases=(Phase.QUAY, Phase.RECOVERY)), "the items of recovery are a separate checklist"),
    ],
)
def test_integration_is_planned_alone_and_for_one_robot(declaration: Inventory, scope: Scope, message: str) -> None:
    with pytest.raises(UsageError) as error:
        plan(declaration, "coastal", scope)
    assert str(error.value) == message
    assert error.value.hint


def test_robot_without_a_file_has_no_integration_record(declaration: Inventory, tmp_path: Path) -> None:
    inventory = Path(shutil.copytree(ROOT / "inventory", tmp_path / "inventory"))
    (inventory / "robots" / "sparus.yml").unlink()
    with pytest.raises(NoMatchError) as error:
        record_of(load(inventory), "sparus")
    assert str(error.value) == "`sparus` has no robot file, so it has no integration record"
    assert record_of(declaration, "sparus").entries


def test_faulty_file_gives_one_item_that_is_not_green(tmp_path: Path) -> None:
    inventory = Path(shutil.copytree(ROOT / "inventory", tmp_path / "inventory"))
    (inventory / "robots" / "sparus.yml").write_text("namespace: sparus\n")
    (entry,) = record_of(load(inventory), "sparus").entries
    assert (entry.item.id, entry.item.phase) == ("sparus/integration/discovery", Phase.INTEGRATION)
    assert entry.step.probe is not None
    assert entry.step.probe.judge({}).verdict is Verdict.INCONCLUSIVE


def test_custom_items_of_a_vehicle_are_included(declaration: Inventory) -> None:
    row = {"id": "label", "text": "Its label is on", "look_for": "it is", "phase": "integration"}
    own = VehicleChecklist.model_validate({"items": [row]})
    vehicle = declaration.vehicles["sparus"].model_copy(update={"checklist": own})
    more = replace(declaration, vehicles={**declaration.vehicles, "sparus": vehicle})
    listed = record_of(more, "sparus")
    assert listed.entries[-1].item.id == "sparus/items/label"
    assert [row.beside for row in listed.rows] == [("integration", "items")]
    assert "sparus/items/label" not in {entry.item.id for entry in plan(more, "coastal").entries}


ANSWERS = f"""\
name: {NAME}
answers:
  sparus/integration/ros1-bridge: {{verdict: SKIP, note: it speaks ROS 2}}
  sparus/integration/bag-record: {{verdict: PASS, note: sparus.db3 has 4200 messages}}
  sparus/integration/bag-replay: {{verdict: PASS, note: sparus.db3}}
  sparus/integration/plan: {{verdict: PASS, note: two steps off the quay}}
  sparus/integration/commands: {{verdict: PASS, note: all of them}}
sign: true
"""


@pytest.mark.parametrize(
    ("broken", "wrong"), [((), []), (("break=robot-topic-missing",), [("sparus/integration/booleans", "FAIL")])]
)
def test_rehearsed_record_is_signed_with_an_answers_file(
    broken: tuple[str, ...],
    wrong: list[tuple[str, str]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path / "state"))
    file = tmp_path / "answers.yml"
    file.write_text(ANSWERS)
    words = ("check", "site=coastal", "vehicle=sparus", "phase=integration", "--rehearse", "--json", *broken)
    code = main([*words, "--answers", str(file)])
    document = json.loads(capsys.readouterr().out)
    assert code == document["exit"] == (6 if wrong else 0)
    assert document["signed"]["by"] == NAME
    verdicts = [(item["id"], item["verdict"]) for item in document["items"]]
    assert len(verdicts) == len(PROBED) + len(PEOPLE)
    bridge = ("sparus/integration/ros1-bridge", "SKIP")
    assert [pair for pair in verdicts if pair[1] != "PASS"] == [*wrong, bridge]
    assert "-token" not in json.dumps(document)


def made(document: Document) -> Mapping[str, bytes]:
    return pages(document, {})


def test_record_is_signed_separately_and_has_its_own_page(sparus: Checklist, tmp_path: Path) -> None:
    folder = tmp_path / "real" / "coastal" / "checks"
    with ChecklistSession.open(folder, sparus, HEAD, now=Clock()) as book:
        for entry in sparus.entries:
            if entry.item.kind is ItemKind.AUTOMATIC:
                book.settle(entry.item.model_copy(update={"verdict": Verdict.PASS, "message": "heard"}))
        with pytest.raises(ChecklistUsageError, match="required: a note with what was seen"):
            book.confirm("sparus/integration/plan", Confirmation(Verdict.PASS, NAME))
        for name in PEOPLE:
            bridge = name == "ros1-bridge"
            verdict, note = (Verdict.SKIP, "it speaks ROS 2") if bridge else (Verdict.PASS, "seen")
            book.confirm(f"sparus/integration/{name}", Confirmation(verdict, NAME, note))
        document = book.sign(NAME, made)
        page = (book.folder / "report.html").read_text()
        assert (book.folder / "report.pdf").stat().st_size
    assert document.exit is ExitCode.DONE
    assert document.scope == {"vehicle": ("sparus",), "phase": ("integration",)}
    assert ">Integration record: Sparus, Coastal testbed</h1>" in page
    assert "<title>PASS: Integration record of Sparus, run" in page
    assert "requirement" not in page, "no inventory declares it"
    assert "Girona" not in lines(document)
    (kept,) = books(folder)
    assert kept.document == document


@pytest.mark.parametrize(
    ("fault", "message", "hint"),
    [
        (
            "robot-frozen",
            "`break=robot-frozen` does not affect sparus",
            "it belongs to the record of `vehicle=mares`",
        ),
        ("rogue-dhcp", "`break=rogue-dhcp` does not affect sparus", "it belongs to the site's checklist"),
    ],
)
def test_fault_that_cannot_affect_the_robot_is_refused(
    fault: str, message: str, hint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["vehicle=sparus", "phase=integration", f"break={fault}", "--rehearse"]
    assert main(["check", "site=coastal", *words]) == ExitCode.USAGE
    said = " ".join(capsys.readouterr().err.split())
    assert message in said
    assert hint in said
