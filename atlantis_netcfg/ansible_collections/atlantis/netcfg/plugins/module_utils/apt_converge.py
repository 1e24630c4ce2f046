"""Bring the packages of a computer to their desired state, whatever state an earlier run has left.

The costs, in bytes over the link and on the disk, are known before anything is downloaded.
"""

from __future__ import annotations

import os
import re
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Callable, Collection, Mapping, Sequence

from atlantis_netcfg.core.messages import arg, msg

from .apt_messages import explain_install_failure, explain_update_failure, other_source_notes
from .apt_run import (
    Apt,
    InstalledPackage,
    half_done,
    list_installed,
    refuse_another_system,
    version_matches,
    wait_for_others,
)
from .apt_sources import AptKey, Sources, check_key
from .errors import ModuleError

_ARCHIVES = "/var/cache/apt/archives"
_SPARE_BYTES = 32 * 1024 * 1024
"""Spare bytes for dpkg's database, logs and files that package scripts create."""
_INST = re.compile(r"^Inst (?P<name>\S+) (?:\[\S*\] )?\((?P<version>\S+) .*\)", re.MULTILINE)
_URI = re.compile(r"^'(?P<scheme>[a-z+]+):[^']*' (?P<file>\S+) (?P<bytes>\d+)", re.MULTILINE)


@dataclass(frozen=True)
class AptCosts:
    """Cost of an apt run, in bytes."""

    download: int
    """Bytes to fetch from the network, without what is on the computer already."""
    room: int
    """Bytes that the installed packages need."""


def to_install(text: str) -> dict[str, str]:
    """Return the packages and versions that a simulation (`apt-get -s`) would install."""
    return {match["name"].partition(":")[0]: match["version"] for match in _INST.finditer(text)}


def costs_of(apt: Apt, arguments: Sequence[str], packages: dict[str, str]) -> AptCosts:
    """Compute the cost of `apt-get ARGUMENTS`, which installs `packages`."""
    matchs = _URI.finditer(apt.get("--yes", "--print-uris", *arguments).output)
    download = sum(int(match["bytes"]) for match in matchs if match["scheme"] not in ("file", "copy", "cdrom"))
    if not packages:
        return AptCosts(download, 0)
    show_output = apt.cache("show", "--no-all-versions", *(f"{name}={version}" for name, version in packages.items()))
    kilobytes = sum(int(size) for size in re.findall(r"^Installed-Size: (\d+)", show_output.output, re.MULTILINE))
    return AptCosts(download, kilobytes * 1024)


def max_lists_download(apt: Apt) -> int | None:
    """Estimate the largest download of an update from the sources' last InRelease files; None if unknown."""
    folder = Path(apt.tree.at(apt.lists))
    total_bytes = 0
    for path in folder.iterdir() if folder.is_dir() else ():
        if path.name.endswith("InRelease"):
            text = path.read_text(errors="replace")
            for index in set(re.findall(rf"(\S+/binary-{apt.architecture}/Packages)(?:\.\w+)?$", text, re.MULTILINE)):
                sizes = re.findall(rf"^ [0-9a-f]{{64}} +(\d+) {re.escape(index)}(?:\.\w+)?$", text, re.MULTILINE)
                total_bytes += min((int(size) for size in sizes), default=0)
    return total_bytes or None


def refuse_if_full(apt: Apt, costs: AptCosts) -> None:
    """Raise ModuleError if the disk has too little space; paths on the same file system are added up."""
    needs_by_device: dict[int, tuple[str, int]] = {}
    for place, size in (("/usr", costs.room + _SPARE_BYTES), (_ARCHIVES, costs.download)):
        real = Path(apt.tree.at(place))
        if real.is_dir():
            device = real.stat().st_dev
            first, sum_before = needs_by_device.get(device, (place, 0))
            needs_by_device[device] = (first, sum_before + size)
    for place, size in needs_by_device.values():
        result = os.statvfs(apt.tree.at(place))
        free = result.f_bavail * result.f_frsize
        if free < size:
            raise ModuleError(
                f"the computer's disk is too full: {arg(format_size(size))} are needed at {arg(place)}, "
                f"{arg(format_size(free))} are free",
                "free some space, for example with `apt-get clean` and `journalctl --vacuum-size=50M`; `df -h` "
                "shows what is full",
            )


def format_size(size: int) -> str:
    """Format a size for a person, in decimal units as mobile network contracts count."""
    for unit, factor in (("GB", 10**9), ("MB", 10**6), ("kB", 10**3)):
        if size >= factor:
            decimals = 1 if size < 10 * factor else 0
            return msg(f"{arg(size / factor):.{decimals}f} {arg(unit)}")
    return msg(f"{arg(size)} bytes")


_INSTALL = (
    "--no-install-recommends",
    "--no-remove",
    "-o",
    "Dpkg::Options::=--force-confdef",
    "-o",
    "Dpkg::Options::=--force-confold",
)
_DAMAGED_LISTS = ("could not be parsed or opened", "Unable to parse package file", "package cache file is corrupted")
_DAMAGED_ARCHIVE = "dpkg-deb: error"


@dataclass(frozen=True)
class DesiredPackages:
    """Desired packages of a computer; `packages` maps a name to its version, None for any version."""

    packages: Mapping[str, str | None]
    keys: Sequence[AptKey] = ()
    codename: str | None = None
    distribution: str | None = None
    architectures: Sequence[str] = ()
    """Accepted architectures; empty: any."""
    limit_bytes: int | None = None
    """Maximum download in bytes."""
    limit_words: str = ""
    """Reason for `limit_bytes`: the link in use and what it costs."""


@dataclass
class AptOutcome:
    """Changes and notes of an apt run; in check mode, the changes that it would make."""

    changes: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    versions: dict[str, str] = field(default_factory=dict)
    """Versions of the declared packages, as reported by dpkg."""
    also: dict[str, str] = field(default_factory=dict)
    """Versions of the other packages that were installed with them."""
    download_bytes: int = 0


class AptConvergence:
    """One run; `clock` gives the computer's time in seconds since 1970."""

    def __init__(
        self, apt: Apt, sources: Sources, desired_packages: DesiredPackages, clock: Callable[[], float] = time.time
    ) -> None:
        self.apt = apt
        self.sources = sources
        self.desired_packages = desired_packages
        self.clock = clock
        self.outcome = AptOutcome()
        self._before: dict[str, InstalledPackage] | None = None
        """Installed packages before the first change was made."""

    def run(self, *, check: bool) -> AptOutcome:
        """Read the current state and, unless `check` is set, install what is missing. Raises ModuleError."""
        self._preflight()
        before = list_installed(self.apt)
        half_installed = half_done(self.apt, before)
        missing = self._missing(before)
        files = [*self.sources.changed_paths, *self.sources.conflicting_paths]
        self.outcome.changes += [
            msg(f"package {arg(package.name)} was half installed, repaired") for package in half_installed
        ]
        self.outcome.changes += [msg(f"file {arg(path)}") for path in files]
        if check:
            self._forecast(missing, ready=not files and not half_installed)
        elif half_installed or files or missing or self._stale:
            self._converge(half_installed, before)
        self._verify(before, check=check)
        return self.outcome

    def list_changes(self) -> list[str]:
        """List what a failed run has changed nevertheless."""
        if self._before is None:
            return []
        packages = [
            msg(f"package {arg(name)} {arg(package.version)} ({arg(package.state)})")
            for name, package in list_installed(self.apt).items()
            if self._before.get(name) != package
        ]
        return [*(msg(f"file {arg(path)}") for path in self.sources.was), *packages]

    @property
    def _stale(self) -> bool:
        """Whether apt's lists must be updated although no package is missing; never with a bundle."""
        return self.apt.bundle is None and not self.sources.is_updated

    def _preflight(self) -> None:
        desired_packages = self.desired_packages
        refuse_another_system(
            self.apt, desired_packages.distribution, desired_packages.codename, desired_packages.architectures
        )
        notes = [check_key(key, self.clock()) for key in self.desired_packages.keys]
        self.outcome.notes += [note for note in notes if note is not None]

    def _missing(self, packages: dict[str, InstalledPackage]) -> dict[str, str | None]:
        """Return the desired packages that are not installed in their version; a package on hold is not changed."""
        missing = {}
        for name, version in self.desired_packages.packages.items():
            is_now = packages.get(name)
            if is_now is not None and is_now.is_installed and version_matches(is_now.version, version):
                continue
            if is_now is not None and is_now.is_installed and is_now.is_held:
                raise ModuleError(
                    f"package {arg(name)} is on hold at {arg(is_now.version)}; the inventory has {arg(version)}",
                    f"release it on the computer: `apt-mark unhold {arg(name)}`; or set the version that it has in the "
                    "inventory",
                )
            missing[name] = version
        return missing

    def _forecast(self, missing: Mapping[str, str | None], *, ready: bool) -> None:
        versions: dict[str, str] = {}
        if missing and ready and self.sources.is_updated:
            versions = to_install(self.apt.get("-s", "--yes", *self._install_arguments(missing)).output)
        for name, version in missing.items():
            new = versions.get(name) or version
            self.outcome.changes.append(msg(f"package {arg(name)} {arg(new)}" if new else f"package {arg(name)}"))

    def _converge(self, half_installed: Sequence[InstalledPackage], before: dict[str, InstalledPackage]) -> None:
        wait_for_others(self.apt.tree, self.apt.wait_s)
        self._before = before
        if half_installed:
            self.apt.run("dpkg", "--configure", "-a", "--force-confdef", "--force-confold")
        self.apt.ready()
        self.sources.write()
        missing = self._missing(list_installed(self.apt) if half_installed else before)
        if missing and not self._current_lists_suffice(missing):
            self._check_lists_cost()
            self._update()
        elif self._stale and self.desired_packages.limit_bytes is None:
            self._update()
        if half_installed or missing:
            self._repair(missing)
        if missing:
            self._refuse_unknown(missing)
            self._run_apt(self._install_arguments(missing), list(missing))

    def _current_lists_suffice(self, missing: Mapping[str, str | None]) -> bool:
        """Return whether metered data can be saved: the current lists already offer all missing packages."""
        if self.desired_packages.limit_bytes is None or not self.sources.is_updated:
            return False
        versions = self._available_versions(missing)
        return all(
            any(version_matches(item, version) for item in versions.get(name, ())) for name, version in missing.items()
        )

    def _check_lists_cost(self) -> None:
        limit = self.desired_packages.limit_bytes
        size = max_lists_download(self.apt) if self.apt.bundle is None else 0
        if limit is not None and (size is None or size > limit):
            self.sources.take_back()
            text = "an unknown size, usually 10 to 40 MB" if size is None else msg(f"up to {arg(format_size(size))}")
            raise self._over_limit_error(msg(f"the package lists must be fetched first: {arg(text)}"))

    def _over_limit_error(self, what: str) -> ModuleError:
        why = msg(f" ({arg(self.desired_packages.limit_words)})") if self.desired_packages.limit_words else ""
        return ModuleError(
            f"{arg(what)}; the accepted limit is "
            f"{arg(format_size(self.desired_packages.limit_bytes or 0))}{arg(why)}. Nothing was downloaded for it",
            "run the same command with --accept-cost (ansible-playbook: -e atlantis_accept_cost=true), or bring the "
            "packages: `provision gateway bundle site=…`, then `--offline`",
        )

    def _update(self) -> None:
        """Update apt's lists; remove our sources again if they do not work."""
        self.apt.drop_lists(only_empty=True)
        result = self.apt.update()
        if any(words in result.output for words in _DAMAGED_LISTS):
            self.apt.drop_lists(only_empty=False)
            result = self.apt.update()
        urls = [f"file:{self.apt.bundle}"] if self.apt.bundle is not None else self.sources.urls
        why = explain_update_failure(result.output, result.code, urls, self.apt.architecture)
        if why is not None:
            self.sources.take_back()
            raise why
        self.outcome.notes += other_source_notes(result.output, urls)
        if self.apt.bundle is None:
            self.sources.note()

    def _repair(self, missing: Collection[str]) -> None:
        """Repair what dpkg alone could not: packages that need others, or whose unpacking was interrupted.

        A package of `missing` that cannot be configured may still be replaced by its desired version.
        """
        for package in half_done(self.apt, list_installed(self.apt)):
            if not package.is_damaged:
                continue
            again = [*_INSTALL, "--reinstall", "install", package.name]
            if self.apt.get("-s", "--yes", *again).code == 0:
                self._run_apt(again, [package.name])
            else:
                self.apt.run("dpkg", "--remove", "--force-remove-reinstreq", package.name)
        half_installed = half_done(self.apt, list_installed(self.apt))
        if half_installed or self.apt.get("check").code:
            try:
                self._run_apt([*_INSTALL, "-f", "install"], [])
            except ModuleError:
                if not half_installed or any(package.name not in missing for package in half_installed):
                    raise

    def _refuse_unknown(self, missing: Mapping[str, str | None]) -> None:
        """Raise ModuleError for packages or versions that no source has, with the versions available."""
        versions = self._available_versions(missing)
        without = [name for name in missing if name not in versions]
        if without:
            raise ModuleError(
                f"no configured apt source provides {arg(', '.join(without))}",
                "check the names and the sources: `grep -r ^ /etc/apt/sources.list /etc/apt/sources.list.d`",
            )
        for name, version in missing.items():
            if not any(version_matches(item, version) for item in versions[name]):
                raise ModuleError(
                    f"{arg(name)}: version {arg(version)} is not available; available: "
                    f"{arg(', '.join(dict.fromkeys(versions[name])))}",
                    "set one of these in the inventory, or remove the version from it; a bundle keeps old versions",
                )

    def _available_versions(self, missing: Mapping[str, str | None]) -> dict[str, list[str]]:
        """Return the versions of each package in apt's lists."""
        versions: dict[str, list[str]] = {}
        for line in self.apt.cache("madison", *missing).output.splitlines() if missing else ():
            words = [word.strip() for word in line.split("|")]
            if len(words) > 1:
                versions.setdefault(words[0], []).append(words[1])
        return versions

    def _install_arguments(self, missing: Mapping[str, str | None]) -> list[str]:
        exact = [f"{name}={version}" if version else name for name, version in missing.items()]
        down = ["--allow-downgrades"] if any(missing.values()) or self.desired_packages.keys else []
        return [*_INSTALL, *down, "install", *exact]

    def _run_apt(self, arguments: Sequence[str], names: Sequence[str]) -> None:
        """Run apt after checking its cost; a damaged download is fetched once more."""
        forecast = self.apt.get("-s", "--yes", *arguments)
        if forecast.code:
            raise explain_install_failure(forecast.output, names)
        self._check_install_cost(arguments, to_install(forecast.output))
        result = self.apt.get("--yes", *arguments)
        if result.code and _DAMAGED_ARCHIVE in result.output:
            self.apt.get("clean")
            result = self.apt.get("--yes", *arguments)
        if result.code:
            raise explain_install_failure(result.output, names)

    def _check_install_cost(self, arguments: Sequence[str], packages: dict[str, str]) -> None:
        costs = costs_of(self.apt, arguments, packages)
        limit = self.desired_packages.limit_bytes
        if limit is not None and costs.download > limit:
            raise self._over_limit_error(
                msg(f"{arg(len(packages))} packages of {arg(format_size(costs.download))} would be downloaded")
            )
        refuse_if_full(self.apt, costs)
        self.outcome.download_bytes += costs.download

    def _verify(self, before: dict[str, InstalledPackage], *, check: bool) -> None:
        """Read back the installed packages and raise ModuleError if any is still missing or half installed."""
        after = before if check else list_installed(self.apt)
        if not check:
            still = [*self._missing(after), *(package.name for package in half_done(self.apt, after))]
            if still:
                raise ModuleError(
                    f"apt reported success, but {arg(', '.join(dict.fromkeys(still)))} is not as in the inventory",
                    "`dpkg --audit` and `apt-cache policy` on the computer show what is wrong",
                )
        for name, package in after.items():
            if package.is_installed and (name not in before or before[name] != package):
                change = msg(f"package {arg(name)} {arg(package.version)}")
                if name not in self.desired_packages.packages:
                    self.outcome.also[name] = package.version
                elif change not in self.outcome.changes:
                    self.outcome.changes.append(change)
        names = [name for name in self.desired_packages.packages if name in after and after[name].is_installed]
        self.outcome.versions = {name: after[name].version for name in names}
