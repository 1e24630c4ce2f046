"""Who did what with the VPN, out of the record, which is compared with what it was signed as and what it has made."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, date, datetime
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import NetcfgError, UsageError
from atlantis_netcfg.operations.vpn.records import of_partner, period
from atlantis_netcfg.vpn.authority import NONE_SIGNED, AuthorityDamaged
from atlantis_netcfg.vpn.ledger import LedgerDamaged

if TYPE_CHECKING:
    from atlantis_netcfg.vpn.authority import Agreement, Authority, Entry

__all__ = ["Audit", "audit", "start_of"]


@dataclass(frozen=True, slots=True)
class Audit:
    """Entries that were asked for, and what is wrong with the record."""

    entries: tuple[Entry, ...]
    agreement: Agreement | None
    """None: the ledger is damaged, and none of its entries is told as true."""
    broken: tuple[NetcfgError, ...]

    @property
    def words(self) -> tuple[str, ...]:
        """What was checked and found to agree, and what was not checked."""
        found = self.agreement
        if found is None or found.at is None or self.broken:
            return ()
        later = found.lines - found.signed
        signed = f"the first {found.signed} are as the CA key signed them on {found.at:%Y-%m-%d %H:%M} UTC"
        return (
            f"{found.lines} entries in all: {signed}",
            f"the certificates and revocation list {found.number} agree with them",
            *([f"entries after line {found.signed} are chained to them, and not signed"] if later else []),
            "whether this is the newest copy is not checked here: `provision vpn status` asks the server",
        )


def audit(authority: Authority, since: datetime | None, partner: str | None) -> Audit:
    """Read the record, and compare it. Of a damaged one no entry is told as true."""
    try:
        found = authority.agreement()
        entries = authority.history()
        names = None if partner is None else {member.name for member in of_partner(authority.roll(), partner)}
    except LedgerDamaged as error:
        return Audit((), None, (error,))
    requested = tuple(
        entry
        for entry in entries
        if (since is None or entry.at >= since) and (names is None or names & _concerned(entry.facts()))
    )
    return Audit(
        requested,
        found,
        tuple(AuthorityDamaged(each, hint=_SIGN if each == NONE_SIGNED else _COMPARE) for each in found.problems),
    )


_SIGN = "if nobody is missing in `provision vpn list`: `provision vpn sync --sign` signs it from now on"
_COMPARE = "sign nothing; put the folder of the last backup beside this one, and compare them"


def _concerned(result: object) -> set[str]:
    """Every member that an entry names, whatever its kind: a common name stands for its member."""
    if isinstance(result, dict):
        return {name for value in result.values() for name in _concerned(value)}
    if isinstance(result, list | tuple):
        return {name for value in result for name in _concerned(value)}
    return {result.partition(".")[0]} if isinstance(result, str) else set()


def start_of(since: str) -> datetime:
    """The moment that a day (`2026-11-01`) or a span (`30d`) begins with. Raises UsageError."""
    try:
        day = date.fromisoformat(since) if len(since) == len("2026-11-01") else None
    except ValueError:
        day = None
    if day is not None:
        return datetime(day.year, day.month, day.day, tzinfo=UTC)
    try:
        return datetime.now(UTC) - period(since, "since")
    except UsageError as error:
        raise UsageError(str(error), hint="a day or a span, as in `since=2026-11-01` or `since=30d`") from None
