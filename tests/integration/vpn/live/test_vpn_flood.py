"""A stranger floods the server with the recorded first packet of a member: who is connected notices nothing."""

import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from live_stand import Client, Echo, Server, record, server_of
from waiting import wait_until

pytestmark = [pytest.mark.namespace, pytest.mark.slow]

RATE = 10_000
CAPTURE = ("127.0.0.1", 4711)
FLOOD = """\
import socket, sys, time
packet, address, rate = bytes.fromhex(sys.argv[1]), sys.argv[2], int(sys.argv[3])
sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(200)]
begun, sent = time.monotonic(), 0
while True:
    while sent < (time.monotonic() - begun) * rate:
        try:
            sockets[sent % len(sockets)].sendto(packet, (address, 1194))
        except OSError:
            pass
        sent += 1
        if sent % rate == 0:
            print(sent, flush=True)
    time.sleep(0.001)
"""


def first_packet(client: Client) -> bytes:
    """What its OpenVPN begins with."""
    conf = client.at("/etc/openvpn/client.conf")
    conf.write_text(re.sub(r"(?m)^remote .*", f"remote {CAPTURE[0]} {CAPTURE[1]}", conf.read_text()))
    with client.udp() as heard:
        heard.bind(CAPTURE)
        client.start(wait=False)
        packet = heard.recv(4096)
    client.stop()
    return packet


@contextmanager
def flood(client: Client, packet: bytes, address: str) -> Iterator["subprocess.Popen[str]"]:
    """It tells each second's worth of packets in a line."""
    words = [*client.enter, sys.executable, "-c", FLOOD, packet.hex(), address, str(RATE)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def memory_kb(server: Server) -> int:
    pid = server.at("/run/openvpn.pid").read_text().strip()
    found = re.search(r"VmRSS:\s+(\d+)", Path(f"/proc/{pid}/status").read_text())
    assert found is not None
    return int(found[1])


@pytest.mark.parametrize("seconds", [5, pytest.param(60, marks=pytest.mark.campaign)])
def test_during_a_flood_members_stay_connected_and_revoked_one_is_out(tmp_path: Path, seconds: int) -> None:
    made = record(tmp_path / "vpn")
    with server_of(made) as server:
        revoked, other, recorded = made.onboard(3)
        server.push()
        clients = [server.client(name) for name in (revoked, other)]
        for client in clients:
            client.start()
        stranger = server.client(recorded)
        packet, before = first_packet(stranger), memory_kb(server)
        address = re.search(r"local (\S+)", server.at("/etc/openvpn/server/atlantis.conf").read_text())
        assert address is not None
        with flood(stranger, packet, address[1]) as process, Echo(clients[0]) as echo, Echo(clients[1]) as beside:
            assert process.stdout is not None
            lines = [process.stdout.readline() for _ in range(seconds)]
            assert int(lines[-1]) == seconds * RATE
            echo.goes()
            evidence = server.throw_out(revoked)
            assert evidence.is_confirmed, evidence
            assert echo.answers() == 0
            beside.goes()
        assert server.lives
        assert server.names() == [other]
        assert server.log().count("connect-freq-initial") + server.log().count("initial packet") >= 1, server.log()[
            -2000:
        ]
        assert memory_kb(server) - before < 32_000
        stranger.become(made.identities[recorded])
        stranger.start(wait=False)
        wait_until(lambda: stranger.up, lambda: stranger.log()[-2000:])
