"""The program of the bridge to ROS 1 beside a real master, Debian's `roscore`; a stand-in for the bridge's binary only.

In a namespace with its loopback. The set-up files of ROS are stand-ins as well: Debian's ROS 1 is in the system's path.
"""

import os
import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from waiting import HANG_S, wait_until

from atlantis_netcfg.computers.ros1_bridge import ros1_bridge
from atlantis_netcfg.inventory.model import Ros1Bridge

pytestmark = [
    pytest.mark.namespace,
    pytest.mark.skipif(os.geteuid() != 0, reason="making a network namespace needs root"),
]
URI = "http://127.0.0.1:11311"
TOPICS = [{"topic": "/zarco/pose", "type": "geometry_msgs/msg/Pose"}]
STAND_IN = """\
#!/bin/sh
# In place of `ros2 run ros1_bridge PROGRAM`.
exec > "$HOME/said.new" 2>&1
echo "words $*"; echo "master $ROS_MASTER_URI"; echo "address $ROS_IP"
rosparam get /topics
mv "$HOME/said.new" "$HOME/said"
exec sleep 1000
"""
Start = Callable[..., subprocess.Popen[str]]


class Ground:
    """A namespace, and processes in it."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.name = folder, f"ros1-{os.getpid()}"
        self.processes: list[subprocess.Popen[str]] = []
        subprocess.run(["ip", "netns", "add", self.name], check=True)
        subprocess.run(["ip", "-n", self.name, "link", "set", "lo", "up"], check=True)

    def start(self, *words: str, **environment: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            ["ip", "netns", "exec", self.name, *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={**os.environ, "HOME": str(self.folder), "ROS_LOG_DIR": str(self.folder / "log"), **environment},
            start_new_session=True,
        )
        self.processes.append(process)
        return process

    def master(self) -> subprocess.Popen[str]:
        """Start one, and return when it answers."""
        made = self.start("roscore", ROS_MASTER_URI=URI, ROS_IP="127.0.0.1")
        wait_until(lambda: self.start("rosparam", "get", "/run_id", ROS_MASTER_URI=URI).wait(HANG_S) == 0, every_s=0.2)
        return made

    def close(self) -> None:
        for process in self.processes:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
            if process.stdout is not None:
                process.stdout.close()
        subprocess.run(["ip", "netns", "delete", self.name], check=True)


@pytest.fixture
def ground(tmp_path: Path) -> Iterator[Ground]:
    made = Ground(tmp_path)
    yield made
    made.close()


def program(folder: Path, *topics: dict[str, str]) -> Path:
    """As it is laid down, with stand-ins for what ROS brings and less patience between two looks at the master."""
    bridge = Ros1Bridge.model_validate({"master_uri": URI, "topics": topics})
    laid = {file.path: file.content for file in ros1_bridge(bridge, "foxy").files}
    (folder / "ros1-bridge.yaml").write_text(laid.get("/etc/atlantis/ros1-bridge.yaml", ""))
    (folder / "ros2").write_text(STAND_IN)
    (folder / "ros2").chmod(0o755)
    (folder / "setup.sh").write_text(f"PATH={folder}:$PATH\n")
    text = laid["/usr/local/lib/atlantis/ros1_bridge.sh"]
    assert text.count("sleep 10 &") == 1
    for old, new in (
        ("sleep 10 &", "sleep 0.5 &"),
        ("/opt/ros/noetic", str(folder)),
        ("/opt/ros/foxy", str(folder)),
        ("/etc/atlantis/ros1-bridge.yaml", str(folder / "ros1-bridge.yaml")),
    ):
        text = text.replace(old, new)
    path = folder / "ros1_bridge.sh"
    path.write_text(text)
    return path


def said(folder: Path) -> list[str]:
    wait_until((folder / "said").exists)
    return (folder / "said").read_text().splitlines()


def children(process: subprocess.Popen[str]) -> list[str]:
    found = subprocess.run(["pgrep", "-g", str(process.pid)], capture_output=True, text=True, check=False)
    return found.stdout.split()


def test_bridge_waits_for_the_master_and_sets_the_topics(ground: Ground, tmp_path: Path) -> None:
    bridge = ground.start("sh", str(program(tmp_path, *TOPICS)))
    assert bridge.stdout is not None
    assert bridge.stdout.readline() == f"waiting for the master of ROS 1 at {URI}\n"
    with pytest.raises(subprocess.TimeoutExpired):
        bridge.wait(5)
    assert not (tmp_path / "said").exists(), "nothing is bridged without a master"
    ground.master()
    words, master, address, *topics = said(tmp_path)
    assert (words, master, address) == (
        "words run ros1_bridge parameter_bridge",
        f"master {URI}",
        "address 127.0.0.1",
    )
    assert [line.strip() for line in topics if line.strip()] == [
        "- queue_size: 10",
        "topic: /zarco/pose",
        "type: geometry_msgs/msg/Pose",
    ], "as the real master has them"
    bridge.send_signal(signal.SIGTERM)
    assert bridge.wait(HANG_S) == 143
    wait_until(lambda: not children(bridge), lambda: "the bridge goes with it")


@pytest.mark.slow
def test_bridge_exits_when_another_master_starts(ground: Ground, tmp_path: Path) -> None:
    first = ground.master()
    bridge = ground.start("sh", str(program(tmp_path)))
    assert said(tmp_path)[0] == "words run ros1_bridge dynamic_bridge --bridge-all-topics"
    first.send_signal(signal.SIGINT)
    first.wait(HANG_S)
    with pytest.raises(subprocess.TimeoutExpired):
        bridge.wait(3)  # a master that is away for a while may be the same one
    ground.master()
    assert bridge.wait(HANG_S) == 1
    assert bridge.stdout is not None
    assert bridge.stdout.read().splitlines()[-1] == "another master of ROS 1 has started"
    wait_until(lambda: not children(bridge), lambda: "the bridge goes with it")
