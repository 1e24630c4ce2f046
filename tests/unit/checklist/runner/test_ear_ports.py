"""Ports that may be somebody else's: UDP ports and serial ports are taken from nobody."""

import os
import socket
import subprocess
import sys
import termios
import threading
import time
import tty
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from ear_stand import ENOUGH_S, LOOPBACK, asked_apart, heard_by, listen

from atlantis_netcfg.checklist.probes import Listen, Place, Say, Transcript, Trouble
from atlantis_netcfg.checklist.probes.agent import streams

HOLDS = "import os,sys; port = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY); print('held', flush=True); input()"
LOCKS = "import fcntl,os,sys; port = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY); fcntl.flock(port, fcntl.LOCK_EX)"


def serial(path: str, **how: Any) -> Listen:  # noqa: ANN401 - the fields of Listen
    return replace(Listen("it", Place.LAPTOP, "serial", device=path, baud=19200), **how)


@pytest.fixture
def pair() -> Iterator[tuple[int, str]]:
    """The device's end of a pseudo-terminal, and the path of the other; nobody has that open."""
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    path = os.ttyname(theirs)
    os.close(theirs)
    yield ours, path
    os.close(ours)


@contextmanager
def other(program: str, path: str) -> Iterator[int]:
    words = [sys.executable, "-c", program, path]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"held\n"
        yield process.pid
        process.communicate(b"\n")


def datagrams(port: int, *data: bytes) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        for one in data:
            out.sendto(one, (LOOPBACK, port))


def udp(port: int, **how: Any) -> Listen:  # noqa: ANN401 - the fields of Listen
    return listen(port, transport="udp", address="", **how)


def test_datagrams_are_kept_separate(monkeypatch: pytest.MonkeyPatch) -> None:
    bound = threading.Event()
    bind = socket.socket.bind

    class Told(socket.socket):
        def bind(self, address: Any) -> None:  # noqa: ANN401 - as socket.bind has it
            bind(self, address)
            bound.set()

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind((LOOPBACK, 0))
        port = free.getsockname()[1]
    monkeypatch.setattr(socket, "socket", Told)

    def send() -> None:
        bound.wait()
        datagrams(port, b"\xfd one", b"", b"\xfd two")

    sender = threading.Thread(target=send)
    sender.start()
    told = heard_by(udp(port, listen_s=ENOUGH_S, enough=b"two"))
    sender.join()
    assert (told.trouble, [data for _, data in told.chunks]) == (None, [b"\xfd one", b"\xfd two"])


def test_a_udp_port_of_another_program_is_left_alone() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        taken.bind((LOOPBACK, 0))
        port = taken.getsockname()[1]
        told = heard_by(udp(port, listen_s=ENOUGH_S))
        datagrams(port, b"still mine")
        assert taken.recv(100) == b"still mine"
    assert (told.trouble, told.words) == (Trouble.BUSY, f"UDP port {port}: Address already in use")


def test_silent_udp_port_gives_nothing() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind((LOOPBACK, 0))
        port = free.getsockname()[1]
    assert heard_by(udp(port, listen_s=0.01)).chunks == ()


def test_serial_port_settings_are_restored(pair: tuple[int, str]) -> None:
    ours, path = pair
    before = settings(path)

    def device() -> None:
        assert spoken(ours) == b"#01C1C0\r\n"
        for byte in b"$0140E2\x00\xff\r\n":
            os.write(ours, bytes([byte]))

    thread = threading.Thread(target=device)
    thread.start()
    told = heard_by(serial(path, say=(Say(b"#01C1C0\r\n", rb"\r\n", ENOUGH_S),)))
    thread.join()
    assert (told.trouble, told.words, told.data) == (None, "", b"$0140E2\x00\xff\r\n")
    assert settings(path) == before


def test_creator_of_a_pseudo_terminal_does_not_count_as_user(pair: tuple[int, str]) -> None:
    """A twin keeps its own end: from another process this must not look like somebody who has the port."""
    ours, path = pair
    os.write(ours, b"$GPGGA,1\r\n")
    told = asked_apart(serial(path, listen_s=ENOUGH_S, enough=rb"\n"))["it"]
    assert isinstance(told, Transcript)
    assert (told.trouble, told.data) == (None, b"$GPGGA,1\r\n")


def test_port_in_use_by_another_process_is_not_opened(pair: tuple[int, str]) -> None:
    ours, path = pair
    with other(HOLDS, path) as pid:
        before, name = settings(path), Path(f"/proc/{pid}/comm").read_text().strip()
        told = heard_by(serial(path, say=(Say(b"mine\n", b".", ENOUGH_S),)))
        assert settings(path) == before
    assert (told.trouble, told.data) == (Trouble.BUSY, b"")
    assert told.words == f"{path} is held by {name} (process {pid})"
    os.set_blocking(ours, False)
    with pytest.raises(
        OSError, match=r"error|unavailable"
    ):  # nothing was said: nobody has it open, or nothing is there to read
        os.read(ours, 100)


def test_locked_port_is_not_opened(pair: tuple[int, str]) -> None:
    with other(f"{LOCKS}; print('held', flush=True); input()", pair[1]) as pid:
        told = heard_by(serial(pair[1]))
    assert (told.trouble, told.words) == (Trouble.BUSY, f"{pair[1]} is locked by process {pid}")


def test_lock_file_counts_only_while_its_process_lives(
    pair: tuple[int, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(streams, "_LOCKS", (str(tmp_path),))
    lock = tmp_path / f"LCK..{Path(pair[1]).name}"
    lock.write_text("         1\n")
    assert heard_by(serial(pair[1])).words == f"{pair[1]} is locked by process 1"
    lock.write_text("4194399\n")  # above the largest number of a process
    assert heard_by(serial(pair[1])).trouble is None


def test_port_is_not_opened_if_its_user_cannot_be_determined(
    pair: tuple[int, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def hidden(_process: Path, _device: int) -> bool:
        raise PermissionError

    monkeypatch.setattr(streams, "_holds", hidden)
    assert heard_by(serial(pair[1])).trouble is None, "its own port"
    monkeypatch.setattr(os, "getuid", lambda: 54321)
    told = heard_by(serial(pair[1]))
    assert told.trouble is Trouble.DENIED
    assert told.words == f"only root sees whether another program holds {pair[1]}, so it was not opened"


@pytest.mark.parametrize(
    ("path", "baud", "words"),
    [
        ("/dev/ttyNONE9", 9600, "/dev/ttyNONE9: No such file or directory"),
        ("/dev/null", 9600, "/dev/null: Inappropriate ioctl for device"),
        ("/proc/version", 9600, "/proc/version is no serial port"),
        ("/dev/null", 12345, "/dev/null: no serial port does 12345 baud"),
    ],
)
def test_invalid_serial_port_is_reported(path: str, baud: int, words: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(streams, "_require_free_port", lambda *_: None)  # everybody has /dev/null open
    told = heard_by(serial(path, baud=baud))
    assert (told.trouble, told.words) == (Trouble.MISSING, words)


def test_unplugged_device_is_reported() -> None:
    ours, theirs = os.openpty()
    name = os.ttyname(theirs)
    os.close(theirs)

    def pull() -> None:
        spoken(ours)
        os.close(ours)

    thread = threading.Thread(target=pull)
    thread.start()
    told = heard_by(serial(name, say=(Say(b"?\n", b".", ENOUGH_S),), listen_s=ENOUGH_S))
    thread.join()
    assert (told.trouble, told.data) == (Trouble.CLOSED, b"")


def spoken(ours: int) -> bytes:
    """What is said to the device; a pseudo-terminal that nobody has open cannot be waited for."""
    while True:
        with suppress(OSError):
            return os.read(ours, 100)
        time.sleep(0.002)


def settings(path: str) -> list[Any]:
    port = os.open(path, os.O_RDWR | os.O_NOCTTY)
    try:
        return termios.tcgetattr(port)
    finally:
        os.close(port)
