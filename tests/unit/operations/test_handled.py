from __future__ import annotations

from pathlib import Path

import yaml

from atlantis_netcfg.declaration import load
from atlantis_netcfg.operations.kinds import handled

ROOT = Path(__file__).parents[3]


def test_every_host_that_is_called_handled_is_in_a_play_with_the_role() -> None:
    plays = yaml.safe_load((ROOT / "playbooks/site.yml").read_text(encoding="utf-8"))
    patterns = [play["hosts"] for play in plays for task in play["tasks"] if "ansible.builtin.import_role" in task]
    groups = {group for pattern in patterns for group in pattern.split(":")}
    inventory = yaml.safe_load((ROOT / "inventory/hosts.yml").read_text(encoding="utf-8"))["all"]["children"]
    hosts = {name for group in groups & inventory.keys() for name in inventory[group]["hosts"]}
    found = {host.name for host in load(ROOT / "inventory").hosts.values() if handled(host)}
    assert found
    assert found <= hosts
