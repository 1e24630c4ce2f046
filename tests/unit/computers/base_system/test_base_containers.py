"""Containers of services and the bridge to ROS 1: what is laid down, and that no registry is ever meant."""

import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from atlantis_netcfg.computers.base import GatewayBase, gateway_base
from atlantis_netcfg.computers.containers import PACKAGES, folder_budget_check
from atlantis_netcfg.computers.dds import gateway_dds
from atlantis_netcfg.computers.services import BRIDGE
from atlantis_netcfg.inventory import load
from atlantis_netcfg.inventory.model import HostedService, Ros1Bridge, ServerComputer

SHIPPED = load(Path(__file__).parents[4] / "inventory")
CENTRE = "scc-control"
FOLDER = "/etc/atlantis/containers"
IMAGE = {"archive": "backend.tar", "sha256": "A" * 64}
TOPICS = [
    {"topic": "/zarco/pose", "type": "geometry_msgs/msg/Pose"},
    {"topic": "/zarco/config", "type": "std_msgs/msg/String"},
]


def base(*services: dict[str, Any], bridge: dict[str, Any] | None = None, **images: str) -> GatewayBase:
    host = SHIPPED.hosts[CENTRE]
    assert isinstance(host.device, ServerComputer)
    made = None if bridge is None else Ros1Bridge.model_validate({**IMAGE, **bridge})
    declared = tuple(HostedService.model_validate(each) for each in services)
    device = host.device.model_copy(update={"services": declared, "ros1_bridge": made})
    changed = replace(host, device=device)
    return gateway_base(replace(SHIPPED, hosts={**SHIPPED.hosts, CENTRE: changed}), changed, images=images)


def contained(name: str = "backend", **container: Any) -> dict[str, Any]:  # noqa: ANN401 - keys of the declaration
    return {"name": name, "port": 18082, "open_to": ["vpn"], "container": {**IMAGE, "budget_mb": 500, **container}}


def files(made: GatewayBase) -> dict[str, str]:
    return {file.path: file.content for file in made.configuration.files}


def test_a_container_is_confined_and_never_pulled() -> None:
    script = files(base(contained(arguments="--port 18082", data="/srv/backend", data_at="/var/lib/backend")))[
        f"{FOLDER}/atlantis-service-backend"
    ]
    (run,) = [part for part in script.replace("\\\n", "").splitlines() if "podman run" in part]
    for words in (
        "--pull never",
        "--read-only",
        "--cap-drop all",
        "--security-opt no-new-privileges",
        "--cgroups disabled",
        '--user "$(id -u svc-backend):$(id -g svc-backend)"',
        "--volume /srv/backend:/var/lib/backend",
        '"$image" --port 18082',
    ):
        assert words in run
    for word in ("--privileged", "--cap-add", "podman pull", "docker.io"):
        assert word not in script
    assert f"sha256={'a' * 64}\n" in script, "small letters, as sha256sum prints them"


def test_privileged_port_needs_one_capability() -> None:
    script = files(base({**contained(), "port": 443}))[f"{FOLDER}/atlantis-service-backend"]
    assert "--cap-drop all --cap-add NET_BIND_SERVICE" in script


def test_unit_has_limits_and_leaves_the_rest_to_podman() -> None:
    unit = files(base(contained(memory_mb=300, restart="on-failure")))[
        "/etc/systemd/system/atlantis-service-backend.service"
    ].splitlines()
    script = f"{FOLDER}/atlantis-service-backend"
    for line in (f"ExecStartPre={script} load", f"ExecStart={script} run", "MemoryMax=300M", "Restart=on-failure"):
        assert line in unit
    assert not [line for line in unit if line.startswith(("User=", "ProtectSystem="))]


@pytest.mark.parametrize("made", [base(contained()), base(bridge={"master_uri": "http://10.64.0.30:11311"})])
def test_script_is_valid_sh(made: GatewayBase, tmp_path: Path) -> None:
    (script,) = [text for path, text in files(made).items() if path.startswith(FOLDER) and "." not in Path(path).name]
    (tmp_path / "script").write_text(script)
    done = subprocess.run(["sh", "-n", str(tmp_path / "script")], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_podman_is_installed_only_for_containers() -> None:
    def names(made: GatewayBase) -> set[str]:
        return {package.name for package in made.packages}

    assert names(base(contained())) - names(base()) == set(PACKAGES)
    off = {unit.name for unit in base(contained()).configuration.units if unit.enabled is False}
    assert {"podman-auto-update.timer", "podman.socket"} <= off
    assert not [unit for unit in base().configuration.units if unit.name.startswith("podman")]


def test_secrets_are_placeholders_in_inventory_order() -> None:
    rows = [
        {"name": "MODE", "value": "quay"},
        {"name": "B", "secret": "EXAMPLE-b"},
        {"name": "A", "secret": "EXAMPLE-a"},
    ]
    made = base(contained(environment=rows), contained("second", environment=rows[1:2]) | {"port": 18083})
    assert made.service_secrets == ("@secret B of backend@", "@secret A of backend@", "@secret B of second@")
    text = files(made)[f"{FOLDER}/atlantis-service-backend.env"]
    assert text == "MODE=quay\nB=@secret B of backend@\nA=@secret A of backend@\n"
    assert "EXAMPLE-b" not in repr(made)


def test_a_rehearsal_pins_its_own_archive() -> None:
    made = base(contained(), backend="b" * 64)
    assert f"sha256={'b' * 64}\n" in files(made)[f"{FOLDER}/atlantis-service-backend"]


def test_folder_size_is_checked_against_its_budget(tmp_path: Path) -> None:
    def over(folder: Path) -> bool:
        return subprocess.run(folder_budget_check("x", str(folder), 2).run, check=False).returncode != 0

    assert not over(tmp_path / "missing")
    (tmp_path / "small").write_bytes(bytes(1_000_000))
    assert not over(tmp_path)
    (tmp_path / "large").write_bytes(bytes(2_500_000))
    assert over(tmp_path)


def test_bridge_follows_the_vpn_and_the_dds_profile() -> None:
    made = base(bridge={"master_uri": "http://10.64.0.30:11311/", "topics": TOPICS})
    laid = files(made)
    unit = laid[f"/etc/systemd/system/{BRIDGE}"]
    assert "BindsTo=sys-subsystem-net-devices-tun0.device" in unit
    stem = f"{FOLDER}/atlantis-service-ros1-bridge"
    assert "--env-file /etc/atlantis/ros.env" in laid[stem]
    assert "--volume /etc/atlantis/dds:/etc/atlantis/dds:ro" in laid[stem]
    assert f"rosparam load {stem}.yaml && exec ros2 run ros1_bridge parameter_bridge" in laid[stem]
    assert "ROS_MASTER_URI=http://10.64.0.30:11311\n" in laid[f"{stem}.env"]
    assert laid[f"{stem}.yaml"].splitlines() == [
        "topics:",
        "  - {topic: /zarco/pose, type: geometry_msgs/msg/Pose, queue_size: 10}",
        "  - {topic: /zarco/config, type: std_msgs/msg/String, queue_size: 10}",
    ]
    host = SHIPPED.hosts[CENTRE]
    assert BRIDGE in {unit["name"] for unit in gateway_dds(SHIPPED, host).as_dict()["configure"]["units"]}


def test_all_topics_are_bridged_by_default() -> None:
    laid = files(base(bridge={"master_uri": "http://10.64.0.30:11311"}))
    assert "ros2 run ros1_bridge dynamic_bridge --bridge-all-topics" in laid[f"{FOLDER}/atlantis-service-ros1-bridge"]
    assert f"{FOLDER}/atlantis-service-ros1-bridge.yaml" not in laid


def test_the_master_alone_reaches_the_ports_of_the_bridge() -> None:
    laid = files(base(bridge={"master_uri": "http://10.64.0.30:11311"}))["/etc/nftables.conf"]
    assert 'ip saddr { 10.64.0.30/32 } tcp dport 32768-60999 accept comment "ROS 1"' in laid
    assert "32768" not in files(base())["/etc/nftables.conf"]
