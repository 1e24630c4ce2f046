"""What keeps DDS off a link: laid down where a link of the site may not be crossed, and taken away elsewhere."""

from dataclasses import replace
from pathlib import Path

import pytest

from atlantis_netcfg.computers.base import GatewayBase, gateway_base
from atlantis_netcfg.computers.dds_link import SERVICE, links_without_dds
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.inventory.model import DdsPath

SHIPPED = load(Path(__file__).parents[4] / "inventory")
UNIT = f"/etc/systemd/system/{SERVICE}"


def changed(*, dds: bool | None) -> Inventory:
    """The shipped one, with another word on DDS at every link of the coastal site."""
    coastal = SHIPPED.sites["coastal"]
    bearers = tuple(bearer.model_copy(update={"dds": dds}) for bearer in coastal.bearers)
    return replace(SHIPPED, sites={**SHIPPED.sites, "coastal": coastal.model_copy(update={"bearers": bearers})})


def part(declaration: Inventory, name: str = "coastal-gateway") -> GatewayBase:
    return gateway_base(declaration, declaration.hosts[name])


def text(base: GatewayBase, path: str) -> str:
    return next(file.content for file in base.configuration.files if file.path == path)


def test_gateway_pings_its_router_and_drops_its_own_dds() -> None:
    base = part(SHIPPED)
    assert "ping -n -s 0 -i 5 -Q 4 -t 2 203.0.113.2 |" in text(base, UNIT)
    assert text(base, UNIT).count("ping -q -c 1 -s 0 -W 5 10.80.0.1") == 2
    rules = [line.strip() for line in text(base, "/etc/nftables.conf").splitlines() if "no_dds" in line]
    assert rules == [
        "set no_dds {",
        'oifname "tun0" udp dport 7400-7429 meta protocol @no_dds counter drop comment "DDS, kept off this link"',
        (
            "ct state related ip saddr 10.64.1.1 icmp type destination-unreachable icmp code 13"
            ' update @no_dds { meta protocol } comment "no DDS over this link"'
        ),
    ]
    assert [(unit.enabled, unit.active) for unit in base.configuration.units if unit.name == SERVICE] == [(True, True)]


@pytest.mark.parametrize("case", ["every link", "over LANs", "no DDS", "control centre", "outside the VPN"])
def test_service_is_removed_elsewhere(case: str) -> None:
    declaration, name = SHIPPED, "coastal-gateway"
    if case == "every link":
        declaration = changed(dds=True)
    elif case == "control centre":
        name = "scc-control"
    elif case == "outside the VPN":
        host = SHIPPED.hosts[name]
        outside = replace(host, device=host.device.model_copy(update={"vpn_address": None}))
        declaration = replace(SHIPPED, hosts={**SHIPPED.hosts, name: outside})
    else:
        dds = SHIPPED.pilot.dds
        assert dds is not None
        update = {"dds": None if case == "no DDS" else dds.model_copy(update={"over": DdsPath.LAN})}
        declaration = replace(SHIPPED, pilot=SHIPPED.pilot.model_copy(update=update))
    base = part(declaration, name)
    assert UNIT in base.configuration.absent
    assert "no_dds" not in text(base, "/etc/nftables.conf")
    assert [step.name for step in base.configuration.steps if SERVICE in step.run] == [
        "stop checking whether DDS may use the active link"
    ]


def test_metered_links_carry_no_dds_by_default() -> None:
    assert links_without_dds(changed(dds=None), "coastal") == ("4g", "satellite")
    assert links_without_dds(changed(dds=False), "coastal") == ("wifi-ptp", "4g", "satellite")
    assert links_without_dds(SHIPPED, "scc") == ()
