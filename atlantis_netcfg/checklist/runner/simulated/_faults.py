"""Faults for a rehearsal, by name: each breaks one thing, and lists the checklist items that have to detect it.

They are made for the shipped inventory's coastal testbed; with another inventory, only those that apply are offered.

First the class of a fault, then faults of the RouterOS devices, of vehicles (receivers, acoustic modems, an autopilot),
and those visible to the gateway computer: its radios, its addresses, its clock, other hosts in the LAN.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.checklist.runner.simulated import _world, robots
from atlantis_netcfg.emulator import linux
from atlantis_netcfg.emulator.gnss import GnssAccess, Speech
from atlantis_netcfg.vpn.client import IDENTITY

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping


@dataclass(frozen=True, slots=True)
class RehearsedFault:
    """A fault set on purpose in a rehearsal."""

    words: str
    """Description for the person who trains with it."""
    turns: tuple[str, ...]
    """Items that have to detect it; `SITE` stands for the site. All others stay as they are."""
    spoil: Callable[[_world.World], None]
    """Sets the fault. Raises KeyError if the site has no such thing."""


_STRANGER = "02:00:5E:00:FC:66"


def _change_gateway(change: Callable[[linux.ComputerSpec], dict[str, Any]]) -> Callable[[_world.World], None]:
    return lambda world: world.gateway(change)


def _interface(name: str, change: Callable[[linux.InterfaceSpec], dict[str, Any]]) -> Callable[[_world.World], None]:
    """Change one interface. Raises KeyError where it is not there."""

    def update_interface(computer: linux.ComputerSpec) -> dict[str, Any]:
        if computer.interface(name) is None:
            raise KeyError(name)
        return {
            "interfaces": tuple(
                interface.model_copy(update=change(interface)) if interface.name == name else interface
                for interface in computer.interfaces
            )
        }

    return _change_gateway(update_interface)


def _change_association(name: str, **changes: Any) -> Callable[[_world.World], None]:  # noqa: ANN401 - fields of AssociationSpec
    def change(interface: linux.InterfaceSpec) -> dict[str, Any]:
        assert interface.association is not None  # noqa: S101 - a healthy radio is associated
        return {"association": interface.association.model_copy(update=changes)}

    return _interface(name, change)


def _echo(address: str, **changes: Any) -> Callable[[_world.World], None]:  # noqa: ANN401 - fields of EchoSpec
    return _change_gateway(lambda computer: {"echoes": {**computer.echoes, address: linux.EchoSpec(**changes)}})


def _offer(*knows: str) -> Callable[[_world.World], None]:
    offer = linux.OfferSpec(
        server="192.168.2.2", mac=_STRANGER, address="192.168.2.50", router="192.168.2.2", knows=knows
    )
    return _change_gateway(
        lambda computer: {"dhcp": {name: (*offers, offer) for name, offers in computer.dhcp.items()}}
    )


def _add_advertisement(computer: linux.ComputerSpec) -> dict[str, Any]:
    router = linux.AdvertisementSpec(address="fe80::ff:fe00:fc66", mac=_STRANGER, prefixes=("2001:db8:5::/64",))
    return {"routers": dict.fromkeys(computer.dhcp, (router,))}


def _change_default_route(computer: linux.ComputerSpec) -> dict[str, Any]:
    others = tuple(route for route in computer.routes if route.to != "default")
    return {"routes": (*others, linux.RouteSpec(via="10.70.2.1", dev="wlan1", protocol="dhcp"))}


def _neighbour(address: str, mac: str) -> Callable[[_world.World], None]:
    def change(computer: linux.ComputerSpec) -> dict[str, Any]:
        others = tuple(neighbour for neighbour in computer.neighbours if neighbour.address != address)
        return {"neighbours": (*others, linux.NeighbourSpec(address=address, dev="eth0", mac=mac))}

    return _change_gateway(change)


def _without_server(computer: linux.ComputerSpec) -> dict[str, Any]:
    """Return the changes for an unreachable VPN server, through which all VPN traffic passes."""
    return {"echoes": {**computer.echoes, "10.80.0.1": linux.EchoSpec(loss_percent=100.0)}, "reflectors": {}}


def _reflectors(**changes: Any) -> Callable[[_world.World], None]:  # noqa: ANN401 - fields of ReflectorSpec
    return _change_gateway(
        lambda computer: {
            "reflectors": {address: there.model_copy(update=changes) for address, there in computer.reflectors.items()}
        }
    )


def _expire_certificate(computer: linux.ComputerSpec) -> dict[str, Any]:
    old = linux.CertificateSpec(subject=computer.name, not_after=linux.CertificateSpec(subject="x").not_before)
    return {"certificates": {**computer.certificates, IDENTITY: (old, *computer.certificates[IDENTITY][1:])}}


GATEWAY_FAULTS: Mapping[str, RehearsedFault] = {
    "wifi-saturated": RehearsedFault(
        "the access point of Sparus is so near that it overdrives the receiver",
        ("sparus/wifi",),
        _change_association("wlan1", signal_dbm=-18),
    ),
    "wifi-weak": RehearsedFault(
        "the access point of Girona 500 is hardly heard",
        ("girona500/wifi",),
        _change_association("wlan0", signal_dbm=-88),
    ),
    "wifi-gone": RehearsedFault(
        "the gateway has lost the access point of Mares",
        ("mares/wifi",),
        _interface("wlan2", lambda _: {"association": None}),
    ),
    "wifi-other": RehearsedFault(
        "the gateway's radio for Sparus has joined another network",
        ("sparus/wifi",),
        _change_association("wlan1", ssid="EXAMPLE-SOMEBODY"),
    ),
    "wifi-indoors": RehearsedFault(
        "the access point of Mares is on a channel for indoor use",
        ("mares/wifi",),
        _change_association("wlan2", frequency_mhz=5180),
    ),
    "wifi-loss": RehearsedFault(
        "two of five pings to Zarco are lost", ("zarco/wifi",), _echo("10.64.1.23", loss_percent=40.0)
    ),
    "cable-out": RehearsedFault(
        "the cable of the ECA ROV is unplugged", ("eca-rov/ethernet",), _echo("10.64.1.26", loss_percent=100.0)
    ),
    "rogue-dhcp": RehearsedFault(
        "a robot's own DHCP server is plugged into the LAN", ("SITE/site/rogue-dhcp",), _offer()
    ),
    "rogue-dhcp-known": RehearsedFault(
        "a second DHCP server answers the card of Zarco and nobody else",
        ("SITE/site/rogue-dhcp",),
        _offer("02:00:5E:00:01:23"),
    ),
    "rogue-ra": RehearsedFault(
        "a robot's own IPv6 router is plugged into the LAN",
        ("SITE/site/rogue-router",),
        _change_gateway(_add_advertisement),
    ),
    "second-address": RehearsedFault(
        "the gateway has leased a second address of its subnet on the same card",
        ("SITE/site/one-subnet-twice",),
        _interface(
            "eth0",
            lambda item: {"addresses": (*item.addresses, linux.AddressSpec(address="10.64.1.130/24", lease_s=3000))},
        ),
    ),
    "address-leased": RehearsedFault(
        "the gateway's static address is only leased",
        ("SITE/site/static-addresses",),
        _interface(
            "eth0", lambda entry: {"addresses": (linux.AddressSpec(address=entry.addresses[0].address, lease_s=1800),)}
        ),
    ),
    "address-unkept": RehearsedFault(
        "no file gives the gateway its address at the next start",
        ("SITE/site/static-addresses",),
        _change_gateway(lambda computer: {"files": {"/etc/resolv.conf": computer.files["/etc/resolv.conf"]}}),
    ),
    "gateway-route": RehearsedFault(
        "the gateway's default route leads through a robot's access point",
        ("SITE/site/default-route",),
        _change_gateway(_change_default_route),
    ),
    "address-twice": RehearsedFault(
        "another card answers for the address of Zarco",
        ("SITE/site/duplicate-addresses",),
        _neighbour("10.64.1.23", _STRANGER),
    ),
    "factory-address": RehearsedFault(
        "a device in the LAN is left on 192.168.2.2",
        ("SITE/site/factory-defaults",),
        _neighbour("192.168.2.2", _STRANGER),
    ),
    "gateway-clock": RehearsedFault(
        "the gateway's clock is an hour behind, and nothing sets it",
        ("SITE/site/clock",),
        _change_gateway(
            lambda computer: {
                "time": computer.time.model_copy(update={"offset_s": -3600.0, "is_synchronised": False, "ntp": False})
            }
        ),
    ),
    "gateway-ntp-off": RehearsedFault(
        "a time server has set the gateway's clock once, and nothing sets it any more",
        ("SITE/site/clock",),
        _change_gateway(lambda computer: {"time": computer.time.model_copy(update={"ntp": False})}),
    ),
    "gateway-tunnel": RehearsedFault(
        "the gateway is not in the VPN",
        ("SITE/site/vpn", "SITE/site/data-reaches-scc", "SITE/site/dds"),
        _change_gateway(
            lambda computer: {
                "interfaces": tuple(interface for interface in computer.interfaces if interface.name != "tun0")
            }
        ),
    ),
    "server-silent": RehearsedFault(
        "the VPN server does not answer",
        ("SITE/site/vpn", "SITE/site/data-reaches-scc"),
        _change_gateway(_without_server),
    ),
    "centre-silent": RehearsedFault(
        "the control centre does not answer",
        ("SITE/site/data-reaches-scc",),
        _change_gateway(lambda _: {"reflectors": {}}),
    ),
    "centre-late": RehearsedFault(
        "what is sent to the control centre is answered after seconds",
        ("SITE/site/data-reaches-scc",),
        _reflectors(rtt_ms=8000.0),
    ),
    "centre-outside-vpn": RehearsedFault(
        "what is sent to the control centre reaches it outside of the VPN",
        ("SITE/site/data-reaches-scc",),
        _reflectors(arrives_by="eth0"),
    ),
    "certificate-expired": RehearsedFault(
        "the gateway's certificate of the VPN has expired",
        ("SITE/site/certificates",),
        _change_gateway(_expire_certificate),
    ),
    "dds-silent": RehearsedFault(
        "nothing speaks DDS on the gateway", ("SITE/site/dds",), _change_gateway(lambda _: {"udp": (), "dds": ()})
    ),
    "dds-loopback": RehearsedFault(
        "what speaks DDS on the gateway is bound to its loopback (ROS_LOCALHOST_ONLY=1)",
        ("SITE/site/dds",),
        _change_gateway(lambda _: {"dds": (linux.DdsSpec(addresses=("127.0.0.1",)),)}),
    ),
}

_ROUTER, _UNIT = "coastal-router", "coastal-4g"
_LONG_AGO = datetime(2025, 1, 1, tzinfo=UTC)


def _add_acts(*acts: _world.Act) -> Callable[[_world.World], None]:
    return lambda world: world.acts.extend(acts)


def _change_router(**changes: Any) -> Callable[[_world.World], None]:  # noqa: ANN401 - fields of what stands around a router
    def spoil(world: _world.World) -> None:
        place = world.routers[_ROUTER]
        for name, value in changes.items():
            place[name] = {**place[name], **value} if isinstance(value, dict) and value and name in place else value

    return spoil


def _station(mac: str, **changes: Any) -> Callable[[_world.World], None]:  # noqa: ANN401 - fields of the emulated router's `NearbyStation`
    def spoil(world: _world.World) -> None:
        stations = world.routers[_ROUTER]["stations"]
        world.routers[_ROUTER]["stations"] = [each | changes if each["mac"] == mac else each for each in stations]

    return spoil


def _unit(before: Mapping[str, Any], after: Mapping[str, Any]) -> Callable[[_world.World], None]:
    return _add_acts(_world.change_modem(_UNIT, before, after))


def _set_clock_back(world: _world.World) -> None:
    world.routers[_ROUTER]["time_server"] = None
    world.acts.append(_world.set_clock(_ROUTER, _LONG_AGO))


ROUTER_FAULTS: Mapping[str, RehearsedFault] = {
    "bridge-saturated": RehearsedFault(
        "the two ends of the Wi-Fi bridge stand on one bench, 2 m apart",
        ("SITE/wifi",),
        _add_acts(_world.apart("coastal-cpe", before={"distance_m": 150.0}, after={"distance_m": 2.0})),
    ),
    "bridge-weak": RehearsedFault(
        "something stands between the two ends of the Wi-Fi bridge",
        ("SITE/wifi",),
        _add_acts(_world.apart("coastal-cpe", before={"loss_db": 0.0}, after={"loss_db": 32.0})),
    ),
    "station-key": RehearsedFault(
        "Stork has another key than the site's access point",
        ("stork/wifi",),
        _station("02:00:5E:00:01:24", passphrase="EXAMPLE-another-key"),  # noqa: S106 - an example
    ),
    "station-other-network": RehearsedFault(
        "Zarco looks for a network of another name", ("zarco/wifi",), _station("02:00:5E:00:01:23", ssid="EXAMPLE-OLD")
    ),
    "station-weak": RehearsedFault(
        "the site's access point hardly hears Zarco",
        ("zarco/wifi",),
        _station("02:00:5E:00:01:23", signal_dbm=-88.0),
    ),
    "access-point-off": RehearsedFault(
        "somebody has switched the site's access point off",
        ("zarco/wifi", "stork/wifi"),
        _add_acts(_world.change_rows(_ROUTER, "/interface/wifi", {"default-name": "wifi1"}, disabled="yes")),
    ),
    "lte-no-card": RehearsedFault("there is no SIM in the 4G unit", ("SITE/4g",), _unit({"sim": {}}, {"sim": None})),
    "lte-roaming": RehearsedFault(
        "the 4G unit hears a foreign network only, and roaming is off",
        ("SITE/4g",),
        _unit({"cell": {"plmn": "00101"}}, {"cell": {"plmn": "26803"}}),
    ),
    "lte-no-coverage": RehearsedFault("no network is heard", ("SITE/4g",), _unit({"cell": {}}, {"cell": None})),
    "lte-refused": RehearsedFault(
        "the network refuses the card",
        ("SITE/4g",),
        _unit({"cell": {"denies": False}}, {"cell": {"denies": True}}),
    ),
    "dear-route": RehearsedFault(
        "somebody has set a default route over 4G by hand",
        ("SITE/site/default-route", "SITE/wifi", "SITE/4g"),
        _add_acts(_world.add_row(_ROUTER, "/ip/route", dst_address="0.0.0.0/0", gateway="10.10.1.1", distance="1")),
    ),
    "bridge-beyond-silent": RehearsedFault(
        "nobody answers beyond the Wi-Fi bridge",
        ("SITE/wifi",),
        _add_acts(_world.silence_addresses(_ROUTER, ["198.51.100.11", "198.51.100.12"])),
    ),
    "poe-overload": RehearsedFault(
        "the port of the 4G unit is overloaded",
        ("SITE/site/poe",),
        _change_router(loads={"ether2": {"status": "overload"}}),
    ),
    "router-tunnel": RehearsedFault("the router is not in the VPN", ("SITE/site/vpn",), _change_router(tunnels={})),
    "router-clock": RehearsedFault(
        "the router's clock stands at the year before, and no time server answers",
        ("SITE/site/clock",),
        _set_clock_back,
    ),
    "router-ntp-waiting": RehearsedFault(
        "no time server answers the router, whose clock is right so far",
        ("SITE/site/clock",),
        _change_router(time_server=None),
    ),
    "router-certificate": RehearsedFault(
        "the router's certificate of the VPN ends in a week",
        ("SITE/site/certificates",),
        lambda world: world.routers[_ROUTER].update(validity={"atlantis-vpn": _expiring_validity()}),
    ),
    "router-subnet-twice": RehearsedFault(
        "the router has a second address of its LAN on the same bridge",
        ("SITE/site/one-subnet-twice",),
        _add_acts(_world.add_row(_ROUTER, "/ip/address", address="10.64.1.2/24", interface="bridge-lan")),
    ),
    "filter-open": RehearsedFault(
        "a rule of the satellite's allow-list is switched off",
        ("SITE/site/satellite-filter", "SITE/satellite/allow-list"),
        _add_acts(
            _world.change_rows(
                _ROUTER, "/ip/firewall/filter", {"chain": "to-satellite", "action": "drop"}, disabled="yes"
            )
        ),
    ),
}


def _expiring_validity() -> dict[str, str]:
    now = datetime.now(UTC)
    return {"since": (now - timedelta(days=358)).isoformat(), "until": (now + timedelta(days=7)).isoformat()}


def _receiver(vehicle: str, **changes: Any) -> Callable[[_world.World], None]:  # noqa: ANN401 - fields of its spec
    return lambda world: world.receiver(vehicle, **changes)


def _modem(vehicle: str, **changes: Any) -> Callable[[_world.World], None]:  # noqa: ANN401 - fields of its spec
    return lambda world: world.modem(vehicle, **changes)


def _autopilot(vehicle: str, **changes: Any) -> Callable[[_world.World], None]:  # noqa: ANN401 - fields of its spec
    return lambda world: world.autopilot(vehicle, **changes)


def _change_sender(vehicle: str, address: str) -> Callable[[_world.World], None]:
    def spoil(world: _world.World) -> None:
        world.autopilots[vehicle] = replace(world.autopilots[vehicle], address=address)

    return spoil


_GPS = {
    "gps-no-fix": RehearsedFault(
        "the receiver of Girona 500 has no fix under an open sky", ("girona500/gps",), _receiver("girona500", mode=1)
    ),
    "gps-stale": RehearsedFault(
        "the receiver of Sparus repeats an old position", ("sparus/gps",), _receiver("sparus", stale=True)
    ),
    "gps-lost": RehearsedFault(
        "the receiver of Zarco loses its fix while it is watched", ("zarco/gps",), _receiver("zarco", lost_after=2)
    ),
    "gps-swapped": RehearsedFault(
        "the receiver of Mares has longitude and latitude exchanged",
        ("mares/gps",),
        _receiver("mares", has_swapped_axes=True),
    ),
    "gps-elsewhere": RehearsedFault(
        "the receiver of Sparus tells a position far from the site", ("sparus/gps",), _receiver("sparus", latitude=41.2)
    ),
    "gps-simulated": RehearsedFault(
        "the receiver of Zarco tells simulated positions", ("zarco/gps",), _receiver("zarco", status=8)
    ),
    "gps-clock": RehearsedFault(
        "the receiver of Stork is ten minutes behind", ("stork/gps",), _receiver("stork", time_offset_s=-600.0)
    ),
    "gps-no-satellites": RehearsedFault(
        "the receiver of Mares tells a position that no satellite gives",
        ("mares/gps",),
        _receiver("mares", satellites=0),
    ),
    "gps-silent": RehearsedFault(
        "the receiver of Mares says nothing", ("mares/gps",), _receiver("mares", speech=Speech.NOTHING)
    ),
    "gps-in-use": RehearsedFault(
        "the gpsd of Stork is held by its own software", ("stork/gps",), _receiver("stork", access=GnssAccess.IN_USE)
    ),
    "gps-gone": RehearsedFault(
        "no gpsd runs on Zarco", ("zarco/gps",), _receiver("zarco", access=GnssAccess.UNREACHABLE)
    ),
}
_GIRONA_MODEM = ("girona500/acoustic", "girona500/acoustic/fleet", "girona500/acoustic/message", "girona500/usbl")
_SPARUS_MODEM = ("sparus/acoustic", "girona500/acoustic/fleet", "sparus/acoustic/message", "sparus/usbl")
_ZARCO_MODEM = ("zarco/acoustic", "zarco/acoustic/fleet", "zarco/usbl", "zarco/usbl/ping")
_ACOUSTIC = {
    "modem-silent": RehearsedFault(
        "the modem of Girona 500 is silent", _GIRONA_MODEM, _modem("girona500", silent=True)
    ),
    "modem-in-use": RehearsedFault(
        "the modem of Sparus is held by its own software", _SPARUS_MODEM, _modem("sparus", is_occupied=True)
    ),
    "modem-alarm": RehearsedFault(
        "the modem of Sparus tells an internal error",
        ("sparus/acoustic", "sparus/acoustic/message"),
        _modem("sparus", state="OFFLINE ALARM"),
    ),
    "modem-twice": RehearsedFault(
        "the modem of Sparus has the acoustic address of Girona 500",
        _SPARUS_MODEM,
        _modem("sparus", local_address=1),
    ),
    "modem-foreign": RehearsedFault(
        "another modem than that of Girona 500 answers at its end",
        _GIRONA_MODEM,
        _modem("girona500", local_address=9),
    ),
    "modem-packet-time": RehearsedFault(
        "the modem of Sparus has another packet time than the fleet",
        ("girona500/acoustic/fleet",),
        _modem("sparus", packet_time_ms=500),
    ),
    "modem-loud": RehearsedFault(
        "the modem of Girona 500 is set to a source level that is not for air",
        ("girona500/acoustic", "girona500/acoustic/message"),
        _modem("girona500", source_level=0),
    ),
    "beacon-damaged": RehearsedFault(
        "every answer of Zarco's beacon has a wrong sum", _ZARCO_MODEM, _modem("zarco", every_sum_wrong=True)
    ),
    "usbl-nobody": RehearsedFault("nobody answers the pings of Mares", ("mares/usbl",), _modem("mares", fixes=0)),
    "usbl-frozen": RehearsedFault("the modem of Mares repeats one fix", ("mares/usbl",), _modem("mares", frozen=True)),
    "usbl-foreign": RehearsedFault(
        "the modem of Mares hears a modem that is not the declared one", ("mares/usbl",), _modem("mares", hears=(9,))
    ),
    "usbl-off": RehearsedFault(
        "the modem of Girona 500 does not put its fixes out",
        ("girona500/usbl",),
        _modem("girona500", tells_fixes=False),
    ),
}
_REMOTE = {
    "rc-armed": RehearsedFault(
        "Stork is armed", ("stork/rc_rf", "stork/rc_rf/sticks"), _autopilot("stork", is_armed=True)
    ),
    "rc-sticks-dead": RehearsedFault(
        "the channels of Stork do not follow the sticks", ("stork/rc_rf/sticks",), _autopilot("stork", moving=0)
    ),
    "rc-silent": RehearsedFault(
        "no stream of Stork's autopilot arrives",
        ("stork/rc_rf", "stork/rc_rf/sticks"),
        _autopilot("stork", silent=True),
    ),
    "rc-foreign": RehearsedFault(
        "another computer sends as the autopilot of Stork",
        ("stork/rc_rf", "stork/rc_rf/sticks"),
        _change_sender("stork", "10.64.1.199"),
    ),
    "rc-receiver-sick": RehearsedFault(
        "the autopilot of Stork calls its RC receiver sick",
        ("stork/rc_rf",),
        _autopilot("stork", receiver_healthy=False),
    ),
}
VEHICLE_FAULTS: Mapping[str, RehearsedFault] = {**_GPS, **_ACOUSTIC, **_REMOTE}

_LINKS: Mapping[str, RehearsedFault] = {
    "link-measured-long-ago": RehearsedFault(
        "the satellite was last measured 60 days ago",
        ("SITE/site/link-qualified-satellite",),
        lambda world: world.link("satellite", age=timedelta(days=60)),
    ),
    "link-too-slow": RehearsedFault(
        "when it was measured, 4G was slower than it may be",
        ("SITE/site/link-qualified-4g",),
        lambda world: world.link("4g", slower=1.3),
    ),
}

_DISCOVERY_ITEMS = ("robot/discovered", "robot/control-centre")
_PUBLICATION_ITEMS = ("robot/telemetry", "robot/pose", "robot/rates")


def _robot(vehicle: str, change: robots.Change) -> Callable[[_world.World], None]:
    return lambda world: world.robots.change(vehicle, change)


def _item_ids(vehicle: str, *items: str) -> tuple[str, ...]:
    return tuple(f"{vehicle}/{item}" for item in items)


_ROBOTS: Mapping[str, RehearsedFault] = {
    "robot-away": RehearsedFault(
        "the interface of Sparus is not started",
        _item_ids("sparus", *_DISCOVERY_ITEMS, *_PUBLICATION_ITEMS),
        _robot("sparus", robots.remove_robot),
    ),
    "robot-not-at-centre": RehearsedFault(
        "nothing of Mares reaches the control centre",
        ("mares/robot/control-centre",),
        lambda world: robots.remove_robot(world.robots.centre, "mares"),
    ),
    "robot-not-in-vpn": RehearsedFault(
        "OpenVPN is not started on Stork",
        ("stork/robot/vpn",),
        lambda world: world.robots.members.update(stork=replace(world.robots.members["stork"], session="")),
    ),
    "robot-token": RehearsedFault(
        "a robot that calls itself Stork has another token",
        _item_ids("stork", *_DISCOVERY_ITEMS),
        _robot("stork", robots.says("EXAMPLE-stork-token", "EXAMPLE-another")),
    ),
    "robot-other-file": RehearsedFault(
        "the ECA ROV publishes another configuration than its file",
        _item_ids("eca-rov", *_DISCOVERY_ITEMS),
        _robot("eca-rov", robots.says("label: Leak", "label: Water")),
    ),
    "robot-twice": RehearsedFault(
        "two robots call themselves Zarco", _item_ids("zarco", *_DISCOVERY_ITEMS), _robot("zarco", robots.another())
    ),
    "robot-stranger": RehearsedFault(
        "a robot that nobody has declared introduces itself",
        ("SITE/robot/strangers",),
        _robot("sparus", robots.another("EXAMPLE_")),
    ),
    "robot-topic-missing": RehearsedFault(
        "Sparus does not publish its leak sensor",
        ("sparus/robot/telemetry",),
        _robot("sparus", robots.remove_topic("leak")),
    ),
    "robot-frozen": RehearsedFault(
        "the pose of Mares is always the same",
        ("mares/robot/pose",),
        _robot("mares", robots.topic("pose", lambda row: setattr(row, "contents", {b"1"}))),
    ),
    "robot-stale": RehearsedFault(
        "the positions of Zarco are a minute old",
        ("zarco/robot/pose",),
        _robot("zarco", robots.topic("fix", lambda row: setattr(row, "stamp_age_s", 60.0))),
    ),
    "robot-rate": RehearsedFault(
        "Girona 500 publishes its depth 20 times a second",
        ("girona500/robot/rates",),
        _robot(
            "girona500",
            robots.topic("depth", lambda row: setattr(row, "first_s", row.last_s - (row.messages - 1) / 20.0)),
        ),
    ),
}

FAULTS = {**VEHICLE_FAULTS, **_ROBOTS, **_LINKS, **GATEWAY_FAULTS, **ROUTER_FAULTS}
"""Name -> fault; faults can be combined."""
