"""Which values count as examples: numbers as well as text, and none because a text has a `#` in it."""

import shutil
from pathlib import Path

import pytest
from hints_said import advised

from atlantis_netcfg.cli import main
from atlantis_netcfg.core.errors import ExitCode, UsageError
from atlantis_netcfg.inventory import load, validate
from atlantis_netcfg.inventory._yaml import parse
from atlantis_netcfg.inventory.examples import by_line, examples_in
from atlantis_netcfg.operations.common.request import refuse_examples

SHIPPED = Path(__file__).parents[4] / "inventory"


def keys(text: str) -> list[str]:
    root, findings = parse(text.encode(), "file.yml", None)
    assert findings == []
    assert root is not None
    return [example.key for example in examples_in([root])]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("price: 8.0 # EXAMPLE\nport: 1\n", ["price"]),
        ("price: 8.0 # from the contract; EXAMPLE\n", ["price"]),
        ("bands: [3, 7] # EXAMPLE\n", ["bands", "bands"]),
        ("at: {lan: 10.0.0.1, port: 1} # EXAMPLE\n", ["lan", "port"]),
        ("block: # EXAMPLE\n  a: 1\n  b: {c: 2}\nd: 3\n", ["a", "c"]),
        ("list: # EXAMPLE\n  - 1\n  - a: 2\nd: 3\n", ["list", "a"]),
        ("# EXAMPLE VALUES in this file\na: 1\n", []),
        ("a: 1 # no example\n", []),
        ("a: 1 # EXAMPLE-key is an example\n", []),
        ("a: 'x # EXAMPLE'\n", []),
        ("a: x#EXAMPLE\n", []),
        ("a: 'it # says' # EXAMPLE\n", ["a"]),
        ("a: |\n  text # EXAMPLE\nb: 1\n", []),
        ("a: | # EXAMPLE\n  text\nb: 1\n", ["a"]),
        ("a: !vault | # EXAMPLE\n  $ANSIBLE_VAULT;1.1;AES256\n  3063\n", ["a"]),
        ("a: 192.0.2.7\nb: EXAMPLE-key\nc: vpn.example.org\nd: 10.0.0.1\n", ["a", "b", "c"]),
    ],
)
def test_example_markers_are_recognised(text: str, expected: list[str]) -> None:
    assert keys(text) == expected


@pytest.fixture
def inventory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(SHIPPED, tmp_path / "inventory")
    monkeypatch.chdir(tmp_path)
    return Path("inventory")


def test_remaining_example_values_are_reported_with_their_line(inventory: Path) -> None:
    """The 8 EUR/MB, the bands and the modems' addresses of the shipped inventory are named, each with its line."""
    path = inventory / "group_vars/all/pilot.yml"
    path.write_text(path.read_text(encoding="utf-8").replace("example_values: true", "example_values: false"), "utf-8")
    told = [f"{finding.file}:{finding.line} {finding.message}" for finding in validate(inventory)]
    for place, key in (
        ("group_vars/coastal.yml:53", "price_per_mb"),
        ("host_vars/coastal-4g.yml:14", "bands"),
        ("host_vars/coastal-cpe.yml:16", "frequency_mhz"),
        ("group_vars/all/vehicles.yml:26", "acoustic_address"),
    ):
        assert [line for line in told if line.startswith(f"inventory/{place} ") and f"`{key}`" in line], place


def test_refused_run_names_count_and_first_examples(inventory: Path) -> None:
    declaration = load(inventory)
    with pytest.raises(UsageError) as caught:
        refuse_examples(declaration, is_rehearsal=False)
    lines = str(caught.value.hint).splitlines()
    assert lines[1].startswith(f"{len(declaration.examples)} values are examples")
    (words,) = advised(lines[1])
    assert main([*words, "inventory=inventory"]) == ExitCode.DONE
    assert [line.strip() for line in lines[2:]] == by_line(declaration.examples)[:3]
    refuse_examples(declaration, is_rehearsal=True)
