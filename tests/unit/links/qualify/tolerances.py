"""The tolerances of docs/engineers/qualify-method.md: written there once, and read from there."""

import re
from functools import cache
from pathlib import Path

PAGE = Path(__file__).parents[4] / "docs" / "engineers" / "qualify-method.md"


@cache
def tolerances() -> dict[str, float]:
    rows = re.findall(r"^\| ([a-z_]+) \| ([0-9.]+) \|", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    return {name: float(value) for name, value in rows}
