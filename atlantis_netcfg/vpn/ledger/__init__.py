"""The authority's append-only ledger.

Each line has its number, a checksum, and the hash of the line before, so a changed, lost or inserted line is detected.
An incomplete last line was being written when the process was killed; the next writer removes it. The list of members
is a pure function of the entries.
"""

from __future__ import annotations

from atlantis_netcfg.vpn.ledger.file import (
    FILE,
    CorruptLedgerError,
    Ledger,
    LedgerEntry,
    LedgerError,
    Reading,
    digest,
    first_lines,
    read,
    utc_now,
)
from atlantis_netcfg.vpn.ledger.records import Record
from atlantis_netcfg.vpn.ledger.state import NEVER_HANDED_OUT, LedgerState, membership

__all__ = [
    "FILE",
    "NEVER_HANDED_OUT",
    "CorruptLedgerError",
    "Ledger",
    "LedgerEntry",
    "LedgerError",
    "LedgerState",
    "Reading",
    "Record",
    "digest",
    "first_lines",
    "membership",
    "read",
    "utc_now",
]
