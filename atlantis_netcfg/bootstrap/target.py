"""Types of first contact: the target state, the facts read, the routes to the console, the result."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from ipaddress import IPv4Interface
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Mapping
    from datetime import datetime

    from atlantis_netcfg.console.types import Console
    from atlantis_netcfg.core.secret import Secret
    from atlantis_netcfg.core.versions import Version
    from atlantis_netcfg.rsc import Export

Row = dict[str, str]

FACTORY_ADDRESS = "192.168.88.1"
FACTORY_USER = "admin"
CERTIFICATE = "atlantis-api"
MARK = "atlantis: management"
"""Comment of the management address."""
TEMPORARY = "atlantis: first contact"
"""Comment of what lives only until first contact is over."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """The "adopted" state of one router, from its declaration."""

    name: str
    user: str
    password: Secret
    address: str
    """On the management port, with prefix length."""
    technician: str
    """The laptop's own address in the management network."""
    port: str
    """The management port, by its factory name."""
    ports: tuple[str, ...]
    """All declared ports, by their factory names."""
    model: str | None = None
    api_port: int = 8729
    features: Mapping[str, str] = field(default_factory=dict)
    """Features of device-mode that the declared text needs, each with the menu that needs it."""
    radio: bool = False
    """Whether the declared text configures a wireless interface."""
    certificates: tuple[str, ...] = (CERTIFICATE,)
    """Certificates that the declared text refers to; somebody may have imported them already."""

    @property
    def host(self) -> str:
        """The management address without its prefix length."""
        return str(IPv4Interface(self.address).ip)

    @property
    def laptop(self) -> str:
        """What the technician types into the laptop's network settings."""
        return f"{self.technician}/{IPv4Interface(self.address).network.prefixlen}"


class DeviceState(StrEnum):
    """Whose the device is."""

    FACTORY = "factory-fresh"
    HALF = "half adopted by an earlier run"
    ADOPTED = "adopted"
    SOMEONES = "configured by somebody"


@dataclass(frozen=True, slots=True, kw_only=True)
class Facts:
    """What a device says about itself on its console."""

    version: Version
    board: str
    architecture: str
    packages: tuple[str, ...]
    device_mode: Mapping[str, str] | None
    """None where there is no device-mode."""
    now: datetime | None
    """Its clock; None if it could not be read."""
    users: tuple[Row, ...]
    certificates: tuple[Row, ...]
    services: tuple[Row, ...]
    ethernets: tuple[Row, ...]
    rows: Mapping[str, tuple[Row, ...]]
    """Rows of the menus that a default configuration fills, by menu."""
    export: Export
    text: str
    """The export as it was printed, without secrets."""


class ConsoleRoute(Protocol):
    """A way to a device's console."""

    label: str
    """As a person would say it: an address, or a serial line."""
    serial: bool

    def open(self, user: str, password: Secret) -> Console:
        """Log in. Raises ConsoleUnreachable, LoginFailed, HostKeyChanged, ConsoleLost."""

    def prove(self, pin: str) -> None:
        """Log in by api-ssl as our user, under this certificate alone. Raises ConsoleUnreachable, NetcfgError."""

    def meet(self) -> None:
        """Learn the SSH host key, without a login, if it is not known yet. Raises NetcfgError."""


class ConsoleRoutes(Protocol):
    """The two ways, and what is known of the device."""

    first: ConsoleRoute
    """Where the technician has plugged in."""
    final: ConsoleRoute
    """The management address."""

    @property
    def host_key(self) -> str | None:
        """The host key that the device has shown; None as long as nobody came by SSH."""


class Status(StrEnum):
    """How first contact ended."""

    ALREADY = "unchanged"
    PLANNED = "planned"
    ADOPTED = "changed"


@dataclass(frozen=True, slots=True)
class Adopted:
    """What came of it; `notes` say what nobody has verified, and what to do now."""

    status: Status
    standing: DeviceState
    steps: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    facts: Facts | None = None
