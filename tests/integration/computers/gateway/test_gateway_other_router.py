"""A gateway takes neither a route nor an address from a computer that nobody has declared to be a router."""

import re
from pathlib import Path

import pytest
import rogue_router
from gateway_role import NAME, Stand
from gateway_stand import FREE_CLOCK, ROUTER, Key, Start, ground, machine, technician  # noqa: F401 - fixtures
from rogue_router import PREFIX
from waiting import wait_until

from atlantis_netcfg.emulator.lab import Lab

pytestmark = [pytest.mark.namespace, pytest.mark.slow]

OTHER, TARGET = "10.64.1.99", "192.0.2.55"
DEFAULT, PREFIXED = f"default via {rogue_router.ROUTER}", str(PREFIX).rstrip(":")
NO_LLMNR = "[Resolve]\nLLMNR=no\nMulticastDNS=no\n"


def said(stand: Stand, command: str) -> str:
    return stand.gateway.run(command).stdout


def linked(stand: Stand) -> bool:
    """Whether IPv6 of the interface is ready: a computer hears no router before."""
    line = said(stand, "ip -6 -oneline address show dev eth0 scope link")
    return bool(line) and "tentative" not in line


def deceive(stand: Stand, ground: Lab) -> None:  # noqa: F811 - a fixture
    """An advertisement and a redirect; both have arrived when this returns."""
    wait_until(lambda: linked(stand))
    rogue_router.send(ground, rogue_router.advertisement())
    mac = said(stand, "cat /sys/class/net/eth0/address").strip()
    said(stand, f"ping -c 1 -W 5 {OTHER}")  # the kernel believes a redirect to a neighbour that it knows
    rogue_router.send(ground, rogue_router.redirect(mac, stand.gateway.address, ROUTER, TARGET, OTHER))
    said(stand, f"ping -c 1 -W 5 {ROUTER}")


def routes(stand: Stand) -> dict[str, bool]:
    """What the kernel has taken over."""
    return {
        "default route": DEFAULT in said(stand, "ip -6 route"),
        "address": PREFIXED in said(stand, "ip -6 address show dev eth0"),
        "redirect": OTHER in said(stand, f"ip route get {TARGET}"),
    }


@pytest.fixture
def stand(
    machine: Start,  # noqa: F811 - fixtures
    technician: Key,  # noqa: F811
    ground: Lab,  # noqa: F811
    tmp_path: Path,
) -> Stand:
    """A gateway as it comes from the vendor, and a robot's address beside it."""
    made = Stand(machine(NAME), technician, tmp_path, ["gateway_base"])
    ground.add_address(f"{OTHER}/24")
    made.gateway.put("/etc/systemd/system/chrony.service.d/test.conf", FREE_CLOCK)
    made.gateway.run("systemctl daemon-reload")
    return made


def test_no_route_comes_from_another_computer(stand: Stand, ground: Lab) -> None:  # noqa: F811 - a fixture
    """The same frames deceive the computer as it comes from the vendor."""
    deceive(stand, ground)
    assert routes(stand) == {"default route": True, "address": True, "redirect": True}

    done = stand.run()
    assert done["hint"] is None, done["message"]
    assert not [note for note in done["notes"] if ".conf." in note]
    assert stand.run()["changes"] == []
    keys = "grep -H . /proc/sys/net/ipv[46]/conf/*/accept_redirects /proc/sys/net/ipv6/conf/*/accept_ra"
    assert {line.rpartition(":")[2] for line in said(stand, keys).splitlines()} == {"0"}
    assert said(stand, "grep -v ^# /etc/systemd/resolved.conf.d/60-atlantis.conf") == NO_LLMNR

    stand.gateway.power_cut()
    stand.gateway.power_on()
    none = {"default route": False, "address": False, "redirect": False}
    deceive(stand, ground)
    assert routes(stand) == none
    stand.gateway.run("nft flush ruleset")
    deceive(stand, ground)
    assert routes(stand) == none, "the kernel alone, without the firewall"


def test_firewall_alone_blocks_foreign_routes(stand: Stand, ground: Lab) -> None:  # noqa: F811 - a fixture
    """Whatever switches the kernel's own protection off: a tool of the network, or a person."""
    stand.run()
    keys = "/proc/sys/net/ipv4/conf/*/accept_redirects /proc/sys/net/ipv6/conf/*/accept_ra"
    stand.gateway.run(f"for key in {keys}; do echo 1 > $key; done")
    deceive(stand, ground)
    assert routes(stand) == {"default route": False, "address": False, "redirect": False}
    counted = said(stand, "nft list chain inet atlantis input")
    assert len(re.findall(r"counter packets [1-9]\d* bytes .* drop comment", counted)) == 2, counted
