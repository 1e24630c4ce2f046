"""`robot discover record=` and `robot mock bag=` in a network namespace: what was recorded is what is said again."""

import json
import signal
import subprocess
from collections import defaultdict
from pathlib import Path
from typing import Any

import pytest
from rosbags.rosbag2 import Reader
from test_robots_on_the_network import ALONE, PROVISION, alone, pytestmark  # noqa: F401 - it marks this file as well
from waiting import wait_until

ROBOTS = ["eca_rov", "girona500", "mares", "sparus", "stork", "zarco"]


def contents(folder: Path) -> dict[str, list[bytes]]:
    """Topic to its messages, in their order."""
    found: dict[str, list[bytes]] = defaultdict(list)
    with Reader(folder) as reader:
        for connection, _, data in reader.messages():
            found[connection.topic].append(data)
    return dict(found)


@pytest.mark.slow
def test_recording_is_replayed_identically(tmp_path: Path) -> None:
    script = (
        '"$1" robot mock for=60s >/dev/null 2>&1 & mock=$!; '
        '"$1" robot discover site=coastal for=8s address=127.0.0.1 record="$2" --json || exit 9; '
        "kill $mock; wait $mock; "
        '"$1" robot mock bag="$2" >"$4" 2>&1 & '
        '"$1" robot discover site=coastal for=14s address=127.0.0.1 record="$3" --json'
    )
    first, second, told = tmp_path / "first", tmp_path / "second", tmp_path / "told"
    done = alone(script, str(PROVISION), str(first), str(second), str(told))
    assert done.returncode == 6, "old stamps are stale: " + done.stderr[-2000:]
    recorded, replayed = parsed(done.stdout)
    assert recorded["recording"]["ended_early"] is None
    assert recorded["recording"]["messages"] == sum(map(len, contents(first).values()))
    assert contents(second) == contents(first), "every byte, in the same order, a topic"
    assert [robot["namespace"] for robot in replayed["robots"]] == ROBOTS
    assert len(replayed["participants"]) == len(ROBOTS)
    for before, after in zip(recorded["robots"], replayed["robots"], strict=True):
        assert {finding["code"] for finding in after["findings"]} == {"topic-stale"}
        assert before["topics"].keys() == after["topics"].keys()
        for name, topic in before["topics"].items():
            assert after["topics"][name]["rate_hz"] == pytest.approx(topic["rate_hz"], rel=0.1), name
            assert (after["topics"][name]["type"], after["topics"][name]["bytes"]) == (topic["type"], topic["bytes"])
    assert f"at 127.0.0.1, in domain 0: {', '.join(ROBOTS)}" in told.read_text()
    assert first.stat().st_mode & 0o777 == 0o700


def parsed(printed: str) -> list[dict[str, Any]]:
    decoder, documents, text = json.JSONDecoder(), [], printed.strip()
    while text:
        document, end = decoder.raw_decode(text)
        documents.append(document)
        text = text[end:].strip()
    return documents


@pytest.mark.slow
def test_a_recording_that_is_stopped_can_be_read(tmp_path: Path) -> None:
    """By Ctrl-C, while messages come."""
    script = (
        'ip link set lo up; "$1" robot mock vehicle=sparus for=60s >/dev/null 2>&1 & mock=$!; trap "kill $mock" EXIT; '
        '"$1" robot discover site=coastal for=60s address=127.0.0.1 record="$2"'
    )
    bag = tmp_path / "bag"
    process = subprocess.Popen(
        [*ALONE, script, "sh", str(PROVISION), str(bag)], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    wait_until((bag / "bag.db3").exists, lambda: "no recording has begun", 0.1)
    listener = child(process.pid, "discover")
    # The database is written when it is finished: so long some messages come.
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(6)
    subprocess.run(["kill", f"-{signal.SIGINT}", str(listener)], check=True)
    shown, _ = process.communicate(timeout=60)
    assert "recorded in" in shown
    assert len(contents(bag)["/sparus/depth"]) >= 3


def child(pid: int, word: str) -> int:
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        words = path.read_bytes().split(b"\0")
        if word.encode() in words and f"{pid}" == (path.parent / "stat").read_text().rpartition(")")[2].split()[1]:
            return int(path.parent.name)
    raise AssertionError(f"no process with `{word}`")


def test_broken_bag_publishes_nothing(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    bag.mkdir()
    (bag / "bag.db3").write_bytes(b"SQLite format 3\0" + b"\xff" * 5000)
    script = '"$1" robot mock bag="$2" & "$1" robot discover site=coastal for=5s address=127.0.0.1 --json; wait $!'
    done = alone(script, str(PROVISION), str(bag))
    assert done.returncode == 3, done.stdout
    assert "cannot be read as a bag" in done.stderr
    assert json.loads(done.stdout)["participants"] == {}, "nothing was published"
