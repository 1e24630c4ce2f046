"""`provision vpn sync`: bring the server of the VPN to what is recorded."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli._arguments import JSON, Command, Flag
from atlantis_netcfg.cli._passphrase import PASSPHRASE_FD
from atlantis_netcfg.cli._vpn import AGAIN, AUTHORITY, CLOCK, INVENTORY

if TYPE_CHECKING:
    from atlantis_netcfg.cli._arguments import Arguments
    from atlantis_netcfg.errors import ExitCode

__all__ = ["COMMAND", "run"]

COMMAND = Command(
    "vpn sync",
    "bring the server to what is recorded: members, list, firewall, and sessions that must end",
    words=(CLOCK, AUTHORITY, INVENTORY),
    flags=(
        Flag("sign", "also sign the list of revoked certificates anew: it is good for 90 days"),
        PASSPHRASE_FD,
        JSON,
    ),
    details="Needs no passphrase without `--sign`. Exit code 5 says that the server was not reached.",
    changes=True,
    again=AGAIN,
)


def run(arguments: Arguments) -> ExitCode:
    """Push, end what must end, look."""
    from atlantis_netcfg.cli import _members, _vpn
    from atlantis_netcfg.cli._passphrase import asked
    from atlantis_netcfg.cli._progress import progress

    declaration = _vpn.declared(arguments)
    authority = _vpn.opened(arguments)
    server = _vpn.server(arguments, declaration)
    if arguments.flag("sign"):
        with _vpn.desk(arguments, authority).unlocked(asked(arguments)) as signer:
            signer.publish()
    with progress(quiet=arguments.flag("json")) as notify:
        deployed = server.deploy(authority, notify)
    return _members.close_synced(arguments, deployed)
