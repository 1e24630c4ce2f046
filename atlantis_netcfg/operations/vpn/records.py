"""Members and entries of the record as rows: for lists that people read, and for programs."""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core.errors import NothingMatched, UsageError
from atlantis_netcfg.core.suggest import nearest
from atlantis_netcfg.vpn.identity import CertificateStatus

if TYPE_CHECKING:
    from atlantis_netcfg.vpn.identity import Certificate, Member, MembershipList

__all__ = ["certificate_row", "expires", "find", "member_row", "of_partner", "period", "status_of", "when"]

_PERIODS = {"d": 1, "w": 7}


def find(roll: MembershipList, name: str) -> Member:
    """The member of that name; a common name stands for its member. Raises UsageError with the near miss."""
    for typed in (name, name.partition(".")[0]):
        if typed in roll.members:
            return roll.members[typed]
    near = nearest(name, roll.members)
    hint = f"did you mean `name={near}`?" if near else "`provision vpn list` names them all"
    raise UsageError(f"there is no member `{ascii(name)[1:-1][:60]}` in the VPN", hint=hint)


def of_partner(roll: MembershipList, partner: str | None) -> tuple[Member, ...]:
    """The members of a partner, or all. Raises UsageError, NothingMatched if there is none."""
    if not roll.members:
        raise NothingMatched(
            "nobody is in the VPN yet", hint="`provision vpn onboard --help` says how somebody is let in"
        )
    if partner is None:
        return tuple(roll.members.values())
    found = tuple(member for member in roll.members.values() if member.partner == partner)
    if not found:
        known = sorted({member.partner for member in roll.members.values() if member.partner is not None})
        near = nearest(partner, known)
        hint = f"did you mean `partner={near}`?" if near else f"there are devices of: {', '.join(known) or 'nobody'}"
        raise UsageError(f"nobody in the VPN is of `{ascii(partner)[1:-1][:60]}`", hint=hint)
    return found


def status_of(member: Member, now: datetime) -> str:
    """How it stands with a member, in a few words."""
    if not member.good:
        return "revoked"
    newest, oldest = member.good[-1], member.good[0]
    if newest.not_after <= now:
        return "expired"
    if newest is not oldest:
        return f"renewed, {oldest.common_name} still in use"
    return "in use" if newest.standing is CertificateStatus.SEEN else "never seen"


def expires(member: Member) -> datetime | None:
    """When the member's newest good certificate ends; None if it has none."""
    return member.good[-1].not_after if member.good else None


def member_row(member: Member, now: datetime) -> dict[str, Any]:
    """A member for programs, with its certificates."""
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


def certificate_row(certificate: Certificate) -> dict[str, Any]:
    """A certificate for programs; nothing of it is secret."""
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
    """A moment for people, in UTC."""
    return "-" if moment is None else f"{moment.astimezone(UTC):%Y-%m-%d %H:%M}"


def period(text: str, word: str) -> timedelta:
    """A span such as 30d or 8w. Raises UsageError."""
    found = re.fullmatch(r"([0-9]{1,4})([dw])", text)
    if found is None:
        raise UsageError(
            f"`{word}={ascii(text)[1:-1][:60]}` is no span of time", hint=f"days or weeks, as in `{word}=30d`"
        )
    return timedelta(days=int(found[1]) * _PERIODS[found[2]])
