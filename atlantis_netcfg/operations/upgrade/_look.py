"""What a device says of its software: version, packages, radios, room, and the package files on its flash."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import DeviceFailed
from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.packages import Installed, Package
from atlantis_netcfg.routeros.api import Command, Session

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.packages import Npk
    from atlantis_netcfg.routeros.api import Endpoint, Reply

__all__ = ["REBOOTED_WITHIN_S", "Seen", "log_of", "look"]

REBOOTED_WITHIN_S = 5.0
"""How far the device's count of its uptime and our clock may be apart."""

_RESOURCE = "version,architecture-name,board-name,free-hdd-space,factory-software,uptime"
_READS = (
    Command("/system/resource/print", ((".proplist", _RESOURCE),)),
    Command("/system/package/print", ((".proplist", "name,version,disabled"),)),
    Command("/interface/print", ((".proplist", "name,type"),), ("?type=wlan", "?type=wifi", "?#|")),
    Command(
        "/file/print",
        ((".proplist", "name,size,package-name,package-version,package-architecture"),),
        ("?type=package",),
    ),
)
_WEIGHT_S = {"w": 604800, "d": 86400, "h": 3600, "m": 60, "s": 1}
_LOG_LINES = 6


@dataclass(frozen=True, slots=True)
class Seen:
    """One look at a device."""

    installed: Installed
    uptime_s: float
    files: Mapping[str, Mapping[str, str]]
    """Package files on its flash, by name, as `/file` shows them."""

    def holds(self, package: Npk) -> bool:
        """Whether this very package lies on the flash, whole: of its size, and understood by the device itself."""
        file = self.files.get(package.path.name)
        if file is None or file.get("size") != str(package.size):
            return False
        return "package-name" not in file or file.get("package-version") == str(package.version)


async def look(endpoint: Endpoint) -> Seen:
    """Read it in one session of two round trips. Raises DeviceFailed, also for answers that are not understood."""
    session = await Session.open(endpoint)
    try:
        resource, packages, radios, files = await session.flight(_READS)
    finally:
        await session.close()
    about = next(iter(resource.checked().rows), {})
    return Seen(
        Installed(
            version=_version(about.get("version", "")),
            architecture=about.get("architecture-name", ""),
            board=about.get("board-name", ""),
            packages=tuple(_packages(packages)),
            free_bytes=_number(about.get("free-hdd-space", "")),
            radios=tuple(row.get("name", "") for row in radios.checked().rows),
            factory=_maybe(about.get("factory-software", "")),
        ),
        uptime_s=_seconds(about.get("uptime", "")),
        files={row.get("name", ""): row for row in files.checked().rows},
    )


async def log_of(endpoint: Endpoint) -> list[str]:
    """Return what the device wrote about packages, latest last; empty if it cannot be read."""
    try:
        session = await Session.open(endpoint)
    except DeviceFailed:
        return []
    try:
        reply = await session.command(Command("/log/print", ((".proplist", "topics,message"),)))
    except DeviceFailed:
        return []
    finally:
        await session.close()
    about = re.compile(r"install|package|npk|removed", re.IGNORECASE)
    return [row["message"] for row in reply.rows if about.search(row.get("message", ""))][-_LOG_LINES:]


def _packages(reply: Reply) -> list[Package]:
    """Return what is installed; from 7.18 on the list also has packages that a server offers, without a version."""
    return [
        Package(row.get("name", ""), _version(row["version"]), row.get("disabled") in ("true", "yes"))
        for row in reply.checked().rows
        if row.get("version")
    ]


def _version(text: str) -> Version:
    found = _maybe(text)
    if found is None:
        raise DeviceFailed(f"this is no RouterOS that we know: it names a version `{text}`")
    return found


def _maybe(text: str) -> Version | None:
    try:
        return Version.parse(text)
    except ValueError:
        return None


def _number(text: str) -> int:
    return int(text) if text.isdecimal() else 0


def _seconds(text: str) -> float:
    """Read `1w2d3h4m5s`."""
    return float(sum(int(count) * _WEIGHT_S[unit] for count, unit in re.findall(r"(\d+)([wdhms])(?![a-z])", text)))
