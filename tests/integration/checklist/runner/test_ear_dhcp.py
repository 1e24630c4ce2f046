"""The probing for DHCP servers, against Debian's dnsmasq: every server is found, and none gives an address away."""

import pytest
from dhcp_stand import CABLE, Segment, segment  # noqa: F401 - a fixture

from atlantis_netcfg.checklist.probes import Trouble

pytestmark = pytest.mark.namespace
WITHIN_S = 1.0
"""Two servers in the same computer answer within milliseconds."""
NOBODY = ("setpriv", "--reuid=65534", "--clear-groups", "--inh-caps=-all", "--bounding-set=-all")


def test_two_servers_offer_and_nothing_is_leased(segment: Segment) -> None:  # noqa: F811
    macs = {subnet: segment.serve(name, subnet) for name, subnet in (("own0", "10.64.9"), ("rogue0", "192.168.88"))}
    found = segment.ask(CABLE, WITHIN_S)
    assert (found.trouble, found.words) == (None, "")
    assert {(one.server, one.mac, one.router) for one in found.offers} == {
        (f"{subnet}.1", mac, f"{subnet}.1") for subnet, mac in macs.items()
    }
    assert {one.address.rpartition(".")[0] for one in found.offers} == set(macs)
    for name in ("own0", "rogue0"):
        said = segment.log(name).read_text()
        assert "DHCPDISCOVER" in said
        assert "DHCPOFFER" in said
        assert "DHCPREQUEST" not in said
        assert not segment.leases(name).exists() or segment.leases(name).read_text() == ""


def test_no_server_no_permission_or_no_interface_is_reported(segment: Segment) -> None:  # noqa: F811
    assert segment.ask("ask0", 0.1).offers == ()
    found = segment.ask("ask0", WITHIN_S, *NOBODY)
    assert (found.trouble, found.words) == (Trouble.DENIED, "only root may ask a segment for its DHCP servers")
    absent = segment.ask("10.64.9.99", WITHIN_S)
    assert (absent.trouble, absent.words) == (Trouble.MISSING, "this computer has no interface 10.64.9.99")
    segment.ip("link", "set", "ask0", "down")
    down = segment.ask("ask0", WITHIN_S)
    assert (down.trouble, down.words) == (Trouble.UNREACHABLE, "ask0: Network is down")
