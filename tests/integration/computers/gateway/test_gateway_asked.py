"""The questions of a checklist to a real gateway: one SSH command, real ports there, a host key that is compared."""

import asyncio
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest
from gateway_stand import NETWORK, ROUTER, SHIPPED, Key, Start, ground, machine, technician  # noqa: F401 - fixtures

from atlantis_netcfg.checklist.probes import (
    Answer,
    CommandResult,
    DhcpDiscoverRequest,
    DhcpOffers,
    Listen,
    Place,
    RunProgram,
    Say,
    Transcript,
    Trouble,
)
from atlantis_netcfg.checklist.runner import RealTransport
from atlantis_netcfg.emulator.lab import Lab
from atlantis_netcfg.operations.common.request import Request, Target

pytestmark = [pytest.mark.namespace, pytest.mark.slow]

NAME = "coastal-gateway"
OTHER_KEY = "ssh-ed25519 AAAAC3NzaC1lZDI1NTE5AAAAIOzMkrV3HHY+skvjB+3Dgsy6+gi2Qp9FkJyNvsHCouP1"
HOLDS = "import os,signal,socket; s = socket.socket(type=2); s.bind(('', 14550)); os.fork() or signal.pause()"
"""The vehicle's software there, which has the port when the command returns."""
CONSOLE = "/dev/pts/0"
"""Somebody may log in there: agetty has it."""
MOST_BYTES = 22_000
"""Both directions: a connection of OpenSSH (about 6 kB), the program (about 7 kB), the questions and the answers."""


@pytest.fixture
def ears(machine: Start, technician: Key, tmp_path: Path) -> RealTransport:  # noqa: F811 - fixtures
    gateway = machine(NAME)
    gateway.run(f'python3 -c "{HOLDS}" </dev/null >/dev/null 2>&1')
    (tmp_path / "known").write_text(f"{NAME} {gateway.host_key}\n")
    config = tmp_path / "config"
    config.write_text(
        f"Host {NAME}\n HostName 127.0.0.1\n Port {gateway.port}\n User root\n IdentityFile {technician.file}\n"
        f" IdentitiesOnly yes\n UserKnownHostsFile {tmp_path / 'known'}\n"
    )
    return RealTransport(SHIPPED, "coastal", Request(state=tmp_path / "state"), ssh_config=str(config))


def asked(ears: RealTransport, *questions: Listen | RunProgram | DhcpDiscoverRequest) -> Mapping[str, Answer]:
    return asyncio.run(ears.ask(Place.GATEWAY, None, [(one.name, one) for one in questions], lambda *_: None))


def test_gateway_queries_share_one_ssh_connection(
    ears: RealTransport,
    ground: Lab,  # noqa: F811 - as above
    technician: Key,  # noqa: F811
    tmp_path: Path,
) -> None:
    def tcp(name: str, address: str, port: int, *say: Say) -> Listen:
        return Listen(name, Place.GATEWAY, "tcp", address, port, say=say, listen_s=0.1, connect_s=5)

    def run(name: str, *argv: str) -> RunProgram:
        return RunProgram(name, Place.GATEWAY, argv)

    gateway, known = ground.machines[NAME], str(tmp_path / "known")
    traffic = gateway.traffic
    before = replace(traffic)
    with ground.listen() as door:
        found = asked(
            ears,
            run("who", "id", "-u"),
            run("python", "python3", "--version"),
            tcp("ssh", "127.0.0.1", 22, Say(b"", b"\n")),
            tcp("refused", ROUTER, 1),
            tcp("silent", ROUTER, door.getsockname()[1], Say(b"AT?S\n", b".", 0.1)),
            Listen("held", Place.GATEWAY, "serial", device=CONSOLE, baud=19200),
            Listen("vehicle", Place.GATEWAY, "udp", port=14550, listen_s=5),
            DhcpDiscoverRequest("dhcp", Place.GATEWAY, f"{NETWORK}10", within_s=0.2),
        )
    assert traffic.connections == before.connections + 1
    assert traffic.up_bytes + traffic.down_bytes < before.up_bytes + before.down_bytes + MOST_BYTES
    who, python, ssh = found["who"], found["python"], found["ssh"]
    assert isinstance(who, CommandResult)
    assert who.out == "0\n"
    assert isinstance(python, CommandResult)
    assert python.out.startswith("Python 3.")
    assert isinstance(ssh, Transcript)
    assert ssh.data.startswith(b"SSH-2.0-OpenSSH")
    assert {name: one.trouble for name, one in found.items() if one.trouble is not None} == {
        "refused": Trouble.REFUSED,
        "held": Trouble.BUSY,
        "vehicle": Trouble.BUSY,
    }
    assert found["held"].words.startswith(f"{CONSOLE} is held by ")
    assert found["dhcp"] == DhcpOffers(None)

    target = Target(host="127.0.0.1", port=gateway.port, known_hosts=known, identity=str(technician.file))
    rehearsed = Request(state=tmp_path / "state", rehearsed=True, targets={NAME: target})
    assert asked(RealTransport(SHIPPED, "coastal", rehearsed), run("who", "id", "-u"))["who"].trouble is None

    Path(known).write_text(f"{NAME} {OTHER_KEY}\n")
    changed = asked(ears, run("who", "id", "-u"))["who"]
    assert changed.trouble is Trouble.NO_PLACE
    assert changed.words == (
        f"{NAME} is unreachable: it shows a different SSH host key than before, so nothing was sent to it; only "
        f"if it was reinstalled: run `ssh-keygen -R {NAME}`, then run `provision device trust site=…` on a "
        "terminal: it shows each device's identity and asks you to confirm it"
    )
