"""`provision vpn status`: how it stands with the VPN, and what must be done soon."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli._arguments import JSON, Command, Word
from atlantis_netcfg.cli._vpn import AUTHORITY, INVENTORY, NO_PUSH

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from datetime import datetime

    from atlantis_netcfg.cli._arguments import Arguments
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.operations.vpn.status import VpnStatus
    from atlantis_netcfg.vpn.identity import Member

COMMAND = Command(
    "vpn status",
    "tell expiries, sessions, who was last seen when, what waits, and what differs at the server",
    words=(Word("partner", "only the devices of this partner", example="iqua"), AUTHORITY, INVENTORY),
    flags=(NO_PUSH, JSON),
    details=(
        "Exit code 6: something must be done (a list or a certificate ends within 30 days or has ended, the server "
        "differs from the record, a revocation waits). 5: the server was not reached, so nobody knows."
    ),
)


def run(arguments: Arguments) -> ExitCode:
    """Look at the record and at the server; whoever was seen is recorded."""
    from datetime import UTC, datetime

    from atlantis_netcfg.cli import _vpn
    from atlantis_netcfg.cli._progress import progress
    from atlantis_netcfg.operations.vpn import records
    from atlantis_netcfg.operations.vpn.server import Connected
    from atlantis_netcfg.operations.vpn.status import vpn_status

    declaration = _vpn.declared(arguments)
    authority = _vpn.opened(arguments)
    server = _vpn.server(arguments, declaration)
    with progress(quiet=arguments.flag("json")) as notify:
        found = vpn_status(authority, server if isinstance(server, Connected) else None, notify)
    membership, partner = authority.membership(), arguments.optional("partner")
    members = records.of_partner(membership, partner) if membership.members or partner is not None else ()
    now = datetime.now(UTC)
    values = {
        "told": [item.as_json() for item in found.items],
        "members": [records.member_row(member, now) for member in members],
        "server": found.server_json(),
        "queued": list(membership.queued),
    }
    return _vpn.tell(arguments, found.exit, values, _lines(found, members, now))


def _lines(found: VpnStatus, members: Sequence[Member], now: datetime) -> Iterator[str]:
    from atlantis_netcfg.cli._vpn import table
    from atlantis_netcfg.operations.vpn.records import expires, status_of, when

    for entry in found.items:
        yield f"{entry.verdict.value:<12} {entry.message}"
        if entry.hint:
            yield from (f"{'':<12} {line}" for line in entry.hint.splitlines())
    up = {session.common_name: session for session in found.state.sessions if session.is_up} if found.state else {}
    rows = [("member", "address", "until", "last seen", "session", "standing")] if members else []
    for member in members:
        until, names = expires(member), [item.common_name for item in member.certificates]
        seen = max(
            (certificate.seen for certificate in member.certificates if certificate.seen is not None), default=None
        )
        session = next((up[name] for name in names if name in up), None)
        rows.append(
            (
                member.name,
                str(member.address),
                f"{until:%Y-%m-%d}" if until is not None else "-",
                when(seen),
                f"{session.real} as {session.common_name}" if session is not None else "-",
                status_of(member, now),
            )
        )
    yield from table(rows)
