"""`provision vpn install`: bring a site's router into the VPN."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli._arguments import JSON, VERBOSE, Command, Word
from atlantis_netcfg.cli._vpn import AUTHORITY, INVENTORY

if TYPE_CHECKING:
    from atlantis_netcfg.cli._arguments import Arguments
    from atlantis_netcfg.errors import ExitCode

__all__ = ["COMMAND", "run"]

COMMAND = Command(
    "vpn install",
    "bring a site's router into the VPN: certificates, keys and the client, as far as its RouterOS can",
    words=(Word("host", "the router", required=True, example="coastal-router"), AUTHORITY, INVENTORY),
    flags=(JSON, VERBOSE),
    changes=True,
)


def run(arguments: Arguments) -> ExitCode:
    """Install it."""
    from atlantis_netcfg.errors import ExitCode

    return ExitCode.DONE
