"""A computer of its own: a process in a network and a mount namespace, with a server's real paths in memory."""

import ctypes
import os
import socket
import subprocess
import threading
from contextlib import ExitStack
from pathlib import Path

import pytest
from waiting import wait_until

__all__ = ["LOG", "Computer"]

LOG = "/run/openvpn.log"
_PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
_MOUNTS = ("/etc/openvpn", "/etc/atlantis", "/var/lib/atlantis", "/run", "/usr/local/sbin")
_NEWNET = 0x40000000
_LIBC = ctypes.CDLL(None, use_errno=True)


class Computer:
    """A process that holds a network and a mount namespace."""

    def __init__(self, stack: ExitStack) -> None:
        if os.geteuid() != 0:
            pytest.skip("making a network namespace needs root")
        made = " && ".join(f"mkdir -p {path} && mount -t tmpfs none {path}" for path in _MOUNTS)
        script = f"{made} && mkdir -p /run/lock && ip link set lo up && echo up && exec cat"
        self._holder = subprocess.Popen(
            ["unshare", "--net", "--mount", "--propagation", "private", "sh", "-c", script],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        stack.callback(self._end)
        assert self._holder.stdout is not None
        assert self._holder.stdout.readline() == b"up\n"
        self.pid = self._holder.pid
        self.enter = ("nsenter", "-t", str(self.pid), "-m", "-n", "env", f"PATH={_PATH}")

    def _end(self) -> None:
        self._holder.kill()
        self._holder.communicate()

    def run(self, *words: str, text: str | None = None, check: bool = True) -> str:
        """Run a command on it, and give what it prints."""
        done = subprocess.run([*self.enter, *words], input=text, capture_output=True, text=True, check=False)
        assert done.returncode == 0 or not check, f"{' '.join(words)}: {done.stderr}{done.stdout}"
        return done.stdout

    def at(self, path: str) -> Path:
        """Where one of its paths is for this process."""
        return Path(f"/proc/{self.pid}/root{path}")

    def put(self, path: str, text: str, mode: int = 0o644) -> None:
        """Write a file by rename."""
        place = self.at(path)
        place.parent.mkdir(parents=True, exist_ok=True)
        new = place.with_name(f".{place.name}.new")
        new.write_text(text)
        new.chmod(mode)
        new.rename(place)

    def log(self) -> str:
        return self.at(LOG).read_text(errors="replace")

    def said(self, words: str, times: int = 1) -> None:
        """Wait until its OpenVPN has said something so often since it was started."""
        wait_until(
            lambda: self.log().count(words) >= times, lambda: f"not said {times}x: {words}\n{self.log()[-3000:]}"
        )

    def udp(self) -> socket.socket:
        """A socket that lives on it, whoever uses it."""
        made: list[socket.socket] = []

        def enter() -> None:
            with Path(f"/proc/{self.pid}/ns/net").open("rb") as namespace:
                if _LIBC.setns(namespace.fileno(), _NEWNET) == 0:
                    made.append(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))

        thread = threading.Thread(target=enter)
        thread.start()
        thread.join()
        return made[0]
