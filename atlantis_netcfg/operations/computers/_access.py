"""How Ansible reaches a computer: the declared address, or the system that stands for it in a rehearsal."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from atlantis_netcfg.operations.bearers import bearer_of
from atlantis_netcfg.site.model import Gateway, VpnServer

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.operations.request import Request
    from atlantis_netcfg.site import Declaration, Host

__all__ = ["computer_access", "is_computer", "is_gateway", "is_server"]


def is_gateway(host: Host) -> bool:
    """Whether a host is a gateway computer."""
    return isinstance(host.device, Gateway)


def is_server(host: Host) -> bool:
    """Whether a host runs the server of the VPN."""
    return isinstance(host.device, VpnServer)


def is_computer(host: Host) -> bool:
    """Whether roles work on a host over SSH: a gateway computer, or the server of the VPN."""
    return is_gateway(host) or is_server(host)


def computer_access(declaration: Declaration, host: Host, request: Request) -> Mapping[str, Any]:
    """Give the variables of a connection: `host`, `port`, `user`, `become`, `ssh_args`, `metered`.

    The host key is kept in the technician's own known_hosts under the name of the host, whatever address it is reached
    by: taken at first contact, compared ever after. Raises UsageError if the site has no such bearer as `via=` names.
    """
    device = host.device
    assert isinstance(device, Gateway | VpnServer)  # noqa: S101 - callers ask `is_computer`
    bearer = bearer_of(declaration, host, request.via.get(host.name))
    target = request.targets.get(host.name) if request.rehearsed else None
    alias = f"-o HostKeyAlias={host.name}"
    if target is not None:
        known = f"-o StrictHostKeyChecking=yes -o UserKnownHostsFile={target.known_hosts}"
        key = f"-o IdentityFile={target.identity} -o IdentitiesOnly=yes"
        return {
            "host": target.host,
            "port": target.port,
            "user": "root",
            "become": False,
            "ssh_args": f"{alias} {known} {key}",
            "metered": "",
        }
    return {
        "host": str(device.address),
        "port": device.ssh.port,
        "user": device.account,
        "become": device.account != "root",
        "ssh_args": f"{alias} -o StrictHostKeyChecking=accept-new",
        "metered": bearer.name if bearer.metered else "",
    }
