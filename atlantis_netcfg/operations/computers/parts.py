"""What each role of a gateway asks for, by the role's name. A new role is a function and its line here."""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping
from typing import Any

from atlantis_netcfg.gateway.base import gateway_base
from atlantis_netcfg.gateway.interop import gateway_interop
from atlantis_netcfg.gateway.ros2 import StandIn, gateway_ros2
from atlantis_netcfg.gateway.ros_key import ArchiveKey
from atlantis_netcfg.operations.computers._access import gateway_access
from atlantis_netcfg.operations.computers.dds import gateway_dds
from atlantis_netcfg.operations.request import Request
from atlantis_netcfg.site import Declaration, Host

__all__ = ["ACCESS", "PARTS", "Part"]

Part = Callable[[Declaration, Host, Request], Mapping[str, Any]]
"""Pure: what one host should hold, as JSON-able data without secrets."""
ACCESS = "gateway_access"


def _ros2(declaration: Declaration, host: Host, request: Request) -> Mapping[str, Any]:
    served = request.standins if request.rehearsed else None
    if served is None:
        return gateway_ros2(declaration, host).as_dict()
    key = ArchiveKey(base64.b64decode(served.key), served.fingerprint)
    stand_in = StandIn(served.archive, key, served.codename, served.distribution)
    return gateway_ros2(declaration, host, stand_in).as_dict()


def _interop(declaration: Declaration, host: Host, request: Request) -> Mapping[str, Any]:
    wanted = gateway_interop(declaration, host).as_dict()
    served = request.standins if request.rehearsed else None
    if served is not None and wanted["build"] is not None:
        for repository in filter(None, (wanted["build"]["library"], wanted["build"]["examples"])):
            repository["url"] = f"{served.repositories}/{repository['url'].rpartition('/')[2]}"
    return wanted


def _base(declaration: Declaration, host: Host, request: Request) -> Mapping[str, Any]:
    """In a rehearsal without the network, which is that of the machine, and which its tools do not own."""
    wanted = gateway_base(declaration, host).as_dict()
    return {name: told for name, told in wanted.items() if name != "network" or not request.rehearsed}


def _dds(declaration: Declaration, host: Host, _request: Request) -> Mapping[str, Any]:
    return gateway_dds(declaration, host).as_dict()


PARTS: Mapping[str, Part] = {
    ACCESS: gateway_access,
    "gateway_base": _base,
    "gateway_ros2": _ros2,
    "gateway_interop": _interop,
    "gateway_dds": _dds,
}
