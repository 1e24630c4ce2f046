"""What dpkg knows: what is installed, what was left half done, and who is at work."""

from __future__ import annotations

import fcntl
import os
import struct
import time
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING

from .refused import Refused

if TYPE_CHECKING:
    from typing import Callable

    from .apt_run import Apt
    from .tree import Tree

__all__ = ["Package", "fits", "half_done", "installed", "wait_for_others"]

_FIELDS = "${Package}\\t${Architecture}\\t${db:Status-Want}\\t${db:Status-Eflag}\\t${db:Status-Status}\\t${Version}\\n"
_UNFINISHED = ("half-installed", "unpacked", "half-configured", "triggers-awaited", "triggers-pending")
_LOCKS = (
    "/var/lib/dpkg/lock-frontend",
    "/var/lib/dpkg/lock",
    "/var/lib/apt/lists/lock",
    "/var/cache/apt/archives/lock",
)
_FLOCK = "hhqqi"
"""struct flock of 64-bit Linux: type, whence, start, length, process."""
_POLL_S = 1.0


@dataclass(frozen=True)
class Package:
    """A package in dpkg's database."""

    name: str
    version: str
    wanted: str
    """install, hold, deinstall, purge or unknown."""
    damaged: bool
    """dpkg asks to install it again (`reinst-required`)."""
    state: str
    """dpkg(1), package states: installed, half-configured and so on."""

    @property
    def is_installed(self) -> bool:
        """Whether it is there and was configured."""
        return self.state == "installed" and not self.damaged

    @property
    def is_held(self) -> bool:
        """Whether somebody forbade to change it."""
        return self.wanted == "hold"


def installed(apt: Apt) -> dict[str, Package]:
    """Every package that dpkg knows, by name; of several architectures the computer's own."""
    local = apt.architecture
    output = apt.run("dpkg-query", "--show", f"--showformat={_FIELDS}")
    if output.code:
        raise Refused(
            f"dpkg cannot read its database: {output.said.strip()}",
            "`cp /var/lib/dpkg/status-old /var/lib/dpkg/status` brings the state before the last change back",
        )
    found: dict[str, Package] = {}
    for line in output.said.splitlines():
        if line.count("\t") != _FIELDS.count("\\t"):
            continue  # a warning about an entry, between the entries
        name, architecture, desired, flag, state, version = line.split("\t")
        if architecture in (local, "all") or name not in found:
            found[name] = Package(name, version, desired, flag == "reinstreq", state)
    return found


def half_done(apt: Apt, packages: dict[str, Package]) -> list[Package]:
    """What an interrupted dpkg left behind; a journal that was not merged counts for the package `dpkg`."""
    left = [package for package in packages.values() if package.state in _UNFINISHED or package.damaged]
    try:
        journal = any(path.name.isdigit() for path in Path(apt.tree.at("/var/lib/dpkg/updates")).iterdir())
    except OSError:
        journal = False
    return left or ([packages["dpkg"]] if journal and "dpkg" in packages else [])


def fits(version: str, desired: str | None) -> bool:
    """Whether an installed version is the wanted one; None: any is; a `*` at its end stands for the rest."""
    return desired is None or version == desired or (desired.endswith("*") and fnmatchcase(version, desired))


def wait_for_others(tree: Tree, wait_s: float, sleep: Callable[[float], None] = time.sleep) -> None:
    """Wait until no other apt or dpkg is at work. Raises Refused with who it is."""
    until = time.monotonic() + wait_s
    while True:
        holder = next((found for found in (_holder(tree, lock) for lock in _LOCKS) if found), None)
        if holder is None:
            return
        if time.monotonic() >= until:
            raise Refused(
                f"another program is installing packages for more than {wait_s:.0f} s: {holder}",
                "let it come to its end (`ps -ef | grep -e apt -e dpkg` shows it), and type the same again; on a new "
                "board it is mostly the system's own first update",
            )
        sleep(_POLL_S)


def _holder(tree: Tree, lock: str) -> str | None:
    """Who holds a lock of fcntl(2), if anybody does; such locks end with their process, whatever file is left."""
    try:
        with Path(tree.at(lock)).open("rb+") as file:
            data = struct.pack(_FLOCK, fcntl.F_WRLCK, os.SEEK_SET, 0, 0, 0)
            kind, _, _, _, pid = struct.unpack(_FLOCK, fcntl.fcntl(file, fcntl.F_GETLK, data))
    except OSError:
        return None
    return None if kind == fcntl.F_UNLCK else f"process {pid}{_command(pid)}"


def _command(pid: int) -> str:
    try:
        data = Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return ""
    words = data.replace(b"\0", b" ").decode(errors="replace").strip()
    return f" ({words})" if words else ""
