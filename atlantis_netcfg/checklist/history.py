"""Earlier checklists of a site and of each vehicle, and the changes since the last green one."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist import _ledger, _signing, report
from atlantis_netcfg.checklist._opening import runs
from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, msg

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path


class VehicleState(StrEnum):
    """State of a stored checklist."""

    OPEN = "open"
    """It can be continued."""
    UNFINISHED = "unfinished"
    """Another checklist was started in its place."""
    SIGNED = "signed"
    DAMAGED = "damaged"
    """Its content is not what was written; `provision report verify` shows where."""


@dataclass(frozen=True, slots=True)
class SavedChecklist:
    """A stored checklist."""

    folder: Path
    state: VehicleState
    document: report.Document | None
    """Document, as far as it can be read."""
    why: str = ""
    """Reason why it is unfinished or damaged."""

    @property
    def run(self) -> str:
        """Name of the checklist, sortable by time."""
        return self.folder.name


def books(folder: Path) -> tuple[SavedChecklist, ...]:
    """Return every checklist of a site (`folder`: its `checks`), newest last."""
    return tuple(checklist for run in runs(folder) if (checklist := _load_checklist(run)) is not None)


def _load_checklist(run: Path) -> SavedChecklist | None:
    if (run / _signing.MANIFEST).exists():
        return _load_signed(run)
    lines = _ledger.read(run / _ledger.FILE)
    document = _ledger.rebuild_document(lines)
    if lines.damage:
        return SavedChecklist(run, VehicleState.DAMAGED, document, f"{_ledger.FILE} {lines.damage}")
    if document is None:
        is_empty = [path.name for path in run.iterdir()] == [_ledger.FILE]  # killed before the first record
        return (
            None if is_empty else SavedChecklist(run, VehicleState.DAMAGED, None, msg(f"{arg(_ledger.FILE)} is empty"))
        )
    reasons = [
        record.record.why for record in lines.records if isinstance(record.record, _ledger.SupersedeResultRecord)
    ]
    return SavedChecklist(
        run, VehicleState.UNFINISHED if reasons else VehicleState.OPEN, document, reasons[-1] if reasons else ""
    )


def _load_signed(run: Path) -> SavedChecklist:
    """Load a signed checklist; its report must match its own digest and signature, whoever's key it is."""
    try:
        data = _signing.content(run / _signing.REPORT)
        key = str((_signing.parse_json(data)["signed"] or {}).get("key"))
        troubles = list(_signing.check_report(data, {key}))
        document = report.Document.model_validate(_signing.parse_json(data))
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        return SavedChecklist(run, VehicleState.DAMAGED, None, msg(f"its {arg(_signing.REPORT)} cannot be read"))
    return SavedChecklist(
        run, VehicleState.DAMAGED if troubles else VehicleState.SIGNED, document, troubles[0].what if troubles else ""
    )


def filter_by_scope(document: report.Document, scope: Mapping[str, tuple[str, ...]]) -> report.Document:
    """Return the document with only the items of a scope."""
    items = tuple(item for item in document.items if _is_in_scope(item, scope))
    return document.model_copy(update={"items": items})


def _is_in_scope(item: report.Item, scope: Mapping[str, tuple[str, ...]]) -> bool:
    have = {"vehicle": item.vehicle, "endpoint": item.endpoint, "phase": str(item.phase)}
    return all(have[name] in choices for name, choices in scope.items())


def last_green(
    folder: Path, scope: Mapping[str, tuple[str, ...]] | None = None, *, but: str = ""
) -> report.Document | None:
    """Return the newest signed checklist whose items in a scope were all checked and green, limited to that scope.

    So a vehicle's last green checklist may be one of the whole site in which another vehicle failed. `but`: a run to
    ignore.
    """
    expected_scope = dict(scope or {})
    for run in reversed(runs(folder)):
        if run.name == but or not (run / _signing.MANIFEST).exists():
            continue
        checklist = _load_signed(run)
        if (
            checklist.state is not VehicleState.SIGNED
            or checklist.document is None
            or not _covers(checklist.document.scope, expected_scope)
        ):
            continue
        document = filter_by_scope(checklist.document, expected_scope)
        if document.exit is ExitCode.DONE:
            return document
    return None


def _covers(wide: Mapping[str, tuple[str, ...]], scope: Mapping[str, tuple[str, ...]]) -> bool:
    return all(name in scope and set(scope[name]) <= set(choices) for name, choices in wide.items())


def compare_with_green(green: report.Document | None, now: report.Document) -> report.SinceGreen | None:
    """Compare a document with the last green one; None if there was none."""
    if green is None:
        return None
    at = green.signed.at if green.signed is not None else green.started
    return report.SinceGreen(run=green.run, at=at, changes=changes(green, now))


def changes(green: report.Document, now: report.Document) -> tuple[report.ItemChange, ...]:
    """Return every changed item: other verdict or reason, override added or removed, new, open, or gone."""
    before = {item.id: item for item in filter_by_scope(green, now.scope).items}
    after = {item.id: item for item in now.items}
    return (*_changed_items(before, after), *_find_removed_items(before, after))


def _changed_items(before: Mapping[str, report.Item], after: Mapping[str, report.Item]) -> Iterator[report.ItemChange]:
    for name, item in after.items():
        old = before.get(name)
        if old is not None and _state(old) == _state(item):
            continue
        message = (
            item.message if item.override is None else msg(f"{arg(item.message)}; overridden by {arg(_override(item))}")
        )
        yield report.ItemChange(
            id=name,
            before=old.verdict if old is not None else None,
            after=item.verdict,
            message=message if old is not None else msg(f"new: {arg(message)}"),
        )


def _state(item: report.Item) -> tuple[object, ...]:
    """Return the values to compare: measured figures always differ, and the reason for a warning is its code."""
    reasons = {finding.code for finding in item.findings if finding.verdict not in {Verdict.PASS, Verdict.SKIP}}
    return item.verdict, item.open, item.override is not None, reasons


def _override(item: report.Item) -> str:
    return msg(f"{arg(item.override.by)}: {arg(item.override.reason)}" if item.override is not None else "")


def _find_removed_items(
    before: Mapping[str, report.Item], after: Mapping[str, report.Item]
) -> Iterator[report.ItemChange]:
    for name, item in before.items():
        if name not in after:
            yield report.ItemChange(
                id=name, before=item.verdict, after=None, message=msg(f"no longer checked: {arg(item.title)}")
            )
