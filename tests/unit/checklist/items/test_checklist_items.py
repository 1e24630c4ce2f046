"""Items that the pilot declares: asked in their order, by whom and with what is declared, and green only when it is."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest
from checklist_bench import HEAD, Clock, open_items, pages

from atlantis_netcfg.checklist import (
    Answers,
    AnswersInvalid,
    Checklist,
    ChecklistSession,
    ChecklistUsageError,
    Confirmation,
    Scope,
    plan,
    report,
)
from atlantis_netcfg.checklist.probes import CommandResult, RunProgram, Trouble
from atlantis_netcfg.checklist.probes.base import Place
from atlantis_netcfg.checklist.probes.items import ExpectedLine
from atlantis_netcfg.checklist.report import ItemKind, Phase
from atlantis_netcfg.core.errors import NoMatchError, UsageError
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.inventory.model import ChecklistSettings, Role, VehicleChecklist

ROOT = Path(__file__).parents[4]
NAME = "A. Technician"
BATTERY, PLUG, SWITCH, RINSED = (f"mares/items/{name}" for name in ("battery", "drain-plug", "kill-switch", "rinsed"))
ANTENNAS, LIGHTS, LOGGED = (f"coastal/items/{name}" for name in ("antennas", "lights", "logged-time"))
ONLY_ITEMS = ("items",)


@pytest.fixture(scope="module")
def shipped() -> Inventory:
    return load(ROOT / "inventory")


def _settings(declaration: Inventory, **changes: object) -> Inventory:
    site = declaration.sites["coastal"]
    settings = ChecklistSettings.model_validate({**site.checklist.model_dump(), **changes})
    sites = {**declaration.sites, "coastal": site.model_copy(update={"checklist": settings})}
    return replace(declaration, sites=sites)


def _mares(declaration: Inventory, *items: Mapping[str, object]) -> Inventory:
    """With these items in place of those that are shipped."""
    rows = [{"text": "It is well", "look_for": "it is so", "phase": "bench", **item} for item in items]
    own = VehicleChecklist.model_validate({"items": rows})
    vehicle = declaration.vehicles["mares"].model_copy(update={"checklist": own})
    return replace(declaration, vehicles={**declaration.vehicles, "mares": vehicle})


def _ids(declaration: Inventory, **scope: object) -> list[str]:
    return [entry.item.id for entry in plan(declaration, "coastal", Scope(**scope)).entries]  # type: ignore[arg-type]


def _book(checklist: Checklist, folder: Path) -> ChecklistSession:
    return ChecklistSession.open(folder / "real" / "coastal" / "checks", checklist, HEAD, now=Clock())


def test_items_keep_their_order_after_the_columns_of_their_row(shipped: Inventory) -> None:
    assert _ids(shipped, endpoints=ONLY_ITEMS) == [BATTERY, PLUG, SWITCH, ANTENNAS]
    of_mares = _ids(shipped, vehicles=("mares",))
    assert of_mares[-3:] == [BATTERY, PLUG, SWITCH]
    assert of_mares[0] == "mares/wifi"
    other = _mares(shipped, {"id": "b"}, {"id": "a"})
    assert _ids(other, vehicles=("mares",), endpoints=ONLY_ITEMS) == ["mares/items/b", "mares/items/a"]


def test_site_item_may_belong_to_a_vehicle(shipped: Inventory) -> None:
    rows = [{"id": "hmi", "vehicle": "eca-rov", "text": "Its screen is on", "look_for": "it is", "phase": "quay"}]
    assert _ids(_settings(shipped, items=rows), vehicles=("eca-rov",), endpoints=ONLY_ITEMS) == ["eca-rov/items/hmi"]
    assert _ids(shipped, mission="inspection", vehicles=("eca-rov",))[-1] == "eca-rov/items/tether"
    assert "eca-rov/items/tether" not in _ids(shipped)


def test_mission_adds_items_and_removes_none(shipped: Inventory) -> None:
    without, listed = plan(shipped, "coastal"), plan(shipped, "coastal", Scope(mission="night"))
    more = {entry.item.id for entry in listed.entries} - {entry.item.id for entry in without.entries}
    assert more == {LIGHTS, LOGGED}
    assert listed.left_out == ()
    assert "with the items of mission night: Test after sunset" in listed.notes
    assert "no mission given; `mission=NAME` adds the items of a mission: night, inspection" in without.notes
    kinds = {entry.item.id: entry.item.kind for entry in listed.entries}
    assert (kinds[LIGHTS], kinds[LOGGED]) == (ItemKind.PERSON, ItemKind.AUTOMATIC)
    with pytest.raises(NoMatchError, match="unknown mission `nigth`"):
        plan(shipped, "coastal", Scope(mission="nigth"))


def test_recovery_is_a_separate_list(shipped: Inventory) -> None:
    first, after = plan(shipped, "coastal"), plan(shipped, "coastal", Scope(phases=(Phase.RECOVERY,)))
    assert RINSED not in {entry.item.id for entry in first.entries}
    assert RINSED in first.beyond
    assert (
        "1 item of recovery is still to come, in a separate checklist, when the vehicles are back: `provision "
        "check site=coastal phase=recovery`"
    ) in first.notes
    assert [entry.item.id for entry in after.entries] == [RINSED]
    assert BATTERY in after.beyond
    assert (after.columns, after.left_out, after.notes) == ((), (), ())
    assert [(row.key, row.table3, row.beside) for row in after.rows] == [("mares", (), ("items",))]


def test_recovery_cannot_be_mixed_with_other_phases(shipped: Inventory) -> None:
    with pytest.raises(UsageError, match="are a separate checklist") as error:
        plan(shipped, "coastal", Scope(phases=(Phase.QUAY, Phase.RECOVERY)))
    assert error.value.hint == "`provision check site=coastal phase=recovery` on its own, when the vehicles are back"
    with pytest.raises(NoMatchError, match="coastal has no such recovery item in the inventory"):
        plan(shipped, "coastal", Scope(vehicles=("sparus",), phases=(Phase.RECOVERY,)))


def test_recovery_is_signed_separately(shipped: Inventory, tmp_path: Path) -> None:
    with _book(plan(shipped, "coastal", Scope(vehicles=("mares",), endpoints=ONLY_ITEMS)), tmp_path) as book:
        book.confirm(BATTERY, Confirmation(Verdict.PASS, NAME, value=16.1))
        book.confirm(PLUG, Confirmation(Verdict.PASS, NAME))
        assert [item.id for item in open_items(book)] == [SWITCH], "what nobody has answered is open"
        assert int(book.document().exit) == 6
        book.confirm(SWITCH, Confirmation(Verdict.PASS, NAME))
        before = book.sign(NAME, pages)
    with _book(plan(shipped, "coastal", Scope(phases=(Phase.RECOVERY,))), tmp_path) as book:
        assert book.folder.name != before.run
        assert int(book.document().exit) == 6
        book.confirm(RINSED, Confirmation(Verdict.PASS, NAME))
        after = book.sign(NAME, pages)
    assert [(int(document.exit), document.signed is not None) for document in (before, after)] == [(0, True)] * 2


def test_each_mission_has_its_own_book(shipped: Inventory, tmp_path: Path) -> None:
    with _book(plan(shipped, "coastal", Scope(endpoints=ONLY_ITEMS)), tmp_path) as book:
        first = book.run
        book.confirm(PLUG, Confirmation(Verdict.PASS, NAME))
    night = plan(shipped, "coastal", Scope(endpoints=ONLY_ITEMS, mission="night"))
    with _book(night, tmp_path) as book:
        assert book.run != first
        assert book.item(PLUG).open
        assert book.document().mission == "night"
    with _book(plan(shipped, "coastal", Scope(endpoints=ONLY_ITEMS)), tmp_path) as book:
        assert (book.run, book.item(PLUG).open) == (first, False)


@pytest.mark.parametrize(
    ("value", "verdict", "refused"),
    [
        (16.1, Verdict.PASS, None),
        (14.8, Verdict.PASS, None),
        (16.8, Verdict.WARN, None),
        (14.7, Verdict.PASS, "14.7 V does not pass: required is a number in V, 14.8 to 16.8"),
        (17.0, Verdict.WARN, "17 V does not pass: required is a number in V, 14.8 to 16.8"),
        (None, Verdict.PASS, "required: a number in V, 14.8 to 16.8"),
        (12.0, Verdict.FAIL, None),
        (None, Verdict.FAIL, None),
        (None, Verdict.INCONCLUSIVE, None),
    ],
)
def test_number_passes_only_in_its_range(
    shipped: Inventory, tmp_path: Path, value: float | None, verdict: Verdict, refused: str | None
) -> None:
    note = "" if verdict is Verdict.PASS else "seen so"
    with _book(plan(shipped, "coastal", Scope(vehicles=("mares",))), tmp_path) as book:
        answer = Confirmation(verdict, NAME, note, value=value)
        if refused is not None:
            with pytest.raises(ChecklistUsageError) as error:
                book.confirm(BATTERY, answer)
            assert str(error.value) == f"`{BATTERY}`: {refused}"
            assert book.item(BATTERY).open
            return
        item = book.confirm(BATTERY, answer)
    assert item.verdict is verdict
    if value is not None:
        number = f"{value:g} V"
        assert item.evidence[0].value == (f"{number}; {note}" if note else number)
        assert item.message.endswith(item.evidence[0].value)
    assert item.evidence[1].value == "a number in V, 14.8 to 16.8"


def test_replaced_number_stays_in_the_report(shipped: Inventory, tmp_path: Path) -> None:
    with _book(plan(shipped, "coastal", Scope(vehicles=("mares",))), tmp_path) as book:
        for value in (15.0, 16.0):
            item = book.confirm(BATTERY, Confirmation(Verdict.PASS, NAME, value=value))
    assert [each.value for each in item.evidence] == ["16 V", "a number in V, 14.8 to 16.8", "PASS: 15 V"]


@pytest.mark.parametrize(("low", "high", "words"), [(3, None, "3 at least"), (None, 4.5, "4.5 at most")])
def test_a_range_with_one_end(
    shipped: Inventory, tmp_path: Path, low: float | None, high: float | None, words: str
) -> None:
    number = {"id": "bar", "evidence": "number", "unit": "bar", "min": low, "max": high}
    listed = plan(_mares(shipped, number), "coastal", Scope(vehicles=("mares",)))
    with _book(listed, tmp_path) as book:
        for value in (2.0, 5.0):
            outside = value < low if low is not None else value > (high or 0)
            if outside:
                with pytest.raises(ChecklistUsageError, match=f"does not pass: required is a number in bar, {words}"):
                    book.confirm("mares/items/bar", Confirmation(Verdict.PASS, NAME, value=value))
            else:
                assert book.confirm("mares/items/bar", Confirmation(Verdict.PASS, NAME, value=value)).verdict == "PASS"


def test_required_text_and_photo_cannot_be_omitted(shipped: Inventory, tmp_path: Path) -> None:
    (tmp_path / "list.txt").write_text("no picture")
    (tmp_path / "photo.png").write_bytes((ROOT / "tests" / "data" / "answers" / "failsafe.png").read_bytes())
    two = _mares(shipped, {"id": "serial", "evidence": "text"}, {"id": "ring", "evidence": "photo"})
    with _book(plan(two, "coastal", Scope(vehicles=("mares",))), tmp_path) as book:
        with pytest.raises(ChecklistUsageError, match="required: a note with what was seen"):
            book.confirm("mares/items/serial", Confirmation(Verdict.PASS, NAME, "  "))
        assert book.confirm("mares/items/serial", Confirmation(Verdict.PASS, NAME, "no 12")).verdict is Verdict.PASS
        for files in ((), (tmp_path / "list.txt",)):
            with pytest.raises(ChecklistUsageError, match="required: a photo"):
                book.confirm("mares/items/ring", Confirmation(Verdict.PASS, NAME, files=files))
        item = book.confirm("mares/items/ring", Confirmation(Verdict.PASS, NAME, files=(tmp_path / "photo.png",)))
    assert [each.what for each in item.evidence if each.file is not None] == ["photo.png"]


def test_unexpected_number_is_refused(shipped: Inventory, tmp_path: Path) -> None:
    with (
        _book(plan(shipped, "coastal", Scope(vehicles=("mares",))), tmp_path) as book,
        pytest.raises(ChecklistUsageError, match="this item takes no number"),
    ):
        book.confirm(PLUG, Confirmation(Verdict.PASS, NAME, value=3.0))


@pytest.fixture
def restricted(shipped: Inventory) -> Checklist:
    """Two may answer, one by a role; the safety officer alone signs."""
    roles = (Role(name="pilots", people=("B. Pilot",)), Role(name="safety", people=("C. Officer",)))
    pilot = shipped.pilot.model_copy(update={"roles": roles})
    declaration = _mares(shipped, {"id": "switch", "by": ["pilots", "D. Owner"]})
    settled = _settings(replace(declaration, pilot=pilot), signed_by=("safety",))
    return plan(settled, "coastal", Scope(vehicles=("mares",), endpoints=ONLY_ITEMS))


def test_only_authorised_people_answer_override_and_sign(restricted: Checklist, tmp_path: Path) -> None:
    name = "mares/items/switch"
    assert restricted.entries[0].item.message == "waits for one of B. Pilot, D. Owner"
    with _book(restricted, tmp_path) as book:
        with pytest.raises(ChecklistUsageError) as error:
            book.confirm(name, Confirmation(Verdict.PASS, NAME))
        assert str(error.value) == f"`{name}`: {NAME} may not answer: the inventory names others"
        assert error.value.hint == "it must be one of: B. Pilot, D. Owner"
        book.confirm(name, Confirmation(Verdict.FAIL, "b.  pilot", "it does not stop"))
        with pytest.raises(ChecklistUsageError, match="may not override it"):
            book.override(name, "it is late", NAME)
        assert book.override(name, "motors are off at the breaker", "D. Owner").counts is Verdict.WARN
        with pytest.raises(ChecklistUsageError, match=r"D\. Owner may not sign this checklist"):
            book.sign("D. Owner", pages)
        assert book.document().signed is None
        signed = book.sign("C. Officer", pages).signed
    assert signed is not None
    assert signed.by == "C. Officer"


ANSWERS = """\
name: A. Technician
answers:
  mares/items/switch: {verdict: PASS}
overrides:
  mares/items/switch: {reason: it is late, by: E. Guest}
sign: true
"""


def test_unauthorised_people_in_answers_are_reported_with_lines(restricted: Checklist, tmp_path: Path) -> None:
    file = tmp_path / "answers.yml"
    file.write_text(ANSWERS)
    with pytest.raises(AnswersInvalid) as error:
        Answers.read(file, restricted)
    assert [(each.line, each.message.partition(":")[0]) for each in error.value.findings] == [
        (3, "A. Technician may not answer"),
        (5, "E. Guest may not override it"),
        (6, "A. Technician may not sign this checklist"),
    ]


def test_answers_supply_required_evidence(shipped: Inventory, tmp_path: Path) -> None:
    listed = plan(shipped, "coastal", Scope(endpoints=ONLY_ITEMS))
    file = tmp_path / "answers.yml"
    file.write_text(
        f"name: A\nanswers:\n  {BATTERY}: {{verdict: PASS, value: 12}}\n"
        f"  {PLUG}: {{verdict: PASS, value: 1}}\n  {ANTENNAS}: {{verdict: PASS}}\n"
    )
    with pytest.raises(AnswersInvalid) as error:
        Answers.read(file, listed)
    assert [(each.line, each.message) for each in error.value.findings] == [
        (3, "12 V does not pass: required is a number in V, 14.8 to 16.8"),
        (4, "this item takes no number"),
        (5, "required: a photo"),
    ]
    file.write_text(f"name: A\nanswers:\n  {BATTERY}: {{verdict: PASS, value: 15.5}}\n")
    with _book(listed, tmp_path) as book:
        Answers.read(file, listed).write_down(book)
        assert book.item(BATTERY).evidence[0].value == "15.5 V"


def _ran(out: str = "", rc: int = 0, trouble: Trouble | None = None) -> CommandResult:
    return CommandResult(trouble, "no such program" if trouble else "", rc, out)


@pytest.mark.parametrize(
    ("expect", "ran", "verdict", "code"),
    [
        ("NTPSynchronized=yes", _ran("Timezone=UTC\n NTPSynchronized=yes \n"), "PASS", "line-found"),
        ("NTPSynchronized=*", _ran("NTPSynchronized=no\n"), "PASS", "line-found"),
        ("NTP=yes", _ran("NTPSynchronized=yes\nCanNTP=yes\n"), "FAIL", "line-missing"),
        ("N.P=yes", _ran("NTP=yes\n"), "FAIL", "line-missing"),
        ("NTPSynchronized=yes", _ran("NTPSynchronized=no\n"), "FAIL", "line-missing"),
        ("NTPSynchronized=yes", _ran(), "FAIL", "line-missing"),
        ("NTPSynchronized=yes", _ran("NTPSynchronized=yes\n", rc=1), "INCONCLUSIVE", "program-failed"),
        ("NTPSynchronized=yes", _ran(rc=1), "FAIL", "line-missing"),
        ("NTPSynchronized=yes", _ran(trouble=Trouble.MISSING), "INCONCLUSIVE", "program-missing"),
        ("NTPSynchronized=yes", _ran(trouble=Trouble.NO_PLACE), "INCONCLUSIVE", "not-asked"),
        ("NTPSynchronized=yes", _ran("NTPSynchronized=yes\n", trouble=Trouble.SILENT), "INCONCLUSIVE", "program-slow"),
    ],
)
def test_command_passes_if_expected_line_was_printed(expect: str, ran: CommandResult, verdict: str, code: str) -> None:
    probe = ExpectedLine(Place.GATEWAY, "timedatectl show", expect)
    assert probe.asks() == (RunProgram("output", Place.GATEWAY, ("timedatectl", "show")),)
    judged = probe.judge({"output": ran})
    assert (judged.verdict, [finding.code for finding in judged.findings]) == (verdict, [code])
    assert judged.evidence[0].value == expect


def test_nearest_line_is_shown_unless_it_is_from_a_file() -> None:
    shown = ExpectedLine(Place.GATEWAY, "timedatectl show", "NTPSynchronized=yes").judge(
        {"output": _ran("NTPSynchronized=no\nTimezone=UTC\n")}
    )
    assert [each.value for each in shown.evidence][1:] == ["NTPSynchronized=no"]
    file = ExpectedLine(Place.GATEWAY, "cat /etc/netplan/10-atlantis.yaml", "password: secret")
    for out in ("password: secrets\n", "password: secret\n"):
        assert len(file.judge({"output": _ran(out)}).evidence) == 1


def test_declared_items_are_on_every_page_and_counted(shipped: Inventory, tmp_path: Path) -> None:
    (tmp_path / "photo.png").write_bytes((ROOT / "tests" / "data" / "answers" / "failsafe.png").read_bytes())
    with _book(plan(shipped, "coastal", Scope(endpoints=ONLY_ITEMS, mission="night")), tmp_path) as book:
        book.confirm(BATTERY, Confirmation(Verdict.PASS, NAME, value=16.1))
        book.confirm(SWITCH, Confirmation(Verdict.FAIL, NAME, "it does not stop"))
        book.confirm(ANTENNAS, Confirmation(Verdict.PASS, NAME, files=(tmp_path / "photo.png",)))
        document = book.document()
        made = report.pages(document, book.files)
    text = report.lines(document)
    assert "Items         Mares FAIL, Coastal testbed OPEN\n" in text
    assert f"X FAIL         {SWITCH}: The kill switch stops the motors\n" in text
    assert f"+ PASS         {BATTERY}, {ANTENNAS}\n" in text
    assert "1 FAIL, 3 OPEN, 2 PASS; exit 6" in text
    assert max(map(len, text.splitlines())) <= 80
    root = ET.fromstring(made["junit.xml"])  # noqa: S314 - ours
    failed = {case.get("name") for case in root.iter("testcase") if case.find("failure") is not None}
    assert failed == {SWITCH, PLUG, LIGHTS, LOGGED}
    html = made["report.html"].decode()
    for words in ("The kill switch stops the motors", "16.1 V", "a number in V, 14.8 to 16.8", LOGGED, "mission"):
        assert words in html
    assert made["report.pdf"].startswith(b"%PDF-")


def test_recovery_page_has_its_items_and_no_table(shipped: Inventory, tmp_path: Path) -> None:
    with _book(plan(shipped, "coastal", Scope(phases=(Phase.RECOVERY,))), tmp_path) as book:
        book.confirm(RINSED, Confirmation(Verdict.PASS, NAME))
        document = book.document()
        made = report.pages(document, book.files)
    text = report.lines(document)
    assert "Items         Mares ok\n" in text
    assert "Girona" not in text
    assert "Acous." not in text
    assert "The vehicle was rinsed" in made["report.html"].decode()
    assert "when the vehicles are back" in made["report.html"].decode()
    assert made["report.pdf"].startswith(b"%PDF-")
