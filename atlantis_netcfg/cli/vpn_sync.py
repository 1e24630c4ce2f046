"""`provision vpn sync`: bring the server of the VPN to what is recorded."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli._arguments import JSON, VERBOSE, Command, Flag
from atlantis_netcfg.cli._passphrase import PASSPHRASE_FD
from atlantis_netcfg.cli._vpn import AUTHORITY, INVENTORY

if TYPE_CHECKING:
    from atlantis_netcfg.cli._arguments import Arguments
    from atlantis_netcfg.errors import ExitCode

__all__ = ["COMMAND", "run"]

COMMAND = Command(
    "vpn sync",
    "bring the server to what is recorded: members, list, firewall, and sessions that must end",
    words=(AUTHORITY, INVENTORY),
    flags=(
        Flag("sign", "also sign the list of revoked certificates anew: it is good for 90 days"),
        PASSPHRASE_FD,
        JSON,
        VERBOSE,
    ),
    details="Needs no passphrase without `--sign`. Exit code 5 says that the server was not reached.",
    changes=True,
)


def run(arguments: Arguments) -> ExitCode:
    """Push, end what must end, look."""
    from atlantis_netcfg.cli import _members, _vpn
    from atlantis_netcfg.cli._passphrase import asked

    declaration = _vpn.declared(arguments)
    authority = _vpn.opened(arguments)
    server = _vpn.server(arguments, declaration)
    if arguments.flag("sign"):
        with authority.unlocked(asked(arguments), _vpn.who(), waiting=_vpn.waiting(arguments)) as signer:
            signer.publish()
    return _members.close_synced(arguments, server.deploy(authority))
