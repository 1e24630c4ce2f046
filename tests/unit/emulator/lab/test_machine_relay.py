"""The bearer between this computer and a machine; here a server of the loopback stands for the machine."""

import socket
import struct
import time
from collections.abc import Iterator
from contextlib import closing

import pytest
from waiting import HANG_S

from atlantis_netcfg.emulator.lab.relay import Relay, RelayLink, RelayTraffic
from atlantis_netcfg.emulator.udp_link import LinkShape


@pytest.fixture
def server() -> Iterator[socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as made:
        made.settimeout(HANG_S)
        yield made


@pytest.fixture
def relay(server: socket.socket) -> Iterator[Relay]:
    with closing(Relay(socket.socket, server.getsockname())) as made:
        yield made


class Both:
    def __init__(self, relay: Relay, server: socket.socket) -> None:
        self.client = socket.create_connection(("127.0.0.1", relay.port), HANG_S)
        self.machine, _ = server.accept()
        self.machine.settimeout(HANG_S)

    def close(self) -> None:
        self.client.close()
        self.machine.close()


@pytest.fixture
def both(relay: Relay, server: socket.socket) -> Iterator[Both]:
    with closing(Both(relay, server)) as made:
        yield made


def _everything(end: socket.socket) -> bytes:
    return b"".join(iter(lambda: end.recv(65536), b""))


def test_bytes_pass_both_ways_and_are_counted(both: Both, relay: Relay) -> None:
    both.client.sendall(b"to the machine")
    assert both.machine.recv(100) == b"to the machine"
    both.machine.sendall(b"and back")
    assert both.client.recv(100) == b"and back"
    assert relay.traffic == RelayTraffic(connections=1, up_bytes=14, down_bytes=8)


def test_half_closed_connection_still_receives(both: Both) -> None:
    sent = bytes(range(256)) * 4096
    both.client.sendall(b"all")
    both.client.shutdown(socket.SHUT_WR)
    assert _everything(both.machine) == b"all"
    both.machine.sendall(sent)
    both.machine.close()
    assert _everything(both.client) == sent


@pytest.mark.parametrize("breaker", ["client", "machine"])
def test_reset_is_relayed_after_earlier_data(both: Both, breaker: str) -> None:
    near, far = (both.client, both.machine) if breaker == "client" else (both.machine, both.client)
    near.sendall(b"last words")
    assert far.recv(100) == b"last words"
    near.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    near.close()
    with pytest.raises(ConnectionResetError):
        far.recv(100)


def test_client_is_reset_when_machine_refuses_connection(server: socket.socket, relay: Relay) -> None:
    server.close()
    with pytest.raises(ConnectionError), socket.create_connection(("127.0.0.1", relay.port), HANG_S) as client:
        client.recv(1)


def test_connect_and_request_cost_two_round_trips(server: socket.socket, relay: Relay) -> None:
    relay.set(RelayLink(delay_s=0.05))
    begin = time.monotonic()
    with closing(Both(relay, server)) as both:
        both.client.sendall(b"?")
        assert both.machine.recv(1) == b"?"
        both.machine.sendall(b"!")
        assert both.client.recv(1) == b"!"
    assert time.monotonic() - begin >= 4 * 0.05


def test_shape_overrides_delay_and_rates(server: socket.socket, relay: Relay) -> None:
    up = LinkShape(delay_s=0.05, gaps_s=((0.0, 0.15),))
    relay.set(RelayLink(delay_s=100, shapes=(up, LinkShape(delay_s=0.02))))
    with closing(Both(relay, server)) as both:
        begin = time.monotonic()
        both.client.sendall(b"?")
        assert both.machine.recv(1) == b"?"
        assert time.monotonic() - begin >= 0.2 + 0.05, "lost in the gap, and sent again"


def test_a_rate_is_shared_by_all_connections(server: socket.socket, relay: Relay) -> None:
    relay.set(RelayLink(rate_down_bps=800_000))
    begin = time.monotonic()
    with closing(Both(relay, server)) as one, closing(Both(relay, server)) as other:
        for both in (one, other):
            both.machine.sendall(b"x" * 10_000)
            both.machine.close()
        assert len(_everything(one.client)) + len(_everything(other.client)) == 20_000
    assert time.monotonic() - begin >= 0.2


def test_the_other_direction_is_not_slowed_down(both: Both, relay: Relay) -> None:
    relay.set(RelayLink(rate_down_bps=1))
    both.client.sendall(b"x" * 10_000)
    both.client.close()
    assert len(_everything(both.machine)) == 10_000


def test_data_on_a_dead_link_arrives_when_it_is_up_again(both: Both, relay: Relay) -> None:
    relay.set(RelayLink(up=False))
    both.client.sendall(b"into the silence")
    both.client.shutdown(socket.SHUT_WR)
    while relay.traffic.up_bytes < len(b"into the silence"):
        pass
    relay.set(RelayLink(up=False))  # whatever the relay would have done by now, it has done
    both.machine.setblocking(False)
    with pytest.raises(BlockingIOError):
        both.machine.recv(1)
    both.machine.settimeout(HANG_S)
    relay.set(RelayLink())
    assert _everything(both.machine) == b"into the silence"


def test_connection_over_a_dead_link_waits_until_it_is_up(server: socket.socket, relay: Relay) -> None:
    relay.set(RelayLink(up=False))
    with socket.create_connection(("127.0.0.1", relay.port), HANG_S) as client:
        client.sendall(b"patient")
        server.setblocking(False)
        with pytest.raises(BlockingIOError):
            server.accept()
        server.settimeout(HANG_S)
        relay.set(RelayLink())
        machine, _ = server.accept()
        with machine:
            assert machine.recv(100) == b"patient"


def test_closing_the_relay_closes_open_connections(server: socket.socket) -> None:
    relay = Relay(socket.socket, server.getsockname())
    with closing(Both(relay, server)) as both:
        relay.close()
        assert _everything(both.client) == b""
        assert _everything(both.machine) == b""
    relay.close()
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", relay.port))
