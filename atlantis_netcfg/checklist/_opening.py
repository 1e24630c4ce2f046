"""Find the checklist to continue, or start a new one."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist import _ledger
from atlantis_netcfg.checklist._signing import MANIFEST
from atlantis_netcfg.checklist.report import Document, Drawing
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.runs import make_private, new_run, os_errors_as, run_order, sync_directory

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from atlantis_netcfg.checklist.plan import Checklist

_SAME_DAY = timedelta(hours=18)


@dataclass(frozen=True, slots=True)
class BookHead:
    """Metadata of a checklist document, besides its list and results."""

    is_rehearsal: bool
    tool: str
    """Version of this toolkit."""
    inventory: str
    """Revision of the inventory."""
    drawing: Drawing
    not_rehearsed: tuple[str, ...] = ()
    broken: tuple[str, ...] = ()
    time_zone: str = ""
    """Time zone of the pilot, for times shown to people."""
    run: str = ""
    """Name of a new checklist run, if it is free; empty: named by the time. A continued run keeps its name."""


@dataclass(frozen=True, slots=True)
class FoundBook:
    """The checklist to continue, if there is one."""

    folder: Path | None
    words: str
    """Message about this run, or about the one that is left behind."""


def runs(folder: Path) -> list[Path]:
    """Return the checklist folders of a site, oldest first, including damaged ones; empty folders do not count."""
    if not folder.is_dir():
        return []
    books = (path for path in folder.iterdir() if path.is_dir() and any(path.iterdir()))
    return sorted(books, key=lambda path: run_order(path.name))


def find_open_book(
    folder: Path, checklist: Checklist, head: BookHead, *, anew: bool, now: Callable[[], datetime]
) -> FoundBook:
    """Find the open checklist with the same list; one that no longer fits is closed as unfinished and reported."""
    words = ""
    for run in reversed(runs(folder)):
        lines = _ledger.read(run / _ledger.FILE)
        document = _ledger.rebuild_document(lines)
        if document is None or _is_other_checklist(document, checklist) or _is_closed(run, lines):
            continue
        if lines.damage:
            words = words or msg(f"the checklist {arg(run.name)} is damaged ({arg(lines.damage)})")
            continue
        if why := "a new start was requested" if anew else _other(document, head):
            with _ledger.ChecklistLog(run / _ledger.FILE, now) as ledger:
                ledger.write(_ledger.SupersedeResultRecord(why=why))
            return FoundBook(
                None, msg(f"the checklist {arg(run.name)} stays unfinished, and a new one is started: {arg(why)}")
            )
        _record_reopening(run, document, checklist, head, now)
        tail_note = msg(f"; {arg(lines.tail_error)}, and its content is asked again" if lines.tail_error else "")
        gone_on = msg(
            f"the checklist {arg(run.name)} is continued{arg(tail_note)}{arg(_old(now() - document.started))}"
        )
        return FoundBook(run, msg(f"{arg(words)}; {arg(gone_on)}") if words else gone_on)
    return FoundBook(None, msg(f"{arg(words)}: a new one is started" if words else ""))


def _is_other_checklist(document: Document, checklist: Checklist) -> bool:
    return (document.scope, document.mission) != (checklist.scope.as_dict(), checklist.scope.mission)


def _old(age: timedelta) -> str:
    """Return a warning if the checklist was started on another day, because conditions may have changed."""
    if age < _SAME_DAY:
        return ""
    ago = msg(f"{arg(age.days)} days" if age.days > 1 else "a day")
    return msg(f"; it was started {arg(ago)} ago, and its results stand: `--anew` checks everything again")


def _is_closed(run: Path, lines: _ledger.Lines) -> bool:
    return (run / MANIFEST).exists() or any(
        isinstance(record.record, _ledger.SupersedeResultRecord) for record in lines.records
    )


def _other(document: Document, head: BookHead) -> str:
    """Return why a checklist does not belong to this list; empty if it does."""
    if document.inventory != head.inventory:
        return "the inventory has changed since then"
    if document.tool != head.tool:
        return msg(f"it was started with version {arg(document.tool)} of this toolkit, this is {arg(head.tool)}")
    if (document.rehearsed, document.broken) != (head.is_rehearsal, head.broken):
        return "the deliberate faults are different now"
    return ""


def _record_reopening(
    run: Path, before: Document, checklist: Checklist, head: BookHead, now: Callable[[], datetime]
) -> None:
    document = _document(run.name, before.started, checklist, head)
    same = document.model_copy(update={"items": ()}) == before.model_copy(update={"items": ()})
    same = same and [item.id for item in document.items] == [item.id for item in before.items]
    with _ledger.ChecklistLog(run / _ledger.FILE, now) as ledger:
        ledger.write(_ledger.ReopenedRecord() if same else _ledger.ChecklistBegun(document=document))


def begin(folder: Path, checklist: Checklist, head: BookHead, now: Callable[[], datetime]) -> Path:
    """Write a new checklist to disk and return its folder. Raises JournalError."""
    start = now()
    with os_errors_as("the checklist", folder):
        make_private(folder)
        run = new_run(folder, start, head.run)
        sync_directory(folder)
    with _ledger.ChecklistLog(run / _ledger.FILE, now) as ledger:
        ledger.write(_ledger.ChecklistBegun(document=_document(run.name, start, checklist, head)))
    with os_errors_as("the checklist", run):
        sync_directory(run)
    return run


def _document(run: str, start: datetime, checklist: Checklist, head: BookHead) -> Document:
    return Document(
        run=run,
        site=checklist.site,
        title=checklist.title,
        rehearsed=head.is_rehearsal,
        tool=head.tool,
        inventory=head.inventory,
        started=start,
        ended=None,
        scope=checklist.scope.as_dict(),
        mission=checklist.scope.mission,
        columns=checklist.columns,
        rows=checklist.rows,
        items=tuple(entry.item for entry in checklist.entries),
        left_out=checklist.left_out,
        notes=checklist.notes,
        not_rehearsed=head.not_rehearsed,
        broken=head.broken,
        drawing=head.drawing,
        time_zone=head.time_zone,
    )
