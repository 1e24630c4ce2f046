"""What each role of a computer asks for, by the role's name. A new role is a function and its line here.

`KINDS` says which kind of computer has which roles: a new kind is its row there, and its group in the playbook.

`perform` answers a role: what each computer of a play should hold. It contacts nothing. It also says where a host may
take packages and sources from, and how much of them: its site's link, or a bundle alone.
"""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.declaration import Declaration, Host
from atlantis_netcfg.declaration.model import ControlCentre, Gateway, Model, OperatorStation, VpnServer
from atlantis_netcfg.gateway.base import gateway_base
from atlantis_netcfg.gateway.dds import gateway_dds
from atlantis_netcfg.gateway.interop import gateway_interop
from atlantis_netcfg.gateway.ros2 import ArchiveKey, StandIn, gateway_ros2
from atlantis_netcfg.operations.computers import _watch
from atlantis_netcfg.operations.computers._access import computer_access, is_computer, is_server
from atlantis_netcfg.operations.costs import gate
from atlantis_netcfg.operations.request import Request, declaration_of, open_request, refuse_examples
from atlantis_netcfg.operations.site_links import link_of
from atlantis_netcfg.vpn.client import openvpn_client
from atlantis_netcfg.vpn.server import openvpn_server

if TYPE_CHECKING:
    from pathlib import Path

Part = Callable[[Declaration, Host, Request], Mapping[str, Any]]
"""Pure: what one host should hold, as JSON-able data without secrets."""
ACCESS = "computer_access"
SERVER = "openvpn_server"


def _ros2(declaration: Declaration, host: Host, request: Request) -> Mapping[str, Any]:
    served = request.standins if request.rehearsed else None
    if served is None:
        return gateway_ros2(declaration, host).as_dict()
    key = ArchiveKey(base64.b64decode(served.key), served.fingerprint)
    stand_in = StandIn(served.archive, key, served.codename, served.distribution)
    return gateway_ros2(declaration, host, stand_in).as_dict()


def _interop(declaration: Declaration, host: Host, request: Request) -> Mapping[str, Any]:
    desired = gateway_interop(declaration, host).as_dict()
    served = request.standins if request.rehearsed else None
    if served is not None and desired["build"] is not None:
        for repository in filter(None, (desired["build"]["library"], desired["build"]["examples"])):
            repository["url"] = f"{served.repositories}/{repository['url'].rpartition('/')[2]}"
    return desired


def _base(declaration: Declaration, host: Host, request: Request) -> Mapping[str, Any]:
    """In a rehearsal without the network, which is that of the machine, and which its tools do not own."""
    images = request.images.get(host.name) if request.rehearsed else None
    return gateway_base(declaration, host, rehearsed=request.rehearsed, images=images).as_dict()


def _dds(declaration: Declaration, host: Host, _request: Request) -> Mapping[str, Any]:
    return gateway_dds(declaration, host).as_dict()


def _client(declaration: Declaration, host: Host, request: Request) -> Mapping[str, Any]:
    return openvpn_client(declaration, host, request.identity_of(host.name)).as_dict()


def _server(declaration: Declaration, host: Host, request: Request) -> Mapping[str, Any]:
    """Not pure: the roll and the list are the authority's. Raises NoAuthority, AuthorityDamaged."""
    from atlantis_netcfg.vpn.authority.authority import Authority  # noqa: PLC0415 - most runs have no server of the VPN

    authority = Authority.open(request.vpn)
    authority.crl()  # neither a foreign list nor one that has expired leaves this computer
    return openvpn_server(declaration, host, authority.membership(), authority.folder).as_dict()


_SERVING = ("gateway_base", "openvpn_client", "gateway_ros2", "gateway_interop", "gateway_dds")
KINDS: Mapping[type[Model], tuple[str, ...]] = {
    Gateway: _SERVING,
    ControlCentre: _SERVING,
    OperatorStation: ("gateway_base", "openvpn_client"),
    VpnServer: (SERVER,),
}
"""Kind of a computer -> its roles. Of an operator station `gateway_base` has the network alone."""


def concerns(part: str, host: Host) -> bool:
    """Whether a part is one of this host."""
    roles = KINDS.get(type(host.device), ())
    return part in roles or (part == ACCESS and bool(roles))


def refuse_unfounded(hosts: Iterable[Host], request: Request) -> None:
    """Hold that there is an authority where the server of the VPN is among the hosts. Raises NoAuthority."""
    servers = [host.name for host in hosts if is_server(host)]
    if not servers:
        return
    from atlantis_netcfg.vpn.authority.authority import Authority  # noqa: PLC0415 - as above
    from atlantis_netcfg.vpn.authority.model import NoAuthority  # noqa: PLC0415 - as above

    try:
        Authority.open(request.vpn)
    except NoAuthority as error:
        others = "where a colleague has it, let them run this, and name the other devices with `only=`"
        raise NoAuthority(f"{', '.join(servers)}: {error}", hint=f"make one: `provision vpn init`; {others}") from None


PARTS: Mapping[str, Part] = {
    ACCESS: computer_access,
    SERVER: _server,
    "gateway_base": _base,
    "openvpn_client": _client,
    "gateway_ros2": _ros2,
    "gateway_interop": _interop,
    "gateway_dds": _dds,
}

BUNDLES = "/var/lib/atlantis/bundle"
"""On a computer: where the action `carry` puts a bundle, below its id."""


def fetching(declaration: Declaration, host: Host, request: Request, bundle: str | None) -> Mapping[str, Any]:
    """Give the parameters of the module `packages` that say so; none: whatever it needs, over a link that is free.

    Over a link that is paid by the byte nothing is fetched unless a person has agreed, and never more than its cap.
    Which link a site uses at the moment only its router knows: the one that it prefers is taken for it.
    """
    if bundle is not None:
        return {"offline": f"{BUNDLES}/{bundle}/repository"}
    bearers = declaration.sites[host.site].bearers
    if request.rehearsed or not bearers or not bearers[0].metered:
        return {}
    link = link_of(declaration, host.site, bearers[0].name)
    if request.accept_cost and link.cap_bytes is None:
        return {}
    return {
        "limit_bytes": link.cap_bytes if request.accept_cost else 0,
        "limit_words": f"over {link.name} of {host.site}, which is paid by the byte",
    }


def narrowed(desired: Mapping[str, Any], how: Mapping[str, Any], bundle: str | None) -> dict[str, Any]:
    """Give a part its ways: to packages by `how`, to sources that are built in the bundle alone, if there is one."""
    values = dict(desired)
    if values.get("packages") is not None:
        values["packages"] = {**values["packages"], **how}
    if values.get("build") is not None and bundle is not None:
        values["build"] = {**values["build"], "offline": f"{BUNDLES}/{bundle}/sources"}
    return values


def bundle_of(folder: Path | None) -> str | None:
    """The id of a bundle, as its manifest has it; it was opened, and found right, before."""
    if folder is None:
        return None
    from atlantis_netcfg.bundle.manifest import MANIFEST, read_manifest  # noqa: PLC0415 - most runs have no bundle

    path = folder / MANIFEST
    return read_manifest(path.read_bytes(), str(path)).id


def perform(
    inventory: Path, hosts: Sequence[str], request: Mapping[str, Any] | None, part: str, *, plan_only: bool
) -> dict[str, Any]:
    """Give `per_host` for the part of that name, and refuse what the run may not do. Raises NetcfgError."""
    with open_request(request, plan_only=plan_only) as (requested, _):
        if part not in PARTS:
            raise UsageError(f"`{part}` is no part of a computer", hint=f"there are: {', '.join(PARTS)}")
        declaration = declaration_of(inventory)
        computers = [declaration.hosts[name] for name in hosts if is_computer(declaration.hosts[name])]
        refuse_examples(declaration, rehearsed=requested.rehearsed)
        gate(declaration, computers, requested)
        _watch.refuse()
        if part == ACCESS:
            _open_bundle(declaration, computers, requested)
            refuse_unfounded(computers, requested)
        bundle = bundle_of(requested.offline)
        return {
            "per_host": {
                host.name: narrowed(
                    PARTS[part](declaration, host, requested), fetching(declaration, host, requested, bundle), bundle
                )
                for host in computers
                if concerns(part, host)
            }
        }


def _open_bundle(declaration: Declaration, computers: Sequence[Host], request: Request) -> None:
    """Hold the bundle against the declaration, before anything starts. Raises BundleRefused with all that it lacks."""
    if request.offline is None:
        return
    if servers := [host.name for host in computers if is_server(host)]:
        raise UsageError(
            f"{', '.join(servers)}: the server of the VPN takes nothing from a bundle: that is for the others",
            hint="name the others with `only=`; run the server without `--offline`",
        )
    from atlantis_netcfg.operations import bundle as bundling  # noqa: PLC0415 - most runs have no bundle

    bundling.opened(declaration, computers, request.offline, request)
