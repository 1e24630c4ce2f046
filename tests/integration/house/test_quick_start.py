"""The quick start alone leads from a fresh clone to a signed checklist: each line that it shows is typed as it stands.

The clone finds the packages of the shared checkout, which the launcher has fetched for test_first_start.py, and makes
them its own as it does in a checkout that was moved.
For a machine of the gateway the rehearsal would make a Debian; tests/integration/emulator/lab does that.
"""

import json
import shutil
import subprocess
from pathlib import Path

import pytest
from docs_console import Shown, shown
from docs_terminal import at_a_terminal
from house_checkout import ROOT, clean_environment, copy_of_checkout, shared_checkout

ENGLISH = ROOT / "docs" / "quick-start.md"
PORTUGUESE = ROOT / "docs" / "pt" / "inicio-rapido.md"
STEPS = (
    "git clone",
    "provision help version",
    "provision inventory validate",
    "provision plan",
    "--rehearse",
    "provision check",
)


@pytest.fixture
def address(tmp_path: Path) -> str:
    """A repository with the files of this checkout, to be cloned."""
    place = copy_of_checkout(tmp_path / "published")
    name = ("-c", "user.name=Test", "-c", "user.email=test@example.org", "-c", "commit.gpgsign=false")
    for words in (("init", "--quiet"), ("add", "--all"), (*name, "commit", "--quiet", "-m", "as it is")):
        subprocess.run(["git", *words], cwd=place, check=True, env=clean_environment(HOME=str(tmp_path)))
    return str(place)


@pytest.mark.slow
def test_the_page_leads_from_a_fresh_clone_to_a_signed_checklist(
    address: str, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    fetched = shared_checkout(tmp_path_factory)
    home, place = tmp_path / "home", tmp_path / "home"
    home.mkdir()
    environment = clean_environment(HOME=str(home), TERM="dumb", COLUMNS="80")
    for command in shown(ENGLISH):
        if command.command.startswith("cd "):
            place /= command.command.removeprefix("cd ")
            for name in (".venv", ".venv-setup"):
                shutil.copytree(fetched / name, place / name, symlinks=True)
            continue
        code, seen = at_a_terminal(with_address(command, address), place, environment)
        assert code == command.exit, f"{command.place}: $ {command.command}\nexit {code}\n{seen}"
        assert command.agrees(seen), f"{command.place}: $ {command.command}\n{seen}\nshown:\n{command.output}"
    is_signed(place, home)


def with_address(command: Shown, address: str) -> Shown:
    """The one word of the page that everybody replaces."""
    words = command.command.replace("ADDRESS", f"'{address}'")
    return Shown(command.place, words, command.exit, command.output, command.compared, command.answers)


def is_signed(place: Path, home: Path) -> None:
    """By the files themselves: a signed document of a rehearsal, its pages, and the verdict of `report verify`."""
    reports = list((home / ".local" / "state" / "atlantis").rglob("report.json"))
    assert len(reports) == 1
    document = json.loads(reports[0].read_text())
    assert document["rehearsed"] is True
    assert document["signed"]["by"] == dict(shown(ENGLISH)[-2].answers)["Your name"]
    assert all((reports[0].parent / name).stat().st_size > 0 for name in ("report.html", "report.pdf"))
    verify = [str(place / "provision"), "report", "verify", "site=coastal", "--json"]
    process = subprocess.run(verify, env=clean_environment(HOME=str(home)), capture_output=True, text=True, check=True)
    assert [row["troubles"] for row in json.loads(process.stdout)["verified"]] == [[]]


def test_steps_are_in_order() -> None:
    commands = [command.command for command in shown(ENGLISH)]
    found = [next(number for number, command in enumerate(commands) if step in command) for step in STEPS]
    assert found == sorted(found)
    assert "report verify" in commands[-1]


def test_the_portuguese_page_shows_the_same_commands() -> None:
    english, portuguese = shown(ENGLISH), shown(PORTUGUESE)
    assert [(each.command, each.exit) for each in english] == [(each.command, each.exit) for each in portuguese]
    assert [typed(each) for each in english] == [typed(each) for each in portuguese]
    assert all(
        question.startswith(asked)
        for each, other in zip(english, portuguese, strict=True)
        for (asked, _), (question, _) in zip(each.answers, other.answers, strict=True)
    )


def typed(command: Shown) -> list[str]:
    return [answer for _, answer in command.answers]


@pytest.mark.parametrize(
    ("script", "code", "fails"),
    [
        ('read -p "Your name: " a; echo "[$a]"', 0, ""),
        ('printf "\\nYour name: \\n  (in full)"; read a; echo "[$a]"', 0, ""),
        ("exit 3", 3, "never asked"),
        ('read -p "Your name: " a; read -p "Other: " b', 0, "it waits"),
    ],
)
def test_terminal_helper_waits_for_the_prompt(
    script: str, code: int, fails: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("docs_terminal.ANSWER_S", 2)
    command = Shown("page.md:1", script, code, "", compared=True, answers=(("Your name", "A. B."),))
    if fails:
        with pytest.raises(AssertionError, match=fails):
            at_a_terminal(command, tmp_path, clean_environment())
    else:
        ended, seen = at_a_terminal(command, tmp_path, clean_environment())
        assert (ended, seen.splitlines()[-1]) == (code, "[A. B.]")
