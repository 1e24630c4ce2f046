"""The check of the VPN on a member of a real OpenVPN: the tunnel is up, its server dies, its client ends."""

import re
from collections.abc import Mapping
from pathlib import Path

import pytest
from matrix_papers import host
from matrix_stand import SERVER, Vpn, vpn
from own_asked import GATEWAY, check, findings, inside

from atlantis_netcfg.checklist.probes import Answer, LinkStatusResult, ProbeResult, Rows
from atlantis_netcfg.inventory import load

pytestmark = pytest.mark.namespace
SHIPPED = load(Path(__file__).parents[4] / "inventory")
TOLD: Mapping[str, Answer] = {
    "clients": Rows(None, "", ({"name": "ovpn-scc", "running": "true", "disabled": "false"},)),
    "addresses": Rows(None, "", ({"address": "10.80.0.11/16", "interface": "ovpn-scc"},)),
    "look wifi-ptp": LinkStatusResult(None, "", {"state": "up", "active": True}),
    "look 4g": LinkStatusResult(None, "", {"state": "up", "active": False}),
    "look satellite": LinkStatusResult(None, "", {"state": "unknown", "active": False}),
}
"""By a healthy router."""
HURRY = {"1": "0.2", "10": "1"}
"""Pings that nobody will answer: their interval and how long the last one is waited for, in seconds."""
ROUTER = "PASS router-tunnel: ovpn-scc of coastal-router is up, with its address 10.80.0.11 of the inventory"
UP = "PASS gateway-tunnel: tun0 of coastal-gateway is up, with its address 10.80.0.21 of the inventory"


def asked(made: Vpn, hurry: Mapping[str, str] | None = None) -> ProbeResult:
    return inside(made.name(GATEWAY), check(SHIPPED, "vpn"), TOLD, hurry)


def end(made: Vpn, who: str) -> None:
    """As a crash does it: the other end is not told."""
    made.openvpn[who].kill()
    made.openvpn[who].wait()


def test_a_real_tunnel_is_up_then_without_its_server_then_gone(tmp_path: Path) -> None:
    """One test, because each state is made from the one before."""
    with vpn(SHIPPED, [host(SHIPPED, GATEWAY)], tmp_path) as made:
        judged = asked(made)
        *others, answers = findings(judged)
        assert others == [ROUTER, UP]
        words = (
            r"PASS server-answers: the VPN server 10\.80\.0\.1 replied to 5 of 5 pings through the tunnel, in [\d.]+ ms"
        )
        assert re.fullmatch(words, answers)
        line = judged.evidence[0]
        assert line.what == "pings of 10.80.0.1 through the tunnel"
        assert line.value.startswith("5 packets transmitted, 5 received, 0% packet loss")
        end(made, SERVER)
        assert findings(asked(made, HURRY)) == [
            ROUTER,
            UP,
            "FAIL server-silent: the VPN server 10.80.0.1 replied to none of 5 pings through the tunnel",
        ]
        end(made, GATEWAY)
        assert findings(asked(made, HURRY)) == [
            ROUTER,
            "FAIL gateway-no-tunnel: coastal-gateway has no tunnel: tun0 is missing",
        ]
