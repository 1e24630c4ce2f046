"""What the engine, a rehearsal and first contact ask about a device, whatever kind it is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Collection

    from atlantis_netcfg.declaration import Declaration, Host
    from atlantis_netcfg.declaration.model import Access
    from atlantis_netcfg.emulator.routeros import ModemSpec
    from atlantis_netcfg.render import Prerequisite

__all__ = ["Hardware", "Managed", "Place", "Text"]


@dataclass(frozen=True, slots=True)
class Text:
    """One desired text of a device."""

    text: str
    """Secrets in clear: never print it."""
    radio: str = ""
    """Menu in which the device has to have its radio for this text to be the right one; empty: it is the only text."""


@dataclass(frozen=True, slots=True)
class Place:
    """By which port and address the device is managed, as the adopted device has it."""

    address: str
    """With prefix length."""
    port: str
    """By its factory name."""
    technician: str
    """Where the packets come from: the laptop, or the router that it stands behind."""


@dataclass(frozen=True, slots=True)
class Hardware:
    """What an emulated device of this kind is made of; names are factory names."""

    ports: tuple[str, ...]
    poe_ports: tuple[str, ...] = ()
    radios: tuple[str, ...] = ()
    modem: ModemSpec | None = None
    packages: tuple[str, ...] = ("routeros",)
    board: str = "RB5009UPr+S+"


@dataclass(frozen=True, slots=True)
class Managed(ABC):
    """A declared device that the RouterOS engine brings to its declared state. A kind of device is a subclass."""

    declaration: Declaration
    host: Host

    @staticmethod
    @abstractmethod
    def takes(host: Host) -> bool:
        """Tell whether a host is of this kind."""

    @property
    @abstractmethod
    def access(self) -> Access:
        """Address, port, user and password, and the bearer that leads there."""

    @abstractmethod
    def texts(self) -> tuple[Text, ...]:
        """Render what the device should hold; more than one where the device decides which fits. Raises RenderError."""

    @abstractmethod
    def prerequisites(self) -> tuple[Prerequisite, ...]:
        """Say what must be on the device before a text can be written."""

    @property
    @abstractmethod
    def place(self) -> Place:
        """Where it is managed."""

    @property
    @abstractmethod
    def hardware(self) -> Hardware:
        """What its twin is made of."""

    def unfit(self, radios: Collection[str]) -> tuple[str, str]:
        """Say why none of the texts fits a device with radios in these menus, and what to do about it."""
        there = " and ".join(sorted(radios)) or "no radio"
        return f"{self.host.name} has {there}, for which nothing is declared", "correct its host_vars file"

    @property
    def certificates(self) -> tuple[str, ...]:
        """Names of the certificates that its text refers to."""
        return tuple(one.name for one in self.prerequisites() if one.menu == "/certificate")
