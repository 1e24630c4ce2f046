"""From the declaration to what an image shall become."""

from __future__ import annotations

from ipaddress import IPv4Interface
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.declaration.model import AddressBy, Gateway
from atlantis_netcfg.image import LAYOUTS, Layout, Static, Wish

if TYPE_CHECKING:
    from atlantis_netcfg.declaration import Declaration, Host
    from atlantis_netcfg.declaration.model import Image

__all__ = ["layout_of", "wish_of"]


def _image_of(host: Host) -> tuple[Gateway, Image]:
    device = host.device
    if not isinstance(device, Gateway):
        raise UsageError(
            f"`{host.name}` is a {device.kind.replace('_', ' ')}: cards are made for gateway computers",
            hint="name a host of group `gateways`",
        )
    if device.image is None:
        raise UsageError(
            f"host_vars/{host.name}.yml does not say what goes into the image of `{host.name}`",
            hint="add `image: {layout: odroid-n2, ssh_keys: [ssh-ed25519 …]}` to its `device`",
        )
    return device, device.image


def layout_of(host: Host) -> Layout:
    """How the host's image is laid out. Raises UsageError where no card is made for the host."""
    return LAYOUTS[_image_of(host)[1].layout]


def wish_of(declaration: Declaration, host: Host, source: str) -> Wish:
    """What the host's image shall become; `source` names the vendor's file. Raises UsageError as `layout_of`."""
    device, image = _image_of(host)
    lan, pilot = declaration.sites[host.site].lan, declaration.pilot
    static = None
    if image.address_by is AddressBy.STATIC:
        address = IPv4Interface(f"{device.address}/{lan.network.prefixlen}")
        static = Static(address, lan.gateway, lan.domain)
    return Wish(
        host=host.name,
        site=host.site,
        user=image.user,
        keys=image.ssh_keys,
        static=static,
        interface=image.interface or LAYOUTS[image.layout].interface,
        time_zone=pilot.time_zone,
        time_servers=tuple(server.address for server in pilot.time_servers),
        source=source,
    )
