"""The desired state of each role of a computer, by role name; a new role is a function and its line here.

`KINDS` lists the roles of each kind of computer: a new kind is its row there, and its group in the playbook.
"""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from atlantis_netcfg.computers import ros2
from atlantis_netcfg.computers.base import gateway_base
from atlantis_netcfg.computers.dds import gateway_dds
from atlantis_netcfg.computers.interop import gateway_interop
from atlantis_netcfg.core.messages import arg, join
from atlantis_netcfg.inventory import Host, Inventory, model
from atlantis_netcfg.operations.common.request import Request
from atlantis_netcfg.operations.computers._access import computer_access, is_server
from atlantis_netcfg.vpn.client import openvpn_client
from atlantis_netcfg.vpn.server import openvpn_server

Part = Callable[[Inventory, Host, Request], Mapping[str, Any]]
"""Pure function: the desired state of one host as JSON-able data without secrets."""
ACCESS = "computer_access"
SERVER = "openvpn_server"


def _ros2(inventory: Inventory, host: Host, request: Request) -> Mapping[str, Any]:
    stand_ins = request.standins if request.rehearsed else None
    if stand_ins is None:
        return ros2.gateway_ros2(inventory, host).as_dict()
    key = ros2.ArchiveKey(base64.b64decode(stand_ins.key), stand_ins.fingerprint)
    stand_in = ros2.StandIn(stand_ins.archive, key, stand_ins.codename, stand_ins.distribution)
    return ros2.gateway_ros2(inventory, host, stand_in).as_dict()


def _interop(inventory: Inventory, host: Host, request: Request) -> Mapping[str, Any]:
    desired_state = gateway_interop(inventory, host).as_dict()
    stand_ins = request.standins if request.rehearsed else None
    if stand_ins is not None and desired_state["build"] is not None:
        for repository in filter(None, (desired_state["build"]["library"], desired_state["build"]["examples"])):
            repository["url"] = f"{stand_ins.repositories}/{repository['url'].rpartition('/')[2]}"
    return desired_state


def _base(inventory: Inventory, host: Host, request: Request) -> Mapping[str, Any]:
    """Return the desired base; a rehearsal omits the network, which the machine owns and not its tools."""
    images = request.images.get(host.name) if request.rehearsed else None
    return gateway_base(inventory, host, is_rehearsal=request.rehearsed, images=images).as_dict()


def _dds(inventory: Inventory, host: Host, _request: Request) -> Mapping[str, Any]:
    return gateway_dds(inventory, host).as_dict()


def _client(inventory: Inventory, host: Host, request: Request) -> Mapping[str, Any]:
    return openvpn_client(inventory, host, request.identity_of(host.name)).as_dict()


def _server(inventory: Inventory, host: Host, request: Request) -> Mapping[str, Any]:
    """Return the desired VPN server with member list and CRL; raise NoAuthority or CorruptAuthorityError."""
    from atlantis_netcfg.vpn.authority.authority import Authority  # noqa: PLC0415 - most runs have no server of the VPN

    authority = Authority.open(request.vpn)
    authority.crl()  # neither a foreign list nor one that has expired leaves this computer
    return openvpn_server(inventory, host, authority.membership(), authority.folder).as_dict()


_SERVING = ("gateway_base", "openvpn_client", "gateway_ros2", "gateway_interop", "gateway_dds")
KINDS: Mapping[type[model.Model], tuple[str, ...]] = {
    model.Gateway: _SERVING,
    model.ControlCentre: _SERVING,
    model.OperatorStation: ("gateway_base", "openvpn_client"),
    model.VpnServer: (SERVER,),
}
"""Roles by kind of computer. On an operator station `gateway_base` covers only the network."""


def concerns(part: str, host: Host) -> bool:
    """Return whether a part belongs to this host."""
    roles = KINDS.get(type(host.device), ())
    return part in roles or (part == ACCESS and bool(roles))


def require_authority(hosts: Iterable[Host], request: Request) -> None:
    """Raise NoAuthority if the VPN server is among the hosts and this computer has no authority."""
    servers = [host.name for host in hosts if is_server(host)]
    if not servers:
        return
    from atlantis_netcfg.vpn.authority.authority import Authority  # noqa: PLC0415 - as above
    from atlantis_netcfg.vpn.authority.model import NoAuthority  # noqa: PLC0415 - as above

    try:
        Authority.open(request.vpn)
    except NoAuthority as error:
        others = "if a colleague has it, let them run this, and select the other devices with `device=`"
        raise NoAuthority(
            f"{arg(join(', ', servers))}: {arg(error)}", hint=f"create one: `provision vpn init`; {arg(others)}"
        ) from None


PARTS: Mapping[str, Part] = {
    ACCESS: computer_access,
    SERVER: _server,
    "gateway_base": _base,
    "openvpn_client": _client,
    "gateway_ros2": _ros2,
    "gateway_interop": _interop,
    "gateway_dds": _dds,
}
