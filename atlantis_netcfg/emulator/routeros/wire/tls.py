"""TLS of api-ssl without a socket, so that handshakes pass the emulated link; and the router's certificates."""

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
    """Converter between TCP bytes and API bytes."""

    def receive(self, wire: bytes) -> bytes:
        """Return the client's data. Raises ssl.SSLError if the session is broken, EOFError if it has ended."""

    def send(self, plain: bytes) -> bytes:
        """Return the TCP bytes that carry `plain`."""

    def flush(self) -> bytes:
        """Return further TCP bytes to send (the handshake)."""

    def close(self) -> bytes:
        """Return the closing TCP bytes."""


class Plain:
    """Channel of the service `api`."""

    def receive(self, wire: bytes) -> bytes:
        """Return the same bytes."""
        return wire

    def send(self, plain: bytes) -> bytes:
        """Return the same bytes."""
        return plain

    def flush(self) -> bytes:
        """Return nothing."""
        return b""

    def close(self) -> bytes:
        """Return nothing."""
        return b""


class Tls:
    """Channel of the service `api-ssl`."""

    def __init__(self, settings: ssl.SSLContext) -> None:
        self._in = ssl.MemoryBIO()
        self._out = ssl.MemoryBIO()
        self._tls = settings.wrap_bio(self._in, self._out, server_side=True)
        self._open = False

    def receive(self, wire: bytes) -> bytes:
        """Decrypt, continuing the handshake until it is complete."""
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
        """Return handshake messages and alerts."""
        return self._out.read()

    def close(self) -> bytes:
        """Return close_notify."""
        if self._open:
            with contextlib.suppress(ssl.SSLError):  # the client has not said it yet, and nobody waits for it
                self._tls.unwrap()
        return self._out.read()


def context(pem: Path | None, *, newest: str) -> ssl.SSLContext:
    """Return the settings of api-ssl; without a certificate, checking clients find no cipher (Manual, Services)."""
    settings = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    settings.minimum_version = ssl.TLSVersion.TLSv1_2
    settings.maximum_version = ssl.TLSVersion.TLSv1_3 if newest == "1.3" else ssl.TLSVersion.TLSv1_2
    if pem is not None:
        settings.load_cert_chain(pem)
    return settings


def certificate(folder: Path, name: str, *, common_name: str, address: str) -> Path:
    """Return the file with key and self-signed certificate `name`, created at first use."""
    path = folder / f"{hashlib.sha256(name.encode()).hexdigest()[:16]}.pem"
    if not path.exists():
        write_private(path, _issue(common_name, address))
    return path


def fingerprint(pem: Path) -> str:
    """Return the SHA-256 of the DER certificate in hex, which clients pin."""
    return x509.load_pem_x509_certificate(pem.read_bytes()).fingerprint(hashes.SHA256()).hex()


def _issue(common_name: str, address: str) -> bytes:
    """Return a new key and ten-year certificate as PEM."""
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
