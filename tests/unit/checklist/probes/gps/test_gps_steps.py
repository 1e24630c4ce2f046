"""Which items the column makes of a declaration."""

from dataclasses import replace
from typing import Any

import pytest

from atlantis_netcfg.checklist.probes import Cell, Listen, Place, Step
from atlantis_netcfg.checklist.probes.gps import RouterosGps, StreamGps, steps
from atlantis_netcfg.checklist.probes.registry import find_refusal
from atlantis_netcfg.checklist.report import ItemKind, Phase
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.inventory import Inventory
from atlantis_netcfg.inventory.model import Endpoints


def of(declaration: Inventory, vehicle: str, gps: dict[str, Any] | None = None, *, declared: bool = True) -> Step:
    if gps is not None or not declared:
        endpoints = Endpoints.model_validate({"gps": gps} if gps else {})
        one = declaration.vehicles[vehicle].model_copy(update={"endpoints": endpoints})
        declaration = replace(declaration, vehicles={**declaration.vehicles, vehicle: one})
    (step,) = steps(Cell(declaration, "coastal", vehicle, "gps"))
    return step


def stream(step: Step) -> StreamGps:
    assert isinstance(step.probe, StreamGps)
    return step.probe


@pytest.mark.parametrize(
    ("vehicle", "address", "port", "three"),
    [
        ("sparus", "10.64.1.22", 2947, False),
        ("girona500", "10.64.1.21", 10110, False),
        ("stork", "10.64.1.24", 2947, True),
    ],
)
def test_declared_stream_is_listened_to(
    declaration: Inventory,
    vehicle: str,
    address: str,
    port: int,
    three: bool,  # noqa: FBT001
) -> None:
    step = of(declaration, vehicle)
    probe = stream(step)
    assert (step.name, step.kind, step.phase, step.concerns) == (
        "",
        ItemKind.AUTOMATIC,
        Phase.QUAY,
        ("coastal-gateway",),
    )
    assert (probe.place, probe.address, probe.port) == (Place.GATEWAY, address, port)
    assert (probe.expectation.three, probe.expectation.place) == (three, "coastal-gateway")
    assert probe.expectation.fence == declaration.sites["coastal"].checklist.geofence


@pytest.mark.parametrize("vehicle", ["sparus", "girona500"])
def test_requests_are_allowed(declaration: Inventory, vehicle: str) -> None:
    (question,) = stream(of(declaration, vehicle)).asks()
    assert isinstance(question, Listen)
    assert find_refusal(question, active=False) is None
    assert bool(question.say) is (vehicle == "sparus")


def test_serial_port_belongs_to_the_listening_computer(declaration: Inventory) -> None:
    gps = {"driver": "nmea_serial", "device": "/dev/ttyUSB0", "baud": 4800, "seen_from": "laptop", "reports": 3}
    step = of(declaration, "sparus", gps)
    (question,) = stream(step).asks()
    assert isinstance(question, Listen)
    assert (question.transport, question.device, question.baud, question.address) == (
        "serial",
        "/dev/ttyUSB0",
        4800,
        "",
    )
    assert (question.place, question.listen_s, question.say) == (Place.LAPTOP, 11.0, ())
    assert step.concerns == ()


@pytest.mark.parametrize(("gps", "host"), [({}, "coastal-router"), ({"seen_by": "coastal-cpe"}, "coastal-cpe")])
def test_declared_router_is_queried(declaration: Inventory, gps: dict[str, Any], host: str) -> None:
    step = of(declaration, "sparus", {"driver": "routeros", **gps})
    assert isinstance(step.probe, RouterosGps)
    assert (step.probe.host, step.concerns) == (host, (host,))


def test_undeclared_receiver_is_for_a_person(declaration: Inventory) -> None:
    step = of(declaration, "stork", declared=False)
    assert (step.name, step.kind, step.phase) == ("", ItemKind.PERSON, Phase.QUAY)
    assert "3D fix" in step.look_for
    assert "2D or 3D fix" in of(declaration, "sparus", declared=False).look_for


def test_undeclared_address_is_reported(declaration: Inventory) -> None:
    site = declaration.sites["coastal"]
    lan = site.lan.model_copy(update={"reservations": ()})
    changed = replace(declaration, sites={**declaration.sites, "coastal": site.model_copy(update={"lan": lan})})
    probe = of(changed, "sparus").probe
    assert probe is not None
    assert probe.asks() == ()
    (finding,) = probe.judge({}).findings
    assert (finding.verdict, finding.code) == (Verdict.INCONCLUSIVE, "no-address")
    assert finding.message == "the inventory has no address for the receiver of Sparus"
