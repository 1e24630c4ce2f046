"""What is seen of a frame on a link, and compared with an allow-list."""

from ipaddress import IPv4Address
from pathlib import Path

import pytest

from atlantis_netcfg.emulator.routeros.dataplane.packets import FlowPacket
from atlantis_netcfg.inventory import load
from atlantis_netcfg.operations.pilot_network.link_watch import Destination, LinkWatch

SHIPPED = load(Path(__file__).parents[4] / "inventory")
VPN = SHIPPED.pilot.vpn
SATELLITE = next(link for link in SHIPPED.sites["te4sea"].bearers if link.kind.traits.allow_list)
IPV4, IPV6, ARP = b"\x08\x00", b"\x86\xdd", b"\x08\x06"
SOURCE = IPv4Address("10.64.2.199")


def frame(packet: bytes, kind: bytes = IPV4) -> bytes:
    return bytes(12) + kind + packet


def packet(protocol: str, port: int, address: IPv4Address = VPN.endpoint) -> bytes:
    return FlowPacket(SOURCE, address, protocol, 7, 40_000, port).encode()


def fragment(data: bytes) -> bytes:
    """The same packet as a later fragment, whose first bytes are no ports."""
    return data[:6] + (185).to_bytes(2) + data[8:]


@pytest.mark.parametrize(
    ("data", "destination", "is_stranger"),
    [
        (frame(packet("udp", 1194)), Destination("udp", VPN.endpoint, 1194), False),
        (frame(fragment(packet("udp", 1194))), Destination("udp", VPN.endpoint), False),
        (frame(packet("udp", 1195)), Destination("udp", VPN.endpoint, 1195), True),
        (frame(packet("tcp", 1194)), Destination("tcp", VPN.endpoint, 1194), True),
        (frame(fragment(packet("tcp", 1194))), Destination("tcp", VPN.endpoint), True),
        (frame(packet("icmp", 0)), Destination("icmp", VPN.endpoint), True),
        (frame(packet("udp", 1194, SOURCE)), Destination("udp", SOURCE, 1194), True),
        (frame(bytes(40), IPV6), Destination("0x86dd", IPv4Address(0)), True),
    ],
)
def test_destination_is_compared_with_the_allow_list(
    data: bytes, destination: Destination, *, is_stranger: bool
) -> None:
    watch = LinkWatch()
    watch.see(data)
    assert dict(watch.counts) == {destination: 1}
    lines = watch.strangers(SHIPPED.pilot, SATELLITE)
    expected = f"satellite has carried packets that are not allowed: 1 to {destination}"
    assert lines == ([expected] if is_stranger else [])


def test_arp_stays_on_the_link() -> None:
    watch = LinkWatch()
    watch.see(frame(bytes(28), ARP))
    assert watch.counts.total() == 0
    assert watch.strangers(SHIPPED.pilot, SATELLITE) == []
