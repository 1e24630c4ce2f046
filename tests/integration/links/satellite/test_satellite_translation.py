"""The translation into nftables against a model of RouterOS' chains that was written without it."""

import itertools
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import given as drawn
from hypothesis import strategies as st
from nft_evaluation import Nft, passes, status_of
from nft_translation import translate
from satellite_rendered import SITES, rendered
from satellite_stage import ROBOT, Stage, send_udp, stage, token

from atlantis_netcfg.routeros import rsc

sys.path.append(str(Path(__file__).parents[3] / "unit" / "routeros" / "render"))
from collections.abc import Iterator

from render_walk import Packet, Walk

NETWORKS = ("10.64.1.0/24", "10.64.1.21", "203.0.113.0/29", "203.0.113.2", "192.0.2.123", "8.8.8.8", "0.0.0.0/0")
ADDRESSES = ("10.64.1.21", "10.64.101.10", "203.0.113.2", "203.0.113.3", "192.0.2.123", "8.8.8.8")
PORTS_IN, PORTS_OUT = ("bridge-lan", "ether8", "ether3"), ("ether1", "ether2", "ether3")
NUMBERS = ("53", "123", "1194", "123,1194", "53,443")
STATES = ("new", "established", "related", "invalid", "untracked")
LISTS = ("addresses", "nothing")
SENTINEL = 65000
HEAD = """
/interface list member
add interface=ether1 list=WAN
add interface=ether3 list=WAN
add interface=bridge-lan list=LAN
/ip firewall address-list
add address=203.0.113.2 list=addresses
add address=192.0.2.0/24 list=addresses
/ip firewall filter
"""


def negatable(values: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    return st.tuples(st.sampled_from(["", "", "!"]), values).map("".join)


MATCHERS = {
    "src-address": negatable(st.sampled_from(NETWORKS)),
    "dst-address": negatable(st.sampled_from(NETWORKS)),
    "src-address-list": negatable(st.sampled_from(LISTS)),
    "dst-address-list": negatable(st.sampled_from(LISTS)),
    "in-interface": negatable(st.sampled_from(PORTS_IN)),
    "out-interface": negatable(st.sampled_from(PORTS_OUT)),
    "in-interface-list": negatable(st.sampled_from(["LAN", "WAN"])),
    "out-interface-list": negatable(st.sampled_from(["LAN", "WAN"])),
    "connection-state": negatable(st.sampled_from([*STATES, "established,related", "established,related,untracked"])),
    "connection-nat-state": negatable(st.sampled_from(["srcnat", "dstnat"])),
}
JUMPS = {"forward": ["to-a", "from-b"], "to-a": ["from-b"], "from-b": []}
"""Which chain may jump where: no way back."""


@st.composite
def rows(draw: st.DrawFn, chain: str) -> str:
    names = draw(st.lists(st.sampled_from(sorted(MATCHERS)), max_size=3, unique=True))
    words = {name: draw(MATCHERS[name]) for name in names}
    if draw(st.booleans()):
        words["protocol"] = draw(negatable(st.sampled_from(["udp", "tcp", "icmp"])))
        if words["protocol"] in ("udp", "tcp") and draw(st.booleans()):
            words[draw(st.sampled_from(["dst-port", "src-port"]))] = draw(negatable(st.sampled_from(NUMBERS)))
    words["action"] = draw(
        st.sampled_from(["accept", "drop", "drop", "return", "log", *(["jump"] if JUMPS[chain] else [])])
    )
    if words["action"] == "jump":
        words["jump-target"] = draw(st.sampled_from(JUMPS[chain]))
    if words["action"] == "log":
        words["log-prefix"] = "seen"
        words["limit"] = "10/1m,5:packet"
    return f"add chain={chain} comment=x " + " ".join(f"{name}={value}" for name, value in words.items())


@st.composite
def firewalls(draw: st.DrawFn) -> rsc.Export:
    chains = draw(st.lists(st.sampled_from(["forward", "forward", "to-a", "from-b"]), min_size=1, max_size=10))
    return rsc.parse(HEAD + "\n".join(draw(rows(chain)) for chain in chains) + "\n")


@st.composite
def packets(draw: st.DrawFn) -> Packet:
    return Packet(
        src=draw(st.sampled_from(ADDRESSES)),
        dst=draw(st.sampled_from(ADDRESSES)),
        in_interface=draw(st.sampled_from(PORTS_IN)),
        out_interface=draw(st.sampled_from(PORTS_OUT)),
        protocol=draw(st.sampled_from(["udp", "tcp", "icmp"])),
        dst_port=draw(st.sampled_from([53, 123, 443, 1194, 40000])),
        src_port=draw(st.sampled_from([53, 123, 443, 1194, 40000])),
        state=draw(st.sampled_from(STATES)),
        nat_state=draw(st.frozensets(st.sampled_from(["srcnat", "dstnat"]))),
    )


def as_nft(packet: Packet) -> Nft:
    return Nft(
        packet.src,
        packet.dst,
        packet.in_interface,
        packet.out_interface,
        packet.protocol,
        packet.src_port,
        packet.dst_port,
        packet.state,
        status_of(packet.nat_state),
    )


@settings(max_examples=150)
@drawn(export=firewalls(), some=st.lists(packets(), min_size=1, max_size=8))
def test_translation_decides_like_the_chain_model(export: rsc.Export, some: list[Packet]) -> None:
    walk, ruleset = Walk(export), translate(export)
    for packet in some:
        assert passes(ruleset, "forward", as_nft(packet)) is walk.accepts("forward", packet), packet


@pytest.mark.parametrize("site", SITES)
@settings(max_examples=150)
@drawn(packet=packets(), chain=st.sampled_from(["input", "forward", "output"]))
def test_the_sites_own_filter_is_decided_alike(site: str, packet: Packet, chain: str) -> None:
    export = rendered(site).export
    walk, ruleset = Walk(export), translate(export)
    asked = replace(
        packet,
        in_interface="" if chain == "output" else packet.in_interface,
        out_interface="" if chain == "input" else packet.out_interface,
    )
    assert passes(ruleset, chain, as_nft(asked)) is walk.accepts(chain, asked)


def test_unknown_matcher_is_refused() -> None:
    for words in ("action=accept time=1h-2h,mon", "action=add-src-to-address-list", "action=accept layer7-protocol=x"):
        with pytest.raises(ValueError, match="unknown"):
            translate(rsc.parse(f"/ip firewall filter\nadd chain=forward {words}\n"))


@pytest.fixture(scope="module")
def built() -> Iterator[Stage]:
    with stage(rendered("coastal").view) as made:
        yield made


@pytest.mark.namespace
@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@drawn(export=firewalls())
def test_kernel_decides_like_the_chain_model(built: Stage, export: rsc.Export) -> None:
    """A sample of random filters, loaded into the kernel: datagrams of a robot over two links."""
    head = rsc.parse(f"/ip firewall filter\nadd action=accept chain=forward dst-port={SENTINEL} protocol=udp\n")
    whole = replace(export, statements=(*head.statements, *export.statements))
    walk = Walk(whole)
    built.load(whole)
    wanted = [*itertools.product(("203.0.113.2", "192.0.2.123", "8.8.8.8"), (53, 123, 443, 1194))]
    for bearer, port in (("satellite", "ether3"), ("4g", "ether2")):
        built.prefer(bearer)
        watch, mark = built.watch(bearer), token()
        with built.udp(ROBOT) as robot:
            src_port = int(robot.getsockname()[1])
            for address, number in wanted:
                send_udp(robot, address, number)
            send_udp(robot, "8.8.8.8", SENTINEL, mark)
            arrived = {(seen.dst, seen.dst_port) for seen in watch.until(mark)}
        watch.close()
        packet = Packet(built.robot, "", "bridge-lan", port, "udp", src_port=src_port)
        assert arrived == {
            (address, number)
            for address, number in wanted
            if walk.accepts("forward", replace(packet, dst=address, dst_port=number))
        }
