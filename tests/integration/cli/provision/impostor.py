"""Who else may answer at a device's address: one who only listens, and one who puts hostile text into every answer."""

import datetime as dt
import hashlib
import socket
import ssl
import threading
import unicodedata
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from cryptography.x509.oid import NameOID

from atlantis_netcfg.routeros.api._tls import client_context
from atlantis_netcfg.routeros.api._wire import Decoder, encode

Answer = Callable[[tuple[str, ...]], tuple[str, ...]]

HOSTILE = "evil\x1b]0;owned\x07\x1b[2J\u202e\x9b31m\u2066\n\tevil\r\x7f\u200f\u2028evil"
"""A window's title, a cleared screen, text that runs backwards, C1, and line ends that would be lines of ours."""


def control_characters(text: str) -> list[str]:
    """What a terminal would obey, or what turns or hides text; a line feed is the layout's."""
    return sorted({ascii(one) for one in text if one != "\n" and unicodedata.category(one) in {"Cc", "Cf", "Zl", "Zp"}})


def fake_lines(text: str) -> list[str]:
    """Lines that a device has begun."""
    return [line for line in text.split("\n") if line.startswith("evil")]


@dataclass
class Impostor:
    """A TLS server with a certificate of its own."""

    port: int
    fingerprint: str
    heard: bytearray = field(default_factory=bytearray)
    """What came after the handshakes."""
    handshakes: int = 0


@contextmanager
def impostor(folder: Path) -> Iterator[Impostor]:
    """Answer TLS, and remember what is told."""
    heard = bytearray()

    def listen(tls: ssl.SSLSocket) -> None:
        while data := tls.recv(65536):
            heard.extend(data)

    with served(folder, listen) as who:
        who.heard = heard
        yield who


@contextmanager
def hostile(folder: Path, twin: int, answer: Answer) -> Iterator[Impostor]:
    """Stand before a twin, with each sentence of its answers changed by `answer`."""

    def relay(tls: ssl.SSLSocket) -> None:
        with socket.create_connection(("127.0.0.1", twin)) as raw, client_context().wrap_socket(raw) as wire:
            back = threading.Thread(target=_back, args=(wire, tls, answer), daemon=True)
            back.start()
            with suppress(OSError):
                while data := tls.recv(65536):
                    wire.sendall(data)
            with suppress(OSError):
                wire.shutdown(socket.SHUT_RDWR)
            back.join()

    with served(folder, relay) as who:
        yield who


def _back(wire: ssl.SSLSocket, tls: ssl.SSLSocket, answer: Answer) -> None:
    decoder = Decoder()
    with suppress(OSError):
        while data := wire.recv(65536):
            tls.sendall(b"".join(encode(answer(words)) for words in decoder.feed(data)))
        tls.shutdown(socket.SHUT_RDWR)


def in_every(*names: str) -> Answer:
    """Hostile text behind every value of these names; behind every value where none is named."""

    def answer(words: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(
            f"{word}{HOSTILE}" if word.startswith("=") and _meant(word[1:].partition("=")[0], names) else word
            for word in words
        )

    return answer


def _meant(name: str, names: tuple[str, ...]) -> bool:
    return name in names if names else name not in {".id", "ret"}


def leaving_out(*names: str) -> Answer:
    """Rows in which these attributes are missing; empty rows where none is named."""

    def answer(words: tuple[str, ...]) -> tuple[str, ...]:
        if words[0] != "!re":
            return words
        return tuple(
            word for word in words if not word.startswith("=") or (names and word[1:].partition("=")[0] not in names)
        )

    return answer


def refusing(words: tuple[str, ...]) -> tuple[str, ...]:
    """Refuse everything, in hostile words."""
    tag = [word for word in words if word.startswith(".tag=")]
    return ("!trap", f"=message=no {HOSTILE}", *tag) if words[0] == "!re" else (f"{words[0]}", f"=ret={HOSTILE}", *tag)


def refused_login(_words: tuple[str, ...]) -> tuple[str, ...]:
    """Refuse the login, in hostile words, and end it."""
    return ("!fatal", f"no {HOSTILE}")


@contextmanager
def served(folder: Path, serve: Callable[[ssl.SSLSocket], None]) -> Iterator[Impostor]:
    """Meet everybody with a certificate of our own, each in a thread."""
    context, fingerprint = _context(folder)
    with socket.create_server(("127.0.0.1", 0)) as server:
        who = Impostor(server.getsockname()[1], fingerprint)

        def meet(raw: socket.socket) -> None:
            with raw, suppress(OSError), context.wrap_socket(raw, server_side=True) as tls:
                who.handshakes += 1
                serve(tls)

        def accept() -> None:
            with suppress(OSError):
                while True:
                    raw, _ = server.accept()
                    threading.Thread(target=meet, args=(raw,), daemon=True).start()

        thread = threading.Thread(target=accept, daemon=True)
        thread.start()
        try:
            yield who
        finally:
            server.shutdown(socket.SHUT_RDWR)
            thread.join()


def _context(folder: Path) -> tuple[ssl.SSLContext, str]:
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "impostor")])
    now = dt.datetime.now(dt.UTC)
    made = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - dt.timedelta(days=1))
        .not_valid_after(now + dt.timedelta(days=1))
        .sign(key, hashes.SHA256())
    )
    file = folder / "impostor.pem"
    private = key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    file.write_bytes(made.public_bytes(Encoding.PEM) + private)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(file)
    return context, hashlib.sha256(made.public_bytes(Encoding.DER)).hexdigest()
