from dataclasses import replace
from ipaddress import IPv4Address, IPv4Network

import pytest
from policy_pilots import CENTRE, GATEWAY, MEMBERS, MINE, ROUTER, TIME, member, membership, pilot
from row_subtests import for_each_row

from atlantis_netcfg.inventory.model import Dds, DdsPath, RosDistribution
from atlantis_netcfg.vpn.identity import MemberKind
from atlantis_netcfg.vpn.policy import Flow, Party, Policy, Protocol, policy

PING = Flow(Protocol.ICMP)
SSH = Flow(Protocol.TCP, 22)
WEB = Flow(Protocol.TCP, 8443)
DDS = (Flow(Protocol.UDP, 7410), Flow(Protocol.UDP, 7429))
NOT_DDS = (Flow(Protocol.TCP, 7410), *(Flow(Protocol.UDP, port) for port in (7400, 7409, 7430, 7660)))
FLOWS = {"p": PING, "d": DDS[0], "w": WEB, "s": SSH}
"""Ping, DDS, the shipped service, everything else."""
WHO = {
    "S": "10.80.0.1",
    "R": "10.80.0.11",
    "G": "10.80.0.21",
    "C": "10.80.0.2",
    "A": "10.80.16.1",
    "Z": "10.80.16.2",
    "I": "10.80.17.1",
    "P": "10.80.17.2",
    "M": "10.80.0.61",
    "L": "10.64.1.22",
    "T": "10.64.101.10",
    "E": "10.64.0.77",
    "V": "10.64.100.10",
    "K": "10.64.1.10",
    "B": "10.64.1.23",
    "U": "10.64.1.150",
    "X": "10.80.17.3",
    "Y": "10.80.30.1",
    "W": "198.51.100.7",
}
"""Server, router, gateway, centre, inesc's laptop and Zarco, iqua's laptop and Sparus, our Mares; Sparus plugged into
the LAN behind the router, its technician; something in the server's own LAN, and its technician; in the LAN behind the
router the gateway, inesc's Zarco, and something that nobody has declared; revoked, undeclared, the internet."""
ALL = "pdws"
TABLE = {
    # from: to S     R    G    C    A     Z     I    P    M    L    T    E    V    K    B    U
    "S": (ALL, ALL, ALL, ALL, ALL, ALL, ALL, ALL, ALL, ALL, ALL, ALL, ALL, ALL, ALL, ALL),
    "R": ("p", ALL, ALL, ALL, "", "", "", "", "", "", ALL, "", ALL, ALL, "", ""),
    "G": ("p", ALL, ALL, ALL, "", "pd", "", "pd", "pd", "pd", ALL, "", ALL, ALL, "pd", ""),
    "C": ("p", ALL, ALL, ALL, "pd", "pd", "pd", "pd", "pd", "pd", ALL, "pd", ALL, ALL, "pd", "pd"),
    "A": ("p", "", "", "pdw", ALL, ALL, "", "pd", "", "pd", "", "", "", "", "pd", ""),
    "Z": ("p", "", "pd", "pdw", ALL, ALL, "", "pd", "", "pd", "", "", "", "", "pd", ""),
    "I": ("p", "", "", "pdw", "", "", ALL, ALL, "", "", "", "", "", "", "", ""),
    "P": ("p", "", "pd", "pdw", "pd", "pd", ALL, ALL, "", "", "", "", "", "", "", ""),
    "M": ("p", "", "pd", "pdw", "", "", "", "", "", "", "", "", "", "", "", ""),
    "L": ("p", "", "pd", "pdw", "pd", "pd", "", "", "", ALL, "", "", "", "", "", ""),
    "T": (ALL, ALL, ALL, ALL, "", "", "", "", "", ALL, ALL, ALL, ALL, ALL, ALL, ALL),
    "E": (ALL, "", "", "pdw", "", "", "", "", "", "", "", ALL, ALL, "", "", ""),
    "V": (ALL, ALL, ALL, ALL, "", "", "", "", "", ALL, ALL, ALL, ALL, ALL, ALL, ALL),
    "K": ("p", ALL, ALL, ALL, "", "", "", "", "", "", ALL, "", ALL, ALL, "", ""),
    "B": ("p", "", "pd", "pdw", "pd", "pd", "", "", "", "", "", "", "", "", ALL, ""),
    "U": ("p", "", "", "pdw", "", "", "", "", "", "", "", "", "", "", "", ALL),
}
"""inesc sees Sparus; who stands in no line and in no column reaches nobody and is reached by nobody. A robot in a LAN
is no host of ours: it reaches what it reaches in the VPN, but of its partner's devices only pings and DDS."""


def party(letter: str) -> Party:
    return Party(letter, IPv4Address(WHO[letter]))


@pytest.fixture(scope="module")
def matrix() -> Policy:
    return policy(pilot({"inesc": ("sparus",)}), membership(*MEMBERS))


@pytest.mark.parametrize("source", WHO)
def test_permissions_match_the_table(matrix: Policy, source: str) -> None:
    told = dict(zip(TABLE, TABLE.get(source, ("",) * len(TABLE)), strict=True))
    for destination in WHO:
        if destination != source:
            found = "".join(
                key for key, flow in FLOWS.items() if matrix.allows(party(source), party(destination), flow)
            )
            assert found == told.get(destination, ""), f"{source} to {destination}"


BEGUN = (SSH, Flow(Protocol.TCP, 445), Flow(Protocol.TCP, 8729), Flow(Protocol.TCP, 8443), Flow(Protocol.UDP, 161))


@for_each_row("robot", ["10.64.1.22", "10.64.1.23", "10.64.1.150", "10.64.2.26", "10.64.0.77"])
@for_each_row("there", ["10.64.0.1", "10.64.0.11", "10.64.2.1", "10.64.2.10", "10.64.1.1", "10.64.1.10"])
def test_lan_robot_cannot_connect_to_another_site(matrix: Policy, robot: str, there: str) -> None:
    """As by a partner's, plugged in on the quay: SSH, SMB, the routers' API."""
    members = (*MEMBERS, member("te4sea-router", "10.80.0.31"))
    found = policy(pilot({"inesc": ("sparus",)}), membership(*members))
    one, other = Party("robot", IPv4Address(robot)), Party("host", IPv4Address(there))
    if robot.rpartition(".")[0] != there.rpartition(".")[0]:
        assert not any(found.allows(one, other, flow) for flow in (*BEGUN, PING, *DDS))
        assert not any(found.allows(other, one, flow) for flow in BEGUN)
    assert not matrix.permissions[0].source.holds(one.address)  # type: ignore[union-attr] # our hosts


def test_our_own_hosts_reach_each_other_across_sites(matrix: Policy) -> None:
    """The neighbour of the case above."""
    hosts = [
        Party(name, IPv4Address(address)) for name, address in (("gateway", "10.64.1.10"), ("centre", "10.64.0.11"))
    ]
    for one, other in (hosts, hosts[::-1]):
        assert all(matrix.allows(one, other, flow) for flow in (*BEGUN, PING, *DDS))


def test_computer_service_is_open_to_its_named_partners_only(matrix: Policy) -> None:
    """The shipped control centre's `example-websocket` names iqua; the others of its services name nobody."""
    named, ours = Flow(Protocol.TCP, 18081), Flow(Protocol.TCP, 18080)
    assert [letter for letter in "AZIPMLEBU" if matrix.allows(party(letter), party("C"), named)] == ["I", "P"]
    assert [letter for letter in "AZIPMLEBU" if matrix.allows(party(letter), party("C"), ours)] == []
    assert all(matrix.allows(party("G"), party("C"), flow) for flow in (named, ours))
    assert not matrix.allows(party("I"), party("C"), replace(named, protocol=Protocol.UDP))
    assert not matrix.allows(party("I"), party("G"), named), "it is no service of the gateway"


def test_server_lan_address_is_treated_as_the_server(matrix: Policy) -> None:
    lan = Party("server", IPv4Address("10.64.0.10"))
    assert [matrix.allows(party("G"), lan, flow) for flow in (PING, SSH)] == [True, False]
    assert matrix.allows(party("T"), lan, SSH)
    assert not matrix.allows(party("A"), lan, SSH)


def test_dds_allows_only_its_unicast_ports(matrix: Policy) -> None:
    assert all(matrix.allows(party("A"), party("C"), flow) for flow in DDS)
    assert not any(matrix.allows(party("A"), party("C"), flow) for flow in NOT_DDS)


@pytest.mark.parametrize(("domain", "participants", "first", "last"), [(0, 1, 7410, 7411), (101, 50, 32660, 32759)])
def test_dds_ports_depend_on_domain_and_participants(domain: int, participants: int, first: int, last: int) -> None:
    dds = Dds(distribution=RosDistribution.FOXY, domain=domain, participants=participants)
    declaration = pilot()
    changed = replace(declaration, pilot=declaration.pilot.model_copy(update={"dds": dds}))
    found = policy(changed, membership(*MEMBERS))
    around = range(first - 20, last + 20)
    ports = [one for one in around if found.allows(party("A"), party("C"), Flow(Protocol.UDP, one))]
    assert ports == list(range(first, last + 1))


def test_without_dds_only_ping_is_allowed() -> None:
    declaration = pilot()
    changed = replace(declaration, pilot=declaration.pilot.model_copy(update={"dds": None}))
    found = policy(changed, membership(*MEMBERS))
    assert found.allows(party("A"), party("C"), PING)
    assert not any(found.allows(party("A"), party("C"), Flow(Protocol.UDP, port)) for port in range(1, 65536, 7))
    assert not any(found.allows(party("A"), party("C"), flow) for flow in DDS)


def test_dds_over_lan_reaches_lan_addresses() -> None:
    declaration = pilot()
    dds = Dds(distribution=RosDistribution.FOXY, over=DdsPath.LAN)
    changed = replace(declaration, pilot=declaration.pilot.model_copy(update={"dds": dds}))
    centre = Party("centre", IPv4Address("10.64.0.11"))
    assert policy(changed, membership(*MEMBERS)).allows(party("A"), centre, DDS[0])
    assert not policy(declaration, membership(*MEMBERS)).allows(party("A"), centre, DDS[0])


def test_sees_is_mutual_and_limited_to_the_robot() -> None:
    found = policy(pilot({"inesc": ("sparus",)}), membership(*MEMBERS))
    assert found.allows(party("P"), party("A"), DDS[0])
    assert not found.allows(party("P"), party("A"), SSH)
    assert not found.allows(party("I"), party("A"), PING)
    without = policy(pilot(), membership(*MEMBERS))
    assert not without.allows(party("P"), party("A"), PING)


def test_services_on_the_server_and_over_udp() -> None:
    found = policy(pilot(services=(MINE, TIME)), membership(*MEMBERS))
    for guest in "AZIPM":
        assert found.allows(party(guest), party("S"), Flow(Protocol.TCP, 8080))
        assert not found.allows(party(guest), party("S"), Flow(Protocol.UDP, 8080))
        assert found.allows(party(guest), party("G"), Flow(Protocol.UDP, 123))
    assert not found.allows(party("G"), party("A"), Flow(Protocol.UDP, 123))
    assert not found.allows(party("G"), party("S"), Flow(Protocol.TCP, 8080))


def test_site_without_its_router_has_no_access() -> None:
    found = policy(pilot(), membership(*(one for one in MEMBERS if one.name != ROUTER)))
    for letter in "LTR":
        assert not found.allows(party("G"), party(letter), PING)
        assert not found.allows(party(letter), party("C"), PING)
        assert not found.allows(party("S"), party(letter), PING)


def test_networks_of_each_member_are_listed(matrix: Policy) -> None:
    assert matrix.members["inesc-zarco"] == (IPv4Network("10.80.16.2/32"),)
    networks = ("10.80.0.11/32", "10.64.1.0/24", "10.64.101.0/24")
    assert matrix.members[ROUTER] == tuple(map(IPv4Network, networks))
    assert {"iqua-lost", "gone-laptop"}.isdisjoint(matrix.members)
    assert set(matrix.member_zone.networks) == {one for networks in matrix.members.values() for one in networks}


def test_partner_device_named_like_a_router_gets_no_network() -> None:
    found = policy(pilot(), membership(member(ROUTER, "10.80.16.9", kind=MemberKind.ROUTER, partner="inesc")))
    assert found.members[ROUTER] == (IPv4Network("10.80.16.9/32"),)
    assert not found.allows(Party("it", IPv4Address("10.80.16.9")), party("E"), PING)


def test_undeclared_host_has_no_access() -> None:
    assert policy(pilot(), membership(member("te4sea-old", "10.80.0.99"))).members == {}


def test_every_zone_has_one_name(matrix: Policy) -> None:
    named = {zone for one in matrix.permissions for zone in (one.source, one.destination) if zone is not None}
    assert len({zone.name for zone in named}) == len(named) == len(matrix.zones)


def test_partner_zone_names_never_collide_with_ours(matrix: Policy) -> None:
    partners = {f"p_{name}" for name in pilot().partners}
    own = {zone.name for zone in matrix.zones} - partners
    assert {name for name in own if "_" not in name[2:]} == {"p_members"}


def test_without_members_nobody_has_access() -> None:
    found = policy(pilot(), membership())
    assert found.member_zone.networks == ()
    assert not found.allows(party("A"), party("C"), PING)
    assert found.allows(party("E"), party("S"), SSH), "the server's own LAN is not the tunnel's business"
    assert CENTRE in pilot().hosts
    assert GATEWAY in pilot().hosts
