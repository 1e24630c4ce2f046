"""People's answers to checklist items, and the resulting state of the item."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from atlantis_netcfg.checklist import report
from atlantis_netcfg.checklist._ledger import is_picture
from atlantis_netcfg.checklist._signing import ChecklistUsageError
from atlantis_netcfg.checklist.probes import base
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory.model import EvidenceKind

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from datetime import datetime
    from pathlib import Path

    from atlantis_netcfg.checklist._ledger import CopiedFile

OVERRIDABLE = (Verdict.FAIL, Verdict.INCONCLUSIVE, Verdict.ERROR)
"""Verdicts that a person may override; no other verdict needs it."""
SAYABLE: Mapping[Verdict, str] = {
    Verdict.PASS: "confirmed",
    Verdict.WARN: "confirmed-with-reservation",
    Verdict.FAIL: "seen-to-fail",
    Verdict.INCONCLUSIVE: "could-not-tell",
    Verdict.SKIP: "does-not-apply",
}
"""Verdicts that a person can give -> code of the finding; ERROR is for programs."""
_STATEMENTS = {
    Verdict.PASS: "{by} has seen that it is in order",
    Verdict.WARN: "{by} has seen that it works, but",
    Verdict.FAIL: "{by} has seen that it is not in order",
    Verdict.INCONCLUSIVE: "{by} could not tell",
    Verdict.SKIP: "{by} says that it does not apply",
}
_HINTS = {
    Verdict.WARN: "decide whether the test can continue in spite of it",
    Verdict.FAIL: "fix it and answer again, or override it with a reason",
    Verdict.INCONCLUSIVE: "check again when it can be seen, or override it with a reason",
}
_ALWAYS = frozenset({"vpn", "data-reaches-scc", "dds"})
"""Site checks that apply everywhere: they cannot be skipped to make the checklist green."""
_NAME_LENGTH = 100
_TEXT_LENGTH = 2000


@dataclass(frozen=True, slots=True)
class Confirmation:
    """A person's answer to a step."""

    verdict: Verdict
    by: str
    """Name of the person who looked."""
    note: str = ""
    """What was seen; required for every verdict except PASS."""
    files: tuple[Path, ...] = ()
    """Photos, screenshots, exported backups."""
    value: float | None = None
    """The number that an item asks for."""


def refused_person(by: str, people: Sequence[str], what: str) -> tuple[str, str] | None:
    """Return why `by` may not answer, override or sign, and who may; None if allowed. `people` empty: anybody may."""
    if not people or _same(by) in map(_same, people):
        return None
    return msg(f"{arg(by)} may not {arg(what)}: the inventory names others"), msg(
        f"it must be one of: {arg(join(', ', people))}"
    )


def _same(name: str) -> str:
    """Normalise a name: letter case and whitespace are ignored."""
    return " ".join(name.split()).casefold()


def is_photo(path: Path) -> bool:
    """Return whether a file is accepted as a photo."""
    return is_picture(path)


def missing_evidence(request: base.EvidenceRequest, confirmation: Confirmation) -> tuple[str, str] | None:
    """Return the evidence missing from an answer, and what to do; None if complete. PASS and WARN need evidence."""
    value, words, missing = confirmation.value, request.words, False
    if value is not None and request.kind is not EvidenceKind.NUMBER:
        return "this item takes no number", "remove the number"
    if confirmation.verdict not in {Verdict.PASS, Verdict.WARN}:
        return None
    if value is not None and request.outside(value):
        return msg(
            f"{arg(value):g} {arg(request.unit)} does not pass: required is {arg(words)}"
        ), "measure again, or answer FAIL"
    match request.kind:
        case EvidenceKind.NUMBER:
            missing = value is None
        case EvidenceKind.TEXT:
            missing = not confirmation.note.strip()
        case EvidenceKind.PHOTO:
            missing = not any(map(is_photo, confirmation.files))
    return (msg(f"required: {arg(words)}"), _GIVE[request.kind]) if missing else None


_GIVE = {
    EvidenceKind.NUMBER: "read it, and enter it as `value`",
    EvidenceKind.TEXT: "write it in the note",
    EvidenceKind.PHOTO: "give the path of a JPEG or PNG",
}


def clean_text(text: str, what: str, *, most: int = _TEXT_LENGTH) -> str:
    """Return a person's text as one line. Raises ChecklistUsageError if it is empty, too long or not printable."""
    line = " ".join(text.split())
    if not line:
        raise ChecklistUsageError(f"{arg(what)} is missing", hint="it appears in the report in a person's name")
    if len(line) > most or not line.isprintable():
        raise ChecklistUsageError(
            f"{arg(what)} is too long, or contains control characters",
            hint=f"use at most {arg(most)} printable characters",
        )
    return line


def unskippable(item: report.Item) -> tuple[str, str] | None:
    """Return why an item cannot be skipped, and what to do instead; None if it can."""
    if item.endpoint != "site" or item.id.rpartition("/")[2] not in _ALWAYS:
        return None
    hint = "answer what was observed, or INCONCLUSIVE (`unclear`) and override it with a reason"
    return msg(f"`{arg(item.id)}` applies at every site: it cannot be skipped"), hint


def clean_name(name: str) -> str:
    """Return a person's name as printed in the report. Raises ChecklistUsageError."""
    return clean_text(name, "a name", most=_NAME_LENGTH)


def _require_sayable(item: report.Item, verdict: Verdict) -> None:
    """Raise ChecklistUsageError if a person cannot give this verdict for the item."""
    if item.kind is report.ItemKind.AUTOMATIC:
        hint = "have it checked again, or override it with a reason"
        raise ChecklistUsageError(f"`{arg(item.id)}` is checked by the toolkit: a person cannot answer it", hint=hint)
    if verdict not in SAYABLE:
        words = join(", ", SAYABLE)
        raise ChecklistUsageError(
            f"a person cannot give the verdict {arg(verdict)}", hint=f"choose one of: {arg(words)}"
        )
    if verdict is Verdict.SKIP and (wrong := unskippable(item)) is not None:
        raise ChecklistUsageError(wrong[0], hint=wrong[1])


def confirm_item(
    item: report.Item,
    confirmation: Confirmation,
    files: Sequence[CopiedFile],
    at: datetime,
    step: base.Step | None = None,
) -> report.Item:
    """Return the item with a person's answer. Raises ChecklistUsageError if the answer is not allowed.

    `step`: who may answer, and what evidence is required.
    """
    by = clean_name(confirmation.by)
    request = step.evidence if step is not None else base.EvidenceRequest()
    for wrong in (
        refused_person(by, step.by if step is not None else (), "answer"),
        missing_evidence(request, confirmation),
    ):
        if wrong is not None:
            raise ChecklistUsageError(f"`{arg(item.id)}`: {arg(wrong[0])}", hint=wrong[1])
    _require_sayable(item, confirmation.verdict)
    note = (
        clean_text(confirmation.note, msg(f"the reason for {arg(confirmation.verdict)}"))
        if confirmation.note or confirmation.verdict is not Verdict.PASS
        else ""
    )
    if confirmation.value is not None:
        number = f"{confirmation.value:g} {request.unit}"
        note = msg(f"{arg(number)}; {arg(note)}") if note else number
    message = msg(_STATEMENTS[confirmation.verdict].format(by=arg(by)))
    message = msg(f"{arg(message)}: {arg(note)}") if note else message
    mend = _HINTS.get(confirmation.verdict)
    return item.model_copy(
        update={
            "open": False,
            "verdict": confirmation.verdict,
            "message": message,
            "hint": mend,
            "findings": (
                report.ItemFinding(
                    verdict=confirmation.verdict, code=SAYABLE[confirmation.verdict], message=message, hint=mend
                ),
            ),
            "evidence": (
                report.Evidence(
                    type=report.EvidenceType.CONFIRMED,
                    what=item.title,
                    value=note or confirmation.verdict,
                    at=at,
                    by=by,
                ),
                *(
                    [base.declared_evidence("requirement", request.words)]
                    if request.words and item.endpoint == base.ITEMS
                    else []
                ),
                *(_file_evidence(file, by, at) for file in files),
                *earlier_answers(item, PersonAnswer(confirmation.verdict, by, note)),
            ),
            "at": at,
            "seconds": None,
            "override": None,
        }
    )


EARLIER = "earlier answer, replaced"
EARLIER_OVERRIDE = "earlier override, replaced"


class PersonAnswer(NamedTuple):
    """Short form of a person's answer, to compare two answers."""

    verdict: Verdict
    by: str
    note: str


def earlier_answers(item: report.Item, answer: PersonAnswer | None = None) -> tuple[report.Evidence, ...]:
    """Return the earlier answers for an item that gets another result: the report shows both.

    `answer`: the new one; an identical answer replaces nothing.
    """
    evidence_list = [evidence for evidence in item.evidence if evidence.what in {EARLIER, EARLIER_OVERRIDE}]
    before = _answer_of(item)
    if before is not None and before == answer:
        return tuple(evidence_list)
    if (override := item.override) is not None:
        evidence_list.append(
            _earlier_evidence(
                EARLIER_OVERRIDE, msg(f"{arg(item.verdict)}: {arg(override.reason)}"), override.by, override.at
            )
        )
    if before is not None:
        words = msg(f"{arg(before.verdict)}: {arg(before.note)}") if before.note else str(before.verdict)
        evidence_list.append(_earlier_evidence(EARLIER, words, before.by, item.at))
    return tuple(evidence_list)


def _earlier_evidence(what: str, value: str, by: str, at: datetime | None) -> report.Evidence:
    return report.Evidence(type=report.EvidenceType.CONFIRMED, what=what, value=value, at=at, by=by)


def _answer_of(item: report.Item) -> PersonAnswer | None:
    """Return the person's answer that decides an item; None if it is open or was decided by a program."""
    is_answer = not item.open and [finding.code for finding in item.findings] == [SAYABLE.get(item.verdict)]
    first = item.evidence[0] if item.evidence else None
    if not is_answer or first is None or first.type is not report.EvidenceType.CONFIRMED or first.by is None:
        return None
    return PersonAnswer(item.verdict, first.by, "" if first.value == item.verdict else first.value)


def _file_evidence(stored_file: CopiedFile, by: str, at: datetime) -> report.Evidence:
    name = stored_file.file.rpartition("/")[2].partition("-")[2]
    size = msg(f"{arg(stored_file.size)} bytes")
    return report.Evidence(
        type=report.EvidenceType.FILE,
        what=name,
        value=size,
        at=at,
        by=by,
        file=stored_file.file,
        sha256=stored_file.sha256,
    )


def override_item(item: report.Item, reason: str, by: str, at: datetime, people: Sequence[str] = ()) -> report.Item:
    """Return the item with an override. Raises ChecklistUsageError if there is nothing to override.

    `people`: names of those allowed to override; empty: anybody.
    """
    if (wrong := refused_person(by, people, "override it")) is not None:
        raise ChecklistUsageError(f"`{arg(item.id)}`: {arg(wrong[0])}", hint=wrong[1])
    if item.verdict not in OVERRIDABLE:
        hint = msg(f"only {arg(join(', ', OVERRIDABLE))} can be overridden; if the state has changed, answer it again")
        raise ChecklistUsageError(f"`{arg(item.id)}` is {arg(item.verdict)}: there is nothing to override", hint=hint)
    override = report.Override(reason=clean_text(reason, "the reason for the override"), by=clean_name(by), at=at)
    return item.model_copy(update={"override": override, "evidence": _with_override(item, override)})


def _with_override(item: report.Item, override: report.Override) -> tuple[report.Evidence, ...]:
    """Return the item's evidence with the override that is replaced; an identical override replaces nothing."""
    before = item.override
    if before is None or (before.reason, before.by) == (override.reason, override.by):
        return item.evidence
    words = msg(f"{arg(item.verdict)}: {arg(before.reason)}")
    return (*item.evidence, _earlier_evidence(EARLIER_OVERRIDE, words, before.by, before.at))
