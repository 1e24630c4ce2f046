"""The two languages, by the payloads of devices.md 5, and by anything at all."""

import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from atlantis_netcfg.checklist.probes.acoustic import evologics, seatrac
from atlantis_netcfg.emulator.acoustic import EvologicsSpec, SeatracSpec

BARE_FIX = (
    b"USBLLONG,1464207778.381274,1464207778.075953,2,13.6015,3.1369,1.7311,13.6015,3.1369,1.7311,"
    b"0.0000,-0.0000,0.0000,9377,-54,106,0.1698\r\n"
)
FRAMED_FIX = (
    b"+++AT:118:USBLLONG,455.600823,455.346033,1,1.2601,0.9197,-0.3958,1.2601,0.9197,-0.3958,"
    b"0.0000,-0.0000,0.0000,1073,-37,146,0.0022\r\n"
)
MESSAGE = b"+++AT:37:RECVIM,5,1,2,ack,312,14,11,0.03,\x31\x32\x01\x00\x35\r\n"
MULTIPATH = (
    b"+++AT?P:96:10    10   \n11    12   \n12    14   \n13    16   \n15    18   \n16    20   \n"
    b"17    22   \n100   240  \n\r\n"
)
LISTING = (
    b"Source Level: 3\r\nSource Level Control: 0\r\nGain: 0\r\nCarrier Waveform ID: 1\r\nLocal Address: 2\r\n"
    b"Highest Address: 14\r\nCluster Size: 10\r\nPacket Time: 750\r\nRetry Count: 3\r\nRetry Timeout: 1500\r\n"
    b"Wake Up Active Time: 12\r\nWake Up Period: 12\r\nPromiscuous Mode: 1\r\nSound Speed: 1500\r\n"
    b"IM Rerty Count: 1\r\nPool Size: 16384\r\nHold Timeout: 0\r\nIdle Timeout: 120\r\n\r\n"
)


def test_bare_and_framed_fixes_are_read() -> None:
    bare, framed = evologics.fixes(evologics.pieces(BARE_FIX + FRAMED_FIX))
    assert (bare.remote, bare.position_m, bare.propagation_us) == (2, (13.6015, 3.1369, 1.7311), 9377)
    assert (bare.rssi_db, bare.integrity, bare.accuracy, round(bare.clock_s - bare.measured_s, 3)) == (
        -54,
        106,
        0.1698,
        0.305,
    )
    assert (framed.remote, framed.propagation_us, framed.rssi_db, framed.integrity) == (1, 1073, -37, 146)


def test_direction_is_a_fix_without_a_position() -> None:
    line = b"USBLANGLES,455.6,455.3,3,0.1,0.2,0.3,0.4,0.0,0.0,0.0,-40,120,0.01\r\n"
    (fix,) = evologics.fixes(evologics.pieces(line))
    assert (fix.remote, fix.position_m, fix.propagation_us, fix.rssi_db, fix.integrity) == (3, None, None, -40, 120)


@pytest.mark.parametrize(
    "line",
    [
        BARE_FIX.replace(b",0.1698", b""),
        BARE_FIX.replace(b"9377", b"nan"),
        BARE_FIX.replace(b",2,", b",2.5,"),
        BARE_FIX.replace(b"USBLLONG", b"USBLSHORT"),
        BARE_FIX[:-2],
    ],
)
def test_incomplete_fix_is_ignored(line: bytes) -> None:
    assert evologics.fixes(evologics.pieces(line)) == ()


def test_a_body_may_be_binary() -> None:
    (piece,) = evologics.pieces(MESSAGE)
    assert (piece.command, piece.body[-5:], piece.end) == ("AT", b"12\x01\x005", len(MESSAGE))


def test_response_may_have_many_lines() -> None:
    (piece,) = evologics.pieces(MULTIPATH)
    assert (piece.command, len(piece.body), piece.body.count(b"\n")) == ("AT?P", 96, 8)


def test_nested_frame_is_not_read() -> None:
    inner = b"x\r\n+++AT?S:13:OFFLINE ALARM\r\ny"
    stream = b"raw\x00data+++AT:%d:%b\r\n+++AT?S:23:INITIATION LISTEN 16384\r\n" % (len(inner), inner)
    heard = evologics.pieces(stream)
    assert [piece.command for piece in heard] == ["AT", "AT?S"]
    assert evologics.state(heard) == "INITIATION LISTEN"


@pytest.mark.parametrize("cut", range(1, 60, 7))
def test_content_of_a_cut_frame_is_not_read(cut: int) -> None:
    inner = b"x\r\n+++AT?S:13:OFFLINE ALARM\r\n" + b"y" * 60
    stream = b"+++AT:%d:%b\r\n" % (len(inner), inner)
    assert evologics.state(evologics.pieces(stream[:-cut])) is None


def test_frame_with_wrong_length_is_ignored() -> None:
    heard = evologics.pieces(b"+++AT?S:5:INITIATION LISTEN 16384\r\n+++AT?E:3:-54\r\n")
    assert evologics.state(heard) is None
    assert evologics.answer(heard, "AT?E") == "-54"


@pytest.mark.parametrize("frame", [b"%b", b"+++AT&V:%d:%b\r\n"])
def test_listing_is_read(frame: bytes) -> None:
    body = LISTING[:-2]
    stream = frame % LISTING if frame == b"%b" else frame % (len(body), body)
    told = evologics.settings(evologics.pieces(stream))
    assert told is not None
    assert (len(told.values), told.values["Local Address"], told.values["IM Retry Count"], told.pending) == (
        18,
        2,
        1,
        (),
    )


def test_pending_changes_are_read_and_unknown_names_skipped() -> None:
    stream = (
        LISTING.replace(b"Gain", b"[*]Gain").replace(b"IM Rerty", b"[*]IM Retry").replace(b"Hold", b"Colour: 7\r\nHold")
    )
    told = evologics.settings(evologics.pieces(stream))
    assert told is not None
    assert (told.pending, "Colour" in told.values) == (("Gain", "IM Retry Count"), False)


@pytest.mark.parametrize(
    ("stream", "state"),
    [
        (b"+++INITIATION LISTEN 16384\r\n", "INITIATION LISTEN"),
        (b"INITIATION LISTEN 0 0 0\r\n", "INITIATION LISTEN"),
        (b"+++AT?S:13:OFFLINE ALARM\r\n", "OFFLINE ALARM"),
        (b"+++AT?S:6:ONLINE\r\n", "ONLINE"),
        (b"+++AT?S:6:ASLEEP\r\n", "ASLEEP"),
        (b"+++AT?S:12:BUSY EXAMPLE\r\n", None),
        (b"we are ONLINE here\r\n", None),
        (b"", None),
    ],
)
def test_states_are_read(stream: bytes, state: str | None) -> None:
    assert evologics.state(evologics.pieces(stream)) == state


@pytest.mark.parametrize(
    ("text", "number"),
    [
        ("65", 65.0),
        ("[*]765", 765.0),
        ("65.76", 65.76),
        ("-54 dB", -54.0),
        ("65ABC", None),
        ("ABC", None),
        ("", None),
        (None, None),
    ],
)
def test_numbers_are_read(text: str | None, number: float | None) -> None:
    assert evologics.number(text) == number


def test_beacon_payloads_are_encoded_and_read() -> None:
    assert [seatrac.command(bytes([number])).strip() for number in (0x01, 0x02, 0x15, 0x3A)] == [
        *(b"#01C1C0", b"#0281C1", b"#15C1CF", b"#3A8013")
    ]
    stream = b"$0140E2010089A6\r\n$3A3B5373\n\r$43340266D5\r\nnoise$3A3B5374\r\n"
    heard = seatrac.answers(stream)
    assert [(one.number, one.record) for one in heard] == [
        (0x01, struct.pack("<I", 123456)),
        (0x3A, b"\x3b"),
        (0x43, b"\x34\x02"),
    ]
    assert seatrac.count_damaged(stream) == 1


def test_beacon_records_are_read() -> None:
    spec = SeatracSpec(beacon=7, in_water=True, auto_sound_speed=False, sound_speed_mps=1483.2, suspect=True)
    records = spec.records()
    told = seatrac.settings(records[0x15])
    assert told is not None
    assert (told.beacon, told.sound_speed_mps, told.auto_sound_speed) == (7, 1483.2, False)
    status = seatrac.status(records[0x10])
    assert status is not None
    assert (status.supply_v, status.depth_m, status.sound_speed_mps) == (15.2, 1.2, 1483.2)
    fix = seatrac.fix(spec.fix(3))
    assert fix is not None
    assert (fix.beacon, fix.range_m, fix.fit_error, fix.position_m, fix.suspect) == (
        3,
        14.1,
        0.4,
        (3.1, 13.7, 0.0),
        True,
    )
    assert seatrac.info(records[0x02]) == "SeaTrac X150, serial number 1, firmware 2.2.1000"


def test_cut_records_are_ignored() -> None:
    for whole, read in ((SeatracSpec().fix(3), seatrac.fix), (SeatracSpec().records()[0x02], seatrac.info)):
        assert [read(whole[:end]) for end in range(16 if read is seatrac.fix else 20)] == [None] * (
            16 if read is seatrac.fix else 20
        )
        assert read(whole[:-12]) is None
    assert seatrac.settings(bytes(109)) is None
    assert seatrac.status(bytes(8)) is None


def test_short_status_has_no_values() -> None:
    assert seatrac.status(SeatracSpec(environment=False).records()[0x10]) == seatrac.BeaconStatus()


WORDS = [
    MESSAGE,
    FRAMED_FIX,
    BARE_FIX,
    LISTING,
    MULTIPATH,
    b"+++AT?S:",
    b"+++AT:",
    b"$42",
    b"\r\n",
    b":",
    b",",
    b"+++",
    b"\x00",
]
STREAMS = st.one_of(
    st.binary(max_size=200),
    st.lists(
        st.one_of(st.sampled_from(WORDS), st.binary(max_size=8), st.integers(0, 300).map(lambda n: b"%d:" % n))
    ).map(b"".join),
)


@settings(max_examples=150)
@given(STREAMS)
def test_readers_never_raise(stream: bytes) -> None:
    heard = evologics.pieces(stream)
    assert all(0 < piece.end <= len(stream) for piece in heard)
    evologics.fixes(heard)
    evologics.settings(heard)
    evologics.state(heard)
    for one in seatrac.answers(stream):
        seatrac.fix(one.record)
    for read in (seatrac.fix, seatrac.settings, seatrac.status, seatrac.info):
        read(stream)


@settings(max_examples=50)
@given(st.binary(max_size=80), st.binary(max_size=20))
def test_any_body_round_trips(body: bytes, raw: bytes) -> None:
    stream = raw.replace(b"+", b"") + b"+++AT:%d:%b\r\n" % (len(body), body)
    assert [piece.body for piece in evologics.pieces(stream) if piece.command] == [body]


@settings(max_examples=50)
@given(st.binary(min_size=1, max_size=40))
def test_any_record_round_trips(payload: bytes) -> None:
    command = seatrac.command(payload)
    assert seatrac.payload_of(command) == payload
    (answer,) = seatrac.answers(b"$" + command[1:])
    assert bytes([answer.number]) + answer.record == payload


def test_emulated_listing_matches_the_known_facts() -> None:
    assert EvologicsSpec(local_address=2, carrier=1).listing() + b"\r\n" == LISTING
