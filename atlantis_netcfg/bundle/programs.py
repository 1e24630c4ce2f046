"""Programs of this computer that bundles are made with."""

from __future__ import annotations

import os
import shutil
import subprocess
from typing import TYPE_CHECKING

from atlantis_netcfg.bundle._errors import BundleRefused

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

__all__ = ["program", "require", "run"]

_PACKAGES = {
    "apt-get": "apt",
    "apt-config": "apt",
    "dpkg-deb": "dpkg",
    "git": "git",
    "gpg": "gpg gpg-agent",
    "gpgconf": "gpgconf",
    "gpgv": "gpgv",
    "ssh": "openssh-client",
}
_MAKERS = ("apt-get", "apt-config", "dpkg-deb", "git", "gpg", "gpgv")


def program(name: str) -> str:
    """The path of a program. Raises BundleRefused where it is not installed."""
    found = shutil.which(name)
    if found is None:
        raise BundleRefused(f"`{name}` is not installed on this computer", hint=f"sudo apt install {_PACKAGES[name]}")
    return found


def require() -> None:
    """Hold that what makes a bundle is there, before anything is unpacked or fetched. Raises BundleRefused with all."""
    missing = [name for name in _MAKERS if shutil.which(name) is None]
    if missing:
        listed, verb = " and ".join(f"`{name}`" for name in missing), "is" if len(missing) == 1 else "are"
        packages = " ".join(dict.fromkeys(_PACKAGES[name] for name in missing))
        raise BundleRefused(f"{listed} {verb} not installed on this computer", hint=f"sudo apt install {packages}")


def run(
    command: Sequence[str], environment: Mapping[str, str] | None = None, stdin: bytes | None = None
) -> subprocess.CompletedProcess[bytes]:
    """Run a program whose words are the same in every language; its exit code is the caller's to judge."""
    return subprocess.run(  # noqa: S603 - a program of the system, and arguments that are ours
        [program(command[0]), *command[1:]],
        input=stdin if stdin is not None else b"",
        capture_output=True,
        check=False,
        env={**os.environ, "LC_ALL": "C.UTF-8", **(environment or {})},
    )
