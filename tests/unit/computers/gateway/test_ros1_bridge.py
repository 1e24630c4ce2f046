"""The bridge to ROS 1 as a package of foxy: where it comes from, what is laid down, and that no container is."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from atlantis_netcfg.computers import containers, services
from atlantis_netcfg.computers.dds import gateway_dds
from atlantis_netcfg.computers.ros1_bridge import SERVICE, packages, ros1_bridge
from atlantis_netcfg.computers.ros2 import ArchiveKey, StandIn, gateway_ros2
from atlantis_netcfg.emulator.lab.stubs import publish, ros_packages
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.inventory.model import Gateway, Ros1Bridge, Ros2
from atlantis_netcfg.operations.bundle import host_requirements
from atlantis_netcfg.operations.common.request import Request
from atlantis_netcfg.operations.computers.parts import PARTS

ROOT = Path(__file__).parents[4]
HOST = "coastal-gateway"
TOPICS = ({"topic": "/zarco/pose", "type": "geometry_msgs/msg/Pose"},)
MASTER = {"master_uri": "http://10.64.1.30:11311"}
ROS1 = "/etc/apt/sources.list.d/ros1.sources"


@pytest.fixture(scope="module")
def inventory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("inventory")
    archive = publish(folder / "archive", ros_packages("foxy"), codename="focal")
    own = shutil.copytree(ROOT / "inventory", folder / "inventory")
    (own / "keys").mkdir(exist_ok=True)
    (own / "keys" / "own.asc").write_bytes(archive.key)
    return own


def pilot(inventory: Path, bridge: dict[str, Any] | None, **ros2: str) -> Inventory:
    declaration = load(inventory)
    host = declaration.hosts[HOST]
    assert isinstance(host.device, Gateway)
    made = None if bridge is None else Ros1Bridge.model_validate({**MASTER, **bridge})
    device = host.device.model_copy(update={"ros1_bridge": made})
    declared = Ros2.model_validate({"origin": "snapshot", "key_file": "own.asc", **ros2})
    gateways = declaration.pilot.gateways.model_copy(update={"ros2": declared})
    return replace(
        declaration,
        pilot=declaration.pilot.model_copy(update={"gateways": gateways}),
        hosts={**declaration.hosts, HOST: replace(host, device=device)},
    )


def part(declaration: Inventory, stand_in: StandIn | None = None) -> dict[str, Any]:
    told: dict[str, Any] = gateway_ros2(declaration, declaration.hosts[HOST], stand_in).as_dict()
    return told


def sources(told: dict[str, Any]) -> dict[str, str]:
    return {each["path"]: each["content"] for each in told["packages"]["sources"]}


@pytest.mark.parametrize(
    ("ros2", "url"),
    [
        ({"origin": "snapshot"}, "http://snapshots.ros.org/noetic/final/ubuntu"),
        ({"origin": "live"}, "http://packages.ros.org/ros/ubuntu"),
        ({"ros1_mirror": "http://mirror.example/ros1"}, "http://mirror.example/ros1"),
    ],
)
def test_ros_1_packages_have_their_own_archive(inventory: Path, ros2: dict[str, str], url: str) -> None:
    told = part(pilot(inventory, {}, **ros2))
    assert {"ros-foxy-ros1-bridge", "ros-noetic-ros-comm"} <= {each["name"] for each in told["packages"]["packages"]}
    lines = sources(told)[ROS1].splitlines()
    assert f"URIs: {url}" in lines
    assert "Suites: focal" in lines
    assert "Signed-By: /usr/share/keyrings/ros2-archive-keyring.gpg" in lines
    assert "/etc/apt/sources.list.d/ros-latest.list" in told["packages"]["absent"], "another keyring for one address"


def test_both_snapshots_are_pinned(inventory: Path) -> None:
    declaration = pilot(inventory, {}, ros1_mirror="http://mirror.example/ros1")
    (pins,) = part(declaration)["packages"]["pins"]
    assert [line for line in pins["content"].splitlines() if line.startswith("Pin: origin")] == [
        'Pin: origin "snapshots.ros.org"',
        'Pin: origin "mirror.example"',
    ]


def test_nothing_of_ros_1_is_required_without_a_bridge(inventory: Path) -> None:
    for bridge in (None, {"archive": "bridge.tar", "sha256": "a" * 64}):
        told = part(pilot(inventory, bridge))
        assert list(sources(told)) == ["/etc/apt/sources.list.d/ros2.sources"]
        assert not {*packages("foxy")} & {each["name"] for each in told["packages"]["packages"]}
        assert ROS1 in told["packages"]["absent"]
        assert f"/etc/systemd/system/{SERVICE}" in told["configure"]["absent"]


def test_one_stand_in_archive_replaces_both(inventory: Path, tmp_path: Path) -> None:
    archive = publish(tmp_path / "archive", ros_packages("foxy", more=packages("foxy")), codename="focal")
    stand_in = StandIn("http://192.0.2.1", ArchiveKey(archive.key, archive.fingerprint), "focal", "ubuntu")
    told = part(pilot(inventory, {}), stand_in)
    (content,) = sources(told).values()
    assert "URIs: http://192.0.2.1" in content
    assert {*packages("foxy")} <= {each["name"] for each in told["packages"]["packages"]}


def test_bundle_covers_both_archives(inventory: Path, tmp_path: Path) -> None:
    declaration = pilot(inventory, {})
    parts = {"gateway_ros2": PARTS["gateway_ros2"]}
    wish = host_requirements(declaration, declaration.hosts[HOST], Request(state=tmp_path), parts=parts)
    assert [each.path for each in wish.sources] == ["/etc/apt/sources.list.d/ros2.sources", ROS1]
    assert {*packages("foxy")} <= {each.name for each in wish.packages}
    assert wish.archives == ()


def test_bridge_runs_without_a_container(inventory: Path) -> None:
    device = pilot(inventory, {}).hosts[HOST].device
    assert isinstance(device, Gateway)
    assert not {*containers.PACKAGES} & {*services.packages(device)}
    assert "ros1" not in str(services.services(device).files)


def test_unit_follows_the_vpn_and_the_dds_profile(inventory: Path) -> None:
    declaration = pilot(inventory, {"topics": TOPICS, "memory_mb": 300})
    told = part(declaration)["configure"]
    laid = {each["path"]: each["content"] for each in told["files"]}
    unit = laid[f"/etc/systemd/system/{SERVICE}"].splitlines()
    for line in (
        "BindsTo=sys-subsystem-net-devices-tun0.device",
        "EnvironmentFile=/etc/atlantis/ros.env",
        "ExecStart=/bin/sh /usr/local/lib/atlantis/ros1_bridge.sh",
        "Restart=always",
        "MemoryMax=300M",
        "User=svc-ros1-bridge",
    ):
        assert line in unit
    program = laid["/usr/local/lib/atlantis/ros1_bridge.sh"]
    assert program.index(". /opt/ros/noetic/setup.sh") < program.index(". /opt/ros/foxy/setup.sh")
    assert "rosparam load /etc/atlantis/ros1-bridge.yaml || exit 1\nros2 run ros1_bridge parameter_bridge &" in program
    row = "  - {topic: /zarco/pose, type: geometry_msgs/msg/Pose, queue_size: 10}\n"
    assert laid["/etc/atlantis/ros1-bridge.yaml"] == f"topics:\n{row}"
    units = gateway_dds(declaration, declaration.hosts[HOST]).as_dict()["configure"]["units"]
    assert SERVICE in {each["name"] for each in units}, "it reads the profile when it starts"


def test_all_topics_are_bridged_by_default() -> None:
    laid = {file.path: file.content for file in ros1_bridge(Ros1Bridge.model_validate(MASTER), "foxy").files}
    assert "dynamic_bridge --bridge-all-topics &" in laid["/usr/local/lib/atlantis/ros1_bridge.sh"]
    assert "/etc/atlantis/ros1-bridge.yaml" not in laid


def test_stopped_bridge_is_a_finding() -> None:
    (check,) = ros1_bridge(Ros1Bridge.model_validate(MASTER), "foxy").checks
    assert check.finding == "the bridge to ROS 1 is not running, although the VPN interface exists"
