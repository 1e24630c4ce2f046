"""The last step of a book: report, pages and manifest on disk, the manifest last."""

from __future__ import annotations

import hashlib
import re
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist import _evidence, _ledger
from atlantis_netcfg.checklist._canonical import written
from atlantis_netcfg.checklist._errors import NotSigned
from atlantis_netcfg.checklist._signing import MANIFEST, REPORT, sealed
from atlantis_netcfg.journal import os_errors_as, write_atomically

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from atlantis_netcfg.checklist._key import Key
    from atlantis_netcfg.checklist.report import Document

_SCRATCH = re.compile(r"\..+\.\d+")
"""A file that was being written when the program was killed."""
_PAGE = re.compile(r"[a-z0-9][a-z0-9_-]*\.[a-z0-9]+")


def close_book(folder: Path, document: Document, pages: Mapping[str, bytes], key: Key) -> None:
    """Write everything that is signed. Raises NotSigned for a stranger's file in the folder, JournalFailed."""
    wrong = [name for name in pages if not _PAGE.fullmatch(name) or name in {REPORT, MANIFEST, _ledger.FILE}]
    if wrong:
        raise ValueError(f"no names for pages: {wrong}")
    _clear(folder, {*pages, REPORT})
    files = {REPORT: written(document.model_dump(mode="json")), **pages}
    with os_errors_as("the report", folder):
        for name, data in files.items():
            write_atomically(folder / name, data)
        manifest = _manifest(folder, document, listed(folder))
        write_atomically(folder / MANIFEST, written(sealed(manifest, key)))


def _manifest(folder: Path, document: Document, names: list[str]) -> dict[str, object]:
    data = {name: (folder / name).read_bytes() for name in names}
    files = {name: {"sha256": hashlib.sha256(item).hexdigest(), "bytes": len(item)} for name, item in data.items()}
    by = document.signed.by if document.signed is not None else ""
    return {"version": 1, "run": document.run, "site": document.site, "by": by, "files": files}


def listed(folder: Path) -> list[str]:
    """Everything in a book's folder but the manifest, sorted: files, and folders without a file in them."""
    every = [path for path in folder.rglob("*") if path.is_symlink() or not path.is_dir() or not any(path.iterdir())]
    return sorted(name for path in every if (name := path.relative_to(folder).as_posix()) != MANIFEST)


def _clear(folder: Path, local: set[str]) -> None:
    """Remove what a kill has left of ours; a file that somebody else has put here is not ours to remove or to sign."""
    records = _ledger.read(folder / _ledger.FILE).records
    results = [record.record.item for record in records if isinstance(record.record, _ledger.Result)]
    named = {evidence.file for item in results for evidence in item.evidence if evidence.file}
    for name in listed(folder):
        path = folder / name
        if name in named or name == _ledger.FILE:
            continue
        if path.is_dir() and name == _evidence.FOLDER:
            continue  # it is empty
        if name in local or _SCRATCH.fullmatch(path.name) or _evidence.COPY.fullmatch(name):
            path.unlink()
        else:
            hint = f"take it out of {folder}, or give it as evidence of an item; then sign"
            raise NotSigned(f"`{name}` in the folder of the checklist is not of the checklist", hint=hint)
    empty = folder / _evidence.FOLDER
    if empty.is_dir() and not any(empty.iterdir()):
        empty.rmdir()
