"""An emulated Linux computer, as far as reading programs tell of it: what `ip`, `iw`, `ping` and others would print.

It stands for the output of the programs that the probes may run, in their exact form, for the DHCP servers that answer
on its segments, for the DDS participants that run on it, and for the computers that answer its messages. It has no
network: a ping answers as its specification says, and at once. Its specification is frozen and healthy by default; a
rehearsal breaks things by another one.
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

NOT_REHEARSED = ("a gateway computer: its programs' answers are emulated, the programs themselves do not run",)
