"""A gateway that nothing but SSH from the quay reaches, and bundles of stand-in packages for it."""

import json
import os
import re
import signal
import subprocess
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import preforked
from gateway_stand import ROUTER, Key, gateway_tree

from atlantis_netcfg.computers.bundle.build import BundleOrder, BundlePurpose, make
from atlantis_netcfg.computers.bundle.manifest import Keys, Manifest
from atlantis_netcfg.computers.bundle.requirements import (
    HostRequirements,
    Library,
    PackageRequirement,
    PackageSource,
    read_target,
)
from atlantis_netcfg.computers.bundle.requirements import RequirementKey as ArchiveKey
from atlantis_netcfg.emulator.lab import Machine
from atlantis_netcfg.emulator.lab.stubs import StubPackage, publish

NAME = "coastal-gateway"
CUT = f"""
ip route del default
nft -f - <<'END'
table inet quay {{
  chain input {{
    type filter hook input priority 0; policy drop
    iif lo accept
    ip saddr {ROUTER} tcp dport 22 accept
  }}
  chain output {{
    type filter hook output priority 0; policy drop
    oif lo accept
    ip daddr {ROUTER} tcp sport 22 accept
  }}
}}
END
"""
"""On the machine: all network but the management path is cut."""


@dataclass
class Quay:
    """The machine, the technician's laptop, and the bundles on it."""

    gateway: Machine
    key: Key
    folder: Path
    variables: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        (self.folder / "known").write_text(f"{NAME} {self.gateway.host_key}\n")

    @property
    def keys(self) -> Keys:
        return Keys.of(self.folder / "state")

    def bundle(
        self, packages: Sequence[StubPackage], libraries: Sequence[Library] = (), name: str = "bundle"
    ) -> Manifest:
        """Make one with these packages for the tree that the machine was started from."""
        archive = publish(self.folder / f"{name}-archive", packages, codename="bookworm")
        keyring = "/usr/share/keyrings/standins.gpg"
        wish = HostRequirements(
            NAME,
            tuple(PackageRequirement(each.name, each.version) for each in packages),
            (
                PackageSource(
                    "/etc/apt/sources.list.d/s.list", f"deb [signed-by={keyring}] file:{archive.folder} bookworm main\n"
                ),
            ),
            (ArchiveKey(keyring, archive.key),),
            libraries=tuple(libraries),
        )
        target = read_target((gateway_tree() / "var/lib/dpkg/status").read_bytes(), "tree")
        order = BundleOrder("coastal", "0" * 64, (BundlePurpose(wish, target, None),), self.folder / name)
        return make(order, self.keys.signer(), lambda _words, _share: None, lambda _size: None)

    def _command(self, tasks: Sequence[Mapping[str, Any]], name: str, words: Sequence[str]) -> list[str]:
        """Carry a bundle, then do these tasks."""
        carry = {"name": "Carry", "ansible.builtin.include_role": {"name": "gateway_base", "tasks_from": "offline"}}
        told = {"name": "Told", "ansible.builtin.debug": {"msg": "TOLD {{ gateway_base_bundle | to_json }} TOLD"}}
        play = [{"hosts": "all", "gather_facts": False, "tasks": [carry, told, *tasks]}]
        variables = {
            "ansible_host": "127.0.0.1",
            "ansible_port": self.gateway.port,
            "ansible_user": "root",
            "ansible_ssh_private_key_file": str(self.key.file),
            "ansible_ssh_common_args": f"-F none -o HostKeyAlias={NAME} -o UserKnownHostsFile={self.folder / 'known'}",
            "ansible_ssh_args": "",  # no connection outlives a run that is killed
            "atlantis_request": {"offline": str(self.folder / name), "state": str(self.folder / "state")},
        }
        if "ansible_become" in self.variables:
            play[0]["become"] = True
        for file, value in (("play.yml", play), ("variables.json", variables | self.variables)):
            (self.folder / file).write_text(json.dumps(value))
        return ["-i", f"{NAME},", "play.yml", "-e", "@variables.json", *words]

    def run(self, *tasks: Mapping[str, Any], name: str = "bundle", words: Sequence[str] = ()) -> tuple[int, str]:
        """Do it to the end; gives the exit code and what was said."""
        code = preforked.play(self._command(tasks, name, words), self.folder).wait()
        return code, (self.folder / "said").read_text()

    def cut_off(self, beyond: int) -> None:
        """Carry the bundle; kill Ansible, its workers and their ssh once so many bytes have gone up."""
        process = subprocess.Popen(
            [preforked.PLAYBOOK, *self._command((), "bundle", ())],
            cwd=self.folder,
            env=os.environ | preforked.settings(self.folder),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        while self.gateway.traffic.up_bytes < beyond and process.poll() is None:
            time.sleep(0.02)
        for pid in [process.pid, *_below(process.pid)]:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        process.wait()


def _below(pid: int) -> list[int]:
    """The processes that a process has started, and those that they have."""
    listed = subprocess.run(["ps", "-eo", "pid=,ppid="], capture_output=True, text=True, check=True).stdout
    rows = [tuple(map(int, line.split())) for line in listed.splitlines()]
    own = [child for child, parent in rows if parent == pid]
    return own + [deeper for child in own for deeper in _below(child)]


def told(said: str) -> dict[str, Any]:
    """What the task file has registered."""
    result: dict[str, Any] = json.loads(re.sub(r"\s*\n\s*", " ", said.split("TOLD ")[1].split(" TOLD", maxsplit=1)[0]))
    return result


def install(packages: Sequence[StubPackage]) -> dict[str, Any]:
    """The task of a role that installs from the bundle alone."""
    wanted = [{"name": each.name, "version": each.version} for each in packages]
    arguments = {"packages": wanted, "offline": "{{ gateway_base_bundle.repository }}"}
    return {"name": "Install", "atlantis.netcfg.packages": arguments}
