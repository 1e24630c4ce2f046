"""The first fifteen minutes at a terminal of 80 by 24, in both languages, by an ordinary user.

The command of the README, those of the quick start up to the verified signature, and every command that one of them
names as the next, each typed as it was printed.
"""

import os
import re
import shlex
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import pyte
import pytest
from docs_console import Shown, shown
from docs_terminal import at_a_terminal
from english_words import english_parts, without_names
from house_checkout import NOBODY, ROOT, as_nobody, clean_environment, let_others_pass, shared_checkout

ROWS, COLUMNS = 24, 80
PAGES = {"en": ROOT / "docs" / "quick-start.md", "pt": ROOT / "docs" / "pt" / "inicio-rapido.md"}
LOCALES = {"en": "C.UTF-8", "pt": "pt_PT.UTF-8"}
NEXT = {"en": "next", "pt": "a seguir"}
DO = {"en": "do", "pt": "fazer"}
MOST_COMMANDS = 12
"""A walk that needs more goes round in a circle."""
NOT_UNDERSTOOD = re.compile(
    r"not found|unknown (argument|option|command)|não encontrad|(argumento|opção|comando) desconhecid", re.IGNORECASE
)
ESCAPE = re.compile(r"\x1b(\[[0-9;?]*[A-Za-z]|\][^\x07]*\x07|[=>])")


@dataclass
class Walk:
    """What a person saw: the lines that stayed on the terminal after each command, in the order of the commands."""

    language: str
    home: Path
    checkout: Path
    screens: dict[str, list[str]] = field(default_factory=dict)

    def environment(self) -> Mapping[str, str]:
        """Without the word that keeps rehearsals of tests from making machines: an ordinary user makes none."""
        words = {"HOME": str(self.home), "LANG": LOCALES[self.language], "TERM": "xterm-256color", "PAGER": "cat"}
        return {name: word for name, word in clean_environment(**words).items() if name != "ATLANTIS_NO_MACHINES"}

    def run(self) -> None:
        """Type all commands; after each one first those that it names."""
        waiting = first_commands(self.language)
        known = {each.command: each for each in waiting}
        while waiting:
            command = waiting.pop(0)
            if command.command not in self.screens:
                self.type(command)
                assert len(self.screens) <= MOST_COMMANDS, list(self.screens)
                for text in labelled(self.screens[command.command], NEXT[self.language]):
                    unknown = Shown(f"next of {command.command}", text, 0, "", compared=False)
                    waiting.insert(0, known.setdefault(text, unknown))

    def type(self, command: Shown) -> None:
        by_a_user = replace(command, command=shlex.join([*as_nobody(), "bash", "-c", command.command]))
        code, text = at_a_terminal(by_a_user, self.checkout, self.environment(), ROWS, COLUMNS)
        assert code == command.exit, f"{command.command}\n{text}"
        assert [line for line in written_lines(text, command) if is_too_long(line)] == [], command.command
        self.screens[command.command] = remaining_lines(text)

    def whole(self) -> str:
        return "\n".join(line for lines in self.screens.values() for line in lines)


def first_commands(language: str) -> list[Shown]:
    page = [each for each in shown(PAGES[language]) if not each.command.startswith(("git clone", "cd "))]
    page = [replace(each, answers=tuple((asked(row[0], language), row[1]) for row in each.answers)) for each in page]
    readme = next(each for each in shown(ROOT / "README.md") if "--rehearse" in each.command)
    return [readme, *page]


def asked(question: str, language: str) -> str:
    """The question as it is asked; the Portuguese page shows both: `Note (Nota)`."""
    return question if language == "en" else question.partition("(")[2].removesuffix(")")


def written_lines(text: str, command: Shown) -> Iterator[str]:
    """The lines as the program wrote them: a line that was drawn over in its last state, without the typed answer."""
    for line in ESCAPE.sub("", text).split("\n"):
        last = line.rstrip("\r").rpartition("\r")[2]
        answer = next((typed for _, typed in command.answers if typed and last.endswith(f": {typed}")), "")
        yield last.removesuffix(answer).rstrip(" ")


def is_too_long(line: str) -> bool:
    """Whether the terminal breaks this line although there is a blank at which the program could."""
    return len(line) > COLUMNS and " " in line.strip()


def remaining_lines(text: str) -> list[str]:
    """The lines that a person sees in the end: progress that was drawn over is gone."""
    screen = pyte.HistoryScreen(COLUMNS, ROWS, history=2000, ratio=1)
    pyte.Stream(screen).feed(text.replace("\n", "\r\n"))
    above = ["".join(line[column].data for column in range(COLUMNS)) for line in screen.history.top]
    lines = [line.rstrip() for line in (*above, *screen.display)]
    return lines[: max((place for place, line in enumerate(lines, 1) if line), default=0)]


def labelled(lines: list[str], label: str) -> Iterator[str]:
    """The text behind a label of the last lines of a run, its continuation lines included."""
    for place, line in enumerate(lines):
        if line.startswith(f"{label} "):
            below = lines[place + 1 :]
            more = below[: next((number for number, each in enumerate(below) if each[:1] != " "), len(below))]
            yield "\n".join([line.removeprefix(label).strip(), *(each.strip() for each in more)])


def untranslated_parts(text: str, typed: Iterable[str]) -> list[str]:
    """Where English stands; the terminal may have broken what was typed."""
    words = " ".join(without_names(text).split())
    for answer in typed:
        words = re.sub(" ?".join(map(re.escape, answer)), "…", words)
    return english_parts(words)


@pytest.fixture(scope="module", params=["en", "pt"])
def walk(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Walk:
    checkout = shared_checkout(tmp_path_factory)
    home = tmp_path_factory.mktemp("home")
    let_others_pass(checkout / "below")
    if as_nobody():
        os.chown(home, NOBODY, NOBODY)
        let_others_pass(home)
    result = Walk(request.param, home, checkout)
    result.run()
    return result


pytestmark = pytest.mark.slow


def test_the_walk_ends_with_a_verified_signature(walk: Walk) -> None:
    *_, last = walk.screens
    assert "report verify" in last
    assert "A. Technician" in "\n".join(walk.screens[last])


def test_every_next_command_is_understood(walk: Walk) -> None:
    following = [text for lines in walk.screens.values() for text in labelled(lines, NEXT[walk.language])]
    assert len(following) >= 2
    assert set(following) <= set(walk.screens)
    assert NOT_UNDERSTOOD.search(walk.whole()) is None


def test_no_action_is_cut(walk: Walk) -> None:
    labels = (NEXT[walk.language], DO[walk.language])
    actions = [text for lines in walk.screens.values() for label in labels for text in labelled(lines, label)]
    assert [text for text in actions if "…" in text] == []


def test_a_rehearsal_fits_on_the_terminal(walk: Walk) -> None:
    assert len(walk.screens["./provision site=coastal --rehearse"]) <= ROWS


def test_the_portuguese_walk_shows_no_english(walk: Walk) -> None:
    answers = [typed for each in first_commands(walk.language) for _, typed in each.answers if " " in typed]
    parts = untranslated_parts(walk.whole(), answers)
    if walk.language == "en":
        assert parts != [], "the list of words finds nothing in English"
    else:
        assert parts == []
