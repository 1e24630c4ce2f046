"""The words in which the parts of a computer are told to the modules `configure` and `packages` of the collection.

Part `network` of a computer: the interface of the LAN, in the language of the tool that configures it.

The files have the names and say the words that `provision image` gives a card, so that a fresh computer is as declared.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields, replace
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.desired_state import (
    Brought,
    Check,
    ConvergeStep,
    DesiredState,
    Directory,
    File,
    SymbolicLink,
    Unit,
    WayIn,
)
from atlantis_netcfg.inventory import model
from atlantis_netcfg.routeros.render import environment

if TYPE_CHECKING:
    from atlantis_netcfg.inventory import Declaration, Host

__all__ = ["Brought", "Check", "ConvergeStep", "Directory", "File", "SymbolicLink", "Unit", "WayIn"]


@dataclass(frozen=True, slots=True)
class Package:
    """A Debian package; `version` None takes what the archive has."""

    name: str
    version: str | None = None


def run_on(file: str, *program: str) -> tuple[str, ...]:
    """What a step runs with a file as its last argument: nothing where the file has been taken away."""
    return ("sh", "-c", '[ ! -e "$1" ] || { file="$1"; shift; exec "$@" "$file"; }', "sh", file, *program)


class Configuration(DesiredState):
    """The parameters of `atlantis.netcfg.configure`."""

    def merge(self, more: Configuration) -> Configuration:
        """Both in one round of the link; the way in stays this one's."""
        lists = (item.name for item in fields(self) if item.name != "way_in")
        both: dict[str, Any] = {name: (*getattr(self, name), *getattr(more, name)) for name in lists}
        return replace(self, **both)

    def as_dict(self) -> dict[str, Any]:
        """As JSON-able data; what is left out is the module's default."""
        return {key: _plain(value) for key, value in asdict(self).items() if value}


def _plain(result: Any) -> Any:  # noqa: ANN401 - JSON
    """Lists for tuples, and no keys without a value."""
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
    """What the templates see."""

    interface: str
    address: str
    """With the LAN's prefix length."""
    gateway: str
    """The site's router; it also answers DNS."""
    domain: str
    dhcp: bool


@dataclass(frozen=True, slots=True)
class NetworkPart:
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


def computer_network(declaration: Declaration, host: Host) -> NetworkPart | None:
    """Pure. None where no network is declared: it then stays as the image has it."""
    device = host.device
    assert isinstance(device, model.SiteComputer)  # noqa: S101 - callers choose computers
    if device.network is None:
        return None
    site = declaration.sites[host.site].lan
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
