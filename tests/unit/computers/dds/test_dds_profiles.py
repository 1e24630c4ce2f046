"""Profiles say what is declared, each in the words of its version."""

from dataclasses import replace
from ipaddress import IPv4Address

import pytest
from dds_pilots import leaves, pilot, view

from atlantis_netcfg.computers.dds import GAP_S, RELEASES, TUNING, profile_views, profiles
from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.inventory import Inventory
from atlantis_netcfg.inventory.model import Dds, DdsPath, DdsPeer, LinkKind, Pace, RosDistribution, RosMiddleware

CYCLONE = "CycloneDDS/Domain"
"""The elements below are those of the schema `etc/cyclonedds.xsd` of 0.7, 0.10.5 and 11.0.1."""
FAST = "dds/profiles"


def cyclone(release: str, bearer: str = "satellite") -> list[tuple[str, str]]:
    return [
        (path.removeprefix(f"{CYCLONE}/"), value)
        for path, value in leaves(view("coastal-gateway", bearer, release), "cyclonedds.xml")
    ]


COMMON = [
    ("General/AllowMulticast", "false"),
    ("General/MaxMessageSize", "1200B"),
    ("General/FragmentSize", "1100B"),
    ("Discovery/ParticipantIndex", "auto"),
    ("Discovery/MaxAutoParticipantIndex", "10"),
    ("Discovery/SPDPInterval", "20s"),
]
PEERS = [("Discovery/Peers/Peer@Address", "10.80.0.2"), ("Discovery/Peers/Peer@Address", "10.80.0.21")]
ANY = [(f"{CYCLONE}@Id", "any")]


def test_cyclone_of_foxy() -> None:
    interface = [("General/NetworkInterfaceAddress", "10.80.0.21")]
    assert cyclone("foxy") == [*ANY, *interface, *COMMON, *PEERS, ("Internal/LeaseDuration", "120s")]


@pytest.mark.parametrize("release", ["humble", "jazzy"])
def test_cyclone_of_humble_and_jazzy(release: str) -> None:
    interface = [("General/Interfaces/NetworkInterface@address", "10.80.0.21")]
    assert cyclone(release) == [*ANY, *interface, *COMMON, ("Discovery/LeaseDuration", "120s"), *PEERS]


def test_cyclone_dds_of_a_laptop_keeps_every_peer() -> None:
    interface = [("General/Interfaces/NetworkInterface@address", "10.80.0.21")]
    kept = [("Discovery/LeaseDuration", "120s"), ("Discovery/InitialLocatorPruneDelay", "inf")]
    assert cyclone("pypi") == [*ANY, *interface, *COMMON, *kept, *PEERS]


@pytest.mark.parametrize("release", ["foxy", "humble", "jazzy"])
def test_fast_dds(release: str) -> None:
    transport, participant = "transport_descriptors/transport_descriptor", "participant/rtps"
    discovery, initial = f"{participant}/builtin/discovery_config", f"{participant}/builtin/initialPeersList"
    assert [
        (path.removeprefix(f"{FAST}/"), value)
        for path, value in leaves(view("coastal-gateway", "wifi-ptp", release), "fastdds.xml")
    ] == [
        (f"{transport}/transport_id", "atlantis_udp"),
        (f"{transport}/type", "UDPv4"),
        (f"{transport}/maxMessageSize", "1372"),
        (f"{transport}/maxInitialPeersRange", "10"),
        (f"{transport}/interfaceWhiteList/address", "10.80.0.21"),
        ("participant@profile_name", "atlantis"),
        ("participant@is_default_profile", "true"),
        (f"{discovery}/leaseDuration/sec", "120"),
        (f"{discovery}/leaseAnnouncement/sec", "5"),
        (f"{participant}/builtin/metatrafficUnicastLocatorList/locator/udpv4", ""),
        (f"{initial}/locator/udpv4/address", "10.80.0.2"),
        (f"{initial}/locator/udpv4/address", "10.80.0.21"),
        (f"{participant}/userTransports/transport_id", "atlantis_udp"),
        (f"{participant}/useBuiltinTransports", "false"),
    ]


def test_each_link_has_its_files() -> None:
    declaration = pilot()
    views = profile_views(declaration, declaration.hosts["coastal-gateway"])
    assert [name for one in views for name in profiles(one)] == [
        f"{bearer}/{name}"
        for bearer in ("wifi-ptp", "4g", "satellite")
        for name in ("cyclonedds.xml", "fastdds.xml", "ros.env")
    ]


def test_a_laptop_without_ros_has_no_fast_dds() -> None:
    files = profiles(view("scc-control", "uplink", "pypi"))
    assert list(files) == ["uplink/cyclonedds.xml", "uplink/ros.env"]
    assert files["uplink/ros.env"].splitlines()[1:] == ["CYCLONEDDS_URI=file:///etc/atlantis/dds/uplink/cyclonedds.xml"]


@pytest.mark.parametrize(
    ("release", "kept_open"),
    [
        ("foxy", "ROS_LOCALHOST_ONLY=0"),
        ("humble", "ROS_LOCALHOST_ONLY=0"),
        ("jazzy", "ROS_AUTOMATIC_DISCOVERY_RANGE=SYSTEM_DEFAULT"),
    ],
)
def test_the_environment(release: str, kept_open: str) -> None:
    dds = Dds(distribution=RosDistribution.FOXY, middleware=RosMiddleware.CYCLONE_DDS, domain=42)
    assert profiles(view("coastal-gateway", "4g", release, dds))["4g/ros.env"].splitlines()[1:] == [
        "CYCLONEDDS_URI=file:///etc/atlantis/dds/4g/cyclonedds.xml",
        "FASTRTPS_DEFAULT_PROFILES_FILE=/etc/atlantis/dds/4g/fastdds.xml",
        "RMW_IMPLEMENTATION=rmw_cyclonedds_cpp",
        "ROS_DOMAIN_ID=42",
        kept_open,
    ]


@pytest.mark.parametrize("kind", LinkKind)
@pytest.mark.parametrize("lease_s", [120, 180])
def test_lease_outlives_a_link_gap_and_a_lost_announcement(kind: LinkKind, lease_s: int) -> None:
    assert Dds(distribution=RosDistribution.FOXY).lease_s <= lease_s
    assert GAP_S + 2 * TUNING[kind.traits.pace].announce_s < lease_s


def everywhere() -> Inventory:
    """The shipped pilot, and DDS crosses every link."""
    declaration = pilot()
    return replace(
        declaration,
        sites={
            name: site.model_copy(
                update={"bearers": tuple(bearer.model_copy(update={"dds": True}) for bearer in site.bearers)}
            )
            for name, site in declaration.sites.items()
        },
    )


def test_control_centre_lists_all_gateways_at_the_slowest_pace() -> None:
    declaration = everywhere()
    (centre,) = profile_views(declaration, declaration.hosts["scc-control"])
    assert [name for name, _ in centre.peers] == ["scc-control", "coastal-gateway", "te4sea-gateway"]
    assert centre.tuning == TUNING[Pace.SATELLITE]


def test_control_centre_omits_gateways_with_links_closed_to_dds() -> None:
    """It would announce itself to it over a satellite as well, whoever has to pay for it; it hears it anyway."""
    centre = view("scc-control", "uplink")
    assert [name for name, _ in centre.peers] == ["scc-control"]
    assert centre.tuning == TUNING[Pace.SATELLITE]
    assert [name for name, _ in view("te4sea-gateway", "4g").peers] == ["scc-control", "te4sea-gateway"]


def test_cost_of_announcements() -> None:
    """1 other computer x 11 packets of Fast DDS of 484 bytes and 52 of the VPN, every 20 s; Cyclone DDS: 10 of 380."""
    assert view("coastal-gateway", "satellite").announced_mb_a_day == pytest.approx(11 * 536 * 4320 / 1e6)
    declaration = everywhere()
    (centre,) = profile_views(declaration, declaration.hosts["scc-control"])
    assert centre.announced_mb_a_day == pytest.approx(2 * 11 * 536 * 4320 / 1e6)
    assert view("scc-control", "uplink").announced_mb_a_day == 0.0
    cyclone = view("coastal-gateway", "satellite", "pypi")
    assert cyclone.announced_mb_a_day == pytest.approx(10 * 432 * 4320 / 1e6)


PEERED = Dds(
    distribution=RosDistribution.HUMBLE,
    peers=(
        DdsPeer(name="sparus-onboard", address=IPv4Address("10.80.17.5"), site="coastal"),
        DdsPeer(name="zarco-station", address=IPv4Address("10.80.16.5")),
    ),
)


def test_peers_are_those_of_the_site_and_those_without_one() -> None:
    def names(host: str, bearer: str) -> list[str]:
        return [name for name, _ in view(host, bearer, dds=PEERED).peers]

    assert names("coastal-gateway", "4g") == ["scc-control", "coastal-gateway", "sparus-onboard", "zarco-station"]
    assert names("te4sea-gateway", "4g") == ["scc-control", "te4sea-gateway", "zarco-station"]
    assert names("scc-control", "uplink")[-2:] == ["sparus-onboard", "zarco-station"]


def test_vehicles_with_a_reservation_are_peers_over_the_lan() -> None:
    over_lan = view("coastal-gateway", "wifi-ptp", dds=Dds(distribution=RosDistribution.FOXY, over=DdsPath.LAN))
    assert over_lan.address == "10.64.1.10"
    assert over_lan.peers == (
        ("scc-control", "10.64.0.11"),
        ("coastal-gateway", "10.64.1.10"),
        ("girona500", "10.64.1.21"),
        ("sparus", "10.64.1.22"),
        ("zarco", "10.64.1.23"),
        ("stork", "10.64.1.24"),
        ("mares", "10.64.1.25"),
        ("eca-rov", "10.64.1.26"),
    )


def test_host_without_dds_is_refused() -> None:
    declaration = pilot()
    with pytest.raises(UsageError, match="`coastal-router` is a router: it does not use DDS") as refused:
        profile_views(declaration, declaration.hosts["coastal-router"])
    assert refused.value.hint == "hosts that do: scc-control, coastal-gateway, te4sea-gateway"


def test_unknown_release_is_refused() -> None:
    declaration = pilot()
    with pytest.raises(UsageError, match="`galactic` is not a known release") as refused:
        profile_views(declaration, declaration.hosts["coastal-gateway"], "galactic")
    assert refused.value.hint == f"known releases: {', '.join(RELEASES)}"


def test_every_declarable_distribution_is_known() -> None:
    assert {*RosDistribution} < RELEASES.keys()
