"""The part `openvpn_client` of the shipped pilot, and of pilots that differ from it in one thing."""

import json
import subprocess
from dataclasses import replace
from ipaddress import IPv4Address
from pathlib import Path
from typing import Any

import pytest

from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.inventory.model import LinkKind, Transport
from atlantis_netcfg.vpn.client import CONF, IDENTITY, SERVICE, openvpn_client, site_link
from atlantis_netcfg.vpn.identity import MemberLink

SHIPPED = load(Path(__file__).parents[4] / "inventory")
HOST = "coastal-gateway"
FILE = Path("/laptop/coastal-gateway.identity")
DROP_IN = f"/etc/systemd/system/{SERVICE}.d/atlantis.conf"


def told(declaration: Inventory = SHIPPED, identity: Path | None = FILE) -> dict[str, Any]:
    made = openvpn_client(declaration, declaration.hosts[HOST], identity).as_dict()
    assert json.loads(json.dumps(made)) == made
    return made


def text(made: dict[str, Any], path: str = CONF) -> str:
    (found,) = [file["content"] for file in made["configure"]["files"] if file["path"] == path]
    return str(found)


def options(made: dict[str, Any]) -> dict[str, str]:
    lines = [line for line in text(made).splitlines() if line and not line.startswith("#")]
    return {line.partition(" ")[0]: line.partition(" ")[2] for line in lines}


def without(*kinds: LinkKind) -> Inventory:
    """The pilot whose coastal site lacks some bearers."""
    site = SHIPPED.sites["coastal"]
    kept = tuple(bearer for bearer in site.bearers if bearer.kind not in kinds)
    return replace(SHIPPED, sites={**SHIPPED.sites, "coastal": site.model_copy(update={"bearers": kept})})


def test_gateway_with_an_identity_runs_a_client_that_verifies_the_server() -> None:
    made = told()
    assert made["packages"]["packages"] == [{"name": "openvpn", "version": None}]
    assert made["identity"] == {"path": IDENTITY, "mode": "0600", "from": str(FILE)}
    (unit,) = made["configure"]["units"]
    assert (unit["enabled"], unit["active"], unit["after"]) == (True, True, [CONF, DROP_IN, IDENTITY])
    said = options(made)
    assert said["remote"] == "203.0.113.2 1194"
    assert (said["dev"], said["proto"], said["verify-x509-name"]) == ("tun0", "udp4", "scc-vpn name")
    assert said["remote-cert-tls"] == "server"
    assert said["auth-retry"] == "nointeract"
    assert said["config"] == IDENTITY
    assert "brought" not in made["configure"]


def test_missing_identity_keeps_the_installed_one_and_is_noted() -> None:
    made = told(identity=None)
    assert made["identity"] is None
    (unit,) = made["configure"]["units"]
    assert "enabled" not in unit
    assert "active" not in unit
    assert "absent" not in made["configure"]
    (brought,) = made["configure"]["brought"]
    assert brought["path"] == IDENTITY
    assert "`provision vpn onboard device=coastal-gateway`" in brought["note"]
    assert "`provision vpn accept file=FILE`" in brought["note"]
    assert made["configure"]["files"] == told()["configure"]["files"]


def test_gateway_outside_the_vpn_has_the_client_removed() -> None:
    host = SHIPPED.hosts[HOST]
    outside = replace(host, device=host.device.model_copy(update={"vpn_address": None}))
    made = openvpn_client(SHIPPED, outside, FILE).as_dict()
    assert made["packages"]["packages"] == []
    assert made["identity"] is None
    assert set(made["configure"]["absent"]) == {CONF, DROP_IN, IDENTITY}
    assert made["configure"]["units"] == [
        {"name": SERVICE, "enabled": False, "active": False, "after": [], "reload": False, "wait": True}
    ]


@pytest.mark.parametrize(
    ("lacking", "link", "ping", "retry", "slow"),
    [
        ((), MemberLink.SATELLITE, ("170", "600"), "5 900", "slow"),
        ((LinkKind.SATELLITE,), MemberLink.LTE, ("25", "120"), "5 300", ""),
        ((LinkKind.SATELLITE, LinkKind.LTE), MemberLink.FIBRE, ("10", "60"), "5 300", ""),
    ],
)
def test_timers_follow_the_slowest_link(
    lacking: tuple[LinkKind, ...], link: MemberLink, ping: tuple[str, str], retry: str, slow: str
) -> None:
    declaration = without(*lacking)
    assert site_link(declaration, "coastal") is link
    said = options(told(declaration))
    assert (said["ping"], said["ping-restart"]) == ping
    assert said["connect-retry"] == retry
    assert ("hand-window" in said, "tls-timeout" in said) == (bool(slow), bool(slow))


def test_client_uses_the_lan_address_at_the_server_site_and_tcp_options() -> None:
    server = SHIPPED.hosts["scc-vpn"]
    beside = replace(SHIPPED, hosts={**SHIPPED.hosts, "scc-vpn": replace(server, site="coastal")})
    assert options(told(beside))["remote"] == "10.64.0.10 1194"
    vpn = SHIPPED.pilot.vpn.model_copy(update={"transport": Transport.TCP, "endpoint": IPv4Address("192.0.2.7")})
    said = options(told(replace(SHIPPED, pilot=SHIPPED.pilot.model_copy(update={"vpn": vpn}))))
    assert (said["proto"], said["remote"]) == ("tcp4-client", "192.0.2.7 1194")
    assert "explicit-exit-notify" not in said


def test_client_restarts_after_refusal_and_waits_for_the_clock() -> None:
    drop_in = text(told(), DROP_IN)
    assert "Restart=always\nRestartSec=300\n" in drop_in
    assert "RestartSec=10\n" in text(told(without(LinkKind.SATELLITE, LinkKind.LTE)), DROP_IN)
    assert "StartLimitIntervalSec=0" in drop_in
    assert "-newermt now)\" || chronyc waitsync 30 0 0 2'\n" in drop_in


@pytest.mark.parametrize("lacking", [(), (LinkKind.SATELLITE, LinkKind.LTE)])
def test_openvpn_accepts_the_configuration(lacking: tuple[LinkKind, ...], tmp_path: Path) -> None:
    conf, identity = tmp_path / "atlantis.conf", tmp_path / "atlantis.identity"
    identity.write_text("# no key yet\n")
    conf.write_text(text(told(without(*lacking))).replace(IDENTITY, str(identity)))
    done = subprocess.run(
        ["openvpn", "--config", str(conf), "--show-ciphers"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    conf.write_text(conf.read_text() + "no-such-option\n")
    done = subprocess.run(
        ["openvpn", "--config", str(conf), "--show-ciphers"], capture_output=True, text=True, check=False
    )
    assert done.returncode != 0
