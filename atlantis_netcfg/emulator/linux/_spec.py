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
    """With its prefix length: `10.64.1.10/24`."""
    lease_s: int | None = None
    """What is left of its lease: leased addresses are `dynamic`; None: it is permanent."""

    @model_validator(mode="after")
    def _address(self) -> Self:
        IPv4Interface(self.address)
        return self


class AssociationSpec(_Spec):
    """Association of a wireless interface."""

    ssid: str
    bssid: str
    signal_dbm: int = -52
    chains_dbm: tuple[int, ...] = (-54, -55)
    """Of each antenna; none: the driver does not tell."""
    rate_mbps: float = 54.0
    """Of both directions."""
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
    """None: a tunnel has none."""
    addresses: tuple[AddressSpec, ...] = ()
    up: bool = True
    """False: no cable, no association."""
    mtu: int = 1500
    wireless: bool = False
    type: str = "managed"
    """Of a wireless one: `managed`, `AP`, `monitor`."""
    association: AssociationSpec | None = None
    """Of a wireless one; None: it is associated with nobody. Of an access point: the network that it opens."""
    stations: tuple[AssociationSpec, ...] = ()
    """Of an access point: who has joined it."""
    rx_errors: int = 0
    tx_errors: int = 0


class RouteSpec(_Spec):
    """A configured route; routes of the addresses are added automatically."""

    to: str = "default"
    via: str | None = None
    dev: str
    protocol: str = "static"
    """`static`, `dhcp`, `boot` (of a command `ip route add`)."""
    metric: int | None = None


class NeighbourSpec(_Spec):
    """An entry of the neighbour table."""

    address: str
    dev: str
    mac: str | None
    """None: nobody has answered."""
    state: str = "REACHABLE"


class EchoSpec(_Spec):
    """Ping responses of an address."""

    loss_percent: float = Field(default=0, ge=0, le=100)
    rtt_ms: float = Field(default=1.5, ge=0)


class TimeSpec(_Spec):
    """The clock and its time source."""

    zone: str = "Europe/Lisbon"
    offset_s: float = 0.0
    """How far its clock is ahead of the right time."""
    is_synchronised: bool = True
    ntp: bool = True
    """Whether something is switched on that sets the clock."""
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
    """The name that it gives itself."""
    rtt_ms: float = Field(default=62.0, ge=0)
    loss_percent: float = Field(default=0, ge=0, le=100)
    arrives_by: str = "tun0"
    """The interface by which the messages reach it, as it says."""


class DdsSpec(_Spec):
    """A DDS participant that responds to announcements sent to an address of the computer."""

    domain: int = Field(default=0, ge=0, le=101)
    addresses: tuple[str, ...]
    """At which it says that it is reached: that of the loopback alone is of no use to anybody else."""


class OfferSpec(_Spec):
    """Offer of a DHCP server on a segment."""

    server: str
    mac: str
    address: str
    router: str | None = None
    knows: tuple[str, ...] = ()
    """It answers these cards and nobody else; none: everybody."""


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
    """Address to how it answers; whoever is not named does not."""
    time: TimeSpec = TimeSpec()
    country: str = "PT"
    """Regulatory domain of its radios; `00` is that of a board where nobody has set one."""
    files: dict[str, str] = Field(default_factory=dict)
    """Path to text. `/proc/net/udp` is made from `udp`."""
    unreadable_paths: tuple[str, ...] = ()
    """Paths that are there, and may not be read."""
    certificates: dict[str, tuple[CertificateSpec, ...]] = Field(default_factory=dict)
    """Path to the certificates in that file, beside which it has a key of OpenVPN's own."""
    udp: tuple[UdpSpec, ...] = ()
    dds: tuple[DdsSpec, ...] = ()
    """Participants that answer; that their ports are bound, `udp` says."""
    reflectors: dict[str, ReflectorSpec] = Field(default_factory=dict)
    """Address to who answers messages there; whoever is not named does not."""
    dhcp: dict[str, tuple[OfferSpec, ...]] = Field(default_factory=dict)
    """Interface to the servers that answer on its segment."""
    routers: dict[str, tuple[AdvertisementSpec, ...]] = Field(default_factory=dict)
    """Interface to the IPv6 routers that answer on its segment."""
    kernel: str = "6.1.0-28-arm64"
    """Its release, as `uname -r` prints it."""
    machine: str = "aarch64"
    packages: dict[str, str] = Field(default_factory=dict)
    """Installed package to its version; dpkg knows no other."""
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
