"""Members and ledger entries for people and programs, and the audit of who did what.

The audit compares the record with its signature, and with the certificates and lists that resulted from it.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import UTC, date, datetime, timedelta
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core import errors
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.vpn import identity
from atlantis_netcfg.vpn.authority.ledger_session import NONE_SIGNED
from atlantis_netcfg.vpn.authority.model import CorruptAuthorityError
from atlantis_netcfg.vpn.ledger import CorruptLedgerError

if TYPE_CHECKING:
    from atlantis_netcfg.vpn.authority.authority import Authority
    from atlantis_netcfg.vpn.authority.check import Agreement
    from atlantis_netcfg.vpn.ledger.file import LedgerEntry

_PERIODS = {"d": 1, "w": 7}


def find(membership: identity.MembershipList, name: str) -> identity.Member:
    """Return the member of that name or common name. Raises UsageError with the nearest name."""
    for member_name in (name, name.partition(".")[0]):
        if member_name in membership.members:
            return membership.members[member_name]
    near = errors.nearest(name, membership.members)
    hint = msg(f"did you mean `name={arg(near)}`?" if near else "`provision vpn list` lists them all")
    raise errors.UsageError(f"the VPN has no member `{arg(ascii(name)[1:-1][:60])}`", hint=hint)


def of_partner(membership: identity.MembershipList, partner: str | None) -> tuple[identity.Member, ...]:
    """Return the members of a partner, or all. Raises UsageError, NoMatchError if there is none."""
    if not membership.members:
        raise errors.NoMatchError("the VPN has no members yet", hint="to add one, see `provision vpn onboard --help`")
    if partner is None:
        return tuple(membership.members.values())
    result = tuple(member for member in membership.members.values() if member.partner == partner)
    if not result:
        partners = sorted({member.partner for member in membership.members.values() if member.partner is not None})
        near = errors.nearest(partner, partners)
        hint = msg(
            f"did you mean `partner={arg(near)}`?"
            if near
            else f"partners with devices: {arg(join(', ', partners) or 'nobody')}"
        )
        raise errors.UsageError(f"no VPN member belongs to partner `{arg(ascii(partner)[1:-1][:60])}`", hint=hint)
    return result


def status_of(member: identity.Member, now: datetime) -> str:
    """Return the status of a member in a few words."""
    if not member.good:
        return "revoked"
    newest, oldest = member.good[-1], member.good[0]
    if newest.not_after <= now:
        return "expired"
    if newest is not oldest:
        return msg(f"renewed, {arg(oldest.common_name)} still in use")
    return "in use" if newest.standing is identity.CertificateStatus.SEEN else "never seen"


def expires(member: identity.Member) -> datetime | None:
    """Return the expiry of the member's newest good certificate; None if it has none."""
    return member.good[-1].not_after if member.good else None


def member_row(member: identity.Member, now: datetime) -> dict[str, Any]:
    """Return a member for programs, with its certificates."""
    return {
        "name": member.name,
        "kind": str(member.kind),
        "partner": member.partner,
        "device": member.device,
        "address": str(member.address),
        "link": str(member.link),
        "vehicle": member.vehicle,
        "standing": status_of(member, now),
        "certificates": [certificate_row(certificate) for certificate in member.certificates],
    }


def certificate_row(certificate: identity.Certificate) -> dict[str, Any]:
    """Return a certificate for programs, without secrets."""
    return {
        "common_name": certificate.common_name,
        "serial": f"{certificate.serial:x}",
        "sha256": certificate.sha256,
        "not_before": _iso(certificate.not_before),
        "not_after": _iso(certificate.not_after),
        "wrap": str(certificate.wrap),
        "key": str(certificate.key),
        "standing": str(certificate.standing),
        "seen": _iso(certificate.seen),
        "revoked": _iso(certificate.revoked),
        "reason": certificate.reason,
    }


def _iso(moment: datetime | None) -> str | None:
    return None if moment is None else moment.astimezone(UTC).isoformat(timespec="seconds")


def when(moment: datetime | None) -> str:
    """Format a time for people, in UTC."""
    return "-" if moment is None else f"{moment.astimezone(UTC):%Y-%m-%d %H:%M}"


def period(text: str, word: str) -> timedelta:
    """Parse a duration such as 30d or 8w. Raises UsageError."""
    match = re.fullmatch(r"([0-9]{1,4})([dw])", text)
    if match is None:
        raise errors.UsageError(
            f"`{arg(word)}={arg(ascii(text)[1:-1][:60])}` is not a time span",
            hint=f"use days or weeks, for example `{arg(word)}=30d`",
        )
    return timedelta(days=int(match[1]) * _PERIODS[match[2]])


@dataclass(frozen=True, slots=True)
class Audit:
    """Requested ledger entries, and problems of the record."""

    entries: tuple[LedgerEntry, ...]
    agreement: Agreement | None
    """None: the ledger is damaged, and none of its entries is reported as true."""
    broken: tuple[errors.NetcfgError, ...]

    @property
    def words(self) -> tuple[str, ...]:
        """What was checked and agrees, and what was not checked."""
        agreement = self.agreement
        if agreement is None or agreement.at is None or self.broken:
            return ()
        later = agreement.lines - agreement.signed_lines
        signature_text = msg(
            f"the first {arg(agreement.signed_lines)} match the signature of the CA key of "
            f"{arg(agreement.at):%Y-%m-%d %H:%M} UTC"
        )
        return (
            msg(f"{arg(agreement.lines)} entries in all: {arg(signature_text)}"),
            msg(f"the certificates and revocation list {arg(agreement.number)} agree with them"),
            *(
                [msg(f"entries after line {arg(agreement.signed_lines)} are chained to them, but not signed")]
                if later
                else []
            ),
            "this command does not check whether this is the newest copy: `provision vpn status` asks the server",
        )


def audit(authority: Authority, since: datetime | None, partner: str | None) -> Audit:
    """Read the ledger entries, and compare the record. If it is damaged, no entry is reported as true."""
    try:
        agreement = authority.agreement()
        entries = authority.history()
        names = None if partner is None else {member.name for member in of_partner(authority.membership(), partner)}
    except CorruptLedgerError as error:
        return Audit((), None, (error,))
    selected_entries = tuple(
        entry
        for entry in entries
        if (since is None or entry.at >= since) and (names is None or names & _affected_members(entry.facts()))
    )
    return Audit(
        selected_entries,
        agreement,
        tuple(
            CorruptAuthorityError(each, hint=_SIGN if each == NONE_SIGNED else _COMPARE) for each in agreement.problems
        ),
    )


_SIGN = "if `provision vpn list` shows every member, `provision vpn sync --sign` signs it from now on"
_COMPARE = "sign nothing; compare this folder with the one in the last backup"


def _affected_members(result: object) -> set[str]:
    """Return every member named in an entry of any kind; a common name stands for its member."""
    if isinstance(result, dict):
        return {name for value in result.values() for name in _affected_members(value)}
    if isinstance(result, list | tuple):
        return {name for value in result for name in _affected_members(value)}
    return {result.partition(".")[0]} if isinstance(result, str) else set()


def start_of(since: str) -> datetime:
    """Return the start of a day (`2026-11-01`) or of a time span until now (`30d`). Raises UsageError."""
    try:
        day = date.fromisoformat(since) if len(since) == len("2026-11-01") else None
    except ValueError:
        day = None
    if day is not None:
        return datetime(day.year, day.month, day.day, tzinfo=UTC)
    try:
        return datetime.now(UTC) - period(since, "since")
    except errors.UsageError as error:
        raise errors.UsageError(
            str(error), hint="use a day or a time span: `since=2026-11-01` or `since=30d`"
        ) from None
