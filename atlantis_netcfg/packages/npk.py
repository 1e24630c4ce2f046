"""The header of a `.npk` file: whose package it is, of which version, for which architecture.

MikroTik does not publish the format. What is used here was found by others and agrees between them (repositories
rsa9000/npk-tools, botlabsDev/npkpy): bytes 1E F1 D0 BA, the size of the rest as 32 bits little-endian, then parts of 16
bits of type, 32 bits of size, and a body. Types 1 and 18 begin with a name of 16 bytes and a version (revision,
maturity, minor, major); type 16 is the architecture. The maturity byte is not understood by anybody, so that the file's
name tells a beta from a release. The signature in the file is checked by the device, not here.
"""

from __future__ import annotations

import hashlib
import re
import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.versions import Version

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

__all__ = ["MAIN", "NotAPackage", "Npk", "read_npk"]

MAIN = "routeros"
"""The bundle that is RouterOS itself; its header says `system`, `/system/package` says `routeros`."""

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
    """A file that was given as a package is none, is cut short, or says two things about itself."""


@dataclass(frozen=True, slots=True)
class Npk:
    """One package file as it lies on the technician's disk."""

    path: Path
    name: str
    """As `/system/package` will say it: `routeros`, `wireless`, `wifi-qcom` …"""
    version: Version
    architecture: str
    """As `/system/resource` says it: `arm64`, `mipsbe` …; x86 is `x86`."""
    size: int
    """Bytes."""
    sha256: str


def read_npk(path: Path) -> Npk:
    """Read and check one file. Raises NotAPackage."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise NotAPackage(f"{path}: {error.strerror or error}", hint="name a `.npk` file from MikroTik") from error
    header, architecture = _inside(path, data)
    named = _parsed_name(path)
    name = MAIN if header[0] in ("system", MAIN) or header[0].startswith(f"{MAIN}-") else header[0]
    _agree(path, "package", named.name, name)
    numbers = (named.version.major, named.version.minor, named.version.patch)
    _agree(path, "version", ".".join(map(str, numbers)), ".".join(map(str, header[1])))
    _agree(path, "architecture", named.architecture, architecture)
    return Npk(path, name, named.version, architecture, len(data), hashlib.sha256(data).hexdigest())


@dataclass(frozen=True, slots=True)
class _FileName:
    """What a file's name says: `routeros-7.18.2-arm64.npk`, on version 6 `routeros-arm64-6.49.19.npk`."""

    name: str
    version: Version
    architecture: str


def _parsed_name(path: Path) -> _FileName:
    match = _NAME.fullmatch(path.name)
    if match is None or not _is_version(match["version"]):
        raise NotAPackage(
            f"{path}: not the name of a package", hint="keep MikroTik's own names, like routeros-7.18.2-arm64.npk"
        )
    name, first, last = match["name"], match["first"], match["last"]
    if first is not None and (last is not None or _known(first) is None):
        name, first = f"{name}-{first}", None
    return _FileName(name, Version.parse(match["version"]), _known(last or first or "x86") or (last or "x86"))


def _is_version(text: str) -> bool:
    try:
        Version.parse(text)
    except ValueError:
        return False
    return True


def _known(word: str) -> str | None:
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
            architecture = _known(word) or word
    if info is None or architecture is None:
        raise NotAPackage(f"{path}: a package without a name or an architecture", hint="download it again")
    return info, architecture


def _parts(path: Path, data: bytes) -> Iterator[tuple[int, bytes]]:
    if len(data) < _HEAD.size or data[:4] != _MAGIC:
        raise NotAPackage(f"{path}: not a RouterOS package", hint="name a `.npk` file from MikroTik")
    _magic, rest = _HEAD.unpack_from(data)
    if rest != len(data) - _HEAD.size:
        raise NotAPackage(
            f"{path}: {len(data)} bytes long, but it says {rest + _HEAD.size}",
            hint="download it again: it is cut short",
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
    raise NotAPackage(f"{path}: its parts do not add up to its size", hint="download it again: it is damaged")


def _agree(path: Path, what: str, named: str, inside: str) -> None:
    if named != inside:
        raise NotAPackage(
            f"{path}: by its name the {what} is {named}, inside it is {inside}", hint="keep MikroTik's own file names"
        )
