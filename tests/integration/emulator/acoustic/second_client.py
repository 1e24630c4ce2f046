"""A second, small client for each language, written from devices.md and nothing of ours, to hold the twins to it."""

import binascii
import socket
from typing import Self


class Wire:
    """A connection whose bytes are taken one by one."""

    def __init__(self, host: str, port: int) -> None:
        self._sock = socket.create_connection((host, port), timeout=5)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._sock.close()

    def send(self, data: bytes) -> None:
        self._sock.sendall(data)

    def byte(self) -> bytes:
        """The next one; b"" at the end."""
        return self._sock.recv(1)

    def exactly(self, count: int) -> bytes:
        return b"".join(self.byte() for _ in range(count))

    def upto(self, end: bytes) -> bytes:
        heard = b""
        while not heard.endswith(end):
            one = self.byte()
            if not one:
                raise EOFError(heard)
            heard += one
        return heard.removesuffix(end)


class AtClient(Wire):
    """AT in data mode: counts the bytes that a frame announces."""

    def frame(self) -> tuple[str, bytes]:
        """The next frame; whatever comes before it is dropped."""
        self.upto(b"+++AT")
        command = "AT" + self.upto(b":").decode()
        body = self.exactly(int(self.upto(b":")))
        assert self.exactly(2) == b"\r\n", "a frame ends with its line"
        return command, body

    def ask(self, command: str) -> bytes:
        """The answer to a command, past what comes unasked."""
        self.send(f"+++{command}\n".encode())
        while True:
            answered, body = self.frame()
            if answered == command.partition(",")[0]:
                return body

    def wait(self, keyword: str) -> list[str]:
        """The fields of the next notification of a family."""
        while True:
            command, body = self.frame()
            if command == "AT" and body.startswith(keyword.encode()):
                return body.decode("latin-1").split(",")


def crc16(data: bytes) -> int:
    """CRC-16 with 0x8005 by long division of mirrored bits, as a textbook has it."""
    bits = "".join(f"{byte:08b}"[::-1] for byte in data) + "0" * 16
    rest = int(bits, 2)
    for place in range(len(bits) - 17, -1, -1):
        if rest >> (place + 16) & 1:
            rest ^= 0x18005 << place
    return int(f"{rest:016b}"[::-1], 2)


class BeaconClient(Wire):
    """Frames in ASCII-hex."""

    def order(self, number: int, record: bytes = b"", *, spoilt: int = 0) -> None:
        payload = bytes([number]) + record
        check = crc16(payload) ^ spoilt
        self.send(b"#" + binascii.hexlify(payload).upper() + f"{check & 0xFF:02X}{check >> 8:02X}".encode() + b"\n\r")

    def frame(self) -> tuple[int, bytes]:
        """Number and record of the next answer; its sum has to be right."""
        self.upto(b"$")
        raw = binascii.unhexlify(self.upto(b"\r"))
        assert crc16(raw[:-2]) == raw[-2] | raw[-1] << 8
        return raw[0], raw[1:-2]

    def wait(self, number: int) -> bytes:
        while True:
            heard, record = self.frame()
            if heard == number:
                return record
