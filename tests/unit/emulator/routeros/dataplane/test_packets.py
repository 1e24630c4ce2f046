"""Packets of the flow matrix, against an implementation that is not ours where there is one, and back again."""

import struct
from dataclasses import replace
from ipaddress import IPv4Address

import pytest
from hypothesis import given
from hypothesis import strategies as st

from atlantis_netcfg.emulator.routeros.dataplane import packets
from atlantis_netcfg.emulator.routeros.dataplane.packets import ACK, SYN, FlowPacket, decode


def as_its_protocol(packet: FlowPacket) -> FlowPacket:
    """Without what its protocol does not have."""
    if packet.protocol == "tcp":
        return packet
    return replace(packet, mss=0, destination_port=0 if packet.protocol == "icmp" else packet.destination_port)


PACKETS = st.builds(
    FlowPacket,
    source=st.ip_addresses(v=4),
    destination=st.ip_addresses(v=4),
    protocol=st.sampled_from(["icmp", "tcp", "udp"]),
    number=st.integers(0, packets.MOST),
    source_port=st.integers(0, 65_535),
    destination_port=st.integers(0, 65_535),
    dscp=st.integers(0, 63),
).map(as_its_protocol)


def internet_sum(data: bytes) -> int:
    """Of data that holds its own checksum: 0xFFFF (RFC 1071), one byte at a time."""
    total = sum(byte << (8 if place % 2 == 0 else 0) for place, byte in enumerate(data))
    while total > 0xFFFF:
        total = total // 0x10000 + total % 0x10000
    return total


@given(packet=PACKETS)
def test_a_packet_is_read_as_it_was_written(packet: FlowPacket) -> None:
    data = packet.encode()
    assert decode(data) == packet
    assert internet_sum(data[:20]) == 0xFFFF
    assert struct.unpack("!H", data[2:4])[0] == len(data)
    if packet.protocol == "icmp":
        assert internet_sum(data[20:]) == 0xFFFF
    if packet.protocol == "tcp":
        assert internet_sum(data[12:20] + struct.pack("!HH", 6, len(data) - 20) + data[20:]) == 0xFFFF


@given(packet=PACKETS, number=st.integers(0, packets.MOST))
def test_a_reply_goes_back_to_the_port_that_asked(packet: FlowPacket, number: int) -> None:
    reply = packet.reply(number)
    assert (reply.source, reply.destination, reply.number) == (packet.destination, packet.source, number)
    if packet.protocol == "icmp":
        assert reply.source_port == packet.source_port
    else:
        assert (reply.source_port, reply.destination_port) == (packet.destination_port, packet.source_port)
    if packet.protocol == "tcp":
        assert (reply.flags, reply.ack_number) == (SYN | ACK, packet.number + 1)
    assert decode(reply.encode()) == reply


@pytest.mark.parametrize("data", [b"", b"\x60" + bytes(60), b"\x45" + bytes(60), bytes(40)])
def test_what_is_not_ours_is_left_alone(data: bytes) -> None:
    assert decode(data) is None


def test_an_echo_of_somebody_else_is_left_alone() -> None:
    ping = FlowPacket(IPv4Address("192.0.2.1"), IPv4Address("192.0.2.2"), "icmp", 7, mss=0).encode()
    assert decode(ping) is not None
    assert decode(ping[:28] + b"somebody" + ping[36:]) is None
