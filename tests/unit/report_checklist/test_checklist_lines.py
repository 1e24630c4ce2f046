"""What a console shows, word for word; `golden/` holds it."""

from __future__ import annotations

import os
from pathlib import Path

import checklist_example as made
import pytest

from atlantis_netcfg.checklist.report import Document, LeftOut, Row, lines
from atlantis_netcfg.core.events import Verdict

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
def test_the_text_is_the_golden_one(name: str) -> None:
    told = lines(CASES[name]()) + "\n"
    path = GOLDEN / f"{name}.txt"
    if os.environ.get("GOLDEN") == "write":
        path.write_text(told, encoding="utf-8")
    assert told == path.read_text(encoding="utf-8")


def test_no_golden_text_is_left_over() -> None:
    assert {path.stem for path in GOLDEN.iterdir()} == CASES.keys()
