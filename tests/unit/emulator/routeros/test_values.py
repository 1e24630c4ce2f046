"""Value syntaxes: what goes in, how it is printed, what is refused."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from row_subtests import for_each_row

from atlantis_netcfg.emulator.routeros import values


class Names:
    """One interface, ether1 (*1), and one table, main (*0)."""

    KNOWN = {("interface", 1): "ether1", ("table", 0): "main"}  # noqa: RUF012 - never written

    def id_of(self, space: str, name: str) -> int | None:
        return next((number for (where, number), known in self.KNOWN.items() if (where, known) == (space, name)), None)

    def name_of(self, space: str, number: int) -> str | None:
        return self.KNOWN.get((space, number))


NAMES = Names()
INTERFACE = values.Ref(("interface",), ("all",))

GOOD: list[tuple[values.ValueType, str, str]] = [
    (values.Text(), "a b", "a b"),
    (values.Bool(), "true", "yes"),
    (values.Bool(), "no", "no"),
    (values.FlagValue(), "yes", ""),
    (values.Int(0, 99), "007", "7"),
    (values.Int(hexadecimal=True), "32768", "0x8000"),
    (values.Int(hexadecimal=True), "0x8000", "0x8000"),
    (values.Int(words=("auto",)), "auto", "auto"),
    (values.Size(), "4096", "4096KiB"),
    (values.Choice(("a", "b")), "b", "b"),
    (values.Choices(("a", "b", "c")), "c,a", "a,c"),
    (values.Choices(("syn", "ack"), has_signs=True), "!ack,syn", "syn,!ack"),
    (values.Choices(("a", "b"), is_ordered=False), "b,a", "b,a"),
    (values.Not(values.Choice(("tcp",))), "!tcp", "!tcp"),
    (values.Pattern(r"\d+"), "12", "12"),
    (values.Time(), "90", "1m30s"),
    (values.Time(), "1d2h3m4s", "1d2h3m4s"),
    (values.Time(), "00:10:00", "10m"),
    (values.Time(), "2d 01:00:00", "2d1h"),
    (values.Time(), "1s500ms", "1s500ms"),
    (values.Time(), "10080m", "1w"),
    (values.Time(), "0", "0s"),
    (values.Time(words=("none",)), "none", "none"),
    (values.Moment(words=("startup",)), "startup", "startup"),
    (values.Moment(), "2026-01-31", "2026-01-31"),
    (values.Address(), "2001:DB8::1", "2001:db8::1"),
    (values.Address(dns=True), "vpn.example.org", "vpn.example.org"),
    (values.AddressesValue(), "", ""),
    (values.AddressesValue(), "1.1.1.1,::1", "1.1.1.1,::1"),
    (values.HostPrefix(), "10.0.0.1/24", "10.0.0.1/24"),
    (values.HostPrefix(), "10.0.0.1", "10.0.0.1/32"),
    (values.Prefixes(), "10.0.0.5/24", "10.0.0.0/24"),
    (values.Prefixes(), "10.0.0.5", "10.0.0.5/32"),
    (values.Prefixes(many=True), "", ""),
    (values.Prefixes(many=True), "10.0.0.5/24,::1", "10.0.0.0/24,::1/128"),
    (values.Matcher(), "10.0.0.1/32", "10.0.0.1"),
    (values.Matcher(), "10.0.0.9/24", "10.0.0.0/24"),
    (values.Matcher(), "10.0.0.1-10.0.0.9", "10.0.0.1-10.0.0.9"),
    (values.Matcher(dns=True), "vpn.example.org", "vpn.example.org"),
    (values.Ranges(), "10.0.0.1-10.0.0.9,10.0.1.0/24", "10.0.0.1-10.0.0.9,10.0.1.0/24"),
    (values.Mac(), "02-00-5e-00-01-1a", "02:00:5E:00:01:1A"),
    (values.Ports(), "22,8000-8010", "22,8000-8010"),
    (values.Moment(), "9:00", "09:00:00"),
    (values.Moment(), "0:0:0", "00:00:00"),
    (values.Moment(), "23:59:59", "23:59:59"),
    (values.Plausible(), "!10.0.0.1-10.0.0.9,fe80::1,vpn.example.org", "!10.0.0.1-10.0.0.9,fe80::1,vpn.example.org"),
    (values.Plausible(ports=True), "http,8000-8010", "http,8000-8010"),
    (values.Refs(INTERFACE, between="/"), "ether1/all", "ether1/all"),
    (INTERFACE, "ether1", "ether1"),
    (INTERFACE, "*1", "ether1"),
    (INTERFACE, "all", "all"),
    (values.Refs(INTERFACE), "", ""),
    (values.GatewayValue(), "10.0.0.1", "10.0.0.1"),
    (values.GatewayValue(), "ether1", "ether1"),
    (values.GatewayValue(), "10.0.0.1%ether1", "10.0.0.1%ether1"),
    (values.GatewayValue(), "10.0.0.1@main", "10.0.0.1@main"),
    (values.Topics(("info", "dhcp")), "info,!dhcp", "info,!dhcp"),
    (values.PolicySet(("read", "write")), "read", "read,!write"),
]


@for_each_row(("kind", "text", "printed"), GOOD)
def test_values_are_normalised(kind: values.ValueType, text: str, printed: str) -> None:
    stored = kind.parse(text, NAMES)
    assert values.spell(stored, NAMES) == printed
    assert kind.parse(values.spell(stored, NAMES), NAMES) == stored


INVALID = "invalid value for argument {}"
OFFERED = "input does not match any value of {}"
BAD: list[tuple[values.ValueType, str, str]] = [
    (values.Text(longest=3), "four", INVALID),
    (values.Text(empty=False), "", INVALID),
    (values.Bool(), "perhaps", "value of {} must be either yes or no"),
    (values.Bool(), "", "value of {} must be either yes or no"),
    (values.FlagValue(), "no", INVALID),
    (values.Int(0, 99), "100", "value of {} out of range (0..99)"),
    (values.Int(), "-1", INVALID),
    (values.Int(), "1.5", INVALID),
    (values.Int(), "ff", INVALID),
    (values.Size(), "4MiB", INVALID),
    (values.Choice(("a",)), "A", OFFERED),
    (values.Choices(("a",)), "a,a", OFFERED),
    (values.Choices(("a",)), "!a", OFFERED),
    (values.Not(values.Text()), "!", INVALID),
    (values.Pattern(r"\d+"), "x", INVALID),
    (values.Time(), "soon", INVALID),
    (values.Time(), "5 m", INVALID),
    (values.Time(4, 30), "1m", "value of {} out of range (4s..30s)"),
    (values.Moment(), "tomorrow", INVALID),
    (values.Address(), "10.0.0", INVALID),
    (values.Address(), "010.0.0.1", INVALID),
    (values.Address(v6=False), "::1", INVALID),
    (values.Address(dns=True), "10.0.0.256", INVALID),
    (values.AddressesValue(), "1.1.1.1,", INVALID),
    (values.HostPrefix(), "10.0.0.1/33", INVALID),
    (values.Prefixes(), "10.0.0.0/24,10.0.1.0/24", INVALID),
    (values.Prefixes(v6=False), "::/0", INVALID),
    (values.Matcher(), "vpn.example.org", INVALID),
    (values.Matcher(), "10.0.0.9-10.0.0.1", INVALID),
    (values.Matcher(), "10.0.0.9-", "value of range must have ip address after '-'"),
    (values.Mac(), "02:00:5E:00:01", INVALID),
    (values.Mac(), "02:00-5E:00:01:1A", INVALID),
    (values.Ports(), "70000", INVALID),
    (values.Moment(), "24:00", INVALID),
    (values.Moment(), "9:60", INVALID),
    (values.Plausible(), "10.0.0.1,10.0.0.256", INVALID),
    (values.Plausible(), "!10.0.0.0/33", INVALID),
    (values.Plausible(ports=True), "8000-70000", INVALID),
    (values.Ports(), "90-80", INVALID),
    (values.Ports(single=True), "1,2", INVALID),
    (INTERFACE, "ether2", OFFERED),
    (INTERFACE, "*2", OFFERED),
    (values.GatewayValue(), "ether2", OFFERED),
    (values.GatewayValue(), "10.0.0.1%ether2", OFFERED),
    (values.GatewayValue(), "10.0.0.1@elsewhere", INVALID),
    (values.GatewayValue(), "10.0.0.300", INVALID),
    (values.Topics(("info",)), "debug", OFFERED),
    (values.PolicySet(("read",)), "fly", OFFERED),
]


@for_each_row(("kind", "text", "words"), BAD)
def test_invalid_values_are_refused(kind: values.ValueType, text: str, words: str) -> None:
    with pytest.raises(values.BadValue) as refusal:
        kind.parse(text, NAMES)
    assert refusal.value.words == words


def test_api_formats_some_values_differently() -> None:
    assert values.Bool().show("yes") == "true"
    assert values.Size().show("2048KiB") == "2048"
    assert values.Choice(("yes",)).show("yes") == "yes"


@given(st.integers(0, 10**7))
def test_intervals_round_trip(value: int) -> None:
    assert values.seconds(values.interval(value)) == value
