"""STAMP test packets to and from bytes: RFC 8762 in both modes, session identifier and TLVs of RFC 8972.

Authenticated packets carry HMAC-SHA-256, truncated to 16 octets, over their first 96 octets (RFC 8762, 4.4). TLVs
other than padding are protected by a separate HMAC TLV: over the sequence number and the TLVs before it (RFC 8972,
4.8). Each direction has its own key, derived from the shared one: a reflector's response is not a valid request to any
reflector. Types 252 to 254 are for private use (RFC 8972, 5.1): only this project's reflector knows them.
"""

from __future__ import annotations

import hmac
import math
import struct
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Tuple

PORT = 862
BASE_SIZE = 44
AUTHENTICATED_SIZE = 112
MIN_KEY_SIZE = 16
PADDING = 1
HMAC_TLV = 8
COUNTERS = 252
"""Private type. A request has 16 zero octets; the reply has the reflector's `ReflectorCounters`."""
CHUNK = 253
"""Private type: `MessageChunk` in a request, `Acknowledgement` in its reply; a reply to `REQUEST` has a chunk."""
REQUEST = 254
"""Private type, only if authenticated: `MessageRequest` in a request; `RequestStatus` or `CHUNK` in its reply."""
FLAG_UNRECOGNISED = 0x80
"""Set by the sender; a reflector that knows the type clears it."""

_NTP_1970 = 2_208_988_800
_ERA = 1 << 32
_HMAC_SIZE = 16
_MULTIPLIER = 255
_HMAC_RANGE = 96
_SENDER = struct.Struct(">IQHH28x")
_SENDER_AUTHENTICATED = struct.Struct(">I12xQHH68x")
_REFLECTOR = struct.Struct(">IQHHQIQHxxBxxx")
_REFLECTOR_AUTHENTICATED = struct.Struct(">I12xQHH4xQ8xI12xQH6xB15x")
_TLV = struct.Struct(">BBH")
_COUNTERS = struct.Struct(">IIII")
_CHUNK = struct.Struct(">IIHHBxH")
_ACKNOWLEDGEMENT = struct.Struct(">IIHHQQ")
_REQUEST = struct.Struct(">IIHHHxxI16s")
_STATUS = struct.Struct(">IHxxI8x16s")
_MOST_CHUNKS = 0xFFFF
_MOST_TLVS = 64
_MOST_RESIDENCE = 60 << 32
"""Maximum time of a packet at the reflector, in NTP units of 2**-32 s."""
MISSING = 16
"""Maximum number of missing chunks that one acknowledgement lists."""

TLV_SIZE = _TLV.size
HMAC_TLV_SIZE = TLV_SIZE + _HMAC_SIZE
CHUNK_HEADER_SIZE = TLV_SIZE + _CHUNK.size
ACKNOWLEDGEMENT_SIZE = TLV_SIZE + _ACKNOWLEDGEMENT.size + 2 * MISSING
"""Maximum size of an acknowledgement."""
REQUEST_SIZE = TLV_SIZE + _REQUEST.size
"""Size of a `MessageRequest`, and of the `RequestStatus` that answers it."""
TOKEN_SIZE = 16


class BadPacket(ValueError):
    """The data is no STAMP packet, or was not made with the key."""


def ntp(unix_ns: int) -> int:
    """Convert a time since 1970 to NTP's 64 bits: seconds since 1900, and units of 2**-32 s."""
    seconds, ns = divmod(unix_ns, 1_000_000_000)
    return (seconds + _NTP_1970) % _ERA << 32 | (ns << 32) // 1_000_000_000


def unix_ns(stamp: int, error: int = 1) -> int:
    """Convert a timestamp to ns since 1970; its error estimate selects NTP's or PTP's format.

    NTP's seconds restart in 2036: a small number is taken as later than that. Rounded up, so that `ntp` returns the
    timestamp to within 1 ns.
    """
    seconds, fraction = stamp >> 32, stamp & 0xFFFF_FFFF
    if error & 0x4000:
        return seconds * 1_000_000_000 + fraction
    if seconds < _ERA // 2:
        seconds += _ERA
    return (seconds - _NTP_1970) * 1_000_000_000 + (fraction * 1_000_000_000 + (1 << 31) >> 32)


def error_estimate(error_s: float, *, is_synced: bool) -> int:
    """Encode the error estimate in 16 bits: synchronised flag, NTP format, error (RFC 4656, 4.1.2)."""
    units = max(1, math.ceil(error_s * _ERA))
    scale = max(0, (units - 1).bit_length() - 8)
    multiplier = -(-units // (1 << scale))
    if multiplier > _MULTIPLIER:
        scale, multiplier = scale + 1, 128
    return (0x8000 if is_synced else 0) | min(scale, 63) << 8 | multiplier


def error_s(error: int) -> float:
    """Return the error in seconds from an error estimate."""
    return (error & 0xFF) * 2.0 ** ((error >> 8 & 0x3F) - 32)


def is_synchronised(error: int) -> bool:
    """Return whether the timestamp's clock is flagged as synchronised to UTC by an external source."""
    return bool(error & 0x8000)


@dataclass(frozen=True)
class Tlv:
    """A TLV extension (RFC 8972)."""

    type: int
    value: bytes
    flags: int = FLAG_UNRECOGNISED

    def encode(self) -> bytes:
        """Encode the TLV for a packet."""
        return _TLV.pack(self.flags, self.type, len(self.value)) + self.value


Tlvs = Tuple[Tlv, ...]


@dataclass(frozen=True)
class SenderPacket:
    """A sender's test packet; `timestamp` and `error` are the 64 and 16 bits on the wire."""

    sequence: int
    timestamp: int
    error: int
    session_id: int = 0
    tlvs: Tlvs = ()

    def encode(self, key: bytes | None = None) -> bytes:
        """Encode the packet, authenticated if there is a key."""
        form = _SENDER if key is None else _SENDER_AUTHENTICATED
        base = form.pack(self.sequence, self.timestamp, self.error, self.session_id)
        return _seal(base, self.tlvs, _derive_key(key, b"request"))


@dataclass(frozen=True)
class ReflectorPacket:
    """A reflector's response; the fields `sender_…` repeat the request."""

    sequence: int
    timestamp: int
    error: int
    session_id: int
    receive_timestamp: int
    sender_sequence: int
    sender_timestamp: int
    sender_error: int
    sender_ttl: int
    tlvs: Tlvs = ()

    def encode(self, key: bytes | None = None) -> bytes:
        """Encode the packet, authenticated if there is a key."""
        form = _REFLECTOR if key is None else _REFLECTOR_AUTHENTICATED
        base = form.pack(
            self.sequence,
            self.timestamp,
            self.error,
            self.session_id,
            self.receive_timestamp,
            self.sender_sequence,
            self.sender_timestamp,
            self.sender_error,
            self.sender_ttl,
        )
        return _seal(base, self.tlvs, _derive_key(key, b"answer"))


def decode_sender(data: bytes, key: bytes | None = None) -> SenderPacket:
    """Decode a request; raise BadPacket."""
    key = _derive_key(key, b"request")
    form, body = _verify(data, key, _SENDER, _SENDER_AUTHENTICATED)
    sequence, timestamp, error, session_id = form.unpack_from(data)
    if key is None and _is_answer(data):
        raise BadPacket("it is what a reflector has answered")
    return SenderPacket(sequence, timestamp, error, session_id, _tlvs(data[:4], body, key))


def decode_reflector(data: bytes, key: bytes | None = None) -> ReflectorPacket:
    """Decode a response; raise BadPacket."""
    key = _derive_key(key, b"answer")
    form, body = _verify(data, key, _REFLECTOR, _REFLECTOR_AUTHENTICATED)
    return replace(ReflectorPacket(*form.unpack_from(data)), tlvs=_tlvs(data[:4], body, key))


def padding(size: int, *, is_authenticated: bool) -> Tlvs:
    """Return TLVs that pad a packet to `size` octets of UDP payload; raise ValueError if that is impossible."""
    missing = size - (AUTHENTICATED_SIZE if is_authenticated else BASE_SIZE)
    if missing == 0:
        return ()
    if missing < TLV_SIZE:
        least = size - missing
        raise ValueError(f"a test packet has {least} octets, or {least + TLV_SIZE} and more: it cannot have {size}")
    return (Tlv(PADDING, bytes(missing - TLV_SIZE)),)


@dataclass(frozen=True)
class ReflectorCounters:
    """The reflector's counters for this session, without the packets that request these counters."""

    received_count: int
    """All received packets, including those not answered."""
    duplicates: int
    """Received packets that had arrived before."""
    limited_count: int
    """Received packets above the rate limit of a source; for the sender they look like loss."""
    answered_count: int

    def encode(self) -> bytes:
        """Encode as the value of a TLV."""
        return _COUNTERS.pack(self.received_count, self.duplicates, self.limited_count, self.answered_count)

    @classmethod
    def decode(cls, value: bytes) -> ReflectorCounters:
        """Decode the value of a TLV; raise BadPacket."""
        if len(value) != _COUNTERS.size:
            raise BadPacket("the counters of a reflector have 16 octets")
        return cls(*_COUNTERS.unpack(value))


@dataclass(frozen=True)
class MessageChunk:
    """A part of a message; the receiver discards the contents."""

    message: int
    message_size: int
    index: int
    count: int
    acknowledge: bool
    data: bytes = b""
    """Empty: only the acknowledgement is requested."""

    def encode(self) -> bytes:
        """Encode as the value of a TLV."""
        head = _CHUNK.pack(self.message, self.message_size, self.index, self.count, self.acknowledge, len(self.data))
        return head + self.data

    @classmethod
    def decode(cls, value: bytes) -> MessageChunk:
        """Decode the value of a TLV, which may be longer than its data; raise BadPacket."""
        if len(value) < _CHUNK.size:
            raise BadPacket("a chunk of a message is too short")
        message, size, index, count, acknowledge, length = _CHUNK.unpack_from(value)
        data = value[_CHUNK.size :][:length]
        if index >= count or len(data) != length:
            raise BadPacket("a chunk of a message contradicts itself")
        return cls(message, size, index, count, bool(acknowledge), data)


@dataclass(frozen=True)
class Acknowledgement:
    """The received part of a message, by the receiver's count and clock."""

    message: int
    size: int
    """Received octets of the message, each counted once."""
    missing: int
    """Number of chunks that have not arrived."""
    first: int
    """Arrival time of the first chunk, in NTP's 64 bits; 0: none has arrived."""
    last: int
    """Arrival time of the latest chunk that was not a duplicate."""
    indexes: tuple[int, ...]
    """Numbers of the first missing chunks."""

    def encode(self) -> bytes:
        """Encode as the value of a TLV."""
        named_indexes = self.indexes[:MISSING]
        head = _ACKNOWLEDGEMENT.pack(self.message, self.size, self.missing, len(named_indexes), self.first, self.last)
        return head + struct.pack(f">{len(named_indexes)}H", *named_indexes)

    @classmethod
    def decode(cls, value: bytes) -> Acknowledgement:
        """Decode the value of a TLV; raise BadPacket."""
        if len(value) < _ACKNOWLEDGEMENT.size:
            raise BadPacket("an acknowledgement is too short")
        message, size, missing, count, first, last = _ACKNOWLEDGEMENT.unpack_from(value)
        if len(value) != _ACKNOWLEDGEMENT.size + 2 * count:
            raise BadPacket("an acknowledgement contradicts itself")
        return cls(message, size, missing, first, last, struct.unpack_from(f">{count}H", value, _ACKNOWLEDGEMENT.size))


@dataclass(frozen=True)
class MessageRequest:
    """A request that the reflector sends the requester a message or a part: `count` chunks from `first` on."""

    message: int
    message_size: int
    first: int
    count: int
    """Number of requested chunks; 0: only the `RequestStatus` is requested."""
    packet: int
    """Maximum UDP payload of a chunk's packet."""
    pace_kbps: int
    """Rate of UDP payload at which the chunks are sent; 0: at once."""
    token: bytes = bytes(TOKEN_SIZE)
    """Token that a `RequestStatus` of this reflector gave to this address; without it nothing is sent."""

    @property
    def chunks(self) -> int:
        """The number of chunks of the whole message."""
        return -(-self.message_size // chunk_room(self.packet, is_authenticated=True))

    def chunk_octets(self, index: int) -> int:
        """Return the octets of the message in a chunk."""
        room = chunk_room(self.packet, is_authenticated=True)
        return min(room, self.message_size - index * room)

    def encode(self) -> bytes:
        """Encode as the value of a TLV."""
        numbers = (self.message, self.message_size, self.first, self.count, self.packet, self.pace_kbps)
        return _REQUEST.pack(*numbers, self.token)

    @classmethod
    def decode(cls, value: bytes) -> MessageRequest:
        """Decode the value of a TLV; raise BadPacket."""
        if len(value) != _REQUEST.size:
            raise BadPacket("a request for a message has another length")
        request = cls(*_REQUEST.unpack(value))
        fits = request.message_size > 0 and chunk_room(request.packet, is_authenticated=True) > 0
        if not fits or request.first + request.count > request.chunks or request.chunks > _MOST_CHUNKS:
            raise BadPacket("a request for a message contradicts itself")
        return request


@dataclass(frozen=True)
class RequestStatus:
    """The status of the requests for a message."""

    message: int
    sent_chunks: int
    """Number of chunks sent, including repetitions; at most 65,535."""
    rate_kbps: int
    """Maximum rate of the reflector to one address."""
    token: bytes

    def encode(self) -> bytes:
        """Encode as the value of a TLV."""
        return _STATUS.pack(self.message, min(self.sent_chunks, _MOST_CHUNKS), self.rate_kbps, self.token)

    @classmethod
    def decode(cls, value: bytes) -> RequestStatus:
        """Decode the value of a TLV; raise BadPacket."""
        if len(value) != _STATUS.size:
            raise BadPacket("the answer to a request for a message has another length")
        return cls(*_STATUS.unpack(value))


def extended_size(*, is_authenticated: bool) -> int:
    """Return the UDP payload of a packet with the HMAC that protects its extensions, but without extensions."""
    return AUTHENTICATED_SIZE + HMAC_TLV_SIZE if is_authenticated else BASE_SIZE


def chunk_room(packet: int, *, is_authenticated: bool) -> int:
    """Return the octets of a message in a packet of this UDP payload; 0 or less means none fit."""
    return packet - extended_size(is_authenticated=is_authenticated) - CHUNK_HEADER_SIZE


def reflector_key(key: bytes, reflector: str) -> bytes:
    """Return the key (as text) of one reflector, derived from the shared secret: no other reflector accepts it."""
    return hmac.digest(key, b"STAMP reflector " + reflector.encode(), "sha256").hex().encode()


@lru_cache(maxsize=64)
def _derive_key(key: bytes | None, direction: bytes) -> bytes | None:
    return None if key is None else hmac.digest(key, b"STAMP " + direction, "sha256")


def _is_answer(data: bytes) -> bool:
    """Return whether an unauthenticated packet is a reflector's: its receive time is shortly before its timestamp."""
    timestamp: int
    receive_timestamp: int
    _, timestamp, _, _, receive_timestamp, *_ = _REFLECTOR.unpack_from(data)
    return 0 < receive_timestamp <= timestamp < receive_timestamp + _MOST_RESIDENCE


def _digest(key: bytes, data: bytes) -> bytes:
    return hmac.digest(key, data, "sha256")[:_HMAC_SIZE]


def _seal(base: bytes, tlvs: Tlvs, key: bytes | None) -> bytes:
    body = b"".join(tlv.encode() for tlv in tlvs)
    if key is None:
        return base + body
    if any(tlv.type != PADDING for tlv in tlvs):
        body += Tlv(HMAC_TLV, _digest(key, base[:4] + body), tlvs[0].flags & FLAG_UNRECOGNISED).encode()
    return base + _digest(key, base) + body


def _verify(
    data: bytes, key: bytes | None, plain: struct.Struct, authenticated_form: struct.Struct
) -> tuple[struct.Struct, bytes]:
    """Return the base packet's format and the bytes after it; raise BadPacket if it was not made with the key."""
    if key is None:
        if len(data) < BASE_SIZE:
            raise BadPacket("shorter than a test packet")
        return plain, data[BASE_SIZE:]
    if len(data) < AUTHENTICATED_SIZE:
        raise BadPacket("shorter than an authenticated test packet")
    if not hmac.compare_digest(_digest(key, data[:_HMAC_RANGE]), data[_HMAC_RANGE:AUTHENTICATED_SIZE]):
        raise BadPacket("its HMAC is wrong")
    return authenticated_form, data[AUTHENTICATED_SIZE:]


def _tlvs(sequence: bytes, body: bytes, key: bytes | None) -> Tlvs:
    """Parse TLVs; the HMAC TLV is verified and left out. Octets that are no TLVs (TWAMP padding) end the list."""
    tlvs: list[Tlv] = []
    place = 0
    is_protected = key is None
    while place < len(body):
        if len(body) - place < TLV_SIZE:
            break
        flags, kind, length = _TLV.unpack_from(body, place)
        value = body[place + TLV_SIZE : place + TLV_SIZE + length]
        if not kind or len(value) != length:
            break
        if kind == HMAC_TLV and key is not None:
            if not hmac.compare_digest(_digest(key, sequence + body[:place]), value):
                raise BadPacket("the HMAC of its extensions is wrong")
            is_protected = True
            break
        if len(tlvs) == _MOST_TLVS:
            raise BadPacket("it has more than 64 extensions")
        tlvs.append(Tlv(kind, value, flags))
        place += TLV_SIZE + length
    if not is_protected and any(tlv.type != PADDING for tlv in tlvs):
        raise BadPacket("its extensions are not authenticated")
    return tuple(tlvs)
