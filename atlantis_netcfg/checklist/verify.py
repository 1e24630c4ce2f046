"""Verify that a signed checklist is unchanged.

Every stored byte is covered: the report by its digest and signature, every file by the manifest's SHA-256, the manifest
by its own signature, the records also by their hash chain. Limits: a person who has the computer's key (anybody who can
read its state directory) can write another checklist and sign it; and a checklist whose fingerprint or copy nobody else
has can be removed completely. Against the first, send the report, or the digest that it prints, to somebody else when
it is signed; the second shows as a gap in the history only to those who remember it. Before signing nothing is
guaranteed: the hash chain then detects accidents, but not deliberate rewriting.

Also the last step of signing: report, pages and manifest are written to disk, the manifest last.
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
    SigningError,
    SigningKey,
    SigningTrouble,
    broken_seal,
    check_report,
    content,
    parse_json,
    render_json,
    sign_data,
)
from atlantis_netcfg.checklist.report import Document
from atlantis_netcfg.core.atomic_files import DRAFT
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.runs import os_errors_as, write_atomically

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping
    from pathlib import Path


__all__ = ["SigningTrouble", "verify", "verify_report"]


_PAGE = re.compile(r"[a-z0-9][a-z0-9_-]*\.[a-z0-9]+")


def close_book(folder: Path, document: Document, pages: Mapping[str, bytes], key: SigningKey) -> None:
    """Write everything that is signed. Raises SigningError for an unknown file in the folder, JournalError."""
    wrong = [name for name in pages if not _PAGE.fullmatch(name) or name in {REPORT, MANIFEST, _ledger.FILE}]
    if wrong:
        raise ValueError(msg(f"invalid page names: {arg(wrong)}"))
    _clear(folder, {*pages, REPORT})
    files = {REPORT: render_json(document.model_dump(mode="json")), **pages}
    with os_errors_as("the report", folder):
        for name, data in files.items():
            write_atomically(folder / name, data)
        manifest = _build_manifest(folder, document, list_files(folder))
        write_atomically(folder / MANIFEST, render_json(sign_data(manifest, key)))


def _build_manifest(folder: Path, document: Document, names: list[str]) -> dict[str, object]:
    data = {name: (folder / name).read_bytes() for name in names}
    files = {name: {"sha256": hashlib.sha256(item).hexdigest(), "bytes": len(item)} for name, item in data.items()}
    by = document.signed.by if document.signed is not None else ""
    return {"version": 1, "run": document.run, "site": document.site, "by": by, "files": files}


def list_files(folder: Path) -> list[str]:
    """List everything in a checklist's folder except the manifest, sorted: files, and folders without files."""
    every = [path for path in folder.rglob("*") if path.is_symlink() or not path.is_dir() or not any(path.iterdir())]
    return sorted(name for path in every if (name := path.relative_to(folder).as_posix()) != MANIFEST)


def _clear(folder: Path, local: set[str]) -> None:
    """Remove our own leftovers of an interruption; a file of another origin is neither removed nor signed."""
    records = _ledger.read(folder / _ledger.FILE).records
    results = [record.record.item for record in records if isinstance(record.record, _ledger.RecordedResult)]
    evidence_files = {evidence.file for item in results for evidence in item.evidence if evidence.file}
    for name in list_files(folder):
        path = folder / name
        if name in evidence_files or name == _ledger.FILE:
            continue
        if path.is_dir() and name == _ledger.FOLDER:
            continue  # it is empty
        if name in local or DRAFT.fullmatch(path.name) or _ledger.COPY.fullmatch(name):
            path.unlink()
        else:
            hint = msg(f"remove it from {arg(folder)}, or give it as evidence of an item; then sign")
            raise SigningError(f"`{arg(name)}` in the folder of the checklist does not belong to it", hint=hint)
    empty = folder / _ledger.FOLDER
    if empty.is_dir() and not any(empty.iterdir()):
        empty.rmdir()


_ORIGINAL = "do not rely on it; ask the signer for the original"


def verify(folder: Path, *, key: Path | None = None, required_keys: Collection[str] = ()) -> tuple[SigningTrouble, ...]:
    """List differences from the signed state in the folder of one checklist; empty if there are none.

    `key`: this computer's key, by default the one in the state directory of the folder; `required_keys`: fingerprints,
    one of which must have signed, instead of that key. Raises SigningKeyError.
    """
    path = folder.absolute()
    local = key or (path.parents[3] / KEY if len(path.parents) > 3 else path / KEY)  # noqa: PLR2004 - see `book`
    trusted_keys, is_explicit = _find_trusted_keys(local, required_keys), bool(required_keys)
    troubles = (
        *_manifest(folder, trusted_keys, is_explicit=is_explicit),
        *_report(folder, trusted_keys, is_explicit=is_explicit),
    )
    return tuple(dict.fromkeys((*troubles, *_records(folder))))


def verify_report(data: bytes, *, key: Path, required_keys: Collection[str] = ()) -> tuple[SigningTrouble, ...]:
    """List differences from the signed state in a single `report.json`, as received by mail. Raises SigningKeyError."""
    return tuple(check_report(data, _find_trusted_keys(key, required_keys), is_explicit=bool(required_keys)))


def _find_trusted_keys(key: Path, required_keys: Collection[str]) -> set[str]:
    """Return the required keys if there are any, otherwise the key of this computer."""
    local = SigningKey.load(key) if not required_keys else None
    return {local.fingerprint} if local is not None else set(required_keys)


def _manifest(folder: Path, trusted_keys: Collection[str], *, is_explicit: bool) -> Iterator[SigningTrouble]:
    try:
        data = content(folder / MANIFEST)
    except OSError:
        hint = "the checklist was never signed, or the file was removed; ask the signer for the original"
        yield SigningTrouble(MANIFEST, "is missing: nobody vouches for these files", hint)
        return
    manifest = _read(data)
    if manifest is None:
        yield SigningTrouble(MANIFEST, "is damaged", _ORIGINAL)
        return
    for what, hint in broken_seal(manifest, trusted_keys, is_explicit=is_explicit):
        yield SigningTrouble(MANIFEST, what, hint)
    yield from _files(folder, manifest["files"])


def _read(data: bytes) -> dict[str, Any] | None:
    """Parse the manifest; None if it is invalid, or not in our format."""
    try:
        manifest = parse_json(data)
        files = manifest["files"]
        is_valid = all(isinstance(file["sha256"], str) for file in files.values())
        return manifest if is_valid and render_json(manifest) == data else None
    except (ValueError, TypeError, KeyError, AttributeError):
        return None


def _files(folder: Path, files: dict[str, Any]) -> Iterator[SigningTrouble]:
    there = list_files(folder)
    for name in sorted({*files, *there}):
        if name not in there:
            yield SigningTrouble(name, "is missing", _ORIGINAL)
        elif name not in files:
            yield SigningTrouble(
                name, "was added after the checklist was signed", "it does not belong to the checklist: remove it"
            )
        elif (folder / name).is_symlink() or _hash(folder / name) != files[name]["sha256"]:
            yield SigningTrouble(name, "was changed after the checklist was signed", _ORIGINAL)


def _hash(path: Path) -> str:
    try:
        return hashlib.sha256(content(path)).hexdigest()
    except OSError:
        return ""


def _report(folder: Path, trusted_keys: Collection[str], *, is_explicit: bool) -> Iterator[SigningTrouble]:
    try:
        data = content(folder / REPORT)
    except OSError:
        if not (folder / MANIFEST).exists():
            return  # it was never signed, and that is told
        yield SigningTrouble(REPORT, "is missing", _ORIGINAL)
        return
    yield from check_report(data, trusted_keys, is_explicit=is_explicit)


def _records(folder: Path) -> Iterator[SigningTrouble]:
    """Yield damage of the records, and differences between records and report."""
    lines = _ledger.read(folder / _ledger.FILE)
    if lines.damage or lines.tail_error:
        yield SigningTrouble(_ledger.FILE, lines.damage or lines.tail_error, _ORIGINAL)
        return
    document = _ledger.rebuild_document(lines)
    try:
        items = Document.model_validate(parse_json(content(folder / REPORT))).items
    except (OSError, ValueError):
        return  # that is told
    if document is None or document.items != items:
        yield SigningTrouble(REPORT, "has other results than the records of the checklist", _ORIGINAL)
