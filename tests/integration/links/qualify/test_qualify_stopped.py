"""A real process that measures a load, stopped for most of the time or beside a busy program: no wrong PASS."""

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from test_qualify_real_sockets import reflector
from waiting import HANG_S, measure

from atlantis_netcfg.emulator.udp_link import HEADERS, LinkShape, UdpRelay

pytestmark = pytest.mark.slow

RATE = 4_000_000
LINK = LinkShape(rate_bps=RATE, delay_s=0.0275)
GOODPUT = RATE * 1048 / (1200 + HEADERS)
BUFFER_DELAY = LINK.queue_bytes * 8 / RATE / 0.055
"""The queue that the load fills, by the round trip without it."""
PROGRAM = Path(__file__).with_name("measuring_process.py")


@dataclass(frozen=True)
class Load:
    """What the measuring process has told."""

    rows: dict[str, dict[str, Any]]
    buffer: dict[str, Any]

    def is_right(self, way: str) -> bool:
        return bool(abs(self.rows[way]["goodput_bps"] - GOODPUT) <= 0.05 * GOODPUT)


@contextmanager
def nothing(_process: subprocess.Popen[str]) -> Iterator[None]:
    yield


@contextmanager
def stops(process: subprocess.Popen[str]) -> Iterator[None]:
    """Stop the process for 60 of each 100 ms."""
    over = threading.Event()

    def stop_and_go() -> None:
        while not over.wait(0.04):
            process.send_signal(signal.SIGSTOP)
            over.wait(0.06)
            process.send_signal(signal.SIGCONT)

    thread = threading.Thread(target=stop_and_go)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


@contextmanager
def busy(process: subprocess.Popen[str]) -> Iterator[None]:
    """Let programs of lower priority that never rest share the processor of this one."""
    processor = {min(os.sched_getaffinity(0))}
    os.sched_setaffinity(process.pid, processor)
    loop = [sys.executable, "-c", "import os\nos.nice(5)\nwhile True: pass"]
    loops = [subprocess.Popen(loop) for _ in range(2)]
    try:
        for each in loops:
            os.sched_setaffinity(each.pid, processor)
        yield
    finally:
        for each in loops:
            each.kill()
            each.wait(HANG_S)


def loaded(folder: Path, disturbed: Any = nothing) -> Load:  # noqa: ANN401 - a context for the process
    """Measure a load up and down in a process of its own, which is disturbed once the load begins."""
    with reflector(folder / "far") as (_, port), UdpRelay(("127.0.0.1", port), LINK, LINK) as relay:
        typed = [sys.executable, "-P", str(PROGRAM), str(relay.address[1]), str(RATE)]
        with subprocess.Popen(typed, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdin is not None
            assert process.stdout is not None
            assert process.stdout.readline() == "ready\n"
            process.stdin.write("go\n")
            process.stdin.flush()
            assert process.stdout.readline() == "load\n"
            with disturbed(process):
                told = json.loads(process.stdout.readline())
    rows = {row["way"]: row for row in told["load"]}
    assert rows.keys() == {"up", "down"}
    return Load(rows, next(each for each in told["judgements"] if each["criterion"].startswith("buffer delay")))


def test_undisturbed_process_measures_correctly(tmp_path: Path) -> None:
    def judge() -> None:
        load = loaded(tmp_path)
        for way, row in load.rows.items():
            assert (row["verdict"], row["doubt"]) == ("PASS", "")
            assert load.is_right(way), row
        assert load.buffer["verdict"] == "PASS"
        assert load.buffer["measured"] == pytest.approx(BUFFER_DELAY, rel=0.1)

    measure(judge)


def test_suspended_process_reports_its_own_delay(tmp_path: Path) -> None:
    load = loaded(tmp_path, stops)
    up = load.rows["up"]
    assert up["goodput_bps"] < 0.9 * GOODPUT, "or the stops do nothing here"
    assert up["verdict"] == load.buffer["verdict"] == "INCONCLUSIVE"
    assert up["doubt"].startswith("the sender fell behind: it offered ")
    assert load.buffer["reason"] == up["doubt"]
    assert load.is_right("down") or load.rows["down"]["verdict"] == "INCONCLUSIVE"


def test_busy_computer_is_correct_or_inconclusive(tmp_path: Path) -> None:
    load = loaded(tmp_path, busy)
    for way, row in load.rows.items():
        assert load.is_right(way) or row["verdict"] == "INCONCLUSIVE", row
    if load.rows["up"]["verdict"] == "PASS":
        assert load.buffer["measured"] == pytest.approx(BUFFER_DELAY, rel=0.15)
    else:
        assert load.buffer["verdict"] == "INCONCLUSIVE"
