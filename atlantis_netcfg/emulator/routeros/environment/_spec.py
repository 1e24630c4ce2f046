"""The place of a router, as data."""

from __future__ import annotations

from datetime import datetime
from ipaddress import IPv4Interface
from typing import Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

__all__ = ["Around", "Called", "Load", "Validity"]


class _Spec(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Load(_Spec):
    """A box that is fed by a port."""

    milliamps: int = Field(default=180, ge=0)
    volts: float = Field(default=24.0, ge=0)
    status: str | None = None
    """In place of `powered-on`: `short-circuit`, `overload`, `current-too-low`."""


class Called(_Spec):
    """A device that tells its name by MNDP, CDP or LLDP."""

    identity: str
    interface: str
    """Of the router, on which it is heard."""
    mac: str
    address: str | None = None
    platform: str = "MikroTik"
    board: str = ""
    version: str = ""


class Validity(_Spec):
    """From when until when a certificate says that it is valid."""

    since: datetime
    until: datetime


class Around(_Spec):
    """Everything around a router; by default nothing is."""

    cards: dict[str, str] = Field(default_factory=dict)
    """Address to the MAC that answers there: they answer pings and ARP, like `neighbours` of the router's own spec."""
    called: tuple[Called, ...] = ()
    loads: dict[str, Load] = Field(default_factory=dict)
    """PoE port (factory name) to what hangs on it."""
    dhcp_servers: dict[str, tuple[str, ...]] = Field(default_factory=dict)
    """Interface to the MACs of other DHCP servers on it: `/ip/dhcp-server/alert` tells of them where it has a row."""
    leases: dict[str, str] = Field(default_factory=dict)
    """Address to the `status` of its lease; others are `waiting`."""
    tunnels: dict[str, str] = Field(default_factory=dict)
    """OpenVPN client to the address (with prefix length) that its server gives it: it is connected."""
    time_server: str | None = None
    """The time server that answers; None: none does."""
    validity: dict[str, Validity] = Field(default_factory=dict)
    """Certificate to what `/certificate` shows of its dates; the TLS of api-ssl presents it as it was made."""

    @model_validator(mode="after")
    def _addresses(self) -> Self:
        for address in self.tunnels.values():
            IPv4Interface(address)
        return self
