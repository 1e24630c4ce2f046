"""`provision inventory validate`: what it says, where it says it, and how it ends."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from hints_said import advised

from atlantis_netcfg.cli import main
from atlantis_netcfg.core.errors import ExitCode

SHIPPED = Path(__file__).parents[4] / "inventory"
SAID = """\
inventory: no errors
    3 sites     scc (4 hosts), coastal (5 hosts), te4sea (4 hosts)
   13 hosts     3 router, 2 cpe, 1 vpn_server, 1 control_centre, 2 lte_router, 2 satellite_terminal, 2 gateway
    6 vehicles  girona500, sparus, zarco, stork, mares, eca-rov
    6 partners  inesc, iqua, eca, udg, vtt, spaceapps
Still contains example values: for rehearsals only (`provision site=scc --rehearse inventory=inventory`).
454 values are examples: `provision inventory validate --examples inventory=inventory` lists them.
"""
WRONG = """\
inventory/host_vars/te4sea-router.yml:8:92: `satelite` is not a link of `te4sea`
  -> did you mean `satellite`?
1 error in the inventory; no device was contacted
"""


@pytest.fixture
def inventory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(SHIPPED, tmp_path / "inventory")
    monkeypatch.chdir(tmp_path)
    return Path("inventory")


@pytest.fixture
def invalid(inventory: Path) -> Path:
    path = inventory / "host_vars" / "te4sea-router.yml"
    path.write_text(path.read_text(encoding="utf-8").replace("via: satellite", "via: satelite"), encoding="utf-8")
    return inventory


@pytest.mark.usefixtures("inventory")
def test_result_lists_what_was_checked(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inventory", "validate", "inventory=inventory"]) == ExitCode.DONE
    assert capsys.readouterr() == (SAID, "")


@pytest.mark.usefixtures("inventory")
def test_json_output(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inventory", "validate", "inventory=inventory", "--json"]) == ExitCode.DONE
    said = json.loads(capsys.readouterr().out)
    assert said.pop("revision")
    examples = said.pop("examples")
    assert len(examples) == 454
    assert {"file": "inventory/group_vars/coastal.yml", "line": 53, "column": 31, "key": "price_per_mb"} in [
        {key: value for key, value in example.items() if key != "recognised"} for example in examples
    ]
    assert said == {
        "exit": 0,
        "inventory": "inventory",
        "errors": [],
        "warnings": [],
        "checked": {"sites": 3, "hosts": 13, "vehicles": 6, "partners": 6},
    }


@pytest.mark.usefixtures("inventory")
def test_every_example_value_is_listed_with_its_place(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inventory", "validate", "inventory=inventory"]) == ExitCode.DONE
    (words,) = advised(capsys.readouterr().out.splitlines()[-1])
    assert words == ["inventory", "validate", "--examples", "inventory=inventory"]
    assert main(words) == ExitCode.DONE
    said = capsys.readouterr().out.splitlines()
    keys = "`price_per_mb`, `min_session_bytes`"
    assert f"  group_vars/coastal.yml:53 {keys}" in said
    assert "  host_vars/coastal-4g.yml:14 `bands`" in said
    assert said[-1] == "454 values are examples."


def test_default_inventory_is_that_of_the_checkout(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inventory", "validate"]) == ExitCode.DONE
    assert capsys.readouterr().out.splitlines()[0] == f"{SHIPPED}: no errors"


def test_warnings_do_not_fail(inventory: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = inventory / "group_vars" / "coastal.yml"
    budget = "      standing_budget_mb: 1\n      device: coastal-sat\n"
    path.write_text(path.read_text(encoding="utf-8").replace("      device: coastal-sat\n", budget), encoding="utf-8")
    assert main(["inventory", "validate", "inventory=inventory"]) == ExitCode.DONE
    said = capsys.readouterr().out
    assert "1 warning in the inventory; no device was contacted" in said
    assert main(["inventory", "validate", "inventory=inventory", "--json"]) == ExitCode.DONE
    (warning,) = json.loads(capsys.readouterr().out)["warnings"]
    assert (warning["file"], warning["line"]) == ("inventory/group_vars/coastal.yml", 44)
    assert warning["message"].startswith("9.4 MB of background traffic a month over satellite ")
    without_budgets(inventory)
    assert main(["inventory", "validate", "inventory=inventory"]) == ExitCode.DONE
    said = capsys.readouterr().out
    for link in ("4g", "satellite"):
        assert said.count(f"there is no budget for the background traffic over {link}") == 2
    assert "4 warnings in the inventory; no device was contacted" in said


def without_budgets(inventory: Path) -> None:
    for site in ("coastal", "te4sea"):
        path = inventory / "group_vars" / f"{site}.yml"
        path.write_text(re.sub(r"\n *standing_budget_.*", "", path.read_text(encoding="utf-8")), encoding="utf-8")


@pytest.mark.usefixtures("invalid")
def test_errors_go_to_stderr(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inventory", "validate", "inventory=inventory"]) == ExitCode.USAGE
    assert capsys.readouterr() == ("", WRONG)


@pytest.mark.usefixtures("invalid")
def test_errors_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inventory", "validate", "inventory=inventory", "--json"]) == ExitCode.USAGE
    said = json.loads(capsys.readouterr().out)
    assert said["exit"] == ExitCode.USAGE
    assert said["errors"] == [
        {
            "file": "inventory/host_vars/te4sea-router.yml",
            "line": 8,
            "column": 92,
            "message": "`satelite` is not a link of `te4sea`",
            "hint": "did you mean `satellite`?",
        }
    ]


@pytest.mark.usefixtures("inventory")
def test_missing_inventory_is_reported(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inventory", "validate", "inventory=inventroy"]) == ExitCode.NOTHING
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.splitlines() == [
        "error: the inventory directory inventroy does not exist",
        "       inventories here: inventory",
    ]


def test_validation_imports_only_what_it_needs(inventory: Path) -> None:
    """Where nothing has to be worked out of what links carry."""
    without_budgets(inventory)
    vehicles = inventory / "group_vars" / "all" / "vehicles.yml"
    silent = re.sub(r"\n    telemetry:.*(\n      - .*)+", "", vehicles.read_text(encoding="utf-8"))
    vehicles.write_text(silent, encoding="utf-8")
    program = (
        "import sys; from atlantis_netcfg.cli import main; code = main(['inventory', 'validate', "
        "'inventory=inventory']);"
        "print(*sys.modules, file=sys.stderr); sys.exit(code)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    imported = done.stderr.split()
    strangers = {"ansible", "asyncio", "cryptography", "jinja2", "librouteros", "netmiko", "paramiko", "rich", "ssl"}
    assert strangers.isdisjoint(name.partition(".")[0] for name in imported)
    packages = {name.split(".")[1] for name in imported if name.startswith("atlantis_netcfg.")}
    assert packages <= {"cli", "core", "inventory"}
