"""Packets of STAMP: every octet where RFC 8762 has it, and nothing read that the key did not make."""

import ast
import struct
from pathlib import Path

import pytest
from cryptography.hazmat.primitives import hashes, hmac
from hypothesis import given, settings
from hypothesis import strategies as st
from row_subtests import for_each_row

import atlantis_netcfg.links.qualify.reflector as package
from atlantis_netcfg.links.qualify.reflector.stamp import (
    AUTHENTICATED_SIZE,
    BASE_SIZE,
    CHUNK,
    COUNTERS,
    PADDING,
    Acknowledgement,
    BadPacket,
    MessageChunk,
    ReflectorPacket,
    SenderPacket,
    Tlv,
    decode_reflector,
    decode_sender,
    error_estimate,
    error_s,
    is_synchronised,
    ntp,
    padding,
    unix_ns,
)

KEY = b"an example key, 32 octets long.."
TIME = 0xEB1F_2A3B_8000_0000


def _hmac(data: bytes, key: bytes) -> bytes:
    """Not the implementation that the packets are made with."""
    made = hmac.HMAC(key, hashes.SHA256())
    made.update(data)
    return made.finalize()


def _sealed(data: bytes, direction: bytes) -> bytes:
    return data + _hmac(data, _hmac(b"STAMP " + direction, KEY))[:16]


def test_request_has_the_rfc_8762_format() -> None:
    packet = SenderPacket(7, TIME, 0x8A05, 0x1234)
    assert packet.encode() == bytes.fromhex("00000007 eb1f2a3b80000000 8a05 1234") + bytes(28)
    sealed = packet.encode(KEY)
    assert len(sealed) == AUTHENTICATED_SIZE
    assert sealed[:4] == bytes.fromhex("00000007")
    assert sealed[4:16] == bytes(12)
    assert sealed[16:28] == bytes.fromhex("eb1f2a3b80000000 8a05 1234")
    assert sealed[28:96] == bytes(68)
    assert sealed == _sealed(sealed[:96], b"request")


def test_reply_has_the_rfc_8762_format() -> None:
    packet = ReflectorPacket(3, TIME, 0x8A05, 0x1234, TIME + 1, 7, TIME + 2, 0x0101, 61)
    plain = "00000003 eb1f2a3b80000000 8a05 1234 eb1f2a3b80000001 00000007 eb1f2a3b80000002 0101 0000 3d 000000"
    assert packet.encode() == bytes.fromhex(plain)
    sealed = packet.encode(KEY)
    assert len(sealed) == AUTHENTICATED_SIZE
    # RFC 8762, 4.3.2: sequence, stamp, error, identifier (RFC 8972), received, and what the sender had.
    places = {0: "00000003", 16: "eb1f2a3b80000000", 24: "8a051234", 32: "eb1f2a3b80000001"}
    places |= {48: "00000007", 64: "eb1f2a3b80000002", 72: "0101", 80: "3d"}
    expected = bytearray(96)
    for place, text in places.items():
        expected[place : place + len(text) // 2] = bytes.fromhex(text)
    assert sealed == _sealed(bytes(expected), b"answer")


@settings(max_examples=60)
@given(
    st.integers(0, 2**32 - 1),
    st.integers(0, 2**64 - 1),
    st.integers(0, 2**16 - 1),
    st.lists(st.tuples(st.sampled_from([PADDING, COUNTERS, CHUNK, 77]), st.binary(max_size=40)), max_size=3),
    st.sampled_from([None, KEY]),
)
def test_packets_survive_encoding_and_decoding(
    number: int, stamp: int, short: int, tlvs: list[tuple[int, bytes]], key: bytes | None
) -> None:
    extensions = tuple(Tlv(kind, value) for kind, value in tlvs)
    sent = SenderPacket(number, stamp, short, short, extensions)
    assert decode_sender(sent.encode(key), key) == sent
    answer = ReflectorPacket(number, stamp, short, short, stamp, number, stamp, short, short & 255, extensions)
    assert decode_reflector(answer.encode(key), key) == answer


@pytest.mark.parametrize("size", [BASE_SIZE, BASE_SIZE + 4, 1200])
def test_padding_fills_a_packet(size: int) -> None:
    assert len(SenderPacket(0, 0, 1, 0, padding(size, is_authenticated=False)).encode()) == size


@pytest.mark.parametrize("size", [0, BASE_SIZE - 1, BASE_SIZE + 3])
def test_a_size_that_no_packet_can_have_is_refused(size: int) -> None:
    with pytest.raises(ValueError, match=f"a test packet has 44 octets, or 48 and more: it cannot have {size}"):
        padding(size, is_authenticated=False)


@pytest.mark.parametrize("octet", [0, 20, 60, 95, 96, 111, 113, 130, -1])
def test_single_wrong_bit_is_detected(octet: int) -> None:
    whole = bytearray(SenderPacket(1, TIME, 1, 9, (Tlv(COUNTERS, bytes(16)),)).encode(KEY))
    whole[octet] ^= 1
    with pytest.raises(BadPacket):
        decode_sender(bytes(whole), KEY)


def test_unauthenticated_extensions_are_refused() -> None:
    bare = SenderPacket(1, TIME, 1, 9).encode(KEY)
    with pytest.raises(BadPacket, match="extensions are not authenticated"):
        decode_sender(bare + Tlv(COUNTERS, bytes(16)).encode(), KEY)
    # RFC 8972, 4.8: padding alone needs no HMAC.
    assert decode_sender(bare + Tlv(PADDING, bytes(16)).encode(), KEY).tlvs == (Tlv(PADDING, bytes(16)),)


def test_a_message_moved_to_another_packet_is_refused() -> None:
    first = SenderPacket(1, TIME, 1, 9, (Tlv(CHUNK, MessageChunk(0, 5, 0, 1, True, b"hello").encode()),)).encode(KEY)
    second = SenderPacket(2, TIME, 1, 9).encode(KEY)
    with pytest.raises(BadPacket):
        decode_sender(second + first[AUTHENTICATED_SIZE:], KEY)


@for_each_row("length", range(AUTHENTICATED_SIZE))
def test_truncated_packet_is_refused(length: int) -> None:
    with pytest.raises(BadPacket):
        decode_sender(SenderPacket(1, TIME, 1).encode(KEY)[:length], KEY)


@settings(max_examples=60)
@given(st.integers(0, 2**62))
def test_times_survive_the_format_of_ntp(moment: int) -> None:
    moment %= 4_000_000_000 * 1_000_000_000  # until 2096
    assert abs(unix_ns(ntp(moment)) - moment) <= 1


def test_times_of_ntp() -> None:
    assert ntp(0) == 2_208_988_800 << 32
    assert ntp(500_000_000) & 0xFFFF_FFFF == 1 << 31
    assert ntp(2_085_978_496 * 1_000_000_000) == 0, "NTP's seconds begin again on 7 February 2036"
    assert unix_ns(0) == 2_085_978_496 * 1_000_000_000
    assert unix_ns(struct.unpack(">Q", struct.pack(">II", 1_790_000_000, 5))[0], 0x4001) == 1_790_000_000_000_000_005


@pytest.mark.parametrize("seconds", [1e-9, 1e-6, 0.001, 0.05, 1.0, 60.0])
@pytest.mark.parametrize("synchronised", [True, False])
def test_the_error_of_a_clock_is_never_understated(seconds: float, *, synchronised: bool) -> None:
    estimate = error_estimate(seconds, is_synced=synchronised)
    assert 0 < estimate < 1 << 16
    assert is_synchronised(estimate) is synchronised
    assert seconds <= error_s(estimate) <= max(1.02 * seconds, 2**-32 * 5)


def test_an_acknowledgement_names_at_most_sixteen_chunks() -> None:
    whole = Acknowledgement(1, 2, 40, 3, 4, tuple(range(40)))
    assert Acknowledgement.decode(whole.encode()).indexes == tuple(range(16))
    with pytest.raises(BadPacket):
        Acknowledgement.decode(whole.encode()[:-1])


@pytest.mark.parametrize(
    "value", [b"", MessageChunk(1, 9, 3, 3, True).encode(), MessageChunk(1, 9, 0, 3, True, b"abc").encode()[:-1]]
)
def test_a_chunk_that_contradicts_itself_is_refused(value: bytes) -> None:
    with pytest.raises(BadPacket):
        MessageChunk.decode(value)


def test_far_end_uses_only_python_3_8_and_the_standard_library() -> None:
    files = sorted(Path(package.__file__).parent.glob("*.py"))
    assert [file.name for file in files] == ["__init__.py", "__main__.py", "answering.py", "clock.py", "stamp.py"]
    allowed = {
        *("__future__", "argparse", "asyncio", "clock", "collections", "contextlib", "ctypes", "dataclasses"),
        *("functools", "hashlib", "hmac", "math", "pathlib", "secrets", "select", "signal"),
    }
    allowed |= {"socket", "struct", "sys", "time", "typing", "answering", "stamp"}
    for file in files:
        tree = ast.parse(file.read_text(encoding="utf-8"), feature_version=(3, 8))
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                assert {alias.name for alias in node.names} <= allowed
            elif isinstance(node, ast.ImportFrom):
                assert node.module in allowed
