"""The part `gateway_interop` of the shipped pilot, and of pilots that differ from it in one thing."""

import gzip
import json
import os
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from atlantis_netcfg.computers.dds import gateway_dds
from atlantis_netcfg.computers.interop import SERVICE, gateway_interop
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.inventory.model import InteropService

ROOT = Path(__file__).parents[4]
HOST = "coastal-gateway"
UNIT = f"/etc/systemd/system/{SERVICE}"
COMMAND = "/usr/local/lib/atlantis/data-gateway"


def pilot(**change: Any) -> Inventory:  # noqa: ANN401 - fields of the model
    declaration = load(ROOT / "inventory")
    interop = declaration.pilot.gateways.interop
    assert interop is not None
    gateways = declaration.pilot.gateways.model_copy(update={"interop": interop.model_copy(update=change)})
    return replace(declaration, pilot=declaration.pilot.model_copy(update={"gateways": gateways}))


def told(declaration: Inventory) -> dict[str, Any]:
    made = gateway_interop(declaration, declaration.hosts[HOST]).as_dict()
    assert json.loads(json.dumps(made)) == made
    return made


def files(made: dict[str, Any]) -> dict[str, str]:
    return {file["path"]: file["content"] for file in made["configure"].get("files", ())}


def test_declared_library_is_built_without_exposing_the_token() -> None:
    made = told(pilot())
    assert made["build"]["ros_setup"] == "/opt/ros/foxy/setup.sh"
    assert made["build"]["library"].keys() == {"url", "revision"}
    assert "token" not in json.dumps(made)
    names = [package["name"] for package in made["packages"]["packages"]]
    assert names == ["ca-certificates", "cmake", "git", "libyaml-cpp-dev", "build-essential"]
    assert made["connection_test"]["config"] == "/opt/atlantis/interop/current/examples/config/robot-config.yml"
    assert UNIT not in files(made)
    assert told(pilot(connection_test=None))["connection_test"] is None
    assert told(pilot(examples=None))["build"]["examples"] is None


def test_undeclared_service_and_library_are_removed() -> None:
    made = told(pilot())["configure"]
    assert {UNIT, COMMAND} <= set(made["absent"])
    assert "units" not in made
    declaration = pilot()
    gateways = declaration.pilot.gateways.model_copy(update={"interop": None})
    none = told(replace(declaration, pilot=declaration.pilot.model_copy(update={"gateways": gateways})))
    assert (none["build"], none["connection_test"], none["packages"]["packages"]) == (None, None, [])
    assert {UNIT, COMMAND} <= set(none["configure"]["absent"])


def test_the_service_is_bound_to_the_vpn_and_limited() -> None:
    service = InteropService(command="examples/build/gateway --name 'a b' %i $HOME", memory_mb=768, cpu_percent=150)
    made = told(pilot(service=service))
    unit = files(made)[UNIT]
    device = "sys-subsystem-net-devices-tun0.device"
    for line in (
        f"After={device}",
        f"BindsTo={device}",
        f"WantedBy={device}",
        "Restart=always",
        "RestartSec=5",
        "StartLimitIntervalSec=0",
        "MemoryMax=768M",
        "CPUQuota=150%",
        "TasksMax=512",
        "EnvironmentFile=/etc/atlantis/ros.env",
        f"ExecStart={COMMAND}",
    ):
        assert line in unit.splitlines()
    # The declared words are the shell's business: systemd's own `%` and `$` are not in the way.
    assert files(made)[COMMAND].splitlines()[-1] == f"exec {service.command}"
    assert made["configure"]["units"][0]["after"][-1] == "/opt/atlantis/interop/current/build.json"


@pytest.mark.parametrize(
    ("there", "bounded"),
    [
        (("sys/fs/cgroup/cpu/cpu.cfs_quota_us",), True),
        (("sys/fs/cgroup/system.slice/cpu.max",), True),
        (("sys/fs/cgroup/cpu/cpu.shares", "proc/config.gz: # CONFIG_CFS_BANDWIDTH is not set"), False),
        (("sys/fs/cgroup/system.slice/cpu.weight",), False),
        (("proc/config.gz: CONFIG_CFS_BANDWIDTH=y",), True),
        (("boot/config-@: CONFIG_CFS_BANDWIDTH=y",), True),
        (("boot/config-@: # CONFIG_CFS_BANDWIDTH is not set",), False),
        ((), False),
    ],
)
def test_limit_the_kernel_does_not_enforce_is_a_finding(
    there: tuple[str, ...],
    bounded: bool,  # noqa: FBT001 - a column
    tmp_path: Path,
) -> None:
    """Hardkernel's 4.9 for the N2 has `# CONFIG_CFS_BANDWIDTH is not set`."""
    for each in there:
        name, _, text = each.replace("@", os.uname().release).partition(": ")
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(gzip.compress(f"{text}\n".encode()) if name.endswith(".gz") else f"{text}\n".encode())
    (check,) = told(pilot(service=InteropService(command="gateway")))["configure"]["checks"]
    script = check["run"][2]
    for root in ("/sys/", "/proc/", "/boot/"):
        script = script.replace(root, f"{tmp_path}{root}")
    assert (subprocess.run(["sh", "-c", script], check=False).returncode == 0) is bounded
    assert "CONFIG_CFS_BANDWIDTH" in check["finding"]
    assert "checks" not in told(pilot())["configure"]


def test_service_environment_is_that_of_the_profiles() -> None:
    service = InteropService(command="gateway")
    declaration = pilot(service=service)
    reader, *_ = gateway_dds(declaration, declaration.hosts[HOST]).as_dict()["configure"]["units"]
    assert reader["name"] == SERVICE
    assert "/etc/atlantis/ros.env" in reader["after"]
    assert "/etc/atlantis/ros.env" in files(told(declaration))[UNIT]


@pytest.mark.parametrize(("command", "code"), [("gateway --x 'a b'", 0), ("gateway --x 'a b", 2)])
def test_command_with_shell_syntax_error_is_not_installed(command: str, code: int, tmp_path: Path) -> None:
    made = told(pilot(service=InteropService(command=command)))
    (file,) = (one for one in made["configure"]["files"] if one["path"] == COMMAND)
    script = tmp_path / "script"
    script.write_text(file["content"])
    words = [word.replace("%s", str(script)) for word in file["validate"]]
    assert subprocess.run(words, capture_output=True, check=False).returncode == code
