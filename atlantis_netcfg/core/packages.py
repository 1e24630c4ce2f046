"""Compare installed Python packages with the pinned versions; works without third-party packages.

Only the standard library is used, so that a missing package can be reported.
"""

from __future__ import annotations

import re
from importlib import metadata
from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, msg

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

LOCK = "requirements/run.txt"
RESTORE = "rm .venv/run.stamp"
"""What to type in the checkout: the next start installs every package at its pinned version from the index."""


def pinned_packages(lock_file: str) -> dict[str, str]:
    """Return name and version of each package that a pip lock file installs on this computer."""
    lines = re.findall(r"^([A-Za-z0-9][^\s=]*)==([^\s;\\]+)[ \t]*(?:;([^\\\n]+))?", lock_file, re.MULTILINE)
    return {name: version for name, version, marker in lines if not marker.strip() or _holds(marker)}


def _holds(marker: str) -> bool:
    """Return whether an environment marker applies here; False if it cannot be evaluated."""
    try:
        from packaging.markers import Marker  # noqa: PLC0415 - it may be what is missing
    except ImportError:
        return False
    return Marker(marker).evaluate()


def installed_version(name: str) -> str | None:
    """Return the installed version, or None if the package is missing."""
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def drift(pins: Mapping[str, str], version_of: Callable[[str], str | None] = installed_version) -> list[str]:
    """Describe each package that differs from its pin."""
    versions = {name: version_of(name) for name in pins}
    return [
        msg(
            f"{arg(name)} is missing"
            if versions[name] is None
            else f"{arg(name)} is {arg(versions[name])}, but {arg(version)} is required"
        )
        for name, version in pins.items()
        if versions[name] != version
    ]


def drift_of(checkout: Path) -> list[str]:
    """Describe the drift of a checkout; empty if it has no lock file."""
    try:
        text = (checkout / LOCK).read_text(encoding="utf-8")
    except OSError:
        return []
    return drift(pinned_packages(text))


def summarise(wrong: list[str], most: int = 3) -> str:
    """Join the first few entries, and count the rest."""
    more = msg(f"; and {arg(len(wrong) - most)} more" if len(wrong) > most else "")
    return f"{'; '.join(wrong[:most])}{more}"
