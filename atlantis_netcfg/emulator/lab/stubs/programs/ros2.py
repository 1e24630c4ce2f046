"""Stub, not ROS: `ros2 run PACKAGE PROGRAM`, and `ros2 bag record`, which writes random data."""

# ruff: noqa: INP001 - a file of a package, no module of ours

import os
import signal
import sys
import time
from pathlib import Path
from typing import NoReturn

NOISE_BYTES, PAUSE_S = 100_000, 0.05
"""Bytes of each message, and seconds between messages: 2 MB/s."""


def run(package: str, program: str, *words: str) -> NoReturn:
    """Run a program of a package."""
    path = str(Path("@HOME@", "lib", package, program))
    if not os.access(path, os.X_OK):
        sys.exit(f"Package '{package}' not found")
    os.execv(path, [path, *words])  # noqa: S606 - as the real one does


def record(words: "list[str]") -> None:
    """Write the files of one bag, each at its maximum size, until SIGINT."""
    options = dict(zip(words[::2], words[1::2]))  # noqa: B905 - Python 3.8 of Ubuntu 20.04 has no `strict`
    bag, size = Path(options["--output"]), int(options["--max-bag-size"])
    bag.mkdir(parents=True)
    signals: list[int] = []
    signal.signal(signal.SIGINT, lambda number, _: signals.append(number))
    number = 0
    while not signals:
        with (bag / f"{bag.name}_{number}.db3").open("wb", buffering=0) as file:
            while not signals and file.tell() < size:
                file.write(os.urandom(NOISE_BYTES))
                time.sleep(PAUSE_S)
        number += 1
    (bag / "metadata.yaml").write_text("stand-in: true\n", encoding="utf-8")


if sys.argv[1:3] == ["bag", "record"] and len(sys.argv) > len(("ros2", "bag", "record", "--output", "FOLDER")):
    record(sys.argv[3:])
elif sys.argv[1:2] == ["run"] and len(sys.argv) >= len(("ros2", "run", "PACKAGE", "PROGRAM")):
    run(*sys.argv[2:])
else:
    sys.exit("stand-in, not ROS: only `ros2 run PACKAGE PROGRAM` and `ros2 bag record` are known")
