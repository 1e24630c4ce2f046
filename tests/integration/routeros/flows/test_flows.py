"""Packets through the rows of each site's router: what the inventory intends passes, and nothing else."""

import os
import re
from collections.abc import Callable

import pytest
from flows_bench import SITES, inventory, rows, try_site

from atlantis_netcfg.inventory import Inventory
from atlantis_netcfg.operations.flows.rehearsal import describe

pytestmark = [
    pytest.mark.namespace,
    pytest.mark.skipif(os.geteuid() != 0, reason="making a network namespace needs root"),
]


@pytest.fixture(scope="module")
def declared() -> Inventory:
    return inventory()


@pytest.mark.slow
@pytest.mark.smoke("coastal")
@pytest.mark.parametrize("site", SITES)
def test_every_flow_of_a_site_does_what_the_inventory_intends(declared: Inventory, site: str) -> None:
    state = rows(declared, site)
    assert state.limits == ()
    results = try_site(declared, site, state)
    assert [result.link for result in results] == [link.name for link in declared.sites[site].bearers]
    for result in results:
        assert [str(item) for item in result.differences] == []
        assert result.flows > 2000
        assert result.arrivals > 1000
        assert result.replies > 1000


def without(pattern: str) -> Callable[[str], str]:
    """Drop the rows that match."""

    def edit(text: str) -> str:
        lines = re.sub(r"\\\n\s*", "", text).splitlines(keepends=True)
        kept = [line for line in lines if not re.search(pattern, line)]
        assert len(kept) < len(lines), f"no row matches {pattern}"
        return "".join(kept)

    return edit


def changed(pattern: str, new: str) -> Callable[[str], str]:
    def edit(text: str) -> str:
        result, count = re.subn(pattern, new, re.sub(r"\\\n\s*", "", text))
        assert count, f"nothing matches {pattern}"
        return result

    return edit


def swapped(first: str, second: str) -> Callable[[str], str]:
    """Exchange the first rows that match."""

    def edit(text: str) -> str:
        lines = re.sub(r"\\\n\s*", "", text).splitlines(keepends=True)
        one, other = (next(at for at, line in enumerate(lines) if re.search(words, line)) for words in (first, second))
        lines[one], lines[other] = lines[other], lines[one]
        return "".join(lines)

    return edit


MISTAKES = {
    "a filter row is dropped": (without('"atlantis: everything else"'), "4g", "has to be dropped"),
    "the satellite's allow-list is dropped": (without(r"allow-list.*jump-target=to-satellite"), "satellite", "dropped"),
    "one target of the allow-list is missing": (without(r"chain=to-satellite.*VPN server"), "satellite", "arrive"),
    "control has no mark": (without('"atlantis: satellite, the tunnel first"'), "satellite", "marked"),
    "the tunnel is translated, too": (
        changed(
            "action=masquerade chain=srcnat(.*)out-interface-list=WAN",
            r"action=masquerade chain=srcnat\1out-interface-list=!LAN",
        ),
        "4g",
        "from",
    ),
    "a link is not translated": (
        changed("(action=masquerade chain=srcnat.*)out-interface-list=WAN", r"\1out-interface=ether1"),
        "4g",
        "from",
    ),
    "the segment size is that of Ethernet": (
        without("new-mss=1300.*out-interface=ether3|out-interface=ether3.*new-mss=1300"),
        "satellite",
        "MSS",
    ),
    "two rows are exchanged": (
        swapped('chain=forward.*"atlantis: LAN by the best link"', 'chain=forward.*"atlantis: everything else"'),
        "4g",
        "dropped",
    ),
    "management is open to the LAN": (
        changed("in-interface-list=MGMT protocol=tcp src-address=10.64.101.0/24", "protocol=tcp"),
        "4g",
        "router",
    ),
    "replies of the LAN are dropped": (without('chain=forward.*"atlantis: answers"'), "4g", "reply"),
    "the route back into the VPN is missing": (without("dst-address=10.80.0.0/16 gateway=ovpn-scc"), "4g", "dropped"),
    "a routing rule looks into the wrong table": (
        changed("(src-address=10.10.2.2/32 table=)via-satellite", r"\1via-4g"),
        "4g",
        "instead",
    ),
}
"""What is done to the text of coastal, over which link it shows, and a word of what is said."""


@pytest.mark.slow
@pytest.mark.smoke("the satellite's allow-list is dropped", "the tunnel is translated, too", "two rows are exchanged")
@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_in_the_rows_is_found(declared: Inventory, mistake: str) -> None:
    edit, link, word = MISTAKES[mistake]
    (result,) = try_site(declared, "coastal", rows(declared, "coastal", edit), link)
    said = [describe(item) for item in result.differences]
    assert said, "no flow has noticed"
    assert any(word in line for line in said), said[:5]
