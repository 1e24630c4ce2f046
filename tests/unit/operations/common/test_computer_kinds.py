"""Kinds of computers: one table, and a playbook that has the same groups and the same roles."""

from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import pytest
import yaml

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.callback.computers import GROUPS
from atlantis_netcfg.computers.base import gateway_base
from atlantis_netcfg.inventory import load
from atlantis_netcfg.inventory._hosts import KIND_GROUPS
from atlantis_netcfg.inventory._schema import DEVICES
from atlantis_netcfg.inventory.model import ControlCentre, Gateway, Model, OperatorStation, SshHost, VpnServer
from atlantis_netcfg.operations.computers._access import is_computer
from atlantis_netcfg.operations.computers.desired_state import perform
from atlantis_netcfg.operations.computers.parts import ACCESS, KINDS, PARTS, concerns

ROOT = Path(__file__).parents[4]
SHIPPED = load(ROOT / "inventory")
STATION = OperatorStation.model_validate(
    {
        "kind": "operator_station",
        "address": "10.64.0.30",
        "vpn_address": "10.80.0.30",
        "network": {"by": "netplan", "interface": "eth0"},
    }
)
_GROUP_OF = {kind: group for group, kind in KIND_GROUPS.items()}


def group(model: type[Model]) -> str:
    return _GROUP_OF[get_args(model.model_fields["kind"].annotation)[0]]


def plays() -> list[dict[str, Any]]:
    made: list[dict[str, Any]] = yaml.safe_load((ROOT / "playbooks/site.yml").read_text(encoding="utf-8"))
    return made


def roles_of(name: str) -> set[str]:
    """The roles of the file of tasks that the play `Computers` includes for a group."""
    (play,) = (each for each in plays() if each["name"] == "Computers")
    (task,) = (each for each in play["tasks"] if f"'{name}' in group_names" in each["when"])
    tasks = yaml.safe_load((ROOT / "playbooks" / task["ansible.builtin.include_tasks"]).read_text(encoding="utf-8"))
    return {each["ansible.builtin.import_role"]["name"] for each in tasks if "ansible.builtin.import_role" in each}


def test_every_computer_model_has_a_row() -> None:
    assert set(KINDS) == {model for model in DEVICES.values() if issubclass(model, SshHost)}


@pytest.mark.parametrize("model", KINDS)
def test_the_playbook_has_its_group_and_its_roles(model: type[Model]) -> None:
    name = group(model)
    (computers,) = (play for play in plays() if play["name"] == "Computers")
    assert name in computers["hosts"].split(":")
    assert name in GROUPS
    assert f"!{name}" in plays()[-1]["hosts"].split(":"), "a play says of it that no role handles it yet"
    assert roles_of(name) == set(KINDS[model])


@pytest.mark.parametrize(
    ("host", "model"), [("coastal-gateway", Gateway), ("scc-control", ControlCentre), ("scc-vpn", VpnServer)]
)
def test_parts_apply_to_the_kinds_of_their_rows(host: str, model: type[Model]) -> None:
    assert {part for part in PARTS if concerns(part, SHIPPED.hosts[host])} == {ACCESS, *KINDS[model]}


def test_no_part_applies_to_a_router() -> None:
    router = SHIPPED.hosts["coastal-router"]
    assert not is_computer(router)
    assert not any(concerns(part, router) for part in PARTS)


def told(tmp_path: Path, part: str, host: str = "scc-control") -> Any:  # noqa: ANN401 - JSON
    return perform(ROOT / "inventory", [host], {"state": str(tmp_path), "rehearsed": True}, part, plan_only=False)[
        "per_host"
    ][host]


def test_control_centre_has_a_dds_profile_but_no_ros_by_default(tmp_path: Path) -> None:
    assert told(tmp_path, "gateway_ros2") == {"packages": None, "configure": None}
    assert told(tmp_path, "gateway_interop")["build"] is None
    profile = told(tmp_path, "gateway_dds")["configure"]["files"]
    assert "/etc/atlantis/ros.env" in {file["path"] for file in profile}


def test_control_centre_connects_to_the_local_vpn_server(tmp_path: Path) -> None:
    (conf, _) = told(tmp_path, "openvpn_client")["configure"]["files"]
    assert "remote 10.64.0.10 1194" in conf["content"]


def test_operator_station_gets_only_network_and_vpn_membership() -> None:
    station = replace(SHIPPED.hosts["scc-control"], device=STATION)
    base = gateway_base(SHIPPED, station).as_dict()
    assert base.keys() == {"packages", "network"}
    assert base["packages"] == {"packages": []}
    assert "10.64.0.30/24" in base["network"]["content"]
    assert {part for part in PARTS if concerns(part, station)} == {ACCESS, "gateway_base", "openvpn_client"}
