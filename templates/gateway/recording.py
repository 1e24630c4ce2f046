"""atlantis: records topics of ROS 2 as bags in a folder with a budget. Takes SETUP FOLDER BUDGET_MB and the topics.

The recorder begins a new file at an eighth of the budget. The oldest file goes while there is no room for two more, so
that the budget holds as long as no more than an eighth of it is written in a tenth of a second. The file that is being
written stays. A recorder whose file grows far beyond its share is ended, and systemd starts anew.
"""

# ruff: noqa: INP001, S603 - a program of the gateway, which starts programs of the gateway

import contextlib
import os
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

PARTS = 8
LOOK_S = 0.1
END_S = 15


def files(folder: Path) -> "list[tuple[float, int, Path]]":
    """What stands in the bags: time of the last change, size, path; the oldest first."""
    found = []
    for path in folder.glob("bag-*/*"):
        with contextlib.suppress(OSError):
            state = path.stat()
            found.append((state.st_mtime, state.st_size, path))
    return sorted(found)


def keep_within(folder: Path, budget: int) -> int:
    """Remove the oldest files while there is no room for two more; give the size of the newest one."""
    found = [row for row in files(folder) if row[2].name != "metadata.yaml"]
    total = sum(size for _, size, _ in files(folder))
    room = 2 * (budget // PARTS)
    for _, size, path in found[:-1]:
        if total + room <= budget:
            break
        path.unlink()
        total -= size
        sys.stdout.write(f"removed the oldest: {path}\n")
        if [other for other in path.parent.iterdir() if other.name != "metadata.yaml"] == []:
            shutil.rmtree(str(path.parent), ignore_errors=True)
    sys.stdout.flush()
    return found[-1][1] if found else 0


def record(setup: str, folder: Path, topics: "list[str]", size: int) -> "subprocess.Popen[bytes]":
    """Start the recorder; its bag is a folder of its own."""
    bag = folder / time.strftime("bag-%Y%m%d-%H%M%S", time.gmtime())
    words = ["ros2", "bag", "record", "--output", str(bag), "--max-bag-size", str(size), *topics]
    command = f". {shlex.quote(setup)} && exec {' '.join(map(shlex.quote, words))}"
    return subprocess.Popen(["/bin/sh", "-c", command], stdin=subprocess.DEVNULL, start_new_session=True)


def end(recorder: "subprocess.Popen[bytes]") -> None:
    """Let it close its bag: it does so for SIGINT."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(recorder.pid, signal.SIGINT)
    try:
        recorder.wait(END_S)
    except subprocess.TimeoutExpired:
        os.killpg(recorder.pid, signal.SIGKILL)
        recorder.wait()


def main(setup: str, folder: Path, budget: int, topics: "list[str]") -> int:
    """Record until somebody ends it, or the recorder ends."""
    stopped = []
    signal.signal(signal.SIGTERM, lambda *_: stopped.append(True))
    keep_within(folder, budget)
    recorder = record(setup, folder, topics, budget // PARTS)
    try:
        while not stopped and recorder.poll() is None:
            if keep_within(folder, budget) > 2 * (budget // PARTS):
                sys.stdout.write("the recorder does not begin a new file: it is ended\n")
                return 1
            time.sleep(LOOK_S)
    finally:
        end(recorder)
    return 0 if stopped else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], Path(sys.argv[2]), int(sys.argv[3]) * 1_000_000, sys.argv[4:]))
