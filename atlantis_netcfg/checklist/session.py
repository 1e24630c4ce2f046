"""Storage of one checklist: each result and answer is on disk before anything else happens, until it is signed.

Files:

    <state>/checklist.key                                       this computer's signing key
    <state>/<real|rehearsal>/<site>/checks/lock                 the current user of the site's checklists
    <state>/<real|rehearsal>/<site>/checks/<run>/records.jsonl  one record per line, chained by hash
    <state>/<real|rehearsal>/<site>/checks/<run>/files/…        photos and files, by their hash
    <state>/<real|rehearsal>/<site>/checks/<run>/report.json, report.html, …, manifest.json      once it is signed

A checklist is signed when its manifest exists, which is written last: an interruption leaves an open or a signed one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, Self

from atlantis_netcfg.checklist import _ledger, _opening, _signing, confirmations, report
from atlantis_netcfg.checklist.history import compare_with_green, last_green
from atlantis_netcfg.checklist.verify import close_book
from atlantis_netcfg.core.errors import nearest
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.runs import SiteLock, utc_now

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from datetime import datetime
    from pathlib import Path

    from atlantis_netcfg.checklist.plan import Checklist

_FEW = 8


class ChecklistSession:
    """An open checklist; `Book.open` finds or starts it, `close` (or leaving `with`) releases its lock."""

    def __init__(
        self, folder: Path, checklist: Checklist, lock: SiteLock, words: str, now: Callable[[], datetime]
    ) -> None:
        """Used by `open`, which holds the lock and has written the list to disk."""
        self.folder = folder
        """Folder of the run."""
        self.words = words
        """What happened to an existing checklist: continued, or why not; empty: there was none."""
        self._entries = {entry.item.id: entry for entry in checklist.entries}
        self._signers = checklist.signers
        self._lock = lock
        self._now = now
        self._ledger = _ledger.ChecklistLog(folder / _ledger.FILE, now)
        lines = _ledger.read(folder / _ledger.FILE)
        document = _ledger.rebuild_document(lines)
        assert document is not None, "it was started"  # noqa: S101
        self._document = document
        self._items = {item.id: item for item in self._document.items}
        self._green = last_green(folder.parent, self._document.scope, but=folder.name)

    @classmethod
    def open(  # noqa: PLR0913 - what a book needs to be the right one
        cls,
        folder: Path,
        checklist: Checklist,
        head: _opening.BookHead,
        *,
        now: Callable[[], datetime] = utc_now,
        anew: bool = False,
        command: str = "provision check",
    ) -> Self:
        """Continue the open checklist with the same list, or start one. `folder`: `checks` of the site.

        Raises SiteBusy, naming the current user of the site's checklists; JournalError.
        """
        lock = SiteLock(folder / "lock", msg(f"the checklist of {arg(checklist.site)}"), command)
        lock.__enter__()
        try:
            there = _opening.find_open_book(folder, checklist, head, anew=anew, now=now)
            run = there.folder or _opening.begin(folder, checklist, head, now)
            return cls(run, checklist, lock, there.words, now)
        except BaseException:
            lock.__exit__()
            raise

    @property
    def run(self) -> str:
        """Name of the checklist, sortable by time."""
        return self.folder.name

    @property
    def items(self) -> tuple[report.Item, ...]:
        """Current state of every item, in the list's order."""
        return tuple(self._items.values())

    @property
    def files(self) -> Mapping[str, bytes]:
        """Evidence files of the items, by `Evidence.file`."""
        names = dict.fromkeys(evidence.file for item in self.items for evidence in item.evidence if evidence.file)
        return {name: (self.folder / name).read_bytes() for name in names}

    def item(self, name: str) -> report.Item:
        """Return one item by its id. Raises ChecklistUsageError."""
        if name not in self._items:
            near = nearest(name, self._items)
            hint = msg(
                f"did you mean `{arg(near)}`?"
                if near
                else f"`provision check site={arg(self._document.site)}` lists all ids"
            )
            raise _signing.ChecklistUsageError(f"this checklist has no item `{arg(name)}`", hint=hint)
        return self._items[name]

    def settle(self, item: report.Item) -> report.Item:
        """Record the result of a probe; a second result replaces the first, which stays in the log."""
        evidence = (*item.evidence, *confirmations.earlier_answers(self.item(item.id)))
        return self._record("settled", item.model_copy(update={"open": False, "override": None, "evidence": evidence}))

    def confirm(self, name: str, confirmation: confirmations.Confirmation) -> report.Item:
        """Record a person's answer, with copies of the files. Raises ChecklistUsageError: nothing is written then."""
        item, step = self.item(name), self._entries[name].step
        confirmations.confirm_item(item, confirmation, (), self._now(), step)
        files = _ledger.keep(self.folder, confirmation.files)
        return self._record("confirmed", confirmations.confirm_item(item, confirmation, files, self._now(), step))

    def override(self, name: str, reason: str, by: str) -> report.Item:
        """Record an override. Raises ChecklistUsageError if there is nothing to override."""
        item, people = self.item(name), self._entries[name].step.by
        return self._record("overridden", confirmations.override_item(item, reason, by, self._now(), people))

    def document(self) -> report.Document:
        """Return the checklist in its current state."""
        document = self._document.model_copy(update={"items": self.items})
        return document.model_copy(update={"since_green": compare_with_green(self._green, document)})

    def sign(
        self,
        by: str,
        pages: Callable[[report.Document], Mapping[str, bytes]],
        *,
        leave: Mapping[str, str] | None = None,
    ) -> report.Document:
        """Sign and close the checklist for a person; `pages` builds the files that are signed with it.

        A failed item does not prevent signing: the signature covers that it failed. An open one does: it must be
        settled, overridden, or left open on purpose (`leave`: id to reason), and then the document is not green. An
        item in `leave` that has been settled meanwhile stays settled. Raises SigningError while an item is open,
        ChecklistUsageError, JournalError.
        """
        self._refuse_signed()
        name, left_out = confirmations.clean_name(by), self._find_left_out(leave or {})
        if (wrong := confirmations.refused_person(name, self._signers, "sign this checklist")) is not None:
            raise _signing.ChecklistUsageError(wrong[0], hint=wrong[1])
        at = self._now()
        whole = self.document().model_copy(update={"ended": at})
        whole = whole.model_copy(update={"left_out": (*whole.left_out, *left_out)})
        key = _signing.SigningKey.load_or_create(self.folder.parents[3] / _signing.FILE)
        document = _signing.sign_document(whole, name, at, key)
        close_book(self.folder, document, pages(document), key)
        self._document = document
        self._ledger.close()
        return document

    def close(self) -> None:
        """Release the site's checklists for others; everything is on disk."""
        self._ledger.close()
        self._lock.__exit__()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _find_left_out(self, leave: Mapping[str, str]) -> tuple[report.LeftOut, ...]:
        """Return the items left open on purpose. Raises SigningError if others are open."""
        waiting = {item.id: item for item in self.items if item.open and item.override is None}
        for name in leave:
            self.item(name)
        rest = [name for name in waiting if name not in leave]
        if rest:
            raise _signing.SigningError(
                f"{arg(len(rest))} of {arg(len(self.items))} items are open: {arg(_join_few(rest))}",
                hint="resolve them, override them with a reason, or leave them open on purpose with a reason",
            )
        reasons = {name: confirmations.clean_text(leave[name], "the reason for leaving it open") for name in waiting}
        return tuple(
            report.LeftOut(what=msg(f"{arg(name)}: {arg(waiting[name].title)}"), why=why)
            for name, why in reasons.items()
        )

    def _record(self, how: Literal["settled", "confirmed", "overridden"], item: report.Item) -> report.Item:
        self._refuse_signed()
        self._ledger.write(_ledger.RecordedResult(record=how, item=item))
        self._items[item.id] = item
        return item

    def _refuse_signed(self) -> None:
        if self._document.signed is not None:
            raise _signing.ChecklistUsageError("this checklist is signed: nothing can be added", hint="start a new one")


def _join_few(names: list[str]) -> str:
    return join(", ", names[:_FEW]) + (" …" if len(names) > _FEW else "")
