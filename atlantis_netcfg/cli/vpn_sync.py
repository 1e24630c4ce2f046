"""`provision vpn sync`: bring the server of the VPN to what is recorded."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli._arguments import JSON, Command, Flag
from atlantis_netcfg.cli._passphrase import PASSPHRASE_FD
from atlantis_netcfg.cli._vpn import AGAIN, AUTHORITY, CLOCK, INVENTORY

if TYPE_CHECKING:
    from atlantis_netcfg.cli._arguments import Arguments
    from atlantis_netcfg.core.errors import ExitCode

COMMAND = Command(
    "vpn sync",
    "bring the server to what is recorded: members, list, firewall, and sessions that must end",
    words=(CLOCK, AUTHORITY, INVENTORY),
    flags=(
        Flag("sign", "also sign the list of revoked certificates anew, and the server's certificate where it is time"),
        Flag("take-list", "with --sign: take over what the server's list revokes, as the newest copy of it is lost"),
        PASSPHRASE_FD,
        JSON,
    ),
    details=(
        "Needs no passphrase without `--sign`, which makes a list that is good for 90 days, and a certificate of the "
        "server where its names in the inventory are others or 90 days are left. Exit code 5: it was not reached."
    ),
    changes=True,
    again=AGAIN,
)


def run(arguments: Arguments) -> ExitCode:
    """Push, end what must end, look."""
    from atlantis_netcfg.cli import _members, _vpn
    from atlantis_netcfg.cli._passphrase import passphrase_prompt
    from atlantis_netcfg.cli._progress import progress
    from atlantis_netcfg.core.errors import UsageError
    from atlantis_netcfg.operations.vpn.members import server_names

    declaration = _vpn.declared(arguments)
    authority = _vpn.opened(arguments)
    server = _vpn.server(arguments, declaration)
    sign, take = arguments.flag("sign"), arguments.flag("take-list")
    if take and not sign:
        raise UsageError("a list that is taken over is signed anew", hint="add `--sign`")
    passphrase = passphrase_prompt(arguments) if sign else None
    theirs = None
    if take:
        with progress(quiet=arguments.flag("json")) as notify:
            theirs = server.published(notify)
    else:
        _members.hold(arguments, server, authority)
    served, taken = False, None
    if passphrase is not None:
        with _vpn.operator(arguments, authority).unlocked(passphrase) as signer:
            taken = signer.take(theirs) if theirs is not None else None
            signer.publish()
            served = signer.serve(server_names(declaration))
    with progress(quiet=arguments.flag("json")) as notify:
        deployed = server.deploy(authority, notify)
    return _members.close_synced(arguments, deployed, _vpn.site(declaration) if served else None, taken)
