"""Part `network` of a gateway computer: the interface of the LAN, in the language of the tool that configures it.

The files have the names and say the words that `provision image` gives a card, so that a fresh computer is as declared.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.declaration.model import AddressBy, Gateway, NetworkTool
from atlantis_netcfg.render import environment

if TYPE_CHECKING:
    from atlantis_netcfg.declaration import Declaration, Host


@dataclass(frozen=True, slots=True)
class _Tool:
    template: str
    path: str
    mode: str


_TOOLS = {
    NetworkTool.NETPLAN: _Tool("network-netplan.yaml.j2", "/etc/netplan/10-atlantis.yaml", "0600"),
    NetworkTool.IFUPDOWN: _Tool("network-interfaces.j2", "/etc/network/interfaces", "0644"),
    NetworkTool.NETWORKD: _Tool("network-networkd.network.j2", "/etc/systemd/network/05-atlantis.network", "0644"),
}


@dataclass(frozen=True, slots=True)
class _Lan:
    """What the templates see."""

    interface: str
    address: str
    """With the LAN's prefix length."""
    gateway: str
    """The site's router; it also answers DNS."""
    domain: str
    dhcp: bool


@dataclass(frozen=True, slots=True)
class GatewayNetwork:
    """The parameters of `atlantis.netcfg.network`, but its action."""

    by: str
    interface: str
    address: str
    gateway: str
    path: str
    content: str
    mode: str
    resolver: str | None
    """Text of /etc/resolv.conf where nothing else writes it; None: DHCP brings it."""
    replaces: tuple[str, ...]
    rollback_s: int

    def as_dict(self) -> dict[str, Any]:
        """As JSON-able data; what is left out is the module's default."""
        values = asdict(self) | {"replaces": list(self.replaces)}
        return {key: value for key, value in values.items() if value is not None}


def gateway_network(declaration: Declaration, host: Host) -> GatewayNetwork | None:
    """Pure. None where no network is declared: it then stays as the image has it."""
    device = host.device
    assert isinstance(device, Gateway)  # noqa: S101 - callers choose gateways
    if device.network is None:
        return None
    site = declaration.sites[host.site].lan
    lan = _Lan(
        interface=device.network.interface,
        address=f"{device.address}/{site.network.prefixlen}",
        gateway=str(site.gateway),
        domain=site.domain,
        dhcp=device.image is not None and device.image.address_by is AddressBy.DHCP,
    )
    tool = _TOOLS[device.network.by]
    return GatewayNetwork(
        by=device.network.by.value,
        interface=lan.interface,
        address=lan.address,
        gateway=lan.gateway,
        path=tool.path,
        content=_text(tool.template, lan),
        mode=tool.mode,
        resolver=None if lan.dhcp else _text("network-resolv.conf.j2", lan),
        replaces=device.network.replaces,
        rollback_s=device.network.rollback_s,
    )


def _text(template: str, lan: _Lan) -> str:
    return environment().get_template(f"gateway/{template}").render(lan=lan)
