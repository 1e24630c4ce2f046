"""A station of the site is judged by the registration table of its access point, an emulated RouterOS device.

The bridge of the shipped pilot stands for both: its access point is the one that is asked, its other end the vehicle.
"""

import asyncio
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

import pytest

from atlantis_netcfg.checklist.probes import Cell, CommandResult, Place, ProbeResult, RouterOsQuery
from atlantis_netcfg.checklist.probes.wifi import steps
from atlantis_netcfg.checklist.runner import RealTransport
from atlantis_netcfg.emulator.routeros import EmulatorSpec, RouterLink, RunningSite
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.inventory.model import Cpe, PtpProtocol, RadioMenus, WifiEndpoint
from atlantis_netcfg.operations.common.rehearsal import site_spec
from atlantis_netcfg.operations.common.request import Request, Target
from atlantis_netcfg.routeros.render import cpe

SHIPPED = load(Path(__file__).parents[4] / "inventory")
POINT, STATION, VEHICLE = "scc-cpe", "coastal-cpe", "zarco"
PINGED = CommandResult(
    None,
    out="PING 10.64.1.23 (10.64.1.23) 56(84) bytes of data.\n"
    + "".join(f"64 bytes from 10.64.1.23: icmp_seq={number} ttl=64 time=2.00 ms\n" for number in range(1, 21))
    + "20 packets transmitted, 20 received, 0% packet loss, time 3823ms\nrtt min/avg/max/mdev = 1/2/3/0 ms\n",
)
ANSWERS = "PASS answers: Zarco (10.64.1.23) replied to 20 of 20 pings, in 2 ms"
STRANGER = "02:00:5E:00:01:23"
NOBODY_LISTENS = 1
"""A port."""


@dataclass(frozen=True)
class Bridge:
    """Both ends, and who asks."""

    twins: RunningSite
    declaration: Inventory
    menu: str
    folder: Path

    @property
    def mac(self) -> str:
        """Of the other end's radio."""
        told = self.twins.do(STATION, "console", words=[f"{self.menu}/print", "=.proplist=mac-address"])
        return str(told[0][1]).rpartition("=")[2]

    def air(self, **changes: float) -> None:
        self.twins.do(POINT, "air", **{"distance_m": 150.0, "loss_db": 0.0, **changes})

    def judged(self, mac: str, port: int | None = None) -> ProbeResult:
        """Ask the access point of the vehicle with this radio; what the gateway's ping would print is data."""
        endpoint = WifiEndpoint.model_validate({"role": "station", "seen_by": POINT, "mac": mac})
        vehicle = self.declaration.vehicles[VEHICLE]
        vehicle = vehicle.model_copy(update={"endpoints": vehicle.endpoints.model_copy(update={"wifi": endpoint})})
        declaration = replace(self.declaration, vehicles={**self.declaration.vehicles, VEHICLE: vehicle})
        (step,) = steps(Cell(declaration, "coastal", VEHICLE, "wifi"))
        assert step.probe is not None
        asked = [(one.name, one) for one in step.probe.asks() if isinstance(one, RouterOsQuery)]
        ready = self.twins.ready[POINT]
        target = Target(host=ready["host"], port=port or ready["api_ssl"], pin=ready["pin"])
        request = Request(state=self.folder / "state", rehearsed=True, targets={POINT: target})
        ears = RealTransport(declaration, "coastal", request)
        heard = asyncio.run(ears.ask(Place.ROUTER, POINT, asked, lambda *_: None))
        return step.probe.judge({**heard, "ping": PINGED})


@pytest.fixture(params=["wireless", "wifi"])
def bridge(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Bridge]:
    """Both ends as declared, with the older and with the newer menus for radios."""
    family = str(request.param)
    declaration = SHIPPED if family == "wireless" else _newer(SHIPPED)
    hosts = [declaration.hosts[name] for name in (POINT, STATION)]
    spec = site_spec(declaration, hosts)
    twins = tuple(_configured(declaration, twin, family) for twin in spec.emulators)
    folder = tmp_path / "twins"
    folder.mkdir()
    with RunningSite(spec.model_copy(update={"emulators": twins}), folder) as running:
        yield Bridge(running, declaration, f"/interface/{family}", tmp_path)


def _newer(declaration: Inventory) -> Inventory:
    changed = {}
    for name in (POINT, STATION):
        host = declaration.hosts[name]
        device = cast("Cpe", host.device)
        words = {"protocol": PtpProtocol.IEEE_80211, "menus": RadioMenus.WIFI}
        ptp = device.ptp.model_copy(update=words)
        changed[name] = replace(host, device=device.model_copy(update={"ptp": ptp}))
    return replace(declaration, hosts={**declaration.hosts, **changed})


def _configured(declaration: Inventory, twin: EmulatorSpec, family: str) -> EmulatorSpec:
    """As a run leaves it."""
    seed = cpe(declaration, declaration.hosts[twin.router.name], family)
    return twin.model_copy(update={"link": RouterLink(), "router": twin.router.model_copy(update={"seed": seed})})


def said(judged: ProbeResult) -> list[str]:
    return [f"{one.verdict} {one.code}: {one.message}" for one in judged.findings]


def test_station_is_judged_by_the_registration_table_of_its_access_point(bridge: Bridge) -> None:
    """All that the air may do to it, in one test: a bridge of twins is made once for each family of menus."""
    judged = bridge.judged(bridge.mac)
    assert said(judged) == ["PASS registered: Zarco is registered at scc-cpe, signal -49 dBm", ANSWERS]
    told = {one.what: one.value for one in judged.evidence}
    assert told["station registered at scc-cpe"] == bridge.mac
    assert told["signal at scc-cpe"] == "-49 dBm"
    assert told["expected signal"] == "-75 to -35 dBm"
    bridge.air(distance_m=5.0)
    assert said(bridge.judged(bridge.mac)) == [
        "PASS registered: Zarco is registered at scc-cpe, signal -19 dBm",
        "FAIL signal-strong: scc-cpe receives Zarco at -19 dBm, above -35 dBm: its receiver is overloaded",
        ANSWERS,
    ]
    bridge.air(loss_db=30.0)
    assert said(bridge.judged(bridge.mac)) == [
        "PASS registered: Zarco is registered at scc-cpe, signal -79 dBm",
        "WARN signal-weak: scc-cpe receives Zarco at -79 dBm, below -75 dBm",
        ANSWERS,
    ]
    bridge.air(loss_db=60.0)
    assert said(bridge.judged(bridge.mac)) == [
        f"FAIL not-registered: Zarco ({bridge.mac}) is not registered at scc-cpe; registered there: none",
        ANSWERS,
    ]


def test_other_station_or_unreachable_access_point_proves_nothing(bridge: Bridge) -> None:
    assert said(bridge.judged(STRANGER)) == [
        f"FAIL not-registered: Zarco ({STRANGER}) is not registered at scc-cpe; registered there: 1 other",
        ANSWERS,
    ]
    away, ping = said(bridge.judged(bridge.mac, NOBODY_LISTENS))
    refused = "127.0.0.1:1 cannot be reached: Connection refused"
    assert away.startswith(f"INCONCLUSIVE not-asked: scc-cpe could not be queried: {refused}")
    assert ping == ANSWERS
