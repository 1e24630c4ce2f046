"""An emulated Linux computer: the output of `ip`, `iw`, `ping` and other read-only programs.

It emulates the exact output of the programs that the probes may run, the DHCP servers on its segments, its DDS
participants, and the computers that respond to its messages. It has no network: the specification defines the result of
a ping, which returns at once. The specification is immutable and healthy by default; a rehearsal uses another one to
cause faults.
"""

from __future__ import annotations

from atlantis_netcfg.emulator.linux._computer import NOT_FOUND, Computer, lan_computer
from atlantis_netcfg.emulator.linux._spec import (
    AddressSpec,
    AdvertisementSpec,
    AssociationSpec,
    CertificateSpec,
    ComputerSpec,
    DdsSpec,
    EchoSpec,
    InterfaceSpec,
    NeighbourSpec,
    OfferSpec,
    ReflectorSpec,
    RouteSpec,
    TimeSpec,
    UdpSpec,
)

__all__ = [
    "NOT_FOUND",
    "NOT_REHEARSED",
    "AddressSpec",
    "AdvertisementSpec",
    "AssociationSpec",
    "CertificateSpec",
    "Computer",
    "ComputerSpec",
    "DdsSpec",
    "EchoSpec",
    "InterfaceSpec",
    "NeighbourSpec",
    "OfferSpec",
    "ReflectorSpec",
    "RouteSpec",
    "TimeSpec",
    "UdpSpec",
    "lan_computer",
]

NOT_REHEARSED = ("a gateway computer: the output of its programs is emulated; the programs do not run",)
