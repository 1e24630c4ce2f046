"""Patience belongs to the bearer: seconds on a cable, longer than a gap of 70 s where there are gaps."""

from dataclasses import replace

import pytest

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.operations.common.session_link import LAN, with_timeouts
from atlantis_netcfg.routeros.api import Endpoint
from atlantis_netcfg.routeros.estimate import LinkMetrics

ENDPOINT = Endpoint("192.0.2.1", 8729, "provision", Secret("x"), None)
BRIDGE = LinkMetrics("wifi-ptp", 0.004, 50e6, 50e6, is_metered=False)
MOBILE = LinkMetrics("4g", 0.06, 20e6, 20e6, is_metered=True)
SATELLITE = LinkMetrics("satellite", 0.7, 352e3, 704e3, is_metered=True)
GAP_S = 70


@pytest.mark.parametrize("bearer", [LAN, BRIDGE], ids=lambda bearer: bearer.name)
def test_link_without_gaps_times_out_in_seconds(bearer: LinkMetrics) -> None:
    found = with_timeouts(ENDPOINT, bearer)
    assert found.connect_timeout_s <= 15
    assert found.reply_timeout_s <= 60
    assert replace(found, connect_timeout_s=120.0, reply_timeout_s=180.0) == ENDPOINT


@pytest.mark.parametrize(
    "bearer", [MOBILE, SATELLITE, replace(SATELLITE, is_metered=False)], ids=lambda bearer: bearer.name
)
def test_link_with_gaps_has_timeouts_longer_than_a_gap(bearer: LinkMetrics) -> None:
    found = with_timeouts(ENDPOINT, bearer)
    assert min(found.connect_timeout_s, found.reply_timeout_s) > GAP_S + 10 * bearer.rtt_s
