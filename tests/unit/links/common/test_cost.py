"""What a session is billed as: the published example by hand, and what holds for any tariff."""

from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from atlantis_netcfg.computers.dds import SIZES
from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.inventory.model import RosMiddleware
from atlantis_netcfg.links.cost import Basis, MeteredLink, Tariff, bill, preview, size
from atlantis_netcfg.links.standing_traffic import NO_VPN, DdsMessages, LinkPace, SteadyTopic

CERTUS_100 = Tariff(Decimal(8), "EUR", min_session_bytes=5000, floor_bytes_per_s=300, floor_after_s=300)
"""The published fair-use rule; the price is an example."""

TARIFFS = st.builds(
    Tariff,
    price_per_mb=st.decimals(0, 1000, places=4),
    min_session_bytes=st.integers(0, 100_000),
    floor_bytes_per_s=st.integers(0, 10_000),
    floor_after_s=st.integers(0, 10_000),
)
BYTES = st.integers(0, 10**9)
SECONDS = st.floats(0, 10**6)


@pytest.mark.parametrize(
    ("nbytes", "seconds", "billed", "basis"),
    [
        (0, 0.0, 0, Basis.PAYLOAD),
        (0, 86400.0, 0, Basis.PAYLOAD),
        (1, 1.0, 5000, Basis.MINIMUM),
        (5000, 1.0, 5000, Basis.PAYLOAD),
        (60_000, 299.9, 60_000, Basis.PAYLOAD),
        (60_000, 300.0, 90_000, Basis.FLOOR),
        (200_000, 600.0, 200_000, Basis.PAYLOAD),
        (1, 86400.0, 25_920_000, Basis.FLOOR),
    ],
)
def test_published_billing_rule_is_applied(nbytes: int, seconds: float, billed: int, basis: Basis) -> None:
    found = bill(nbytes, seconds, CERTUS_100)
    assert (found.billed_bytes, found.basis) == (billed, basis)
    assert found.price == Decimal(8) * billed / 1_000_000


def test_price_without_a_tariff_is_unknown() -> None:
    found = bill(60_000, 900.0, None)
    assert (found.billed_bytes, found.price, found.currency) == (60_000, None, None)
    assert found.words == "60 kB, price unknown"
    assert found.as_dict()["price"] is None


def test_a_price_below_a_cent_is_not_shown_as_nothing() -> None:
    assert bill(5000, 1.0, Tariff(Decimal("0.001"))).money == "less than 0.01 EUR"
    assert bill(5000, 1.0, Tariff(Decimal(0))).money == "0.00 EUR"
    assert bill(60_001, 1.0, Tariff(Decimal(8), "USD")).money == "0.49 USD"


@pytest.mark.parametrize(("nbytes", "seconds"), [(-1, 0.0), (0, -0.1)])
def test_impossible_session_is_not_priced(nbytes: int, seconds: float) -> None:
    with pytest.raises(ValueError, match="invalid session:"):
        bill(nbytes, seconds, CERTUS_100)


@given(BYTES, SECONDS, TARIFFS)
def test_billed_bytes_are_never_below_the_payload(nbytes: int, seconds: float, tariff: Tariff) -> None:
    found = bill(nbytes, seconds, tariff)
    assert found.billed_bytes >= nbytes
    assert (found.billed_bytes == nbytes) == (found.basis is Basis.PAYLOAD)
    assert found.price is not None
    assert found.price >= 0


@given(BYTES, BYTES, SECONDS, SECONDS, TARIFFS)
def test_more_bytes_or_a_longer_session_never_cost_less(
    nbytes: int, more: int, seconds: float, longer: float, tariff: Tariff
) -> None:
    less = bill(nbytes, seconds, tariff)
    assert bill(nbytes + more, seconds, tariff).billed_bytes >= less.billed_bytes
    assert bill(nbytes, seconds + longer, tariff).billed_bytes >= less.billed_bytes


@given(BYTES, SECONDS, TARIFFS)
def test_a_dearer_tariff_never_costs_less(nbytes: int, seconds: float, tariff: Tariff) -> None:
    dearer = Tariff(
        tariff.price_per_mb + 1,
        tariff.currency,
        tariff.min_session_bytes + 1,
        tariff.floor_bytes_per_s + 1,
        max(0, tariff.floor_after_s - 1),
    )
    lower, higher = bill(nbytes, seconds, tariff).price, bill(nbytes, seconds, dearer).price
    assert lower is not None
    assert higher is not None
    assert higher >= lower


def test_preview_names_link_price_and_missing_billing() -> None:
    satellite = MeteredLink("satellite", "coastal", is_metered=True, tariff=CERTUS_100, cap_bytes=5_000_000)
    assert preview(60_000, 40.0, satellite).words == ("over metered link satellite of coastal: about 60 kB, 0.48 EUR")
    lte = MeteredLink("4g", "coastal", is_metered=True, cap_bytes=5_000_000)
    assert preview(60_000, 2.0, lte).words == (
        "over metered link 4g of coastal: about 60 kB, price unknown (`billing` of link `4g` in "
        "group_vars/coastal.yml is not set)"
    )
    cable = MeteredLink("lan", "coastal", is_metered=False)
    assert preview(60_000, 2.0, cable).words == "over lan (not metered): about 60 kB"


def test_cap_applies_to_metered_links_and_names_its_key() -> None:
    link = MeteredLink("satellite", "coastal", is_metered=True, cap_bytes=5_000_000)
    assert not preview(5_000_000, 1.0, link).over_cap
    beyond = preview(5_000_001, 1.0, link)
    assert beyond.over_cap
    assert beyond.refusal().exit is ExitCode.FAILED
    assert "`cap_mb` of link `satellite` in group_vars/coastal.yml" in (beyond.refusal().hint or "")
    assert not preview(10**9, 1.0, MeteredLink("lan", "coastal", is_metered=False, cap_bytes=1)).over_cap
    assert not preview(10**9, 1.0, MeteredLink("4g", "coastal", is_metered=True)).over_cap


@pytest.mark.parametrize(
    ("nbytes", "words"),
    [
        (0, "0 B"),
        (999, "999 B"),
        (1000, "1.0 kB"),
        (9999, "10.0 kB"),
        (61_400, "61 kB"),
        (999_499, "999 kB"),
        (999_500, "1.0 MB"),
        (12_400_000, "12.4 MB"),
    ],
)
def test_sizes_use_the_units_of_a_bill(nbytes: int, words: str) -> None:
    assert size(nbytes) == words


# What a message of a topic is on the link, against bytes that were counted of real participants.


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
def test_model_agrees_with_measured_message_costs(topic: SteadyTopic, up: float, down: float) -> None:
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
def test_message_bytes_agree_with_counted_traffic(name: str) -> None:
    sizes, pace, topic, both = COUNTED[name]
    cost = DdsMessages(1200, 1100, sizes, NO_VPN).cost(topic, pace)
    assert cost.bytes_up + cost.bytes_down == pytest.approx(both, rel=TOLERANCE)


def test_reliable_images_over_a_thin_link_are_sent_several_times() -> None:
    """The reason for the advice of the page: best effort for what goes in fragments."""
    images = SteadyTopic(0.2, 10_000), SteadyTopic(0.2, 10_000, reliable=True)
    once, again = (DdsMessages(1200, 1100, FAST, NO_VPN).cost(topic, SATELLITE) for topic in images)
    assert (once.fragments, once.packets_up, once.packets_down) == (10, 10, 0)
    assert again.packets_up == pytest.approx(55, abs=1)
    assert again.bytes_up > 5 * once.bytes_up
