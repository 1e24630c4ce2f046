"""What a technician types on the quay: the whole command against a gateway at its declared address, from a bundle."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import preforked
import pytest
from gateway_role import NAME, ROOT
from gateway_stand import FREE_CLOCK, Key, Start, ground, machine, technician  # noqa: F401 - fixtures
from test_gateway_voyage import Voyage, served

from atlantis_netcfg.emulator.lab import Lab
from atlantis_netcfg.emulator.lab.stubs import StubArchive
from atlantis_netcfg.emulator.lab.stubs.interop import GitServer
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.operations.common.request import Request
from bench.declared import Declared

pytestmark = [pytest.mark.namespace, pytest.mark.slow]
TOKEN = "a-real-interop-token"
REPORTS = "https://gitlab.spaceapplications.com/c4i"


class Typed(Voyage):
    """The same with an inventory that holds no examples, and with `provision` itself."""

    def __post_init__(self) -> None:
        self.real = Declared.make(self.folder)

    @property
    def request(self) -> Request:
        return Request(state=self.folder / "state")

    @property
    def declaration(self) -> Inventory:
        return load(self.inventory, decrypt=lambda _sealed: TOKEN)

    def provision(self, ground: Lab, *words: str) -> dict[str, Any]:  # noqa: F811 - not the fixture
        """Type it where the laptop stands: in the network of the quay."""
        command, words = (words[:1], words[1:]) if words[0] == "plan" else ((), words)
        typed = [*command, "site=coastal", f"device={NAME}", f"inventory={self.inventory}", "--json", *words]
        options = f"-F none -i {self.key.file} -o IdentitiesOnly=yes -o UserKnownHostsFile={self.known}"
        more = {
            "ATLANTIS_STATE": str(self.folder / "state"),
            "ANSIBLE_HOME": str(self.folder / "ansible"),
            "ANSIBLE_SSH_CONTROL_PATH_DIR": str(self.folder / "kept"),
            "ANSIBLE_VAULT_PASSWORD_FILE": str(self.real.vault_password),
            "ANSIBLE_SSH_EXTRA_ARGS": options,
        }
        server = preforked.server(sys.executable).fileno()
        done = subprocess.run(
            [*ground.prefix(), *preforked.client(server), *typed],
            cwd=ROOT,
            pass_fds=[server],
            env=os.environ | more,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.stdout.startswith("{"), done.stdout[:2000] + done.stderr[-2000:]
        told: dict[str, Any] = json.loads(done.stdout)
        return told


@pytest.fixture
def ashore(tmp_path: Path) -> Iterator[tuple[GitServer, StubArchive, str]]:
    with served(tmp_path, "v1.0.0", TOKEN) as there:
        yield there


@pytest.fixture
def typed(
    machine: Start,  # noqa: F811 - fixtures
    technician: Key,  # noqa: F811
    tmp_path: Path,
    ashore: tuple[GitServer, StubArchive, str],
) -> Typed:
    git, archive, mirror = ashore
    stand = Typed(machine(NAME), technician, tmp_path, [])
    (stand.inventory / "keys").mkdir(exist_ok=True)
    (stand.inventory / "keys" / "stand-in.gpg").write_bytes(archive.key)
    pilot = stand.inventory / "group_vars/all/pilot.yml"
    text = pilot.read_text().replace(REPORTS, git.url)
    more = f"origin: snapshot\n      mirror: {mirror}\n      key_file: stand-in.gpg #"
    pilot.write_text(text.replace("origin: snapshot #", more))
    stand.gateway.put("/etc/systemd/system/chrony.service.d/test.conf", FREE_CLOCK)
    stand.gateway.run("rm -f /etc/os-release /etc/apt/sources.list /etc/apt/sources.list.d/*; systemctl daemon-reload")
    stand.gateway.put("/etc/os-release", "ID=ubuntu\nVERSION_CODENAME=focal\n")
    stand.known.write_text(f"{NAME} {stand.gateway.host_key}\n")
    return stand


def test_plan_run_and_repeated_run_are_consistent(typed: Typed, ground: Lab) -> None:  # noqa: F811 - a fixture
    typed.pack()
    bundle = str(typed.folder / "bundle")
    known = typed.known.read_text()
    typed.known.write_text("")
    for flag in ("plan", "--yes"):
        refused = typed.provision(ground, flag, "--offline", bundle)
        assert (refused["exit"], refused["devices"][NAME]["status"]) == (4, "left-as-found"), refused["errors"]
        assert (
            "its SSH host key differs from the inventory, or is not known here" in refused["devices"][NAME]["message"]
        )
        assert "provision device trust site=coastal" in refused["devices"][NAME]["hint"]
        assert typed.known.read_text() == "", "it was not taken over"
    typed.known.write_text(known)
    planned = typed.provision(ground, "plan", "--offline", bundle)
    assert (planned["exit"], planned["devices"][NAME]["status"]) == (2, "planned"), planned["errors"]
    done = typed.provision(ground, "--yes", "--offline", bundle)
    assert (done["exit"], done["devices"][NAME]["status"]) == (0, "changed"), done["errors"]
    again = typed.provision(ground, "--yes", "--offline", bundle)
    assert (again["exit"], again["devices"][NAME]["changes"]) == (0, [])
    assert len(done["runs"]) == len(again["runs"]) == 1
    shutil.rmtree(typed.folder / "kept")  # the connection that was kept open
    typed.known.write_text(f"{NAME} {typed.key.public}\n")
    other = typed.provision(ground, "--yes", "--offline", bundle)
    assert (other["exit"], other["devices"][NAME]["status"]) == (4, "left-as-found"), other["errors"]


def test_incomplete_bundle_is_refused_before_contacting_the_gateway(typed: Typed, ground: Lab) -> None:  # noqa: F811
    typed.pack()
    pilot = typed.inventory / "group_vars/all/pilot.yml"
    pilot.write_text(
        pilot.read_text().replace(
            "key_file: stand-in.gpg #", "key_file: stand-in.gpg\n      packages: [ros-foxy-more] #"
        )
    )
    before = typed.gateway.traffic.connections
    told = typed.provision(ground, "--yes", "--offline", str(typed.folder / "bundle"))
    assert told["exit"] == 3
    assert "ros-foxy-more" in told["errors"][0]["message"]
    assert typed.gateway.traffic.connections == before, "nobody was contacted"
