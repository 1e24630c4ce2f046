"""The arithmetic of what a link carries by itself: sizes, intervals, and what they cost."""

from decimal import Decimal

import pytest

from atlantis_netcfg.links import standing_traffic
from atlantis_netcfg.links.cost import MeteredLink, Tariff

CYCLONE = standing_traffic.DdsSizes(
    380, has_repeat=False, sample_head=84, reliability=standing_traffic.CycloneHeartbeats()
)
FAST = standing_traffic.DdsSizes(
    484, has_repeat=True, sample_head=160, reliability=standing_traffic.PeriodicHeartbeats()
)
CABLE = standing_traffic.LinkPace(rtt_s=0.0, up_bps=1e9)
UDP = standing_traffic.VpnHeaders.of("udp")


def test_probe_target_traffic() -> None:
    assert standing_traffic.probe_targets(2, 10) == standing_traffic.StandingFlow(
        standing_traffic.TrafficSource.CANARIES, 8640 * 2 * 84, 8640 * 2 * 84, always=True
    )
    assert standing_traffic.probe_targets(0, 10).both == 0
    assert standing_traffic.probe_targets(2, 30).both * 3 == standing_traffic.probe_targets(2, 10).both


def test_ntp_traffic() -> None:
    assert standing_traffic.ntp_traffic(2, 1024).both == pytest.approx(2 * 2 * 76 * standing_traffic.DAY_S / 1024)


@pytest.mark.parametrize(("ping_s", "mb_a_day"), [(10, 1.17), (60, 0.20)])
def test_keep_alive_agrees_with_measured_traffic(ping_s: float, mb_a_day: float) -> None:
    """facts/vpn.md, section 9: 1200 s at IP level, without a renegotiation."""
    assert standing_traffic.keep_alive(ping_s, 1e12, None, None).both / 1e6 == pytest.approx(mb_a_day, rel=0.03)
    assert standing_traffic.keep_alive(ping_s, 3600, None, None).both / 1e6 == pytest.approx(mb_a_day + 0.12, rel=0.03)


def test_frequent_traffic_replaces_keep_alive_pings() -> None:
    quiet = standing_traffic.keep_alive(60, 3600, None, None)
    assert standing_traffic.keep_alive(60, 3600, 60, 90) == quiet
    one_way = standing_traffic.keep_alive(60, 3600, 20, None)
    assert quiet.up - one_way.up == pytest.approx(1440 * 68)
    assert one_way.down == quiet.down


@pytest.mark.parametrize(
    ("sizes", "processes", "sent", "refused"),
    [
        (CYCLONE, 1, 10 * 432, 6 * 460),
        (FAST, 1, 11 * 536, 6 * 564),
        (FAST, 2, 2 * 12 * 536, 2 * 6 * 564),
        (CYCLONE, 8, 8 * 10 * 432, 8 * 2 * 460),
        (CYCLONE, 10, 10 * 10 * 432, 0),
    ],
)
def test_dds_announcements_and_port_refusals(
    sizes: standing_traffic.DdsSizes, processes: int, sent: int, refused: int
) -> None:
    announcing = standing_traffic.DdsAnnouncements(processes, ports=10, every_s=20, sizes=sizes)
    assert announcing.announcement_bytes(1, UDP) == pytest.approx(sent * 4320)
    assert announcing.announcement_bytes(3, UDP) == pytest.approx(3 * sent * 4320)
    assert announcing.refusal_bytes(1, UDP) == pytest.approx(refused * 4320)


def test_kernel_sends_at_most_one_refusal_per_second() -> None:
    assert (
        standing_traffic.DdsAnnouncements(5, ports=50, every_s=5, sizes=CYCLONE).refusal_bytes(
            1, standing_traffic.NO_VPN
        )
        == standing_traffic.DAY_S * 408
    )


@pytest.mark.parametrize(
    ("size_bytes", "on_the_link"),
    [
        (20, 104),  # as it was counted of Cyclone DDS
        (17, 104),
        (1200 - 56, 84 + 1144),
        (1200 - 55, 2 * (84 + 12) + 1148),
        (20_000, 19 * (84 + 12) + 20_000),
    ],
)
def test_oversized_message_is_fragmented(size_bytes: int, on_the_link: int) -> None:
    cost = standing_traffic.DdsMessages(1200, 1100, CYCLONE, standing_traffic.NO_VPN).cost(
        standing_traffic.SteadyTopic(1.0, size_bytes), CABLE
    )
    assert (cost.bytes_up, cost.bytes_down) == (on_the_link, 0)
    assert cost.packets_up == cost.fragments


def test_telemetry_goes_to_each_subscriber() -> None:
    topics = [(2, standing_traffic.MessageCost(1, 104, 1)), (0.5, standing_traffic.MessageCost(1, 1000, 1, 92, 1))]
    assert standing_traffic.topic_flow(topics, 2) == standing_traffic.StandingFlow(
        standing_traffic.TrafficSource.TELEMETRY, (208 + 500) * 2 * standing_traffic.DAY_S, 92 * standing_traffic.DAY_S
    )


def test_permanent_traffic_is_reported_separately() -> None:
    asked, said = (
        standing_traffic.probe_targets(2, 30),
        standing_traffic.StandingFlow(standing_traffic.TrafficSource.DDS, 1_000_000, 2_000_000),
    )
    traffic = standing_traffic.StandingTraffic(MeteredLink("4g", "quay", is_metered=True), (asked, said))
    assert (traffic.idle_day_bytes, traffic.day_bytes) == (967_680, 3_967_680)
    assert traffic.month_bytes == 30 * traffic.day_bytes
    assert traffic.words == (
        "4.0 MB per day, 119.0 MB per month while it carries the traffic: price unknown",
        "per day: canaries 968 kB, DDS 3.0 MB",
        "968 kB per day while another link carries the traffic",
    )
    assert traffic.only(standing_traffic.TrafficSource.DDS).flows == (said,)


def test_endless_session_is_billed_at_the_floor() -> None:
    tariff = Tariff(Decimal(8), min_session_bytes=5000, floor_bytes_per_s=300, floor_after_s=300)
    link = MeteredLink("satellite", "quay", is_metered=True, tariff=tariff)
    traffic = standing_traffic.StandingTraffic(
        link, (standing_traffic.StandingFlow(standing_traffic.TrafficSource.VPN, 100_000, 100_000),)
    )
    assert traffic.bill.billed_bytes == 300 * 30 * standing_traffic.DAY_S
    assert traffic.words[-1] == "a month is billed as 777.6 MB, the floor of a long session"
    assert traffic.words[0].endswith(": 6220.80 EUR")
    assert traffic.as_dict()["bill_month"] == traffic.bill.as_dict()


def test_unmetered_link_has_no_price() -> None:
    traffic = standing_traffic.StandingTraffic(
        MeteredLink("wifi-ptp", "quay", is_metered=False),
        (standing_traffic.StandingFlow(standing_traffic.TrafficSource.VPN, 1000, 1000),),
    )
    assert traffic.words == ("2.0 kB per day, 60 kB per month while it carries the traffic", "per day: VPN 2.0 kB")
    assert traffic.as_dict()["bill_month"] is None


def test_flows_of_one_source_are_added_up() -> None:
    flows = [
        standing_traffic.StandingFlow(standing_traffic.TrafficSource.DDS, 1, 2),
        standing_traffic.probe_targets(1, 10),
        standing_traffic.StandingFlow(standing_traffic.TrafficSource.DDS, 3, 4),
        standing_traffic.StandingFlow(standing_traffic.TrafficSource.TIME, 0, 0),
    ]
    assert standing_traffic.sum_by_source(flows) == (
        standing_traffic.probe_targets(1, 10),
        standing_traffic.StandingFlow(standing_traffic.TrafficSource.DDS, 4, 6),
    )
    assert standing_traffic.StandingFlow(
        standing_traffic.TrafficSource.DDS, 1, 2
    ).mirror() == standing_traffic.StandingFlow(standing_traffic.TrafficSource.DDS, 2, 1)
