"""What a console shows, word for word; `golden/` holds it."""

import io
import os
from collections.abc import Callable
from pathlib import Path

import checklist_example as made
import pytest
from row_subtests import for_each_row

from atlantis_netcfg.checklist.report import Document, LeftOut, Row, ending, lines
from atlantis_netcfg.checklist.report._shapes import ASCII, state
from atlantis_netcfg.checklist.report._words import to_look_at
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.printable import show

GOLDEN = Path(__file__).with_name("golden")


def narrowed() -> Document:
    """One vehicle: the rest of the table is not there."""
    own = tuple(item for item in made.healthy_items() if item.vehicle == "sparus")
    left = tuple(LeftOut(what=f"{name}: Wi-Fi", why="left out by `vehicle=sparus`") for name in ("Mares", "Stork"))
    return made.green(items=own, left_out=left, scope={"vehicle": ("sparus",)}, signed=None)


def changed_row() -> Document:
    """A vehicle that differs from the report, and all of it skipped."""
    row = Row(key="stork", name="Stork", kind="uav", table3=("wifi",), deviation="its GPS is on the ground")
    return made.green(items=(made.item("stork/wifi", Verdict.SKIP, "it does not fly today"),), rows=(row,))


CASES = {
    "example": made.example,
    "green": made.green,
    "empty": made.empty,
    "narrowed": narrowed,
    "skipped": changed_row,
}


@pytest.mark.parametrize("name", CASES)
def test_text_matches_the_golden_file(name: str) -> None:
    told = lines(CASES[name]()) + "\n"
    path = GOLDEN / f"{name}.txt"
    if os.environ.get("GOLDEN") == "write":
        path.write_text(told, encoding="utf-8")
    assert told == path.read_text(encoding="utf-8")


def test_no_golden_text_is_left_over() -> None:
    assert {path.stem for path in GOLDEN.iterdir()} == CASES.keys()


class Terminal(io.StringIO):
    """Which shows colours."""

    def isatty(self) -> bool:
        return True


def ends(document: Document, room: int = 8) -> list[str]:
    out = io.StringIO()
    show(ending(document, room), out)
    return out.getvalue().splitlines()


LONG = "the far end does not answer at all, " * 9
ENDS: dict[str, Callable[[], Document]] = {
    **CASES,
    "long": lambda: made.example(items=(made.item("sparus/wifi", Verdict.FAIL, LONG, hint=LONG), *made.items())),
    "long message": lambda: made.green(items=(made.item("sparus/wifi", Verdict.FAIL, LONG, hint="mend it"),)),
    "wide scope": lambda: made.green(scope={"vehicle": tuple(made.NAMES)}),
}


@for_each_row("room", [5, 6, 8])
@for_each_row("name", ENDS)
def test_ending_fits_and_shows_the_worst(name: str, room: int) -> None:
    document = ENDS[name]()
    told = ends(document, room)
    assert max(map(len, told)) <= 80
    assert len(told) <= room
    shown = state(to_look_at(document)[1][0]) if to_look_at(document)[1] else None
    if shown is not None:
        assert told[0].startswith(f"{ASCII[shown]} {shown}: The checklist has ")
        assert any(line.startswith(f"{to_look_at(document)[1][0].id}: ") for line in told)


def test_long_text_is_shortened_and_its_advice_kept() -> None:
    told = ends(ENDS["long message"](), 5)
    assert told[2].endswith(" ...")
    assert told[3] == "  -> mend it"


def test_verdicts_are_coloured_only_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    out = Terminal()
    show(ending(made.example()), out)
    assert "\x1b[31m# ERROR\x1b[0m: The checklist has not passed\n" in out.getvalue()
    out = Terminal()
    show(ending(made.green()), out)
    assert out.getvalue().startswith(
        "\x1b[32m+ PASS\x1b[0m: The checklist has passed\n\x1b[32m32 PASS\x1b[0m; exit 0\n"
    )
    monkeypatch.setenv("NO_COLOR", "1")
    out = Terminal()
    show(ending(made.example()), out)
    assert "\x1b" not in out.getvalue()
