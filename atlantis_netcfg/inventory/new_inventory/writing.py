"""Creation of a new inventory folder: all files are written or none, and only if the whole inventory is valid."""

from __future__ import annotations

import shutil
from dataclasses import replace
from typing import TYPE_CHECKING

from atlantis_netcfg.core.atomic_files import draft_of
from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.messages import arg
from atlantis_netcfg.inventory import json_schema
from atlantis_netcfg.inventory.findings import InventoryInvalid
from atlantis_netcfg.inventory.loader import load

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from atlantis_netcfg.inventory.findings import Finding
    from atlantis_netcfg.inventory.inventory import Inventory

README = "README.md"


def refuse_used(folder: Path) -> None:
    """Raise UsageError unless the folder is new or empty and its parent folder exists."""
    another = "name a folder that does not exist yet"
    if folder.is_dir():
        if any(folder.iterdir()):
            raise UsageError(f"{arg(folder)} is not empty, so nothing was written", hint=another)
    elif folder.exists() or folder.is_symlink():
        raise UsageError(f"{arg(folder)} is not a folder", hint=another)
    elif not folder.absolute().parent.is_dir():
        raise UsageError(f"the folder above {arg(folder)} does not exist", hint=f"mkdir -p {arg(folder.parent)}")


def create(folder: Path, files: Mapping[str, str]) -> Inventory:
    """Write the files with their schemas and load them; on UsageError or InventoryInvalid nothing is left behind."""
    refuse_used(folder)
    target = folder.absolute()
    scratch = draft_of(target)
    try:
        scratch.mkdir()
        for name, text in files.items():
            path = scratch / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        json_schema.write(scratch)
        _check(scratch, folder)
        scratch.rename(target)
    except OSError as error:
        reason = error.strerror or str(error)
        raise UsageError(f"{arg(folder)} cannot be written: {arg(reason)}", hint="name another folder") from error
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    return load(folder)


def _check(scratch: Path, folder: Path) -> None:
    """Load the draft; raise InventoryInvalid with findings that name the final folder."""
    try:
        load(scratch)
    except InventoryInvalid as error:
        names = (str(scratch), scratch.name)
        raise InventoryInvalid(_rename_folder(finding, names, str(folder)) for finding in error.findings) from error


def _rename_folder(finding: Finding, names: Sequence[str], folder: str) -> Finding:
    """Replace the draft folder's name in a finding by the final folder's name."""
    for name in names:
        texts = {key: getattr(finding, key).replace(name, folder) for key in ("file", "message", "hint")}
        finding = replace(finding, **texts)
    return finding


def example_files(inventory: Path) -> dict[str, str]:
    """Return the files of the shipped inventory, without hidden ones: those are generated again."""
    return {
        path.relative_to(inventory).as_posix(): path.read_text(encoding="utf-8")
        for path in sorted(inventory.rglob("*"))
        if path.is_file() and not any(part.startswith(".") for part in path.relative_to(inventory).parts)
    }
