"""`provision vpn show`: one member of the VPN, with its certificates and what may be reached from it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli._arguments import JSON, Command, Word
from atlantis_netcfg.cli._vpn import AUTHORITY

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.cli._arguments import Arguments
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.vpn.identity import Certificate, Member

COMMAND = Command(
    "vpn show",
    "show one member of the VPN with its certificates",
    words=(Word("name", "the member", required=True, example="iqua-sparus2"), AUTHORITY),
    flags=(JSON,),
)


def run(arguments: Arguments) -> ExitCode:
    """Show it."""
    from datetime import UTC, datetime

    from atlantis_netcfg.cli import _vpn
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.operations.vpn import records

    now = datetime.now(UTC)
    member = records.find(_vpn.opened(arguments).membership(), arguments.word("name"))
    lines = _lines(member, records.status_of(member, now))
    return _vpn.tell(arguments, ExitCode.DONE, {"member": records.member_row(member, now)}, lines)


def _lines(member: Member, standing: str) -> Iterator[str]:
    whose = f"of {member.partner}" if member.partner is not None else "of the pilot itself"
    vehicle = f", the vehicle {member.vehicle}" if member.vehicle is not None else ""
    yield f"{member.name}: {member.kind} {whose}{vehicle}, {standing}"
    yield f"  address {member.address}, timers for {member.link}"
    for certificate in member.certificates:
        yield from _certificate(certificate)


def _certificate(certificate: Certificate) -> Iterator[str]:
    from atlantis_netcfg.operations.vpn.records import when

    until, seen = when(certificate.not_after), when(certificate.seen)
    yield f"  {certificate.common_name}: {certificate.standing}, good until {until}, last seen {seen}"
    yield f"    {certificate.key} key, {certificate.wrap}, serial {certificate.serial:x}"
    if certificate.revoked is not None:
        yield f"    revoked {when(certificate.revoked)}{f': {certificate.reason}' if certificate.reason else ''}"
