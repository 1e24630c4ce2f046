"""TLS of api-ssl without a socket, so that its handshake travels the shaped link too; and the twin's certificates."""

from __future__ import annotations

import contextlib
import hashlib
import ssl
from datetime import UTC, datetime, timedelta
from ipaddress import IPv4Address
from typing import TYPE_CHECKING, Protocol

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from cryptography.x509.oid import NameOID

from atlantis_netcfg.core.paths import write_private

if TYPE_CHECKING:
    from pathlib import Path


class ByteChannel(Protocol):
    """What lies between the bytes of TCP and the words of the API."""

    def receive(self, wire: bytes) -> bytes:
        """What the client said; raises ssl.SSLError if the conversation cannot go on, EOFError if it ended."""

    def send(self, plain: bytes) -> bytes:
        """What TCP has to carry so that the client hears `plain`."""

    def flush(self) -> bytes:
        """What TCP has to carry besides (the handshake)."""

    def close(self) -> bytes:
        """The farewell."""


class Plain:
    """Service `api`."""

    def receive(self, wire: bytes) -> bytes:
        """The same bytes."""
        return wire

    def send(self, plain: bytes) -> bytes:
        """The same bytes."""
        return plain

    def flush(self) -> bytes:
        """Nothing."""
        return b""

    def close(self) -> bytes:
        """Nothing."""
        return b""


class Tls:
    """Service `api-ssl`."""

    def __init__(self, settings: ssl.SSLContext) -> None:
        self._in = ssl.MemoryBIO()
        self._out = ssl.MemoryBIO()
        self._tls = settings.wrap_bio(self._in, self._out, server_side=True)
        self._open = False

    def receive(self, wire: bytes) -> bytes:
        """Decrypt, and go on with the handshake until it is done."""
        self._in.write(wire)
        plain = bytearray()
        try:
            if not self._open:
                self._tls.do_handshake()
                self._open = True
            while piece := self._tls.read(65536):
                plain += piece
        except ssl.SSLWantReadError:
            return bytes(plain)
        if plain:
            return bytes(plain)
        raise EOFError

    def send(self, plain: bytes) -> bytes:
        """Encrypt."""
        self._tls.write(plain)
        return self._out.read()

    def flush(self) -> bytes:
        """Handshake messages and alerts."""
        return self._out.read()

    def close(self) -> bytes:
        """close_notify."""
        if self._open:
            with contextlib.suppress(ssl.SSLError):  # the client has not said it yet, and nobody waits for it
                self._tls.unwrap()
        return self._out.read()


def context(pem: Path | None, *, newest: str) -> ssl.SSLContext:
    """Settings of api-ssl; without a certificate no client that checks one finds a common cipher (Manual, Services)."""
    settings = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    settings.minimum_version = ssl.TLSVersion.TLSv1_2
    settings.maximum_version = ssl.TLSVersion.TLSv1_3 if newest == "1.3" else ssl.TLSVersion.TLSv1_2
    if pem is not None:
        settings.load_cert_chain(pem)
    return settings


def certificate(folder: Path, name: str, *, common_name: str, address: str) -> Path:
    """The file with key and self-signed certificate called `name`; made when it is first needed, and kept."""
    path = folder / f"{hashlib.sha256(name.encode()).hexdigest()[:16]}.pem"
    if not path.exists():
        write_private(path, _issue(common_name, address))
    return path


def fingerprint(pem: Path) -> str:
    """SHA-256 of the DER certificate in hex: what a client pins."""
    return x509.load_pem_x509_certificate(pem.read_bytes()).fingerprint(hashes.SHA256()).hex()


def _issue(common_name: str, address: str) -> bytes:
    """PEM text of a new key and its certificate for ten years."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])
    names = x509.SubjectAlternativeName([x509.DNSName(common_name), x509.IPAddress(IPv4Address(address))])
    start = datetime.now(UTC) - timedelta(days=1)
    cert = (
        x509.CertificateBuilder(issuer_name=name, subject_name=name, public_key=key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(start)
        .not_valid_after(start + timedelta(days=3650))
        .add_extension(names, critical=False)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .sign(key, hashes.SHA256())
    )
    secret = key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    return secret + cert.public_bytes(Encoding.PEM)
