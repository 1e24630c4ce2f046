"""Inventory files that commands write: `guests.yml`, and the `telemetry:` of a vehicle.

A change is validated with the whole pilot in a copy first, and then applied atomically.
"""

from __future__ import annotations

import shutil
from dataclasses import replace
from typing import TYPE_CHECKING

from atlantis_netcfg import inventory, runs
from atlantis_netcfg.core import temporary

if TYPE_CHECKING:
    from pathlib import Path

_READABLE = 0o644


def validate_change(root: Path, file: str, text: str | None) -> inventory.Inventory:
    """Return the pilot with the change; raise InventoryInvalid with the user's file names. Nothing is written."""
    with temporary.folder("inventory") as place:
        copy = place / root.name
        shutil.copytree(root, copy)
        put(copy / file, text)
        try:
            return replace(inventory.load(copy), root=root)
        except inventory.InventoryInvalid as error:
            copy_path, real = copy.as_posix(), root.as_posix()
            raise inventory.InventoryInvalid(
                replace(
                    finding,
                    file=finding.file.replace(copy_path, real),
                    message=finding.message.replace(copy_path, real),
                )
                for finding in error.findings
            ) from None


def write(root: Path, file: str, text: str | None) -> None:
    """Replace or remove the file atomically; raise JournalError."""
    with runs.os_errors_as("the inventory", root / file):
        put(root / file, text)


def put(path: Path, text: str | None) -> None:
    """Write or remove a file; an existing file keeps its mode."""
    if text is None:
        path.unlink(missing_ok=True)
        runs.sync_directory(path.parent)
        return
    mode = path.stat().st_mode & 0o777 if path.exists() else _READABLE
    runs.write_atomically(path, text.encode(), mode=mode)
