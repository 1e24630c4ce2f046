"""What installing costs: bytes over the link, and room on the disk; told before anything is downloaded."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from .refused import Refused

if TYPE_CHECKING:
    from typing import Sequence

    from .apt_run import Apt

__all__ = ["Costs", "bytes_of_lists", "costs_of", "in_words", "refuse_if_full", "to_install"]

_ARCHIVES = "/var/cache/apt/archives"
_SPARE_BYTES = 32 * 1024 * 1024
"""dpkg's database, logs, and what the scripts of packages make."""
_INST = re.compile(r"^Inst (?P<name>\S+) (?:\[\S*\] )?\((?P<version>\S+) .*\)", re.MULTILINE)
_URI = re.compile(r"^'(?P<scheme>[a-z+]+):[^']*' (?P<file>\S+) (?P<bytes>\d+)", re.MULTILINE)


@dataclass(frozen=True)
class Costs:
    """In bytes."""

    download: int
    """Over the network: not what lies on the computer already."""
    room: int
    """What the packages take when they are installed."""


def to_install(text: str) -> dict[str, str]:
    """The packages and versions that a simulation (`apt-get -s`) would install."""
    return {match["name"].partition(":")[0]: match["version"] for match in _INST.finditer(text)}


def costs_of(apt: Apt, arguments: Sequence[str], packages: dict[str, str]) -> Costs:
    """What `apt-get ARGUMENTS` costs, that installs `packages`."""
    matchs = _URI.finditer(apt.get("--yes", "--print-uris", *arguments).said)
    download = sum(int(match["bytes"]) for match in matchs if match["scheme"] not in ("file", "copy", "cdrom"))
    if not packages:
        return Costs(download, 0)
    shown = apt.cache("show", "--no-all-versions", *(f"{name}={version}" for name, version in packages.items()))
    kilobytes = sum(int(size) for size in re.findall(r"^Installed-Size: (\d+)", shown.said, re.MULTILINE))
    return Costs(download, kilobytes * 1024)


def bytes_of_lists(apt: Apt) -> int | None:
    """What an update may download at most, by what the sources said of themselves last; None: nobody knows yet."""
    folder = Path(apt.tree.at(apt.lists))
    found = 0
    for path in folder.iterdir() if folder.is_dir() else ():
        if path.name.endswith("InRelease"):
            text = path.read_text(errors="replace")
            for index in set(re.findall(rf"(\S+/binary-{apt.architecture}/Packages)(?:\.\w+)?$", text, re.MULTILINE)):
                sizes = re.findall(rf"^ [0-9a-f]{{64}} +(\d+) {re.escape(index)}(?:\.\w+)?$", text, re.MULTILINE)
                found += min((int(size) for size in sizes), default=0)
    return found or None


def refuse_if_full(apt: Apt, costs: Costs) -> None:
    """Raise Refused where the disk cannot take it; places of one file system count together."""
    needed: dict[int, tuple[str, int]] = {}
    for place, size in (("/usr", costs.room + _SPARE_BYTES), (_ARCHIVES, costs.download)):
        real = Path(apt.tree.at(place))
        if real.is_dir():
            device = real.stat().st_dev
            first, sum_before = needed.get(device, (place, 0))
            needed[device] = (first, sum_before + size)
    for place, size in needed.values():
        result = os.statvfs(apt.tree.at(place))
        free = result.f_bavail * result.f_frsize
        if free < size:
            raise Refused(
                f"the disk of the computer is too full: {in_words(size)} are needed at {place}, "
                f"{in_words(free)} are free",
                "make room, for example by `apt-get clean` and `journalctl --vacuum-size=50M`; "
                "`df -h` tells where it is full",
            )


def in_words(size: int) -> str:
    """A size for a person: decimal units, as a contract of a mobile network counts."""
    for unit, factor in (("GB", 10**9), ("MB", 10**6), ("kB", 10**3)):
        if size >= factor:
            return f"{size / factor:.1f} {unit}" if size < 10 * factor else f"{size / factor:.0f} {unit}"
    return f"{size} bytes"
