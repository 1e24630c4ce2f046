from __future__ import annotations

from pathlib import Path

import yaml

from atlantis_netcfg.operations.handled import handled
from atlantis_netcfg.site import load

ROOT = Path(__file__).parents[3]


def test_the_playbook_has_a_role_for_exactly_what_is_called_handled() -> None:
    plays = yaml.safe_load((ROOT / "playbooks/site.yml").read_text(encoding="utf-8"))
    groups = {play["hosts"] for play in plays for task in play["tasks"] if "ansible.builtin.import_role" in task}
    inventory = yaml.safe_load((ROOT / "inventory/hosts.yml").read_text(encoding="utf-8"))["all"]["children"]
    hosts = {name for group in groups for name in inventory[group]["hosts"]}
    assert hosts
    assert {host.name for host in load(ROOT / "inventory").hosts.values() if handled(host)} == hosts
