"""4G units of other makes by the command line: each driver rehearsed, and a RutOS unit set at its declared address."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import preforked
import pytest
from quay import CHECKOUT, _inventory, _namespace
from test_adopt_run import led

from atlantis_netcfg.emulator.rutos import RunningRutos, RutosSim, RutosSpec
from atlantis_netcfg.runs import RunStart, Store

pytestmark = pytest.mark.slow

NAME = "te4sea-4g"
ADDRESS = "10.10.9.1"
ONLY = ("site=te4sea", f"device={NAME}")
BASE = """\
---
device:
  kind: lte_router
  address: 10.10.9.1
  powered_by: {device: te4sea-router, port: ether1}
  driver: """


def provision(inventory: Path, state: Path, *typed: str, code: int) -> str:
    variables = {"ATLANTIS_STATE": str(state)}
    if (password := inventory.parent / "vault-password").exists():
        variables["ANSIBLE_VAULT_PASSWORD_FILE"] = str(password)
    done = preforked.run([*typed, f"inventory={inventory}"], env={**os.environ, **variables})
    assert done.returncode == code, f"exit {done.returncode}\n{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.mark.parametrize(
    ("declared", "code", "message", "planned"),
    [
        (None, 0, "3 settings applied and verified; registered home (EXAMPLE-OPERATOR lte B3)", 3),
        ("at\n  serial: /dev/ttyUSB2\n", 0, "checked only; registered home (EXAMPLE-OPERATOR lte B3)", 0),
        ("modemmanager\n", 7, "not checked: driver modemmanager has no emulator", 0),
        ("manual\n", 7, "not checked: this 4G unit must be checked by hand", 0),
    ],
    ids=["rutos", "at", "modemmanager", "manual"],
)
def test_rehearsal_of_each_driver(tmp_path: Path, declared: str | None, code: int, message: str, planned: int) -> None:
    inventory = tmp_path / "inventory"
    shutil.copytree(CHECKOUT / "inventory", inventory)
    if declared is not None:
        (inventory / "host_vars/te4sea-4g.yml").write_text(BASE + declared)
    told = json.loads(provision(inventory, tmp_path / "state", *ONLY, "--rehearse", "--yes", "--json", code=code))
    result = told["devices"][NAME]
    assert (result["message"], result["planned"], result["exit"]) == (message, planned, code)
    assert any(
        "4G" in line or "RutOS" in line or "AT modem" in line or "Modem" in line for line in result["not_rehearsed"]
    )
    if not code:
        assert result["second_pass"] == 0
        assert set(result["bearers"]) >= {"lan"}


@pytest.fixture
def at(tmp_path: Path) -> Iterator[tuple[Path, RunningRutos]]:
    """A unit at its declared address, in a network of this test's own."""
    inventory = _inventory(tmp_path)
    spec = RutosSpec(
        name=NAME,
        serial_number="1000000001",
        reader="provision",
        reader_password="a-real-4g-te4sea",
        admin_password="a-real-4g-admin-te4sea",
        sim=RutosSim(apn="internet", is_listed=False),
    )
    with ExitStack() as stack:
        stack.enter_context(_namespace())
        subprocess.run(["ip", "address", "add", f"{ADDRESS}/32", "dev", "lo"], check=True)
        running = stack.enter_context(RunningRutos(spec, tmp_path / "unit"))
        for port, door in ((443, "https"), (22, "ssh")):
            stack.enter_context(led((ADDRESS, port), running.ready[door]))
        yield inventory, running


@pytest.mark.smoke
@pytest.mark.namespace
def test_unit_is_pinned_configured_and_then_unchanged(at: tuple[Path, RunningRutos], tmp_path: Path) -> None:
    inventory, running = at
    state = tmp_path / "state"
    before = running.unit.export()

    def typed(*words: str, code: int) -> dict[str, Any]:
        line = [*ONLY, *words] if words != ("plan",) else ["plan", *ONLY]
        told: dict[str, Any] = json.loads(provision(inventory, state, *line, "--accept-cost", "--json", code=code))
        return dict(told["devices"][NAME])

    # It stands behind a router that is reached over the satellite.
    assert "the cost was not accepted" in provision(inventory, state, *ONLY, "--yes", "--json", code=4)
    pins = Store(state).pins
    for flag in ("plan", "--yes"):
        assert "unknown certificate; no password was sent" in typed(flag, code=4)["message"]
    assert (pins.get(NAME), running.unit.export()) == (None, before)
    pins.change(NAME, running.ready["pin"])  # as `provision device trust` does
    for flag in ("plan", "--yes"):
        refused = typed(flag, code=4)
        assert "unknown SSH host key; no password was sent" in refused["message"]
        assert refused["hint"].startswith("run `provision device trust site=te4sea ")
    assert (pins.host_key(NAME), running.unit.export()) == (None, before)
    pins.change_host_key(NAME, running.ready["host_key"])
    assert typed("plan", code=2)["planned"] == 3
    assert running.unit.export() == before
    assert typed("--yes", code=0)["status"] == "changed"
    after = running.unit.export()
    assert running.unit.modem.settings["apn"] == "internet"
    assert typed("--yes", code=0)["status"] == "unchanged"
    assert typed("plan", code=0)["planned"] == 0
    assert running.unit.export() == after
    runs = Store(state).runs("te4sea")
    assert [run.exit for run in runs] == [4, 4, 0, 0]

    killed = RunStart(site="te4sea", revision="", tool="", hosts=(NAME,), rehearsed=False, command="provision")
    with Store(state).start(killed):
        pass
    assert len(Store(state).unfinished_runs("te4sea")) == 1
    resumed = json.loads(
        provision(inventory, state, "recover", "resume", "site=te4sea", "--accept-cost", "--json", code=0)
    )
    assert resumed["devices"][NAME]["status"] == "unchanged"
    assert Store(state).unfinished_runs("te4sea") == ()
    assert "a-real" not in "".join(path.read_text() for path in state.rglob("*") if path.is_file())


@pytest.mark.namespace
def test_plain_ansible_configures_the_unit_too(at: tuple[Path, RunningRutos], tmp_path: Path) -> None:
    inventory, running = at
    variables = {
        "ATLANTIS_STATE": str(tmp_path / "state"),
        "ANSIBLE_VAULT_PASSWORD_FILE": str(tmp_path / "vault-password"),
        "ANSIBLE_CONFIG": str(CHECKOUT / "ansible.cfg"),
        "ANSIBLE_NOCOLOR": "1",
    }
    command = [sys.executable, "-m", "ansible", "playbook", "-i", str(inventory), "--limit", NAME]
    command += ["-e", "atlantis_accept_cost=true"]
    refused = subprocess.run(
        [*command, str(CHECKOUT / "playbooks" / "site.yml")],
        env={**os.environ, **variables},
        capture_output=True,
        text=True,
        check=False,
    )
    assert refused.returncode != 0
    assert "unknown certificate; no password was sent" in " ".join(refused.stdout.split())
    file = inventory / "host_vars" / f"{NAME}.yml"
    known = f"    fingerprint: {running.ready['pin']}\n    host_key: {running.ready['host_key']}\n"
    declared = file.read_text("utf-8")
    file.write_text(declared.replace("    user: provision", f"    user: provision\n{known.rstrip()}"), "utf-8")
    for extra, recap in ((["--check", "--diff"], "changed=1"), ([], "changed=1"), ([], "changed=0")):
        done = subprocess.run(
            [*command, *extra, str(CHECKOUT / "playbooks" / "site.yml")],
            env={**os.environ, **variables},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        line = next(line for line in done.stdout.splitlines() if line.startswith(NAME) and "ok=" in line)
        assert recap in line
        assert "failed=0" in line
        assert "not supported yet" not in done.stdout
        if extra:
            assert "+ set network.mob1s1a1.apn='internet'" in done.stdout
            assert running.unit.shell.reloads == 0
    assert running.unit.modem.settings["apn"] == "internet"
