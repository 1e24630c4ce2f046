"""Router solicitations and advertisements as the ear makes and reads them (RFC 4861); garbage is no router."""

import socket
import struct

import pytest

from atlantis_netcfg.checklist.probes.agent.main import _advertisement, _checksum, _segment, _solicitation
from atlantis_netcfg.checklist.probes.agent.streams import ProbeError

MAC, ROUTER_MAC = bytes.fromhex("02005e000110"), bytes.fromhex("02005e000124")
ADDRESS = socket.inet_pton(socket.AF_INET6, "fe80::124")
NODES = socket.inet_pton(socket.AF_INET6, "ff02::1")
HEARD = {"address": "fe80::124", "mac": "02:00:5e:00:01:24", "lifetime_s": 1800, "prefixes": ["2001:db8:9::/64"]}


def prefix(text: str = "2001:db8:9::", size: int = 4) -> bytes:
    return struct.pack("!BBBBIII", 3, size, 64, 0xC0, 7200, 7200, 0) + socket.inet_pton(socket.AF_INET6, text)


def advertisement(*options: bytes, kind: int = 134, hops: int = 255, protocol: int = 58, size: int = 0) -> bytes:
    body = struct.pack("!BBHBBHII", kind, 0, 0, 64, 0, 1800, 0, 0) + b"".join(options)
    header = struct.pack("!IHBB", 6 << 28, size or len(body), protocol, hops)
    return bytes.fromhex("333300000001") + ROUTER_MAC + b"\x86\xdd" + header + ADDRESS + NODES + body


def test_advertisement_is_read() -> None:
    mtu, name_server = b"\x05\x01\0\0\0\0\x05\xdc", b"\x19\x03" + bytes(22)
    assert _advertisement(advertisement(mtu, prefix(), name_server)) == HEARD
    assert _advertisement(advertisement()) == {**HEARD, "prefixes": []}
    assert _advertisement(advertisement(prefix()) + bytes(12)) == HEARD, "padding of Ethernet"


@pytest.mark.parametrize(
    "frame",
    [
        advertisement(kind=135),
        advertisement(hops=254),
        advertisement(protocol=17),
        advertisement(size=17),
        advertisement(size=15),
        b"",
        b"\xff" * 200,
        bytes(200),
    ],
    ids=["neighbour", "from-elsewhere", "udp", "longer-than-it-is", "too-short", "empty", "ones", "zeros"],
)
def test_unrelated_frame_is_ignored(frame: bytes) -> None:
    assert _advertisement(frame) is None


def test_options_with_wrong_length_end_the_list() -> None:
    assert _advertisement(advertisement(prefix(size=0), prefix())) == {**HEARD, "prefixes": []}
    assert _advertisement(advertisement(prefix(), prefix(size=200))) == HEARD
    many = _advertisement(advertisement(*(prefix(f"2001:db8:{number:x}::") for number in range(40))))
    assert many is not None
    assert len(many["prefixes"]) == 8


def test_truncated_frame_is_ignored() -> None:
    whole = advertisement(prefix())
    assert not [length for length in range(len(whole)) if _advertisement(whole[:length])]


def test_socket_receives_nothing_before_it_is_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    """A socket of AF_PACKET with a protocol hears every interface until it is bound (packet(7))."""
    made: list[tuple[object, ...]] = []

    def refuse(*words: object) -> socket.socket:
        made.append(words)
        raise PermissionError

    monkeypatch.setattr("socket.socket", refuse)
    with pytest.raises(ProbeError, match="only root may ask"), _segment("lo", 0x86DD, "routers"):
        pass
    assert made == [(socket.AF_PACKET, socket.SOCK_RAW, 0)]


def test_solicitation_frame() -> None:
    frame = _solicitation(MAC)
    assert frame[:14] == bytes.fromhex("333300000002") + MAC + b"\x86\xdd"
    assert struct.unpack("!IHBB", frame[14:22]) == (6 << 28, 8, 58, 255)
    assert (frame[22:38], frame[38:54]) == (bytes(16), socket.inet_pton(socket.AF_INET6, "ff02::2"))
    assert (frame[54:56], len(frame)) == (b"\x85\0", 62)
    assert _checksum(frame[22:54] + struct.pack("!II", 8, 58) + frame[54:]) == 0
