"""Which rows of a router's firewall no flow would miss: a list, with the reason for each."""

import os
from dataclasses import replace

import pytest
from flows_bench import device, inventory, try_site

from atlantis_netcfg.emulator.routeros.dataplane import rows

pytestmark = [
    pytest.mark.namespace,
    pytest.mark.campaign,
    pytest.mark.skipif(os.geteuid() != 0, reason="making a network namespace needs root"),
]
MISSED_BY_NOBODY = {
    "what is kept off, a sample": "a log",
    "what is turned away, a sample": "a log",
    "what is dropped, a sample": "a log",
    "satellite, what comes in": "a second wall: for connections that began on another link",
    "satellite, everything else that comes in": "as above",
    "errors on the way": "an ICMP error of the path: none is sent here",
    "stale, not masqueraded": "for connections that began on another link",
    "invalid": "in `input` a second wall: what it drops, nothing accepts",
    "answers to other sites by the VPN's server": "replies turn round on the bridge: the router sees none here",
    "answers of forwarded services": "a second wall: `answers` accepts them, unless they are stale",
}


@pytest.mark.parametrize("site", ["scc", "coastal", "te4sea"])
def test_a_flow_misses_each_row_of_the_firewall(site: str) -> None:
    declared = inventory()
    topology = device(declared, site).core.topology.with_all_linked()
    whole = rows.firewall_rows(topology)
    links = [link.name for link in declared.sites[site].bearers]
    unnoticed = set()
    for missing in whole:
        rest = tuple(row for row in whole if row is not missing)
        state = replace(rows.network_state(topology), firewall=rows.firewall(topology, rest).text())
        if not any(result.differences for name in links for result in try_site(declared, site, state, name)):
            unnoticed.add(missing.get("comment").removeprefix("atlantis: "))
    assert unnoticed - MISSED_BY_NOBODY.keys() == set()
    assert len(whole) > 30
