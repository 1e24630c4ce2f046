"""The answer file: a person's answers to a checklist, written before it runs; accepted completely or not at all.

A file:

    name: A. Technician                 # signs, and answers where `by` is not given
    consents:                           # to actions that need a person's consent; `all:` covers every item not below
      sparus/usbl/ping: in the water, nobody dives near it
    answers:
      stork/rc_rf/failsafe: {verdict: PASS, note: motors stopped after 2 s, files: [failsafe.jpg]}
      mares/items/battery: {verdict: PASS, value: 16.1}
    overrides:                          # used if the item has not passed; not needed if it has
      zarco/wifi: {reason: tested with the cable today}
    leave:                              # left open on purpose when signing; the document is not green then
      mares/usbl: Mares comes tomorrow
    sign: true

File paths are relative to the folder of the answer file. Entries for items that a narrower list leaves out are ignored,
so that the file for a whole site also serves for one of its vehicles.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Self

from pydantic import Field, StrictBool, StrictFloat

from atlantis_netcfg.checklist._ledger import evidence_problem
from atlantis_netcfg.checklist.confirmations import (
    OVERRIDABLE,
    SAYABLE,
    Confirmation,
    missing_evidence,
    refused_person,
    unskippable,
)
from atlantis_netcfg.checklist.report import Item, ItemKind
from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory import Finding, report, yaml_file
from atlantis_netcfg.inventory.model import Model, Text

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

    from atlantis_netcfg.checklist.plan import Checklist
    from atlantis_netcfg.checklist.session import ChecklistSession

ALL = "all"
Words = Annotated[Text, Field(max_length=2000)]
Person = Annotated[Text, Field(max_length=100)]


class _StatedWord(StrEnum):
    """Verdicts that a person can give."""

    PASS = "PASS"  # noqa: S105 - a verdict
    WARN = "WARN"
    FAIL = "FAIL"
    INCONCLUSIVE = "INCONCLUSIVE"
    SKIP = "SKIP"


class _StatedAnswer(Model):
    verdict: _StatedWord
    by: Person | None = None
    note: Words | None = None
    files: tuple[Text, ...] = ()
    value: StrictFloat | None = None


class _OverrideAnswer(Model):
    reason: Words
    by: Person | None = None


class _EvidenceFile(Model):
    name: Person | None = None
    consents: dict[str, Words] = Field(default_factory=dict)
    answers: dict[str, _StatedAnswer] = Field(default_factory=dict)
    overrides: dict[str, _OverrideAnswer] = Field(default_factory=dict)
    leave: dict[str, Words] = Field(default_factory=dict)
    sign: StrictBool = False


class AnswersInvalid(UsageError):
    """The answer file has errors; nothing was written, nobody was prompted."""

    def __init__(self, findings: tuple[Finding, ...]) -> None:
        self.findings = tuple(sorted(set(findings)))
        super().__init__(report(self.findings, "in the answers; nothing was changed"))


@dataclass(frozen=True, slots=True)
class Overriding:
    """A person's acceptance of responsibility for an item that does not pass."""

    reason: str
    by: str


@dataclass(frozen=True, slots=True)
class Answers:
    """A person's answers to one checklist."""

    confirmations: Mapping[str, Confirmation]
    consent_by_item: Mapping[str, str]
    """Active item -> who consents, and to what."""
    overrides: Mapping[str, Overriding]
    leave: Mapping[str, str]
    """Item left open on purpose -> reason."""
    sign_by: str | None
    """Name of the signer; None: nobody signs."""

    @classmethod
    def read(cls, path: Path, checklist: Checklist) -> Self:
        """Read an answer file for a list. Raises UsageError, or AnswersInvalid with all errors of the file."""
        block = yaml_file.read(path, _EvidenceFile, "the answers file")
        answers = cls(*_collect_answers(block.value, checklist, path.parent)) if block.value is not None else None
        findings = (*block.findings, *_CheckAnswer(block, checklist, path.parent, answers).findings())
        if findings or answers is None:
            raise AnswersInvalid(findings)
        return answers

    def consents(self, item: str) -> str | None:
        """Return who consents to an active step, in that person's words; None if nobody does."""
        return self.consent_by_item.get(item)

    def write_down(self, book: ChecklistSession, on_settle: Callable[[Item], None] = lambda _: None) -> tuple[str, ...]:
        """Record answers, then overrides; call `on_settle` for each item. Return the overrides that were not needed.

        Call it after the probes: an override is used only for an item that has not passed.
        """
        for name, confirmation in self.confirmations.items():
            on_settle(book.confirm(name, confirmation))
        needed_overrides = {name for name in self.overrides if book.item(name).verdict in OVERRIDABLE}
        for name, overriding in self.overrides.items():
            if name in needed_overrides:
                on_settle(book.override(name, overriding.reason, overriding.by))
        spare = [name for name in self.overrides if name not in needed_overrides]
        return tuple(
            msg(f"`{arg(name)}` is {arg(book.item(name).verdict)}: the override is not needed") for name in spare
        )


def _collect_answers(
    file: _EvidenceFile, checklist: Checklist, folder: Path
) -> tuple[dict[str, Confirmation], dict[str, str], dict[str, Overriding], dict[str, str], str | None]:
    name = file.name or ""
    items = {entry.item.id: entry.item for entry in checklist.entries}
    values = {
        item: Confirmation(
            Verdict(str(answer.verdict)),
            answer.by or name,
            answer.note or "",
            tuple(folder / each for each in answer.files),
            answer.value,
        )
        for item, answer in file.answers.items()
        if item in items
    }
    consents = {item: msg(f"{arg(name)}: {arg(words)}") for item, words in _collect_consents(file, items).items()}
    overrides = {
        item: Overriding(override.reason, override.by or name)
        for item, override in file.overrides.items()
        if item in items
    }
    leave = {item: why for item, why in file.leave.items() if item in items}
    return values, consents, overrides, leave, name if file.sign else None


def _collect_consents(file: _EvidenceFile, items: Mapping[str, Item]) -> dict[str, str]:
    """Return consents by item; `all` covers every active item that is neither answered nor left open."""
    active = [name for name, item in items.items() if item.kind is ItemKind.ACTIVE and item.open]
    everything = file.consents.get(ALL)
    words = {} if everything is None else dict.fromkeys(active, everything)
    words = {name: row for name, row in words.items() if name not in file.answers and name not in file.leave}
    return words | {name: entry for name, entry in file.consents.items() if name in items}


class _CheckAnswer:
    """Checks of the answer file against the list; valid parts are checked even if others are wrong."""

    def __init__(
        self, block: yaml_file.Block[_EvidenceFile], checklist: Checklist, folder: Path, answers: Answers | None
    ) -> None:
        self._block = block
        self._answers = answers
        self._steps = {entry.item.id: entry.step for entry in checklist.entries}
        self._signers = checklist.signers
        self._keys = block.root.keys
        self._items = {entry.item.id: entry.item for entry in checklist.entries}
        self._beyond = checklist.beyond
        self._folder = folder

    def findings(self) -> Iterator[Finding]:
        for part, fits in _FITS.items():
            for name in self._names(part):
                yield from self._check_item(part, name, fits)
        for name in self._names("answers"):
            yield from self._check_answer(name)
        for name in self._names("overrides"):
            yield from self._check_person(("overrides", name))
        if self._answers is not None:
            yield from self._people(self._answers)
            yield from self._evidence(self._answers)
        yield from self._find_duplicates("leave", ("answers", "consents", "overrides"))
        yield from self._find_duplicates("answers", ("consents",))
        yield from self._require_name()

    def _names(self, part: str) -> list[str]:
        node = self._keys.get(part)
        return list(node.keys) if node is not None else []

    def _check_item(self, part: str, name: str, fits: Callable[[Item], tuple[str, str] | None]) -> Iterator[Finding]:
        if (part == "consents" and name == ALL) or name in self._beyond:
            return
        item = self._items.get(name)
        if item is None:
            hint = yaml_file.suggest(name, self._items, none="the checklist is empty")
            yield self._block.wrong_key((part, name), msg(f"this checklist has no item `{arg(name)}`"), hint)
        elif not item.open:
            yield self._block.wrong_key(
                (part, name), msg(f"`{arg(name)}` does not apply: {arg(item.message)}"), "remove it"
            )
        elif (wrong := fits(item)) is not None:
            yield self._block.wrong_key((part, name), *wrong)

    def _check_answer(self, name: str) -> Iterator[Finding]:
        path = ("answers", name)
        keys = self._block.root.at(*path).keys
        yield from self._check_person(path)
        verdict = keys["verdict"].value if "verdict" in keys else None
        if "note" not in keys and isinstance(verdict, str) and verdict in set(SAYABLE) - {Verdict.PASS}:
            yield self._block.wrong(
                (*path, "verdict"), msg(f"{arg(verdict)} needs a note"), "add `note:` with what was observed"
            )
        item = self._items.get(name)
        if verdict == Verdict.SKIP and item is not None and (wrong := unskippable(item)) is not None:
            yield self._block.wrong((*path, "verdict"), *wrong)
        files = keys["files"].value if "files" in keys else None
        for number, node in enumerate(files if isinstance(files, list) else ()):
            unfit = evidence_problem(self._folder / str(node.value)) if isinstance(node.value, str) else None
            if unfit is not None:
                yield self._block.wrong((*path, "files", number), *unfit)

    def _people(self, answers: Answers) -> Iterator[Finding]:
        """Yield a finding for each named person who may not answer, override or sign."""
        people = [(("answers", item), answer.by, "answer") for item, answer in answers.confirmations.items()]
        people += [(("overrides", item), override.by, "override it") for item, override in answers.overrides.items()]
        for path, by, what in people:
            wrong = refused_person(by, self._steps[path[1]].by, what) if by else None
            if wrong is not None:
                yield self._block.wrong_key(path, *wrong)
        if answers.sign_by is not None:
            wrong = refused_person(answers.sign_by, self._signers, "sign this checklist")
            if answers.sign_by and wrong is not None:
                yield self._block.wrong_key(("sign",), *wrong)

    def _evidence(self, answers: Answers) -> Iterator[Finding]:
        """Yield a finding for required evidence that is missing; files that do not exist are reported elsewhere."""
        for item, answer in answers.confirmations.items():
            there = not any(map(evidence_problem, answer.files))
            wrong = missing_evidence(self._steps[item].evidence, answer) if there else None
            if wrong is not None:
                yield self._block.wrong_key(("answers", item), *wrong)

    def _check_person(self, path: tuple[str, str]) -> Iterator[Finding]:
        node = self._block.root.at(*path)
        if isinstance(node.value, dict) and "by" not in node.keys and "name" not in self._keys:
            yield self._block.wrong_key(
                path, msg(f"`{arg(path[1])}` has no name of a person"), "add `by:` here, or `name:` to the file"
            )

    def _find_duplicates(self, part: str, others: tuple[str, ...]) -> Iterator[Finding]:
        for name in self._names(part):
            for other in others:
                if name in self._names(other):
                    message = msg(f"`{arg(name)}` is also listed under `{arg(other)}`")
                    yield self._block.wrong_key((part, name), message, "remove it from one of them")

    def _require_name(self) -> Iterator[Finding]:
        if "name" in self._keys:
            return
        sign = self._keys.get("sign")
        if sign is not None and sign.value is True:
            yield self._block.wrong(("sign",), "the signature has no name", "add `name:` to the file")
        if self._names("consents"):
            yield self._block.wrong_key(("consents",), "the consent has no name", "add `name:` to the file")


def _answer_problem(item: Item) -> tuple[str, str] | None:
    if item.kind is ItemKind.AUTOMATIC:
        return (
            msg(f"`{arg(item.id)}` is checked by the toolkit: a person cannot answer it"),
            "remove it, or put it under `overrides`",
        )
    return None


def _consent_problem(item: Item) -> tuple[str, str] | None:
    if item.kind is not ItemKind.ACTIVE:
        return (
            msg(f"`{arg(item.id)}` needs no consent"),
            "put it under `answers`" if item.kind is ItemKind.PERSON else "remove it",
        )
    return None


def _no_problem(_item: Item) -> None:
    return None


_FITS: Mapping[str, Callable[[Item], tuple[str, str] | None]] = {
    "consents": _consent_problem,
    "answers": _answer_problem,
    "overrides": _no_problem,
    "leave": _no_problem,
}
