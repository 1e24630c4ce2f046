"""What `ansible-doc` shows of our modules is what they take."""

import ast
from pathlib import Path
from typing import Any

import pytest
import yaml

PLUGINS = Path(__file__).parents[3] / "atlantis_netcfg/ansible_collections/atlantis/netcfg/plugins"
MODULES = sorted((PLUGINS / "modules").glob("*.py"))


def texts(module: Path) -> dict[str, Any]:
    """The YAML that a module's file holds in its documentation's names."""
    body = ast.parse(module.read_text(encoding="utf-8")).body
    assigned = [one for one in body if isinstance(one, ast.Assign) and isinstance(one.value, ast.Constant)]
    named = {one.targets[0].id: one.value.value for one in assigned if isinstance(one.targets[0], ast.Name)}  # type: ignore[attr-defined] # constants
    return {name: yaml.safe_load(named[name]) for name in ("DOCUMENTATION", "EXAMPLES", "RETURN")}


@pytest.mark.parametrize("module", MODULES, ids=lambda path: path.stem)
def test_documentation_is_complete(module: Path) -> None:
    told = texts(module)
    assert told["DOCUMENTATION"]["module"] == module.stem
    assert all(option["description"] for option in told["DOCUMENTATION"].get("options", {}).values())
    assert all(f"atlantis.netcfg.{module.stem}" in task for task in told["EXAMPLES"])
    assert told["RETURN"]
