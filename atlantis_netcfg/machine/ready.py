"""Tells whether machines can be run on this computer."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from atlantis_netcfg.machine._programs import asked

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["OFF", "why_not"]

OFF = "ATLANTIS_NO_MACHINES"
"""The variable of the environment that forbids machines, whatever its value is."""
_PROGRAMS = {
    "mmdebstrap": "mmdebstrap",
    "systemd-nspawn": "systemd-container",
    "ip": "iproute2",
    "nsenter": "util-linux",
    "setpriv": "util-linux",
    "unshare": "util-linux",
    "mount": "mount",
}
"""Program and the Debian package that brings it."""
_KEYRING = Path("/usr/share/keyrings/debian-archive-keyring.gpg")


def why_not(environ: Mapping[str, str] | None = None) -> str | None:
    """Why no machine can be run here, in a few words; None where machines run."""
    if (os.environ if environ is None else environ).get(OFF) is not None:
        return f"{OFF} is set"
    if sys.platform != "linux":
        return "not Linux"
    if os.geteuid() != 0:
        return "not root"
    return _missing() or _forbidden()


def _missing() -> str | None:
    packages = {package for name, package in _PROGRAMS.items() if shutil.which(name) is None}
    if not _KEYRING.exists():
        packages.add("debian-archive-keyring")
    return f"missing: apt install {' '.join(sorted(packages))}" if packages else None


def _forbidden() -> str | None:
    """What a computer that is itself a container may not do."""
    if not _overlays():
        return "the kernel has no overlay file system"
    if asked(("unshare", "--net", "--mount", "--pid", "--fork", "true")).returncode:
        return "this computer may not make namespaces"
    return None


def _overlays() -> bool:
    known = Path("/proc/filesystems").read_text(encoding="ascii").split()
    return "overlay" in known or (
        shutil.which("modprobe") is not None and not asked(("modprobe", "overlay")).returncode
    )
