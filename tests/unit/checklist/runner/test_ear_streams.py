"""What the ear hears over TCP, from servers that refuse, hang up, keep silent or say one byte at a time."""

import errno
import socket
import threading
from collections.abc import Iterator

import pytest
from ear_stand import ENOUGH_S, LOOPBACK, asked, heard_by, listen, served, until_gone

from atlantis_netcfg.checklist.probes import Say, Transcript, Trouble
from atlantis_netcfg.checklist.probes.agent.streams import encode_bytes, no_answer

HELLO = Say(b"hello\n", rb"\r\n$", ENOUGH_S)


@pytest.fixture
def free() -> Iterator[int]:
    with socket.socket() as bound:
        bound.bind((LOOPBACK, 0))
        yield bound.getsockname()[1]


def test_refused_connection_is_reported(free: int) -> None:
    told = heard_by(listen(free))
    assert (told.trouble, told.words) == (Trouble.REFUSED, f"127.0.0.1 port {free}: Connection refused")


def test_connection_timeout_is_reported() -> None:
    with socket.socket() as door:
        door.bind((LOOPBACK, 0))
        door.listen(0)
        port = door.getsockname()[1]
        crowd = [socket.socket() for _ in range(4)]
        for one in crowd:  # a queue that is full drops who knocks
            one.setblocking(False)
            one.connect_ex((LOOPBACK, port))
        told = heard_by(listen(port, connect_s=0.2))
        for one in crowd:
            one.close()
    assert (told.trouble, told.words) == (Trouble.SILENT, f"127.0.0.1 port {port}: no response within 0.2 s")


@pytest.mark.parametrize(
    ("number", "trouble"),
    [
        (errno.ECONNREFUSED, "refused"),
        (errno.EHOSTUNREACH, "unreachable"),
        (errno.ENETUNREACH, "unreachable"),
        (errno.EADDRINUSE, "busy"),
        (errno.EACCES, "denied"),
        (errno.ENXIO, "missing"),
        (errno.EMFILE, "unreachable"),
    ],
)
def test_system_errors_are_classified(number: int, trouble: str) -> None:
    found = no_answer(OSError(number, "words of the system"), "10.0.0.1 port 9200")
    assert (Trouble(found.trouble), found.words) == (Trouble(trouble), "10.0.0.1 port 9200: words of the system")


@pytest.mark.parametrize("say", [(), (HELLO,)])
def test_immediate_hang_up_is_reported(say: tuple[Say, ...]) -> None:
    with served(lambda client: client.shutdown(socket.SHUT_RDWR)) as port:
        told = heard_by(listen(port, say=say, listen_s=ENOUGH_S))
    assert told.trouble is Trouble.CLOSED
    assert told.words.startswith("the other end hung up after ")
    assert told.data == b""


def test_hang_up_after_a_busy_message_is_reported() -> None:
    with served(lambda client: client.sendall(b"port already in use\r\n\r\n ")) as port:
        told = heard_by(listen(port, say=(Say(b"AT\n", b"^OK", ENOUGH_S),), listen_s=ENOUGH_S))
    assert (told.trouble, told.data) == (Trouble.CLOSED, b"port already in use\r\n\r\n ")


def test_hang_up_after_the_response_is_no_error() -> None:
    with served(lambda client: client.sendall(b"all there is")) as port:
        told = heard_by(listen(port, listen_s=ENOUGH_S))
    assert (told.trouble, told.data) == (None, b"all there is")
    assert told.words.startswith("the other end hung up after")


def test_responses_may_arrive_byte_by_byte() -> None:
    answers = {b"hello\n": b'\x00\xff binary "quoted" \\ \r\n', b"and?\n": "Größe\r\n".encode()}
    said = []

    def dribble(client: socket.socket) -> None:
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for word, answer in answers.items():
            said.append(client.recv(100))
            assert said[-1] == word
            for byte in answer:
                client.sendall(bytes([byte]))
        assert until_gone(client) == b""

    with served(dribble) as port:
        told = heard_by(listen(port, say=(HELLO, Say(b"and?\n", rb"\r\n$", ENOUGH_S))))
    assert told.trouble is None
    assert told.data == b"".join(answers.values())
    assert [at for at, _ in told.chunks] == sorted(at for at, _ in told.chunks)
    assert told.began > 0
    assert told.ended_s >= told.chunks[-1][0]


def test_nothing_more_is_sent_after_a_missing_response() -> None:
    """The transmission hangs on the answer that allows it; what comes later is heard all the same."""
    said = []

    def serve(client: socket.socket) -> None:
        client.sendall(b"BUSY\r\n")
        said.append(until_gone(client))

    script = (Say(b"", b"BUSY\r\n", ENOUGH_S), Say(b"may I?\n", b"^OK", 0.05), Say(b"transmit\n", b".", 0.05))
    with served(serve) as port:
        told = heard_by(listen(port, say=script, listen_s=0.05))
    assert (told.trouble, told.data) == (None, b"BUSY\r\n")
    assert said == [b"may I?\n"]


def test_silent_connection_is_no_error() -> None:
    with served(until_gone) as port:
        told = heard_by(listen(port, say=(Say(b"?\n", b".", 0.05),), listen_s=0.05))
    assert (told.trouble, told.words, told.chunks) == (None, "", ())


def test_earlier_data_does_not_count_as_a_response() -> None:
    def serve(client: socket.socket) -> None:
        client.sendall(b"OK\r\n")
        assert client.recv(100) == b"one\n"
        client.sendall(b"OK\r\n")
        assert client.recv(100) == b"two\n"
        client.sendall(b"OK 2\r\n")
        until_gone(client)

    script = (Say(b"one\n", rb"(?s)OK\r\n.*OK\r\n", ENOUGH_S), Say(b"two\n", rb"^OK 2\r\n", ENOUGH_S))
    with served(serve) as port:
        assert heard_by(listen(port, say=script)).data == b"OK\r\nOK\r\nOK 2\r\n"


def test_listening_ends_when_enough_is_received() -> None:
    def serve(client: socket.socket) -> None:
        client.sendall(b"$GPGGA,1\r\n")
        client.sendall(b"$GPGGA,2\r\n")
        until_gone(client)

    with served(serve) as port:
        told = heard_by(listen(port, listen_s=ENOUGH_S, enough=rb"(?s)GGA.*GGA.*\n"))
    assert told.data == b"$GPGGA,1\r\n$GPGGA,2\r\n"


def test_data_is_cut_at_the_requested_size() -> None:
    def serve(client: socket.socket) -> None:
        client.sendall(b"x" * 5000)
        until_gone(client)

    with served(serve) as port:
        told = heard_by(listen(port, listen_s=ENOUGH_S, max_bytes=100))
    assert (len(told.data), told.words) == (100, "cut after 100 bytes")


def test_requests_to_one_port_run_in_order() -> None:
    """A modem serves one client; two of our own questions must not look like the vehicle's software to each other."""
    inside, most, said = [0], [0], []
    lock = threading.Lock()

    def serve(client: socket.socket) -> None:
        with lock:
            inside[0] += 1
            most[0] = max(most[0], inside[0])
        said.append(client.recv(100))
        client.sendall(b"ok")
        until_gone(client)
        with lock:
            inside[0] -= 1

    with served(serve, clients=2) as port:
        questions = [listen(port, name=name, say=(Say(name.encode(), b"ok", ENOUGH_S),)) for name in ("b", "a")]
        told = asked(*questions)
    assert said == [b"b", b"a"]
    assert most == [1]
    assert {name: one.data for name, one in told.items() if isinstance(one, Transcript)} == {"b": b"ok", "a": b"ok"}


def test_requests_on_a_shared_medium_run_in_turn() -> None:
    order: list[str] = []

    def transmit(client: socket.socket) -> None:
        order.append("begins")
        client.recv(100)
        client.sendall(b"done")
        until_gone(client)
        order.append("ends")

    with served(transmit) as one, served(transmit) as other:
        script = (Say(b"transmit\n", b"done", ENOUGH_S),)
        asked(listen(one, name="a", say=script, turn="water"), listen(other, name="b", say=script, turn="water"))
    assert order == ["begins", "ends", "begins", "ends"]


@pytest.mark.parametrize("data", [b"", b"$GPGGA,1\r\n", bytes(range(256)), b"\xfd\x09\x00\x00"])
def test_bytes_round_trip_through_json(data: bytes) -> None:
    def serve(client: socket.socket) -> None:
        client.sendall(data)

    with served(serve) as port:
        assert heard_by(listen(port, listen_s=ENOUGH_S)).data == data


def test_text_stays_text_and_bytes_become_base64() -> None:
    assert (
        encode_bytes(b"$GPGGA,101500.00,,,,,0,00,99.99,,,,,,*63\r\n") == "$GPGGA,101500.00,,,,,0,00,99.99,,,,,,*63\r\n"
    )
    assert len(encode_bytes(bytes(range(256)))[0]) == 344
