"""A gateway is brought to all that is declared of it from a bundle alone, on a vessel without internet."""

import functools
import json
import socket
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
import yaml
from gateway_role import NAME, ROOT, Stand
from gateway_stand import FREE_CLOCK, SHIPPED, Key, Start, gateway_tree, ground, machine, technician  # noqa: F401 - fixtures
from gateway_suite import checked

from atlantis_netcfg.computers.bundle.build import BundleOrder, BundlePurpose, make
from atlantis_netcfg.computers.bundle.manifest import Keys, Manifest
from atlantis_netcfg.computers.bundle.open import open_bundle
from atlantis_netcfg.computers.bundle.requirements import read_target
from atlantis_netcfg.emulator.lab.stubs import StubArchive, StubPackage, publish, ros_packages
from atlantis_netcfg.emulator.lab.stubs.interop import EXAMPLES, LIBRARY, GitServer, make_interop, serve_git
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.operations.bundle import host_requirements
from atlantis_netcfg.operations.common.request import Request
from atlantis_netcfg.vpn.rehearsal import identities
from bench.proxy import Count, Shape
from bench.world import Proxies

pytestmark = [pytest.mark.namespace, pytest.mark.slow]
ROLES = ["gateway_base/offline", "gateway_base", "openvpn_client", "gateway_ros2", "gateway_interop", "gateway_dds"]
TOKEN = "EXAMPLE-token-of-the-voyage"


PREFETCH = next(
    task
    for task in yaml.safe_load((ROOT / "playbooks/computers/computer.yml").read_text())
    if "atlantis.netcfg.prefetch" in task
)
"""The task of the product's own playbook."""
NO_OP = 12
"""Round trips of a run of all roles from a bundle that finds nothing to do, SSH's own handshake included: 10 today."""
WAY = Shape(0.05)
"""Long enough for answers that belong together to be one."""


def counted(stand: Stand) -> Count:
    """What a run of a gateway as declared puts on the wire, counted by a relay."""
    with Proxies([("127.0.0.1", 0, stand.gateway.port)], WAY) as relay:
        stand.variables |= {"ansible_port": relay.proxies[0].address[1]}
        assert stand.run()["changes"] == []
        del stand.variables["ansible_port"]
        return relay.count()


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_arguments: object) -> None:
        """Requests are apt's business."""


@dataclass
class Voyage(Stand):
    """A gateway whose runs take a bundle."""

    @property
    def request(self) -> Request:
        return Request(state=self.folder / "state", rehearsed=True)

    def _command(self, events: int, words: Sequence[str]) -> list[str]:
        command = super()._command(events, words)
        told = json.loads((self.folder / "variables.json").read_text())
        told["atlantis_request"]["offline"] = str(self.folder / "bundle")
        (self.folder / "variables.json").write_text(json.dumps(told))
        play = json.loads((self.folder / "play.yml").read_text())
        play[0]["tasks"].insert(0, PREFETCH)
        (self.folder / "play.yml").write_text(json.dumps(play))
        return command

    @property
    def declaration(self) -> Inventory:
        return load(self.inventory)

    def pack(self) -> Manifest:
        """What the laptop does ashore."""
        declaration = self.declaration
        wish = host_requirements(declaration, declaration.hosts[NAME], self.request, tokens=True)
        status = (gateway_tree() / "var/lib/dpkg/status").read_bytes()
        target = replace(read_target(status, "tree"), distribution="ubuntu", codename="focal")
        order = BundleOrder(
            "coastal", declaration.revision, (BundlePurpose(wish, target, None),), self.folder / "bundle"
        )
        keys = Keys.of(self.request.state)
        made = make(order, keys.signer(), lambda _words, _share: None, lambda _size: None)
        assert open_bundle(self.folder / "bundle", keys, [wish]).manifest == made
        return made


@contextmanager
def served(folder: Path, tag: str, token: str) -> Iterator[tuple[GitServer, StubArchive, str]]:
    """The partners' git server and ROS' archive; no machine reaches them."""
    projects = make_interop(folder / "served", tag)
    more = [StubPackage(name, "1.0") for name in ("build-essential", "gpsd", "python3-colcon-ros")]
    archive = publish(folder / "archive", [*ros_packages("foxy"), *more], codename="focal")
    server = ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=str(archive.folder)))
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    with serve_git(projects.folder, socket.create_server(("127.0.0.1", 0)), token) as git:
        yield git, archive, f"http://127.0.0.1:{server.server_address[1]}"
    server.shutdown()
    thread.join()
    server.server_close()


@pytest.fixture
def ashore(tmp_path: Path) -> Iterator[tuple[GitServer, StubArchive, str]]:
    with served(tmp_path, "v1", TOKEN) as there:
        yield there


@pytest.fixture
def voyage(
    machine: Start,  # noqa: F811 - fixtures
    technician: Key,  # noqa: F811
    tmp_path: Path,
    ashore: tuple[GitServer, StubArchive, str],
) -> Voyage:
    git, archive, mirror = ashore
    stand = Voyage(machine(NAME), technician, tmp_path, ROLES)
    identities(SHIPPED, [SHIPPED.hosts[NAME]], tmp_path / "state" / "vpn")
    (stand.inventory / "keys").mkdir(exist_ok=True)
    (stand.inventory / "keys" / "stand-in.gpg").write_bytes(archive.key)
    ros2 = {"origin": "snapshot", "mirror": mirror, "key_file": "stand-in.gpg"}
    library, examples = (
        {"url": f"{git.url}/{name}.git", "revision": "v1", "token": TOKEN} for name in (LIBRARY, EXAMPLES)
    )
    packages = ["libyaml-cpp-dev", "g++", "make"]
    stand.declare(
        {"gateways": {"ros2": ros2, "interop": {"library": library, "examples": examples, "packages": packages}}}
    )
    stand.gateway.put("/etc/systemd/system/chrony.service.d/test.conf", FREE_CLOCK)
    stand.gateway.run("rm -f /etc/os-release /etc/apt/sources.list /etc/apt/sources.list.d/*; ip route del default")
    stand.gateway.put("/etc/os-release", "ID=ubuntu\nVERSION_CODENAME=focal\n")
    stand.gateway.run("systemctl daemon-reload")
    return stand


def test_all_roles_install_from_the_bundle_alone(voyage: Voyage, ashore: tuple[GitServer, StubArchive, str]) -> None:
    manifest = voyage.pack()
    asked = len(ashore[0].requests)
    planned = voyage.run("--check")
    assert planned["status"] == "planned", planned["message"]
    assert planned["changes"][0].startswith(f"bundle {manifest.id}: ")
    assert planned["changes"][0].endswith(" kB to copy")
    assert voyage.gateway.run("ls /var/lib/atlantis/bundle", check=False).stdout == ""
    done = voyage.run()
    assert (done["status"], done["hint"]) == ("changed", None), done
    assert f"bundle {manifest.id} assembled" in done["changes"]
    assert any(change.startswith("package ros-foxy-ros-base") for change in done["changes"])
    assert voyage.gateway.run("readlink /opt/atlantis/interop/current").stdout.startswith("builds/")
    again = voyage.run()
    assert (again["changes"], again["status"]) == ([], "unchanged"), again
    assert len(ashore[0].requests) == asked
    count = counted(voyage)
    assert count.round_trips <= NO_OP, count
    one, other = "/etc/atlantis/ros.env", "/etc/systemd/journald.conf.d/atlantis.conf"
    voyage.gateway.run(f"echo drift >> {one}; rm {other}")
    drift = [f"file {other}", f"file {one}"]
    planned = voyage.run("--check", "-vvv")
    assert planned["status"] == "planned", planned
    found = planned["changes"]
    assert [change for change in found if change.startswith("file ")] == drift
    assert TOKEN not in (voyage.folder / "said").read_text()
    mended = voyage.run("-vvv")
    assert (mended["changes"], mended["status"]) == (found, "changed"), mended
    assert TOKEN not in (voyage.folder / "said").read_text()
    assert voyage.run()["changes"] == []
    seen = voyage.gateway.run(f"grep -rlF {TOKEN} /var/lib/atlantis /etc /opt /var/log", check=False)
    assert (seen.returncode, seen.stdout) == (1, "")
    away = {f"test_clock_follows_a_source[{NAME}]", f"test_tunnel_has_its_address[{NAME}]"}
    assert checked(voyage).keys() == away, "neither a time server nor the VPN's is in the yard"
