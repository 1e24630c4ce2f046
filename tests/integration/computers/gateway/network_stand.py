"""A gateway whose network is changed: a machine with all three tools, and the tasks of the role run by Ansible."""

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import preforked
import pytest
from debian_trees import NETWORK
from gateway_stand import ROUTER, Key

from atlantis_netcfg.computers.parts import computer_network
from atlantis_netcfg.emulator.lab import Lab, Machine, build_rootfs, open_lab, why_not
from atlantis_netcfg.inventory import load
from atlantis_netcfg.inventory.model import ComputerNetwork, Gateway, NetworkTool

ROOT = Path(__file__).resolve().parents[4]
NAME = "coastal-gateway"
NO_UDEV = "#!/bin/sh\nexit 0\n"
"""Of a container: it has no udev, and /sys cannot be written, so that the `udevadm trigger` of netplan fails there."""
STATE = "/var/lib/atlantis/network"


def wanted(by: str, **changes: Any) -> dict[str, Any]:  # noqa: ANN401 - JSON
    """What the role is told of the shipped gateway with this tool; `changes` are made in the finished data."""
    declaration = load(ROOT / "inventory")
    host = declaration.hosts[NAME]
    assert isinstance(host.device, Gateway)
    network = ComputerNetwork(by=NetworkTool(by), interface="eth0", rollback_s=changes.pop("rollback_s", 60))
    part = computer_network(declaration, replace(host, device=host.device.model_copy(update={"network": network})))
    assert part is not None
    return {**part.as_dict(), **changes}


def other(told: dict[str, Any], old: str, new: str) -> dict[str, Any]:
    """The same with one word for another, as a wrong declaration would have it."""
    word = rf"(?<![\w.]){re.escape(old)}(?![\w.])"
    return {key: re.sub(word, new, value) if isinstance(value, str) else value for key, value in told.items()}


@dataclass
class NetworkStand:
    """The machine and the technician's way to it."""

    gateway: Machine
    key: Key
    folder: Path
    lab: Lab

    def run(self, told: dict[str, Any], *words: str) -> tuple[int, str]:
        """Run the tasks of the role; gives Ansible's exit code and what it said."""
        return self._play(
            {"ansible.builtin.include_role": {"name": "gateway_base", "tasks_from": "network"}}, told, words
        )

    def stage(self, told: dict[str, Any]) -> None:
        """Run the first of them only, as a laptop does that dies thereafter."""
        code, said = self._play({"atlantis.netcfg.network": {**told, "action": "stage"}}, told, ())
        assert code == 0, said

    def _play(self, task: dict[str, Any], told: dict[str, Any], words: Sequence[str]) -> tuple[int, str]:
        (self.folder / "known").write_text(f"{NAME} {self.gateway.host_key}\n")
        play = [{"hosts": "all", "gather_facts": False, "tasks": [{"name": "Network", **task}]}]
        variables = {
            "ansible_host": "127.0.0.1",
            "ansible_port": self.gateway.port,
            "ansible_user": "root",
            "ansible_ssh_private_key_file": str(self.key.file),
            "ansible_ssh_common_args": f"-o HostKeyAlias={NAME} -o UserKnownHostsFile={self.folder / 'known'}",
            "gateway_base_network": told,
        }
        for name, value in (("play.yml", play), ("variables.json", variables)):
            (self.folder / name).write_text(json.dumps(value))
        process = preforked.play(["-i", f"{NAME},", "play.yml", "-e", "@variables.json", *words], self.folder)
        return process.wait(), (self.folder / "said").read_text()

    def network(self) -> dict[str, Any]:
        """Files and running state, to be compared before and after."""
        show = "cat /etc/netplan/10-atlantis.yaml /etc/network/interfaces /etc/systemd/network/05-atlantis.network"
        return {
            "files": self.gateway.run(f"{show} /etc/resolv.conf 2>&1", check=False).stdout,
            "addresses": re.sub(r"@\S+", "", self.gateway.run("ip -4 -brief address show scope global").stdout).split(),
            "default": self.gateway.run("ip -4 route show default").stdout.split()[:5],
        }


@pytest.fixture
def network_stand(tmp_path: Path, technician: Key) -> Iterator[NetworkStand]:
    """A gateway as it comes from the vendor, with a second interface on the same cable."""
    if (reason := why_not()) is not None:
        pytest.skip(reason)
    with open_lab(tmp_path / "yard") as made:
        gateway = made.start(
            NAME,
            build_rootfs(NETWORK),
            address="10.64.1.10/24",
            gateway=ROUTER,
            keys=(technician.public,),
            spare="eth1",
        )
        gateway.put("/usr/local/sbin/udevadm", NO_UDEV, mode="0755")
        yield NetworkStand(gateway, technician, tmp_path, made)
