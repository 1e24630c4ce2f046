"""The device at one moment, with queries about the path between technician and router."""

from __future__ import annotations

from dataclasses import dataclass
from ipaddress import IPv4Address, IPv4Interface, IPv4Network, ip_interface
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import DeviceError
from atlantis_netcfg.routeros import menus

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from atlantis_netcfg.routeros._types import Row

INTERFACES = ("/interface/ethernet", "/interface/bridge", "/interface/ovpn-client")


@dataclass(frozen=True, slots=True)
class ManagementPath:
    """The path of our session: from the technician's address to a service on one of the router's addresses."""

    technician: str
    """The technician's address, as the router sees it (`/user/active`)."""
    local: str
    """The router's address in our session."""
    service: str = "api-ssl"
    user: str = "provision"


def is_set(row: Row, flag: str) -> bool:
    """Return True if a flag of a row is set; an omitted flag is false."""
    return menus.canonical(menus.PropertyKind.BOOLEAN, row.get(flag, "no")) == "yes"


@dataclass(frozen=True)
class State:
    """Rows of the device, with queries shared by several checks."""

    rows: Mapping[str, tuple[Row, ...]]
    path: ManagementPath

    def all(self, menu: str) -> tuple[Row, ...]:
        """Return the rows of a menu; none if it was not read."""
        return self.rows.get(menu, ())

    def enabled_rows(self, menu: str) -> Iterator[Row]:
        """Yield the rows of a menu that are not disabled."""
        return (row for row in self.all(menu) if not is_set(row, "disabled"))

    def find(self, menu: str, name: str, value: str) -> Row | None:
        """Return the row of a menu with that value, without the sessions listed in `/ip service` from 7.19 on."""
        return next((row for row in self.all(menu) if row.get(name) == value and not is_set(row, "dynamic")), None)

    @property
    def local(self) -> IPv4Address:
        """The router's address that our session uses."""
        return _message(self.path.local)

    @property
    def technician(self) -> IPv4Address:
        """The address of our end of the session."""
        return _message(self.path.technician)

    def address_row(self) -> Row | None:
        """Return the row with the router's address that we use; an enabled one if there are several."""
        rows = [
            row for row in self.all("/ip/address") if (interface := interface_of(row)) and interface.ip == self.local
        ]
        return min(rows, key=lambda row: is_set(row, "disabled"), default=None)

    def interface(self, name: str) -> tuple[str, Row] | None:
        """Return the menu and row of an interface; None for kinds whose menu we do not read."""
        for menu in INTERFACES:
            if row := self.find(menu, "name", name):
                return menu, row
        return None

    def is_up(self, name: str) -> bool:
        """Return True if an interface can have addresses: neither disabled nor a bridge port."""
        interface = self.interface(name)
        return (interface is None or not is_set(interface[1], "disabled")) and self.bridge_of(name) is None

    def bridge_of(self, name: str) -> str | None:
        """Return the bridge that the interface is a port of; None if it is not."""
        ports = (row for row in self.enabled_rows("/interface/bridge/port") if row.get("interface") == name)
        return next((row["bridge"] for row in ports if "bridge" in row), None)

    def ports(self, name: str) -> frozenset[str]:
        """Return the physical interfaces that lead to `name`, by identities that do not change on renaming."""
        interface = self.interface(name)
        if interface is None:
            return frozenset({name})
        menu, row = interface
        if not self.is_up(name):
            return frozenset()
        if menu != "/interface/bridge":
            return frozenset({identity(menu, row)})
        members = [
            port["interface"] for port in self.enabled_rows("/interface/bridge/port") if port.get("bridge") == name
        ]
        return frozenset(self._port_identity(member) for member in members if self._is_enabled(member))

    def _port_identity(self, name: str) -> str:
        interface = self.interface(name)
        return identity(*interface) if interface is not None else name

    def _is_enabled(self, name: str) -> bool:
        interface = self.interface(name)
        return interface is None or not is_set(interface[1], "disabled")

    def connected_networks(self) -> Iterator[tuple[IPv4Network, str]]:
        """Yield the directly connected networks with their interfaces."""
        for row in self.enabled_rows("/ip/address"):
            interface = interface_of(row)
            if interface is not None and self.is_up(row.get("interface", "")):
                yield _network(interface, row.get("network", "")), row.get("interface", "")


def identity(menu: str, row: Row) -> str:
    """Return an identity of an interface that does not change on renaming."""
    return row.get("default-name") or row.get(".id") or menus.MENUS[menu].name_of(row)


def interface_of(row: Row) -> IPv4Interface | None:
    """Return the address of a row of `/ip/address`, or None if it is none of IPv4."""
    try:
        interface = ip_interface(row.get("address", ""))
    except ValueError:
        return None
    return interface if isinstance(interface, IPv4Interface) else None


def _network(interface: IPv4Interface, far_end: str) -> IPv4Network:
    """Return the network; a /32 with another address as network is a point-to-point link to that address."""
    if interface.network.prefixlen == interface.max_prefixlen and far_end:
        return IPv4Network(far_end)
    return interface.network


def _message(address: str) -> IPv4Address:
    """Parse an end of our own session as shown by the device. Raises DeviceError if it is not an address."""
    try:
        return IPv4Address(address)
    except ValueError:
        raise DeviceError(
            "the device does not show the addresses of our own session, so no plan can be made",
            hint="check `/user active print` on its own console: it must show the session",
        ) from None
