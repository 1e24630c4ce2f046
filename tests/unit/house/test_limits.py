"""The code does not grow unnoticed: tests/data/limits.yml."""

from pathlib import Path

import yaml

CHECKOUT = Path(__file__).parents[3]
LIMITS: dict[str, int] = yaml.safe_load((CHECKOUT / "tests/data/limits.yml").read_text(encoding="utf-8"))
SLACK = 500
"""So many lines below its limit: lower it."""


def test_no_part_has_more_lines_than_its_limit_or_far_fewer() -> None:
    lines = {
        part: sum(len(file.read_bytes().splitlines()) for file in (CHECKOUT / part).rglob("*.py")) for part in LIMITS
    }
    assert {part: count for part, count in lines.items() if not LIMITS[part] - SLACK <= count <= LIMITS[part]} == {}
