"""`provision vpn init`: make the authority of the VPN."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli._arguments import JSON, Command, Word
from atlantis_netcfg.cli._passphrase import PASSPHRASE_FD
from atlantis_netcfg.cli._vpn import AGAIN, AUTHORITY, INVENTORY

if TYPE_CHECKING:
    from atlantis_netcfg.cli._arguments import Arguments
    from atlantis_netcfg.core.errors import ExitCode

COMMAND = Command(
    "vpn init",
    "make the VPN's authority: a CA whose key is sealed with a passphrase, and the server's certificate",
    words=(
        Word("sealed", "how the CA key is sealed; age if left out", choices=("age", "vault")),
        AUTHORITY,
        INVENTORY,
    ),
    flags=(PASSPHRASE_FD, JSON),
    details=(
        "Once for a pilot, on one computer. Without the passphrase nobody can onboard, renew or revoke, and nobody can "
        "get it back; `docs/vpn.md` says what to copy where."
    ),
    changes=True,
    again=AGAIN,
)


def run(arguments: Arguments) -> ExitCode:
    """Make it, unless it is there."""
    from atlantis_netcfg.cli import _vpn
    from atlantis_netcfg.cli._passphrase import chosen
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.operations.vpn.members import existing_authority, refuse_example_authority, server_names
    from atlantis_netcfg.vpn.authority.authority import Authority
    from atlantis_netcfg.vpn.pki import SEAL_GUESSES, VAULT_GUESSES, check_passphrase

    declaration, folder = _vpn.declared(arguments), _vpn.folder(arguments)
    refuse_example_authority(declaration, named=arguments.optional("authority") is not None)
    there = existing_authority(folder, declaration)
    authority = there
    if authority is None:
        vault = arguments.optional("sealed") == "vault"
        guesses = VAULT_GUESSES if vault else SEAL_GUESSES
        passphrase = chosen(arguments, lambda typed: check_passphrase(typed, guesses))
        authority = Authority.init(
            folder, passphrase, server_names(declaration), _vpn.who(), "vault" if vault else "age"
        )
    names = authority.server()
    values = {
        "authority": str(folder),
        "already": there is not None,
        "server": {
            "name": names.common_name,
            "dns": list(names.dns),
            "addresses": [str(address) for address in names.addresses],
        },
    }
    lines = [
        f"{'already so' if there else 'made'}: the authority of the VPN, in {folder}",
        f"  its server is {names.common_name}, reached as {', '.join([*names.dns, *map(str, names.addresses)])}",
    ]
    if there is None:
        lines.append(
            "  copy the folder to a second place, and write the passphrase down in a third: nobody can make them again"
        )
    if there is None and (memory := authority.opening_bytes()):
        lines.append(f"  opening its key takes about a second and {memory >> 20} MiB of memory, wherever that is done")
    return _vpn.tell(arguments, ExitCode.DONE, values, lines)
