"""`provision check` from its words to its end, with devices of which none answers."""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import pytest
from check_desk import pilot

from atlantis_netcfg.checklist import plan, report
from atlantis_netcfg.checklist.probes import Answer, Place, Question
from atlantis_netcfg.checklist.report import Document
from atlantis_netcfg.checklist.runner import OnAnswer
from atlantis_netcfg.checklist.runner.results import trouble_answer
from atlantis_netcfg.cli import main
from atlantis_netcfg.cli.base.syntax import parse
from atlantis_netcfg.cli.checklist import CHECK, check_run
from atlantis_netcfg.cli.checklist.check_run import CheckInterrupt, run_check
from atlantis_netcfg.cli.checklist.workflow import Listening, Prompt, price_of

if TYPE_CHECKING:
    from atlantis_netcfg.cli.base.session import CommandSession

ROV = ("site=coastal", "vehicle=eca-rov", "--rehearse")
"""One thing that a program looks at, and one that a person does."""
ANSWERS = """\
name: A. Technician
answers:
  eca-rov/usbl: {verdict: PASS, note: heard at 40 m}
overrides:
  eca-rov/ethernet: {reason: its cable is aboard}
sign: true
"""


class NobodyThere:
    def __init__(self) -> None:
        self.asked: list[str] = []

    async def ask(
        self,
        place: Place,  # noqa: ARG002 - of the protocol
        host: str | None,  # noqa: ARG002 - of the protocol
        questions: Sequence[tuple[str, Question]],
        heard: OnAnswer,  # noqa: ARG002 - of the protocol
    ) -> Mapping[str, Answer]:
        self.asked += [key for key, _ in questions]
        return {key: trouble_answer(question, "nobody is there") for key, question in questions}


class Twins:
    not_rehearsed = ("everything",)
    targets: Mapping[str, Any] = {}


@pytest.fixture
def ears(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> NobodyThere:
    """A rehearsal that starts nothing, of robots without files, and pages that nobody has to draw."""

    @contextmanager
    def nothing(*_: object) -> Iterator[Twins]:
        yield Twins()

    @contextmanager
    def nobody(*_: object) -> Iterator[Listening]:
        yield Listening(there, there)

    there = NobodyThere()
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path / "state"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("atlantis_netcfg.operations.common.rehearsal.rehearsal", nothing)
    without_robots = replace(pilot(), root=tmp_path)
    monkeypatch.setattr("atlantis_netcfg.inventory.load", lambda *_, **__: without_robots)
    monkeypatch.setattr(check_run, "listening", nobody)
    monkeypatch.setattr(report, "pages", lambda _document, _files: {"report.html": b"<p>page</p>"}, raising=False)
    return there


def told(capsys: pytest.CaptureFixture[str], *typed: str, code: int) -> dict[str, Any]:
    assert main(["check", *typed, "--json"]) == code
    said = capsys.readouterr()
    assert said.err == ""
    found: dict[str, Any] = json.loads(said.out)
    assert found["exit"] == code
    return found


def at_desk(*typed: str, words: Sequence[str] = ROV) -> tuple[int, str]:
    """Exit code, and what was said; what is typed last may be Ctrl+C."""
    rest, said = list(typed), list[str]()

    def ask(question: str) -> str:
        said.append(question)
        answer = rest.pop(0)
        if answer == "^C":
            raise KeyboardInterrupt
        return answer

    code = run_check(parse(CHECK, words), Prompt(ask, said.append))
    assert rest == []
    return int(code), "\n".join(said)


def test_json_mode_asks_nobody(ears: NobodyThere, capsys: pytest.CaptureFixture[str]) -> None:
    found = told(capsys, *ROV, code=6)
    assert found["signed"] is None
    assert found["errors"] == []
    assert found["scope"] == {"vehicle": ["eca-rov"]}
    assert {key for key in ears.asked if not key.startswith("eca-rov/ethernet#")} == set()
    rows = {row["id"]: row for row in found["items"]}
    assert rows["eca-rov/usbl"]["open"]
    assert not rows["eca-rov/ethernet"]["open"]
    assert rows["eca-rov/ethernet"]["verdict"] == "INCONCLUSIVE"
    wanted = {"id", "vehicle", "location", "endpoint", "table3", "kind", "verdict", "message", "evidence"}
    assert all(wanted <= row.keys() for row in rows.values())
    kept = {name: value for name, value in found.items() if name not in {"exit", "errors"}}
    assert Document.model_validate_json(json.dumps(kept)).exit == 6


@pytest.mark.usefixtures("ears")
def test_without_a_terminal_the_next_steps_are_shown(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["check", *ROV, "--anew"]) == 6
    said = capsys.readouterr()
    assert "eca-rov/ethernet" in said.err
    (folder,) = (tmp_path / "state" / "rehearsal" / "coastal" / "checks").glob("2*")
    last = said.out.splitlines()[-7:]
    assert last == [
        "? INCONCLUSIVE: The checklist has not passed, for vehicle=eca-rov only",
        "1 INCONCLUSIVE, 1 OPEN; exit 6; rehearsed",
        "eca-rov/ethernet: the gateway could not be queried: nobody is there",
        "  -> make the gateway reachable, then check again",
        "NOT SIGNED: 1 item is open. To continue and sign, run on a terminal:",
        f"  provision check {' '.join(ROV)}",
        f"report: {folder}/report.html",
    ]
    assert max(map(len, last[:-1])) <= 80
    assert (folder / "report.html").read_bytes() == b"<p>page</p>"


@pytest.mark.usefixtures("ears")
def test_answers_file_leads_to_a_signature(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "answers.yml").write_text(ANSWERS)
    assert told(capsys, *ROV, "--answers", "answers.yml", code=0)["signed"]["by"] == "A. Technician"
    assert main(["report", "verify", "site=coastal"]) == 0
    (report_file,) = (tmp_path / "state").rglob("report.json")
    report_file.write_bytes(report_file.read_bytes().replace(b"40 m", b"400 m"))
    assert main(["report", "verify", "site=coastal"]) == 6
    assert "report.json: was changed after" in capsys.readouterr().out


@pytest.mark.usefixtures("ears")
def test_invalid_answers_file_starts_nothing(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "answers.yml").write_text(ANSWERS.replace("eca-rov/usbl", "eca-rov/usb"))
    assert main(["check", *ROV, "--answers", "answers.yml"]) == 3
    assert "answers.yml:3:3: this checklist has no item `eca-rov/usb`" in capsys.readouterr().err
    assert not list((tmp_path / "state").rglob("records.jsonl"))


@pytest.mark.usefixtures("ears")
def test_checklist_with_open_items_is_not_signed(capsys: pytest.CaptureFixture[str]) -> None:
    found = told(capsys, *ROV, "--sign-as", "A. Technician", code=6)
    assert found["signed"] is None
    assert [error["message"] for error in found["errors"]] == ["1 of 2 items are open: eca-rov/usbl"]


@pytest.mark.usefixtures("ears")
def test_person_completes_the_checklist_and_signs(capsys: pytest.CaptureFixture[str]) -> None:
    code, said = at_desk("override", "spare cable", "N", "yes", "heard", "", "yes")
    assert code == 0
    assert "0 of 2 items are complete, 2 are open." in said
    assert "No item is open. Sign the checklist as it is?\n  Type yes (the whole word) to continue, or no: " in said
    out = capsys.readouterr().out
    assert "Signed by N" in out
    assert "Checklist of coastal" in said
    assert "Checklist of coastal" not in out, "who has just read it needs its end alone"


def test_worst_item_is_named_after_signing() -> None:
    bad: list[Any] = [SimpleNamespace(id="worst"), SimpleNamespace(id="other"), SimpleNamespace(id="third")]
    said = [check_run._begin_anew(bad[:count]).partition(", then")[0] for count in (1, 2, 3)]
    assert said == ["Fix worst", "Fix worst and 1 other", "Fix worst and 2 others"]


@pytest.mark.usefixtures("ears")
def test_checklist_is_left_for_later_and_resumed(capsys: pytest.CaptureFixture[str]) -> None:
    code, said = at_desk("override", "spare cable", "N", "later")
    assert (code, said.endswith("left for later")) == (6, True)
    assert "NOT SIGNED" in capsys.readouterr().out
    code, said = at_desk("yes", "", "N", "", "no")
    assert "1 of 2 items are complete, 1 are open." in said
    assert code == 0, "all is green, and nobody has signed"
    code, said = at_desk("later", words=[*ROV, "--anew"])
    assert (code, "0 of 2 items are complete, 2 are open." in said) == (6, True)


@pytest.mark.usefixtures("ears")
def test_later_at_the_signature_means_no(capsys: pytest.CaptureFixture[str]) -> None:
    assert at_desk("override", "spare cable", "N", "yes", "", "", "later")[0] == 0
    assert "NOT SIGNED" in capsys.readouterr().out


@pytest.mark.usefixtures("ears")
@pytest.mark.parametrize("kept", range(7))
def test_checklist_is_resumed_after_ctrl_c(kept: int) -> None:
    typed = ["override", "spare cable", "N", "yes", "heard", "", "yes"]
    with pytest.raises(CheckInterrupt) as stopped:
        at_desk(*typed[:kept], "^C")
    assert (stopped.value.exit, str(stopped.value)) == (
        4,
        "interrupted by Ctrl-C; results and answers so far are saved",
    )
    rest = ["yes", "N"] if kept == 6 else ["yes", "heard", "N", "", "yes"] if kept > 2 else typed
    code, said = at_desk(*rest)
    assert code == 0
    assert " is continued\n" in said


def test_allow_list_test_over_satellite_shows_its_price() -> None:
    (entry,) = [one for one in plan(pilot(), "coastal").entries if one.item.id == "coastal/satellite/allow-list"]
    rows = [
        (["site=coastal"], False, True),
        (["site=coastal", "--accept-cost"], False, False),
        (["site=coastal", "--rehearse"], True, False),
    ]
    for words, rehearsed, due in rows:
        opened = SimpleNamespace(
            inventory=pilot(), site="coastal", is_rehearsal=rehearsed, arguments=parse(CHECK, words)
        )
        price = price_of(cast("CommandSession", opened), entry)
        assert price is not None
        assert price.due is due
        assert re.fullmatch(r"over metered link satellite.* \d+\.\d\d EUR.*", price.words), price.words
