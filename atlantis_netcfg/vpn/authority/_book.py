"""The ledger while it is written to, with what follows from it."""

from __future__ import annotations

import secrets
from datetime import timedelta
from typing import TYPE_CHECKING, Self

from atlantis_netcfg.vpn.authority._errors import ClockBehind
from atlantis_netcfg.vpn.ledger import FILE, Ledger, LedgerState, utc_now
from atlantis_netcfg.vpn.ledger.records import ClockTrusted

if TYPE_CHECKING:
    from collections.abc import Sequence
    from datetime import datetime
    from pathlib import Path

    from atlantis_netcfg.vpn.ledger import Record

__all__ = ["LedgerSession", "new_operation"]

SLACK = timedelta(minutes=2)
"""So far a clock may be set back by a time server: records of that while bear the time of the last one."""


class LedgerSession:
    """Opened by the one who holds the lock. Raises LedgerDamaged, LedgerFailed."""

    def __init__(self, folder: Path, who: str) -> None:
        self._ledger = Ledger(folder / FILE)
        self._who = who
        self.fold = LedgerState(self._ledger.entries)

    @property
    def usable(self) -> bool:
        """Whether it can still be written to."""
        return self._ledger.usable

    @property
    def digests(self) -> Sequence[str]:
        """Hash of each line."""
        return self._ledger.digests

    def now(self) -> datetime:
        """The time for what is recorded and signed: this computer's, and never before the last record."""
        now = utc_now()
        return now if self.fold.last is None else max(now, self.fold.last)

    def check_clock(self, *, trusted: bool) -> None:
        """Raise ClockBehind if the clock stands before the last record; `trusted`: record that it is right."""
        now, last = utc_now(), self.fold.last
        if last is None or now >= last - SLACK:
            return
        if not trusted:
            raise ClockBehind(
                f"this computer's clock says {now:%Y-%m-%d %H:%M} UTC, and the last record of the authority is of "
                f"{last:%Y-%m-%d %H:%M} UTC: what is signed now could be refused, or end too early",
                hint="set the clock, then run the same command again; if the clock is right and was wrong before: "
                "add clock=right",
            )
        self._apply([ClockTrusted(before=last)], new_operation(), now)

    def write(self, records: Sequence[Record], operation: str) -> None:
        """Put records on disk, all or none as far as a disk can. Raises LedgerFailed."""
        self._apply(records, operation, self.now())

    def close(self) -> None:
        """Nothing is pending."""
        self._ledger.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _apply(self, records: Sequence[Record], operation: str, now: datetime) -> None:
        for entry in self._ledger.write(records, self._who, operation, now):
            self.fold.apply(entry)


def new_operation() -> str:
    """What the records of one command have in common."""
    return secrets.token_hex(6)
