"""Journals, states and pins, kept on disk so that a kill at any moment loses nothing.

    <state>/<real|rehearsal>/pins.json                          certificates and SSH host keys, by device
    <state>/<real|rehearsal>/commands/<invocation>              exit code of a command with runs; empty until it ends
    <state>/<real|rehearsal>/<site>/lock                        the process that works on the site now
    <state>/<real|rehearsal>/<site>/runs/<run>/journal.jsonl    one record per line, each on disk before the next step
    <state>/<real|rehearsal>/<site>/runs/<run>/before/<device>.rsc   the device's state before the run's first change
    <state>/<real|rehearsal>/<site>/archive/<run>/              an older run that is no longer needed, unchanged
    <state>/<real|rehearsal>/<site>/usage.json                  bytes carried by each link, by month
    <state>/real/<site>/sim/<device>.tried                      a PIN was sent, and not seen to be accepted
    <state>/<real|rehearsal>/<site>/confirmed/<device>-<hash>.rsc    a state that runs have read back at their end

Everything is readable by its owner only. No record contains a secret: actions arrive here masked.
"""

from __future__ import annotations

from atlantis_netcfg.core.atomic_files import sync_directory, write_atomically
from atlantis_netcfg.runs.files import (
    DamagedPinsError,
    DamagedStateError,
    JournalError,
    NoSuchRun,
    SiteBusy,
    make_private,
    new_run,
    os_errors_as,
    run_order,
    unwritable,
)
from atlantis_netcfg.runs.log import (
    NOT_RECORDED,
    Journal,
    Log,
    LogEntry,
    NoJournal,
    Recorder,
    StatesOnly,
    conclude,
    mark_unrecorded,
    read,
    utc_now,
)
from atlantis_netcfg.runs.pins import Pins
from atlantis_netcfg.runs.records import (
    SETTLED_STATUSES,
    ActionAcknowledgement,
    ActionConfirmation,
    ContactStep,
    ContactStepDone,
    CostRecord,
    DeviceObservation,
    LayerSent,
    Outcome,
    PackageConfirmation,
    PackageSent,
    PinRecord,
    PlannedAction,
    PlanRecord,
    ProtectionRecord,
    Purpose,
    Rebooting,
    Record,
    ReleaseRecord,
    Releasing,
    RollbackRecord,
    RunEnd,
    RunResume,
    RunStart,
    SignRecord,
    StateBackup,
    StateConfirmation,
    VerificationRecord,
)
from atlantis_netcfg.runs.run import Run, SavedState
from atlantis_netcfg.runs.store import KEPT_RUNS, DeviceHistory, LockHolder, SiteLock, Store, find_unfinished
from atlantis_netcfg.runs.usage import Counters, MonthBytes, Usage

__all__ = [
    "KEPT_RUNS",
    "NOT_RECORDED",
    "SETTLED_STATUSES",
    "ActionAcknowledgement",
    "ActionConfirmation",
    "ContactStep",
    "ContactStepDone",
    "CostRecord",
    "Counters",
    "DamagedPinsError",
    "DamagedStateError",
    "DeviceHistory",
    "DeviceObservation",
    "Journal",
    "JournalError",
    "LayerSent",
    "LockHolder",
    "Log",
    "LogEntry",
    "MonthBytes",
    "NoJournal",
    "NoSuchRun",
    "Outcome",
    "PackageConfirmation",
    "PackageSent",
    "PinRecord",
    "Pins",
    "PlanRecord",
    "PlannedAction",
    "ProtectionRecord",
    "Purpose",
    "Rebooting",
    "Record",
    "Recorder",
    "ReleaseRecord",
    "Releasing",
    "RollbackRecord",
    "Run",
    "RunEnd",
    "RunResume",
    "RunStart",
    "SavedState",
    "SignRecord",
    "SiteBusy",
    "SiteLock",
    "StateBackup",
    "StateConfirmation",
    "StatesOnly",
    "Store",
    "Usage",
    "VerificationRecord",
    "conclude",
    "find_unfinished",
    "make_private",
    "mark_unrecorded",
    "new_run",
    "os_errors_as",
    "read",
    "run_order",
    "sync_directory",
    "unwritable",
    "utc_now",
    "write_atomically",
]
