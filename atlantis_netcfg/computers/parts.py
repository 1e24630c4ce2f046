"""Parameters of the collection's modules `configure` and `packages`, and the `network` part of a computer.

The network part configures the LAN interface, in the format of the tool that manages it. Its files have the same names
and contents as those that `provision gateway image` writes to a card, so that a fresh computer has no drift.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields, replace
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.desired_state import (
    Check,
    ConvergeStep,
    DesiredState,
    Directory,
    File,
    SshRequirements,
    SymbolicLink,
    Unit,
    UserSuppliedFile,
)
from atlantis_netcfg.inventory import model
from atlantis_netcfg.routeros.render import environment

if TYPE_CHECKING:
    from atlantis_netcfg.inventory import Host, Inventory

__all__ = ["Check", "ConvergeStep", "Directory", "File", "SshRequirements", "SymbolicLink", "Unit", "UserSuppliedFile"]


@dataclass(frozen=True, slots=True)
class Package:
    """A Debian package; `version` None takes what the archive has."""

    name: str
    version: str | None = None


def run_on(file: str, *program: str) -> tuple[str, ...]:
    """Return a step that runs a program with a file as last argument, or does nothing if the file is gone."""
    return ("sh", "-c", '[ ! -e "$1" ] || { file="$1"; shift; exec "$@" "$file"; }', "sh", file, *program)


class Configuration(DesiredState):
    """The parameters of `atlantis.netcfg.configure`."""

    def merge(self, more: Configuration) -> Configuration:
        """Combine both configurations for one run of the module; `way_in` of this one is kept."""
        lists = (item.name for item in fields(self) if item.name != "way_in")
        both: dict[str, Any] = {name: (*getattr(self, name), *getattr(more, name)) for name in lists}
        return replace(self, **both)

    def as_dict(self) -> dict[str, Any]:
        """Return JSON-able data; omitted keys have the module's default."""
        return {key: _plain(value) for key, value in asdict(self).items() if value}


def _plain(result: Any) -> Any:  # noqa: ANN401 - JSON
    """Convert tuples to lists, and drop keys without a value."""
    if isinstance(result, dict):
        return {key: _plain(value) for key, value in result.items() if value is not None}
    return [_plain(value) for value in result] if isinstance(result, list | tuple) else result


@dataclass(frozen=True, slots=True)
class _InstalledTool:
    template: str
    path: str
    mode: str


_TOOLS = {
    model.NetworkTool.NETPLAN: _InstalledTool("network-netplan.yaml.j2", "/etc/netplan/10-atlantis.yaml", "0600"),
    model.NetworkTool.IFUPDOWN: _InstalledTool("network-interfaces.j2", "/etc/network/interfaces", "0644"),
    model.NetworkTool.NETWORKD: _InstalledTool(
        "network-networkd.network.j2", "/etc/systemd/network/05-atlantis.network", "0644"
    ),
}


@dataclass(frozen=True, slots=True)
class _LanPart:
    """Values for the network templates."""

    interface: str
    address: str
    """Address with the prefix length of the LAN."""
    gateway: str
    """Address of the site's router, which is also the DNS server."""
    domain: str
    dhcp: bool


@dataclass(frozen=True, slots=True)
class NetworkPart:
    """Parameters of `atlantis.netcfg.network`, except its action."""

    by: str
    interface: str
    address: str
    gateway: str
    path: str
    content: str
    mode: str
    resolver: str | None
    """Content of /etc/resolv.conf if no other program writes it; None: provided by DHCP."""
    replaces: tuple[str, ...]
    rollback_s: int

    def as_dict(self) -> dict[str, Any]:
        """Return JSON-able data; omitted keys have the module's default."""
        values = asdict(self) | {"replaces": list(self.replaces)}
        return {key: value for key, value in values.items() if value is not None}


def computer_network(inventory: Inventory, host: Host) -> NetworkPart | None:
    """Build the network part (pure); None if the inventory has none: the image's network is then kept."""
    device = host.device
    assert isinstance(device, model.SiteComputer)  # noqa: S101 - callers choose computers
    if device.network is None:
        return None
    site = inventory.sites[host.site].lan
    lan = _LanPart(
        interface=device.network.interface,
        address=f"{device.address}/{site.network.prefixlen}",
        gateway=str(site.gateway),
        domain=site.domain,
        dhcp=device.image is not None and device.image.address_by is model.AddressBy.DHCP,
    )
    tool = _TOOLS[device.network.by]
    return NetworkPart(
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


def _text(template: str, lan: _LanPart) -> str:
    return environment().get_template(f"gateway/{template}").render(lan=lan)
