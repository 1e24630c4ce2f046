"""The Python packages of this environment against the pins; told also where one that nearly all needs is missing.

Nothing but the standard library is needed here.
"""

from __future__ import annotations

import re
from importlib import metadata
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

LOCK = "requirements/run.txt"
RESTORE = "rm .venv/run.stamp"
"""What to type in the checkout: the next start brings every package to its pin, from the package index."""


def pinned_packages(lock_file: str) -> dict[str, str]:
    """Name and version of each package that this computer gets by a lock file of pip."""
    lines = re.findall(r"^([A-Za-z0-9][^\s=]*)==([^\s;\\]+)[ \t]*(?:;([^\\\n]+))?", lock_file, re.MULTILINE)
    return {name: version for name, version, marker in lines if not marker.strip() or _holds(marker)}


def _holds(marker: str) -> bool:
    """Whether a line is for this computer; it is left out where that cannot be worked out."""
    try:
        from packaging.markers import Marker  # noqa: PLC0415 - it may be what is missing
    except ImportError:
        return False
    return Marker(marker).evaluate()


def installed_version(name: str) -> str | None:
    """The version in this environment; None where the package is missing."""
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def drift(pins: Mapping[str, str], version_of: Callable[[str], str | None] = installed_version) -> list[str]:
    """What is not as pinned, in a few words each."""
    versions = {name: version_of(name) for name in pins}
    return [
        f"{name} is missing" if versions[name] is None else f"{name} is {versions[name]}, pinned is {version}"
        for name, version in pins.items()
        if versions[name] != version
    ]


def drift_of(checkout: Path) -> list[str]:
    """The same for a checkout; nothing where it has no lock file."""
    try:
        text = (checkout / LOCK).read_text(encoding="utf-8")
    except OSError:
        return []
    return drift(pinned_packages(text))


def summarise(wrong: list[str], most: int = 3) -> str:
    """Some of them in words, and how many more there are."""
    more = f"; and {len(wrong) - most} more" if len(wrong) > most else ""
    return f"{'; '.join(wrong[:most])}{more}"
