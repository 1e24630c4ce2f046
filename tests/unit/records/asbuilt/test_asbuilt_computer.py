"""What a computer says of itself: over SSH by a script that takes its place, and read from what programs print."""

import asyncio
import os
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from atlantis_netcfg.checklist.probes import Answer, CommandResult, Trouble
from atlantis_netcfg.core.events import ignore
from atlantis_netcfg.core.reading_programs import is_allowed
from atlantis_netcfg.inventory import load
from atlantis_netcfg.operations.common.request import Request
from atlantis_netcfg.records.asbuilt import computer
from atlantis_netcfg.records.asbuilt.collect import SiteLook
from atlantis_netcfg.records.asbuilt.record import CableState, DeviceRecord, Origin, ReadState

if TYPE_CHECKING:
    from collections.abc import Mapping

SHIPPED = load(Path(__file__).parents[4] / "inventory")
GATEWAY = SHIPPED.hosts["coastal-gateway"]
KEY = "SHA256:" + "A" * 43
PRINTED = {
    "os": 'NAME="Ubuntu"\nPRETTY_NAME="Ubuntu 20.04.6 LTS"\n',
    "kernel": "4.9.337-EXAMPLE aarch64\n",
    "board": "Hardkernel ODROID-N2\0",
    "board_serial": "EXAMPLE-SERIAL\0",
    "links": '[{"ifname":"lo","link_type":"loopback","address":"00:00:00:00:00:00","operstate":"UNKNOWN"},'
    '{"ifname":"eth0","link_type":"ether","address":"02:00:5e:00:00:07","operstate":"UP"},'
    '{"ifname":"wlan0","link_type":"ether","address":"02:00:5e:00:00:08","operstate":"DOWN"},'
    '{"ifname":"docker0","link_type":"ether","address":"02:42:00:00:00:01","operstate":"DOWN"}]',
    "neighbours": '[{"dst":"10.64.1.1","dev":"eth0","lladdr":"02:00:5e:00:01:04","state":["REACHABLE"]},'
    '{"dst":"fe80::1","dev":"eth0","lladdr":"02:00:5e:00:01:04","state":["STALE"]},'
    '{"dst":"10.64.1.9","dev":"eth0","state":["FAILED"]}]',
    "host_key": f"256 {KEY} root@EXAMPLE (ED25519)\n",
    "speed": "1000\n",
    "packages": "chrony=4.3-2=installed\ngpsd=3.22-4=config-files\nodd=1:2.0=x=installed\n",
}


def answers(**more: str | None) -> dict[str, Answer]:
    """What the programs print; None: there is no such file or program."""
    asked = dict(computer.questions(GATEWAY, ("chrony", "gpsd")))
    printed: Mapping[str, str | None] = {**PRINTED, **more}
    gone = CommandResult(None, "", 1, "", "cat: No such file or directory\n")
    texts = {name: printed.get(name) for name in asked}
    return {name: gone if text is None else CommandResult(None, "", 0, text) for name, text in texts.items()}


def read(**more: str | None) -> computer.ComputerFacts:
    declared = {"10.64.1.1": "coastal-router"}
    return computer.read(GATEWAY, answers(**more), ("chrony", "gpsd", "odd", "none"), declared)


def test_every_command_is_on_the_allow_list(tmp_path: Path) -> None:
    packages, notes = computer.declared_packages(SHIPPED, GATEWAY, Request(state=tmp_path / "none"))
    assert "chrony" in packages
    # The shipped inventory has no key of ROS' archive.
    assert [note.partition(",")[0] for note in notes] == ["the packages of `gateway_ros2` are not known"]
    asked = computer.questions(GATEWAY, packages)
    assert [question.argv for _, question in asked if not is_allowed(question.argv)] == []


def test_server_packages_are_those_its_role_installs(tmp_path: Path) -> None:
    found = computer.declared_packages(SHIPPED, SHIPPED.hosts["scc-vpn"], Request(state=tmp_path / "none"))
    assert found == (("conntrack", "nftables", "openssl", "openvpn", "python3", "unattended-upgrades"), ())


@pytest.mark.parametrize(
    "words",
    [
        r"dpkg-query -W -f=${Package}=${Version}=${db:Status-Status}\n ../etc",
        "dpkg-query -S x",
        "dpkg -i x",
        "cat /etc/shadow",
        "ssh-keygen -l -f /root/.ssh/id",
        "cat /sys/class/net/../../x/speed",
    ],
)
def test_other_commands_are_not_on_the_allow_list(words: str) -> None:
    assert not is_allowed(tuple(words.split()))


def test_board_facts_are_read() -> None:
    values = {name: fact.value for name, fact in read().facts.items()}
    assert values == {
        "model": "Hardkernel ODROID-N2",
        "serial": "EXAMPLE-SERIAL",
        "os": "Ubuntu 20.04.6 LTS",
        "kernel": "4.9.337-EXAMPLE aarch64",
        "host_key": KEY,
    }


def test_pc_model_comes_from_firmware_and_placeholder_serial_is_ignored() -> None:
    found = read(board=None, board_serial=None, product="EXAMPLE-PC\n", product_serial="To Be Filled By O.E.M.\n")
    assert found.facts["model"].value == "EXAMPLE-PC"
    assert (found.facts["serial"].value, found.facts["serial"].origin) == (None, Origin.NOT_READ)


def test_ports_and_their_neighbours_are_read() -> None:
    first, second = read().ports
    assert (first.name, first.mac, first.link) == ("eth0", "02:00:5E:00:00:07", CableState.UP)
    assert [(item.mac, item.address, item.declared) for item in first.neighbours] == [
        ("02:00:5E:00:01:04", "10.64.1.1", "coastal-router")
    ]
    assert (second.name, second.link, second.neighbours) == ("wlan0", CableState.DOWN, ())


def test_package_versions_come_from_dpkg() -> None:
    assert read().packages == {"chrony": "4.3-2", "gpsd": "not installed", "odd": "1:2.0=x", "none": "not installed"}
    assert read(packages=None).packages == {}


def test_failed_command_that_every_computer_has_is_listed_as_missing() -> None:
    assert read().missing == ()
    assert read(kernel=None).missing == ("uname -rm: cat: No such file or directory",)


@pytest.mark.parametrize("text", ["", "null", "{}", "[1, 2]", "[{"])
def test_invalid_link_list_gives_no_ports(text: str) -> None:
    assert read(links=text).ports == ()


class Ssh:
    """A gateway that is this computer, by scripts named ssh and sudo."""

    def __init__(self, folder: Path, does: str) -> None:
        self.calls = folder / "calls"
        self.calls.touch()
        self.folder = folder
        programs = folder / "programs"
        programs.mkdir()
        scripts = {"ssh": f'for last; do :; done\necho "$@" >>{self.calls}\n{does}', "sudo": 'exec "$@"'}
        for name, text in scripts.items():
            (programs / name).write_text(f"#!/bin/sh\n{text}\n")
            (programs / name).chmod(0o700)
        self.path = f"{programs}{os.pathsep}{os.environ['PATH']}"

    def look(self) -> DeviceRecord:
        request = Request(state=self.folder / "state", command="test")
        site = SiteLook(SHIPPED, "coastal", request, ignore, ssh_config=str(self.folder / "ssh_config"))
        found = asyncio.run(site.devices((GATEWAY,)))
        return next(device for device in found if device.name == GATEWAY.name)


def test_local_computer_is_read_in_one_ssh_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ssh = Ssh(tmp_path, 'exec sh -c "$last"')
    monkeypatch.setenv("PATH", ssh.path)
    found = ssh.look()
    assert found.state is ReadState.READ, found.why
    assert len(ssh.calls.read_text().splitlines()) == 1
    assert found.facts["kernel"].value == f"{os.uname().release} {os.uname().machine}"
    assert found.facts["os"].origin is Origin.READ
    assert "chrony" in found.packages


def test_unreachable_gateway_has_no_read_values(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ssh = Ssh(tmp_path, "echo 'ssh: connect to host EXAMPLE port 22: No route to host' >&2; exit 255")
    monkeypatch.setenv("PATH", ssh.path)
    found = ssh.look()
    assert found.state is ReadState.NOT_REACHED
    assert "coastal-gateway is unreachable: ssh: connect to host EXAMPLE port 22: No route to host" in found.why
    assert (found.read_at, found.packages) == (None, {})
    assert all(fact.origin is not Origin.READ for fact in found.facts.values())


def test_computer_lacking_a_program_is_read_without_it() -> None:
    found = computer.read(
        GATEWAY,
        {**answers(), "host_key": CommandResult(Trouble.MISSING, "there is no program ssh-keygen")},
        (),
        {},
    )
    assert (found.facts["host_key"].value, found.missing) == (None, ())
