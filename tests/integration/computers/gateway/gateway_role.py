"""One role of the gateways, run by Ansible on a machine, and its result as reports have it."""

import json
import os
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import preforked
import yaml
from gateway_stand import Key

from atlantis_netcfg.emulator.lab import Machine

ROOT = Path(__file__).resolve().parents[4]
NAME = "coastal-gateway"


@dataclass
class Stand:
    """A gateway that runs, the technician's key, and a pilot whose declaration may be changed."""

    gateway: Machine
    key: Key
    folder: Path
    roles: Sequence[str]
    variables: dict[str, Any] = field(default_factory=dict)
    """Extra variables of Ansible."""
    name: str = NAME
    """Of the computer in the inventory."""

    def __post_init__(self) -> None:
        shutil.copytree(ROOT / "inventory", self.inventory)
        self.known.write_text(f"{self.name} {self.gateway.host_key}\n")

    @property
    def inventory(self) -> Path:
        return self.folder / "inventory"

    @property
    def known(self) -> Path:
        """The file with the gateway's host key."""
        return self.folder / "known"

    def declare(self, change: Mapping[str, Any], file: str = "group_vars/all/pilot.yml", key: str = "pilot") -> None:
        """Change keys below `pilot:` (or another one of another file); None takes one out."""
        path = self.inventory / file
        told = yaml.safe_load(path.read_text())
        told[key] |= change
        told[key] = {name: value for name, value in told[key].items() if value is not None}
        path.write_text(yaml.safe_dump(told))

    def publish_nothing(self) -> None:
        """Take the vehicles' telemetry out, which needs DDS."""
        path = self.inventory / "group_vars/all/vehicles.yml"
        told = yaml.safe_load(path.read_text())
        for vehicle in told["vehicles"].values():
            vehicle.pop("telemetry", None)
        path.write_text(yaml.safe_dump(told))

    def run(self, *words: str) -> dict[str, Any]:
        """Run the roles; `words` are for ansible-playbook."""
        read, write = os.pipe()
        with os.fdopen(read) as lines:
            with os.fdopen(write, "w"):
                process = preforked.play(self._command(write, words), self.folder, pass_fds=[write])
            told = [json.loads(line) for line in lines]
            process.wait()
        results = [line["devices"][self.name] for line in told if line.get("devices")]
        assert len(results) == 1, f"{(self.folder / 'said').read_text()}\n{told}"
        result: dict[str, Any] = results[0]
        return result

    def _command(self, events: int, words: Sequence[str]) -> list[str]:
        # `role/file` stands for other tasks of the role than its main ones.
        tasks = [
            {
                "name": f"Role {role}",
                "ansible.builtin.import_role": {
                    "name": role.partition("/")[0],
                    "tasks_from": role.partition("/")[2] or "main",
                    "rolespec_validate": False,
                },
            }
            for role in self.roles
        ]
        play = [{"hosts": "gateways:control_centres", "gather_facts": False, "tasks": tasks}]
        variables = {
            "ansible_host": "127.0.0.1",
            "ansible_port": self.gateway.port,
            "ansible_user": "root",
            "ansible_ssh_private_key_file": str(self.key.file),
            "ansible_ssh_common_args": f"-o HostKeyAlias={self.name} -o UserKnownHostsFile={self.known}",
            "atlantis_request": {"state": str(self.folder / "state"), "rehearsed": True, "events_fd": events},
            **self.variables,
        }
        (self.folder / "play.yml").write_text(json.dumps(play))
        (self.folder / "variables.json").write_text(json.dumps(variables))
        return ["-i", "inventory", "play.yml", "-e", "@variables.json", "--limit", self.name, *words]
