"""Which items the radio columns make of a declaration."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest

from atlantis_netcfg.checklist.probes import Cell, Step
from atlantis_netcfg.checklist.probes.registry import steps_of
from atlantis_netcfg.checklist.report import ItemKind
from atlantis_netcfg.inventory import Inventory
from atlantis_netcfg.inventory.model import Endpoints, Link


def told(steps: tuple[Step, ...]) -> list[tuple[str, str, tuple[str, ...]]]:
    return [(step.name, step.kind.value, step.concerns) for step in steps]


def with_location(
    declaration: Inventory, endpoints: Mapping[str, Any] | None = None, bearers: tuple[Link, ...] | None = None
) -> Inventory:
    """The declaration with another location row, or with other links, of the coastal site."""
    site = declaration.sites["coastal"]
    location = site.location.model_copy(update={"endpoints": Endpoints.model_validate(endpoints or {})})
    links = site.bearers if bearers is None else bearers
    changed = site.model_copy(update={"location": location, "bearers": links})
    return replace(declaration, sites={**declaration.sites, "coastal": changed})


def test_vehicle_is_checked_where_its_endpoint_is_declared(declaration: Inventory) -> None:
    sparus = steps_of(Cell(declaration, "coastal", "sparus", "wifi"))
    assert told(sparus) == [("", "automatic", ("coastal-gateway",))]
    assert sparus[0].title == "Access point of Sparus has a good signal, and responds without loss"
    (zarco,) = steps_of(Cell(declaration, "coastal", "zarco", "wifi"))
    assert zarco.title == "Zarco is registered at coastal-router, has a good signal, and responds without loss"
    (elsewhere,) = steps_of(Cell(declaration, "scc", "zarco", "wifi"))
    assert elsewhere.title == "Zarco responds over the Wi-Fi of the site without loss"
    assert told(steps_of(Cell(declaration, "coastal", "eca-rov", "ethernet"))) == [
        ("", "automatic", ("coastal-router",))
    ]
    assert steps_of(Cell(declaration, "coastal", "eca-rov", "wifi")) == ()


def test_location_has_a_step_for_each_link(declaration: Inventory) -> None:
    def of(endpoint: str) -> list[tuple[str, str, tuple[str, ...]]]:
        return told(steps_of(Cell(declaration, "coastal", None, endpoint)))

    assert of("wifi") == [("", "automatic", ("coastal-cpe", "scc-cpe"))]
    assert of("4g") == [("", "automatic", ("coastal-4g",))]
    assert of("satellite") == [
        ("", "automatic", ("coastal-sat",)),
        ("allow-list", "active", ("coastal-sat",)),
        ("firewall", "person", ("coastal-sat",)),
        ("terminal", "person", ("coastal-sat",)),
    ]


def test_second_link_of_a_kind_is_named(declaration: Inventory) -> None:
    bearers = declaration.sites["coastal"].bearers
    twice = tuple(two for one in bearers for two in (one, one.model_copy(update={"name": f"{one.name}-b"})))
    changed = with_location(declaration, bearers=twice)

    def of(endpoint: str) -> list[str]:
        return [step.name for step in steps_of(Cell(changed, "coastal", None, endpoint))]

    assert of("wifi") == ["", "wifi-ptp-b"]
    assert of("4g") == ["", "4g-b"]
    assert of("satellite")[3:] == [
        "terminal",
        "satellite-b",
        "satellite-b-allow-list",
        "satellite-b-firewall",
        "satellite-b-terminal",
    ]


def test_location_also_has_its_own_endpoints(declaration: Inventory) -> None:
    ends = {"wifi": {"role": "station", "seen_by": "coastal-cpe"}, "ethernet": {"router_port": "ether4"}}
    changed = with_location(declaration, ends)
    wifi = steps_of(Cell(changed, "coastal", None, "wifi"))
    assert [step.name for step in wifi] == ["", "own"]
    assert wifi[1].title == "Coastal testbed is registered at coastal-cpe, has a good signal, and responds without loss"
    (cable,) = steps_of(Cell(changed, "coastal", None, "ethernet"))
    assert cable.probe is not None
    assert [question.name for question in cable.probe.asks()] == ["monitor", "interfaces"]


@pytest.mark.parametrize("endpoint", ["wifi", "satellite", "4g", "ethernet"])
def test_missing_link_is_for_a_person(declaration: Inventory, endpoint: str) -> None:
    changed = with_location(declaration, bearers=())
    (step,) = steps_of(Cell(changed, "coastal", None, endpoint))
    assert step.kind is ItemKind.PERSON
    assert step.do
    assert step.look_for


@pytest.mark.parametrize("endpoint", ["satellite", "4g"])
def test_a_vehicle_with_a_long_haul_link_is_for_a_person(declaration: Inventory, endpoint: str) -> None:
    (step,) = steps_of(Cell(declaration, "coastal", "stork", endpoint))
    assert step.kind is ItemKind.PERSON
    assert "Stork" in step.title


def test_consent_to_the_allow_list_test_shows_its_cost(declaration: Inventory) -> None:
    proof = steps_of(Cell(declaration, "coastal", None, "satellite"))[1]
    assert proof.consent is not None
    assert proof.consent.cost
    assert "90 s" in proof.consent.prompt


def test_permitted_destinations_of_the_terminal_are_listed(declaration: Inventory) -> None:
    firewall = steps_of(Cell(declaration, "coastal", None, "satellite"))[2]
    vpn = declaration.pilot.vpn
    assert f"VPN server ({vpn.endpoint} udp {vpn.port})" in firewall.look_for
    assert "screenshot" in firewall.do
