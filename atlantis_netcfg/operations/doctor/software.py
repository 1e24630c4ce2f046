"""Required software and its versions: Python, the pinned packages, the system and its programs.

A package counts as correct if its metadata in `.venv` names the pinned version; its files are not checked for changes.
"""

from __future__ import annotations

import os
import platform
import re
import shutil
import subprocess
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.computers.bundle import manifest
from atlantis_netcfg.computers.image import ext4
from atlantis_netcfg.core import packages, processes
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.emulator import lab
from atlantis_netcfg.operations.doctor.items import DoctorItem, DoctorSection

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

_MINIMUM_PYTHON = (3, 11)
"""Must match `requires-python` in pyproject.toml (checked by a test)."""
_PATIENCE_S = 5.0
_TESTED_RELEASES = {"debian": (12,), "ubuntu": (24, 4)}
"""Oldest release of each operating system that the first-run page names."""


def _item(name: str, verdict: Verdict, observation: str, hint: str = "", commands: Sequence[str] = ()) -> DoctorItem:
    return DoctorItem(DoctorSection.SOFTWARE, name, verdict, observation, hint, tuple(commands))


def judge_python(version: str) -> DoctorItem:
    """Judge whether this Python is new enough."""
    if tuple(map(int, re.findall(r"\d+", version)[:2])) < _MINIMUM_PYTHON:
        return _item(
            "Python",
            Verdict.FAIL,
            msg(f"{arg(version)}; {arg('.'.join(map(str, _MINIMUM_PYTHON)))} or newer is required"),
            commands=["sudo apt-get install -y python3-venv"],
        )
    return _item("Python", Verdict.PASS, version)


def judge_packages(pins: Mapping[str, str], get_version: Callable[[str], str | None]) -> DoctorItem:
    """Judge whether `.venv` still has the pinned packages: someone may have installed or removed some since."""
    wrong = packages.drift(pins, get_version)
    if not wrong:
        return _item(
            "packages",
            Verdict.PASS,
            msg(f"{arg(len(pins))} match the pinned versions; ansible-core {arg(pins.get('ansible-core'))}"),
        )
    return _item(
        "packages",
        Verdict.FAIL,
        packages.summarise(wrong),
        "the next start reinstalls them from the package index, after:",
        [packages.RESTORE],
    )


def judge_system(os_release: str) -> DoctorItem:
    """Judge the system: the toolkit is tested on Debian and Ubuntu alone."""
    properties = dict(re.findall(r'^([A-Z_]+)="?([^"\n]*)"?$', os_release, re.MULTILINE))
    title, name = properties.get("PRETTY_NAME", "unknown"), properties.get("ID", "")
    version = tuple(map(int, re.findall(r"\d+", properties.get("VERSION_ID", ""))))
    if name not in _TESTED_RELEASES or not version:
        return _item(
            "system", Verdict.WARN, msg(f"{arg(title)}: not tested; tested are Debian 12, Ubuntu 24.04 and newer")
        )
    if version < _TESTED_RELEASES[name]:
        return _item("system", Verdict.WARN, msg(f"{arg(title)}: older than the systems this version was tested on"))
    return _item("system", Verdict.PASS, title)


@dataclass(frozen=True, slots=True)
class ProgramRequirement:
    """Programs of the system, and who needs them."""

    name: str
    packages: Mapping[str, str]
    """Debian package by program."""
    purpose: str
    is_required: bool = False
    """Whether no work on the site is possible without them; otherwise only their purpose fails."""


def program_needs(*, computers: bool) -> tuple[ProgramRequirement, ...]:
    """Return the required programs; `computers`: the inventory has gateways or a VPN server, which need OpenSSH."""
    return (
        ProgramRequirement(
            "network tools", {"ip": "iproute2"}, "reading this laptop's network settings", is_required=True
        ),
        ProgramRequirement("OpenSSH", {"ssh": "openssh-client"}, "gateways and the VPN server", is_required=computers),
        ProgramRequirement("ping", {"ping": "iputils-ping"}, "checklist items tested from this laptop"),
        ProgramRequirement(
            "for the VPN", {"openvpn": "openvpn"}, "reaching the sites through the VPN from this laptop"
        ),
        ProgramRequirement("for card images", ext4.PROGRAMS, "gateway card images"),
        ProgramRequirement("for bundles", manifest.MAKERS, "bundles for gateways without internet"),
    )


def judge_programs(
    need: ProgramRequirement, has_program: Callable[[str], bool], versions: Mapping[str, str]
) -> DoctorItem:
    """Judge missing programs: an error only if the site needs them; `versions` are those of Debian packages."""
    missing = [program for program in need.packages if not has_program(program)]
    if not missing:
        names = dict.fromkeys(word for package in need.packages.values() for word in package.split())
        package_versions = [f"{name} {versions[name]}" for name in names if name in versions]
        return _item(need.name, Verdict.PASS, join(", ", package_versions or need.packages))
    commands = [f"sudo apt install {' '.join(dict.fromkeys(need.packages[program] for program in missing))}"]
    programs = join(", ", missing)
    if need.is_required:
        return _item(
            need.name,
            Verdict.FAIL,
            msg(f"missing: {arg(programs)}; required for {arg(need.purpose)}"),
            commands=commands,
        )
    return _item(
        need.name,
        Verdict.SKIP,
        msg(f"missing: {arg(programs)}; required only for {arg(need.purpose)}"),
        commands=commands,
    )


def debian_versions(packages: Iterable[str]) -> dict[str, str]:
    """Return the versions of installed Debian packages; empty without dpkg."""
    words = ["dpkg-query", "--show", "--showformat=${Package}\t${Version}\n", *packages]
    if shutil.which(words[0]) is None:
        return {}
    try:
        process = subprocess.run(  # noqa: S603 - our own words
            words, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=_PATIENCE_S, check=False
        )
    except (OSError, subprocess.TimeoutExpired):
        return {}
    rows = (line.partition("\t") for line in process.stdout.splitlines())
    return {name: version for name, _, version in rows if version}


def is_installed(program: str) -> bool:
    """Return whether a program is installed, including Debian's directories outside an ordinary user's PATH."""
    return shutil.which(program, path=processes.program_path()) is not None


def judge_emulation(*, root: bool, missing: Sequence[str], off: bool) -> DoctorItem:
    """Report what rehearsals can emulate here; whether the kernel runs real systems is tested by the rehearsal."""
    name = msg("rehearsals")
    if off:
        return _item(name, Verdict.SKIP, msg(f"routers only: {arg(lab.OFF)} is set"))
    if not root:
        return _item(name, Verdict.SKIP, "routers only; gateways are rehearsed as root, with `sudo`")
    if missing:
        debian = " ".join(missing)
        return _item(
            name,
            Verdict.SKIP,
            msg(f"routers only; missing for gateways: {arg(debian)}"),
            commands=[f"sudo apt install {debian}"],
        )
    return _item(name, Verdict.PASS, "routers and gateways: everything required for real systems is installed")


def software_items(root: Path, *, computers: bool) -> Iterator[DoctorItem]:
    """Check the software of this computer; `root` is the checkout."""
    yield judge_python(platform.python_version())
    lock = root / packages.LOCK
    if lock.is_file():
        yield judge_packages(packages.pinned_packages(lock.read_text(encoding="utf-8")), packages.installed_version)
    else:
        yield _item(
            "packages", Verdict.SKIP, "no requirements/run.txt next to the program: it was installed another way"
        )
    yield judge_system(_os_release())
    needs = program_needs(computers=computers)
    versions = debian_versions(
        {word for need in needs for package in need.packages.values() for word in package.split()}
    )
    for need in needs:
        yield judge_programs(need, is_installed, versions)
    yield judge_emulation(root=os.geteuid() == 0, missing=lab.missing_packages(), off=lab.OFF in os.environ)


def _os_release() -> str:
    try:
        return "\n".join(f'{name}="{value}"' for name, value in platform.freedesktop_os_release().items())
    except OSError:
        return ""
