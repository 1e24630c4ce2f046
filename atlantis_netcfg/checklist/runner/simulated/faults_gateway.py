"""Faults that the gateway computer sees: its radios, its addresses, its clock, who else is in the LAN."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from atlantis_netcfg.checklist.runner.simulated._fault import Fault
from atlantis_netcfg.emulator.linux import (
    AddressSpec,
    CertificateSpec,
    DdsSpec,
    EchoSpec,
    NeighbourSpec,
    OfferSpec,
    RouteSpec,
)
from atlantis_netcfg.vpn.client import IDENTITY

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from atlantis_netcfg.checklist.runner.simulated._world import World
    from atlantis_netcfg.emulator.linux import ComputerSpec, InterfaceSpec

_STRANGER = "02:00:5E:00:FC:66"


def _gateway(change: Callable[[ComputerSpec], dict[str, Any]]) -> Callable[[World], None]:
    return lambda world: world.gateway(change)


def _interface(name: str, change: Callable[[InterfaceSpec], dict[str, Any]]) -> Callable[[World], None]:
    """Change one interface. Raises KeyError where it is not there."""

    def changed(computer: ComputerSpec) -> dict[str, Any]:
        if computer.interface(name) is None:
            raise KeyError(name)
        return {
            "interfaces": tuple(
                interface.model_copy(update=change(interface)) if interface.name == name else interface
                for interface in computer.interfaces
            )
        }

    return _gateway(changed)


def _received(name: str, **changes: Any) -> Callable[[World], None]:  # noqa: ANN401 - fields of AssociationSpec
    def change(interface: InterfaceSpec) -> dict[str, Any]:
        assert interface.association is not None  # noqa: S101 - a healthy radio is associated
        return {"association": interface.association.model_copy(update=changes)}

    return _interface(name, change)


def _echo(address: str, **changes: Any) -> Callable[[World], None]:  # noqa: ANN401 - fields of EchoSpec
    return _gateway(lambda computer: {"echoes": {**computer.echoes, address: EchoSpec(**changes)}})


def _offer(*knows: str) -> Callable[[World], None]:
    offer = OfferSpec(server="192.168.2.2", mac=_STRANGER, address="192.168.2.50", router="192.168.2.2", knows=knows)
    return _gateway(lambda computer: {"dhcp": {name: (*offers, offer) for name, offers in computer.dhcp.items()}})


def _another_way(computer: ComputerSpec) -> dict[str, Any]:
    others = tuple(route for route in computer.routes if route.to != "default")
    return {"routes": (*others, RouteSpec(via="10.70.2.1", dev="wlan1", protocol="dhcp"))}


def _neighbour(address: str, mac: str) -> Callable[[World], None]:
    def change(computer: ComputerSpec) -> dict[str, Any]:
        others = tuple(neighbour for neighbour in computer.neighbours if neighbour.address != address)
        return {"neighbours": (*others, NeighbourSpec(address=address, dev="eth0", mac=mac))}

    return _gateway(change)


def _expired(computer: ComputerSpec) -> dict[str, Any]:
    old = CertificateSpec(subject=computer.name, not_after=CertificateSpec(subject="x").not_before)
    return {"certificates": {**computer.certificates, IDENTITY: (old, *computer.certificates[IDENTITY][1:])}}


FAULTS: Mapping[str, Fault] = {
    "wifi-saturated": Fault(
        "the access point of Sparus is so near that it overdrives the receiver",
        ("sparus/wifi",),
        _received("wlan1", signal_dbm=-18),
    ),
    "wifi-weak": Fault(
        "the access point of Girona 500 is hardly heard", ("girona500/wifi",), _received("wlan0", signal_dbm=-88)
    ),
    "wifi-gone": Fault(
        "the gateway has lost the access point of Mares",
        ("mares/wifi",),
        _interface("wlan2", lambda _: {"association": None}),
    ),
    "wifi-other": Fault(
        "the gateway's radio for Sparus has joined another network",
        ("sparus/wifi",),
        _received("wlan1", ssid="EXAMPLE-SOMEBODY"),
    ),
    "wifi-indoors": Fault(
        "the access point of Mares is on a channel for indoor use",
        ("mares/wifi",),
        _received("wlan2", frequency_mhz=5180),
    ),
    "wifi-loss": Fault("two of five pings to Zarco are lost", ("zarco/wifi",), _echo("10.64.1.23", loss_percent=40.0)),
    "cable-out": Fault(
        "the cable of the ECA ROV is unplugged", ("eca-rov/ethernet",), _echo("10.64.1.26", loss_percent=100.0)
    ),
    "rogue-dhcp": Fault("a robot's own DHCP server is plugged into the LAN", ("SITE/site/rogue-dhcp",), _offer()),
    "rogue-dhcp-known": Fault(
        "a second DHCP server answers the card of Zarco and nobody else",
        ("SITE/site/rogue-dhcp",),
        _offer("02:00:5E:00:01:23"),
    ),
    "second-address": Fault(
        "the gateway has leased a second address of its subnet on the same card",
        ("SITE/site/one-subnet-twice",),
        _interface(
            "eth0", lambda item: {"addresses": (*item.addresses, AddressSpec(address="10.64.1.130/24", lease_s=3000))}
        ),
    ),
    "address-leased": Fault(
        "the gateway's static address is only leased",
        ("SITE/site/static-addresses",),
        _interface(
            "eth0", lambda entry: {"addresses": (AddressSpec(address=entry.addresses[0].address, lease_s=1800),)}
        ),
    ),
    "address-unkept": Fault(
        "no file gives the gateway its address at the next start",
        ("SITE/site/static-addresses",),
        _gateway(lambda computer: {"files": {"/etc/resolv.conf": computer.files["/etc/resolv.conf"]}}),
    ),
    "gateway-route": Fault(
        "the gateway's default route leads through a robot's access point",
        ("SITE/site/default-route",),
        _gateway(_another_way),
    ),
    "address-twice": Fault(
        "another card answers for the address of Zarco",
        ("SITE/site/duplicate-addresses",),
        _neighbour("10.64.1.23", _STRANGER),
    ),
    "factory-address": Fault(
        "a device in the LAN is left on 192.168.2.2",
        ("SITE/site/factory-defaults",),
        _neighbour("192.168.2.2", _STRANGER),
    ),
    "gateway-clock": Fault(
        "the gateway's clock is an hour behind, and nothing sets it",
        ("SITE/site/clock",),
        _gateway(
            lambda computer: {
                "time": computer.time.model_copy(update={"offset_s": -3600.0, "synchronised": False, "ntp": False})
            }
        ),
    ),
    "gateway-ntp-off": Fault(
        "a time server has set the gateway's clock once, and nothing sets it any more",
        ("SITE/site/clock",),
        _gateway(lambda computer: {"time": computer.time.model_copy(update={"ntp": False})}),
    ),
    "gateway-tunnel": Fault(
        "the gateway is not in the VPN",
        ("SITE/site/vpn", "SITE/site/dds"),
        _gateway(
            lambda computer: {
                "interfaces": tuple(interface for interface in computer.interfaces if interface.name != "tun0")
            }
        ),
    ),
    "server-silent": Fault(
        "the VPN server does not answer", ("SITE/site/vpn",), _echo("10.80.0.1", loss_percent=100.0)
    ),
    "certificate-expired": Fault(
        "the gateway's certificate of the VPN has expired", ("SITE/site/certificates",), _gateway(_expired)
    ),
    "dds-silent": Fault(
        "nothing speaks DDS on the gateway", ("SITE/site/dds",), _gateway(lambda _: {"udp": (), "dds": ()})
    ),
    "dds-loopback": Fault(
        "what speaks DDS on the gateway is bound to its loopback (ROS_LOCALHOST_ONLY=1)",
        ("SITE/site/dds",),
        _gateway(lambda _: {"dds": (DdsSpec(addresses=("127.0.0.1",)),)}),
    ),
}
