"""Ansible reads the inventory as we do: the same hosts in the same groups with the same values."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.inventory._hosts import KIND_GROUPS

SHIPPED = Path(__file__).parents[4] / "inventory"


@pytest.fixture(scope="module")
def ours() -> Inventory:
    return load(SHIPPED)


@pytest.fixture(scope="module")
def ansibles(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    home = tmp_path_factory.mktemp("home")
    environment = {
        **os.environ,
        "HOME": str(home),
        "ANSIBLE_LOCAL_TEMP": str(home),
        "ANSIBLE_CONFIG": str(SHIPPED.parent / "ansible.cfg"),
    }
    command = [sys.executable, "-m", "ansible", "inventory", "-i", str(SHIPPED), "--list"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    told: dict[str, Any] = json.loads(done.stdout)
    return told


def test_site_hosts_match_ansible(ours: Inventory, ansibles: dict[str, Any]) -> None:
    assert {site: ansibles[site]["hosts"] for site in ansibles["sites"]["children"]} == {
        site: [host.name for host in ours.site_hosts(site)] for site in ours.sites
    }


def test_hosts_by_kind_match_ansible(ours: Inventory, ansibles: dict[str, Any]) -> None:
    assert {kind: sorted(ansibles.get(group, {}).get("hosts", ())) for group, kind in KIND_GROUPS.items()} == {
        kind: sorted(host.name for host in ours.hosts.values() if host.device.kind == kind)
        for kind in KIND_GROUPS.values()
    }


def test_ansible_host_values_match_the_files(ours: Inventory, ansibles: dict[str, Any]) -> None:
    for host in ours.hosts.values():
        files = [*sorted((SHIPPED / "group_vars/all").iterdir()), SHIPPED / f"group_vars/{host.site}.yml"]
        files.append(SHIPPED / f"host_vars/{host.name}.yml")
        values: dict[str, Any] = {}
        for file in files:
            values |= yaml.safe_load(file.read_text(encoding="utf-8"))
        told = ansibles["_meta"]["hostvars"][host.name]
        assert {name: value for name, value in told.items() if not name.startswith("ansible_")} == values
