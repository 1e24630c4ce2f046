"""TLS to a device whose certificate is self-signed: trust is the pinned fingerprint, never a chain."""

from __future__ import annotations

import hashlib
import socket
import ssl
from typing import TYPE_CHECKING

from atlantis_netcfg.routeros.api._errors import CertificateChanged, CertificateUnknown, Unreachable

if TYPE_CHECKING:
    import asyncio

    from atlantis_netcfg.routeros.api._values import Endpoint

__all__ = ["check_pin", "client_context", "fingerprint_of", "keep_alive"]

_COMPARE = "compare it with `fingerprint` in  /certificate print detail  on the device's own console (cable, Winbox)"


def client_context() -> ssl.SSLContext:
    """Make a context for TLS 1.2 or newer that takes any certificate, but never none (anonymous Diffie-Hellman)."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    context.set_ciphers("DEFAULT:!aNULL:!eNULL")
    return context


def fingerprint_of(endpoint: Endpoint, transport: asyncio.BaseTransport) -> str:
    """Return the SHA-256 of the certificate that the device showed, as RouterOS prints it. Raises Unreachable."""
    der: bytes | None = transport.get_extra_info("ssl_object").getpeercert(binary_form=True)
    if not der:
        raise Unreachable(f"{endpoint} showed no certificate")
    return hashlib.sha256(der).hexdigest()


def check_pin(endpoint: Endpoint, seen: str) -> None:
    """Compare certificate and pin. Raises CertificateUnknown without a pin, CertificateChanged if they differ."""
    if endpoint.pin is None:
        raise CertificateUnknown(
            f"{endpoint}: this device was never met before, so its certificate is not known; it showed {seen}",
            fingerprint=seen,
            hint=f"{_COMPARE}; if they are equal, pin {seen}",
        )
    pinned = endpoint.pin.replace(":", "").lower()
    if pinned != seen:
        raise CertificateChanged(
            f"{endpoint}: the certificate is not the one of this device; pinned is {pinned}, it showed {seen}",
            pinned=pinned,
            seen=seen,
            hint=f"{_COMPARE}; only if they are equal and the certificate was renewed on purpose, pin {seen} instead;"
            " a device that stands in for another one is met by `provision adopt … --replaced`",
        )


def keep_alive(transport: asyncio.BaseTransport) -> None:
    """Send small sentences at once, and notice a dead link within minutes, not within a gap of 70 s."""
    connection = transport.get_extra_info("socket")
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for option, value in (("TCP_KEEPIDLE", 60), ("TCP_KEEPINTVL", 30), ("TCP_KEEPCNT", 6)):
        if hasattr(socket, option):
            connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)
