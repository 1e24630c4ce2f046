"""What `ansible-doc` shows of the modules can be read, and is what they take."""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Any

import pytest
import yaml

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.modules.configure import ARGUMENTS

MODULES = Path(__file__).parents[3] / "atlantis_netcfg/ansible_collections/atlantis/netcfg/plugins/modules"
TEXTS = {"DOCUMENTATION", "EXAMPLES", "RETURN"}


def told(module: str) -> dict[str, Any]:
    """The texts of a module, read as YAML."""
    found = {}
    for node in ast.parse((MODULES / f"{module}.py").read_text()).body:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and node.targets[0].id in TEXTS:
            found[node.targets[0].id] = yaml.safe_load(ast.literal_eval(node.value))
    return found


def shape(options: dict[str, Any], below: str) -> dict[str, Any]:
    """Names, types and defaults."""
    return {
        name: (
            row["type"],
            row.get("elements"),
            row.get("default"),
            row.get("required", False),
            shape(row.get(below, {}), below),
        )
        for name, row in options.items()
    }


@pytest.mark.parametrize("module", [path.stem for path in sorted(MODULES.glob("*.py"))])
def test_the_documentation_can_be_read(module: str) -> None:
    texts = told(module)
    assert texts.keys() == TEXTS
    assert texts["DOCUMENTATION"]["module"] == module
    assert texts["EXAMPLES"][0].keys() >= {"name", f"atlantis.netcfg.{module}"}


def test_configure_takes_what_it_tells() -> None:
    assert shape(told("configure")["DOCUMENTATION"]["options"], "suboptions") == shape(ARGUMENTS, "options")
