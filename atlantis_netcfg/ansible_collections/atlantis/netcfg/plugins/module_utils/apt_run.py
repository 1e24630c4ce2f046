"""apt-get and dpkg, run so that nothing asks, and nothing waits for a service that was started; they speak English."""

from __future__ import annotations

import os
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote

from .refused import Refused

if TYPE_CHECKING:
    from typing import Sequence

    from .tree import Tree

__all__ = ["Apt", "Output", "bundle_of", "refuse_another_system"]

_FOLDER = "/var/lib/atlantis/apt"
_KEY = "atlantis.gpg"
_GAP_S = 120
"""A server that says nothing for so long is given up; a satellite is silent for 70 s."""
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
class Output:
    """How a program ended, and all that it said, in order."""

    code: int
    said: str


def bundle_of(tree: Tree, folder: str) -> str:
    """The one line of sources that a bundle is: a flat signed repository with its own key. Raises Refused."""
    for name in ("InRelease", _KEY):
        if tree.read(f"{folder}/{name}") is None:
            raise Refused(
                f"{folder} is no offline bundle, or only half of one: {name} is missing",
                "copy the bundle to the computer again",
            )
    return f"deb [signed-by={folder}/{_KEY}] file:{quote(folder)} ./\n"


def refuse_another_system(
    apt: Apt, distribution: str | None, codename: str | None, architectures: Sequence[str]
) -> None:
    """Raise Refused where the computer runs another system than all this is made for; None: any is good."""
    text = (apt.tree.read("/etc/os-release") or b"").decode(errors="replace")
    pairs = (line.partition("=") for line in text.splitlines())
    values = {name: value.strip().strip("'\"") for name, _, value in pairs}
    is_now = (values.get("ID", "?"), values.get("VERSION_CODENAME", "?"))
    desired = (distribution or is_now[0], codename or is_now[1])
    if is_now != desired:
        raise Refused(
            f"the computer runs {' '.join(is_now)}; what is declared is made for {' '.join(desired)}",
            "make a card with the right system (`provision image --help`), or declare the release that fits this one",
        )
    if architectures and apt.architecture not in architectures:
        raise Refused(
            f"the computer is {apt.architecture}; what is declared exists for {', '.join(architectures)}",
            "declare another release or source",
        )


class Apt:
    """apt of this computer; with `bundle` it knows that repository only, and keeps its lists apart.

    `wait_s`: how long it waits for another apt or dpkg to let go.
    """

    def __init__(self, tree: Tree, bundle: str | None = None, wait_s: int = 300) -> None:
        self.tree = tree
        self.bundle = bundle
        self.wait_s = wait_s
        self._architecture = ""

    @property
    def lists(self) -> str:
        """Where its lists of packages are."""
        return "/var/lib/apt/lists" if self.bundle is None else f"{_FOLDER}/lists"

    @property
    def architecture(self) -> str:
        """The computer's own, as dpkg calls it."""
        if not self._architecture:
            self._architecture = self.run("dpkg", "--print-architecture").said.strip()
        return self._architecture

    def ready(self) -> None:
        """Make what a bundle needs beside apt's own files."""
        if self.bundle is not None:
            self.tree.write(f"{_FOLDER}/offline.list", bundle_of(self.tree, self.bundle).encode())
            self.tree.write(f"{self.lists}/partial/.keep", b"")

    def update(self) -> Output:
        """Bring the lists of packages up to date. Only when it is not quiet apt tells what a source does not have."""
        return self.get("-o", "quiet=0", "update")

    def get(self, *arguments: str) -> Output:
        """Run apt-get."""
        return self.run("apt-get", *self._options(), *arguments)

    def cache(self, *arguments: str) -> Output:
        """Run apt-cache."""
        return self.run("apt-cache", *self._options(), *arguments)

    def run(self, *argv: str) -> Output:
        """Run any program and wait for it, not for services that it has started and that keep its output open."""
        command = list(argv) if self.tree.root == "/" else ["chroot", self.tree.root, *argv]
        handle = os.memfd_create("said")
        try:
            done = subprocess.run(  # noqa: S603 - apt and dpkg, with names that were checked
                command,
                stdin=subprocess.DEVNULL,
                stdout=handle,
                stderr=handle,
                env=_ENVIRONMENT,
                cwd="/",
                check=False,
            )
            code = done.returncode
        except FileNotFoundError:
            raise Refused(f"`{argv[0]}` is not on this computer", "it has to be a Debian or an Ubuntu") from None
        finally:
            os.lseek(handle, 0, os.SEEK_SET)
            with os.fdopen(handle, "rb") as file:
                text = file.read().decode(errors="replace").replace("\r", "\n")
        return Output(code, text)

    def drop_lists(self, *, only_empty: bool) -> None:
        """Remove lists that a power cut has left empty or damaged: apt takes those that it has for good ones."""
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
