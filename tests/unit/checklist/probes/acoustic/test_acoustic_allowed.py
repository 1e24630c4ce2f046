"""What may be sent to a modem: the lines of devices.md 5, and whatever else somebody may think of."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from row_subtests import for_each_row

from atlantis_netcfg.checklist.probes import Consent, Listen, Place, Say
from atlantis_netcfg.checklist.probes import registry as allowed_messages
from atlantis_netcfg.checklist.probes.acoustic import modem, seatrac

CONSENT = Consent("Sparus is in the water, and its modem may transmit")
QUERIES = ["S", "E", "I", "T", "V", "P", "BL", "BR", "BV", "CLOCK", "CA", "AL", "AR", "L", "ZU"]
READS = [*(f"AT?{query}" for query in QUERIES), "ATI0", "ATI1", "ATI7", "AT&V"]
DENIED = [
    *("AT!AL2", "AT!L0", "AT!ZU1", "AT@CTRL", "AT@ZU1", "AT@ZF1", "AT&W", "AT&F", "ATZ0", "ATZ1", "ATZ3", "ATZ4"),
    *("ATA", "ATN", "ATD", "ATH", "ATH0", "ATC", "ATO", "AT*SEND,5,2,hello", "AT*SENDIM,5,2,ack,hello"),
    *("AT*SENDIM,5,2,noack,hello", "AT*SENDIMS,5,2,0,hello", "AT*SENDPBM,5,2,hello", ""),
]
SEATRAC_READS = [0x01, 0x02, 0x10, 0x11, 0x15, 0x21, 0x3A]
SEATRAC_NEVER = [0x03, 0x0D, 0x0E, 0x0F, 0x12, 0x16, 0x17, 0x18, 0x19, 0x20, 0x22]
SEATRAC_ACTIVE = [0x40, 0x48, 0x50, 0x5B, 0x60]


def said(data: bytes, *, transport: str = "tcp") -> Listen:
    return Listen(name="any", place=Place.LAPTOP, transport=transport, say=(Say(data, b""),))  # type: ignore[arg-type]


@pytest.mark.parametrize("query", READS)
def test_query_is_allowed(query: str) -> None:
    assert modem.ask_at(query, b"").data == f"+++{query}\n".encode()
    assert allowed_messages.find_refusal(said(f"+++{query}\n".encode()), active=False) is None


@for_each_row("command", DENIED)
def test_command_that_does_more_is_refused(command: str) -> None:
    with pytest.raises(modem.NeverSaid):
        modem.ask_at(command, b"")
    assert modem.refused_reason(f"+++{command}\n".encode(), active=False)
    whole = command == "AT*SENDIM,5,2,ack,hello"
    assert (modem.refused_reason(f"+++{command}\n".encode(), active=True) is None) == whole


FORMS = [
    *("{q}\n", "+++{q}", "+++{q}\r\n", "+++ {q}\n", "+++{q} \n", " +++{q}\n", "++++{q}\n", "+++{q}\n\n", "+++{q},1\n"),
    *("+++{q}\n+++{q}\n", "+++{q};AT&W\n", "+++{q}\nAT&W\n", "+++{q}\x00\n", "+++AT&W\n+++{q}\n"),
]


@pytest.mark.parametrize("query", READS)
def test_query_in_another_form_is_refused(query: str) -> None:
    for form in FORMS:
        assert modem.refused_reason(form.format(q=query).encode(), active=True), form


@pytest.mark.parametrize("query", READS)
def test_query_in_lower_case_is_refused(query: str) -> None:
    assert modem.refused_reason(f"+++{query.lower()}\n".encode(), active=True)


@pytest.mark.parametrize("number", SEATRAC_READS)
def test_reading_command_is_allowed(number: int) -> None:
    assert modem.refused_reason(modem.ask_seatrac(number, b"").data, active=False) is None
    assert modem.refused_reason(seatrac.command(bytes([number, 1])), active=True), "a parameter"


@pytest.mark.parametrize("number", [*SEATRAC_NEVER, *SEATRAC_ACTIVE])
def test_non_reading_command_is_refused_except_a_ping(number: int) -> None:
    _passes_at_most_as_one_ping(number)


def test_other_numbers_are_refused_except_a_ping() -> None:
    for number in range(256):
        if number not in SEATRAC_READS:
            _passes_at_most_as_one_ping(number)


def _passes_at_most_as_one_ping(number: int) -> None:
    with pytest.raises(modem.NeverSaid):
        modem.ask_seatrac(number, b"")
    for record in (b"", b"\x00", b"\x02", b"\x00\x04", b"\x10\x04", b"\x02\x02", b"\x02\x04\x00"):
        assert modem.refused_reason(seatrac.command(bytes([number]) + record), active=True)
    assert (modem.refused_reason(seatrac.command(bytes([number, 2, 4])), active=True) is None) == (number == 0x40)


def test_command_table_matches_the_known_facts() -> None:
    by_use = {use: [number for number, one in modem.SEATRAC.items() if one.use is use] for use in modem.ModemUse}
    assert by_use == {
        modem.ModemUse.READ: SEATRAC_READS,
        modem.ModemUse.NEVER: SEATRAC_NEVER,
        modem.ModemUse.ACTIVE: SEATRAC_ACTIVE,
    }


@pytest.mark.parametrize("payload", [b"\x01", b"\x15", b"\x40\x02\x04"])
def test_malformed_or_repeated_frame_is_refused(payload: bytes) -> None:
    data = seatrac.command(payload)
    wrong = b"#" + payload.hex().upper().encode() + b"0000\n\r"
    whole = {data[:-1], data[:-2], data + data, b" " + data, data.lower(), wrong, data[:-2] + b"\r\n", b"$" + data[1:]}
    for other in whole - {data}:
        assert modem.refused_reason(other, active=True), other


def test_message_and_ping_need_consent_in_the_water() -> None:
    assert modem.refused_reason(modem.message("ATLANTIS", 2, CONSENT, b"", within_s=1).data, active=True) is None
    for consent in (None, Consent("Sparus may transmit")):
        with pytest.raises(modem.NeverSaid, match="nobody has consented"):
            modem.message("ATLANTIS", 2, consent, b"", within_s=1)
        with pytest.raises(modem.NeverSaid, match="nobody has consented"):
            modem.ping(2, consent, b"", within_s=1)


@pytest.mark.parametrize(
    ("text", "to"), [("A" * 65, 2), ("", 2), ("A B", 2), ("A\nB", 2), ("A", 0), ("A", 255), ("A", -1)]
)
def test_long_odd_or_broadcast_message_is_refused(text: str, to: int) -> None:
    with pytest.raises(modem.NeverSaid):
        modem.message(text, to, CONSENT, b"", within_s=1)


@pytest.mark.parametrize("data", [b"+++AT*SENDIM,4,2,ack,hello\n", b"+++AT*SENDIM,5,2,ack,he\n+++AT&W\n", b"hello\n"])
def test_message_with_wrong_length_is_refused(data: bytes) -> None:
    assert modem.refused_reason(data, active=True)


@pytest.mark.parametrize("beacon", [0, 16, 255])
def test_ping_to_an_invalid_beacon_is_refused(beacon: int) -> None:
    with pytest.raises(modem.NeverSaid):
        modem.ping(beacon, CONSENT, b"", within_s=1)


def test_nothing_is_sent_to_a_receive_only_stream() -> None:
    assert allowed_messages.find_refusal(said(b"+++AT?S\n", transport="udp"), active=True)


@pytest.mark.parametrize("data", [b'?WATCH={"enable":true,"json":true}\n', b"?VERSION;\n"])
def test_gpsd_allows_only_its_fixed_requests(data: bytes) -> None:
    assert allowed_messages.find_refusal(said(data), active=False) is None
    assert allowed_messages.find_refusal(said(data + data), active=False)
    assert allowed_messages.find_refusal(said(b'?DEVICE={"path":"/dev/ttyUSB0","bps":4800}\n'), active=False)


ANYTHING = st.one_of(
    st.binary(max_size=60),
    st.text(alphabet="AT?!@&*+#$IVWFZSENDM,0123456789 \r\n\x00abc", max_size=40).map(str.encode),
    st.lists(st.sampled_from([*READS, *DENIED, "+++", "\n", "\r", " ", "#01C1C0", ";"]), max_size=6).map(
        lambda words: "".join(words).encode()
    ),
    st.binary(min_size=1, max_size=4).map(seatrac.command),
)


@settings(max_examples=150)
@given(ANYTHING)
def test_only_listed_commands_are_allowed(data: bytes) -> None:
    passes = {f"+++{query}\n".encode() for query in [*READS, *(f"ATI{n}" for n in range(10))]}
    passes |= {seatrac.command(bytes([number])) for number in SEATRAC_READS}
    assert (modem.refused_reason(data, active=False) is None) == (data in passes)
