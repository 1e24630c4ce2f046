"""RouterOS packages: what a given set of `.npk` files would do to a device, and whether that is allowed.

The set is read from the files' headers, never from their names alone, and compared with the device's properties.
Uploads are checked here first; nothing here contacts a device.

Rules: all packages have one version, since a package of another version than the system's is not installed (Manual,
Packages); the architecture is that of `/system/resource` (Manual, Upgrade); every installed package has a successor in
the set, so that no radio or modem is lost by an upgrade. From 7.13 on `wireless` is a separate package; before, it was
in the bundle, and `wifi-qcom` was called `wifiwave2` (Manual, Packages). A device with radios that crosses 7.13 without
one of them has no Wi-Fi afterwards (field log of a survey boat, 7.4.1 to 7.22). `wireless` conflicts with `wifi-qcom`
and `wifi-qcom-ac` (Manual, Packages).

MikroTik does not publish the format of `.npk`. The description used here was reverse-engineered by others, who agree
(repositories rsa9000/npk-tools, botlabsDev/npkpy): bytes 1E F1 D0 BA, the size of the rest as 32 bits little-endian,
then parts of 16 bits of type, 32 bits of size, and a body. Types 1 and 18 begin with a name of 16 bytes and a version
(revision, maturity, minor, major); type 16 is the architecture. The meaning of the maturity byte is unknown, so the
file's name distinguishes a beta from a release. The signature in the file is checked by the device, not here.
"""

from __future__ import annotations

import hashlib
import re
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import DeviceError, UsageError
from atlantis_netcfg.core.messages import alternatives, arg, join, msg
from atlantis_netcfg.core.versions import Version

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path


MAIN = "routeros"
"""RouterOS itself; its header says `system`, `/system/package` says `routeros`."""

_MAGIC = bytes.fromhex("1ef1d0ba")
_HEAD = struct.Struct("<4sI")
_PART = struct.Struct("<HI")
_INFO = struct.Struct("<16sBBBB")
_INFO_TYPES = (1, 18)
_ARCHITECTURE_TYPE = 16
_NAME = re.compile(r"(?P<name>[a-z][a-z0-9-]*?)(?:-(?P<first>[a-z]+\d*))?-(?P<version>\d+\.\d+[a-z0-9.]*?)"
                   r"(?:-(?P<last>[a-z]+\d*))?\.npk")  # fmt: skip
_ARCHITECTURES = ("arm", "arm64", "mipsbe", "mmips", "smips", "ppc", "tile", "x86", "x86_64")
_ALIASES = {"i386": "x86", "powerpc": "ppc"}
_MOST_PARTS = 4096


class NotAPackage(UsageError):
    """A file is not a package, is truncated, or contains contradictory data."""


@dataclass(frozen=True, slots=True)
class Npk:
    """One package file on the technician's disk."""

    path: Path
    name: str
    """Name as in `/system/package`: `routeros`, `wireless`, `wifi-qcom` …"""
    version: Version
    architecture: str
    """Architecture as in `/system/resource`: `arm64`, `mipsbe` …; x86 is `x86`."""
    size: int
    """Size in bytes."""
    sha256: str


def read_npk(path: Path) -> Npk:
    """Read and check one file. Raises NotAPackage."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise NotAPackage(
            f"{arg(path)}: {arg(error.strerror or error)}", hint="use a `.npk` file from MikroTik"
        ) from error
    header, architecture = _inside(path, data)
    file_name = _parsed_name(path)
    name = MAIN if header[0] in ("system", MAIN) or header[0].startswith(f"{MAIN}-") else header[0]
    _require_match(path, "package", file_name.name, name)
    numbers = (file_name.version.major, file_name.version.minor, file_name.version.patch)
    _require_match(path, "version", ".".join(map(str, numbers)), ".".join(map(str, header[1])))
    _require_match(path, "architecture", file_name.architecture, architecture)
    return Npk(path, name, file_name.version, architecture, len(data), hashlib.sha256(data).hexdigest())


@dataclass(frozen=True, slots=True)
class _FileName:
    """The parts of a file name: `routeros-7.18.2-arm64.npk`, on version 6 `routeros-arm64-6.49.19.npk`."""

    name: str
    version: Version
    architecture: str


def _parsed_name(path: Path) -> _FileName:
    match = _NAME.fullmatch(path.name)
    if match is None or not _is_version(match["version"]):
        raise NotAPackage(
            f"{arg(path)}: not a valid package name",
            hint="keep MikroTik's own file names, for example routeros-7.18.2-arm64.npk",
        )
    name, first, last = match["name"], match["first"], match["last"]
    if first is not None and (last is not None or _architecture_of(first) is None):
        name, first = f"{name}-{first}", None
    return _FileName(name, Version.parse(match["version"]), _architecture_of(last or first or "x86") or (last or "x86"))


def _is_version(text: str) -> bool:
    try:
        Version.parse(text)
    except ValueError:
        return False
    return True


def _architecture_of(word: str) -> str | None:
    word = _ALIASES.get(word, word)
    return word if word in _ARCHITECTURES else None


def _inside(path: Path, data: bytes) -> tuple[tuple[str, tuple[int, int, int]], str]:
    """Return name, version and architecture as the header has them."""
    info: tuple[str, tuple[int, int, int]] | None = None
    architecture = None
    for kind, body in _parts(path, data):
        if kind in _INFO_TYPES and info is None and len(body) >= _INFO.size:
            name, revision, _maturity, minor, major = _INFO.unpack_from(body)
            info = name.rstrip(b"\0").decode("ascii", "replace"), (major, minor, revision)
        elif kind == _ARCHITECTURE_TYPE and architecture is None:
            word = body.rstrip(b"\0").decode("ascii", "replace")
            architecture = _architecture_of(word) or word
    if info is None or architecture is None:
        raise NotAPackage(f"{arg(path)}: a package without a name or an architecture", hint="download it again")
    return info, architecture


def _parts(path: Path, data: bytes) -> Iterator[tuple[int, bytes]]:
    if len(data) < _HEAD.size or data[:4] != _MAGIC:
        raise NotAPackage(f"{arg(path)}: not a RouterOS package", hint="use a `.npk` file from MikroTik")
    _magic, rest = _HEAD.unpack_from(data)
    if rest != len(data) - _HEAD.size:
        raise NotAPackage(
            f"{arg(path)}: {arg(len(data))} bytes long, but its header says {arg(rest + _HEAD.size)}",
            hint="download it again: it is truncated",
        )
    at = _HEAD.size
    for _ in range(_MOST_PARTS):
        if at == len(data):
            return
        if at + _PART.size > len(data):
            break
        kind, size = _PART.unpack_from(data, at)
        at += _PART.size
        if at + size > len(data):
            break
        yield kind, data[at : at + size]
        at += size
    raise NotAPackage(
        f"{arg(path)}: the sizes of its parts do not match its size", hint="download it again: it is damaged"
    )


def _require_match(path: Path, what: str, from_name: str, inside: str) -> None:
    if from_name != inside:
        raise NotAPackage(
            f"{arg(path)}: according to its name the {arg(what)} is {arg(from_name)}, but inside it is {arg(inside)}",
            hint="keep MikroTik's own file names",
        )


SPLIT = Version(7, 13)
"""First version whose bundle does not contain `wireless`."""
_LEGACY_RADIO, _NEW_RADIO = "wireless", ("wifi-qcom", "wifi-qcom-ac", "wifi-qcom-be", "wifi-mediatek")
_SUCCESSORS = {"wifiwave2": ("wifi-qcom", "wifi-qcom-ac"), "lora": ("lora", "iot")}
_BUNDLE_PACKAGES = (
    "system",
    "ppp",
    "dhcp",
    "hotspot",
    "ipv6",
    "mpls",
    "routing",
    "security",
    "advanced-tools",
    "wireless",
)
"""Packages that version 6 lists beside its bundle, and that version 7 includes."""
_CHR = {"x86_64": "x86"}
_SPARE_BYTES = 512 * 1024
"""Flash kept free beside the files: the device writes during installation. Assumption: upgrade-free-flash"""


class UpgradeError(DeviceError):
    """The set would harm the device or would not be installed; nothing was sent."""


@dataclass(frozen=True, slots=True)
class RouterOsPackage:
    """An installed package from `/system/package`."""

    name: str
    version: Version
    is_disabled: bool = False


@dataclass(frozen=True, slots=True)
class InstalledSystem:
    """Version, architecture and packages of the device."""

    version: Version
    architecture: str
    board: str
    packages: tuple[RouterOsPackage, ...]
    free_bytes: int
    """Free bytes of the flash (`free-hdd-space`)."""
    radios: tuple[str, ...] = ()
    """Names of the Wi-Fi interfaces, of either family."""
    factory: Version | None = None
    """Oldest version that the board accepts (`factory-software`)."""

    @property
    def bundle(self) -> bool:
        """True if the bundle of version 6 or of version 7 is installed: only these can be upgraded to version 7."""
        return any(package.name in (MAIN, f"{MAIN}-{self.architecture}") for package in self.packages)


@dataclass(frozen=True, slots=True)
class Upgrade:
    """What to send, in which order, and what to read back after the reboot; empty if already up to date."""

    send: tuple[Npk, ...]
    """Packages to send, RouterOS last: a device that reboots earlier cannot install the others and stays unchanged."""
    version: Version
    """System version after the upgrade."""
    expected_packages: tuple[str, ...]
    """Packages that must be installed after the upgrade."""
    notes: tuple[str, ...] = ()

    @property
    def size(self) -> int:
        """Bytes to send."""
        return sum(package.size for package in self.send)


def plan(system: InstalledSystem, packages: Sequence[Npk], *, give_up: Sequence[str] = ()) -> Upgrade:
    """Plan the upgrade; `give_up` names installed packages that the user wants to lose.

    Raises UpgradeError with all reasons.
    """
    version = max((package.version for package in packages), default=system.version)
    reasons = [*_package_set_reasons(packages), *_device_reasons(system, packages, version)]
    if not reasons:
        reasons = [*_left_behind(system, packages, version, give_up), *_space_reasons(system, packages)]
    if reasons:
        raise UpgradeError("not upgraded, nothing was sent: " + str(arg(join("; ", reasons))), hint=_hint(system))
    there = {package.name: package for package in system.packages}
    send = tuple(
        package
        for package in sorted(packages, key=lambda each: (each.name == MAIN, each.name))
        if package.name not in there or there[package.name].version != package.version
    )
    retained_names = {package.name for package in system.packages if version == system.version}
    expected_names = tuple(sorted({package.name for package in packages} | retained_names))
    return Upgrade(send, version, expected_names, tuple(_notes(system, version)) if send else ())


def _hint(system: InstalledSystem) -> str:
    return msg(f"the device: {arg(system.board)}, {arg(system.architecture)}, RouterOS {arg(system.version)}")


def _package_set_reasons(packages: Sequence[Npk]) -> list[str]:
    reasons = []
    names = [package.name for package in packages]
    twice = sorted({name for name in names if names.count(name) > 1})
    if not packages:
        reasons.append("no package given")
    if twice:
        reasons.append(msg(f"{arg(join(', ', twice))} is given twice"))
    versions = sorted({package.version for package in packages})
    if len(versions) > 1:
        files = join(", ", (f"{package.path.name}" for package in packages))
        reasons.append(msg(f"packages of different versions do not work together: {arg(files)}"))
    if _LEGACY_RADIO in names and (other := sorted(set(names) & {"wifi-qcom", "wifi-qcom-ac"})):
        reasons.append(
            msg(f"{arg(_LEGACY_RADIO)} and {arg(other[0])} cannot be active together: pass only one of them")
        )
    return reasons


def _device_reasons(system: InstalledSystem, packages: Sequence[Npk], version: Version) -> list[str]:
    architecture = _CHR.get(system.architecture, system.architecture)
    reasons = [
        msg(f"{arg(package.path.name)} is for {arg(package.architecture)}, the device is {arg(system.architecture)}")
        for package in packages
        if package.architecture != architecture
    ]
    if version < system.version:
        reasons.append(msg(f"the device has {arg(system.version)}; this command does not downgrade to {arg(version)}"))
    if system.factory is not None and version < system.factory:
        reasons.append(msg(f"this board needs {arg(system.factory)} or later"))
    if version != system.version and not any(package.name == MAIN for package in packages):
        reasons.append(
            msg(
                f"the packages are of {arg(version)}, the device runs {arg(system.version)}:"
                f" the {arg(MAIN)} package of {arg(version)} is missing"
            )
        )
    if version.major > system.version.major and not system.bundle:
        reasons.append(
            msg(
                f"RouterOS {arg(system.version.major)} on this device consists of single packages: upgrade it to the "
                "bundle first"
            )
        )
    return reasons


def _left_behind(
    system: InstalledSystem, packages: Sequence[Npk], version: Version, give_up: Sequence[str]
) -> list[str]:
    """Return what would be lost: an installed package without a successor, or the radio driver."""
    if version == system.version:
        return []
    names = {package.name for package in packages}
    reasons = []
    for package in system.packages:
        heirs = _heirs(package.name, system)
        if not heirs or names & set(heirs) or package.name in give_up:
            continue
        reasons.append(
            msg(
                f"{arg(package.name)} is installed, but the new packages have no {arg(alternatives(heirs))} of "
                f"{arg(version)} (add it, or do without it with drop={arg(package.name)})"
            )
        )
    crossing = system.version < SPLIT <= version
    drivers = {_LEGACY_RADIO, *_NEW_RADIO}
    loses_driver = crossing and system.radios and not names & drivers and _LEGACY_RADIO not in give_up
    if loses_driver and not any(package.name == "wifiwave2" for package in system.packages):
        reasons.append(
            msg(
                f"from {arg(SPLIT)} on the driver of {arg(join(', ', system.radios))} is a separate package: add "
                f"wireless-{arg(version)}-{arg(system.architecture)}.npk (or drop={arg(_LEGACY_RADIO)}, and lose the "
                "radio)"
            )
        )
    return reasons


def _heirs(name: str, system: InstalledSystem) -> tuple[str, ...]:
    """Return the possible successors of package `name`; empty if the bundle contains it."""
    if name in (MAIN, f"{MAIN}-{system.architecture}"):
        return (MAIN,)
    if name in _BUNDLE_PACKAGES and system.version < SPLIT:
        return ()
    return _SUCCESSORS.get(name, (name,))


def _space_reasons(system: InstalledSystem, packages: Sequence[Npk]) -> list[str]:
    need = sum(package.size for package in packages) + _SPARE_BYTES
    if system.free_bytes >= need:
        return []
    return [msg(f"the device has {arg(system.free_bytes // 1024)} KiB free, but {arg(need // 1024)} KiB are needed")]


def _notes(system: InstalledSystem, version: Version) -> list[str]:
    notes = ["the device reboots; meanwhile everything that it powers by PoE and every link over it is down"]
    if version.major > system.version.major:
        notes.append(
            msg(
                f"from RouterOS {arg(system.version.major)} to {arg(version.major)} the device rewrites its "
                "configuration: compare the saved export with the new one"
            )
        )
    notes.append("the boot loader is not upgraded: /system/routerboard/upgrade does that, and needs another reboot")
    return notes
