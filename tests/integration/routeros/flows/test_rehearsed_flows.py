"""What a rehearsal says of the flows through the emulated routers that it has started."""

import os

import pytest
from flows_bench import inventory

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.operations.common.rehearsal import rehearsal
from atlantis_netcfg.operations.flows.rehearsal import limits, routers_of, try_flows

pytestmark = [
    pytest.mark.namespace,
    pytest.mark.slow,
    pytest.mark.smoke,
    pytest.mark.skipif(os.geteuid() != 0, reason="making a network namespace needs root"),
]


def test_a_router_that_was_not_configured_fails() -> None:
    declared = inventory()
    hosts = [declared.hosts["te4sea-router"], declared.hosts["te4sea-sat"]]
    routers = routers_of(hosts)
    assert [host.name for host in routers] == ["te4sea-router"]
    with rehearsal(declared, routers) as emulated:
        result = try_flows(declared, routers, emulated.emulators)["te4sea-router"]
    assert result["exit"] is ExitCode.FAILED
    flows = result["flows"]
    assert flows["links"] == [link.name for link in declared.sites["te4sea"].bearers]
    assert flows["tried"] > 10_000
    assert len(flows["differences"]) == 20
    assert any("but has to be dropped" in line for line in flows["differences"])
    assert "flows do not do what the inventory intends" in result["message"]


def test_rows_that_the_packets_did_not_meet_are_limits() -> None:
    flows = {"not_rehearsed": ["/ip/firewall/filter mine: unknown matcher layer7-protocol"]}
    assert limits({"x-router": {"flows": flows}, "y-router": {"flows": {"not_rehearsed": []}}}) == [
        "packets: x-router without /ip/firewall/filter mine: unknown matcher layer7-protocol"
    ]
