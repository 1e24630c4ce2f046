from pathlib import Path

import inventory_cases
import pytest
import yaml
from row_subtests import for_each_row
from schema_reader import files, problems, schema_of

from atlantis_netcfg.inventory import json_schema

CHECKOUT = Path(__file__).parents[4]
SHIPPED = CHECKOUT / "inventory"

CASES: dict[str, list[str]] = yaml.safe_load(Path(__file__).with_name("schema_cases.yml").read_text(encoding="utf-8"))
SCHEMAS = {path.relative_to(SHIPPED): schema_of(path) for path in files(SHIPPED)}


def seen(case: str, folder: Path) -> str:
    """Who sees that the case's inventory is broken, one file at a time."""
    inventory = inventory_cases.spoil(inventory_cases.load(inventory_cases.HERE / f"{case}.yml"), folder)
    rejected = False
    for path in files(inventory):
        name = path.relative_to(inventory)
        schema = SCHEMAS.get(name)
        if schema is None or path.read_bytes() == (SHIPPED / name).read_bytes():
            continue
        try:
            rejected = bool(problems(path, schema)) or rejected
        except (yaml.YAMLError, ValueError):  # ValueError: PyYAML, of a number that is none
            return "yaml"
    return "schema" if rejected else "beyond"


def test_shipped_schemas_match_the_model() -> None:
    shipped = {path.name: path.read_text(encoding="utf-8") for path in (SHIPPED / json_schema.FOLDER).iterdir()}
    assert shipped == json_schema.texts(), "write them: python -m atlantis_netcfg.inventory.json_schema"


@for_each_row("path", files(SHIPPED), ids=lambda path: path.stem)
def test_a_shipped_file_names_its_schema_and_is_accepted(path: Path) -> None:
    schema = schema_of(path)
    assert schema is not None
    assert schema.parent == SHIPPED / json_schema.FOLDER
    assert problems(path, schema) == []


@pytest.mark.parametrize("sort", ["schema", "yaml", "beyond"])
def test_broken_inventory_is_detected_by_the_expected_checker(sort: str, tmp_path: Path) -> None:
    found = {case: seen(case, tmp_path / case) for case in CASES[sort]}
    assert found == dict.fromkeys(CASES[sort], sort)


def test_lists_cover_all_cases() -> None:
    listed = [case for cases in CASES.values() for case in cases]
    every = [path.stem for path in inventory_cases.cases()]
    assert sorted(listed) == sorted(case for case in every if not case.startswith("bounds-"))  # no editor opens a pipe
    assert len(CASES["schema"]) >= 30


def test_a_vaulted_secret_is_accepted(tmp_path: Path) -> None:
    text = (SHIPPED / "host_vars/scc-router.yml").read_text(encoding="utf-8")
    vaulted = "!vault |\n      $ANSIBLE_VAULT;1.1;AES256\n      3063\n"
    text = text.replace(
        "access: {address: 10.64.100.1, user: provision, password: EXAMPLE-provision-scc}",
        f"access:\n    address: 10.64.100.1\n    password: {vaulted}",
    )
    path = tmp_path / "scc-router.yml"
    path.write_text(text, encoding="utf-8")
    assert "$ANSIBLE_VAULT" in text
    assert problems(path, SHIPPED / json_schema.FOLDER / "router.json") == []
    path.write_text(text.replace(vaulted, "correct-horse\n"), encoding="utf-8")
    assert problems(path, SHIPPED / json_schema.FOLDER / "router.json") != []


def test_every_key_of_every_schema_has_a_meaning() -> None:
    missing = [
        f"{name}: {block}.{key}"
        for name, schema in json_schema.schemas().items()
        for block, definition in schema.get("$defs", {}).items()
        for key, entry in definition.get("properties", {}).items()
        if not entry.get("description")
    ]
    assert missing == []
