"""The role `gateway_ros2` on a real Debian with systemd, by SSH, from a signed archive of stand-ins."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
from gateway_role import Stand
from gateway_stand import Key, Start, ground, machine, technician  # noqa: F401 - fixtures

from atlantis_netcfg.computers import ros1_bridge
from atlantis_netcfg.computers.recording import SERVICE, packages
from atlantis_netcfg.emulator.lab import Lab
from atlantis_netcfg.emulator.lab.stubs import StubArchive, StubPackage, publish, ros_packages

pytestmark = [pytest.mark.namespace, pytest.mark.slow]

UBUNTU = "ID=ubuntu\nVERSION_CODENAME=focal\n"
FIRST, SECOND = "0.9.2-1stand.in", "0.9.3-1stand.in"
STEP = "step talker and listener of ROS 2"
SOURCE = "/etc/apt/sources.list.d/ros2.sources"
MASTER = "http://192.0.2.30:11311"


@dataclass
class Ros:
    """A gateway that says it is an Ubuntu 20.04, and an archive that it reaches."""

    stand: Stand
    serve: Callable[[StubArchive], str]

    def declare(self, archive: StubArchive, **more: object) -> None:
        keys = self.stand.inventory / "keys"
        keys.mkdir(exist_ok=True)
        (keys / "stand-in.gpg").write_bytes(archive.key)
        ros2 = {"origin": "snapshot", "mirror": self.serve(archive), "key_file": "stand-in.gpg", **more}
        self.stand.declare({"gateways": {"ros2": ros2}})


@pytest.fixture
def ros(ground: Lab, machine: Start, technician: Key, tmp_path: Path) -> Ros:  # noqa: F811 - fixtures
    stand = Stand(machine("coastal-gateway"), technician, tmp_path, ["gateway_ros2"])
    stand.gateway.run("rm -f /etc/os-release /etc/apt/sources.list /etc/apt/sources.list.d/*")
    stand.gateway.put("/etc/os-release", UBUNTU)
    return Ros(stand, lambda archive: ground.serve(archive.folder))


def test_ros2_is_installed_works_and_changes_version(ros: Ros, tmp_path: Path) -> None:
    every = (*ros_packages("foxy", FIRST), *ros_packages("foxy", SECOND))
    archive = publish(tmp_path / "archive", every, codename="focal")
    versions = [{"package": f"ros-foxy-{name}", "version": "0.9.2-1*"} for name in ("ros-base", "ros-core")]
    ros.declare(archive, packages=["ros-foxy-ros-core"], pins=versions)

    planned = ros.stand.run("--check")
    assert ros.stand.gateway.run(f"ls {SOURCE} /opt/ros", check=False).stdout == ""
    done = ros.stand.run()
    assert done["status"] == "changed", done
    assert {change.split()[1] for change in planned["changes"]} == {change.split()[1] for change in done["changes"]}
    assert f"package ros-foxy-ros-base {FIRST}" in done["changes"]
    assert f"package ros-foxy-demo-nodes-py {SECOND}" in done["changes"]
    assert STEP in done["changes"]
    assert any("without security updates since 2023-06-20" in note for note in done["notes"])
    assert any("the listener of ROS 2 heard the talker 3 times" in note for note in done["notes"])
    login = ros.stand.gateway.run("env -i sh -lc env").stdout
    assert "ROS_DISTRO=foxy" in login
    assert "LOCALHOST" not in login
    assert ros.stand.run()["changes"] == []

    ros.declare(archive, packages=["ros-foxy-ros-core"], pins=[{**pin, "version": SECOND} for pin in versions])
    assert {f"package ros-foxy-ros-base {SECOND}"} <= {*ros.stand.run()["changes"]}
    ros.declare(archive, packages=["ros-foxy-ros-core"], pins=versions)
    assert {f"package ros-foxy-ros-base {FIRST}"} <= {*ros.stand.run()["changes"]}
    assert ros.stand.run()["changes"] == []


def test_listener_that_receives_nothing_fails_the_gateway(ros: Ros, tmp_path: Path) -> None:
    listener = "/opt/ros/foxy/lib/demo_nodes_py/listener"
    deaf = StubPackage("ros-foxy-demo-nodes-py", "1.0", files={listener: "#!/bin/sh\necho no middleware\nexit 3\n"})
    others = [package for package in ros_packages("foxy") if package.name != deaf.name]
    ros.declare(publish(tmp_path / "archive", [*others, deaf], codename="focal"))
    told = ros.stand.run()
    assert told["status"] == "left-as-found", told
    assert "heard the talker 0 times" in told["message"]
    assert "listener: no middleware" in told["message"]


def test_wrong_system_expired_key_or_empty_archive_changes_nothing(ros: Ros, tmp_path: Path) -> None:
    archive = publish(tmp_path / "archive", ros_packages("foxy"), codename="focal", architectures=("arm64",))
    ros.declare(archive)
    told = ros.stand.run()
    assert "focal has no packages for amd64, this computer's architecture" in told["message"]
    assert ros.stand.gateway.run(f"ls {SOURCE}", check=False).stdout == ""

    ros.stand.gateway.put("/etc/os-release", UBUNTU.replace("focal", "jammy"))
    told = ros.stand.run()
    assert "the computer runs ubuntu jammy; the inventory is for ubuntu focal" in told["message"]
    assert told["changes"] == []


def test_recording_service_is_installed_records_and_is_removed(ros: Ros, tmp_path: Path) -> None:
    """The unit waits for the VPN's interface, which is not there: its very program is started by hand."""
    every = ros_packages("foxy", more=packages("foxy"))
    ros.declare(publish(tmp_path / "archive", every, codename="focal"))
    declared = {"topics": ["/girona500/pose"], "budget_mb": 80}
    ros.stand.declare({"recording": declared}, "host_vars/coastal-gateway.yml", "device")
    told = ros.stand.run()
    assert (told["status"], told["exit"]) == ("changed", 0), told["message"]
    assert "package ros-foxy-ros2bag 0.9.2-1stand.in" in told["changes"]
    assert ros.stand.run()["changes"] == []
    on = ros.stand.gateway.run
    start = on(f"sed -n 's/^ExecStart=//p' /etc/systemd/system/{SERVICE}").stdout.strip()
    bounds = "--property=User=svc-recording --property=ProtectSystem=strict --property=KillMode=mixed"
    place = "--property=ReadWritePaths=/var/lib/svc-recording"
    on(f"systemd-run --unit recorded {bounds} {place} {start}")
    on("timeout 60 sh -c 'until [ -s /var/lib/svc-recording/bag-*/*_0.db3 ]; do sleep 0.2; done'")
    on("systemctl stop recorded")
    assert on("ls /var/lib/svc-recording/bag-*/metadata.yaml").stdout, "the bag was closed"
    ros.stand.declare({"recording": None}, "host_vars/coastal-gateway.yml", "device")
    assert f"absent /etc/systemd/system/{SERVICE}" in ros.stand.run()["changes"]
    assert on(f"systemctl is-enabled {SERVICE}", check=False).returncode != 0
    assert ros.stand.run()["changes"] == []


def test_ros1_bridge_is_installed_waits_and_is_removed(ros: Ros, tmp_path: Path) -> None:
    """Its program is started by hand, as that of the recording; of ROS 1 there is no more than its set-up file."""
    archive = publish(tmp_path / "archive", ros_packages("foxy", more=ros1_bridge.packages("foxy")), codename="focal")
    ros.declare(archive, ros1_mirror=ros.serve(archive))
    ros.stand.declare({"ros1_bridge": {"master_uri": MASTER}}, "host_vars/coastal-gateway.yml", "device")
    told = ros.stand.run()
    assert (told["status"], told["exit"]) == ("changed", 0), told["message"]
    assert f"package ros-noetic-ros-comm {FIRST}" in told["changes"]
    assert f"package ros-foxy-ros1-bridge {FIRST}" in told["changes"]
    on = ros.stand.gateway.run
    assert on("cat /etc/apt/sources.list.d/ros1.sources").stdout.startswith("# atlantis: the archive of ROS 1.")
    assert ros.stand.run()["changes"] == []
    unit = f"/etc/systemd/system/{ros1_bridge.SERVICE}"
    assert on(f"systemd-analyze verify --man=no {unit}", check=False).stderr == ""
    start = on(f"sed -n 's/^ExecStart=//p' {unit}").stdout.strip()
    on(f"systemd-run --unit bridged --property=User=svc-ros1-bridge --property=ProtectSystem=strict {start}")
    on("timeout 60 sh -c 'until journalctl --unit bridged --output cat | grep -q waiting; do sleep 0.2; done'")
    assert f"waiting for the master of ROS 1 at {MASTER}" in on("journalctl --unit bridged --output cat").stdout
    assert on("systemctl is-active bridged").stdout.strip() == "active"
    on("systemctl stop bridged")
    ros.stand.declare({"ros1_bridge": None}, "host_vars/coastal-gateway.yml", "device")
    assert f"absent {unit}" in ros.stand.run()["changes"]
    assert on("ls /etc/apt/sources.list.d").stdout.split() == ["ros2.sources"]
    assert ros.stand.run()["changes"] == []
