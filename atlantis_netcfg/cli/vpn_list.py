"""`provision vpn list`: who is in the VPN."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli._arguments import JSON, Command, Word
from atlantis_netcfg.cli._vpn import AUTHORITY

if TYPE_CHECKING:
    from atlantis_netcfg.cli._arguments import Arguments
    from atlantis_netcfg.core.errors import ExitCode

COMMAND = Command(
    "vpn list",
    "list who is in the VPN, and until when",
    words=(Word("partner", "only the devices of this partner", example="iqua"), AUTHORITY),
    flags=(JSON,),
)


def run(arguments: Arguments) -> ExitCode:
    """List them, in the order of their onboarding."""
    from datetime import UTC, datetime

    from atlantis_netcfg.cli import _vpn
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.operations.vpn import records

    now = datetime.now(UTC)
    members = records.of_partner(_vpn.opened(arguments).membership(), arguments.optional("partner"))
    rows = [("name", "kind", "address", "until", "last seen", "standing")]
    for member in members:
        until = records.expires(member)
        seen = max(
            (certificate.seen for certificate in member.certificates if certificate.seen is not None), default=None
        )
        rows.append(
            (
                member.name,
                str(member.kind),
                str(member.address),
                f"{until:%Y-%m-%d}" if until is not None else "-",
                records.when(seen),
                records.status_of(member, now),
            )
        )
    values = {"members": [records.member_row(member, now) for member in members]}
    return _vpn.tell(arguments, ExitCode.DONE, values, _vpn.table(rows))
