"""The recording of a gateway: what is laid down, and a folder that keeps within its budget while something writes."""

import os
import signal
import stat
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from waiting import HANG_S

from atlantis_netcfg.computers.dds import gateway_dds
from atlantis_netcfg.computers.recording import SERVICE, packages, recording
from atlantis_netcfg.computers.ros2 import ArchiveKey, StandIn, gateway_ros2
from atlantis_netcfg.emulator.lab.stubs import publish, ros_packages
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.inventory.model import Gateway, Recording

ROOT = Path(__file__).parents[4]
PROGRAM = ROOT / "templates/gateway/recording.py"
SHIPPED = load(ROOT / "inventory")
HOST = "coastal-gateway"
DECLARED = Recording.model_validate({"topics": ["/girona500/pose", "/girona500/config"], "budget_mb": 80})


def with_recording() -> Inventory:
    box = SHIPPED.hosts[HOST]
    assert isinstance(box.device, Gateway)
    device = box.device.model_copy(update={"recording": DECLARED})
    return replace(SHIPPED, hosts={**SHIPPED.hosts, HOST: replace(box, device=device)})


def test_the_unit_records_the_declared_topics() -> None:
    (unit,) = (file.content for file in recording(DECLARED, "foxy").files if file.path.endswith(".service"))
    words = "/opt/ros/foxy/setup.sh /var/lib/svc-recording 80 /girona500/pose /girona500/config"
    assert f"ExecStart=/usr/bin/python3 /usr/local/lib/atlantis/recording.py {words}" in unit.splitlines()
    assert "EnvironmentFile=/etc/atlantis/ros.env" in unit.splitlines()


def test_stopped_recording_is_a_finding() -> None:
    (check,) = recording(DECLARED, "foxy").checks
    assert check.finding == "the recording is not running, although the VPN interface exists"


def test_undeclared_recording_is_removed() -> None:
    made = recording(None, "foxy")
    assert (made.files, made.units, made.checks) == ((), (), ())
    assert f"/etc/systemd/system/{SERVICE}" in made.absent


def test_packages_are_installed_with_ros(tmp_path: Path) -> None:
    archive = publish(tmp_path / "archive", ros_packages("foxy", more=packages("foxy")), codename="focal")
    stand_in = StandIn("http://192.0.2.1", ArchiveKey(archive.key, archive.fingerprint), "focal", "ubuntu")
    declaration = with_recording()
    made = gateway_ros2(declaration, declaration.hosts[HOST], stand_in)
    assert set(packages("foxy")) <= {package.name for package in made.packages}
    assert SERVICE in {unit.name for unit in made.configuration.units}
    assert SERVICE in {
        unit["name"] for unit in gateway_dds(declaration, declaration.hosts[HOST]).as_dict()["configure"]["units"]
    }


class Recorder:
    """The program as the unit starts it, with a stand-in for ROS 2."""

    def __init__(self, folder: Path, budget_mb: int) -> None:
        self.bags = folder / "bags"
        self.bags.mkdir()
        ros = folder / "ros2"
        source = ROOT / "atlantis_netcfg/emulator/lab/stubs/programs/ros2.py"
        ros.write_text(
            f"#!{sys.executable}\n{source.read_text()}".replace("PAUSE_S = 100_000, 0.05", "PAUSE_S = 100_000, 0.03")
        )
        ros.chmod(ros.stat().st_mode | stat.S_IXUSR)
        (folder / "setup.sh").write_text(f"PATH={folder}:$PATH\n")
        self.budget = budget_mb * 1_000_000
        words = (str(PROGRAM), str(folder / "setup.sh"), str(self.bags), str(budget_mb), "/a", "/b")
        self.running = subprocess.Popen([sys.executable, *words], stdout=subprocess.PIPE, text=True)

    @property
    def held(self) -> int:
        total = 0
        for path in self.bags.rglob("*"):
            try:
                total += path.stat().st_size if path.is_file() else 0
            except FileNotFoundError:
                continue  # it has just gone
        return total

    @property
    def files(self) -> list[str]:
        return sorted(path.name for path in self.bags.rglob("*.db3"))


@pytest.fixture
def recorder(tmp_path: Path) -> Iterator[Recorder]:
    made = Recorder(tmp_path, budget_mb=8)
    yield made
    made.running.terminate()  # and not killed: it ends the recorder, which has a session of its own
    made.running.communicate(timeout=HANG_S)


def test_oldest_recording_is_removed_before_the_budget_is_exceeded(recorder: Recorder) -> None:
    most, until = 0, time.monotonic() + HANG_S
    while not any("_12.db3" in name for name in recorder.files):
        assert time.monotonic() < until, recorder.files
        assert recorder.running.poll() is None
        most = max(most, recorder.held)
        os.sched_yield()
    assert recorder.budget // 2 < most <= recorder.budget
    assert not any("_0.db3" in name for name in recorder.files), "the oldest has gone"
    recorder.running.send_signal(signal.SIGTERM)
    said, _ = recorder.running.communicate(timeout=HANG_S)
    assert recorder.running.returncode == 0
    assert "removed the oldest" in said
    assert list(recorder.bags.rglob("metadata.yaml")), "the bag was closed"


def values(**change: Any) -> dict[str, Any]:  # noqa: ANN401 - keys of the declaration
    return {"topics": ["/a"], "budget_mb": 80, **change}


@pytest.mark.parametrize("change", [{"topics": []}, {"budget_mb": 79}, {"topics": ["pose"]}, {"folder": "/etc/bags"}])
def test_invalid_recording_is_refused(change: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"topics|budget_mb|folder"):
        Recording.model_validate(values(**change))
