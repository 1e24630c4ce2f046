"""The question for IPv6 routers, against Debian's dnsmasq: it is found by what it advertises, and not believed."""

import subprocess

import pytest
from dhcp_stand import CABLE, Segment, segment  # noqa: F401 - a fixture
from test_ear_dhcp import NOBODY

from atlantis_netcfg.checklist.probes import RouterAdvertisement, Trouble

pytestmark = pytest.mark.namespace
PREFIX = "2001:db8:9::"
WITHIN_S = 4.0
"""dnsmasq answers after a random time, and rarely twice within 3 s (RFC 4861, 6.2.6)."""


def test_router_is_detected_without_changing_routes(segment: Segment) -> None:  # noqa: F811
    mac = segment.advertise("rogue0", PREFIX)
    # As on a gateway: what the kernel does not take in is heard all the same.
    inside = ["ip", "netns", "exec", segment.name]
    subprocess.run([*inside, "sysctl", "-qw", "net.ipv6.conf.ask0.accept_ra=0"], check=True)
    found = segment.solicit(CABLE, WITHIN_S)
    assert (found.trouble, found.words) == (None, "")
    (heard,) = {(one.address, one.mac): one for one in found.routers}.values()
    assert heard == RouterAdvertisement(heard.address, mac, 1800, (f"{PREFIX}/64",))
    assert heard.address.startswith("fe80::")
    shown = [*inside, "ip", "-6", "route", "show", "dev", "ask0"]
    routes = subprocess.run(shown, check=True, capture_output=True, text=True).stdout
    assert "default" not in routes
    assert PREFIX not in routes


def test_no_router_no_permission_or_no_interface_is_reported(segment: Segment) -> None:  # noqa: F811
    assert segment.solicit("ask0", 0.2).routers == ()
    found = segment.solicit("ask0", WITHIN_S, *NOBODY)
    assert (found.trouble, found.words) == (Trouble.DENIED, "only root may ask a segment for its routers")
    absent = segment.solicit("10.64.9.99", WITHIN_S)
    assert (absent.trouble, absent.words) == (Trouble.MISSING, "this computer has no interface 10.64.9.99")
