"""atlantis: does a listener of ROS 2 on this computer hear a talker? HOME COUNT SECONDS [NAME=VALUE …].

Both get an environment of their own, so that neither a profile nor a variable of the computer takes part, and none of
what is set here stays. Exit 0: heard often enough.
"""

# ruff: noqa: INP001, S603 - a program of the gateway, which starts programs of the gateway

import contextlib
import os
import shlex
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

HEARD = "I heard"
LINES = 6


def main(home: str, count: int, seconds: float, variables: "list[str]") -> int:
    """Start both, count what is heard, end both."""
    setup = Path(home, "setup.sh")
    if not setup.is_file():
        sys.stdout.write(f"ROS 2 is not at {home}: {setup} is missing\n")
        return 1
    with tempfile.TemporaryDirectory(prefix="atlantis-ros2-") as folder:
        environment = {
            "HOME": folder,
            "PATH": "/usr/sbin:/usr/bin:/sbin:/bin",
            "LANG": "C.UTF-8",
            "ROS_LOG_DIR": folder,
        }
        environment.update(word.split("=", 1) for word in variables)
        nodes = {
            "listener": "ros2 run demo_nodes_py listener",
            "talker": "ros2 run demo_nodes_cpp talker",
        }
        began = time.monotonic()
        running = {}
        try:
            for name, words in nodes.items():
                running[name] = start(f". {shlex.quote(str(setup))} && exec {words}", Path(folder, name), environment)
            heard = wait(running, Path(folder, "listener"), count, began + seconds)
        finally:
            for node in running.values():
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(node.pid, signal.SIGKILL)
                node.wait()
        took = time.monotonic() - began
        if heard >= count:
            sys.stdout.write(f"note: the listener of ROS 2 heard the talker {heard} times in {took:.0f} s\n")
            return 0
        sys.stdout.write(f"the listener of ROS 2 heard the talker {heard} times in {took:.0f} s, {count} were wanted\n")
        for name in nodes:
            said = Path(folder, name).read_text(errors="replace").splitlines()[-LINES // 2 :]
            sys.stdout.write("".join(f"{name}: {line}\n" for line in said or ["said nothing"]))
        return 1


def start(command: str, said: Path, environment: "dict[str, str]") -> "subprocess.Popen[bytes]":
    """Start a node in a session of its own, which ends as a whole."""
    with said.open("wb") as file:
        return subprocess.Popen(
            ["/bin/sh", "-c", command],
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=subprocess.STDOUT,
            env=environment,
            cwd="/",
            start_new_session=True,
        )


def wait(running: "dict[str, subprocess.Popen[bytes]]", said: Path, count: int, until: float) -> int:
    """Wait until enough was heard, one of the two has ended, or time is up; give how often it was heard."""
    while True:
        ended = any(node.poll() is not None for node in running.values())
        heard = said.read_text(errors="replace").count(HEARD)
        if heard >= count or ended or time.monotonic() >= until:
            return heard
        time.sleep(0.2)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], int(sys.argv[2]), float(sys.argv[3]), sys.argv[4:]))
