"""One run, read from its journal."""

from __future__ import annotations

import hashlib
import shlex
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, join
from atlantis_netcfg.runs.files import DamagedStateError
from atlantis_netcfg.runs.log import FILE, Log, read
from atlantis_netcfg.runs.records import (
    SETTLED_STATUSES,
    ActionAcknowledgement,
    ActionConfirmation,
    LayerSent,
    Outcome,
    ProtectionRecord,
    Purpose,
    Releasing,
    RunEnd,
    RunResume,
    RunStart,
    SignRecord,
    StateBackup,
    StateConfirmation,
)

if TYPE_CHECKING:
    from datetime import datetime
    from pathlib import Path

_COMPLETE_STATUSES = frozenset({"unchanged", "changed"})
"""Outcomes of a device that was read back in the expected state."""

_TOUCHING = (SignRecord, ProtectionRecord, LayerSent, Releasing)
"""Records after which something of the run may be open on the device."""


@dataclass(frozen=True, slots=True)
class SavedState:
    """The state of one device before a run, or as read back by it; `text` is export text without secrets."""

    run: str
    at: datetime
    path: Path
    sha256: str

    def text(self) -> str:
        """Read the text. Raises DamagedStateError if the file is missing or differs from what was written."""
        try:
            data = self.path.read_bytes()
        except OSError as error:
            raise self._damage_error(error.strerror or str(error)) from error
        if hashlib.sha256(data).hexdigest() != self.sha256:
            raise self._damage_error("it was changed since")
        return data.decode()

    def _damage_error(self, why: str) -> DamagedStateError:
        return DamagedStateError(
            f"the state saved by run {arg(self.run)} cannot be used: {arg(why)} ({arg(self.path)})",
            hint="use the state of another run: `provision report runs` lists them",
        )


@dataclass(frozen=True, slots=True)
class Run:
    """One run, finished or not."""

    directory: Path
    log: Log

    @classmethod
    def load(cls, directory: Path) -> Run:
        """Read a run's journal; empty if the run was killed right after its directory was created."""
        path = directory / FILE
        return cls(directory, read(path) if path.exists() else Log(()))

    @property
    def id(self) -> str:
        """The run's name, sortable by time."""
        return self.directory.name

    @property
    def start_record(self) -> RunStart | None:
        """The first record; None if the run was killed before it."""
        return next((record for record in self.log.records if isinstance(record, RunStart)), None)

    @property
    def invocations(self) -> dict[str, str]:
        """Commands that started or resumed the run, by invocation; those without an id by site and run."""
        name = f"{self.directory.parent.parent.name}/{self.id}"
        starts = (record for record in self.log.records if isinstance(record, RunStart | RunResume))
        return {record.invocation or name: record.command for record in starts} or {name: ""}

    @property
    def at(self) -> datetime | None:
        """Start time of the run; None if there is no record."""
        return self.log.entries[0].at if self.log.entries else None

    @property
    def exit(self) -> int | None:
        """Exit code of the run; None if it is still active or was killed."""
        ends: int | None = None
        for record in self.log.records:
            if isinstance(record, RunEnd):
                ends = record.exit
            elif isinstance(record, RunResume):
                ends = None
        return ends

    @property
    def outcomes(self) -> dict[str, Outcome]:
        """Final results by device; a device on which a resumed run has continued is omitted."""
        result: dict[str, Outcome] = {}
        for record in self.log.records:
            if isinstance(record, Outcome):
                result[record.device] = record
            elif isinstance(record, _TOUCHING):
                result.pop(record.device, None)
        return result

    @property
    def purpose(self) -> Purpose:
        """Purpose of the run."""
        return self.start_record.purpose if self.start_record is not None else Purpose.CONFIGURE

    @property
    def next_command(self) -> str:
        """Command to continue the run: `resume` for an engine run, else the same command again."""
        if self.start_record is None or self.purpose is Purpose.CONFIGURE:
            words = shlex.split(self.start_record.command) if self.start_record is not None else []
            inventory_words = [shlex.quote(word) for word in words if word.startswith("inventory=")]
            rehearse_option = ["--rehearse"] if self.start_record is not None and self.start_record.rehearsed else []
            resume = f"provision recover resume site={self.directory.parent.parent.name} run={self.id}"
            return " ".join([resume, *inventory_words, *rehearse_option])
        return self.start_record.command

    @property
    def settled_devices(self) -> frozenset[str]:
        """Devices on which the run left nothing open."""
        return frozenset(
            device
            for device, outcome in self.outcomes.items()
            if outcome.status in SETTLED_STATUSES and not outcome.open
        )

    @property
    def unsettled_devices(self) -> tuple[str, ...]:
        """Devices with an unknown outcome or never reached; a backup leaves nothing open."""
        settled_devices = self.settled_devices
        return tuple(host for host in self._changing if host not in settled_devices)

    @property
    def undone(self) -> tuple[str, ...]:
        """Devices that were not read back in the state intended by the run, even if nothing is open on them."""
        settled_devices, outcomes = self.settled_devices, self.outcomes
        return tuple(
            host
            for host in self._changing
            if host not in settled_devices or outcomes[host].status not in _COMPLETE_STATUSES
        )

    @property
    def _changing(self) -> tuple[str, ...]:
        """Devices that the run was to change: none of a backup."""
        return self.start_record.hosts if self.start_record is not None and self.purpose is not Purpose.BACKUP else ()

    def settles(self, earlier: Run) -> frozenset[str]:
        """Return devices on which this run completed an earlier one: same purpose, and read back.

        A refused or rolled-back run completes nothing.
        """
        alike = self.purpose is earlier.purpose
        if not alike and (self.purpose, earlier.purpose) != (Purpose.CONFIGURE, Purpose.ADOPT):
            return frozenset()
        outcomes = self.outcomes
        return frozenset(device for device in self.settled_devices if outcomes[device].status in _COMPLETE_STATUSES)

    def has_sign(self, device: str, sign: str) -> bool:
        """Return True if this run marker on the device belongs to this run."""
        return any(isinstance(record, SignRecord) and record.sign == sign for record in self._records_of(device))

    def before(self, device: str) -> SavedState | None:
        """Return the device's state before the run's first change; None if the run did not get that far."""
        for entry in self.log.entries:
            record = entry.record
            if isinstance(record, StateBackup) and record.device == device:
                return SavedState(self.id, entry.at, self.directory / record.file, record.sha256)
        return None

    @property
    def damage(self) -> str:
        """Description of the damage in its journal; empty if there is none."""
        return str(self.damage_error("")) if self.log.damage else ""

    def damage_error(self, hint: str) -> DamagedStateError:
        """Return the error for a caller that needs records which may be lost."""
        return DamagedStateError(
            f"the journal of run {arg(self.id)} is damaged: {arg(join(', ', self.log.damage))}", hint=hint
        )

    def confirmed_state(self, device: str) -> SavedState | None:
        """Return the device's state read back at the end of the run; None if the run did not get that far."""
        for entry in reversed(self.log.entries):
            record = entry.record
            if isinstance(record, StateConfirmation) and record.device == device:
                site = self.directory.parent.parent
                return SavedState(self.id, entry.at, site / record.file, record.sha256)
        return None

    @property
    def confirmed_devices(self) -> frozenset[str]:
        """Devices whose read-back state was saved by the run."""
        return frozenset(record.device for record in self.log.records if isinstance(record, StateConfirmation))

    def acknowledged_actions(self, device: str) -> tuple[int, ...]:
        """Return the numbers of the actions that the device has acknowledged."""
        records = (record for record in self._records_of(device) if isinstance(record, ActionAcknowledgement))
        return tuple(sorted({number for record in records for number in record.actions}))

    def confirmed_actions(self, device: str) -> tuple[int, ...]:
        """Return the numbers of the actions that were read back and are permanent."""
        records = (record for record in self._records_of(device) if isinstance(record, ActionConfirmation))
        return tuple(sorted({number for record in records for number in record.actions}))

    def _records_of(self, device: str) -> list[object]:
        return [record for record in self.log.records if getattr(record, "device", None) == device]
