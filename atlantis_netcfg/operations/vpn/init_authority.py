"""Making the authority of the pilot's VPN, from what the inventory says of its server."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.vpn.authority import Authority, ServerNames
from atlantis_netcfg.vpn.enrolment_package import server_name

if TYPE_CHECKING:
    from pathlib import Path

    from atlantis_netcfg.declaration import Declaration

__all__ = ["existing_authority", "refuse_example_authority", "server_names"]


def server_names(declaration: Declaration) -> ServerNames:
    """What the server's certificate is made out to: RouterOS compares name or address with what it connects to."""
    vpn = declaration.pilot.vpn
    lan = getattr(declaration.hosts[vpn.server].device, "address", None)
    addresses = (vpn.endpoint,) if lan is None else (vpn.endpoint, lan)
    return ServerNames(server_name(declaration), (vpn.endpoint_name,), addresses)


def existing_authority(folder: Path, declaration: Declaration) -> Authority | None:
    """The authority that is there already. Raises UsageError if its server is another than the declared one."""
    if not Authority.exists(folder):
        return None
    authority = Authority.open(folder)
    names, desired = authority.server(), server_names(declaration)
    if names != desired:
        raise UsageError(
            f"{folder} has an authority whose server is {_names_text(names)}, and the inventory declares {_names_text(desired)}",
            hint="if the inventory is right, `provision vpn sync --sign` makes a certificate for it; "
            "another authority has another folder: `authority=FOLDER`",
        )
    return authority


def refuse_example_authority(declaration: Declaration, *, named: bool) -> None:
    """Raise UsageError where example values would go into the real authority; one in a `named` folder is for trying."""
    if declaration.pilot.example_values and not named:
        raise UsageError(
            "the inventory still holds example values, and nobody could use what is made of them",
            hint="replace them and set `example_values: false` in group_vars/all/pilot.yml, "
            "or try it out in a folder of its own: add `authority=FOLDER`",
        )


def _names_text(names: ServerNames) -> str:
    return ", ".join([names.common_name, *names.dns, *map(str, names.addresses)])
