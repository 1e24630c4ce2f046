"""The whole way of a robot's data: seen both ways over every link; each element that is cut turns what it concerns.

Real OpenVPN, DDS participants, probes and reflector, and the product's files; what stands for a radio and for a link
is a pair of veth, and what the router says of its tunnel is data (chain_stand.py). Which link is in use is read from
the route of the namespace that stands for the router; how a router changes it is for tests/integration/links/failover.
"""

import itertools
import time
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest
from chain_stand import BEARERS, CENTRE, GATEWAY, MEMBERS, ROBOT, Chain, chain, end, reflect
from matrix_stand import SERVER
from own_asked import check, findings, inside

from atlantis_netcfg.checklist.probes import Answer, LinkStatusResult, Rows
from atlantis_netcfg.checklist.probes.base import ProbeResult
from atlantis_netcfg.inventory import load

if find_spec("cyclonedds") is None:
    pytest.skip("PyPI has no cyclonedds for this machine", allow_module_level=True)
pytestmark = [pytest.mark.slow, pytest.mark.namespace]
EVERY = set(itertools.permutations(MEMBERS, 2))
"""Speaker and listener."""
ITEMS = ("vpn", "data-reaches-scc", "dds")
HURRY = {"1": "0.2", "10": "2"}
"""Pings that nobody may answer: their interval and how long the last one is waited for, in seconds."""
TUNNEL = {"name": "ovpn-scc", "running": "true", "disabled": "false"}
WELL = dict.fromkeys(ITEMS, "PASS")
_TRIES = 4


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chain]:
    with chain(load(Path(__file__).parents[4] / "inventory"), tmp_path_factory.mktemp("chain")) as stand:
        assert stand.meet(EVERY, time.monotonic()) == EVERY
        yield stand


def judged(made: Chain, item: str) -> ProbeResult:
    """Ask the gateway for an item of the site, once more where a busy machine was late with some of its answers.

    Nothing here loses a part of what is sent: an element is whole or cut.
    """
    for _ in range(_TRIES):
        result = _judged(made, item)
        if all(finding.code not in {"server-lossy", "data-lost"} for finding in result.findings):
            return result
    return result


def _judged(made: Chain, item: str) -> ProbeResult:
    told: dict[str, Answer] = {
        "clients": Rows(None, "", (TUNNEL,)),
        "addresses": Rows(None, "", ({"address": "10.80.0.11/16", "interface": "ovpn-scc"},)),
    }
    told = {} if item != "vpn" else told
    if item != "dds":
        looks = {name: {"state": "up", "active": name == made.bearer} for name in BEARERS}
        told |= {f"look {name}": LinkStatusResult(None, "", look) for name, look in looks.items()}
    return inside(made.net.name(GATEWAY), check(made.declaration, item), told, HURRY)


def turned(made: Chain) -> dict[str, str]:
    """Verdict and code of the worst finding of each item; of one that passes its verdict alone."""
    found = {}
    for item in ITEMS:
        result = judged(made, item)
        worst = next(one for one in result.findings if one.verdict is result.verdict)
        found[item] = str(result.verdict) if result.verdict == "PASS" else f"{result.verdict} {worst.code}"
    return found


def without(*names: str) -> set[tuple[str, str]]:
    """The pairs in which none of these is."""
    return {pair for pair in EVERY if not set(pair) & set(names)}


@pytest.mark.parametrize("bearer", [*BEARERS[1:], BEARERS[0]])
def test_every_participant_is_reached_in_both_directions_over_each_link(made: Chain, bearer: str) -> None:
    """Also over those that are not in use by the declared order, once they are chosen; the others carry nothing."""
    made.choose(bearer)
    began, before = time.monotonic(), made.carried()
    assert made.meet(EVERY, began) == EVERY
    result = judged(made, "data-reaches-scc")
    grown = {name: made.carried()[name] - count for name, count in before.items()}
    assert [name for name, count in grown.items() if count > 10] == [bearer]
    (line,) = findings(result)
    assert line.startswith(
        f"PASS data-reaches: scc-control responded to 3 of 3 messages through the VPN over {bearer},"
    )
    delays = [float(one.value.partition(" ms")[0]) for one in result.evidence if one.what.startswith("message ")]
    assert len(delays) == 3
    assert bearer != "satellite" or min(delays) > 600, delays
    assert all("from 10.80.0.21 by tun0, back by tun0" in one.value for one in result.evidence[1:])


def test_each_link_cut_changes_exactly_the_dependent_verdicts(made: Chain) -> None:
    """One test, because each state is made from the one before: what can be mended first."""
    assert turned(made) == WELL
    made.link("satellite", "down")
    assert told(made, EVERY) == WELL
    made.link("satellite", "up")
    made.cable(ROBOT, "down")
    assert told(made, without(ROBOT)) == WELL
    made.cable(ROBOT, "up")
    end(made.reflector[CENTRE])
    assert told(made, EVERY) == {**WELL, "data-reaches-scc": "FAIL nobody-answers-data"}
    reflect(made, CENTRE)
    made.cable(CENTRE, "down")
    assert told(made, without(CENTRE)) == {**WELL, "data-reaches-scc": "FAIL far-end-silent"}
    made.cable(CENTRE, "up")
    made.link("wifi-ptp", "down")
    cut = {"vpn": "FAIL server-silent", "data-reaches-scc": "FAIL far-end-silent", "dds": "PASS"}
    assert told(made, set()) == cut
    made.choose("4g")
    assert told(made, EVERY) == WELL, "another link mends it"


def test_stopped_process_or_tunnel_changes_exactly_the_dependent_verdicts(made: Chain) -> None:
    end(made.participants[GATEWAY].process)
    off = {**WELL, "dds": "INCONCLUSIVE nobody-announces"}
    assert told(made, without(GATEWAY)) == off
    end(made.net.openvpn[SERVER])
    assert told(made, set()) == {**off, "vpn": "FAIL server-silent", "data-reaches-scc": "FAIL far-end-silent"}
    end(made.net.openvpn[GATEWAY])
    assert turned(made) == {
        "vpn": "FAIL gateway-no-tunnel",
        "data-reaches-scc": "FAIL no-vpn",
        "dds": "INCONCLUSIVE no-such-address",
    }


def told(made: Chain, pairs: set[tuple[str, str]]) -> dict[str, str]:
    """What the items say, once exactly these pairs hear each other."""
    began = time.monotonic() + 1.0
    found = turned(made)
    assert made.meet(pairs, began) == pairs
    return found
