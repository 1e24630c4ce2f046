from pathlib import Path
from typing import Any

import pytest
import yaml
from ansible.module_utils.common.arg_spec import ArgumentSpecValidator

from atlantis_netcfg.declaration.argument_specs import ROLES, text, write

CHECKOUT = Path(__file__).parents[3]
ROUTERS = sorted((CHECKOUT / "inventory" / "host_vars").glob("*-router.yml"))


def read(path: Path) -> dict[str, Any]:
    data: dict[str, Any] = yaml.safe_load(path.read_text(encoding="utf-8"))
    return data


def variables(router: Path) -> dict[str, Any]:
    group_vars = CHECKOUT / "inventory" / "group_vars"
    site = router.stem.removesuffix("-router")
    return {**read(group_vars / "all" / "pilot.yml"), **read(group_vars / f"{site}.yml"), **read(router)}


def errors(given: dict[str, Any]) -> list[str]:
    specs = yaml.safe_load(text("routeros"))["argument_specs"]["main"]["options"]
    found: list[str] = ArgumentSpecValidator(specs).validate(given).error_messages
    return found


@pytest.mark.parametrize("role", ROLES)
def test_file_and_model_are_equal(role: str) -> None:
    path = CHECKOUT / "roles" / role / "meta" / "argument_specs.yml"
    assert path.read_text(encoding="utf-8") == text(role), "run: python -m atlantis_netcfg.declaration.argument_specs"


def test_write(tmp_path: Path) -> None:
    assert [path.read_text(encoding="utf-8") for path in write(tmp_path)] == [text(role) for role in ROLES]


@pytest.mark.parametrize("router", ROUTERS, ids=lambda path: path.stem)
def test_ansible_accepts_the_shipped_inventory(router: Path) -> None:
    assert errors(variables(router)) == []


def test_ansible_refuses_what_the_model_refuses() -> None:
    given = variables(ROUTERS[0])
    given["device"]["ports"][0]["use"] = "wan"
    del given["site"]["lan"]["gateway"]
    assert len(errors(given)) == 2


def test_every_secret_is_no_log() -> None:
    specs = yaml.safe_load(text("routeros"))["argument_specs"]["main"]["options"]
    secrets = [name for name, option in _walk(specs) if option.get("no_log")]
    assert secrets == ["token", "token", "key", "key", "password", "password", "key"]


def test_every_option_is_described() -> None:
    specs = yaml.safe_load(text("routeros"))["argument_specs"]["main"]["options"]
    assert [name for name, option in _walk(specs) if not option["description"].endswith(".")] == []


def _walk(options: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    found = []
    for name, option in options.items():
        found.append((name, option))
        found.extend(_walk(option.get("options", {})))
    return found
