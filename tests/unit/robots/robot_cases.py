"""Broken robots' files: `broken.yml` spoils the shipped file of Sparus, and says what a person is told of it.

`python tests/unit/robots/robot_cases.py` writes the expected lines anew: read the difference before you commit it.
"""

import shutil
import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.inventory.robots import reading

HERE = Path(__file__).parent
SHIPPED = HERE.parents[2] / "inventory"
CASES = HERE / "broken.yml"


def cases() -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = yaml.safe_load(CASES.read_text())
    return found


def spoil(case: dict[str, Any], folder: Path) -> Path:
    """A copy of the shipped robots in `folder`, with the case's edits."""
    inventory = folder / "inventory"
    shutil.copytree(SHIPPED / "robots", inventory / "robots")
    for edit in case["edits"]:
        file = inventory / "robots" / edit.get("file", "sparus.yml")
        text = file.read_text() if file.exists() else ""
        if "old" in edit:
            assert text.count(edit["old"]) == 1, edit
            file.write_text(text.replace(edit["old"], edit["new"]))
        else:
            file.write_text(edit["content"] * edit.get("times", 1))
    return inventory


@cache
def shipped() -> Inventory:
    return load(SHIPPED)


def told(inventory: Path) -> list[str]:
    """Every error and warning of the robots below a folder, beside the shipped inventory's vehicles."""
    declaration = replace(shipped(), root=inventory)
    names, findings = reading.key_names(declaration)
    sources = reading.read_declared(declaration, names)
    warnings = [finding for source in sources for finding in source.warnings]
    findings += [finding for source in sources for finding in source.findings]
    return [
        f"{sort}{each.file}:{each.line}:{each.column}: {each.message} -> {each.hint}".replace(f"{inventory}/", "")
        for sort, rows in (("", findings), ("warning: ", warnings))
        for each in rows
    ]


def main() -> None:
    rows = cases()
    for case in rows:
        with tempfile.TemporaryDirectory() as folder:
            case["told"] = told(spoil(case, Path(folder)))
    CASES.write_text(yaml.safe_dump(rows, sort_keys=False, allow_unicode=True, width=1000))


if __name__ == "__main__":
    main()
