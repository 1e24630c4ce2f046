"""Settings of the whole pilot: time, VPN, partners, vehicles. One file of `group_vars/all/` each."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Final, Literal

from pydantic import Field, StrictBool, StrictFloat, StrictInt

from atlantis_netcfg.inventory.model import _base
from atlantis_netcfg.inventory.model.checklist import Role, VehicleChecklist
from atlantis_netcfg.inventory.model.dds import Dds, RosDistribution, TelemetryTopic
from atlantis_netcfg.inventory.model.endpoints import Endpoints
from atlantis_netcfg.inventory.model.gateways import Gateways
from atlantis_netcfg.inventory.model.qualify import Qualify
from atlantis_netcfg.inventory.model.retrieval import Retrieval


class TimeServer(_base.Model):
    """A time server by address: names do not resolve while the clock is wrong and the satellite filter is closed."""

    name: _base.Text
    """For people; devices use the address."""
    address: _base.Address
    """Of the server, reachable from every site."""


class OpenVpnVersion(StrEnum):
    """Lines of OpenVPN that a client may run. 2.4 knows the shared key (tls-crypt) alone, not tls-crypt-v2."""

    V2_4 = "2.4"
    V2_5 = "2.5"
    V2_6 = "2.6"
    V2_7 = "2.7"


class VpnService(_base.Model):
    """A service of ours that partners may use, at the tunnel address of its host."""

    name: _base.Text
    """What it is, for people."""
    host: _base.HostName
    """Computer of ours that offers it; it has a `vpn_address`."""
    transport: _base.Transport = _base.Transport.TCP
    """What the service speaks."""
    port: Annotated[StrictInt, Field(ge=1, le=65535)]
    """At which it listens."""


class Vpn(_base.Model):
    """The OpenVPN that joins sites, robots and partners."""

    server: _base.HostName
    """Host that runs the server; it stands at the SCC."""
    endpoint: _base.Address
    """Public address at which every site reaches the server."""
    endpoint_name: _base.DnsName
    """DNS name in the server's certificate; RouterOS compares it with what it connects to."""
    port: Annotated[StrictInt, Field(ge=1, le=65535)] = 1194
    """Public port of the server, the same that its own router forwards."""
    transport: _base.Transport = _base.Transport.UDP
    """`udp`, or `tcp` where a network lets nothing else out."""
    network: _base.Network
    """All tunnel addresses; the pools below and those of the partners lie inside."""
    infrastructure: _base.Network
    """Pool of routers, gateways and servers of the sites."""
    cipher: Literal["aes256-gcm", "aes128-gcm"] = "aes256-gcm"
    """RouterOS does not negotiate: both ends name the same (MikroTik manual, OpenVPN)."""
    max_clients: Annotated[StrictInt, Field(ge=1, le=1000)] = 100
    """Members that are connected at once; the server refuses more."""
    new_clients_per_10_s: Annotated[StrictInt, Field(ge=1, le=10_000)] = 100
    """First packets that the server looks at in 10 s, of members and of strangers; over UDP."""
    force_cookie: StrictBool = False
    """Whether clients must answer a cookie; routers, and OpenVPN before 2.6, get the shared key then."""
    shared_key_until: _base.Day | None = None
    """Last day (UTC) on which clients with the shared key may begin a session; null: no end. Over UDP only."""
    robot_openvpn: OpenVpnVersion | None = None
    """OpenVPN of the robots of which `vehicles` says nothing; null: that of the Ubuntu of `dds.distribution`."""
    services: tuple[VpnService, ...] = ()
    """What every partner's devices may use, besides pings and the control centre's DDS."""


class Partner(_base.Model):
    """An organisation that joins through the VPN."""

    full_name: _base.Text
    """What the organisation is called in reports."""
    vpn_pool: _base.Network
    """Tunnel addresses of its devices; inside the network of the VPN, and of nobody else."""
    sees: tuple[_base.Name, ...] = ()
    """Vehicles, besides its own devices, that its devices may reach by ping and DDS, and that may reach them."""


class VehicleKind(StrEnum):
    """The report's words for its robots, and for what they dock at."""

    AUV = "auv"
    ASV = "asv"
    UAV = "uav"
    ROV = "rov"
    DOCKING_STATION = "docking_station"
    """It has no row in Table 3 (2.2.2): its own needs no `table3_deviation`."""


class Column(StrEnum):
    """The columns of the report's Table 3, in its order."""

    WIFI = "wifi"
    ACOUSTIC = "acoustic"
    SATELLITE = "satellite"
    USBL = "usbl"
    RC_RF = "rc_rf"
    LTE = "4g"
    GPS = "gps"


ETHERNET: Final = "ethernet"
"""A column of our own beside those of Table 3: the cable of a vehicle or a location."""


class Vehicle(_base.Model):
    """A robot of the report's Table 3, under its own inventory key."""

    name: _base.Text
    """As Table 3 prints it."""
    kind: VehicleKind
    """What sort of robot it is."""
    aliases: tuple[_base.Text, ...] = ()
    """Other names that the report uses; the partner confirms them."""
    partner: _base.Name | None = None
    """Key in `partners`; null where the report does not say."""
    table3: tuple[Column, ...]
    """The X cells of its row."""
    table3_deviation: _base.Text | None = None
    """Why `table3` differs from the report; required if it does."""
    guest: StrictBool = False
    """The robot of a company that is not in the report: `table3` holds its own cells, and they are no deviation."""
    ethernet: StrictBool = False
    """Our extension, not part of Table 3: the vehicle is also reached by cable."""
    distribution: RosDistribution | None = None
    """Release of ROS 2 on its computer; null: `dds.distribution` of the pilot."""
    openvpn: OpenVpnVersion | None = None
    """OpenVPN on its computer, in quotes; null: that of the Ubuntu of its ROS 2 (foxy 2.4, humble 2.5, jazzy 2.6)."""
    telemetry: tuple[TelemetryTopic, ...] = ()
    """Topics that it publishes to the control centre all the time: for what that costs, nothing is configured by it."""
    endpoints: Endpoints = Endpoints()
    """How the pre-test checklist looks at each; what is missing, a person confirms."""
    checklist: VehicleChecklist = VehicleChecklist()
    """What it asks of this vehicle besides."""


class Guest(Vehicle):
    """A robot that is here for a while, under its own key in `guests.yml`: `provision robot invite` writes it."""

    guest: StrictBool = True
    """Stays true here."""
    partner: _base.Name
    """Key in `partners`: whose robot it is."""
    until: _base.Day
    """Its last day here, by the clocks of the pilot: no certificate of it is good for longer."""
    tested_at: Annotated[tuple[_base.Name, ...], Field(min_length=1)]
    """Sites whose checklist has it, whatever their `checklist.vehicles` lists."""


class NumberMask(StrEnum):
    """How much of a number that names a SIM or a modem (IMEI, ICCID) stands in a record."""

    FULL = "full"
    LAST4 = "last4"
    NONE = "none"


class AsBuilt(_base.Model):
    """What `provision report as-built` writes down, and the sheet of labels that it prints."""

    mask: NumberMask = NumberMask.LAST4
    """Of IMEI and ICCID: `full` hides all digits, `last4` all but the last four, `none` hides nothing."""
    label_width_mm: Annotated[StrictFloat, Field(ge=35, le=210)] = 70.0
    """Of one label; as many as have room stand side by side on A4. 70 by 36 mm are sheets of 24 labels."""
    label_height_mm: Annotated[StrictFloat, Field(ge=25, le=297)] = 36.0
    """Of one label."""


class Pilot(_base.Model):
    """Values that every site shares."""

    name: _base.Text
    """What the pilot is called in reports."""
    example_values: StrictBool
    """True while the inventory holds the shipped example values: only rehearsals may use them."""
    country: _base.Country
    """Regulatory domain of the radios, as RouterOS names it; ask its authority for national deviations.

    `later` is for other countries: rehearsals then use the European rules, and real radios are refused.
    """
    time_zone: _base.Text
    """Name of the IANA database; the clocks of all devices show it."""
    time_servers: Annotated[tuple[TimeServer, ...], Field(min_length=1)]
    """In order of preference."""
    vpn: Vpn
    dds: Dds | None = None
    """None: no profiles are made."""
    gateways: Gateways = Gateways()
    qualify: Qualify | None = None
    """None: links are not measured, and no far end is set up."""
    asbuilt: AsBuilt = AsBuilt()
    retrieval: Retrieval | None = None
    """None: no recordings are brought to the control centre."""
    roles: tuple[Role, ...] = ()
    """Who may answer or sign in the checklist, where `by` and `signed_by` name a role."""
