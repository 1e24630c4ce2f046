"""How a run ended on one computer: the shape of a device's result, so that every report can hold it."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from difflib import unified_diff
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core.errors import complete
from atlantis_netcfg.journal import NOT_RECORDED
from atlantis_netcfg.operations.computers._access import key_trouble
from atlantis_netcfg.operations.request import Mode
from atlantis_netcfg.routeros.apply import Status

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.journal import JournalFailed

__all__ = ["ComputerResult"]

_MENU = "roles"
_NO_PAST = "a computer keeps no record of its changes"
_PROTECTION = "files whole or not at all; a firewall without the way in is refused; the network changes under a timer"


@dataclass(slots=True)
class ComputerResult:
    """What its tasks have told so far."""

    name: str
    mode: Mode = Mode.APPLY
    site: str = ""
    changes: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    findings: list[str] = field(default_factory=list)
    """What is not as declared and stopped nothing; no green end."""
    shown: list[str] = field(default_factory=list)
    """Differences of texts, as `diff -u` has them."""
    failure: str | None = None
    hint: str | None = None
    status: Status = Status.UNCHANGED
    seconds: float = 0.0
    recorded: bool = True

    def ok(self, task: str, values: Mapping[str, Any]) -> None:
        """Take what a task has changed: our modules name each change, of any other the task's name is the change."""
        self.notes += [str(note) for note in values.get("notes") or ()]
        self._find([str(finding) for finding in values.get("findings") or ()], values.get("hint"))
        if not values.get("changed"):
            return
        self.changes += [str(change) for change in values.get("changes") or (task,)]
        self.shown += _differences(values.get("diff"))
        if self.status is Status.UNCHANGED:
            self.status = self._changed

    def _find(self, findings: list[str], hint: object) -> None:
        if not findings:
            return
        self.findings += findings
        self.hint = self.hint or (str(hint) if hint else None)
        if self.mode is Mode.DRIFT:
            self.status = Status.DRIFTED

    def failed(self, task: str, values: Mapping[str, Any], status: Status) -> None:
        """Take why a task failed."""
        words = str(values.get("msg") or "no reason was given").strip()
        self.failure = f"{task}: {words}"
        self.hint = str(values["hint"]) if values.get("hint") else None
        self.changes += [str(change) for change in values.get("changes") or ()]
        self.status = status

    def not_reached(self, values: Mapping[str, Any]) -> None:
        """Take why it could not be connected to: it is as it was. Of Ansible's words the reason alone is told."""
        words = str(values.get("msg") or "it does not answer").strip()
        self.hint = str(values["hint"]) if values.get("hint") else None
        if (trouble := key_trouble(self.name, words)) is not None:
            words, self.hint = trouble
        self.failure = f"not reached: {words.rpartition('reached over ssh: ')[2]}"
        self.status = Status.LEFT_AS_FOUND

    def rescued(self) -> None:
        """Forget a failure that the role itself has dealt with."""
        if self.failure is None:
            return
        self.failure, self.hint = None, None
        drifted = self.findings and self.mode is Mode.DRIFT
        self.status = self._changed if self.changes or drifted else Status.UNCHANGED

    def unrecorded(self, failure: JournalFailed) -> None:
        """Take why the result is not in the journal: it is not green then."""
        self.recorded = False
        self.hint = self.hint or failure.hint
        self.notes.append(str(failure))

    @property
    def _changed(self) -> Status:
        return {Mode.PLAN: Status.PLANNED, Mode.DRIFT: Status.DRIFTED}.get(self.mode, Status.CHANGED)

    @property
    def exit(self) -> ExitCode:
        """The exit code of a run that ended so on its only device."""
        found = self.findings and self.status is not Status.PLANNED
        return self.status.exit if self.recorded and not found else self.status.exit.unproved

    @property
    def confirmed(self) -> int:
        """Changes that its tasks have made; of a run that failed none is counted."""
        return 0 if self.mode.reads_only or self.failure is not None else len(self.changes)

    @property
    def message(self) -> str:
        """What stands in the report beside its name."""
        text = "; finding: ".join([self._message, *self.findings])
        return text if self.recorded else f"{text}; {NOT_RECORDED}"

    @property
    def _message(self) -> str:
        count = f"{len(self.changes)} change{'' if len(self.changes) == 1 else 's'}"
        if self.failure is not None:
            return f"{self.failure} (after {count})" if self.changes else self.failure
        if self.status is Status.UNCHANGED:
            return "nothing to change" if self.findings else "as declared, nothing to change"
        if self.mode is Mode.DRIFT:
            differ = len(self.changes) + len(self.findings)
            return f"{differ} things differ" if differ > 1 else "1 thing differs"
        return f"{count} to make" if self.mode is Mode.PLAN else f"{count} made"

    def _comparison(self) -> dict[str, Any]:
        """The changes that a run would make, in the words of drift; whose they are, and since when, none tells."""
        unsaid: dict[str, Any] = {
            "owner": "declared",
            "mark": "",
            "row": "",
            "fields": [],
            "since": "unknown",
            "history": None,
        }
        return {
            "menus": [_MENU],
            "confirmed": None,
            "differences": [
                {**unsaid, "menu": _MENU, "subject": change, "kind": "changed", "why_unknown": _NO_PAST, "counts": True}
                for change in (*self.changes, *self.findings)
            ],
        }

    def as_dict(self) -> dict[str, Any]:
        """As JSON-able data, with every key of a device's result."""
        lines = [*(f"  {change}" for change in self.changes), *self.shown]
        return {
            "status": self.status.value,
            "exit": int(self.exit),
            "message": self.message,
            "hint": self.hint and complete(self.hint, site=self.site, device=self.name),
            "busy": "",
            "planned": len(self.changes),
            "confirmed": self.confirmed,
            "diff": "\n".join(lines),
            "drift": [],
            "comparison": self._comparison() if self.mode is Mode.DRIFT and self.failure is None else None,
            "notes": list(dict.fromkeys(self.notes)),
            "estimate": None,
            "plan_hash": hashlib.sha256("\n".join(lines).encode()).hexdigest(),
            "protection": None,
            "protection_words": _PROTECTION,
            "round_trips": 0,
            "bytes": {"sent": 0, "received": 0},
            "seconds": round(self.seconds, 3),
            "version": None,
            "board": None,
            "changes": list(self.changes),
        }


def _differences(result: object) -> Iterator[str]:
    """What Ansible's `diff` says, one text after another."""
    for item in result if isinstance(result, list) else [result]:
        if not isinstance(item, dict):
            continue
        if "prepared" in item:
            yield str(item["prepared"]).rstrip()
        elif "before" in item or "after" in item:
            before, after = (str(item.get(side) or "").splitlines() for side in ("before", "after"))
            names = (str(item.get("before_header") or "before"), str(item.get("after_header") or "after"))
            yield "\n".join(unified_diff(before, after, *names, lineterm="", n=1))
