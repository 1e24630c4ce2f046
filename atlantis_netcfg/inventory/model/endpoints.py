"""Probes of a vehicle's (or location's) endpoints before a test; a person confirms omitted ones.

They are in `endpoints` of a vehicle and of a site's `location`, one key for each column of Table 3 that a program can
check. Satellite and 4G have no key: they are links of a site. Table 3 defines which endpoints a vehicle has.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Literal, Self

from pydantic import Field, StrictBool, StrictFloat, StrictInt, model_validator

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory.model import _base
from atlantis_netcfg.inventory.model.computer import Interface

Port = Annotated[StrictInt, Field(ge=1, le=65535)]


class SeenFrom(StrEnum):
    """From where a probe runs."""

    GATEWAY = "gateway"
    """The site's gateway computer, over SSH."""
    LAPTOP = "laptop"
    """The technician's computer, in the site's LAN."""


class _EndpointModel(_base.Model):
    seen_from: SeenFrom = SeenFrom.GATEWAY
    """Where the probe stands."""
    address: _base.Address | None = None
    """None: that of the site's DHCP reservation with the vehicle's key, for it has another one at each site."""


class WifiRole(StrEnum):
    """Which side of the association the vehicle is."""

    ACCESS_POINT = "access_point"
    """As the report has it for AUVs: the gateway is associated with the vehicle, on the surface only (2.2.2)."""
    STATION = "station"
    """The vehicle is associated with an access point of the site."""


class WifiClient(_base.Model):
    """The address of the gateway's radio in the network of a vehicle's access point."""

    network: _base.Network
    """Of the access point: no other network of the pilot."""
    address: _base.Address
    """Of the gateway in it."""


class WifiEndpoint(_EndpointModel):
    """The vehicle's own Wi-Fi."""

    role: WifiRole
    """Which side of the association the vehicle is."""
    interface: Interface = "wlan0"
    """Of the gateway, where the vehicle is the access point: each of its radios hears one of them at a time."""
    ssid: _base.Ssid | None = None
    """Name of the network; None: any."""
    key: _base.SecretText | None = None
    """Passphrase of the vehicle's access point: the gateway's radio joins it. None: a person configures the radio."""
    wpa: Literal["wpa2", "wpa3"] = "wpa2"
    """How the access point of `key` protects its network."""
    client: WifiClient | None = None
    """With `key`: the address of the gateway's radio; None: the vehicle's DHCP server gives it one."""
    mac: _base.MacAddress | None = None
    """Of the vehicle's radio; None: whoever has the address is believed."""
    seen_by: _base.HostName | None = None
    """Vehicle as station: RouterOS device whose registration table lists it; None: the site's router, if it has one."""
    low_dbm: Annotated[StrictFloat, Field(ge=-100, le=0)] = -75.0
    """Weaker is poor."""
    high_dbm: Annotated[StrictFloat, Field(ge=-100, le=0)] = -35.0
    """Stronger overdrives the receiver."""
    loss_percent: Annotated[StrictFloat, Field(ge=0, le=100)] = 5.0
    """So many of a hundred pings may be lost."""
    rate_mbps: Annotated[StrictFloat, Field(gt=0)] | None = None
    """The association's rate must not be lower, as the gateway or the router tells it."""

    @model_validator(mode="after")
    def _check_bounds(self) -> Self:
        if self.low_dbm >= self.high_dbm:
            raise _base.wrong(
                msg(f"`low_dbm: {arg(self.low_dbm):g}` is not below `high_dbm: {arg(self.high_dbm):g}`"), "-75 and -35"
            )
        return self


class AcousticDriver(StrEnum):
    """Modems that can be read without disturbing them."""

    EVOLOGICS = "evologics"
    """EvoLogics S2C: AT queries over TCP."""
    SEATRAC = "seatrac"
    """Blueprint SeaTrac: framed commands over TCP (a serial server) or a serial port."""


class _ModemEndpoint(_EndpointModel):
    driver: AcousticDriver
    """What the modem speaks."""
    port: Port = 9200
    """TCP port of the modem, or of its serial server."""
    device: _base.Text | None = None
    """Serial port of the computer in `seen_from`, in place of address and port: `/dev/ttyUSB0`."""
    baud: Annotated[StrictInt, Field(ge=1200, le=921600)] | None = None
    """None: 19200 for EvoLogics, 115200 for SeaTrac."""


class AcousticEndpoint(_ModemEndpoint):
    """The vehicle's acoustic modem."""

    acoustic_address: Annotated[StrictInt, Field(ge=1, le=254)] | None = None
    """EvoLogics: Local Address. SeaTrac: beacon id, 1 to 15. None: whatever it says, as long as it is the only one."""
    partner: Annotated[StrictInt, Field(ge=1, le=254)] | None = None
    """Acoustic address to which the active check sends one message, in water and with consent; None: none is sent."""


class UsblEndpoint(_ModemEndpoint):
    """A modem that reports positions: the vehicle's own, or one of the site that receives the vehicle."""

    hears: tuple[Annotated[StrictInt, Field(ge=1, le=254)], ...] = ()
    """Acoustic addresses whose fixes are expected; none: anybody's."""
    listen_s: Annotated[StrictFloat, Field(ge=1, le=600)] = 30.0
    """How long fixes are listened for, in seconds."""
    max_age_s: Annotated[StrictFloat, Field(gt=0)] = 10.0
    """Age of the last fix at the end of the listening."""
    ping: Annotated[StrictInt, Field(ge=1, le=15)] | None = None
    """SeaTrac: beacon that the active check pings, in water and with consent; None: nobody is pinged."""


class RcRfEndpoint(_EndpointModel):
    """The remote control of a vehicle whose autopilot speaks MAVLink; for any other a person confirms it.

    The companion computer forwards the stream by UDP: the autopilot's own port is never opened.
    """

    port: Port = 14550
    """UDP port on which the stream arrives at the computer in `seen_from`."""
    system_id: Annotated[StrictInt, Field(ge=1, le=255)] = 1
    """Of the autopilot, as MAVLink numbers it."""
    rssi_low: Annotated[StrictInt, Field(ge=0, le=254)] | None = None
    """Baseline of this very vehicle: scales differ, so none is compared with another's. None: steady is enough."""


class GpsDriver(StrEnum):
    """Where positions come from."""

    GPSD = "gpsd"
    NMEA_TCP = "nmea_tcp"
    NMEA_SERIAL = "nmea_serial"
    ROUTEROS = "routeros"
    """The receiver of a RouterOS device (`seen_by`)."""


class GpsEndpoint(_EndpointModel):
    """A GNSS receiver."""

    driver: GpsDriver
    """Where positions come from."""
    port: Port | None = None
    """None: 2947 for gpsd (IANA), 10110 for NMEA over TCP (IANA, nmea-0183)."""
    device: _base.Text | None = None
    """Serial port, for `nmea_serial`."""
    baud: Annotated[StrictInt, Field(ge=1200, le=921600)] = 9600
    """Of the serial port, for `nmea_serial`."""
    seen_by: _base.HostName | None = None
    """For `routeros`; None: the site's router."""
    clear_sky: StrictBool = True
    """False where the antenna may be under a roof at the check: no fix is then no failure."""
    reports: Annotated[StrictInt, Field(ge=2, le=100)] = 5
    """Consecutive positions that have to agree with each other and with the geofence."""
    max_age_s: Annotated[StrictFloat, Field(gt=0, le=60)] = 3.0
    """Older positions count as none, in seconds."""

    @model_validator(mode="after")
    def _require_serial_device(self) -> Self:
        if self.driver is GpsDriver.NMEA_SERIAL and self.device is None:
            raise _base.wrong("`driver: nmea_serial` needs the path of the port", "device: /dev/ttyUSB0")
        return self


class EthernetEndpoint(_EndpointModel):
    """A vehicle, or its operator's computer, on the site's cable."""

    seen_by: _base.HostName | None = None
    """Router whose port is looked at, if `router_port` is given; None: the site's."""
    router_port: _base.Text | None = None
    """Port of that router where the cable is plugged in: link, speed and errors are read."""
    mac: _base.MacAddress | None = None
    """Of the vehicle's card; None: whoever has the address is believed."""
    loss_percent: Annotated[StrictFloat, Field(ge=0, le=100)] = 0.0
    """So many of a hundred pings may be lost."""


class Endpoints(_base.Model):
    """What a program can check; a column of Table 3 that is missing here is confirmed by a person."""

    wifi: WifiEndpoint | None = None
    acoustic: AcousticEndpoint | None = None
    usbl: UsblEndpoint | None = None
    rc_rf: RcRfEndpoint | None = None
    gps: GpsEndpoint | None = None
    ethernet: EthernetEndpoint | None = None
