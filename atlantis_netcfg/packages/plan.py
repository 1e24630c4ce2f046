"""May this set of packages go onto this device, and what would be there afterwards.

Rules: all packages of one version, since a package of another one than the system is not installed (Manual, Packages);
the architecture of `/system/resource` (Manual, Upgrade); every installed package has its successor in the set. From
7.13 on `wireless` is a package of its own, which before was in the bundle, and `wifiwave2` is called `wifi-qcom`
(Manual, Packages): a device with radios that crosses 7.13 without one of them has no Wi-Fi afterwards (field log of a
survey boat, 7.4.1 to 7.22). `wireless` conflicts with `wifi-qcom` and `wifi-qcom-ac` (Manual, Packages).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import DeviceFailed
from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.packages.npk import MAIN, Npk

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["Installed", "Package", "Upgrade", "UpgradeRefused", "plan"]

SPLIT = Version(7, 13)
"""The first version whose bundle has no `wireless`."""
_LEGACY_RADIO, _NEW_RADIO = "wireless", ("wifi-qcom", "wifi-qcom-ac", "wifi-qcom-be", "wifi-mediatek")
_RENAMED = {"wifiwave2": ("wifi-qcom", "wifi-qcom-ac"), "lora": ("lora", "iot")}
_BUNDLED = ("system", "ppp", "dhcp", "hotspot", "ipv6", "mpls", "routing", "security", "advanced-tools", "wireless")
"""What version 6 lists beside its bundle, and version 7 has inside."""
_CHR = {"x86_64": "x86"}
_SPARE_BYTES = 512 * 1024
"""Kept free on the flash beside the files: the device writes while it installs (inferred)."""


class UpgradeRefused(DeviceFailed):
    """The set would harm the device or would not be installed; nothing was sent."""


@dataclass(frozen=True, slots=True)
class Package:
    """A row of `/system/package` that is installed."""

    name: str
    version: Version
    disabled: bool = False


@dataclass(frozen=True, slots=True)
class Installed:
    """What the device says about itself."""

    version: Version
    architecture: str
    board: str
    packages: tuple[Package, ...]
    free_bytes: int
    """Of its flash (`free-hdd-space`)."""
    radios: tuple[str, ...] = ()
    """Names of its Wi-Fi interfaces, of either family."""
    factory: Version | None = None
    """The oldest version that the board accepts (`factory-software`)."""

    @property
    def bundle(self) -> bool:
        """Whether version 6's bundle or version 7's is installed: only those can be followed by version 7."""
        return any(package.name in (MAIN, f"{MAIN}-{self.architecture}") for package in self.packages)


@dataclass(frozen=True, slots=True)
class Upgrade:
    """What is to be sent, in which order, and what is to be read back after the reboot; empty: already so."""

    send: tuple[Npk, ...]
    """RouterOS itself last: a device that reboots before finds packages that it cannot install, and stays as it is."""
    version: Version
    """Of the system afterwards."""
    expected: tuple[str, ...]
    """Names of the packages that have to be there afterwards."""
    notes: tuple[str, ...] = ()

    @property
    def size(self) -> int:
        """Bytes to send."""
        return sum(package.size for package in self.send)


def plan(installed: Installed, given: Sequence[Npk], *, give_up: Sequence[str] = ()) -> Upgrade:
    """Decide; `give_up` names installed packages that a person wants to lose.

    Raises UpgradeRefused with all reasons.
    """
    version = max((package.version for package in given), default=installed.version)
    reasons = [*_of_the_set(given), *_for_the_device(installed, given, version)]
    if not reasons:
        reasons = [*_left_behind(installed, given, version, give_up), *_room(installed, given)]
    if reasons:
        raise UpgradeRefused("not upgraded, nothing was sent: " + "; ".join(reasons), hint=_hint(installed))
    there = {package.name: package for package in installed.packages}
    send = tuple(
        package
        for package in sorted(given, key=lambda each: (each.name == MAIN, each.name))
        if package.name not in there or there[package.name].version != package.version
    )
    kept = {package.name for package in installed.packages if version == installed.version}
    expected = tuple(sorted({package.name for package in given} | kept))
    return Upgrade(send, version, expected, tuple(_notes(installed, version)) if send else ())


def _hint(installed: Installed) -> str:
    return f"the device: {installed.board}, {installed.architecture}, RouterOS {installed.version}"


def _of_the_set(given: Sequence[Npk]) -> list[str]:
    reasons = []
    names = [package.name for package in given]
    twice = sorted({name for name in names if names.count(name) > 1})
    if not given:
        reasons.append("no package was given")
    if twice:
        reasons.append(f"{', '.join(twice)} is given twice")
    versions = sorted({package.version for package in given})
    if len(versions) > 1:
        files = ", ".join(f"{package.path.name}" for package in given)
        reasons.append(f"packages of different versions do not work together: {files}")
    if _LEGACY_RADIO in names and (other := sorted(set(names) & {"wifi-qcom", "wifi-qcom-ac"})):
        reasons.append(f"{_LEGACY_RADIO} and {other[0]} cannot be active together: give one of them")
    return reasons


def _for_the_device(installed: Installed, given: Sequence[Npk], version: Version) -> list[str]:
    known = _CHR.get(installed.architecture, installed.architecture)
    reasons = [
        f"{package.path.name} is for {package.architecture}, the device is {installed.architecture}"
        for package in given
        if package.architecture != known
    ]
    if version < installed.version:
        reasons.append(f"the device has {installed.version}, and this command does not go back to {version}")
    if installed.factory is not None and version < installed.factory:
        reasons.append(f"this board needs {installed.factory} or later")
    if version != installed.version and not any(package.name == MAIN for package in given):
        reasons.append(
            f"the packages are of {version}, the device runs {installed.version}:"
            f" the {MAIN} package of {version} is missing"
        )
    if version.major > installed.version.major and not installed.bundle:
        reasons.append(
            f"on this device RouterOS {installed.version.major} is made of single packages:"
            " upgrade it to the bundle first"
        )
    return reasons


def _left_behind(installed: Installed, given: Sequence[Npk], version: Version, give_up: Sequence[str]) -> list[str]:
    """Name what would be lost: an installed package without a successor, or the driver of the radios."""
    if version == installed.version:
        return []
    names = {package.name for package in given}
    reasons = []
    for package in installed.packages:
        heirs = _heirs(package.name, installed)
        if not heirs or names & set(heirs) or package.name in give_up:
            continue
        reasons.append(
            f"{package.name} is installed, and the set has no {' or '.join(heirs)} of {version}"
            f" (add it, or give it up with drop={package.name})"
        )
    crossing = installed.version < SPLIT <= version
    drivers = {_LEGACY_RADIO, *_NEW_RADIO}
    lost = crossing and installed.radios and not names & drivers and _LEGACY_RADIO not in give_up
    if lost and not any(package.name == "wifiwave2" for package in installed.packages):
        reasons.append(
            f"from {SPLIT} on the driver of {', '.join(installed.radios)} is a package of its own: add"
            f" wireless-{version}-{installed.architecture}.npk (or drop={_LEGACY_RADIO}, and lose the radio)"
        )
    return reasons


def _heirs(name: str, installed: Installed) -> tuple[str, ...]:
    """Return the packages one of which has to follow `name`; none where the bundle holds it."""
    if name in (MAIN, f"{MAIN}-{installed.architecture}"):
        return (MAIN,)
    if name in _BUNDLED and installed.version < SPLIT:
        return ()
    return _RENAMED.get(name, (name,))


def _room(installed: Installed, given: Sequence[Npk]) -> list[str]:
    need = sum(package.size for package in given) + _SPARE_BYTES
    if installed.free_bytes >= need:
        return []
    return [f"the device has {installed.free_bytes // 1024} KiB free, and {need // 1024} KiB are needed"]


def _notes(installed: Installed, version: Version) -> list[str]:
    notes = ["the device reboots; everything that it feeds by PoE and every link over it is down meanwhile"]
    if version.major > installed.version.major:
        notes.append(
            f"from RouterOS {installed.version.major} to {version.major} the device rewrites its configuration:"
            " compare the saved export with the new one"
        )
    notes.append("the boot loader is not upgraded: /system/routerboard/upgrade does it, and wants another reboot")
    return notes
