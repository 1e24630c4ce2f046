"""The role `gateway_interop` on a real Debian with systemd, by SSH: stand-ins for the partners' projects are built."""

import datetime as dt
import os
import signal
import ssl
import subprocess
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from ipaddress import ip_address
from pathlib import Path
from typing import Any

import preforked
import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID
from gateway_role import Stand
from gateway_stand import ROUTER, Key, Start, ground, machine, technician  # noqa: F401 - fixtures

from atlantis_netcfg.emulator.lab import Lab
from atlantis_netcfg.emulator.lab.stubs.interop import (
    EXAMPLES,
    LIBRARY,
    GitServer,
    InteropProjects,
    make_interop,
    serve_git,
)

pytestmark = [pytest.mark.namespace, pytest.mark.slow]

TOKEN = "EXAMPLE-CANARY-of-interop"
CURRENT = "/opt/atlantis/interop/current"
SERVICE = "atlantis-data-gateway.service"


@dataclass
class Interop:
    """A gateway with ROS 2's place taken, and the partners' server."""

    stand: Stand
    git: GitServer
    projects: InteropProjects
    authority: str

    def declare(self, library: str, examples: str | None = "v1", **more: Any) -> None:  # noqa: ANN401 - YAML
        def repository(name: str, revision: str) -> dict[str, str]:
            return {"url": f"{self.git.url}/{name}.git", "revision": revision, "token": TOKEN}

        interop = {
            "library": repository(LIBRARY, library),
            "examples": None if examples is None else repository(EXAMPLES, examples),
            "packages": ["libyaml-cpp-dev", "g++", "make"],
            **more,
        }
        self.stand.declare({"gateways": {"ros2": {"origin": "snapshot"}, "interop": interop}})

    def on(self, command: str) -> str:
        return self.stand.gateway.run(command).stdout.strip()

    def until(self, command: str) -> None:
        """Wait until a command succeeds."""
        self.on(f"while ! {{ {command}; }} >/dev/null 2>&1; do sleep 0.2; done")

    def key(self, name: str = "current") -> str:
        return self.on(f"readlink /opt/atlantis/interop/{name}").rpartition("/")[2]

    def until_it_is(self, state: str) -> None:
        """Wait until the service is in a state: systemd acts on a device's coming and going in its own time."""
        self.until(f'test "$(systemctl is-active {SERVICE})" = {state}')

    def state(self) -> tuple[str, str]:
        """Whether the service is enabled, and whether it runs."""
        done = self.stand.gateway.run(f"systemctl is-enabled {SERVICE}; systemctl is-active {SERVICE}", check=False)
        enabled, active = done.stdout.split() if len(done.stdout.split()) == 2 else ("", done.stdout.strip())
        return enabled, active

    def pid(self) -> str:
        return self.on(f"systemctl show -p MainPID --value {SERVICE}")

    def says(self) -> str:
        """What the program of the build in use says of its library."""
        robot = f"{CURRENT}/examples/build/example-robot {CURRENT}/examples/config/robot-config.yml"
        return self.stand.gateway.run(f"timeout 1 {robot}", check=False).stdout


@pytest.fixture
def interop(ground: Lab, machine: Start, technician: Key, tmp_path: Path) -> Iterator[Interop]:  # noqa: F811
    stand = Stand(machine("coastal-gateway"), technician, tmp_path, ["gateway_interop"])
    stand.gateway.put("/opt/ros/foxy/setup.sh", "export ROS_DISTRO=foxy\n")
    authority, context = certified(tmp_path, ROUTER)
    projects = make_interop(tmp_path / "served", "v1")
    with serve_git(projects.folder, ground.listen(), TOKEN, context) as git:
        yield Interop(stand, git, projects, authority)


def certified(folder: Path, address: str) -> tuple[str, ssl.SSLContext]:
    """Give a certificate that signs itself, and what serves with it."""
    key, name = ec.generate_private_key(ec.SECP256R1()), x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "forge")])
    now = dt.datetime.now(dt.UTC)
    made = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(1)
        .not_valid_before(now - dt.timedelta(days=1))
        .not_valid_after(now + dt.timedelta(days=1))
        .add_extension(x509.SubjectAlternativeName([x509.IPAddress(ip_address(address))]), critical=False)
        .sign(key, hashes.SHA256())
    )
    text = made.public_bytes(serialization.Encoding.PEM)
    secret = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    (folder / "forge.pem").write_bytes(text + secret)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(folder / "forge.pem")
    return text.decode(), context


def test_interop_is_built_once_per_revision_and_runs_over_the_vpn(interop: Interop) -> None:  # noqa: PLR0915 - one life
    stand = interop.stand
    stand.roles = ["gateway_interop", "gateway_interop/connection_test"]
    test = {"program": "example-robot", "config": "config/robot-config.yml"}
    service = {"command": "examples/build/example-robot examples/config/robot-config.yml", "memory_mb": 256}
    interop.declare("v1", service=service, connection_test=test)
    refused = stand.run()
    assert f"the certificate of {interop.git.url[8:]} is not accepted" in refused["message"]
    stand.gateway.put("/usr/local/share/ca-certificates/forge.crt", interop.authority)
    interop.on("update-ca-certificates")

    planned = stand.run("--check")
    assert planned["changes"][0] == "build of library v1 and examples v1 started"
    stand.gateway.put("/run/scan", SCAN)
    interop.on("systemd-run -q --unit=scan python3 /run/scan")
    interop.until(": CANARY-control; grep -q CAN[A]RY-control /run/seen")  # it sees what is there to be seen
    interop.on(": >/run/seen")
    built = stand.run("-vvv")
    interop.on("rm /run/scan")
    first = interop.key()
    assert built["changes"][:2] == [
        planned["changes"][0],
        f"build {first} of library v1 and examples v1 activated",
    ]
    assert built["changes"][2:] == [one for one in planned["changes"] if one in built["changes"]][1:]
    assert built["notes"] == ["example-robot was not started: tun0, the VPN's interface, has no address yet"]
    assert seen_of_the_token(interop) == ""
    assert interop.state() == ("enabled", "inactive")
    assert stand.run()["changes"] == []

    stand.gateway.put("/etc/atlantis/ros.env", "ROS_DOMAIN_ID=7\n")
    plug(interop)
    interop.until_it_is("activating")
    assert interop.state() == ("enabled", "activating")
    interop.on("ip address add 10.80.0.10/16 dev tun0")
    interop.until("systemctl is-active " + SERVICE)
    interop.until(f"journalctl -o cat -u {SERVICE} | grep -q 'library, v1'")
    assert interop.on(f"tr '\\0' '\\n' </proc/{interop.pid()}/environ | grep ROS_DOMAIN") == "ROS_DOMAIN_ID=7"
    shown = interop.on(f"systemctl show {SERVICE} -p User -p MemoryMax -p CPUQuotaPerSecUSec -p TasksMax -p Restart")
    assert set(shown.splitlines()) == {
        *("User=atlantis-interop", f"MemoryMax={256 * 2**20}", "CPUQuotaPerSecUSec=2s", "TasksMax=512"),
        "Restart=always",
    }
    interop.on(f"kill -KILL {interop.pid()}")
    interop.until(f"test $(systemctl show -p NRestarts --value {SERVICE}) = 1 && systemctl is-active {SERVICE}")

    interop.projects.release("v2")
    interop.declare("v2", service=service, connection_test=test)
    renewed = stand.run()
    assert renewed["changes"][-1] == f"unit {SERVICE} restarted"
    assert renewed["notes"][-1].startswith(
        "INCONCLUSIVE: example-robot ran for 15 s without an error; only a person at the SCC can see whether TEST_ROBOT"
    )
    assert interop.key("previous") == first != interop.key()
    interop.until(f"journalctl -o cat -u {SERVICE} | tail -n 1 | grep -q 'library, v2'")
    assert stand.run()["changes"] == []

    asked = len(interop.git.requests)
    interop.declare("v1", service=service)
    back = stand.run()
    assert back["changes"] == [
        f"build {first} of library v1 and examples v1 activated",
        f"unit {SERVICE} restarted",
    ]
    assert len(interop.git.requests) == asked

    unplug(interop)
    interop.until_it_is("inactive")
    assert interop.state() == ("enabled", "inactive")
    plug(interop)
    interop.on("ip address add 10.80.0.10/16 dev tun0")
    interop.until("systemctl is-active " + SERVICE)
    interop.declare("v1")
    assert f"absent /etc/systemd/system/{SERVICE}" in stand.run()["changes"]
    assert interop.state()[1] == "inactive"
    assert stand.run()["changes"] == []

    interop.git.token = "another"
    interop.declare("v3")
    refused = stand.run()
    assert "does not accept the inventory's token for" in refused["message"]
    assert "/var/log/atlantis/build-" in refused["hint"]
    assert interop.key() == first
    assert seen_of_the_token(interop) == ""


def test_build_survives_full_disk_killed_laptop_and_power_cut(interop: Interop) -> None:
    gateway = interop.stand.gateway
    gateway.put("/usr/local/share/ca-certificates/forge.crt", interop.authority)
    interop.on("update-ca-certificates")
    hold = 'execute_process(COMMAND sh -c "while [ -e /var/tmp/hold ]; do sleep 0.2; done")\n'
    interop.projects.release_examples("slow", {"more.cmake": hold})
    interop.declare("v1", "slow")

    gateway.fill_disk(leave_kb=300)
    full = interop.stand.run()
    assert "full" in full["message"], full
    assert interop.on("find /opt/atlantis/interop/builds -type f") == ""
    gateway.free_disk()

    interop.on("touch /var/tmp/hold")
    kill(interop, begin(interop))
    assert interop.on("systemctl is-active 'atlantis-build-*'") == "active"
    gateway.power_cut()
    gateway.power_on()
    interop.on("test ! -e /opt/atlantis/interop/current")

    kill(interop, begin(interop))
    asked = len(interop.git.requests)
    joined = begin(interop)
    interop.on("rm /var/tmp/hold")
    assert joined.wait() == 0
    assert interop.key() != ""
    assert len(interop.git.requests) == asked
    assert interop.stand.run()["changes"] == []
    assert "v1" in interop.says()


@pytest.mark.campaign
def test_build_survives_a_satellite_outage(interop: Interop) -> None:
    gateway = interop.stand.gateway
    gateway.put("/usr/local/share/ca-certificates/forge.crt", interop.authority)
    interop.on("update-ca-certificates; touch /var/tmp/hold")
    hold = 'execute_process(COMMAND sh -c "while [ -e /var/tmp/hold ]; do sleep 0.2; done")\n'
    interop.projects.release_examples("slow", {"more.cmake": hold})
    interop.declare("v1", "slow")
    gateway.link(delay_s=0.35, rate_up_bps=352_000, rate_down_bps=704_000)
    running = begin(interop)
    gateway.link(up=False)
    interop.on("sleep 30; rm /var/tmp/hold; sleep 40")
    gateway.link(delay_s=0.35, rate_up_bps=352_000, rate_down_bps=704_000)
    assert running.wait() == 0
    assert "v1" in interop.says()


SCAN = """\
import os, time
seen = set()
with open("/run/seen", "ab", buffering=0) as log:
    while os.path.exists("/run/scan"):
        places = [f"/proc/{name}" for name in os.listdir("/proc") if name.isdigit()]
        for place in [f"{place}/{name}" for place in places for name in ("cmdline", "environ")]:
            try:
                with open(place, "rb") as file:
                    words = file.read().split(b"\\0")
            except OSError:
                continue
            for word in words:
                if b"CANARY" in word and word not in seen:
                    seen.add(word)
                    log.write(word + b"\\n")
        time.sleep(0.005)
"""
"""Writes down, as long as its file is there, what processes show of the token; a round takes a few milliseconds."""


def seen_of_the_token(interop: Interop) -> str:
    """Where it stands on the gateway, in its journal, or in what Ansible has said."""
    said = (interop.stand.folder / "said").read_text()
    found = interop.stand.gateway.run(
        "cat /run/seen; grep -rlaF -f - /etc /home /opt /root /run /tmp /usr/local /var 2>/dev/null;"
        " journalctl --no-pager -a | grep CAN[A]RY",
        input=f"{TOKEN}\n",
        check=False,
    )
    return found.stdout + ("said" if TOKEN in said else "")


def plug(interop: Interop) -> None:
    """Let tun0 appear, and systemd see it; in a container without udev, its notes are written here."""
    interop.on(
        "test -w /sys || { mount -o remount,rw /sys; systemctl daemon-reexec; }; ip tuntap add tun0 mode tun;"
        " ip link set tun0 up; n=n$(cat /sys/class/net/tun0/ifindex);"
        " mkdir -p /run/udev/data /run/udev/tags/systemd; touch /run/udev/tags/systemd/$n;"
        " printf 'I:1\\nE:SYSTEMD_ALIAS=/sys/subsystem/net/devices/tun0\\nG:systemd\\nQ:systemd\\nV:1\\n'"
        " >/run/udev/data/$n; systemctl daemon-reload"
    )


def unplug(interop: Interop) -> None:
    interop.on("ip link delete tun0; systemctl daemon-reload")


def begin(interop: Interop) -> subprocess.Popen[bytes]:
    """Type the run; come back when it waits for the build, which has come to the examples."""
    stand, said = interop.stand, interop.stand.folder / "said"
    stand.variables["ansible_ssh_args"] = "-o ControlMaster=no"
    with (stand.folder / "events").open("wb") as events, said.open("wb") as output:
        running = subprocess.Popen(
            [preforked.PLAYBOOK, *stand._command(events.fileno(), ())],  # by its environment `kill` knows it
            cwd=stand.folder,
            env=os.environ | preforked.settings(stand.folder),
            pass_fds=[events.fileno()],
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
        )
    while "Wait for the build" not in said.read_text():
        assert running.poll() is None, said.read_text()
        time.sleep(0.1)
    interop.until("grep -q 'building the examples' /var/log/atlantis/build-*.log")
    return running


def kill(interop: Interop, running: subprocess.Popen[bytes]) -> None:
    """Take the laptop away: Ansible, and its tasks, which are sessions of their own; their environment names it."""
    named = f"ANSIBLE_HOME={interop.stand.folder}/ansible".encode()
    running.kill()
    running.wait()
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if named in (process / "environ").read_bytes().split(b"\0"):
                os.kill(int(process.name), signal.SIGKILL)
