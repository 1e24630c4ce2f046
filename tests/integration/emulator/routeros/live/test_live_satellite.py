"""The allow-list test of a satellite through an attached router: what arrives beyond it, and what comes back."""

import asyncio
import os
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
from live_stage import ROUTER, SITE, STRANGER, TECHNICIAN, TIME_SERVER, VPN_SERVER, LiveStage, live_site, shipped

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.emulator.lab import hosts
from atlantis_netcfg.links.qualify.transport import UdpTransport
from atlantis_netcfg.operations.allow_list_test.prove import Proof, ProofPace
from atlantis_netcfg.operations.allow_list_test.site import satellite_of
from atlantis_netcfg.operations.allow_list_test.vpn import VpnQuestion
from atlantis_netcfg.routeros.api import Endpoint, Session
from atlantis_netcfg.vpn.identity import Wrap
from atlantis_netcfg.vpn.pki.keys import FirstPacket
from atlantis_netcfg.vpn.rehearsal import rehearsed_identity, vpn_server

pytestmark = [
    pytest.mark.namespace,
    pytest.mark.skipif(os.geteuid() != 0, reason="making a network namespace needs root"),
]
OTHER_TIME_SERVER = "192.0.2.124"
VPN = (VPN_SERVER, 1194)
END = b"end"
Answer = Callable[[bytes], bytes]


@pytest.fixture
def stage(tmp_path: Path) -> Iterator[LiveStage]:
    with live_site(tmp_path) as made:
        yield made


@contextmanager
def server(stage: LiveStage, place: tuple[str, int], answer: Answer) -> Iterator[None]:
    """Answer every datagram that arrives beyond the satellite."""
    with stage.socket("satellite", socket.SOCK_DGRAM, place) as beyond:

        def serve() -> None:
            while (received := beyond.recvfrom(2048))[0] != END:
                beyond.sendto(answer(received[0]), received[1])

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            yield
        finally:
            with stage.socket("satellite", socket.SOCK_DGRAM) as last:
                last.sendto(END, place)
                thread.join()


@contextmanager
def openvpn(port: int) -> Iterator[Answer]:
    """A real server on the loopback of this computer."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as inside:
        inside.settimeout(10)
        inside.connect(("127.0.0.1", port))

        def answer(datagram: bytes) -> bytes:
            inside.send(datagram)
            return inside.recv(2048)

        yield answer


async def run(stage: LiveStage, question: VpnQuestion) -> Proof:
    """The test as `--try-all` has it, with the router's time running ahead while nothing is sent."""

    async def sleep(seconds: float) -> None:
        await asyncio.to_thread(stage.do, "wait", seconds=seconds)

    proving = satellite_of(shipped(), SITE, None).proving(
        shipped(), open_filter=False, try_all=True, is_rehearsal=False
    )
    # A connection that the router's own filter drops takes as long as its row waits, in real seconds.
    refused = tuple(target for target in proving.link.refused_probes if target.port is None)
    proving.link = proving.link.model_copy(update={"refused_probes": refused})
    proving.pace, proving.vpn = ProofPace(sleep=sleep), question
    info = stage.do("info")
    password = Secret(stage.user.password)
    endpoint = Endpoint(info["host"], info["api_ssl"], stage.user.name, password, pin=info["pin"])
    async with await Session.open(endpoint) as session:
        return await proving.run(session)


def prove(stage: LiveStage) -> Proof:
    """Run the test with what answers beyond the satellite: two time servers and a real OpenVPN."""
    identity = rehearsed_identity(shipped(), shipped().hosts[ROUTER], Wrap.TLS_CRYPT)
    inside = hosts.NamespaceSockets(stage.name("technician"))
    with ExitStack() as stack:
        stack.callback(inside.close)
        relay = stack.enter_context(openvpn(stack.enter_context(vpn_server(identity))))
        stack.enter_context(server(stage, VPN, relay))
        for address in (TIME_SERVER, OTHER_TIME_SERVER):
            stack.enter_context(server(stage, (address, 123), lambda request: request))
        transport = stack.enter_context(inside.call(lambda source: UdpTransport(VPN, source=source), TECHNICIAN))
        return asyncio.run(run(stage, VpnQuestion(TECHNICIAN, transport, FirstPacket(identity.wrap_key))))


def outcomes(proof: Proof) -> dict[str, tuple[str, str]]:
    return {each.target: (each.outcome.value, finding.verdict.value) for each, finding in proof.results}


def test_every_target_is_proved_by_packets(stage: LiveStage) -> None:
    before = stage.do("export", header=False)
    proof = prove(stage)
    assert outcomes(proof) == {
        f"{VPN_SERVER} udp 1194": ("answered", "PASS"),
        f"{TIME_SERVER} udp 123": ("answered", "PASS"),
        f"{OTHER_TIME_SERVER} udp 123": ("answered", "PASS"),
        STRANGER: ("refused here", "PASS"),
    }
    assert "4 of 4 targets proved, 0 could not be tested" in proof.as_text()
    assert 0 < proof.bytes_counted < proof.budget_bytes
    assert stage.do("export", header=False) == before


def test_target_that_the_far_end_drops_is_not_reached(stage: LiveStage) -> None:
    stage.silence("satellite", OTHER_TIME_SERVER)
    result = outcomes(prove(stage))
    assert result[f"{OTHER_TIME_SERVER} udp 123"] == ("silent", "FAIL")
    assert result[f"{TIME_SERVER} udp 123"] == ("answered", "PASS")
