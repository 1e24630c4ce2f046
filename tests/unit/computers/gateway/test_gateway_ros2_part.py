"""The part `gateway_ros2` of the shipped pilot, and of pilots that differ from it in one thing."""

import shutil
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from atlantis_netcfg.computers.ros2 import RELEASES, ArchiveKey, GatewayRos2, StandIn, archive_key, gateway_ros2
from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.emulator.lab.stubs import StubArchive, publish
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.inventory.model import Dds, Gateways, Ros2, RosDistribution, RosMiddleware, RosOrigin

ROOT = Path(__file__).parents[4]
HOST = "coastal-gateway"
NOW = datetime.now(UTC)
FOXY = Dds(distribution=RosDistribution.FOXY)
SNAPSHOT = {"origin": "snapshot", "key_file": "own.asc"}


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> StubArchive:
    return publish(tmp_path_factory.mktemp("archive") / "archive", [], codename="focal")


@pytest.fixture
def inventory(tmp_path: Path, archive: StubArchive) -> Path:
    shutil.copytree(ROOT / "inventory", tmp_path / "inventory")
    (tmp_path / "inventory" / "keys").mkdir(exist_ok=True)
    (tmp_path / "inventory" / "keys" / "own.asc").write_bytes(archive.key)
    return tmp_path / "inventory"


def pilot(inventory: Path, ros2: dict[str, Any] | None, dds: Dds | None = FOXY) -> Inventory:
    declaration = load(inventory)
    gateways = Gateways(ros2=None if ros2 is None else Ros2.model_validate(ros2))
    changed = declaration.pilot.model_copy(update={"gateways": gateways, "dds": dds})
    return replace(declaration, pilot=changed)


def part(inventory: Path, ros2: dict[str, Any] | None, dds: Dds | None = FOXY, **how: Any) -> GatewayRos2:  # noqa: ANN401
    declaration = pilot(inventory, ros2, dds)
    return gateway_ros2(declaration, declaration.hosts[HOST], **how)


def talker(told: dict[str, Any]) -> dict[str, Any]:
    """The step that tries ROS 2 on the computer; the others are the recording's."""
    (step,) = (step for step in told["configure"]["steps"] if step["name"] == "talker and listener of ROS 2")
    return dict(step)


def test_nothing_is_required_without_ros(inventory: Path) -> None:
    assert part(inventory, None).as_dict() == {"packages": None, "configure": None}


def test_foxy_comes_from_its_final_snapshot(inventory: Path, archive: StubArchive) -> None:
    told = part(inventory, {**SNAPSHOT, "pins": [{"package": "ros-foxy-ros-base", "version": "0.9.2-1*"}]}).as_dict()
    asked = told["packages"]
    assert asked["packages"] == [
        {"name": "ros-foxy-ros-base", "version": "0.9.2-1*"},
        {"name": "ros-foxy-demo-nodes-cpp", "version": None},
        {"name": "ros-foxy-demo-nodes-py", "version": None},
        {"name": "python3-colcon-common-extensions", "version": None},
    ]
    (source,) = asked["sources"]
    assert "URIs: http://snapshots.ros.org/foxy/final/ubuntu\nSuites: focal\nComponents: main\n" in source["content"]
    (key,) = asked["keys"]
    assert key["fingerprint"] == archive.fingerprint
    assert f"Signed-By: {key['path']}\n" in source["content"]
    (pins,) = asked["pins"]
    assert pins["content"].splitlines()[1:] == [
        *("", "Package: *", 'Pin: origin "snapshots.ros.org"', "Pin-Priority: 1001"),
        *("", "Package: ros-foxy-ros-base", "Pin: version 0.9.2-1*", "Pin-Priority: 1001"),
    ]
    assert asked["expected"] == {"codename": "focal", "distribution": "ubuntu", "architectures": ["amd64", "arm64"]}
    assert asked["notes"] == ["ROS 2 foxy has been without security updates since 2023-06-20"]


@pytest.mark.parametrize(
    ("release", "codename", "alone"),
    [("humble", "jammy", "ROS_LOCALHOST_ONLY=1"), ("jazzy", "noble", "ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST")],
)
def test_supported_release_comes_from_the_live_archive(
    inventory: Path, release: str, codename: str, alone: str
) -> None:
    dds = Dds(distribution=RosDistribution(release), middleware=RosMiddleware.CYCLONE_DDS)
    told = part(inventory, {"origin": "live", "key_file": "own.asc"}, dds, now=NOW).as_dict()
    assert (
        f"URIs: http://packages.ros.org/ros2/ubuntu\nSuites: {codename}\n" in told["packages"]["sources"][0]["content"]
    )
    assert told["packages"]["pins"][0]["content"].splitlines()[1:] == []
    assert told["packages"]["notes"] == []
    assert f"ros-{release}-rmw-cyclonedds-cpp" in [package["name"] for package in told["packages"]["packages"]]
    step = talker(told)
    assert alone in step["run"]
    assert f"/opt/ros/{release}" in step["run"]


def test_localhost_setting_of_the_test_is_not_installed(inventory: Path) -> None:
    told = part(inventory, SNAPSHOT).as_dict()
    assert not any("LOCALHOST_ONLY=" in file["content"] for file in told["configure"]["files"])


def test_test_is_repeated_after_a_package_change(inventory: Path) -> None:
    told = part(inventory, {**SNAPSHOT, "packages": ["ros-foxy-nav-msgs"]}).as_dict()
    assert "/var/lib/dpkg/info/ros-foxy-nav-msgs.md5sums" in talker(told)["after"]


def test_snapshot_of_a_supported_release_needs_its_date(inventory: Path) -> None:
    humble = Dds(distribution=RosDistribution.HUMBLE)
    with pytest.raises(UsageError, match="no final snapshot of humble"):
        part(inventory, SNAPSHOT, humble)
    mirror = "http://snapshots.ros.org/humble/2026-01-31/ubuntu"
    told = part(inventory, {**SNAPSHOT, "mirror": mirror}, humble).as_dict()
    assert f"URIs: {mirror}\nSuites: jammy\n" in told["packages"]["sources"][0]["content"]


def test_release_is_unknown_without_dds(inventory: Path) -> None:
    with pytest.raises(UsageError, match="the release of ROS 2 is unknown"):
        part(inventory, SNAPSHOT, None)


def test_stand_ins_replace_the_archive(inventory: Path, archive: StubArchive) -> None:
    key = ArchiveKey(archive.key, archive.fingerprint)
    stand_in = StandIn("http://10.64.1.1:8000", key, "bookworm", "debian")
    told = part(inventory, {"origin": "snapshot"}, stand_in=stand_in).as_dict()["packages"]
    assert "URIs: http://10.64.1.1:8000\nSuites: bookworm\n" in told["sources"][0]["content"]
    assert told["expected"]["distribution"] == "debian"
    assert any("stand-ins replace the packages of ROS 2" in note for note in told["notes"])


def test_archive_key_must_exist_and_match(inventory: Path, archive: StubArchive) -> None:
    with pytest.raises(UsageError, match=r"is missing: keys/ros-snapshots\.asc") as missing:
        part(inventory, {"origin": "snapshot"})
    assert "0x4B63CF8FDE49746E98FA01DDAD19BAB3CBF125EA" in str(missing.value.hint)
    (inventory / "keys" / "ros-snapshots.asc").write_bytes(archive.key)
    with pytest.raises(UsageError, match=f"of the inventory is a different key: {archive.fingerprint}, not 4B63"):
        part(inventory, {"origin": "snapshot"})


@pytest.mark.parametrize(
    ("content", "why"), [(b"<html>", "is not a public key: it is neither"), (2, "contains 2 keys")], ids=["html", "two"]
)
def test_invalid_key_file_is_refused(inventory: Path, archive: StubArchive, content: bytes | int, why: str) -> None:
    (inventory / "keys" / "own.asc").write_bytes(archive.key * content if isinstance(content, int) else content)
    with pytest.raises(UsageError, match=why):
        part(inventory, SNAPSHOT)


def test_expiring_key_is_noted_and_expired_key_refused(inventory: Path) -> None:
    row = RELEASES[RosDistribution.FOXY].archives[RosOrigin.SNAPSHOT]
    assert archive_key(inventory, row, "own.asc", NOW).note is None
    soon = archive_key(inventory, row, "own.asc", NOW + timedelta(days=310)).note
    assert soon is not None
    assert "expires on" in soon
    with pytest.raises(UsageError, match="expired on"):
        archive_key(inventory, row, "own.asc", NOW + timedelta(days=400))
