"""What ran, what the devices said, what to go on with: kept on disk so that a kill at any moment loses nothing.

    <state>/<real|rehearsal>/pins.json                          certificates and SSH host keys, by device
    <state>/<real|rehearsal>/<site>/lock                        who works on the site now
    <state>/<real|rehearsal>/<site>/runs/<run>/journal.jsonl    one record a line, each on disk before the next step
    <state>/<real|rehearsal>/<site>/runs/<run>/before/<device>.rsc   the device's state before the run's first change
    <state>/<real|rehearsal>/<site>/archive/<run>/              an older run that nothing needs, as it was
    <state>/<real|rehearsal>/<site>/usage.json                  bytes of each bearer, by month
    <state>/real/<site>/sim/<device>.tried                      a PIN was sent, and was not seen to be taken
    <state>/<real|rehearsal>/<site>/confirmed/<device>-<hash>.rsc    a state that runs have read back at their end

Everything is readable by its owner only. No record holds a secret: actions arrive here masked.
"""

from __future__ import annotations

from atlantis_netcfg.core.atomic_files import sync_directory, write_atomically
from atlantis_netcfg.runs.files import (
    JournalFailed,
    NoSuchRun,
    PinsDamaged,
    SiteBusy,
    StateDamaged,
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
    read,
    unrecorded,
    utc_now,
)
from atlantis_netcfg.runs.pins import Pins
from atlantis_netcfg.runs.records import (
    SETTLED,
    ActionsAcknowledged,
    ActionsConfirmed,
    ContactStep,
    ContactStepDone,
    CostCounted,
    DeviceObserved,
    LayerSent,
    Outcome,
    PackagesConfirmed,
    PackageSent,
    Pinned,
    Planned,
    PlannedAction,
    Protected,
    Purpose,
    Rebooting,
    Record,
    Released,
    Releasing,
    RunEnded,
    RunResumed,
    RunStarted,
    Signed,
    StateConfirmed,
    StateSaved,
    Unrolled,
    Verified,
)
from atlantis_netcfg.runs.run import Run, SavedState
from atlantis_netcfg.runs.store import KEPT, DeviceHistory, LockHolder, SiteLock, Store, unfinished
from atlantis_netcfg.runs.usage import Counters, MonthBytes, Usage

__all__ = [
    "KEPT",
    "NOT_RECORDED",
    "SETTLED",
    "ActionsAcknowledged",
    "ActionsConfirmed",
    "ContactStep",
    "ContactStepDone",
    "CostCounted",
    "Counters",
    "DeviceHistory",
    "DeviceObserved",
    "Journal",
    "JournalFailed",
    "LayerSent",
    "LockHolder",
    "Log",
    "LogEntry",
    "MonthBytes",
    "NoJournal",
    "NoSuchRun",
    "Outcome",
    "PackageSent",
    "PackagesConfirmed",
    "Pinned",
    "Pins",
    "PinsDamaged",
    "Planned",
    "PlannedAction",
    "Protected",
    "Purpose",
    "Rebooting",
    "Record",
    "Recorder",
    "Released",
    "Releasing",
    "Run",
    "RunEnded",
    "RunResumed",
    "RunStarted",
    "SavedState",
    "Signed",
    "SiteBusy",
    "SiteLock",
    "StateConfirmed",
    "StateDamaged",
    "StateSaved",
    "StatesOnly",
    "Store",
    "Unrolled",
    "Usage",
    "Verified",
    "conclude",
    "make_private",
    "new_run",
    "os_errors_as",
    "read",
    "run_order",
    "sync_directory",
    "unfinished",
    "unrecorded",
    "unwritable",
    "utc_now",
    "write_atomically",
]
