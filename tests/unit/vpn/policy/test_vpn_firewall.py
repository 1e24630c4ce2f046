import itertools
import os
import random
import re
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from ipaddress import IPv4Address
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nft_walk import Packet, parse
from policy_pilots import MEMBERS, MINE, TIME, member, membership, pilot

from atlantis_netcfg.inventory.model import VpnService
from atlantis_netcfg.vpn.identity import MemberKind
from atlantis_netcfg.vpn.policy import MEMBERS_SET, TABLE, Flow, Party, Policy, Protocol, firewall, policy

SERVER = "10.80.0.1"
TUNNEL = {
    **{one.name: str(one.address) for one in MEMBERS},
    "sparus in the LAN": "10.64.1.22",
    "zarco in the LAN": "10.64.1.23",
    "gateway in the LAN": "10.64.1.10",
    "unknown in the LAN": "10.64.1.150",
    "technician": "10.64.101.10",
    "nobody": "10.80.99.9",
    "site without router": "10.64.2.22",
}
LAN = {"beside": "10.64.0.77", "technician beside": "10.64.100.10", "internet": "198.51.100.7"}
FLOWS = (
    Flow(Protocol.ICMP),
    *(Flow(Protocol.TCP, port) for port in (22, 8080, 8443, 18081, 7410)),
    *(Flow(Protocol.UDP, port) for port in (123, 7409, 7410, 7429, 7430, 8443)),
)
DENIED, SPOOFED, IPV6, MULTICAST = ("p_denied", "log"), ("p_spoofed",), ("p_ipv6",), ("p_multicast",)
_Expected = tuple[Packet, bool, tuple[str, ...]]


def declared() -> tuple[str, Policy]:
    declaration = pilot({"inesc": ("sparus", "mares")}, services=(MINE, TIME))
    return firewall(declaration, membership(*MEMBERS)), policy(declaration, membership(*MEMBERS))


def battery(matrix: Policy) -> Iterator[_Expected]:
    """Packets, whether they shall pass, and what shall count them."""
    for (one, source), (other, destination) in itertools.permutations({**TUNNEL, **LAN, "server": SERVER}.items(), 2):
        hook, iif, oif = _way(one, other)
        ends = Party(one, IPv4Address(source)), Party(other, IPv4Address(destination))
        for flow in FLOWS:
            packet = _packet(hook, iif, oif, source, destination, flow)
            outside = "tun0" not in {iif, oif}
            passes = outside or matrix.allows(*ends, flow)
            yield packet, passes, () if passes else DENIED
            answered = outside or matrix.allows(ends[1], ends[0], flow)
            if flow.protocol is not Protocol.ICMP and matrix.allows(*ends, Flow(flow.protocol, 40000)) == outside:
                answer = replace(packet, sport=packet.dport, dport=40000, state="established", reply=True)
                yield answer, answered, () if answered else DENIED
                forged = replace(answer, reply=False, state="new")
                yield forged, outside, () if outside else DENIED
        if "tun0" in {iif, oif}:
            ping = _packet(hook, iif, oif, source, destination, FLOWS[0])
            yield replace(ping, spoofed=hook != "output"), *_told(matrix, ping, ends, hook)
            yield replace(ping, ipv6=True, protocol="tcp"), False, IPV6


def _told(matrix: Policy, ping: Packet, ends: tuple[Party, Party], hook: str) -> tuple[bool, tuple[str, ...]]:
    if hook != "output":
        return False, SPOOFED
    passes = matrix.allows(*ends, FLOWS[0])
    assert ping.hook == "output"
    return passes, () if passes else DENIED


def _way(source: str, destination: str) -> tuple[str, str, str]:
    iif, oif = ("eth0" if who in LAN else "tun0" for who in (source, destination))
    if source == "server":
        return "output", "", oif
    return ("input", iif, "") if destination == "server" else ("forward", iif, oif)


def _packet(hook: str, iif: str, oif: str, source: str, destination: str, flow: Flow) -> Packet:  # noqa: PLR0913, PLR0917
    return Packet(
        hook,
        iif,
        oif,
        source,
        destination,
        flow.protocol,
        sport=40000,
        dport=flow.port or 0,
        icmp="echo-request" if flow.protocol is Protocol.ICMP else "",
    )


def more(matrix: Policy) -> Iterator[_Expected]:
    """What is no pair: errors, multicast, answers to the server, our own net without the tunnel."""
    a, c, x = TUNNEL["inesc-laptop"], TUNNEL["scc-control"], TUNNEL["iqua-lost"]
    error = Packet("forward", "tun0", "tun0", a, c, "icmp", icmp="destination-unreachable", state="related", reply=True)
    yield error, True, ()
    yield replace(error, state="new"), False, DENIED
    yield replace(error, saddr=x), False, DENIED
    yield replace(error, protocol="tcp"), False, DENIED
    yield replace(error, icmp="echo-reply", state="established"), True, ()
    yield replace(error, icmp="timestamp-request", state="new"), False, DENIED
    old = Packet("forward", "tun0", "tun0", a, x, "tcp", 22, 40000, state="established", reply=True)
    yield old, False, DENIED
    yield replace(old, saddr=x, daddr=a), False, DENIED
    to_server = Packet("input", "tun0", "", a, SERVER, "tcp", 22, 40000, state="established", reply=True)
    yield to_server, True, ()
    yield replace(to_server, reply=False), False, DENIED
    yield replace(to_server, saddr=x), False, DENIED
    yield replace(to_server, protocol="icmp", icmp="destination-unreachable", state="related"), True, ()
    yield replace(to_server, protocol="icmp", icmp="echo-reply", state="new", reply=False), False, DENIED
    yield Packet("output", "", "tun0", SERVER, "239.255.0.1", "udp", 40000, 7400), False, MULTICAST
    yield Packet("output", "", "eth0", "10.64.0.10", "239.255.0.1", "udp", 40000, 7400), True, ()
    yield Packet("output", "", "tun0", SERVER, "10.80.255.255", "udp", 40000, 7400), False, DENIED
    yield Packet("input", "tun0", "", a, "239.255.0.1", "udp", 40000, 7400), False, DENIED
    for hook, iif, oif in (("input", "eth0", ""), ("forward", "eth0", "eth1"), ("output", "", "eth0")):
        yield Packet(hook, iif, oif, "198.51.100.7", "10.64.0.10", "tcp", 40000, 22, ipv6=True), True, ()
        yield Packet(hook, iif, oif, "198.51.100.7", "10.64.0.10", "udp", 40000, 1194, spoofed=True), True, ()
    assert not matrix.allows(Party("a", IPv4Address(a)), Party("x", IPv4Address(x)), FLOWS[0])


def wrong(text: str, expected: list[_Expected]) -> list[_Expected]:
    table = parse(text)
    return [one for one in expected if table.walk(one[0]) != one[1:]]


@pytest.fixture(scope="module")
def expected() -> list[_Expected]:
    _, matrix = declared()
    found = [*battery(matrix), *more(matrix)]
    random.Random(6).shuffle(found)  # noqa: S311 - so that most mutants are found out by the first few
    return found


def test_firewall_text_implements_the_policy(expected: list[_Expected]) -> None:
    text, _ = declared()
    assert wrong(text, expected) == []
    assert len(expected) > 3000
    assert 500 < sum(one[1] for one in expected) < len(expected) - 500


def mutants(text: str) -> Iterator[tuple[str, str]]:
    """The text without one of its lines, each in turn."""
    lines = text.splitlines()
    for index, line in enumerate(lines):
        if line.strip() and not line.strip().startswith("#"):
            yield f"{index + 1}: {line.strip()}", "\n".join([*lines[:index], *lines[index + 1 :]]) + "\n"


def killed(mutant: str, expected: list[_Expected]) -> bool:
    try:
        table = parse(mutant)
        return any(table.walk(packet) != (passes, left) for packet, passes, left in expected)
    except (ValueError, KeyError):
        return True


def test_every_firewall_line_is_tested(expected: list[_Expected]) -> None:
    """But for the type of a set, which is nft's to miss: see below."""
    text, _ = declared()
    found = [(line, mutant) for line, mutant in mutants(text) if not _OF_SETS.fullmatch(line)]
    assert len(found) > 80
    assert [line for line, mutant in found if not killed(mutant, expected)] == []


_OF_SETS = re.compile(r"\d+: (flags interval|type ipv4_addr)")


def nft(text: str, *words: str) -> str:
    """What nft says to a file in a namespace of its own, which ends with it; words are run there afterwards."""
    if os.geteuid() != 0:
        pytest.skip("making a network namespace needs root")
    script = f"nft -f - && {' '.join(words)}" if words else "nft -c -f -"
    done = subprocess.run(
        ["unshare", "-n", "sh", "-c", script], input=text, capture_output=True, text=True, check=False
    )
    return done.stdout if done.returncode == 0 else f"refused: {done.stderr}"


@pytest.mark.namespace
def test_removed_type_or_flags_of_a_set_are_refused_by_nft() -> None:
    text, _ = declared()
    assert nft(text) == ""
    found = {line: mutant for line, mutant in mutants(text) if _OF_SETS.fullmatch(line)}
    first = next(mutant for line, mutant in found.items() if "type" in line)
    wide = text.partition("set p_site_hosts {")[2]
    without = text.replace(wide, wide.replace("flags interval\n", "\n", 1))
    assert nft(first).startswith("refused: ")
    assert nft(without).startswith("refused: ")


@pytest.mark.namespace
def test_loading_is_idempotent_and_leaves_other_tables_alone(tmp_path: Path) -> None:
    text, _ = declared()
    file = tmp_path / "vpn.nft"
    file.write_text(text, encoding="utf-8")
    broken = tmp_path / "broken.nft"
    broken.write_text(text.replace("p_deny {", "p_other {"), encoding="utf-8")
    again = f"nft list ruleset; nft -f {file}; nft -f {broken} 2>/dev/null || nft list ruleset"
    other = "table ip other {\n\tchain input {\n\t\ttype filter hook input priority filter; policy accept;\n\t}\n}\n"
    said = nft(other + text, again)
    assert said.count(f"table inet {TABLE} {{") == 2
    half = len(said) // 2
    assert said[:half] == said[half:]
    assert said.startswith(other)


@pytest.mark.namespace
def test_removing_an_address_keeps_its_neighbours_in_the_set() -> None:
    """Its neighbours stay: a set of intervals takes what stands beside each other for one range in some versions."""
    neighbours = [
        member(f"inesc-{last}", f"10.80.16.{last}", kind=MemberKind.LAPTOP, partner="inesc") for last in range(1, 7)
    ]
    text = firewall(pilot(), membership(*neighbours))
    delete = f"nft delete element inet {TABLE} {MEMBERS_SET} {{ 10.80.16.3 }}"
    said = nft(text, delete, "&& nft list set inet", TABLE, MEMBERS_SET)
    assert re.findall(r"10\.80\.16\.\d+(?:-[\d.]+)?", said) == [f"10.80.16.{last}" for last in (1, 2, 4, 5, 6)]


_RESERVED = frozenset({"members", "default", "server"})
_KEYS = st.from_regex(r"[a-z0-9]([a-z0-9-]{0,30}[a-z0-9])?", fullmatch=True).filter(lambda key: key not in _RESERVED)
_TEXTS = st.text(st.characters(categories=("L", "N", "P", "S", "Zs")), min_size=1, max_size=200).filter(
    lambda text: bool(text.strip()) and text.isprintable()
)


@pytest.mark.namespace
@settings(max_examples=12)
@given(
    keys=st.lists(_KEYS | st.sampled_from(["ip", "tcp", "log", "drop", "table", "set"]), max_size=8, unique=True),
    services=st.lists(_TEXTS, max_size=4),
    admitted=st.integers(0, 40),
)
def test_nft_accepts_every_inventory(keys: list[str], services: list[str], admitted: int) -> None:
    declaration = pilot(
        services=[VpnService(name=name, host="scc-control", port=1000 + index) for index, name in enumerate(services)]
    )
    inesc = declaration.partners["inesc"]
    seen = [inesc.model_copy(update={"sees": ("sparus",) if index % 2 else ()}) for index in range(len(keys))]
    declaration = replace(declaration, partners=dict(zip(keys, seen, strict=True)))
    members = [
        member(
            f"m{number}",
            f"10.80.20.{number + 1}",
            kind=MemberKind.ROBOT,
            partner=keys[number % len(keys)],
            vehicle="sparus",
        )
        for number in range(admitted if keys else 0)
    ]
    text = firewall(declaration, membership(*members, *MEMBERS[:3]))
    assert nft(text) == ""
    parse(text)
