"""Debian packages that stand in for others: of the same name, and saying of themselves that they are not those."""

from __future__ import annotations

import hashlib
import subprocess
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from atlantis_netcfg.core import temporary
from atlantis_netcfg.emulator.lab.hosts import MachineFailed

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path


class StandInFailed(MachineFailed):
    """Something that should stand in for the real thing could not be made."""


@dataclass(frozen=True, slots=True)
class StubPackage:
    """A package. `files` maps an absolute path to its text; programs are those below a `bin` or `lib` folder."""

    name: str
    version: str
    depends: tuple[str, ...] = ()
    files: Mapping[str, str] = field(default_factory=dict)
    postinst: str | None = None
    """Shell text that runs when the package is configured."""
    padding_kb: int = 0
    """Of bytes that do not compress, for what has to be large."""
    architecture: str = "all"

    @property
    def file(self) -> str:
        """The name of its file."""
        return f"{self.name}_{self.version}_{self.architecture}.deb"

    @property
    def control(self) -> str:
        """Its control file (Debian Policy 5.3)."""
        size = self.padding_kb + sum(len(text) for text in self.files.values()) // 1024 + 1
        depends = f"Depends: {', '.join(self.depends)}\n" if self.depends else ""
        return (
            f"Package: {self.name}\nVersion: {self.version}\nArchitecture: {self.architecture}\n"
            f"Maintainer: ATLANTIS rehearsal <rehearsal@example.org>\nSection: misc\nPriority: optional\n"
            f"Installed-Size: {size}\n{depends}"
            f"Description: stand-in, not {self.name}\n"
            " Made for rehearsals and tests of the ATLANTIS toolkit. It does nothing for a robot.\n"
        )


def build(package: StubPackage, folder: Path) -> Path:
    """Make the .deb in `folder`. Raises StandInFailed."""
    made = folder / package.file
    with temporary.folder("stand-in") as root:
        root.chmod(0o755)
        sums = [_put(root, path, text.encode()) for path, text in package.files.items()]
        if package.padding_kb:
            noise = hashlib.shake_256(package.name.encode()).digest(package.padding_kb * 1024)
            sums.append(_put(root, f"/usr/share/{package.name}/padding", noise))
        meta = root / "DEBIAN"
        meta.mkdir(mode=0o755)
        (meta / "control").write_text(package.control, encoding="utf-8")
        (meta / "md5sums").write_text("".join(sums), encoding="utf-8")
        if package.postinst is not None:
            script = meta / "postinst"
            script.write_text(f"#!/bin/sh\nset -e\n{package.postinst}\n", encoding="utf-8")
            script.chmod(0o755)
        words = ["dpkg-deb", "--root-owner-group", "-Zgzip", "--build", str(root), str(made)]
        done = subprocess.run(words, capture_output=True, text=True, check=False)  # noqa: S603 - of the system
    if done.returncode:
        raise StandInFailed(f"the stand-in package {package.name} could not be made: {done.stderr.strip()}")
    return made


def _put(root: Path, path: str, content: bytes) -> str:
    """Write a file; give its line of md5sums (deb-md5sums(5))."""
    place = root / path.lstrip("/")
    place.parent.mkdir(parents=True, exist_ok=True, mode=0o755)
    place.write_bytes(content)
    place.chmod(0o755 if {"bin", "lib"} & set(place.relative_to(root).parts) else 0o644)
    return f"{hashlib.md5(content, usedforsecurity=False).hexdigest()}  {path.lstrip('/')}\n"
