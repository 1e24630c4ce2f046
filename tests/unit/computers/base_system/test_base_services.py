"""Declared services: who reaches which port, what is started, and what a look on the computer says of it."""

import re
import shutil
import socket
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from waiting import HANG_S

from atlantis_netcfg.computers.base import gateway_base
from atlantis_netcfg.computers.parts import Configuration
from atlantis_netcfg.computers.services import LIST, services
from atlantis_netcfg.emulator.lab.stubs import service_program
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.inventory.model import HostedService, ServerComputer, VpnService

SHIPPED = load(Path(__file__).parents[4] / "inventory")
CENTRE = "scc-control"
LAN, POOL = "10.64.0.0/24", "10.80.0.0/24"
_OPEN = re.compile(r"ip saddr \{ (.*) \} (tcp|udp) dport (\d+) accept comment \"(.*)\"")


def with_services(*declared: dict[str, Any], host: str = CENTRE) -> Inventory:
    """The shipped pilot, in which `host` has these services and no partner's page is offered."""
    box = SHIPPED.hosts[host]
    assert isinstance(box.device, ServerComputer)
    device = box.device.model_copy(update={"services": tuple(HostedService.model_validate(each) for each in declared)})
    vpn = SHIPPED.pilot.vpn.model_copy(update={"services": ()})
    pilot = SHIPPED.pilot.model_copy(update={"vpn": vpn})
    return replace(SHIPPED, pilot=pilot, hosts={**SHIPPED.hosts, host: replace(box, device=device)})


_OURS = {"SSH", "checklists of other sites", "measurements"}


def opened(declaration: Inventory, host: str = CENTRE) -> dict[str, tuple[str, int, list[str]]]:
    """Name -> transport, port and sources of every rule of the firewall that opens a port to networks by a set."""
    configuration = gateway_base(declaration, declaration.hosts[host]).configuration
    (text,) = (file.content for file in configuration.files if file.path == "/etc/nftables.conf")
    rows = (match.groups() for match in _OPEN.finditer(text))
    found = {name: (transport, int(port), sources.split(", ")) for sources, transport, port, name in rows}
    return {name: row for name, row in found.items() if name not in _OURS}


@pytest.mark.parametrize(
    ("whom", "sources"),
    [
        ({"open_to": ["lan"]}, [LAN]),
        ({"open_to": ["vpn"]}, [POOL]),
        ({"open_to": ["lan", "vpn"]}, [LAN, POOL]),
        ({"partners": ["iqua"]}, ["10.80.17.0/24"]),
        ({"open_to": ["vpn"], "partners": ["inesc", "iqua"]}, [POOL, "10.80.16.0/23"]),
    ],
)
def test_port_is_open_to_the_declared_sources(whom: dict[str, Any], sources: list[str]) -> None:
    assert opened(with_services({"name": "web", "port": 18080, **whom})) == {"web": ("tcp", 18080, sources)}


def test_service_without_port_or_sources_opens_nothing() -> None:
    assert opened(with_services({"name": "database", "port": 18083}, {"name": "worker"})) == {}


def test_gateway_can_host_services() -> None:
    declared = {"name": "map", "transport": "udp", "port": 18084, "open_to": ["lan"]}
    found = opened(with_services(declared, host="coastal-gateway"), "coastal-gateway")
    assert found["map"] == ("udp", 18084, ["10.64.1.0/24"])


def test_remote_control_stream_passes_the_firewall_of_the_gateway() -> None:
    """The autopilot sends it without being asked, so that no answer that is awaited lets it in."""
    found = opened(SHIPPED, "coastal-gateway")
    assert found["remote control of stork"] == ("udp", 14550, ["10.64.1.0/24"])
    assert not [name for name in opened(SHIPPED) if name.startswith("remote control")]


def test_vpn_service_for_all_partners_is_open_on_its_host() -> None:
    declaration = with_services()
    offered = VpnService.model_validate({"name": 'a "page"', "host": CENTRE, "port": 8443})
    vpn = declaration.pilot.vpn.model_copy(update={"services": (offered,)})
    declaration = replace(declaration, pilot=declaration.pilot.model_copy(update={"vpn": vpn}))
    (row,) = opened(declaration).values()
    assert row == ("tcp", 8443, ["10.64.0.0/23", "10.64.2.0/24", "10.80.0.0/16"])
    assert list(opened(declaration)) == ["a _page_"], "a quotation mark would end nftables' string"


def service(**program: Any) -> HostedService:  # noqa: ANN401 - keys of the declaration
    words = {"command": "/opt/backend --port 18082", **program}
    return HostedService.model_validate({"name": "backend", "port": 18082, "open_to": ["vpn"], "program": words})


def configured(*declared: HostedService) -> Configuration:
    device = SHIPPED.hosts[CENTRE].device
    assert isinstance(device, ServerComputer)
    return services(device.model_copy(update={"services": declared}))


def unit_of(declared: HostedService) -> str:
    (text,) = (file.content for file in configured(declared).files if file.path.endswith("backend.service"))
    return text


def test_unit_is_sandboxed() -> None:
    lines = unit_of(service(memory_mb=300, restart="on-failure")).splitlines()
    for line in (
        *("User=svc-backend", "ExecStart=/opt/backend --port 18082", "Restart=on-failure", "MemoryMax=300M"),
        *("ReadWritePaths=/var/lib/svc-backend", "ProtectSystem=strict", "CapabilityBoundingSet="),
    ):
        assert line in lines


def test_account_and_folder_can_be_declared() -> None:
    declared = service(user="backend", data="/srv/backend")
    assert {"User=backend", "ReadWritePaths=/srv/backend"} <= set(unit_of(declared).splitlines())
    files = {file.path: file.content for file in configured(declared).files}
    assert files["/usr/lib/sysusers.d/atlantis-services.conf"] == 'u backend - "ATLANTIS service" /srv/backend\n'
    assert files["/etc/tmpfiles.d/atlantis-services.conf"] == "d /srv/backend 0750 backend backend -\n"


def test_privileged_port_needs_one_capability() -> None:
    declared = service().model_copy(update={"port": 443})
    assert "CapabilityBoundingSet=CAP_NET_BIND_SERVICE" in unit_of(declared).splitlines()


def test_shared_account_is_created_once() -> None:
    more = (
        service(user="backend", data="/srv/a"),
        service(user="backend", data="/srv/b").model_copy(update={"name": "second"}),
    )
    files = {file.path: file.content for file in configured(*more).files}
    assert files["/usr/lib/sysusers.d/atlantis-services.conf"].count("\n") == 1
    assert files[LIST].splitlines() == ["atlantis-service-backend.service", "atlantis-service-second.service"]


def test_service_without_a_program_is_removed() -> None:
    made = configured(HostedService.model_validate({"name": "web", "port": 18080}))
    assert (made.files, made.units, made.checks) == ((), (), ())
    assert LIST in made.absent


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="needs systemd-analyze")
def test_systemd_accepts_the_unit(tmp_path: Path) -> None:
    file = tmp_path / "atlantis-service-backend.service"
    file.write_text(unit_of(service()).replace("/opt/backend", "/bin/true").replace("svc-backend", "root"))
    done = subprocess.run(["systemd-analyze", "verify", str(file)], capture_output=True, text=True, check=False)
    assert [line for line in done.stderr.splitlines() if "atlantis-service-backend" in line] == []


@pytest.mark.parametrize(("kind", "sort"), [("tcp", socket.SOCK_STREAM), ("udp", socket.SOCK_DGRAM)])
def test_stand_in_listens(tmp_path: Path, kind: str, sort: socket.SocketKind) -> None:
    with socket.socket(socket.AF_INET, sort) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    program = tmp_path / "backend"
    program.write_text(service_program(kind, port))
    with subprocess.Popen([sys.executable, str(program)]) as running:
        try:
            assert b"stand-in" in _said(sort, port)
        finally:
            running.kill()


def _said(sort: socket.SocketKind, port: int) -> bytes:
    until = time.monotonic() + HANG_S
    while time.monotonic() < until:
        with socket.socket(socket.AF_INET, sort) as client:
            client.settimeout(0.2)
            try:
                client.connect(("127.0.0.1", port))
                client.send(b"?")
                said = client.recv(100)
            except OSError:
                continue
            if said != b"?":  # a socket that got the very port has met itself
                return said
    raise AssertionError("nobody listens")
