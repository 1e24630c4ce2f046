"""Tells whether machines can be run on this computer, and installs what they lack."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.lab._programs import asked

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

__all__ = ["OFF", "provide", "why_not"]

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
    "git": "git",
    "gpg": "gnupg",
}
"""Program and the Debian package that brings it; stand-ins are served from repositories and signed."""
_KEYRING = Path("/usr/share/keyrings/debian-archive-keyring.gpg")


def why_not(environ: Mapping[str, str] | None = None) -> str | None:
    """Why no machine can be run here, in a few words; None where machines run."""
    if why := _unwanted(environ):
        return why
    packages = _missing()
    return f"missing: apt install {' '.join(packages)}" if packages else _forbidden()


def provide(tell: Callable[[str], None], environ: Mapping[str, str] | None = None) -> None:
    """Install the packages that machines lack, where this is a Debian and its root asks; else do nothing.

    What cannot be installed `why_not` names afterwards.
    """
    packages = () if _unwanted(environ) else _missing()
    if not packages or shutil.which("apt-get") is None:
        return
    tell(f"installing {' '.join(packages)}")
    quiet = ("env", "DEBIAN_FRONTEND=noninteractive", "apt-get", "-qq", "-o", "DPkg::Lock::Timeout=300")
    install = (*quiet, "install", "-y", "--no-install-recommends", *packages)
    if asked(install).returncode:
        asked((*quiet, "update"))
        asked(install)


def _unwanted(environ: Mapping[str, str] | None) -> str | None:
    if (os.environ if environ is None else environ).get(OFF) is not None:
        return f"{OFF} is set"
    if sys.platform != "linux":
        return "not Linux"
    return "not root" if os.geteuid() != 0 else None


def _missing() -> tuple[str, ...]:
    packages = {package for name, package in _PROGRAMS.items() if shutil.which(name) is None}
    if not _KEYRING.exists():
        packages.add("debian-archive-keyring")
    return tuple(sorted(packages))


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
