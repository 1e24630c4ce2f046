"""`provision report verify`: whether what was signed is still what was signed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from atlantis_netcfg.cli._arguments import JSON, Command, Word

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from atlantis_netcfg.checklist import Kept, Trouble
    from atlantis_netcfg.checklist.report import Document
    from atlantis_netcfg.cli._arguments import Arguments
    from atlantis_netcfg.core.errors import ExitCode

COMMAND = Command(
    "report verify",
    "verify that signed checklists, with all their files, are as they were signed",
    words=(
        Word("site", "only those of this site", example="coastal"),
        Word("run", "only this one", example="20260504T093000Z"),
        Word("file", "a report.json that came by mail, in place of what is kept here", example="report.json"),
        Word(
            "key",
            "one of these keys must have signed, by fingerprint; this computer's if left out",
            many=True,
            example="SHA256:…",
        ),
    ),
    flags=(JSON,),
    details=(
        "Real and rehearsed checklists alike. Exit code 0: as signed, 6: something is not, and which file it is, 7: "
        "nothing was signed. Compare the fingerprint of a key with whoever signed, never with the file itself."
    ),
)


def run(arguments: Arguments) -> ExitCode:
    """Look at every byte that was signed."""
    import json

    from atlantis_netcfg.core.errors import ExitCode, NothingMatched

    file = arguments.optional("file")
    rows = [_mailed(arguments, file)] if file is not None else list(_kept(arguments))
    if not rows:
        raise NothingMatched("nothing was signed", hint="`provision check site=NAME` ends with a signature")
    code = ExitCode.CHECKS_FAILED if any(row["troubles"] for row in rows) else ExitCode.DONE
    if arguments.flag("json"):
        print(json.dumps({"exit": int(code), "errors": [], "verified": rows}, ensure_ascii=False))
    else:
        print("\n".join(line for row in rows for line in _lines(row)))
    return code


def _kept(arguments: Arguments) -> Iterator[dict[str, Any]]:
    """A row for each that was signed here, real ones first."""
    from atlantis_netcfg.checklist import books, verify
    from atlantis_netcfg.cli._checking import kept
    from atlantis_netcfg.cli._checking.opening import folder_of

    site, name = arguments.optional("site"), arguments.optional("run")
    for where in (kept.store(rehearsed=False), kept.store(rehearsed=True)):
        for at in kept.sites_with(where):
            for book in books(folder_of(where, at)) if site in {None, at} else ():
                if name in {None, book.run} and _was_signed(book):
                    found = verify(book.folder, known=arguments.many("key"))
                    yield _row(f"{at} {book.run}", book.folder, book.document, found)


def _was_signed(item: Kept) -> bool:
    """Or is damaged, or has a signed report without the manifest, which comes last."""
    from atlantis_netcfg.checklist import State

    return item.state in {State.SIGNED, State.DAMAGED} or (item.folder / "report.json").exists()


def _mailed(arguments: Arguments, name: str) -> dict[str, Any]:
    """The row of a report that came alone: it is told by its own name."""
    from dataclasses import replace
    from pathlib import Path

    from atlantis_netcfg.checklist import KEY, verify_report
    from atlantis_netcfg.checklist.report import Document
    from atlantis_netcfg.core import paths
    from atlantis_netcfg.core.errors import UsageError

    path = Path(name)
    try:
        data = path.read_bytes()
    except OSError as error:
        hint = "name a report.json of a checklist"
        raise UsageError(f"`{name}` cannot be read: {error.strerror}", hint=hint) from error
    try:
        document = Document.model_validate_json(data)
    except ValueError:
        document = None
    found = verify_report(data, key=paths.state_dir() / KEY, known=arguments.many("key"))
    return _row(name, path, document, [replace(trouble, file=path.name) for trouble in found])


def _row(name: str, place: Path, document: Document | None, troubles: Sequence[Trouble]) -> dict[str, Any]:
    signed = document.signed if document is not None else None
    return {
        "name": name,
        "place": str(place),
        "site": document.site if document is not None else None,
        "run": document.run if document is not None else None,
        "rehearsed": document.rehearsed if document is not None else None,
        "signed": signed.model_dump(mode="json") if signed is not None else None,
        "troubles": [{"file": trouble.file, "what": trouble.what, "hint": trouble.hint} for trouble in troubles],
    }


def _lines(row: Mapping[str, Any]) -> Iterator[str]:
    from atlantis_netcfg.core import printable

    rehearsed = ", rehearsed" if row["rehearsed"] else ""
    if not row["troubles"]:
        signed = row["signed"]
        yield printable.line(
            f"{row['name']}{rehearsed}: as {signed['by']} signed it at {signed['at']}, key {signed['key']}"
        )
        return
    yield printable.line(f"{row['name']}{rehearsed}: NOT VERIFIED ({row['place']})")
    for item in row["troubles"]:
        yield printable.line(f"  {item['file']}: {item['what']}")
        yield printable.line(f"    -> {item['hint']}")
