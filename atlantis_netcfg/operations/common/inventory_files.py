"""Files of the inventory that commands write: `guests.yml`, and the `telemetry:` of a vehicle.

What would be written is validated with the whole pilot first, in a copy, and then takes its place at once.
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


def validate_change(root: Path, file: str, text: str | None) -> inventory.Declaration:
    """The pilot as it would be. Raises InventoryInvalid, with the user's own file names; nothing is written."""
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
    """Put the file in its place at once, or remove it. Raises JournalFailed."""
    with runs.os_errors_as("the inventory", root / file):
        put(root / file, text)


def put(path: Path, text: str | None) -> None:
    """Write or remove a file; its mode stays."""
    if text is None:
        path.unlink(missing_ok=True)
        runs.sync_directory(path.parent)
        return
    mode = path.stat().st_mode & 0o777 if path.exists() else _READABLE
    runs.write_atomically(path, text.encode(), mode=mode)
