"""How a sitting ends: a signature or none, the pages, and what is told."""

from __future__ import annotations

import json
import shlex
import sys
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist import NotSigned
from atlantis_netcfg.checklist.report import lines
from atlantis_netcfg.cli._checking.desk import Later
from atlantis_netcfg.cli._checking.kept import as_json, pages_in
from atlantis_netcfg.cli._outcome import tell
from atlantis_netcfg.journal import translated, write_atomically

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping

    from atlantis_netcfg.checklist import Answers, Book
    from atlantis_netcfg.checklist.report import Document
    from atlantis_netcfg.cli._arguments import Arguments
    from atlantis_netcfg.cli._checking.desk import Desk
    from atlantis_netcfg.core.errors import ExitCode, NetcfgError

__all__ = ["again", "close", "greet", "note", "signer"]


def again(arguments: Arguments, without: Collection[str] = ("anew",)) -> str:
    """What a person types to go on with the same checklist."""
    words = [f"{name}={','.join(values)}" for name, values in arguments.words.items()]
    kept = {name: value for name, value in arguments.flags.items() if name not in without}
    flags = [part for name, value in kept.items() for part in (f"--{name}", value) if part is not None]
    return shlex.join(["provision", arguments.command.name, *words, *flags])


def greet(prompt: Desk, book: Book) -> None:
    """Say what is settled already, and what is open; and how it is left for another time."""
    items = book.items
    waiting = sum(item.open and item.override is None for item in items)
    if book.words:
        prompt.say(book.words)
    prompt.say(f"{len(items) - waiting} of {len(items)} items are settled, {waiting} are open.")
    prompt.say("Every answer is kept at once. `later` leaves the rest for another time, as Ctrl+C does.")


def note(words: str) -> None:
    """Tell something beside the result."""
    print(f"note: {words}", file=sys.stderr)


def signer(book: Book, answers: Answers | None, typed: str | None, prompt: Desk | None) -> str | None:
    """Who signs; None: nobody, or something is open."""
    if typed is not None:
        return typed
    if answers is not None:
        return answers.sign_by
    if prompt is None or any(item.open and item.override is None for item in book.items):
        return None
    prompt.say(f"\n{lines(book.document())}\n")
    try:
        return prompt.name if prompt.agrees("Nothing is open. Sign it as it stands?") else None
    except Later:
        return None


def close(
    arguments: Arguments, book: Book, by: str | None, leave: Mapping[str, str], *, read: bool = False
) -> ExitCode:
    """Sign if somebody does, write the pages, tell. An open item keeps the signature away, unless it is to be left.

    `read`: whoever is here has just read the lines, so that their end is enough.
    """
    document, errors = _signed(book, by, leave)
    if document.signed is None:
        _draft(book, document)
    if arguments.flag("json"):
        result = [{"message": str(error), "hint": error.hint} for error in errors]
        print(json.dumps({**as_json(document), "errors": result}, ensure_ascii=False))
    else:
        told_again = lines(document).rpartition("\n\n")[2] if read else lines(document)
        print("\n".join([told_again, *_where(arguments, book, document)]))
        tell(errors)
    return document.exit


def _signed(book: Book, by: str | None, leave: Mapping[str, str]) -> tuple[Document, list[NetcfgError]]:
    if by is None:
        return book.document(), []
    try:
        return book.sign(by, lambda document: _pages(document, book), leave=leave), []
    except NotSigned as error:
        return book.document(), [error]


def _draft(book: Book, document: Document) -> None:
    """The pages as they would be, for who wants to look before anybody signs."""
    with translated("the report", book.folder):
        for name, data in _pages(document, book).items():
            write_atomically(book.folder / name, data)


def _where(arguments: Arguments, book: Book, document: Document) -> Iterator[str]:
    yield from pages_in(book.folder)
    if document.signed is None and document.items:
        waiting = sum(item.open and item.override is None for item in document.items)
        yield f"on a terminal, `{again(arguments, _NOT_AT_A_TERMINAL)}` {_next(waiting)}"


_NOT_AT_A_TERMINAL = frozenset({"anew", "answers", "json"})


def _next(waiting: int) -> str:
    if not waiting:
        return "lets a person sign it"
    return f"asks for what is open ({waiting} item{'s' if waiting > 1 else ''}), and lets a person sign it"


def _pages(document: Document, book: Book) -> Mapping[str, bytes]:
    from atlantis_netcfg.checklist.report import pages

    return pages(document, book.files)
