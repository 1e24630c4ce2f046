"""Value syntaxes: what goes in, how it is printed, what is refused."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from row_subtests import for_each_row

from atlantis_netcfg.emulator.routeros.values import (
    Address,
    AddressesValue,
    BadValue,
    Bool,
    Choice,
    Choices,
    FlagValue,
    GatewayValue,
    Granted,
    HostPrefix,
    Int,
    Mac,
    Matcher,
    Moment,
    Not,
    Pattern,
    Ports,
    Prefixes,
    Ranges,
    Ref,
    Refs,
    Size,
    Text,
    Time,
    Topics,
    ValueType,
    interval,
    seconds,
    spell,
)


class Names:
    """One interface, ether1 (*1), and one table, main (*0)."""

    KNOWN = {("interface", 1): "ether1", ("table", 0): "main"}  # noqa: RUF012 - never written

    def id_of(self, space: str, name: str) -> int | None:
        return next((number for (where, number), known in self.KNOWN.items() if (where, known) == (space, name)), None)

    def name_of(self, space: str, number: int) -> str | None:
        return self.KNOWN.get((space, number))


NAMES = Names()
INTERFACE = Ref(("interface",), ("all",))

GOOD: list[tuple[ValueType, str, str]] = [
    (Text(), "a b", "a b"),
    (Bool(), "true", "yes"),
    (Bool(), "no", "no"),
    (FlagValue(), "yes", ""),
    (Int(0, 99), "007", "7"),
    (Int(hexadecimal=True), "32768", "0x8000"),
    (Int(hexadecimal=True), "0x8000", "0x8000"),
    (Int(words=("auto",)), "auto", "auto"),
    (Size(), "4096", "4096KiB"),
    (Choice(("a", "b")), "b", "b"),
    (Choices(("a", "b", "c")), "c,a", "a,c"),
    (Choices(("syn", "ack"), signed=True), "!ack,syn", "syn,!ack"),
    (Choices(("a", "b"), ordered=False), "b,a", "b,a"),
    (Not(Choice(("tcp",))), "!tcp", "!tcp"),
    (Pattern(r"\d+"), "12", "12"),
    (Time(), "90", "1m30s"),
    (Time(), "1d2h3m4s", "1d2h3m4s"),
    (Time(), "00:10:00", "10m"),
    (Time(), "2d 01:00:00", "2d1h"),
    (Time(), "1s500ms", "1s500ms"),
    (Time(), "10080m", "1w"),
    (Time(), "0", "0s"),
    (Time(words=("none",)), "none", "none"),
    (Moment(words=("startup",)), "startup", "startup"),
    (Moment(), "2026-01-31", "2026-01-31"),
    (Address(), "2001:DB8::1", "2001:db8::1"),
    (Address(dns=True), "vpn.example.org", "vpn.example.org"),
    (AddressesValue(), "", ""),
    (AddressesValue(), "1.1.1.1,::1", "1.1.1.1,::1"),
    (HostPrefix(), "10.0.0.1/24", "10.0.0.1/24"),
    (HostPrefix(), "10.0.0.1", "10.0.0.1/32"),
    (Prefixes(), "10.0.0.5/24", "10.0.0.0/24"),
    (Prefixes(), "10.0.0.5", "10.0.0.5/32"),
    (Prefixes(many=True), "", ""),
    (Prefixes(many=True), "10.0.0.5/24,::1", "10.0.0.0/24,::1/128"),
    (Matcher(), "10.0.0.1/32", "10.0.0.1"),
    (Matcher(), "10.0.0.9/24", "10.0.0.0/24"),
    (Matcher(), "10.0.0.1-10.0.0.9", "10.0.0.1-10.0.0.9"),
    (Matcher(dns=True), "vpn.example.org", "vpn.example.org"),
    (Ranges(), "10.0.0.1-10.0.0.9,10.0.1.0/24", "10.0.0.1-10.0.0.9,10.0.1.0/24"),
    (Mac(), "02-00-5e-00-01-1a", "02:00:5E:00:01:1A"),
    (Ports(), "22,8000-8010", "22,8000-8010"),
    (INTERFACE, "ether1", "ether1"),
    (INTERFACE, "*1", "ether1"),
    (INTERFACE, "all", "all"),
    (Refs(INTERFACE), "", ""),
    (GatewayValue(), "10.0.0.1", "10.0.0.1"),
    (GatewayValue(), "ether1", "ether1"),
    (GatewayValue(), "10.0.0.1%ether1", "10.0.0.1%ether1"),
    (GatewayValue(), "10.0.0.1@main", "10.0.0.1@main"),
    (Topics(("info", "dhcp")), "info,!dhcp", "info,!dhcp"),
    (Granted(("read", "write")), "read", "read,!write"),
]


@for_each_row(("kind", "text", "printed"), GOOD)
def test_normalised(kind: ValueType, text: str, printed: str) -> None:
    stored = kind.parse(text, NAMES)
    assert spell(stored, NAMES) == printed
    assert kind.parse(spell(stored, NAMES), NAMES) == stored


INVALID = "invalid value for argument {}"
OFFERED = "input does not match any value of {}"
BAD: list[tuple[ValueType, str, str]] = [
    (Text(longest=3), "four", INVALID),
    (Text(empty=False), "", INVALID),
    (Bool(), "perhaps", "value of {} must be either yes or no"),
    (Bool(), "", "value of {} must be either yes or no"),
    (FlagValue(), "no", INVALID),
    (Int(0, 99), "100", "value of {} out of range (0..99)"),
    (Int(), "-1", INVALID),
    (Int(), "1.5", INVALID),
    (Int(), "ff", INVALID),
    (Size(), "4MiB", INVALID),
    (Choice(("a",)), "A", OFFERED),
    (Choices(("a",)), "a,a", OFFERED),
    (Choices(("a",)), "!a", OFFERED),
    (Not(Text()), "!", INVALID),
    (Pattern(r"\d+"), "x", INVALID),
    (Time(), "soon", INVALID),
    (Time(), "5 m", INVALID),
    (Time(4, 30), "1m", "value of {} out of range (4s..30s)"),
    (Moment(), "tomorrow", INVALID),
    (Address(), "10.0.0", INVALID),
    (Address(), "010.0.0.1", INVALID),
    (Address(v6=False), "::1", INVALID),
    (Address(dns=True), "10.0.0.256", INVALID),
    (AddressesValue(), "1.1.1.1,", INVALID),
    (HostPrefix(), "10.0.0.1/33", INVALID),
    (Prefixes(), "10.0.0.0/24,10.0.1.0/24", INVALID),
    (Prefixes(v6=False), "::/0", INVALID),
    (Matcher(), "vpn.example.org", INVALID),
    (Matcher(), "10.0.0.9-10.0.0.1", INVALID),
    (Matcher(), "10.0.0.9-", "value of range must have ip address after '-'"),
    (Mac(), "02:00:5E:00:01", INVALID),
    (Mac(), "02:00-5E:00:01:1A", INVALID),
    (Ports(), "70000", INVALID),
    (Ports(), "90-80", INVALID),
    (Ports(single=True), "1,2", INVALID),
    (INTERFACE, "ether2", OFFERED),
    (INTERFACE, "*2", OFFERED),
    (GatewayValue(), "ether2", OFFERED),
    (GatewayValue(), "10.0.0.1%ether2", OFFERED),
    (GatewayValue(), "10.0.0.1@elsewhere", INVALID),
    (GatewayValue(), "10.0.0.300", INVALID),
    (Topics(("info",)), "debug", OFFERED),
    (Granted(("read",)), "fly", OFFERED),
]


@for_each_row(("kind", "text", "words"), BAD)
def test_refused(kind: ValueType, text: str, words: str) -> None:
    with pytest.raises(BadValue) as refusal:
        kind.parse(text, NAMES)
    assert refusal.value.words == words


def test_the_api_spells_some_values_otherwise() -> None:
    assert Bool().show("yes") == "true"
    assert Size().show("2048KiB") == "2048"
    assert Choice(("yes",)).show("yes") == "yes"


@given(st.integers(0, 10**7))
def test_intervals_read_back(value: int) -> None:
    assert seconds(interval(value)) == value
