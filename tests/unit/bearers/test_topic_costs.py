"""What a message of a topic is on the link, against bytes that were counted of real participants."""

from __future__ import annotations

import pytest

from atlantis_netcfg.bearers.standing import NO_VPN, DdsMessages, LinkPace, SteadyTopic
from atlantis_netcfg.declaration.model import RosMiddleware
from atlantis_netcfg.gateway.dds import SIZES

TOLERANCE = 0.15
CYCLONE, FAST = (SIZES[kind] for kind in (RosMiddleware.CYCLONE_DDS, RosMiddleware.FAST_DDS))
CABLE = LinkPace(rtt_s=0.0, up_bps=1e9)
SATELLITE = LinkPace(rtt_s=0.7, up_bps=352_000)
MOBILE = LinkPace(rtt_s=0.06, up_bps=10e6)


@pytest.mark.parametrize(
    ("topic", "up", "down"),
    [
        (SteadyTopic(4.0, 32, reliable=True), 163, 86),
        (SteadyTopic(4.0, 32), (1393 - 968) / 4, 0),
        (SteadyTopic(5.0, 6000), (33_000 - 968) / 5, 0),
    ],
)
def test_the_measured_table_is_a_second_witness(topic: SteadyTopic, up: float, down: float) -> None:
    """facts/devices.md, section 9: Cyclone DDS 0.10.2 with its own fragments of 1344 bytes, by the cost of one more."""
    cost = DdsMessages(1344, 1344, CYCLONE, NO_VPN).cost(topic, CABLE)
    assert (cost.bytes_up, cost.bytes_down) == pytest.approx((up, down), rel=TOLERANCE)


COUNTED = {
    "cyclone, at once": (CYCLONE, CABLE, SteadyTopic(1.0, 32, reliable=True), 148 + 92),
    "cyclone, fragments": (CYCLONE, CABLE, SteadyTopic(5.0, 6000, reliable=True), 6677 + 92),
    "cyclone, satellite": (CYCLONE, SATELLITE, SteadyTopic(1.0, 32, reliable=True), 643 + 659),
    "cyclone, satellite, not yet acknowledged": (CYCLONE, SATELLITE, SteadyTopic(4.0, 32, reliable=True), 267 + 227),
    "cyclone, satellite, fragments": (CYCLONE, SATELLITE, SteadyTopic(0.4, 6000, reliable=True), 7240 + 712),
    "cyclone, mobile": (CYCLONE, MOBILE, SteadyTopic(1.0, 32, reliable=True), 150 + 95),
    "fast, at once": (FAST, CABLE, SteadyTopic(1.0, 32, reliable=True), 246 + 53),
    "fast, best effort": (FAST, CABLE, SteadyTopic(4.0, 32), 192),
    "fast, a full history": (FAST, CABLE, SteadyTopic(4.0, 32, reliable=True), 208 + 27),
    "fast, fragments": (FAST, CABLE, SteadyTopic(5.0, 6000, reliable=True), 7266 + 154),
    "fast, satellite": (FAST, SATELLITE, SteadyTopic(4.0, 32, reliable=True), 224 + 57),
    "fast, satellite, fragments sent again": (FAST, SATELLITE, SteadyTopic(0.4, 6000, reliable=True), 24_963 + 2734),
    "fast, satellite, ten fragments": (FAST, SATELLITE, SteadyTopic(0.2, 10_000, reliable=True), 64_874 + 8392),
    "fast, mobile, ten fragments": (FAST, MOBILE, SteadyTopic(0.2, 10_000, reliable=True), 12_436 + 295),
}
"""By hand, November 2026, for 25 to 30 s inside a real tunnel (on the cable without): Cyclone DDS 11, Fast DDS 2.9."""


@pytest.mark.parametrize("name", COUNTED)
def test_bytes_of_a_message_as_they_were_counted(name: str) -> None:
    sizes, pace, topic, both = COUNTED[name]
    cost = DdsMessages(1200, 1100, sizes, NO_VPN).cost(topic, pace)
    assert cost.bytes_up + cost.bytes_down == pytest.approx(both, rel=TOLERANCE)


def test_reliable_images_over_a_thin_link_go_several_times() -> None:
    """The reason for the advice of the page: best effort for what goes in fragments."""
    images = SteadyTopic(0.2, 10_000), SteadyTopic(0.2, 10_000, reliable=True)
    once, again = (DdsMessages(1200, 1100, FAST, NO_VPN).cost(topic, SATELLITE) for topic in images)
    assert (once.fragments, once.packets_up, once.packets_down) == (10, 10, 0)
    assert again.packets_up == pytest.approx(55, abs=1)
    assert again.bytes_up > 5 * once.bytes_up
