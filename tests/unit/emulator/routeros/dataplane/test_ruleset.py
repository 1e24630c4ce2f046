"""Rows of the firewall as rules of nftables; packets show what they do (tests/integration/routeros/flows)."""

import pytest

from atlantis_netcfg.emulator.routeros.dataplane import ruleset
from atlantis_netcfg.emulator.routeros.dataplane.ruleset import (
    FILTER,
    MANGLE,
    NAT,
    FirewallRow,
    RowReferences,
    translate,
)

REFERENCES = RowReferences(
    devices={"ether1-wan": "ether1"},
    interface_lists={"WAN": ("ether1-wan", "lte1")},
    address_lists={"ours": ("10.64.1.0/24",)},
    tables={"via-4g": 2},
)
CASES = {
    (NAT, "action=masquerade chain=srcnat out-interface-list=WAN"): 'oifname { "ether1", "lte1" } counter masquerade',
    (NAT, "action=dst-nat chain=dstnat protocol=udp dst-port=1194 to-addresses=10.0.0.1 to-ports=1195"): (
        "ip protocol udp udp dport { 1194 } counter dnat to 10.0.0.1:1195"
    ),
    (FILTER, "action=reject chain=forward protocol=tcp reject-with=tcp-reset"): (
        "meta l4proto tcp ip protocol tcp counter reject with tcp reset"
    ),
    (FILTER, "action=drop chain=forward src-address-list=!ours"): "ip saddr != @l_ours counter drop",
    (FILTER, "action=accept chain=input connection-nat-state=!srcnat"): "ct status & 0x10 == 0x0 counter accept",
    (FILTER, "action=accept chain=forward protocol=tcp tcp-flags=syn,!ack"): (
        "ip protocol tcp tcp flags & (syn|ack) == syn counter accept"
    ),
    (FILTER, "action=accept chain=forward dst-limit=32,32,src-address/10s"): (
        "update @m_0 { ip saddr limit rate 32/second burst 32 packets } counter accept"
    ),
    (MANGLE, "action=mark-routing chain=prerouting new-routing-mark=via-4g passthrough=no"): (
        "counter meta mark set mark & 0xff00 | 0x2 accept"
    ),
    (MANGLE, "action=mark-packet chain=postrouting new-packet-mark=control"): (
        "counter meta mark set mark & 0x00ff | 0x100"
    ),
    (MANGLE, "action=change-mss chain=forward protocol=tcp tcp-mss=1301-65535 new-mss=1300"): (
        "ip protocol tcp tcp option maxseg size 1301-65535 counter tcp option maxseg size set 1300"
    ),
}


def row(menu: str, words: str) -> FirewallRow:
    return FirewallRow(menu, dict(word.split("=", 1) for word in words.split()))


@pytest.mark.parametrize("case", CASES, ids=lambda case: case[1])
def test_a_row_is_one_rule(case: tuple[str, str]) -> None:
    result = translate([row(*case)], REFERENCES)
    assert [rule.text() for rule in result.rules] == [CASES[case]]
    assert result.limits == ()


@pytest.mark.parametrize(
    "words", ["action=add-src-to-address-list", "action=accept layer7-protocol=x", "action=accept limit=5,packet"]
)
def test_a_row_that_linux_cannot_stand_for_is_said(words: str) -> None:
    result = translate([row(FILTER, f"chain=forward comment=mine {words}")], REFERENCES)
    assert result.rules == ()
    assert len(result.limits) == 1
    assert "mine: unknown" in result.limits[0]


def test_a_disabled_row_does_nothing() -> None:
    assert translate([row(FILTER, "chain=forward action=drop disabled=yes")], REFERENCES).rules == ()


def test_chains_of_two_menus_with_one_name_are_two() -> None:
    rows = [row(menu, "chain=forward action=jump jump-target=mine") for menu in (FILTER, MANGLE)]
    text = translate(rows, REFERENCES).text()
    assert "jump filter_mine" in text
    assert "jump mangle_mine" in text
    assert text.count("chain filter_mine") == text.count("chain mangle_mine") == 2
    assert ruleset.TABLE in text
