"""Specification of an emulated computer, as JSON-able data; healthy unless a field says otherwise."""

from __future__ import annotations

from datetime import UTC, datetime
from ipaddress import IPv4Address, IPv4Interface, IPv4Network
from typing import Self

from pydantic import BaseModel, ConfigDict, Field, model_validator


class _Spec(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class AddressSpec(_Spec):
    """An address of an interface."""

    address: str
    """Address with prefix length: `10.64.1.10/24`."""
    lease_s: int | None = None
    """Remaining lease time in seconds, with the flag `dynamic`; None: the address is permanent."""

    @model_validator(mode="after")
    def _check_address(self) -> Self:
        IPv4Interface(self.address)
        return self


class AssociationSpec(_Spec):
    """Association of a wireless interface."""

    ssid: str
    bssid: str
    signal_dbm: int = -52
    chains_dbm: tuple[int, ...] = (-54, -55)
    """Signal of each antenna; empty: the driver does not report it."""
    rate_mbps: float = 54.0
    """Rate of both directions."""
    frequency_mhz: int = 5180
    connected_s: int = 240
    inactive_ms: int = 12
    tx_packets: int = 2000
    tx_retries: int = 20
    tx_failed: int = 0


class InterfaceSpec(_Spec):
    """A network interface; every computer also has a loopback."""

    name: str
    mac: str | None = None
    """MAC address; None: a tunnel, which has none."""
    addresses: tuple[AddressSpec, ...] = ()
    up: bool = True
    """False: no cable or no association."""
    mtu: int = 1500
    wireless: bool = False
    type: str = "managed"
    """Type of a wireless interface: `managed`, `AP`, `monitor`."""
    association: AssociationSpec | None = None
    """Association of a wireless interface; None: not associated. For an access point: its own network."""
    stations: tuple[AssociationSpec, ...] = ()
    """Stations associated with an access point."""
    rx_errors: int = 0
    tx_errors: int = 0


class RouteSpec(_Spec):
    """A configured route; routes of the addresses are added automatically."""

    to: str = "default"
    via: str | None = None
    dev: str
    protocol: str = "static"
    """Origin of the route: `static`, `dhcp`, or `boot` (from a command `ip route add`)."""
    metric: int | None = None


class NeighbourSpec(_Spec):
    """An entry of the neighbour table."""

    address: str
    dev: str
    mac: str | None
    """MAC address; None: no response was received."""
    state: str = "REACHABLE"


class EchoSpec(_Spec):
    """Ping responses of an address."""

    loss_percent: float = Field(default=0, ge=0, le=100)
    rtt_ms: float = Field(default=1.5, ge=0)


class TimeSpec(_Spec):
    """The clock and its time source."""

    zone: str = "Europe/Lisbon"
    offset_s: float = 0.0
    """Seconds by which the clock is ahead of the correct time."""
    is_synchronised: bool = True
    ntp: bool = True
    """Whether a service that sets the clock is enabled."""
    chrony: bool = True
    """Whether chronyd runs."""
    server: str = "192.0.2.123"
    stratum: int = 3


class UdpSpec(_Spec):
    """A bound UDP socket."""

    port: int = Field(ge=1, le=65535)
    address: str = "0.0.0.0"  # noqa: S104 - as the table of the kernel has it; nothing is bound
    uid: int = 1000


class ReflectorSpec(_Spec):
    """Responses of another computer of the pilot to messages."""

    host: str
    """Host name in its responses."""
    rtt_ms: float = Field(default=62.0, ge=0)
    loss_percent: float = Field(default=0, ge=0, le=100)
    arrives_by: str = "tun0"
    """Interface by which messages reach it, according to its responses."""


class DdsSpec(_Spec):
    """A DDS participant that responds to announcements sent to an address of the computer."""

    domain: int = Field(default=0, ge=0, le=101)
    addresses: tuple[str, ...]
    """Addresses that it announces; a loopback address alone is useless to other computers."""


class OfferSpec(_Spec):
    """Offer of a DHCP server on a segment."""

    server: str
    mac: str
    address: str
    router: str | None = None
    knows: tuple[str, ...] = ()
    """MAC addresses to which the server responds; empty: all."""


class AdvertisementSpec(_Spec):
    """Advertisement of an IPv6 router on a segment."""

    address: str
    mac: str
    lifetime_s: int = Field(default=1800, ge=0, le=65535)
    prefixes: tuple[str, ...] = ()


class CertificateSpec(_Spec):
    """A certificate in a file."""

    subject: str
    issuer: str = "EXAMPLE VPN authority"
    not_before: datetime = datetime(2026, 1, 1, tzinfo=UTC)
    not_after: datetime = datetime(2036, 1, 1, tzinfo=UTC)


class ComputerSpec(_Spec):
    """One emulated computer: a gateway of a site, or a laptop."""

    name: str = "gateway"
    interfaces: tuple[InterfaceSpec, ...]
    routes: tuple[RouteSpec, ...] = ()
    neighbours: tuple[NeighbourSpec, ...] = ()
    echoes: dict[str, EchoSpec] = Field(default_factory=dict)
    """Address to its ping responses; other addresses do not respond."""
    time: TimeSpec = TimeSpec()
    country: str = "PT"
    """Regulatory domain of the radios; `00` is a board on which none was set."""
    files: dict[str, str] = Field(default_factory=dict)
    """Path to text. `/proc/net/udp` is derived from `udp`."""
    unreadable_paths: tuple[str, ...] = ()
    """Existing paths without read permission."""
    certificates: dict[str, tuple[CertificateSpec, ...]] = Field(default_factory=dict)
    """Path to the certificates in that file, which also contains an OpenVPN key."""
    udp: tuple[UdpSpec, ...] = ()
    dds: tuple[DdsSpec, ...] = ()
    """DDS participants that respond; their bound ports are in `udp`."""
    reflectors: dict[str, ReflectorSpec] = Field(default_factory=dict)
    """Address to the reflector that responds there; other addresses do not respond."""
    dhcp: dict[str, tuple[OfferSpec, ...]] = Field(default_factory=dict)
    """Interface to the DHCP servers that respond on its segment."""
    routers: dict[str, tuple[AdvertisementSpec, ...]] = Field(default_factory=dict)
    """Interface to the IPv6 routers that respond on its segment."""
    kernel: str = "6.1.0-28-arm64"
    """Kernel release, as printed by `uname -r`."""
    machine: str = "aarch64"
    packages: dict[str, str] = Field(default_factory=dict)
    """Installed package to its version; dpkg knows only these."""
    lacks: tuple[str, ...] = ()
    """Programs that are not installed."""

    def interface(self, name: str) -> InterfaceSpec | None:
        """Return the interface with that name."""
        return next((item for item in self.interfaces if item.name == name), None)

    def holding(self, address: str) -> InterfaceSpec | None:
        """Return the interface that has an address."""
        target = IPv4Address(address)
        return next(
            (
                interface
                for interface in self.interfaces
                if target in {IPv4Interface(a.address).ip for a in interface.addresses}
            ),
            None,
        )

    def towards(self, address: str) -> tuple[str, str | None] | None:
        """Return interface and next hop for an address; next hop None: same segment; None: no route."""
        target = IPv4Address(address)
        ways: list[tuple[IPv4Network, str, str | None]] = [
            (IPv4Interface(a.address).network, interface.name, None)
            for interface in self.interfaces
            for a in interface.addresses
        ]
        ways += [
            (IPv4Network("0.0.0.0/0" if way.to == "default" else way.to), way.dev, way.via)
            for way in sorted(self.routes, key=lambda way: way.metric or 0)
        ]
        fitting = [way for way in ways if target in way[0]]
        best = max(fitting, key=lambda way: way[0].prefixlen, default=None)
        return None if best is None else best[1:]
