"""The 4G unit of a site. `host_vars/<host>.yml`, key `device`."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Literal

from pydantic import Field, StrictBool, StrictInt

from atlantis_netcfg.declaration.model._base import Address, Fingerprint, HostKey, HostName, Model, SecretText, Text
from atlantis_netcfg.declaration.model._box import Box

__all__ = ["LteAccess", "LteDriver", "LteRouter", "Sim"]


class LteDriver(StrEnum):
    """How the 4G unit is spoken to; the pilot's model is unknown."""

    ROUTEROS = "routeros"
    """A MikroTik LTE device: configured and read like any other."""
    RUTOS = "rutos"
    """A Teltonika router: read over its HTTPS interface, set over SSH."""
    MODEMMANAGER = "modemmanager"
    """A modem in a Linux host on which ModemManager owns it."""
    AT = "at"
    """A modem on a serial port that nothing owns."""
    MANUAL = "manual"
    """Anything else: a person reads its own page."""


class Sim(Model):
    """The SIM and its subscription, from the contract."""

    apn: Text | None = None
    """None leaves the network's own default."""
    user: Text | None = None
    password: SecretText | None = None
    pin: SecretText | None = None
    """Four to eight digits; only ever tried once, because three wrong ones lock the SIM."""
    roaming: StrictBool = False
    """Whether the subscription may be used in foreign networks, where it may cost more."""
    bands: tuple[Annotated[StrictInt, Field(ge=1, le=256)], ...] = ()
    """LTE bands (3GPP TS 36.101) that the unit is held to; none: all that it has."""


class LteAccess(Model):
    """How the toolkit reaches the unit's own interface."""

    user: Text
    """RouterOS: in group `full`; RutOS: a user that may only read."""
    password: SecretText
    port: Annotated[StrictInt, Field(ge=1, le=65535)] | None = None
    """None: 8729 with RouterOS, 443 with RutOS."""
    fingerprint: Fingerprint | None = None
    """Of its certificate; None: it is known on this computer alone, by `provision trust`."""
    host_key: HostKey | None = None
    """Of its SSH server; None: it is known on this computer alone, by `provision trust`."""
    admin_user: Text | None = None
    """RutOS: who may set things over SSH; None: settings are only checked."""
    admin_password: SecretText | None = None


class LteRouter(Box):
    """The outdoor 3G/4G unit, or the modem that stands in its place."""

    kind: Literal["lte_router"]
    address: Address
    """In the network of its link."""
    driver: LteDriver = LteDriver.MANUAL
    access: LteAccess | None = None
    """Drivers `routeros` and `rutos`."""
    host: HostName | None = None
    """Drivers `modemmanager` and `at`: the Linux host that has the modem; None: the computer that runs `provision`."""
    serial: Text | None = None
    """Driver `at`: the serial port at that host, like /dev/ttyUSB2."""
    sim: Sim = Sim()
