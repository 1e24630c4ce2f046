"""The devices of a site, by `kind`: `host_vars/<host>.yml`, key `device`."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Literal

from pydantic import Field, StrictBool, StrictInt

from atlantis_netcfg.inventory.model import _base, computer


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


class Sim(_base.Model):
    """The SIM and its subscription, from the contract."""

    apn: _base.Text | None = None
    """None leaves the network's own default."""
    user: _base.Text | None = None
    """Of the access point, where the contract names one."""
    password: _base.SecretText | None = None
    """Of that user. Vaulted, or EXAMPLE-…."""
    pin: _base.SecretText | None = None
    """Four to eight digits; only ever tried once, because three wrong ones lock the SIM."""
    roaming: StrictBool = False
    """Whether the subscription may be used in foreign networks, where it may cost more."""
    bands: tuple[Annotated[StrictInt, Field(ge=1, le=256)], ...] = ()
    """LTE bands (3GPP TS 36.101) that the unit is held to; none: all that it has."""


class LteAccess(_base.Model):
    """How the toolkit reaches the unit's own interface."""

    user: _base.Text
    """RouterOS: in group `full`; RutOS: a user that may only read."""
    password: _base.SecretText
    """Of `user`. Vaulted, or EXAMPLE-…."""
    port: Annotated[StrictInt, Field(ge=1, le=65535)] | None = None
    """None: 8729 with RouterOS, 443 with RutOS."""
    fingerprint: _base.Fingerprint | None = None
    """Of its certificate; None: it is known on this computer alone, by `provision device trust`."""
    host_key: _base.HostKey | None = None
    """Of its SSH server; None: it is known on this computer alone, by `provision device trust`."""
    admin_user: _base.Text | None = None
    """RutOS: who may set things over SSH; None: settings are only checked."""
    admin_password: _base.SecretText | None = None
    """Of `admin_user`. Vaulted, or EXAMPLE-…."""


class LteRouter(_base.Box):
    """The outdoor 3G/4G unit, or the modem that stands in its place."""

    kind: Literal["lte_router"]
    """What the device is: it decides which keys the block has."""
    address: _base.Address
    """In the network of its link."""
    driver: LteDriver = LteDriver.MANUAL
    """How the unit is spoken to."""
    access: LteAccess | None = None
    """Drivers `routeros` and `rutos`."""
    host: _base.HostName | None = None
    """Drivers `modemmanager` and `at`: the Linux host that has the modem; None: the computer that runs `provision`."""
    serial: _base.Text | None = None
    """Driver `at`: the serial port at that host, like /dev/ttyUSB2."""
    sim: Sim = Sim()


class PtpMode(StrEnum):
    """Which end of the bridge."""

    ACCESS_POINT = "access_point"
    STATION = "station"


class PtpProtocol(StrEnum):
    """RouterOS' words for `wireless-protocol`."""

    IEEE_80211 = "802.11"
    NSTREME = "nstreme"
    NV2 = "nv2"


class RadioMenus(StrEnum):
    """Which of RouterOS' two families of radio menus the device has."""

    AUTO = "auto"
    """What the device has; asked when it is read."""
    WIRELESS = "wireless"
    """The package `wireless`: nv2, nstreme and 802.11."""
    WIFI = "wifi"
    """The packages `wifi-qcom` and `wifi-qcom-ac`: 802.11 only."""


class SignalBounds(_base.Model):
    """Lowest and highest acceptable signal level of the other end; a receiver is also disturbed by too much."""

    weakest_dbm: Annotated[StrictInt, Field(ge=-95, le=-30)] = -75
    """Weaker than this is poor, in dBm."""
    strongest_dbm: Annotated[StrictInt, Field(ge=-60, le=-10)] = -35
    """Stronger than this overdrives the receiver, in dBm."""


class Ptp(_base.WifiRadio):
    """Radio settings of one end; both ends must agree."""

    peer: _base.HostName
    """The CPE at the other end."""
    mode: PtpMode
    """Which end it is: one of each."""
    protocol: PtpProtocol
    """What the radios speak: RouterOS' `wireless-protocol`."""
    menus: RadioMenus = RadioMenus.AUTO
    """RouterOS' family of radio menus; it is read from the device if left out."""
    distance_m: Annotated[StrictInt, Field(ge=1, le=50_000)] | None = None
    """Between the ends."""
    signal: SignalBounds = SignalBounds()
    link_timeout_s: Annotated[StrictInt, Field(ge=60, le=1800)] = 300
    """When both ends change: if the link is not back after so long they return to what they were."""


class RouterAccessPoint(_base.WifiRadio):
    """The router's own radio, by which vehicles that are stations get into the site's LAN."""

    menus: Literal["wifi", "wireless"] = "wifi"
    """RouterOS' family of radio menus that it has: `wifi` with a package `wifi-qcom`, or the older `wireless`."""
    isolated: StrictBool = True
    """Stations do not reach one another through it; what they say to the rest of the LAN is not filtered."""


class Cpe(_base.Box):
    """One end of the directional Wi-Fi bridge."""

    kind: Literal["cpe"]
    """What the device is: it decides which keys the block has."""
    access: _base.Access
    port: _base.PortName = "ether1"
    """The port of the cable to the router, by its factory name; power comes in by it, too."""
    ptp: Ptp


class PoeMode(StrEnum):
    """RouterOS' words (MikroTik manual, PoE-Out)."""

    AUTO_ON = "auto-on"
    FORCED_ON = "forced-on"
    OFF = "off"


class Poe(_base.Model):
    """Power on a port; 0 is the last to be cut when power is short."""

    out: PoeMode = PoeMode.AUTO_ON
    """RouterOS' `poe-out`."""
    priority: Annotated[StrictInt, Field(ge=0, le=99)] = 10
    """RouterOS' `poe-priority`."""


class PortUse(StrEnum):
    """What a port of the router is for."""

    LAN = "lan"
    LINK = "link"
    MANAGEMENT = "management"
    OFF = "off"


class Port(_base.Model):
    """One Ethernet port of the router."""

    name: _base.PortName
    """The factory name (`default-name`), like ether1."""
    use: PortUse
    """What is plugged in."""
    link: _base.Name | None = None
    """With `use: link`: the bearer or served link on it."""
    poe: Poe | None = None
    """Only for ports that can feed power."""


class VpnClient(_base.Model):
    """The router itself is the site's end of the VPN."""

    certificate: _base.Text
    """Name of the client certificate on the device."""
    user: Annotated[_base.Text, Field(max_length=27)]
    """RouterOS sends one even with certificates, 27 characters at most (MikroTik manual, OpenVPN)."""
    password: _base.SecretText
    """Vaulted, or EXAMPLE-…."""
    address: _base.Address
    """Its fixed tunnel address, inside the infrastructure pool."""


class Forward(_base.Model):
    """A port of the public address that leads to a host of the LAN."""

    transport: _base.Transport
    """Of the port."""
    port: Annotated[StrictInt, Field(ge=1, le=65535)]
    """The same outside and inside."""
    to: _base.HostName
    """A host of the site's LAN."""


class Router(_base.Box):
    """The MikroTik router of a site."""

    kind: Literal["router"]
    """What the device is: it decides which keys the block has."""
    access: _base.Access
    ports: Annotated[tuple[Port, ...], Field(min_length=2)]
    """Every port of the box, also those that are off."""
    vpn_client: VpnClient | None = None
    """None where another host is the site's end of the VPN."""
    access_point: RouterAccessPoint | None = None
    """None: it has no radio, or one that nobody uses."""
    forwards: tuple[Forward, ...] = ()
    """What the public address lets in."""


class SwitchPortUse(StrEnum):
    """What a port of a switch is for."""

    UPLINK = "uplink"
    LAN = "lan"
    OFF = "off"


class SwitchPort(_base.Model):
    """One Ethernet port of a switch."""

    name: _base.PortName
    """The factory name (`default-name`), like ether1."""
    use: SwitchPortUse
    """`uplink`: the cable to the site's router, or to another switch on the way to it."""
    isolated: StrictBool = False
    """With `use: lan`: what is plugged in does not reach other isolated ports, nor stations of an isolated radio."""
    poe: Poe | None = None
    """Only for ports that can feed power."""


class Switch(_base.Box):
    """A RouterOS device that bridges its ports, and its radio if it has one, into the site's LAN."""

    kind: Literal["switch"]
    """What the device is: it decides which keys the block has."""
    access: _base.Access
    ports: Annotated[tuple[SwitchPort, ...], Field(min_length=1)]
    """Every port of the box, also those that are off."""
    access_point: RouterAccessPoint | None = None
    """None: it has no radio, or one that nobody uses."""

    @property
    def uplink(self) -> str:
        """The port towards the site's router."""
        return next(port.name for port in self.ports if port.use is SwitchPortUse.UPLINK)


class TerminalEvidence(_base.Model):
    """What a person has seen on the terminal's own pages, and when."""

    firmware: _base.Text
    """As the terminal shows it."""
    backup_file: _base.Text | None = None
    """Name of the backup that the terminal exported; the file itself is looked for in `evidence/` of the inventory."""
    backup_sha256: _base.Sha256 | None = None
    """Of that file, so that a changed terminal is noticed by its next backup."""
    allow_list: StrictBool
    """Whether the terminal's own filter holds the declared destinations and nothing else."""
    sim_address: _base.Address | None = None
    """The terminal's address towards the network, if its page shows one: behind a carrier's NAT it is a private one."""
    by: _base.Text
    """Who has looked."""
    seen_on: _base.Day
    """Day, like 2026-11-21."""


class SatelliteTerminal(_base.Box):
    """The Thales VesseLINK: it has no documented machine interface, so its settings are recorded, not configured."""

    kind: Literal["satellite_terminal"]
    """What the device is: it decides which keys the block has."""
    address: _base.Address
    """In the network of its link."""
    driver: Literal["manual"] = "manual"
    """The one there is: no terminal of the pilot has a documented interface."""
    evidence: TerminalEvidence | None = None
    """None: nobody has looked yet, which every report says."""


Device = Annotated[
    Router
    | Switch
    | Cpe
    | LteRouter
    | SatelliteTerminal
    | computer.Gateway
    | computer.VpnServer
    | computer.ControlCentre
    | computer.OperatorStation,
    Field(discriminator="kind"),
]
