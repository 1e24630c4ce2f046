"""What the rendered firewall lets through, packet by packet."""

from dataclasses import replace
from ipaddress import IPv4Address, IPv4Network

import pytest
from hypothesis import given as drawn
from hypothesis import settings
from hypothesis import strategies as st
from render_declared import SITES, declaration, with_site
from render_walk import Packet, Walk
from row_subtests import for_each_row
from test_render_text import parsed

from atlantis_netcfg.inventory.model import AllowedTarget, LinkKind, Router
from atlantis_netcfg.inventory.satellite_allow_list import allowed_targets as admitted
from atlantis_netcfg.routeros.render import router_view

STATES = ("new", "established", "related", "invalid", "untracked")
WITH_SATELLITE = ("coastal", "te4sea")
WALKS = {site: Walk(parsed(site)) for site in SITES}
DECLARED = declaration()
PARTNERS = ("10.80.16.5", "10.80.17.9", "10.80.20.250")
INTERFACES = ("bridge-lan", "ether1", "ether2", "ether3", "ether8", "ovpn-scc")


def link(site: str, name: str) -> str:
    device = DECLARED.router(site).device
    assert isinstance(device, Router)
    return next(port.name for port in device.ports if port.link == name)


def allowed(site: str) -> set[tuple[str, str, int | None]]:
    satellite = next(b for b in DECLARED.sites[site].bearers if b.kind is LinkKind.SATELLITE)
    targets = admitted(DECLARED.pilot, satellite)
    assert len(targets) == 2 + len(DECLARED.pilot.time_servers), "the VPN, the far end of measurements, and the time"
    return {(str(target.address), target.transport.value, target.port) for target in targets}


ADDRESSES = st.one_of(
    st.sampled_from(
        ["203.0.113.2", "192.0.2.123", "192.0.2.124", "198.51.100.11", "10.64.0.10", "10.80.0.1", "8.8.8.8"]
    ),
    st.integers(0, 2**32 - 1).map(lambda number: str(IPv4Address(number))),
).filter(lambda address: not address.startswith(("10.10.2.", "10.10.10.")))
PORTS = st.one_of(st.sampled_from([22, 53, 80, 123, 443, 1194, 8729]), st.integers(0, 65535))


@st.composite
def leaving(draw: st.DrawFn, out: str) -> Packet:
    return Packet(
        src=draw(st.sampled_from(["10.64.1.21", "10.64.2.10", "10.80.0.1", "10.64.101.10", "10.64.102.10"])),
        dst=draw(ADDRESSES),
        in_interface=draw(st.sampled_from(INTERFACES)),
        out_interface=out,
        protocol=draw(st.sampled_from(["tcp", "udp", "icmp"])),
        dst_port=draw(PORTS),
        state=draw(st.sampled_from(STATES)),
        nat_state=draw(st.frozensets(st.sampled_from(["srcnat", "dstnat"]))),
    )


@pytest.mark.parametrize("site", WITH_SATELLITE)
@settings(max_examples=150)
@drawn(data=st.data())
def test_satellite_carries_only_allowed_targets(site: str, data: st.DataObject) -> None:
    packet = data.draw(leaving(link(site, "satellite")))
    declared = (packet.dst, packet.protocol, packet.dst_port) in allowed(site)
    assert WALKS[site].accepts("output", replace(packet, in_interface="")) is declared
    assert declared or not WALKS[site].accepts("forward", packet)


@pytest.mark.parametrize("site", WITH_SATELLITE)
def test_lan_reaches_allowed_targets_over_satellite(site: str) -> None:
    lan = str(DECLARED.sites[site].lan.network[21])
    for address, protocol, port in allowed(site):
        packet = Packet(lan, address, "bridge-lan", link(site, "satellite"), protocol, port or 0)
        assert WALKS[site].accepts("forward", packet)


@pytest.mark.parametrize("site", WITH_SATELLITE)
def test_satellite_is_filtered_ahead_of_every_established_accept(site: str) -> None:
    for chain in ("forward", "output"):
        rows = [row for row in WALKS[site].rows if row.get("chain") == chain]
        jump = next(n for n, row in enumerate(rows) if row.get("jump-target") == "to-satellite")
        ahead = [row for row in rows[:jump] if row.get("action") == "accept"]
        assert all(row.get("dst-address") in ("10.10.2.0/29", "10.10.10.0/29") for row in ahead)
        assert all(row.get("connection-state") is None for row in ahead)


@pytest.mark.parametrize("site", WITH_SATELLITE)
def test_satellite_admits_only_responses_of_allowed_targets(site: str) -> None:
    robot, arrives = str(DECLARED.sites[site].lan.network[21]), link(site, "satellite")
    answers = [(address, protocol, port or 0) for address, protocol, port in allowed(site)]
    others = [("203.0.113.2", "udp", 1195), ("203.0.113.2", "tcp", 1194), ("8.8.8.8", "udp", 123)]
    for src, protocol, port in answers + others:
        for state in STATES:
            packet = Packet(
                src, robot, arrives, "bridge-lan", protocol, 40000, state, frozenset({"srcnat"}), src_port=port
            )
            expected = state == "established" and (src, protocol, port) in answers
            assert WALKS[site].accepts("forward", packet) is expected
            assert WALKS[site].accepts("input", replace(packet, out_interface="")) is expected
    for state in STATES:
        error = Packet("192.0.2.254", robot, arrives, "bridge-lan", "icmp", 0, state, frozenset({"srcnat"}))
        assert WALKS[site].accepts("forward", error) is (state == "related")


@pytest.mark.parametrize("site", WITH_SATELLITE)
def test_only_the_technician_reaches_the_terminal_pages(site: str) -> None:
    satellite = next(b for b in DECLARED.sites[site].bearers if b.kind is LinkKind.SATELLITE)
    out = link(site, "satellite")
    technician = str(DECLARED.sites[site].management.technician)
    robot = str(DECLARED.sites[site].lan.network[21])
    own = Packet(str(satellite.address), str(satellite.gateway), "", out, "icmp")
    assert WALKS[site].accepts("output", own)
    assert WALKS[site].accepts("forward", Packet(technician, str(satellite.gateway), "ether8", out, "tcp", 80))
    assert not WALKS[site].accepts("forward", Packet(robot, str(satellite.gateway), "bridge-lan", out, "tcp", 80))


def test_target_without_a_port_allows_every_port() -> None:
    satellite = DECLARED.sites["te4sea"].bearers[1]
    whole = AllowedTarget.model_validate({"name": "control centre", "address": "192.0.2.200"})
    opened = with_site(
        DECLARED,
        "te4sea",
        bearers=(DECLARED.sites["te4sea"].bearers[0], satellite.model_copy(update={"allow": (whole,)})),
    )
    walk = Walk(parsed("te4sea", opened))
    for protocol, port in (("tcp", 1), ("udp", 65535), ("icmp", 0)):
        assert walk.accepts("forward", Packet("10.64.2.21", "192.0.2.200", "bridge-lan", "ether2", protocol, port))
        assert not walk.accepts("forward", Packet("10.64.2.21", "192.0.2.201", "bridge-lan", "ether2", protocol, port))


@pytest.mark.parametrize("site", WITH_SATELLITE)
def test_address_removed_from_the_list_is_blocked(site: str) -> None:
    export = parsed(site)
    kept = tuple(
        row for row in export.statements if (row.get("list"), row.get("address")) != ("sat-allow", "192.0.2.123")
    )
    packet = Packet("10.10.2.2", "192.0.2.123", "", link(site, "satellite"), "udp", 123)
    assert Walk(export).accepts("output", packet)
    assert not Walk(replace(export, statements=kept)).accepts("output", packet)


@pytest.mark.parametrize("site", SITES)
def test_responses_pass_and_invalid_packets_do_not(site: str) -> None:
    robot = str(DECLARED.sites[site].lan.network[21])
    for bearer in DECLARED.sites[site].bearers:
        arrives, limited = link(site, bearer.name), bearer.kind is LinkKind.SATELLITE
        for state, passes in (("established", True), ("related", True), ("new", False), ("invalid", False)):
            to_router = Packet("192.0.2.123", str(bearer.address), arrives, "", "udp", 40000, state, src_port=123)
            to_robot = Packet("93.184.216.34", robot, arrives, "bridge-lan", "tcp", 50000, state, frozenset({"srcnat"}))
            answer = passes and (state == "established" or not limited)
            assert WALKS[site].accepts("input", to_router) is answer
            assert WALKS[site].accepts("forward", to_robot) is (passes and not limited)
    local, out = str(DECLARED.sites[site].lan.gateway), link(site, DECLARED.sites[site].bearers[0].name)
    for chain in ("input", "forward"):
        stray = Packet(robot, local, "bridge-lan", out, "icmp", 0, "invalid")
        assert WALKS[site].verdict(chain, stray) == ("drop", "atlantis: invalid")


@pytest.mark.parametrize("site", WITH_SATELLITE)
def test_tunnel_of_a_computer_passes_over_every_link(site: str) -> None:
    """`provision measure link over=vpn` leads it; through the site's own tunnel a technician reaches nothing."""
    place, endpoint = DECLARED.sites[site], str(DECLARED.pilot.vpn.endpoint)
    for name, inside in ((str(place.management.technician), "ether8"), (str(place.lan.network[77]), "bridge-lan")):
        for bearer in place.bearers:
            out = link(site, bearer.name)
            assert WALKS[site].accepts("forward", Packet(name, endpoint, inside, out, "udp", DECLARED.pilot.vpn.port))
    inner = Packet(str(place.management.technician), "10.80.0.2", "ether8", "ovpn-scc", "udp", 862)
    assert not WALKS[site].accepts("forward", inner)


@pytest.mark.parametrize("site", SITES)
def test_technician_reaches_the_robots(site: str) -> None:
    technician = str(DECLARED.sites[site].management.technician)
    robot = str(DECLARED.sites[site].lan.network[21])
    assert WALKS[site].accepts("forward", Packet(technician, robot, "ether8", "bridge-lan", "tcp", 22))
    assert not WALKS[site].accepts("forward", Packet(robot, technician, "bridge-lan", "ether8", "tcp", 22))


@pytest.mark.parametrize("site", SITES)
def test_nothing_is_fasttracked(site: str) -> None:
    actions = {row.get("action") for row in WALKS[site].rows}
    assert actions <= {"accept", "drop", "reject", "jump", "return", "log"}


@for_each_row("site", SITES)
@for_each_row(("protocol", "port"), [("tcp", 8729), ("tcp", 22), ("icmp", 0)])
@for_each_row("state", STATES)
def test_technician_reaches_the_router_and_gets_responses(site: str, protocol: str, port: int, state: str) -> None:
    management = DECLARED.sites[site].management
    device = DECLARED.router(site).device
    assert isinstance(device, Router)
    local, technician = str(device.access.address), str(management.technician)
    assert WALKS[site].accepts("input", Packet(technician, local, "ether8", "", protocol, port, state))
    assert WALKS[site].accepts("output", Packet(local, technician, "", "ether8", protocol, 50000, "established"))


@pytest.mark.parametrize("site", SITES)
def test_management_rows_come_first(site: str) -> None:
    rows = [row for row in WALKS[site].rows if row.get("chain") == "input"]
    assert [(row.get("protocol"), row.get("in-interface-list") == "MGMT") for row in rows[:4]] == [
        ("tcp", True),
        ("icmp", True),
        ("tcp", False),
        ("icmp", False),
    ]


@pytest.mark.parametrize("site", SITES)
@pytest.mark.parametrize("arrives", INTERFACES)
def test_manager_addresses_count_only_on_management_interfaces(site: str, arrives: str) -> None:
    """A robot in the LAN, or whoever is behind a link, may write any source into its packets."""
    device = DECLARED.router(site).device
    assert isinstance(device, Router)
    tunnel = "bridge-lan" if site == "scc" else "ovpn-scc"
    for source, home in ((str(DECLARED.sites[site].management.technician), "ether8"), ("10.80.0.2", tunnel)):
        for protocol, port in (("tcp", 22), ("tcp", device.access.port), ("icmp", 0)):
            packet = Packet(source, str(device.access.address), arrives, "", protocol, port)
            assert WALKS[site].accepts("input", packet) is (arrives == home), (source, protocol)


def test_prefix_is_bound_to_the_interfaces_it_overlaps() -> None:
    management = DECLARED.sites["coastal"].management
    wide = management.model_copy(update={"admit": tuple(map(IPv4Network, ("10.64.0.0/16", "198.51.100.7/32")))})
    walk = Walk(parsed("coastal", with_site(DECLARED, "coastal", management=wide)))
    device = DECLARED.router("coastal").device
    assert isinstance(device, Router)
    for source, homes in (
        ("10.64.101.10", {"ether8"}),
        ("10.64.1.21", {"bridge-lan"}),
        ("10.64.0.10", {"ovpn-scc"}),
        ("10.64.102.10", {"ovpn-scc"}),
        ("10.64.99.1", set()),
        ("198.51.100.7", {"ether1", "ether2", "ether3"}),
    ):
        packets = {name: Packet(source, str(device.access.address), name, "", "tcp", 22) for name in INTERFACES}
        assert {name for name, packet in packets.items() if walk.accepts("input", packet)} == homes, source


@pytest.mark.parametrize("site", SITES)
def test_engineer_in_the_vpn_reaches_the_router(site: str) -> None:
    device = DECLARED.router(site).device
    assert isinstance(device, Router)
    arrives = "bridge-lan" if site == "scc" else "ovpn-scc"
    packet = Packet("10.80.0.2", str(device.access.address), arrives, "", "tcp", device.access.port)
    assert WALKS[site].accepts("input", packet)


@for_each_row("site", SITES)
@for_each_row("partner", PARTNERS)
@for_each_row("arrives", INTERFACES)
def test_partners_do_not_reach_the_routers_services(site: str, partner: str, arrives: str) -> None:
    for local in (str(DECLARED.sites[site].lan.gateway), str(DECLARED.sites[site].management.network[1])):
        for protocol, port in (("tcp", 22), ("tcp", 8729), ("tcp", 53), ("udp", 53), ("udp", 67), ("icmp", 0)):
            assert not WALKS[site].accepts("input", Packet(partner, local, arrives, "", protocol, port))


@pytest.mark.parametrize("site", SITES)
@pytest.mark.parametrize("partner", PARTNERS)
def test_partners_reach_neither_internet_nor_management_network(site: str, partner: str) -> None:
    technician = str(DECLARED.sites[site].management.technician)
    for arrives in ("bridge-lan", "ovpn-scc"):
        for bearer in DECLARED.sites[site].bearers:
            out = link(site, bearer.name)
            assert not WALKS[site].accepts("forward", Packet(partner, "8.8.8.8", arrives, out, "tcp", 443))
        assert not WALKS[site].accepts("forward", Packet(partner, technician, arrives, "ether8", "tcp", 22))


@for_each_row("site", SITES)
@for_each_row("arrives", INTERFACES)
@for_each_row("port", [21, 23, 53, 80, 443, 2000, 8291, 8728])
def test_undeclared_traffic_is_dropped(site: str, arrives: str, port: int) -> None:
    for chain in ("input", "forward"):
        decided = WALKS[site].verdict(chain, Packet("192.0.2.77", "10.64.1.1", arrives, "ether4", "tcp", port))
        assert decided in (
            ("drop", "atlantis: everything else"),
            ("drop", "atlantis: satellite, everything else that comes in"),
        )


@pytest.mark.parametrize("site", SITES)
def test_lan_gets_only_the_declared_services(site: str) -> None:
    robot, local = str(DECLARED.sites[site].lan.network[21]), str(DECLARED.sites[site].lan.gateway)
    served = {("udp", 53), ("tcp", 53), ("udp", 67), ("icmp", 0)}
    for protocol, port in served | {("tcp", 22), ("tcp", 8729), ("tcp", 80), ("udp", 123), ("udp", 5678)}:
        packet = Packet(robot, local, "bridge-lan", "", protocol, port)
        assert WALKS[site].accepts("input", packet) is ((protocol, port) in served)
    booting = Packet("0.0.0.0", "255.255.255.255", "bridge-lan", "", "udp", 67)  # noqa: S104 - a host without address
    assert WALKS[site].accepts("input", booting)


@pytest.mark.parametrize("site", SITES)
def test_lan_uses_unrestricted_links_and_is_masqueraded(site: str) -> None:
    robot = str(DECLARED.sites[site].lan.network[21])
    for bearer in DECLARED.sites[site].bearers:
        packet = Packet(robot, "93.184.216.34", "bridge-lan", link(site, bearer.name), "tcp", 443)
        assert WALKS[site].accepts("forward", packet) is (bearer.kind is not LinkKind.SATELLITE)
        assert WALKS[site].translation("srcnat", packet) == ("masquerade", "")


def test_flow_without_its_nat_entry_is_dropped() -> None:
    packet = Packet("10.64.1.21", "93.184.216.34", "bridge-lan", "ether2", "tcp", 443, "established")
    assert WALKS["coastal"].verdict("forward", packet) == ("drop", "atlantis: stale, not masqueraded")


@pytest.mark.parametrize("site", WITH_SATELLITE)
def test_sites_meet_inside_the_vpn_without_nat(site: str) -> None:
    robot = str(DECLARED.sites[site].lan.network[21])
    there = Packet(robot, "10.64.0.11", "bridge-lan", "ovpn-scc", "udp", 7410)
    back = Packet("10.64.0.11", robot, "ovpn-scc", "bridge-lan", "udp", 7410)
    assert WALKS[site].accepts("forward", there)
    assert WALKS[site].accepts("forward", back)
    assert WALKS[site].translation("srcnat", there) is None


OF_OTHERS = (
    *("10.64.0.1", "10.64.0.11", "10.64.1.1", "10.64.1.10", "10.64.2.1", "10.64.2.10"),
    *("10.64.100.10", "10.64.102.10"),
)
BEGUN = (("tcp", 22), ("tcp", 445), ("tcp", 8729), ("tcp", 80))


@pytest.mark.parametrize("site", SITES)
def test_lan_robot_cannot_connect_to_other_sites_but_our_hosts_can(site: str) -> None:
    """Robot 22 is a partner's and has a reservation, 150 is of DHCP; the gateway, or the control centre, is ours."""
    lan, out = DECLARED.sites[site].lan.network, "bridge-lan" if site == "scc" else "ovpn-scc"
    others = [one for one in OF_OTHERS if IPv4Address(one) not in lan and not one.startswith(f"10.64.10{str(lan)[6]}.")]
    ours = str(lan[11] if site == "scc" else lan[10])
    reached = {str(network) for network in parsed_remotes(site)}
    for there in others:
        for protocol, port in BEGUN:
            ways = [Packet(str(lan[last]), there, "bridge-lan", out, protocol, port) for last in (22, 150)]
            assert not any(WALKS[site].accepts("forward", packet) for packet in ways), there
            own = WALKS[site].accepts("forward", Packet(ours, there, "bridge-lan", out, protocol, port))
            assert own is any(IPv4Address(there) in IPv4Network(network) for network in reached)


def parsed_remotes(site: str) -> list[str]:
    rows = parsed(site).statements
    return [str(row.get("address")) for row in rows if row.get("list") == "remote"]


@pytest.mark.parametrize("site", SITES)
def test_lan_robot_reaches_the_vpn_and_responds(site: str) -> None:
    """The VPN server decides which addresses of the tunnel it may speak to."""
    robot, out = str(DECLARED.sites[site].lan.network[22]), "bridge-lan" if site == "scc" else "ovpn-scc"
    for protocol, port in (("udp", 7410), ("tcp", 8443), ("icmp", 0)):
        assert WALKS[site].accepts("forward", Packet(robot, "10.80.0.2", "bridge-lan", out, protocol, port))
    other = "10.64.2.10" if site == "coastal" else "10.64.1.10"
    assert WALKS[site].accepts("forward", Packet(robot, other, "bridge-lan", out, "icmp"))
    assert WALKS[site].accepts("forward", Packet(robot, other, "bridge-lan", out, "udp", 7410))
    state = "invalid" if site == "scc" else "established"
    answer = Packet(robot, other, "bridge-lan", out, "tcp", 40000, state, flags=frozenset({"syn", "ack"}))
    assert WALKS[site].accepts("forward", answer)


@pytest.mark.parametrize(("port", "host"), [(1194, "10.64.0.10"), (862, "10.64.0.11")])
def test_control_centre_forwards_the_vpn_and_measurements_from_every_side(port: int, host: str) -> None:
    walk = WALKS["scc"]
    for src, arrives in (("198.18.0.9", "ether1"), ("10.10.0.2", "ether2"), ("10.64.0.50", "bridge-lan")):
        packet = Packet(src, "203.0.113.2", arrives, "", "udp", port)
        assert walk.translation("dstnat", packet) == ("dst-nat", host)
        inside = Packet(src, host, arrives, "bridge-lan", "udp", port, nat_state=frozenset({"dstnat"}))
        assert walk.accepts("forward", inside)
        back = Packet(host, src, "bridge-lan", arrives, "udp", 40000, "established", frozenset({"dstnat"}))
        assert walk.accepts("forward", back)
    unasked = Packet("198.18.0.9", host, "ether1", "bridge-lan", "udp", port)
    assert not walk.accepts("forward", unasked)
    assert not walk.accepts("forward", replace(inside, is_beyond_limit=True)), "a flood of new connections"
    assert walk.accepts("forward", replace(inside, is_beyond_limit=True, state="established")), "who is there stays"


def test_control_centre_masquerades_only_hairpin_traffic() -> None:
    walk = WALKS["scc"]
    hairpin = Packet("10.64.0.50", "10.64.0.10", "bridge-lan", "bridge-lan", "udp", 1194)
    outside = Packet("198.18.0.9", "10.64.0.10", "ether1", "bridge-lan", "udp", 1194)
    assert walk.translation("srcnat", hairpin) == ("masquerade", "")
    assert walk.translation("srcnat", outside) is None


@pytest.mark.parametrize("state", STATES)
def test_control_centre_forwards_vpn_traffic_within_its_bridge(state: str) -> None:
    walk = WALKS["scc"]
    for behind in ("10.80.0.11", "10.64.1.21", "10.64.2.10"):
        packet = Packet("10.64.0.11", behind, "bridge-lan", "bridge-lan", "tcp", 8080, state)
        assert walk.accepts("forward", packet)
        assert walk.translation("srcnat", packet) is None


def test_control_centre_routes_coastal_to_the_internet_but_not_its_lan() -> None:
    walk = WALKS["scc"]
    probe = Packet("10.10.0.2", "198.51.100.11", "ether2", "ether1", "icmp")
    assert walk.accepts("forward", probe)
    assert walk.translation("srcnat", probe) == ("masquerade", "")
    assert not walk.accepts("forward", Packet("10.10.0.2", "10.64.0.11", "ether2", "bridge-lan", "tcp", 443))
    assert not walk.accepts("forward", Packet("10.10.0.2", "10.64.100.10", "ether2", "ether8", "tcp", 22))


def test_both_ends_of_the_bridge_are_reached_from_either_management_port() -> None:
    for site, technician, out in (("scc", "10.64.100.10", "ether2"), ("coastal", "10.64.101.10", "ether1")):
        for cpe in ("10.10.0.3", "10.10.0.4"):
            for port in (22, 8729):
                packet = Packet(technician, cpe, "ether8", out, "tcp", port)
                assert WALKS[site].accepts("forward", packet)
                assert WALKS[site].translation("srcnat", packet) == ("masquerade", "")


def test_routers_ping_each_other_over_the_bridge() -> None:
    for site, arrives, src in (("scc", "ether2", "10.10.0.2"), ("coastal", "ether1", "10.10.0.1")):
        assert WALKS[site].accepts("input", Packet(src, "10.10.0.1", arrives, "", "icmp"))
        assert not WALKS[site].accepts("input", Packet("192.0.2.9", "10.10.0.1", arrives, "", "icmp"))


@pytest.mark.parametrize("site", WITH_SATELLITE)
def test_router_rejects_dds_probe_echo_on_links_without_dds(site: str) -> None:
    """On links that DDS may not cross, in every state of a connection, and nothing else that has its mark."""
    ports = {link.name: link.port for link in router_view(DECLARED, DECLARED.router(site)).uplinks}
    robot = str(DECLARED.sites[site].lan.network[10])
    for name, port in ports.items():
        for state in STATES:
            echo = Packet(robot, "203.0.113.2", "bridge-lan", port, "icmp", state=state, dscp=1)
            refused = WALKS[site].verdict("forward", echo) == ("reject", f"atlantis: no DDS over {name}")
            assert refused is (name == "satellite"), (name, state)
        vpn = Packet(robot, "203.0.113.2", "bridge-lan", port, "udp", 1194, dscp=1)
        assert WALKS[site].accepts("forward", vpn), name
        plain = Packet(robot, "203.0.113.2", "bridge-lan", port, "icmp")
        assert WALKS[site].verdict("forward", plain)[0] != "reject", name


def test_dds_is_blocked_on_metered_links_unless_declared() -> None:
    def refused(**update: object) -> list[str]:
        bearers = tuple(each.model_copy(update=update) for each in DECLARED.sites["coastal"].bearers)
        walk = Walk(parsed("coastal", with_site(DECLARED, "coastal", bearers=bearers)))
        return [str(row.get("comment")) for row in walk.rows if row.get("action") == "reject"]

    names = {name: f"atlantis: no DDS over {name}" for name in ("wifi-ptp", "4g", "satellite")}
    assert refused(dds=None) == [names["4g"], names["satellite"]]
    assert refused(dds=None, metered=False, billing=None) == []
    assert refused(dds=True) == []
    assert refused(dds=False) == list(names.values())
