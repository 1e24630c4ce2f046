"""A plan that is saved and carried out later: that plan and no other, or nothing."""

import json
import re
from pathlib import Path
from typing import Any

import preforked
import pytest
from hints_said import advised
from quay import ROUTER, Quay, fresh_quay
from terminal import terminal
from waiting import HANG_S

pytestmark = [pytest.mark.slow, pytest.mark.namespace]
at = pytest.fixture(fresh_quay)


@pytest.fixture
def plan(at: Quay, tmp_path: Path) -> Path:
    file = tmp_path / "coastal.plan"
    done = at.provision("plan", "site=coastal", "--save", str(file), code=2)
    said = re.sub(r" \\\n +", " ", done.stdout)  # as a shell reads a long command
    assert f"next      provision plan apply {file} inventory={at.inventory}\n" in said
    return file


@pytest.mark.smoke
def test_saved_plan_is_applied_completely(at: Quay, plan: Path) -> None:
    assert plan.stat().st_mode & 0o777 == 0o600
    assert "+ add address=10.64.1.1/24" in json.loads(plan.read_text())["text"]
    told = at.json("plan", "apply", str(plan), "--yes", code=0)
    assert told["devices"][ROUTER]["status"] == "changed"
    assert at.json("plan", "site=coastal", code=0)["devices"][ROUTER]["planned"] == 0


def test_plan_is_refused_when_the_device_has_changed(at: Quay, plan: Path) -> None:
    at.do("console", words=["/system/identity/set", "=name=somebody-was-here"])
    before = at.export()
    done = at.provision("plan", "apply", str(plan), "--yes", code=4)
    assert f"nothing was changed: {ROUTER} changed since the plan was saved" in done.stderr
    assert at.export() == before
    (again,) = advised(done.stderr)
    at.provision(*again, code=2)
    at.provision("plan", "apply", str(plan), "--yes", code=0)


def test_device_already_as_planned_is_unchanged(at: Quay, plan: Path) -> None:
    at.provision("plan", "apply", str(plan), "--yes", code=0)
    after = at.export()
    told = at.json("plan", "apply", str(plan), "--yes", code=0)["devices"][ROUTER]
    assert (told["status"], told["planned"]) == ("unchanged", 0)
    assert at.export() == after


def test_saved_plan_is_shown_without_contacting_a_device(at: Quay, plan: Path) -> None:
    kept = json.loads(plan.read_text())
    at.door.port = 0
    assert at.provision("plan", "apply", str(plan), "--plan", code=0).stdout == f"{kept['text'].rstrip()}\n"
    assert at.json("plan", "apply", str(plan), "--plan", code=0)["plans"] == kept["plans"]


def test_plan_is_refused_when_the_inventory_has_changed(at: Quay, plan: Path) -> None:
    before = at.export()
    file = at.inventory / "group_vars" / "all" / "pilot.yml"
    file.write_text(file.read_text() + "\n# a word\n")
    done = at.provision("plan", "apply", str(plan), "--yes", code=3)
    assert "the inventory has changed since the plan" in done.stderr
    (again,) = advised(done.stderr)
    assert at.export() == before
    at.provision(*again, code=2)
    at.provision("plan", "apply", str(plan), "--yes", code=0)


def test_without_consent_nothing_is_changed(at: Quay, plan: Path) -> None:
    before = at.export()
    assert "--yes" in at.provision("plan", "apply", str(plan), code=3).stderr
    assert at.export() == before
    assert "not confirmed; nothing was changed" in at.typed("plan", "apply", str(plan), answer="no", code=4)
    assert at.export() == before
    assert "[OK] DONE" in at.typed("plan", "apply", str(plan), answer="yes", code=0)


@pytest.mark.parametrize(
    "text",
    ["", "{}", "[]", '{"format": "atlantis-plan-1"}', '{"format": "atlantis-plan-1", "site": "coastal"}', "\xff"],
)
def test_file_that_is_no_plan_is_refused_and_not_overwritten(at: Quay, tmp_path: Path, text: str) -> None:
    file = tmp_path / "x"
    file.write_text(text, encoding="latin-1")
    why = "is not a plan of this version" if text[:1] in {"{", "["} else "is not a saved plan"
    assert why in at.provision("plan", "apply", str(file), code=3).stderr
    done = at.provision("plan", "site=coastal", "--save", str(file), code=3)
    assert "`: the file exists and is not a saved plan" in done.stderr
    assert file.read_text(encoding="latin-1") == text


EDITS: list[tuple[dict[str, Any], int]] = [
    ({"plans": {ROUTER: "0" * 64}}, 3),
    ({"plans": {}}, 3),
    ({"text": "nothing is changed"}, 3),
    ({"via": "4g"}, 3),
    ({"plans": {ROUTER: 1}}, 3),
    ({"rehearsed": "no"}, 3),
    ({"only": None}, 3),
]


def test_edited_plan_is_not_applied(at: Quay, plan: Path) -> None:
    before = at.export()
    kept = json.loads(plan.read_text())
    for edit, code in EDITS:
        plan.write_text(json.dumps({**kept, **edit}))
        assert at.provision("plan", "apply", str(plan), "--yes", code=code).stderr
    assert at.export() == before


def test_incomplete_plan_is_not_saved(at: Quay, tmp_path: Path) -> None:
    at.door.port = 0
    done = at.provision("plan", "site=coastal", "--save", str(tmp_path / "x"), code=4)
    assert not (tmp_path / "x").exists()
    assert "provision plan apply" not in done.stdout


def test_plan_options_suggest_the_plan_command(at: Quay, tmp_path: Path) -> None:
    before = at.export()
    said = at.provision("site=coastal", "--save", str(tmp_path / "x"), "--yes", code=3).stderr
    assert f"did you mean `provision plan site=coastal --save {tmp_path / 'x'} " in said
    said = at.provision("site=coastal", "--summary", "--yes", code=3).stderr
    assert "did you mean `provision plan site=coastal --summary " in said
    done = at.provision("plan", "site=coastal", "--save", str(tmp_path / "no" / "x"), code=3)
    assert "no such folder: " in done.stderr
    assert at.export() == before


def test_a_summary_has_the_cost_without_the_rows(at: Quay) -> None:
    done = at.provision("plan", "site=coastal", "--summary", code=2)
    assert "184 changes over lan" in done.stdout
    assert "+ add" not in done.stdout
    assert "plan      153 rows to add, 31 to change, 0 to remove" in done.stdout


def test_long_plan_is_paged_on_a_terminal(at: Quay) -> None:
    for pager, pages in (("less", True), ("cat", False), ("no-such-pager-anywhere", False)):
        environment = {**at.environment(), "TERM": "xterm", "PAGER": pager}
        with terminal() as seen:
            seen.press("q" if pages else "")
            words = ["plan", "site=coastal", f"device={ROUTER}", f"inventory={at.inventory}"]
            assert preforked.start(words, environment, seen.descriptor, at.inventory.parent).wait(HANG_S) == 2
        text = "\n".join(seen.lines)
        assert "[~] PLANNED: 1 device would change" in text
        assert ("/ip firewall filter" in text) is not pages, pager  # a person has left at the first page
        assert "/system clock" in text
        assert "~ name: MikroTik → coastal-router".encode() in seen.raw


def test_rehearsed_plan_is_applied_only_in_a_rehearsal(at: Quay, tmp_path: Path) -> None:
    file, before = tmp_path / "x", at.export()
    at.provision("plan", "site=coastal", "--rehearse", "--save", str(file), code=2)
    done = at.provision("plan", "apply", str(file), code=0)
    words = " ".join(done.stdout.split())
    assert "[OK] REHEARSED: emulated devices were changed to match the inventory, and read back" in words
    assert "next      provision check site=coastal" in done.stdout
    assert at.export() == before
