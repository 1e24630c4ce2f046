import contextlib
import re
from pathlib import Path

import inventory_cases
import pytest
from english_words import english_parts, without_names
from row_subtests import for_each_row

from atlantis_netcfg.core import language
from atlantis_netcfg.inventory import InventoryInvalid, load, validate
from atlantis_netcfg.inventory._schema import FALLBACK

KEPT = re.compile(r"\{[^}]*\}|(?<=controlador )at$", re.MULTILINE)
"""What stays as it is: a line of YAML to write, and `at`, the name of a driver."""
Case = tuple[Path, str]


@pytest.fixture(scope="module", params=inventory_cases.cases(), ids=lambda path: path.stem)
def case(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Case:
    path: Path = request.param
    folder = tmp_path_factory.mktemp(path.stem)
    inventory_cases.spoil(inventory_cases.load(path), folder)
    with contextlib.chdir(folder):
        return path, inventory_cases.told()


def test_findings_match_the_recorded_text(case: Case) -> None:
    path, text = case
    assert text == path.with_suffix(".txt").read_text(encoding="utf-8")


def test_findings_in_portuguese_have_no_english_word(case: Case, monkeypatch: pytest.MonkeyPatch) -> None:
    _, text = case
    monkeypatch.setattr(language, "_current_language", language.Language.PORTUGUESE)
    translation = language.translate(text)
    assert translation != text
    assert english_parts(KEPT.sub("…", without_names(translation))) == []


def test_at_least_60_cases_exist() -> None:
    assert len(inventory_cases.cases()) >= 60


def test_every_text_has_its_case() -> None:
    texts = {path.stem for path in inventory_cases.HERE.glob("*.txt")}
    assert texts == {path.stem for path in inventory_cases.cases()}


@for_each_row("path", sorted(inventory_cases.HERE.glob("*.txt")), ids=lambda path: path.stem)
def test_messages_contain_no_python_jargon(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    foreign = ("hunter2", "pydantic", "Input should", "yaml.", "Error", "Traceback", "NoneType", "None", "__", FALLBACK)
    assert [word for word in foreign if word in text] == []
    assert all(line.startswith("  -> ") and line.strip() != "->" for line in text.splitlines()[1:-1:2])


def test_shipped_inventory_is_valid(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(inventory_cases.SHIPPED.parent)
    assert validate(Path("inventory")) == []


def test_load_raises_the_findings_of_validate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    inventory = inventory_cases.spoil(
        {"why": "", "edits": [{"file": "group_vars/all/pilot.yml", "old": "country:", "new": "contry:"}]}, tmp_path
    )
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InventoryInvalid) as caught:
        load(inventory)
    assert list(caught.value.findings) == validate(Path("inventory"))
    assert [str(error).split(" ", 1)[0] for error in caught.value.errors] == [
        "inventory/group_vars/all/pilot.yml:12:3:"
    ]
