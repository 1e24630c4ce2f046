"""`provision vpn audit`: who did what, when; and whether the record is as it was signed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli._arguments import JSON, Command, Word
from atlantis_netcfg.cli._vpn import AUTHORITY

if TYPE_CHECKING:
    from atlantis_netcfg.cli._arguments import Arguments
    from atlantis_netcfg.core.errors import ExitCode

COMMAND = Command(
    "vpn audit",
    "tell who did what with the VPN's members, and whether the record is as the CA key signed it",
    words=(
        Word("since", "only from this day on, or of so many days or weeks", example="2026-11-01"),
        Word("partner", "only what concerns the devices of this partner", example="iqua"),
        AUTHORITY,
    ),
    flags=(JSON,),
    details=(
        "The record is compared with its signature, the certificates and the revocation list. Exit code 6 says that "
        "something does not agree: it was changed by something else than provision, or is damaged, or not whole."
    ),
)


def run(arguments: Arguments) -> ExitCode:
    """Tell the entries, oldest first."""
    from atlantis_netcfg.cli import _vpn
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.operations.vpn.records import audit, start_of

    since = arguments.optional("since")
    start = start_of(since) if since is not None else None
    found = audit(_vpn.opened(arguments), start, arguments.optional("partner"))
    rows = [(f"{item.at:%Y-%m-%d %H:%M:%S}", item.who, item.words) for item in found.entries]
    checked = found.agreement
    values = {
        "agrees": not found.broken,
        "lines": checked.lines if checked is not None else None,
        "signed_lines": checked.signed if checked is not None else 0,
        "signed_at": checked.at.isoformat() if checked is not None and checked.at is not None else None,
        "entries": [entry.facts() for entry in found.entries],
    }
    lines = [*_vpn.table(rows), *found.words]
    return _vpn.tell(
        arguments, ExitCode.CHECKS_FAILED if found.broken else ExitCode.DONE, values, lines, errors=found.broken
    )
