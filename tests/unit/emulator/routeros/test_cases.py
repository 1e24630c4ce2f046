"""Sentences and their replies, as data: `cases/*.yml`."""

from pathlib import Path
from typing import Any

import pytest
import yaml
from twin_bench import make

CASES = [
    pytest.param(case, id=f"{file.stem}: {case['case']}")
    for file in sorted(Path(__file__).parent.glob("cases/*.yml"))
    for case in yaml.safe_load(file.read_text(encoding="utf-8"))
]


@pytest.mark.parametrize("case", CASES)
def test_replies(case: dict[str, Any]) -> None:
    bench_ = make(**case.get("spec", {}))
    for step in case["steps"]:
        user = step.get("as")
        by = bench_.session(user["name"], user["password"]) if user else None
        assert bench_.say(*step["send"], by=by) == step["reply"], step["send"]
