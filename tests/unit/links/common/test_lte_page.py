"""docs/4g.md says what the code says: drivers and their fields, findings and what can be done about them."""

import re
from pathlib import Path

import yaml

from atlantis_netcfg.inventory.model import LteDriver
from atlantis_netcfg.inventory.rules.lte import FIELDS

PAGE = (Path(__file__).parents[4] / "docs" / "4g.md").read_text(encoding="utf-8")


def rows(columns: int) -> list[list[str]]:
    """The rows of the tables with so many columns, without their heads."""
    found = [[cell.strip() for cell in line.strip("|").split("|")] for line in PAGE.splitlines() if line[:1] == "|"]
    return [row for row in found if len(row) == columns and row[0].startswith("`") and row[0] != "`driver`"]


def named(cell: str) -> set[str]:
    return set(re.findall(r"`([^`]+)`", cell))


def test_page_lists_drivers_and_their_fields() -> None:
    told = {row[0].strip("`"): (named(row[2]), named(row[3])) for row in rows(4)}
    assert told.keys() == {driver.value for driver in LteDriver}
    for driver in LteDriver:
        needs = {".".join(one.path) for one in FIELDS if driver in one.needed_by}
        uses = {".".join(one.path) for one in FIELDS if driver in one.of}
        assert told[driver.value] == (needs, uses - needs)


def test_every_finding_is_explained() -> None:
    cases = yaml.safe_load((Path(__file__).parent / "lte_judge_cases.yml").read_text(encoding="utf-8"))
    codes = {line.split(" ")[1].rstrip(":") for case in cases for line in case["findings"]}
    assert {row[0].strip("`") for row in rows(2)} == codes
    assert all(row[1] for row in rows(2))
