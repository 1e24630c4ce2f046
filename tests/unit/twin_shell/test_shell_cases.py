"""What a terminal sends and what it is shown, as cases of data; each is replayed whole and byte by byte."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml
from row_subtests import for_each_row
from shell_bench import Bench

CASES: dict[str, dict[str, Any]] = {
    f"{file.stem}: {name}": case
    for file in sorted((Path(__file__).parent / "cases").glob("*.yml"))
    for name, case in yaml.safe_load(file.read_text(encoding="utf-8")).items()
}


def played(case: dict[str, Any], *, cut: bool) -> list[str]:
    """What is shown at first, and after each thing typed."""
    bench = Bench(**case.get("spec", {}))
    terminal = bench.terminal(case.get("login", "admin+cet80w"), sized=case.get("sized", True))
    return [terminal.shown(), *(terminal.type(step["type"], cut=cut) for step in case["steps"])]


@for_each_row("cut", [False, True], ids=["whole", "byte by byte"])
@for_each_row("name", CASES)
def test_case(name: str, cut: bool) -> None:  # noqa: FBT001 (a parameter of the test)
    case = CASES[name]
    greeting, *shown = played(case, cut=cut)
    if "greeting" in case:
        assert greeting == case["greeting"]
    assert shown == [step["shown"] for step in case["steps"]]
