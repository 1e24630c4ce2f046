"""Ansible's access to a computer: the address of the inventory, or its emulator in a rehearsal."""

from __future__ import annotations

import shlex
from typing import TYPE_CHECKING, Any

from atlantis_netcfg import runs
from atlantis_netcfg.core.errors import TRUST
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory.model import SshHost, VpnServer
from atlantis_netcfg.operations.common.session_link import site_link_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.operations.common.request import Request


def is_server(host: Host) -> bool:
    """Return whether a host runs the VPN server."""
    return isinstance(host.device, VpnServer)


def is_computer(host: Host) -> bool:
    """Return whether a host is configured by roles over SSH."""
    return isinstance(host.device, SshHost)


def computer_access(inventory: Inventory, host: Host, request: Request) -> Mapping[str, Any]:
    """Return the connection variables: `host`, `port`, `user`, `become`, `ssh_args`, `metered`.

    The host key is that of the inventory, else the one under the host's name in the technician's known_hosts, whatever
    the address: any other is refused. Raises UsageError if the site has no link as named by `via=`.
    """
    device = host.device
    assert isinstance(device, SshHost)  # noqa: S101 - callers ask `is_computer`
    link = site_link_of(inventory, host, request.via.get(host.name))
    target = request.targets.get(host.name) if request.rehearsed else None
    alias = f"-o HostKeyAlias={host.name}"
    if target is not None:
        host_key_options = f"-o StrictHostKeyChecking=yes -o UserKnownHostsFile={target.known_hosts}"
        key = f"-o IdentityFile={target.identity} -o IdentitiesOnly=yes"
        return {
            "host": target.host,
            "port": target.port,
            "user": "root",
            "become": False,
            "ssh_args": f"{alias} {host_key_options} {key}",
            "metered": "",
        }
    return {
        "host": str(device.address),
        "port": device.ssh.port,
        "user": device.account,
        "become": device.account != "root",
        "ssh_args": f"{alias} -o StrictHostKeyChecking=yes{_declared_key(host, request)}",
        "metered": link.name if link.is_metered else "",
    }


def _declared_key(host: Host, request: Request) -> str:
    """Return the SSH option for a file with only the inventory's host key; empty if it has none."""
    device = host.device
    assert isinstance(device, SshHost)  # noqa: S101 - the caller has asked
    if device.ssh.host_key is None:
        return ""
    path = request.state / "known_hosts" / host.name
    line = f"{host.name} {device.ssh.host_key}\n".encode()
    with runs.os_errors_as("the host key in the inventory", path):
        if not path.is_file() or path.read_bytes() != line:
            runs.make_private(path.parent)
            runs.write_atomically(path, line)
    only = (f'UserKnownHostsFile="{path}"', "GlobalKnownHostsFile=/dev/null", "UpdateHostKeys=no")
    return "".join(f" -o {shlex.quote(option)}" for option in only)


def key_trouble(name: str, message: str) -> tuple[str, str] | None:
    """Return OpenSSH's host-key refusal as text, and what to do about it; None if it refused nothing."""
    if "IDENTIFICATION HAS CHANGED" in message:
        text = "it shows a different SSH host key than before, so nothing was sent to it"
        return text, msg(f"only if it was reinstalled: run `ssh-keygen -R {arg(name)}`, then {arg(TRUST)}")
    if "Host key verification failed" in message or "host key is known" in message:
        return "its SSH host key differs from the inventory, or is not known here, so nothing was sent to it", TRUST
    return None
