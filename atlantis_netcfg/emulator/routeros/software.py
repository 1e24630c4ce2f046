"""Packages of an emulated router: `.npk` files on its flash, installed at reboot (Manual, Packages; Upgrade).

Nothing is unpacked and no signature is checked: name, version and architecture are read from the file's header (see
repositories rsa9000/npk-tools and botlabsDev/npkpy), and a router boots with another version's command tree. Log
messages about refused packages are ours: the manual shows them in a picture only.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.emulator.routeros.core import FlashFile
    from atlantis_netcfg.emulator.routeros.spec import RouterSpec

_MAGIC = b"\x1e\xf1\xd0\xba"


_SYSTEM, _MAIN = "system", "routeros"


_INFO, _MULTIPLE, _ARCHITECTURE = 1, 18, 16


_X86 = {"i386": "x86", "x86_64": "x86"}


@dataclass(frozen=True, slots=True)
class PackageFile:
    """Properties of a package in `/file`: `package-name`, `package-version`, `package-architecture`."""

    name: str
    version: str
    architecture: str

    @property
    def package(self) -> str:
        """Name in `/system/package`."""
        return _MAIN if self.name == _SYSTEM or self.name.startswith(f"{_MAIN}-") else self.name


def package_file(contents: str) -> PackageFile | None:
    """Parse the header; None for an incomplete or other file."""
    data = contents.encode(errors="surrogateescape")
    if data[:4] != _MAGIC or len(data) < 8 or int.from_bytes(data[4:8], "little") != len(data) - 8:  # noqa: PLR2004
        return None
    name = version = architecture = ""
    place = 8
    while place + 6 <= len(data):
        kind, size = struct.unpack_from("<HI", data, place)
        body = data[place + 6 : place + 6 + size]
        place += 6 + size
        if kind in (_INFO, _MULTIPLE) and not name and len(body) >= 20:  # noqa: PLR2004 - name and version
            name = body[:16].rstrip(b"\0").decode("ascii", "replace")
            patch, _, minor, major = body[16:20]
            version = f"{major}.{minor}" + (f".{patch}" if patch else "")
        if kind == _ARCHITECTURE:
            architecture = body.decode("ascii", "replace")
    return PackageFile(name, version, architecture) if place == len(data) and name and architecture else None


@dataclass(frozen=True, slots=True)
class Boot:
    """Result of a boot: spec, remaining files, and log entries."""

    spec: RouterSpec
    files: Mapping[str, FlashFile]
    log: tuple[tuple[str, str], ...] = ()
    """Log entries: topics and message."""


def boot_with(spec: RouterSpec, files: Mapping[str, FlashFile]) -> Boot:
    """Install the packages of the root folder: all of the new version, or only those already installed."""
    packages = {
        name: package
        for name, file in files.items()
        if name.endswith(".npk") and "/" not in name and (package := package_file(file.contents)) is not None
    }
    if not packages:
        return Boot(spec, files)
    local = _X86.get(spec.architecture, spec.architecture)
    right = {
        name: entry for name, entry in packages.items() if _X86.get(entry.architecture, entry.architecture) == local
    }
    log = [
        (
            "system,error",
            f"can not install {item.package}-{item.version}: it is made for {item.architecture}, not {local}",
        )
        for name, item in packages.items()
        if name not in right
    ]
    after = _install(spec, tuple(right.values()), log)
    remaining_files = {name: file for name, file in files.items() if name not in packages}
    return Boot(after, remaining_files, tuple(log))


def _install(spec: RouterSpec, candidates: tuple[PackageFile, ...], log: list[tuple[str, str]]) -> RouterSpec:
    system = next((entry for entry in candidates if entry.package == _MAIN), None)
    version = system.version if system is not None else spec.version
    fit = [each.package for each in candidates if each.version == version]
    log.extend(
        ("system,error", f"can not install {item.package}-{item.version}: system-{item.version} is needed")
        for item in candidates
        if item.version != version
    )
    kept_packages = spec.packages if version == spec.version else ()
    if version != spec.version:
        log.extend(
            ("system,info", f"removed {name}-{spec.version}: it needs system-{spec.version}")
            for name in spec.packages
            if name not in fit
        )
    log.extend(("system,info", f"installed {name}-{version}") for name in fit)
    packages = tuple(dict.fromkeys((*kept_packages, *sorted(fit))))
    return spec.model_copy(update={"version": version, "packages": packages})
