"""scapy 2.8 (`contrib.stamp`) judges our packets, sends, and is the far end. It has the unauthenticated mode only."""

import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from stand import PRESENT, run

from atlantis_netcfg.links.qualify import session
from atlantis_netcfg.links.qualify.budget import Budget, BudgetGuard
from atlantis_netcfg.links.qualify.figures import train_figures
from atlantis_netcfg.links.qualify.reflector.stamp import (
    PADDING,
    ReflectorPacket,
    SenderPacket,
    Tlv,
    error_estimate,
    ntp,
    padding,
    unix_ns,
)
from atlantis_netcfg.links.qualify.samples import ReplySample, Sample
from atlantis_netcfg.links.qualify.session import ReflectorPeer, Train, TrainPlan
from atlantis_netcfg.links.qualify.transport import UdpTransport

pytestmark = [PRESENT, pytest.mark.slow]

CLIENT = "scapy_stamp.py"
HOST = "127.0.0.1"
STAMP = ntp(1_790_000_000_250_000_000)
SECONDS = 1_790_000_000.25 + 2_208_988_800
ERROR = error_estimate(0.001, is_synced=True)


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as opened:
        opened.bind((HOST, 0))
        return int(opened.getsockname()[1])


@contextmanager
def _our_reflector() -> Iterator[int]:
    words = ["--unauthenticated", "--address", HOST, "--port", "0"]
    program = [sys.executable, "-P", "-m", "atlantis_netcfg.links.qualify.reflector", *words]
    with subprocess.Popen(program, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        assert process.stdout is not None
        try:
            yield int(process.stdout.readline().split()[-1])
        finally:
            process.terminate()


def test_scapy_decodes_our_packets_identically(tmp_path: Path) -> None:
    tlvs = (Tlv(PADDING, b"abcd"), Tlv(77, b"xyz"))
    request = SenderPacket(7, STAMP, ERROR, 513, tlvs)
    answer = ReflectorPacket(3, STAMP, ERROR, 513, STAMP, 7, STAMP, 1, 61, tlvs)
    job = {"do": "read", "requests": [request.encode().hex()], "answers": [answer.encode().hex()]}
    ((asked,), (told,)) = run(CLIENT, job, tmp_path)
    error = [1, 0, ERROR >> 8 & 63, ERROR & 255]
    extensions = [[0x80, PADDING, b"abcd".hex()], [0x80, 77, b"xyz".hex()]]
    assert (asked["seq"], asked["ssid"], asked["mbz"], asked["err_estimate"]) == (7, 513, 0, error)
    assert asked["tlv_objects"] == told["tlv_objects"] == extensions
    assert (told["seq"], told["seq_sender"], told["ttl_sender"], told["err_estimate_sender"]) == (
        3,
        7,
        61,
        [0, 0, 0, 1],
    )
    assert [asked["ts"], told["ts"], told["ts_rx"], told["ts_sender"]] == [pytest.approx(SECONDS, abs=1e-6)] * 4
    assert asked["whole"] == request.encode().hex(), "it would send the same octets"


def test_our_reflector_answers_scapy(tmp_path: Path) -> None:
    with _our_reflector() as port:
        told = run(CLIENT, {"do": "send", "host": HOST, "port": port, "count": 8}, tmp_path)
    assert [reply["seq"] for _, _, reply, _ in told] == [reply["seq_sender"] for _, _, reply, _ in told] == [*range(8)]
    for number, (sent, received, reply, whole) in enumerate(told):
        assert sent == received == (44 if number % 2 == 0 else 60)
        assert reply["ssid"] == 77
        assert reply["err_estimate_sender"] == [1, 0, 0, 1]
        assert whole[8:24] == reply["whole"][56:72], "its own stamp comes back"
        assert 0 <= reply["ts"] - reply["ts_rx"] < 5
        assert reply["mbz1"] == reply["mbz2"] == 0
        assert reply["tlv_objects"] == ([] if number % 2 == 0 else [[0, PADDING, bytes(12).hex()]])


def test_scapy_reflects_our_sender(tmp_path: Path) -> None:
    port = _free_port()
    told: list[Any] = []
    lost = {"lost_up": [23, 30, 31], "lost_down": [25]}
    job = {"do": "reflect", "host": HOST, "port": port, **lost}
    far = threading.Thread(target=lambda: told.append(run(CLIENT, job, tmp_path)))
    far.start()
    samples: list[Sample] = []
    peer = ReflectorPeer(None, counts=False)
    with UdpTransport((HOST, port)) as transport:
        _until_it_listens(transport)
        guard = BudgetGuard(Budget(), time.monotonic)
        train = Train("t", TrainPlan(120, 0.02, 1.0, timeout_s=2), peer, transport, samples.append)
        assert session.run(transport, peer, [train], guard) == "done"
        transport.send(SenderPacket(0xFFFFFFFF, STAMP, 1).encode())
    far.join()
    figures = train_figures(samples, "t")
    assert figures.loss.sent == 50
    assert figures.loss.received == 46
    assert figures.rtt is not None
    assert 0 < figures.rtt.min < 1
    numbers = [sample.reflector_sequence for sample in samples if isinstance(sample, ReplySample)]
    first = numbers[0]
    assert numbers == [n for n in range(first, first + 47) if n - first != 24], "it numbers what it answers"
    assert told == [first + 47]


def _until_it_listens(transport: UdpTransport) -> None:
    end = time.monotonic() + 40
    while time.monotonic() < end:
        packet = SenderPacket(1000, ntp(transport.unix_ns()), 1, 9, padding(48, is_authenticated=False))
        transport.send(packet.encode())
        if transport.receive(transport.now_ns() + 200_000_000) is not None:
            while transport.receive(transport.now_ns() + 100_000_000) is not None:
                pass
            return
    pytest.fail("scapy's reflector did not begin")


def test_timestamps_of_scapy_are_decoded_correctly(tmp_path: Path) -> None:
    with _our_reflector() as port:
        ((_, _, reply, _),) = run(CLIENT, {"do": "send", "host": HOST, "port": port, "count": 1}, tmp_path)
    stamp = int(reply["whole"][56:72], 16)
    assert abs(unix_ns(stamp) / 1e9 + 2_208_988_800 - reply["ts_sender"]) < 1e-6
    assert abs(reply["ts_rx"] - reply["ts_sender"]) < 60
