"""The part `gateway_dds` of the shipped pilot, and of pilots that differ from it in one thing."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from atlantis_netcfg.computers.dds import LOGIN, GatewayDds, gateway_dds
from atlantis_netcfg.computers.services import ENVIRONMENT
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.inventory.model import Dds, RosDistribution
from atlantis_netcfg.operations.common.request import Request
from atlantis_netcfg.operations.computers.parts import PARTS

ROOT = Path(__file__).parents[4]
HOST = "coastal-gateway"


def pilot(dds: Dds | None) -> Inventory:
    declaration = load(ROOT / "inventory")
    return replace(declaration, pilot=declaration.pilot.model_copy(update={"dds": dds}))


def part(dds: Dds | None) -> GatewayDds:
    declaration = pilot(dds)
    return gateway_dds(declaration, declaration.hosts[HOST])


def test_the_environment_is_that_of_the_slowest_link() -> None:
    made = part(Dds(distribution=RosDistribution.FOXY))
    assert made.in_use == "satellite"
    assert made.files[ENVIRONMENT] == made.files["/etc/atlantis/dds/satellite/ros.env"]
    assert "/etc/atlantis/dds/satellite/fastdds.xml" in made.files[ENVIRONMENT]


@pytest.mark.parametrize(
    ("order", "in_use"), [(("4g", "wifi-ptp"), "4g"), (("wifi-ptp", "4g"), "4g"), (("wifi-ptp", "cable"), "cable")]
)
def test_of_two_equal_links_the_less_preferred_is_used(order: tuple[str, ...], in_use: str) -> None:
    declaration = pilot(Dds(distribution=RosDistribution.FOXY))
    site = declaration.sites["coastal"]
    known = {one.name: one for one in site.bearers}
    known["cable"] = known["wifi-ptp"].model_copy(update={"name": "cable"})
    changed = site.model_copy(update={"bearers": tuple(known[name] for name in order)})
    declaration = replace(declaration, sites={**declaration.sites, "coastal": changed})
    assert gateway_dds(declaration, declaration.hosts[HOST]).in_use == in_use


def test_readers_of_a_profile_restart_only_for_their_files() -> None:
    configure = part(Dds(distribution=RosDistribution.FOXY)).as_dict()["configure"]
    read = [
        *(f"/etc/atlantis/dds/satellite/{name}" for name in ("cyclonedds.xml", "fastdds.xml", "ros.env")),
        ENVIRONMENT,
    ]
    names = (
        "atlantis-data-gateway",
        "atlantis-recording",
        "atlantis-service-ros1-bridge",
        "atlantis-ros1-bridge",
    )
    assert configure["units"] == [{"name": f"{name}.service", "wait": False, "after": read} for name in names]
    assert configure["only"] == ["/etc/atlantis/dds"]


def test_everything_is_removed_without_dds() -> None:
    told = part(None).as_dict()
    assert told["configure"]["files"] == []
    assert told["configure"]["absent"] == [ENVIRONMENT, LOGIN]
    assert told["configure"]["only"] == ["/etc/atlantis/dds"]
    assert told["elsewhere"]["variables"] == {}


@pytest.mark.parametrize(
    ("distribution", "alone"),
    [
        (RosDistribution.FOXY, {"ROS_LOCALHOST_ONLY": "0"}),
        (RosDistribution.JAZZY, {"ROS_LOCALHOST_ONLY": "0", "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT"}),
    ],
)
def test_exclusive_environment_variables(distribution: RosDistribution, alone: dict[str, str]) -> None:
    assert part(Dds(distribution=distribution)).alone == alone


def test_registry_returns_plain_data() -> None:
    declaration = pilot(Dds(distribution=RosDistribution.FOXY))
    told = PARTS["gateway_dds"](declaration, declaration.hosts[HOST], Request(state=Path("/nowhere")))
    assert json.loads(json.dumps(told)) == told
