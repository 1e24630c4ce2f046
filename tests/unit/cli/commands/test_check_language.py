"""Whatever a person at the desk of a checklist sees passes the catalogue once; answers are kept as typed."""

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import pytest
from check_desk import LAMP, PING, RADIO, Sitting
from checklist_marks import marked, rest_of, without_marks

from atlantis_netcfg.checklist import PlanEntry
from atlantis_netcfg.cli.checklist.check_run import greet
from atlantis_netcfg.cli.checklist.workflow import Price, Prompt, PromptAbort
from atlantis_netcfg.links.cost import CostRefusal

WORDS = {"sparus/wifi": ["FAIL silent", "FAIL silent"], "sparus/usbl/ping": ["PASS answers"]}
VALUES = """
sparus wifi gps usbl ping FAIL PASS WARN INCONCLUSIVE SKIP
yes no but unclear skip back later again override on open seen pay y
it is spare green fog tom N A B site coastal nowhere jpg
"""
"""What is typed, ids, verdicts and the words to answer with, which have a table of their own."""


def paying(_entry: PlanEntry) -> Price:
    return Price("over satellite: 20 kB", due=True)


def refusing(_entry: PlanEntry) -> Price:
    raise CostRefusal("more than the cap", hint="raise it")


SITTINGS = [
    ["override", "it is spare", "site=coastal", "no", "N", "yes", "green", "", "yes", "yes", "pay"],
    ["again", "on", "no", "no", "no", "y", "", "fog", "N", "nowhere.jpg", "", "on", "no", "open"],
    ["on", "but", "back", "back", "on", "tom", "skip", "fog", "N" * 101, "N", "", "no", "seen", "yes", "", ""],
    ["back", "on", "unclear", "fog", "N", "", "override", "it is spare", "", "y", "yes", "no", "open"],
]


@pytest.mark.parametrize("typed", SITTINGS, ids=["well", "slips", "corrected", "overridden"])
@pytest.mark.parametrize("price", [paying, refusing])
def test_every_line_and_prompt_is_translated_once(
    typed: Sequence[str], price: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A script that ends early leaves the rest for later: what was said until then is looked at.
    sitting = Sitting(tmp_path, [*typed, *["later"] * 3], words={name: list(rows) for name, rows in WORDS.items()})
    sitting.price = price  # type: ignore[assignment] # one of the two above
    with marked(monkeypatch), sitting.book() as book:
        greet(sitting.desk, book)
        with suppress(PromptAbort):
            sitting.turn(book).with_a_person(sitting.desk)
    assert len(sitting.said) > 15
    rest = [line for line in sitting.said if rest_of(without_marks(line), VALUES)]
    assert [line for line in rest if "N" * 101 not in line] == []


def test_stored_answers_are_not_translated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sitting = Sitting(tmp_path, ["yes", "green", "N", ""], (LAMP,))
    with marked(monkeypatch):
        sitting.sit()
    (log,) = tmp_path.rglob("records.jsonl")
    assert "«" not in log.read_text(encoding="utf-8")
    assert "N has seen that it is in order: green" in log.read_text(encoding="utf-8")


def test_longer_translations_fit_the_screen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Questions with their choices; what devices say is as long as it is."""
    typed = ["on", "no", "y", "fog", "N", "", "on", "no", "open"]
    sitting = Sitting(tmp_path, typed, (RADIO, LAMP, PING), {"sparus/wifi": ["FAIL silent"]})
    with marked(monkeypatch, lambda text: text + "x" * (len(text) // 3)):
        sitting.sit()
    shown = [part for line in sitting.said for part in line.splitlines()]
    assert len(shown) > 3 * len(typed)
    assert [part for part in shown if len(part) > 80] == []


def test_long_message_is_indented() -> None:
    said: list[str] = []
    labels = f"  do        {'look ' * 20}\n  look for  {'it ' * 30}"
    Prompt(say=said.append).say(f"  {'FAIL':<12} sparus/wifi: {'far away ' * 12}\n{labels}")
    first, second, *steps = said[0].splitlines()
    assert first.startswith("  FAIL         sparus/wifi: far")
    assert second.startswith(f"{'':<15}away")
    assert [step[:12] for step in steps] == ["  do        ", f"{'':<12}", "  look for  ", f"{'':<12}"]
    assert max(map(len, said[0].splitlines())) <= 80
