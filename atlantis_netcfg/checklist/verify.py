"""Whether a signed checklist is still the one that was signed.

Every byte that is kept is covered: the report by its digest and signature, every file by the manifest's SHA-256, the
manifest by a signature of its own, the records also by their chain. What this cannot do: a person who has the key of
the computer (whoever can read its state directory) can write another checklist and sign that; and a checklist of which
nobody else has the fingerprint or a copy can be removed whole. Against the first, send the report, or the digest that
it prints, to somebody else when it is signed; the second is seen as a gap in the history only by who remembers it.
Before it is signed nobody vouches for anything: the chain finds accidents then, and not who writes it anew.

The last step of a book: report, pages and manifest on disk, the manifest last.
"""

from __future__ import annotations

import hashlib
import re
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.checklist import _ledger
from atlantis_netcfg.checklist._signing import FILE as KEY
from atlantis_netcfg.checklist._signing import (
    MANIFEST,
    REPORT,
    NotSigned,
    SigningKey,
    SigningTrouble,
    broken_seal,
    check_report,
    content,
    parsed,
    sealed,
    written,
)
from atlantis_netcfg.checklist.report import Document
from atlantis_netcfg.core.atomic_files import DRAFT
from atlantis_netcfg.runs import os_errors_as, write_atomically

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping
    from pathlib import Path


__all__ = ["SigningTrouble", "verify", "verify_report"]


"""A file that was being written when the program was killed."""
_PAGE = re.compile(r"[a-z0-9][a-z0-9_-]*\.[a-z0-9]+")


def close_book(folder: Path, document: Document, pages: Mapping[str, bytes], key: SigningKey) -> None:
    """Write everything that is signed. Raises NotSigned for a stranger's file in the folder, JournalFailed."""
    wrong = [name for name in pages if not _PAGE.fullmatch(name) or name in {REPORT, MANIFEST, _ledger.FILE}]
    if wrong:
        raise ValueError(f"no names for pages: {wrong}")
    _clear(folder, {*pages, REPORT})
    files = {REPORT: written(document.model_dump(mode="json")), **pages}
    with os_errors_as("the report", folder):
        for name, data in files.items():
            write_atomically(folder / name, data)
        manifest = _contents(folder, document, listed(folder))
        write_atomically(folder / MANIFEST, written(sealed(manifest, key)))


def _contents(folder: Path, document: Document, names: list[str]) -> dict[str, object]:
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
    results = [record.record.item for record in records if isinstance(record.record, _ledger.RecordedResult)]
    named = {evidence.file for item in results for evidence in item.evidence if evidence.file}
    for name in listed(folder):
        path = folder / name
        if name in named or name == _ledger.FILE:
            continue
        if path.is_dir() and name == _ledger.FOLDER:
            continue  # it is empty
        if name in local or DRAFT.fullmatch(path.name) or _ledger.COPY.fullmatch(name):
            path.unlink()
        else:
            hint = f"take it out of {folder}, or give it as evidence of an item; then sign"
            raise NotSigned(f"`{name}` in the folder of the checklist is not of the checklist", hint=hint)
    empty = folder / _ledger.FOLDER
    if empty.is_dir() and not any(empty.iterdir()):
        empty.rmdir()


_ORIGINAL = "do not rely on it; ask whoever signed for the original"


def verify(folder: Path, *, key: Path | None = None, known: Collection[str] = ()) -> tuple[SigningTrouble, ...]:
    """Everything that is not as it was signed, in the folder of one checklist; nothing: it is as it was signed.

    `key`: the key of this computer, else the one of the state directory that the folder is in; `known`: fingerprints of
    which one has to have signed, also in the place of that key. Raises KeyDamaged.
    """
    path = folder.absolute()
    local = key or (path.parents[3] / KEY if len(path.parents) > 3 else path / KEY)  # noqa: PLR2004 - see `book`
    trusted, demanded = _trusted(local, known), bool(known)
    sealed = (*_manifest(folder, trusted, demanded=demanded), *_report(folder, trusted, demanded=demanded))
    return tuple(dict.fromkeys((*sealed, *_records(folder))))


def verify_report(data: bytes, *, key: Path, known: Collection[str] = ()) -> tuple[SigningTrouble, ...]:
    """The same for a `report.json` alone, as it comes by mail: what is not as it was signed. Raises KeyDamaged."""
    return tuple(check_report(data, _trusted(key, known), demanded=bool(known)))


def _trusted(key: Path, known: Collection[str]) -> set[str]:
    """Who names keys asks for one of these, and not for the one of this computer."""
    local = SigningKey.known(key) if not known else None
    return {local.fingerprint} if local is not None else set(known)


def _manifest(folder: Path, trusted: Collection[str], *, demanded: bool) -> Iterator[SigningTrouble]:
    try:
        data = content(folder / MANIFEST)
    except OSError:
        hint = "the checklist was never signed, or the file was removed; ask whoever signed for the original"
        yield SigningTrouble(MANIFEST, "is missing: nobody vouches for what is here", hint)
        return
    manifest = _read(data)
    if manifest is None:
        yield SigningTrouble(MANIFEST, "is damaged", _ORIGINAL)
        return
    for what, hint in broken_seal(manifest, trusted, demanded=demanded):
        yield SigningTrouble(MANIFEST, what, hint)
    yield from _files(folder, manifest["files"])


def _read(data: bytes) -> dict[str, Any] | None:
    """The manifest, if it is one, written as we write it."""
    try:
        manifest = parsed(data)
        files = manifest["files"]
        shaped = all(isinstance(file["sha256"], str) for file in files.values())
        return manifest if shaped and written(manifest) == data else None
    except (ValueError, TypeError, KeyError, AttributeError):
        return None


def _files(folder: Path, files: dict[str, Any]) -> Iterator[SigningTrouble]:
    there = listed(folder)
    for name in sorted({*files, *there}):
        if name not in there:
            yield SigningTrouble(name, "is missing", _ORIGINAL)
        elif name not in files:
            yield SigningTrouble(
                name, "was added after the checklist was signed", "it is not of the checklist: take it out"
            )
        elif (folder / name).is_symlink() or _hash(folder / name) != files[name]["sha256"]:
            yield SigningTrouble(name, "was changed after the checklist was signed", _ORIGINAL)


def _hash(path: Path) -> str:
    try:
        return hashlib.sha256(content(path)).hexdigest()
    except OSError:
        return ""


def _report(folder: Path, trusted: Collection[str], *, demanded: bool) -> Iterator[SigningTrouble]:
    try:
        data = content(folder / REPORT)
    except OSError:
        if not (folder / MANIFEST).exists():
            return  # it was never signed, and that is told
        yield SigningTrouble(REPORT, "is missing", _ORIGINAL)
        return
    yield from check_report(data, trusted, demanded=demanded)


def _records(folder: Path) -> Iterator[SigningTrouble]:
    """The records by themselves, and whether the report says what they say."""
    lines = _ledger.read(folder / _ledger.FILE)
    if lines.damage or lines.torn:
        yield SigningTrouble(_ledger.FILE, lines.damage or lines.torn, _ORIGINAL)
        return
    document = _ledger.replayed(lines)
    try:
        items = Document.model_validate(parsed(content(folder / REPORT))).items
    except (OSError, ValueError):
        return  # that is told
    if document is None or document.items != items:
        yield SigningTrouble(REPORT, "tells other results than the records of the checklist", _ORIGINAL)
