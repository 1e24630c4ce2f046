"""A gateway's network on a real Debian with systemd, by SSH: what holds stays, what cuts the way in is taken back."""

# ruff: noqa: F401, F811 - `network_stand` and `technician` are fixtures

import json
import re
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import pytest
import rogue_router
from gateway_stand import technician
from network_stand import STATE, NetworkStand, network_stand, other, wanted
from waiting import wait_until

pytestmark = [pytest.mark.namespace, pytest.mark.slow]
EVERY = pytest.mark.parametrize("by", ["netplan", "ifupdown", "networkd"])
SAMPLED = pytest.mark.parametrize(
    "by", ["netplan", *(pytest.param(by, marks=pytest.mark.campaign) for by in ("ifupdown", "networkd"))]
)
"""Each of them waits out three roll-backs: a minute."""
ROLLED_BACK = "the network change was rolled back, and everything is as before"


def settled(stand: NetworkStand, by: str) -> dict[str, Any]:
    """Bring it to what is declared."""
    code, said = stand.run(wanted(by))
    assert code == 0, said
    assert "changed=1 " in said
    return stand.network()


def unchanged(stand: NetworkStand, by: str) -> None:
    code, said = stand.run(wanted(by))
    assert code == 0, said
    assert "changed=0 " in said


def advertised(stand: NetworkStand) -> dict[str, bool]:
    """Which interface takes an address from a router advertisement that reaches both."""
    gateway, names = stand.gateway, ("eth0", "eth1")
    gateway.run("ip link set eth1 up")
    links = "ip -6 -oneline address show dev {} scope link -tentative"
    wait_until(lambda: all(gateway.run(links.format(name)).stdout for name in names))
    rogue_router.send(stand.lab, rogue_router.advertisement())
    prefix = str(rogue_router.PREFIX).rstrip(":")
    wait_until(lambda: prefix in gateway.run("ip -6 address show dev eth1").stdout)
    return {name: prefix in gateway.run(f"ip -6 address show dev {name}").stdout for name in names}


def outcome(stand: NetworkStand) -> str:
    why: str = json.loads(stand.gateway.run(f"cat {STATE}/outcome").stdout)["why"]
    return why


def changed(by: str, old: str, new: str, rollback_s: int) -> dict[str, Any]:
    """As declared, but for one word."""
    return other(wanted(by, rollback_s=rollback_s), old, new)


@EVERY
def test_network_is_applied_and_survives_interruptions_and_power_cuts(network_stand: NetworkStand, by: str) -> None:
    before = network_stand.network()
    code, said = network_stand.run(wanted(by), "--check")
    assert code == 0, said
    assert "changed=1 " in said
    assert network_stand.network() == before

    state = settled(network_stand, by)
    assert wanted(by)["content"] in state["files"]
    assert "nameserver 10.64.1.1\n" in state["files"]
    unchanged(network_stand, by)
    assert network_stand.network() == state
    assert advertised(network_stand) == {"eth0": False, "eth1": True}, "eth1 is as the vendor has it"

    gateway = network_stand.gateway
    network_stand.stage(changed(by, "10.64.1.10", "10.64.1.77", 900))
    wait_until(lambda: gateway.run(f"grep -s ended_s {STATE}/applied | grep -v null", check=False).returncode == 0)
    wait_until(
        lambda: "10.64.1.77/24" in network_stand.network()["addresses"]
    )  # systemd-networkd sets it when it is asked
    gateway.power_cut()
    gateway.power_on(is_configured=False, wait_s=None)
    wait_until(
        lambda: gateway.runs and gateway.run("systemctl is-active multi-user.target", check=False).returncode == 0
    )
    if by == "ifupdown":
        gateway.run("ifup --allow=hotplug eth0")  # udev does it on a board; a container has none
    wait_until(lambda: network_stand.network() == state)
    gateway.wait_until_up()
    assert outcome(network_stand) == "the computer was restarted before a new session had confirmed it"
    unchanged(network_stand, by)
    assert gateway.run("systemctl list-units --failed --no-legend 'atlantis*'").stdout == ""


@SAMPLED
def test_change_that_cuts_access_is_rolled_back(network_stand: NetworkStand, by: str) -> None:
    """An address where nobody looks for it, an interface without a cable, a gateway that nobody is."""
    before = settled(network_stand, by)
    gateway = network_stand.gateway
    gateway.run("ip link add eth9 type bridge && ip link set eth9 up")
    for old, new in (("10.64.1.10", "10.64.1.77"), ("eth0", "eth9")):
        told = changed(by, old, new, 5)
        network_stand.stage(told)
        wait_until(lambda: gateway.run(f"test -e {STATE}/pending", check=False).returncode == 1)
        assert network_stand.network() == before
        assert outcome(network_stand) == f"no new session reached {told['address'].partition('/')[0]} within 5 s"

    code, said = network_stand.run(changed(by, "10.64.1.1", "10.64.1.99", 120))
    assert code == 2, said
    assert f"{ROLLED_BACK}: the gateway address 10.64.1.99 does not respond on eth0" in re.sub(r"\s+", " ", said)
    assert network_stand.network() == before
    unchanged(network_stand, by)


def test_unreachable_address_is_reported_and_rolled_back(network_stand: NetworkStand) -> None:
    """Here no tool has made the network that comes back: what was done by hand is done again."""
    before = network_stand.network()
    code, said = network_stand.run(changed("networkd", "10.64.1.10", "10.64.1.77", 6))
    assert code == 2, said
    assert f"{ROLLED_BACK}: no new session reached 10.64.1.77 within 6 s" in re.sub(r"\s+", " ", said)
    assert "rolled_back: true" in said
    assert "hint: correct `network` of the host or `lan` of its site, then run the same command again" in " ".join(
        said.split()
    )
    assert network_stand.network() == before


SLOW = '#!/bin/sh\nsleep 3\nexec /sbin/ifdown.real "$@"\n'
KILLED = {"apply": "activ", "back": "activating"}
"""Unit, and how `systemctl is-active` begins while it works."""


@pytest.mark.campaign
@pytest.mark.parametrize("verb", list(KILLED))
def test_killed_network_unit_still_ends_in_a_rollback(network_stand: NetworkStand, verb: str) -> None:
    """Of the unit that changes the network, and of the one that takes it back."""
    before = settled(network_stand, "ifupdown")
    gateway = network_stand.gateway
    gateway.run("mv /sbin/ifdown /sbin/ifdown.real")
    gateway.put("/sbin/ifdown", SLOW, mode="0755")
    network_stand.stage(changed("ifupdown", "10.64.1.10", "10.64.1.77", 8))
    unit = f"atlantis-network-{verb}.service"
    wait_until(lambda: gateway.run(f"systemctl is-active {unit}", check=False).stdout.startswith(KILLED[verb]))
    wait_until(lambda: gateway.run(f"systemctl status {unit} | grep ifdown.*eth0", check=False).returncode == 0)
    gateway.run(f"systemctl kill -s KILL {unit}")
    assert gateway.run(f"test -e {STATE}/pending", check=False).returncode == 0
    wait_until(lambda: gateway.run(f"test -e {STATE}/pending", check=False).returncode == 1)
    assert network_stand.network() == before
    unchanged(network_stand, "ifupdown")
