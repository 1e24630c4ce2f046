"""The program that listens elsewhere: it is one file of Python 3.8, and hears by ROS 2's own library as well.

No ROS 2 is here: a stand-in offers what the documentation of rclpy has.
"""

import ast
import json
import os
import struct
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import robot_cases

from atlantis_netcfg.cli import main
from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.processes.remote_process import ProcessResult
from atlantis_netcfg.inventory.robots.key_names import KeyNames
from atlantis_netcfg.inventory.robots.reading import read_declared
from atlantis_netcfg.operations.robots import remote
from atlantis_netcfg.operations.robots.remote import ListenError, listen_there
from atlantis_netcfg.robots import listener
from atlantis_netcfg.robots.message_types import MessageTypes
from atlantis_netcfg.robots.observation import RobotObservation, judge

STAND_INS = {
    "rclpy/__init__.py": "from ros_stand_in import create_node, init, spin_once",
    "rclpy/qos.py": "from ros_stand_in import qos_profile_sensor_data",
    "rosidl_runtime_py/__init__.py": "",
    "rosidl_runtime_py/utilities.py": "from ros_stand_in import get_message",
}
NUMBER, FIX = "std_msgs/msg/Float32", "sensor_msgs/msg/NavSatFix"
MOST = 12_000
"""Bytes that go to the other computer, the types of all messages included."""
AGE_S = 60
REQUESTED = {"domain": 7, "address": "127.0.0.1", "profile": "", "topic": "/atlantis/configuration", "types": {}}


def text_of(namespace: str) -> str:
    (sparus,) = [each for each in read_declared(robot_cases.shipped(), KeyNames()) if each.vehicle == "sparus"]
    return sparus.text().replace("namespace: sparus", f"namespace: {namespace}")


def string(text: str) -> bytes:
    data = text.encode() + b"\0"
    return b"\0\1\0\0" + struct.pack("<I", len(data)) + data


def fix(latitude: float) -> bytes:
    return b"\0\1\0\0" + struct.pack("<iIId", int(time.time()) - AGE_S, 0, 0, latitude)


def number(value: float) -> bytes:
    return b"\0\0\0\0" + struct.pack(">f", value)


def row(topic: str, kind: str, robot: int, rate_hz: float, *messages: bytes) -> dict[str, Any]:
    identity = f"0110{robot:02d}" + "00" * 9 + "0102"
    node = {"node": "driver", "namespace": f"/robot{robot}", "gid": identity, "reliable": robot == 1}
    return {"topic": topic, "type": kind, **node, "rate_hz": rate_hz, "messages": [each.hex() for each in messages]}


def run(rows: Sequence[dict[str, Any]], folder: Path, seconds: float) -> RobotObservation:
    """The whole program, as it is sent, where cyclonedds is not."""
    (folder / "network.json").write_text(json.dumps(rows))
    for name, text in STAND_INS.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
    requested = {
        "domain": 7,
        "address": "127.0.0.1",
        "profile": "",
        "seconds": seconds,
        "topic": "/atlantis/configuration",
        "types": {},
    }
    done = subprocess.run(
        [sys.executable, "-S", "-c", remote._BOOT],
        input=remote._program(requested),
        capture_output=True,
        check=False,
        env={
            **os.environ,
            "PYTHONPATH": f"{folder}:{Path(__file__).parent}",
            "ROS_STAND_IN": str(folder / "network.json"),
        },
    )
    assert done.stderr == b""
    host = robot_cases.shipped().hosts["coastal-gateway"]
    return remote._observation(host, {}, ProcessResult(done.returncode, done.stdout, done.stderr, overdue=False))


def test_listener_uses_only_python_3_8_and_the_standard_library() -> None:
    assert listener.__file__ is not None
    tree = ast.parse(Path(listener.__file__).read_text(), feature_version=(3, 8))
    known = {*sys.stdlib_module_names, "cyclonedds", "rclpy", "rosidl_runtime_py"}
    for node in ast.walk(tree):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        assert {name.partition(".")[0] for name in names} <= known


def test_ros_listener_sees_each_robot_and_counts_its_messages(tmp_path: Path) -> None:
    rows = [
        row("/atlantis/configuration", "std_msgs/msg/String", 1, 1.0, string(text_of("sparus"))),
        row("/atlantis/configuration", "std_msgs/msg/String", 2, 1.0, string(text_of("other"))),
        row("/sparus/depth", NUMBER, 1, 4.0, number(1.0), number(2.0)),
        row("/sparus/fix", FIX, 1, 2.0, fix(41.0), fix(42.0)),
        row("/sparus/leak", "c4i_asset_msgs/msg/BoolTimestamped", 1, 2.0, b""),
        row("/sparus/battery/voltage", NUMBER, 1, 2.0, b"\0\1"),
    ]
    seen = run(rows, tmp_path, 4.5)
    assert seen.program == "rclpy"
    assert seen.participants == {f"0110{robot:02d}" + "00" * 9: f"/robot{robot}/driver" for robot in (1, 2)}
    assert sorted(each.text.decode() for each in seen.configurations) == sorted(map(text_of, ("sparus", "other")))
    assert all(0.8 <= (each.writer.rate_hz or 0) <= 1.25 for each in seen.configurations)
    heard = {each.topic: each for each in seen.writers}
    depth, position = heard["/sparus/depth"], heard["/sparus/fix"]
    assert 3.5 <= (depth.rate_hz or 0) <= 4.5
    assert (depth.type, depth.size_bytes, len(depth.contents), depth.stamp_age_s) == (NUMBER, 8, 2, None)
    assert (depth.reliable, len(position.contents)) == (True, 2)
    assert position.stamp_age_s == pytest.approx(AGE_S, abs=8)
    assert seen.unread == {"/sparus/leak": "c4i_asset_msgs/msg/BoolTimestamped"}
    declared = [each for each in read_declared(robot_cases.shipped(), KeyNames()) if each.vehicle == "sparus"]
    reports = {each.namespace: each for each in judge(seen, declared, ["sparus"], KeyNames())}
    codes = {name: {each.code for each in report.findings} for name, report in reports.items()}
    assert codes["sparus"] == {"topic-missing", "topic-stale", "topic-type", "topic-unread"}
    assert codes["other"] == {"robot-unknown", "topic-missing"}


def test_ros_listener_reports_two_robots_in_one_namespace(tmp_path: Path) -> None:
    texts = [text_of("sparus"), text_of("sparus").replace("EXAMPLE-sparus-token", "another")]
    rows = [row("/atlantis/configuration", "std_msgs/msg/String", n, 1.0, string(each)) for n, each in enumerate(texts)]
    seen = run(rows, tmp_path, 3.5)
    (report,) = judge(seen, [], [], KeyNames())
    assert "namespace-twice" in {each.code for each in report.findings}


def test_later_robot_is_not_taken_for_a_duplicate(tmp_path: Path) -> None:
    first, second = (
        row("/atlantis/configuration", "std_msgs/msg/String", n, 1.0, string(text_of(name)))
        for n, name in enumerate(("sparus", "other"))
    )
    seen = run([first, {**second, "from_s": 1.5}], tmp_path, 5.0)
    codes = {each.namespace: {one.code for one in each.findings} for each in judge(seen, [], [], KeyNames())}
    assert codes == {name: {"robot-unknown", "topic-missing"} for name in ("sparus", "other")}


def test_missing_dds_libraries_are_reported() -> None:
    requested = {
        "domain": 7,
        "address": "127.0.0.1",
        "profile": "",
        "seconds": 1,
        "topic": "/atlantis/configuration",
        "types": {},
    }
    done = subprocess.run(
        [sys.executable, "-S", "-c", remote._BOOT],
        input=remote._program(requested),
        capture_output=True,
        check=False,
    )
    host = robot_cases.shipped().hosts["coastal-gateway"]
    with pytest.raises(ListenError, match="neither cyclonedds nor ROS 2"):
        remote._observation(host, {}, ProcessResult(0, done.stdout, b"", overdue=False))


def test_program_sent_to_the_host_is_small() -> None:
    types = MessageTypes().fields
    assert len(remote._program({"types": types})) < MOST


ACCESS = {"host": "10.64.1.10", "port": 22, "user": "root"}


@pytest.mark.parametrize(
    ("ended", "words"),
    [
        (
            ProcessResult(255, b"alive\nalive\n", b"client_loop: send disconnect", overdue=False),
            "was lost before the listening time ended:",
        ),
        (ProcessResult(-9, b"alive\n", b"", overdue=True), "was lost before the listening time ended:"),
        (ProcessResult(-9, b"", b"", overdue=True), "was not reached: no response in time"),
        (
            ProcessResult(255, b"", b"root@10.64.1.10: Permission denied (publickey).", overdue=False),
            "refused the login as root",
        ),
        (ProcessResult(255, b"", b"Host key verification failed.", overdue=False), "differs from the inventory"),
        (ProcessResult(127, b"", b"sh: 1: exec: python3: not found", overdue=False), "has no python3"),
        (ProcessResult(0, b'alive\n{"heard": "eJw', b"", overdue=False), "was lost before the listening time ended:"),
        (
            ProcessResult(0, b'alive\n{"heard": "AAAA"}\n', b"", overdue=False),
            "was lost before the listening time ended:",
        ),
        (
            ProcessResult(0, b'{"trouble": "failed", "words": "DDSException: x"}', b"", overdue=False),
            "could not listen",
        ),
    ],
)
def test_incomplete_output_is_never_an_observation(ended: ProcessResult, words: str) -> None:
    host = robot_cases.shipped().hosts["coastal-gateway"]
    with pytest.raises(ListenError, match=words) as raised:
        remote._observation(host, ACCESS, ended)
    assert raised.value.exit == 6
    assert raised.value.hint


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("from=scc-contrl", "`from=scc-contrl` is not a host of the inventory"),
        ("from=scc-control address=10.64.1.5", "`address=` belongs to this computer, and `from=` names another"),
        ("from=coastal-router", "`coastal-router` is a router: it does not use DDS"),
        ("from=scc-control", "the inventory still contains example values"),
    ],
)
def test_invalid_from_argument_is_refused(words: str, message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["robot", "discover", "site=coastal", *words.split()]) == 3
    assert message in capsys.readouterr().err


def test_router_and_example_host_are_refused_as_listeners() -> None:
    shipped = robot_cases.shipped()
    with pytest.raises(UsageError, match="does not use DDS"):
        listen_there(shipped, shipped.hosts["coastal-router"], 5)
    with pytest.raises(UsageError, match="example values"):
        listen_there(shipped, shipped.hosts["scc-control"], 5)
    silent = replace(shipped, pilot=shipped.pilot.model_copy(update={"dds": None}))
    with pytest.raises(UsageError, match="`dds` is not set for the pilot"):
        listen_there(silent, shipped.hosts["scc-control"], 5)
