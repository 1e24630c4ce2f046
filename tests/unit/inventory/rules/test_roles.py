"""Every role says what it takes, what it changes and how to use it."""

from pathlib import Path
from typing import Any

import pytest
import yaml
from ansible.module_utils.common.arg_spec import ArgumentSpecValidator

ROLES = sorted(path for path in (Path(__file__).parents[4] / "roles").iterdir() if path.is_dir())
MOST_LINES = 2500
"""Of all YAML in `roles/`."""


def options(role: Path) -> dict[str, Any]:
    spec = yaml.safe_load((role / "meta" / "argument_specs.yml").read_text(encoding="utf-8"))
    found: dict[str, Any] = spec["argument_specs"]["main"]["options"]
    return found


def errors(role: Path, given: dict[str, Any]) -> list[str]:
    found: list[str] = ArgumentSpecValidator(options(role)).validate(given).error_messages
    return found


@pytest.mark.parametrize("role", ROLES, ids=lambda path: path.name)
def test_a_role_needs_no_argument_and_takes_those_of_a_run(role: Path) -> None:
    assert errors(role, {}) == []
    assert errors(role, {"atlantis_rehearse": True, "atlantis_request": {"mode": "plan"}}) == []
    assert len(errors(role, {"atlantis_rehearse": "perhaps"})) == 1


@pytest.mark.parametrize("role", ROLES, ids=lambda path: path.name)
def test_a_role_has_a_readme_with_an_example(role: Path) -> None:
    text = (role / "README.md").read_text(encoding="utf-8")
    headings = [line.removeprefix("## ") for line in text.splitlines() if line.startswith("## ")]
    assert headings == ["Variables", "Example", "What it changes", "Check mode"]
    (play,) = yaml.safe_load(text.partition("```yaml\n")[2].partition("```")[0])
    assert play["roles"] == [role.name]


def test_roles_stay_short() -> None:
    files = [path for role in ROLES for path in role.rglob("*.yml")]
    assert len(ROLES) == 9
    assert sum(len(path.read_text(encoding="utf-8").splitlines()) for path in files) <= MOST_LINES
