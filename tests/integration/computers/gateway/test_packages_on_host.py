"""The module `packages` on a real Debian with systemd, by SSH: hindrances are told, what was cut off is finished."""

import base64
import json
import os
import subprocess
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import preforked
import pytest
from gateway_role import NAME, ROOT
from gateway_stand import Key, Start, ground, known_hosts, machine, technician  # noqa: F401 - fixtures
from waiting import HANG_S, wait_until

from atlantis_netcfg.emulator.lab import Lab, Machine
from atlantis_netcfg.emulator.lab.stubs import StubArchive, StubPackage, publish

pytestmark = [pytest.mark.namespace, pytest.mark.slow]

ADHOC = preforked.PLAYBOOK.removesuffix("-playbook")
SOURCE, KEYRING = "/etc/apt/sources.list.d/own.sources", "/usr/share/keyrings/own.gpg"
SLOW = StubPackage("slow", "1.0", postinst="touch /run/slow; while [ -e /srv/slow ]; do sleep 0.1; done")
LARGE = StubPackage("large", "1.0", padding_kb=6000)
BROKEN = (StubPackage("broken", "1.0", postinst="echo no such bus >&2; exit 3"), StubPackage("broken", "2.0"))
PACKAGES = (StubPackage("one", "1.0"), StubPackage("one", "2.0"), SLOW, LARGE, *BROKEN)


@dataclass
class Board:
    """A gateway, an archive that it reaches, and the module run on it as Ansible runs it."""

    gateway: Machine
    key: Key
    folder: Path
    serve: Callable[[StubArchive], str]
    url: str = ""
    archive: StubArchive | None = None

    def publish(self, name: str, packages: tuple[StubPackage, ...] = PACKAGES, **how: Any) -> None:  # noqa: ANN401
        self.archive = publish(self.folder / name, packages, codename="bookworm", **how)
        self.url = self.serve(self.archive)

    def command(self, *names: str, check: bool = False, **more: object) -> list[str]:
        assert self.archive is not None
        source = f"Types: deb\nURIs: {self.url}\nSuites: bookworm\nComponents: main\nSigned-By: {KEYRING}\n"
        asked: dict[str, object] = {
            "packages": [dict(zip(("name", "version"), name.split("="), strict=False)) for name in names],
            "sources": [{"path": SOURCE, "content": source}],
            "keys": [
                {
                    "path": KEYRING,
                    "content_base64": base64.b64encode(self.archive.key).decode(),
                    "fingerprint": self.archive.fingerprint,
                }
            ],
            "expected": {"codename": "bookworm", "distribution": "debian"},
            **more,
        }
        how = {
            "ansible_host": "127.0.0.1",
            "ansible_port": self.gateway.port,
            "ansible_user": "root",
            "ansible_ssh_private_key_file": str(self.key.file),
            "ansible_ssh_common_args": f"-o UserKnownHostsFile={known_hosts(self.folder, self.gateway)}",
        }
        words = ["-m", "atlantis.netcfg.packages", "-a", json.dumps(asked), "-e", json.dumps(how)]
        return ["-i", f"{NAME},", NAME, *words, *(["--check"] if check else [])]

    def run(self, *names: str, check: bool = False, **more: object) -> dict[str, Any]:
        environment = os.environ | {
            "ANSIBLE_CONFIG": str(ROOT / "ansible.cfg"),
            "ANSIBLE_CALLBACK_RESULT_FORMAT": "json",
        }
        words = self.command(*names, check=check, **more)
        said, errors = self.folder / "said", self.folder / "errors"
        with said.open("w") as output, errors.open("w") as other:
            preforked.ansible(
                *(ADHOC, words), env=environment, folder=ROOT, output=output.fileno(), errors=other.fileno()
            ).wait()
        text = said.read_text()
        assert "=> {" in text, text + errors.read_text()
        told: dict[str, Any] = json.loads(text[text.index("=> {") + 3 :])
        return told

    def start(self, *names: str) -> subprocess.Popen[bytes]:
        environment = os.environ | {"ANSIBLE_CONFIG": str(ROOT / "ansible.cfg")}
        return subprocess.Popen(
            [ADHOC, *self.command(*names)], env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )

    def wait_for(self, path: str) -> None:
        wait_until(lambda: self.gateway.run(f"test -e {path}", check=False).returncode == 0, every_s=0.1)


@pytest.fixture
def board(ground: Lab, machine: Start, technician: Key, tmp_path: Path) -> Board:  # noqa: F811 - fixtures
    made = Board(machine(NAME), technician, tmp_path, lambda archive: ground.serve(archive.folder))
    made.gateway.run("rm -f /etc/apt/sources.list /etc/apt/sources.list.d/*")
    return made


def test_declared_packages_are_installed_and_second_run_is_unchanged(board: Board) -> None:
    board.publish("archive")
    planned = board.run("one=1.0", check=True)
    assert board.gateway.run(f"ls {SOURCE}", check=False).stdout == ""
    first = board.run("one=1.0")
    assert planned["changes"] == first["changes"] == [f"file {KEYRING}", f"file {SOURCE}", "package one 1.0"]
    assert first["versions"] == {"one": "1.0"}
    assert board.run("one=1.0")["changes"] == []
    assert board.run("one")["changes"] == []
    board.gateway.run("apt-mark hold one")
    assert "package one is on hold at 1.0; the inventory has 2.0" in board.run("one=2.0")["msg"]
    board.gateway.run("apt-mark unhold one")
    assert board.run("one=2.0", check=True)["changes"] == board.run("one=2.0")["changes"] == ["package one 2.0"]
    assert "one: version 3* is not available; available: 2.0, 1.0" in board.run("one=3*")["msg"]
    dear = board.run("large", limit_bytes=100_000, limit_words="satellite, by the byte")
    assert (
        "1 packages of 6.1 MB would be downloaded; the accepted limit is 100 kB (satellite, by the byte)" in dear["msg"]
    )
    assert "--accept-cost" in dear["hint"]


def test_package_that_fails_to_configure_is_reported_and_replaceable(board: Board) -> None:
    board.publish("archive")
    assert board.run("one")["changes"][-1] == "package one 2.0"
    told = board.run("broken=1.0")
    assert "broken could not be set up" in told["msg"]
    assert told["msg"].endswith("no such bus")
    assert told["changes"] == ["package broken 1.0 (half-configured)"]
    assert "package broken 2.0" in board.run("broken=2.0")["changes"]
    assert board.run("broken=2.0")["changes"] == []


def test_a_power_cut_while_a_package_is_set_up_is_finished_by_the_next_run(board: Board) -> None:
    board.publish("archive")
    board.gateway.put("/srv/slow", "")
    with board.start("slow", "one") as running:
        board.wait_for("/run/slow")
        board.gateway.power_cut()
        running.kill()
    board.gateway.power_on()
    assert "half-configured" in board.gateway.run("dpkg-query -W -f '${db:Status-Status} ' slow").stdout
    board.gateway.run("rm /srv/slow")
    again = board.run("slow", "one")
    assert "package slow was half installed, repaired" in again["changes"]
    assert again["versions"].keys() == {"slow", "one"}
    assert board.run("slow", "one")["changes"] == []
    assert board.gateway.run("dpkg --audit").stdout == ""


def test_concurrent_package_manager_is_reported_and_waited_for(board: Board) -> None:
    board.publish("archive")
    board.gateway.put("/srv/slow", "")
    with board.start("slow") as running:
        board.wait_for("/run/slow")
        told = board.run("one", wait_s=1)
        assert "another program has been installing packages for more than 1 s: process" in told["msg"]
        assert "apt-get" in told["msg"]
        board.gateway.run("rm /srv/slow")
        assert running.wait(HANG_S) == 0
    assert "package one 2.0" in board.run("one")["changes"]


def test_full_disk_is_reported_and_next_run_completes(
    ground: Lab,  # noqa: F811 - a fixture
    machine: Start,  # noqa: F811 - a fixture
    technician: Key,  # noqa: F811 - a fixture
    tmp_path: Path,
) -> None:
    gateway = machine(NAME, disk_mb=64)
    gateway.run("rm -f /etc/apt/sources.list /etc/apt/sources.list.d/*")
    board = Board(gateway, technician, tmp_path, lambda archive: ground.serve(archive.folder))
    board.publish("archive")
    gateway.run("mkdir /srv/room; dd if=/dev/zero of=/srv/room/taken bs=1M count=22 status=none")
    told = board.run("large")
    assert "the computer's disk is too full:" in told["msg"]
    gateway.fill_disk()
    told = board.run("large")
    assert "full" in told["msg"]
    assert "df -h" in told["hint"]
    gateway.free_disk()
    gateway.run("rm -r /srv/room")
    assert board.run("large")["versions"] == {"large": "1.0"}
    assert board.run("large")["changes"] == []


def test_packages_damaged_by_a_power_cut_are_repaired(board: Board) -> None:
    board.publish("archive")
    assert board.run("one=1.0", "slow")["versions"].keys() == {"one", "slow"}
    for line in (
        "apt-get -qq --download-only install one",
        "cd /var/cache/apt/archives && head -c $(stat -c %s one_2.0_all.deb) /dev/zero >zeros",
        "cd /var/cache/apt/archives && mv zeros one_2.0_all.deb",
        "for list in /var/lib/apt/lists/*_Packages; do echo nothing >$list; done",
        "sed -i '/^Package: slow$/,/^$/ s/^Status: .*/Status: install reinstreq half-installed/' /var/lib/dpkg/status",
        "sed -i '/^Package: slow$/,/^$/ s/^Package: .*/Package: vanished/' /var/lib/dpkg/status",
    ):
        board.gateway.run(line)
    mended = board.run("one=2.0")
    assert mended["changes"] == ["package vanished was half installed, repaired", "package one 2.0"]
    assert board.run("one=2.0")["changes"] == []
    assert board.gateway.run("dpkg --audit").stdout == ""


@pytest.mark.campaign
@pytest.mark.parametrize("after_s", [0.8 + 0.2 * step for step in range(16)])
def test_a_power_cut_at_any_time_is_finished_by_the_next_run(board: Board, after_s: float) -> None:
    board.publish("archive")
    with board.start("slow", "one", "large") as running:
        with suppress(subprocess.TimeoutExpired):
            running.wait(timeout=after_s)
        board.gateway.power_cut()
        running.kill()
    board.gateway.power_on()
    assert board.run("slow", "one", "large")["versions"].keys() == {"slow", "one", "large"}
    assert board.run("slow", "one", "large")["changes"] == []
    assert board.gateway.run("dpkg --audit").stdout == ""
