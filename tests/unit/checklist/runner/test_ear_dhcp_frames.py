"""Frames of DHCP as the ear makes and reads them (RFC 2131); garbage is no offer and no fault."""

import socket
import struct

import pytest

from atlantis_netcfg.checklist.probes.agent.main import _frame, _nobody, _offer

MAC, NUMBER = b"\x02\x00\x5e\x00\x01\x10", b"\x01\x02\x03\x04"
SERVER_MAC = b"\x02\x00\x5e\x00\x01\x01"
OFFER = {"server": "10.64.1.1", "mac": "02:00:5e:00:01:01", "address": "10.64.1.100", "router": "10.64.1.254"}


def offer(
    *options: bytes, number: bytes = NUMBER, mac: bytes = MAC, port: int = 68, cookie: bytes = b"c\x82Sc"
) -> bytes:
    yours = socket.inet_aton("10.64.1.100")
    bootp = struct.pack("!4B4sHH4s4s8x6s10x192x", 2, 1, 6, 0, number, 0, 0x8000, b"\0" * 4, yours, mac)
    body = bootp + cookie + b"".join(options) + b"\xff"
    head = struct.pack("!BBHHHBBH4s4s", 0x45, 0, 28 + len(body), 0, 0, 64, 17, 0, b"\x0a\x40\x01\x02", b"\xff" * 4)
    return MAC + SERVER_MAC + b"\x08\x00" + head + struct.pack("!4H", 67, port, 8 + len(body), 0) + body


TYPE, SERVER, ROUTER = b"\x35\x01\x02", b"\x36\x04\x0a\x40\x01\x01", b"\x03\x08\x0a\x40\x01\xfe\x0a\x40\x01\xfd"


def test_offer_is_read() -> None:
    assert _offer(offer(TYPE, b"\0\0", SERVER, ROUTER), [MAC], NUMBER) == OFFER


def test_unnamed_server_is_identified_by_source_address() -> None:
    assert _offer(offer(TYPE), [MAC], NUMBER) == {**OFFER, "server": "10.64.1.2", "router": None}


@pytest.mark.parametrize(
    "frame",
    [
        offer(b"\x35\x01\x05", SERVER),
        offer(SERVER),
        offer(TYPE, number=b"\0\0\0\1"),
        offer(TYPE, mac=SERVER_MAC),
        offer(TYPE, port=67),
        offer(TYPE, cookie=b"\0\0\0\0"),
        b"",
        b"\xff" * 600,
        b"\0" * 600,
    ],
    ids=["ack", "no-type", "of-another", "to-another", "to-a-server", "bootp", "empty", "ones", "zeros"],
)
def test_unrelated_frame_is_ignored(frame: bytes) -> None:
    assert _offer(frame, [MAC], NUMBER) is None


def test_truncated_frame_gives_no_wrong_address() -> None:
    whole = offer(TYPE, SERVER, ROUTER)
    for length in range(len(whole)):
        found = _offer(whole[:length], [MAC], NUMBER)
        assert found is None or found["address"] == "10.64.1.100"


def test_discover_frame() -> None:
    frame = _frame(MAC, MAC, NUMBER)
    assert frame[:14] == b"\xff" * 6 + MAC + b"\x08\x00"
    header = struct.unpack("!10H", frame[14:34])
    total = sum(header)
    assert (total & 0xFFFF) + (total >> 16) == 0xFFFF, "the checksum of IP"
    assert header[1] == len(frame) - 14
    assert struct.unpack("!4H", frame[34:42]) == (68, 67, len(frame) - 34, 0)
    bootp = frame[42:]
    assert (bootp[:4], bootp[4:8], bootp[10:12], bootp[28:34]) == (b"\x01\x01\x06\x00", NUMBER, b"\x80\x00", MAC)
    assert bootp[12:28] == b"\0" * 16, "no address is asked for, none is used"
    assert bootp[236:249] == b"c\x82Sc" + b"\x35\x01\x01" + b"\x37\x03\x01\x03\x33" + b"\xff"
    assert len(bootp) == 300


def test_discover_for_another_card_is_sent_from_this_one() -> None:
    frame = _frame(MAC, SERVER_MAC, NUMBER)
    assert (frame[6:12], frame[42 + 28 : 42 + 34]) == (MAC, SERVER_MAC)
    assert _offer(offer(TYPE, SERVER, ROUTER, mac=SERVER_MAC), [MAC, SERVER_MAC], NUMBER) == OFFER


def test_unused_mac_is_local_and_stable() -> None:
    nobody = _nobody(MAC)
    assert nobody == _nobody(MAC) != MAC
    assert nobody[0] & 3 == 2, "it is a single card's, and no maker's"
