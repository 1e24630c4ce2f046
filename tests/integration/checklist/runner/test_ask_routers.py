"""The questions to RouterOS devices, against emulated ones: one session each, and none takes another down."""

import asyncio
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest

from atlantis_netcfg.checklist.probes import Answer, Place, RouterOsQuery, Rows, Trouble
from atlantis_netcfg.checklist.runner import RealTransport
from atlantis_netcfg.core.events import Event
from atlantis_netcfg.emulator.routeros import RouterLink, RunningSite
from atlantis_netcfg.inventory import load
from atlantis_netcfg.links.status import Query
from atlantis_netcfg.operations.common.rehearsal import site_spec
from atlantis_netcfg.operations.common.request import Request, Target

SHIPPED = load(Path(__file__).parents[4] / "inventory")
ROUTER, CPE = "coastal-router", "coastal-cpe"


@pytest.fixture
def ears(tmp_path: Path) -> Iterator[tuple[RealTransport, list[Event]]]:
    """The router as `provision device adopt` leaves it; nobody stands in the CPE's place."""
    spec = site_spec(SHIPPED, [SHIPPED.hosts[ROUTER]])
    near = tuple(twin.model_copy(update={"link": RouterLink()}) for twin in spec.emulators)
    events: list[Event] = []
    (tmp_path / "twins").mkdir()
    with RunningSite(spec.model_copy(update={"emulators": near}), tmp_path / "twins") as site:
        ready = site.ready[ROUTER]
        targets = {ROUTER: Target(host=ready["host"], port=ready["api_ssl"], pin=ready["pin"])}
        targets[CPE] = Target(host="127.0.0.1", port=1, pin=ready["pin"])
        request = Request(state=tmp_path / "state", rehearsed=True, targets=targets)
        yield RealTransport(SHIPPED, "coastal", request, events.append), events


def asked(ears: RealTransport, *questions: RouterOsQuery) -> Mapping[str, Answer]:
    async def run() -> dict[str, Answer]:
        hosts = list(dict.fromkeys(one.host for one in questions))
        work = [
            ears.ask(Place.ROUTER, host, [(one.name, one) for one in questions if one.host == host], lambda *_: None)
            for host in hosts
        ]
        return {name: answer for found in await asyncio.gather(*work) for name, answer in found.items()}

    return asyncio.run(run())


def test_router_queries_share_one_session_of_five_round_trips(ears: tuple[RealTransport, list[Event]]) -> None:
    questions = [RouterOsQuery(f"q{number}", ROUTER, Query("/system/identity", "print")) for number in range(20)]
    questions += [
        RouterOsQuery("ports", ROUTER, Query("/interface", "print", proplist=("name", "type"))),
        RouterOsQuery("none", ROUTER, Query("/no/such/menu", "print")),
    ]
    found = asked(ears[0], *questions)
    ports, none, first = found["ports"], found["none"], found["q0"]
    assert isinstance(ports, Rows)
    assert ports.trouble is None
    assert {"name": "ether1", "type": "ether"} in (ports.rows or ())
    assert isinstance(none, Rows)
    assert (none.trouble, none.rows, none.words) == (None, None, "no such command prefix")
    assert isinstance(first, Rows)
    assert 0 < first.request_time <= first.response_time
    (spent,) = [event.message for event in ears[1] if event.stage.value == "done"]
    assert spent.startswith("read in 5 round trips, ")


def test_unreachable_or_unknown_device_is_reported(ears: tuple[RealTransport, list[Event]]) -> None:
    identity = Query("/system/identity", "print")
    found = dict(
        asked(
            ears[0],
            *(RouterOsQuery(name, name, identity) for name in (ROUTER, CPE, "coastal-4g", "coastal-gateway", "x")),
        )
    )
    assert found.pop(ROUTER).trouble is None
    assert {one.trouble for one in found.values()} == {Trouble.NO_PLACE}
    assert found[CPE].words.startswith("127.0.0.1:1 cannot be reached: Connection refused")
    assert found["coastal-4g"].words == "coastal-4g is not emulated in this rehearsal"
    assert found["coastal-gateway"].words == "coastal-gateway is a gateway, which is not supported yet"
    assert found["x"].words == "the inventory has no host `x`"
