"""Run apt-get and dpkg in English, without prompts, and without waiting for services that they start.

Also read dpkg's state: installed packages, half-installed packages, and the process that holds its lock.
"""

from __future__ import annotations

import fcntl
import os
import struct
import subprocess
import time
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING, Callable, Sequence
from urllib.parse import quote

from atlantis_netcfg.core.messages import arg, msg

from .errors import ModuleError

if TYPE_CHECKING:
    from .filesystem import FileSystem

_FOLDER = "/var/lib/atlantis/apt"
_KEY = "atlantis.gpg"
_GAP_S = 120
"""Seconds without data after which a server is given up; a satellite link can be silent for 70 s."""
_ENVIRONMENT = {
    "LC_ALL": "C.UTF-8",
    "LANGUAGE": "",
    "PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin",
    "HOME": "/root",
    "DEBIAN_FRONTEND": "noninteractive",
    "UCF_FORCE_CONFFOLD": "1",
    "APT_LISTCHANGES_FRONTEND": "none",
    "NEEDRESTART_SUSPEND": "1",
}


@dataclass(frozen=True)
class AptOutput:
    """Exit code and complete output of a program."""

    code: int
    output: str


def bundle_of(tree: FileSystem, folder: str) -> str:
    """Return the apt source line of a bundle, a flat repository signed by its own key. Raises ModuleError."""
    for name in ("InRelease", _KEY):
        if tree.read(f"{folder}/{name}") is None:
            raise ModuleError(
                f"{arg(folder)} is not an offline bundle, or is incomplete: {arg(name)} is missing",
                "copy the bundle to the computer again",
            )
    return f"deb [signed-by={folder}/{_KEY}] file:{quote(folder)} ./\n"


def refuse_another_system(
    apt: Apt, distribution: str | None, codename: str | None, architectures: Sequence[str]
) -> None:
    """Raise ModuleError if the computer's system is not one of the supported ones; None accepts any."""
    text = (apt.tree.read("/etc/os-release") or b"").decode(errors="replace")
    pairs = (line.partition("=") for line in text.splitlines())
    values = {name: value.strip().strip("'\"") for name, _, value in pairs}
    is_now = (values.get("ID", "?"), values.get("VERSION_CODENAME", "?"))
    desired_system = (distribution or is_now[0], codename or is_now[1])
    if is_now != desired_system:
        raise ModuleError(
            f"the computer runs {arg(' '.join(is_now))}; the inventory is for {arg(' '.join(desired_system))}",
            "write a card with the right system (`provision gateway image --help`), or set the release of this one "
            "in the inventory",
        )
    if architectures and apt.architecture not in architectures:
        raise ModuleError(
            f"the computer is {arg(apt.architecture)}; what the inventory asks for exists for "
            f"{arg(', '.join(architectures))}",
            "set another release or source in the inventory",
        )


class Apt:
    """apt of this computer; with `bundle` it uses only that repository, and keeps its lists separate.

    `wait_s`: timeout for another apt or dpkg to release its lock.
    """

    def __init__(self, tree: FileSystem, bundle: str | None = None, wait_s: int = 300) -> None:
        self.tree = tree
        self.bundle = bundle
        self.wait_s = wait_s
        self._architecture = ""

    @property
    def lists(self) -> str:
        """Folder of apt's package lists."""
        return "/var/lib/apt/lists" if self.bundle is None else f"{_FOLDER}/lists"

    @property
    def architecture(self) -> str:
        """Architecture of the computer, as dpkg names it."""
        if not self._architecture:
            self._architecture = self.run("dpkg", "--print-architecture").output.strip()
        return self._architecture

    def ready(self) -> None:
        """Write the files that a bundle needs in addition to apt's own."""
        if self.bundle is not None:
            self.tree.write(f"{_FOLDER}/offline.list", bundle_of(self.tree, self.bundle).encode())
            self.tree.write(f"{self.lists}/partial/.keep", b"")

    def update(self) -> AptOutput:
        """Update the package lists, not quietly: only then apt reports what a source does not have."""
        return self.get("-o", "quiet=0", "update")

    def get(self, *arguments: str) -> AptOutput:
        """Run apt-get."""
        return self.run("apt-get", *self._options(), *arguments)

    def cache(self, *arguments: str) -> AptOutput:
        """Run apt-cache."""
        return self.run("apt-cache", *self._options(), *arguments)

    def run(self, *argv: str) -> AptOutput:
        """Run any program and wait for it, not for services that it has started and that keep its output open."""
        command = list(argv) if self.tree.root == "/" else ["chroot", self.tree.root, *argv]
        handle = os.memfd_create("said")
        try:
            process = subprocess.run(  # noqa: S603 - apt and dpkg, with names that were checked
                command,
                stdin=subprocess.DEVNULL,
                stdout=handle,
                stderr=handle,
                env=_ENVIRONMENT,
                cwd="/",
                check=False,
            )
            code = process.returncode
        except FileNotFoundError:
            raise ModuleError(
                f"`{arg(argv[0])}` is not installed on this computer", "it must be Debian or Ubuntu"
            ) from None
        finally:
            os.lseek(handle, 0, os.SEEK_SET)
            with os.fdopen(handle, "rb") as file:
                text = file.read().decode(errors="replace").replace("\r", "\n")
        return AptOutput(code, text)

    def drop_lists(self, *, only_empty: bool) -> None:
        """Remove lists that a power cut has left empty or damaged, which apt would treat as valid."""
        folder = Path(self.tree.at(self.lists))
        for path in folder.iterdir() if folder.is_dir() else ():
            if path.is_file() and path.name != "lock" and (not only_empty or path.stat().st_size == 0):
                path.unlink()

    def _options(self) -> list[str]:
        settings = {
            "APT::Color": "0",
            "Dpkg::Use-Pty": "0",
            "DPkg::Lock::Timeout": str(self.wait_s),
            "Acquire::Languages": "none",
            "Acquire::Retries": "3",
            "Acquire::http::Timeout": str(_GAP_S),
            "Acquire::https::Timeout": str(_GAP_S),
        }
        if self.bundle is not None:
            settings.update(
                {
                    "Dir::Etc::SourceList": f"{_FOLDER}/offline.list",
                    "Dir::Etc::SourceParts": "/dev/null",
                    "Dir::Etc::Preferences": "/dev/null",
                    "Dir::Etc::PreferencesParts": "/dev/null",
                    "Dir::State::Lists": self.lists,
                    "Dir::Cache::pkgcache": "",
                    "Dir::Cache::srcpkgcache": "",
                    "APT::Sandbox::User": "root",
                }
            )
        return ["-q", *(word for name, value in settings.items() for word in ("-o", f"{name}={value}"))]


_FIELDS = "${Package}\\t${Architecture}\\t${db:Status-Want}\\t${db:Status-Eflag}\\t${db:Status-Status}\\t${Version}\\n"
_PARTIAL_STATES = ("half-installed", "unpacked", "half-configured", "triggers-awaited", "triggers-pending")
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
class InstalledPackage:
    """A package in dpkg's database."""

    name: str
    version: str
    selection: str
    """install, hold, deinstall, purge or unknown."""
    is_damaged: bool
    """dpkg asks to install it again (`reinst-required`)."""
    state: str
    """Package state of dpkg(1): installed, half-configured and so on."""

    @property
    def is_installed(self) -> bool:
        """Whether the package is installed and configured."""
        return self.state == "installed" and not self.is_damaged

    @property
    def is_held(self) -> bool:
        """Whether the package is on hold."""
        return self.selection == "hold"


def list_installed(apt: Apt) -> dict[str, InstalledPackage]:
    """Return every package that dpkg knows, by name; of several architectures, the computer's own."""
    local = apt.architecture
    output = apt.run("dpkg-query", "--show", f"--showformat={_FIELDS}")
    if output.code:
        raise ModuleError(
            f"dpkg cannot read its database: {arg(output.output.strip())}",
            "`cp /var/lib/dpkg/status-old /var/lib/dpkg/status` restores the state before the last change",
        )
    result: dict[str, InstalledPackage] = {}
    for line in output.output.splitlines():
        if line.count("\t") != _FIELDS.count("\\t"):
            continue  # a warning about an entry, between the entries
        name, architecture, selection, flag, state, version = line.split("\t")
        if architecture in (local, "all") or name not in result:
            result[name] = InstalledPackage(name, version, selection, flag == "reinstreq", state)
    return result


def half_done(apt: Apt, packages: dict[str, InstalledPackage]) -> list[InstalledPackage]:
    """Return what an interrupted dpkg left behind; an unmerged journal counts as the package `dpkg`."""
    half_installed = [
        package for package in packages.values() if package.state in _PARTIAL_STATES or package.is_damaged
    ]
    try:
        journal = any(path.name.isdigit() for path in Path(apt.tree.at("/var/lib/dpkg/updates")).iterdir())
    except OSError:
        journal = False
    return half_installed or ([packages["dpkg"]] if journal and "dpkg" in packages else [])


def version_matches(version: str, desired_version: str | None) -> bool:
    """Return whether a version matches the desired one; None matches any, a `*` at its end any rest."""
    return (
        desired_version is None
        or version == desired_version
        or (desired_version.endswith("*") and fnmatchcase(version, desired_version))
    )


def wait_for_others(tree: FileSystem, wait_s: float, sleep: Callable[[float], None] = time.sleep) -> None:
    """Wait until no other apt or dpkg runs. Raises ModuleError, naming the process, on timeout."""
    until = time.monotonic() + wait_s
    while True:
        holder = next((process for process in (_holder(tree, lock) for lock in _LOCKS) if process), None)
        if holder is None:
            return
        if time.monotonic() >= until:
            raise ModuleError(
                f"another program has been installing packages for more than {arg(wait_s):.0f} s: {arg(holder)}",
                "wait until it ends (`ps -ef | grep -e apt -e dpkg` shows it), then run the same command again; on "
                "a new board it is usually the system's own first update",
            )
        sleep(_POLL_S)


def _holder(tree: FileSystem, lock: str) -> str | None:
    """Return the holder of an fcntl(2) lock, if any; such locks end with their process, even if the file remains."""
    try:
        with Path(tree.at(lock)).open("rb+") as file:
            data = struct.pack(_FLOCK, fcntl.F_WRLCK, os.SEEK_SET, 0, 0, 0)
            kind, _, _, _, pid = struct.unpack(_FLOCK, fcntl.fcntl(file, fcntl.F_GETLK, data))
    except OSError:
        return None
    return None if kind == fcntl.F_UNLCK else msg(f"process {arg(pid)}{arg(_command(pid))}")


def _command(pid: int) -> str:
    try:
        data = Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return ""
    words = data.replace(b"\0", b" ").decode(errors="replace").strip()
    return f" ({words})" if words else ""
