"""Client of the RouterOS API: one asyncio session over api-ssl with a pinned certificate.

librouteros computes the length prefixes of words; the tagged multiplexer above it is ours. Many commands travel in one
write and cost one round trip, which matters on a link with a round trip of 700 ms. Added to librouteros: tags, TLS with
a pin that is checked before the login is sent, five-byte lengths, strings exactly as the device sent them (no casts, no
dropped bytes), timeouts on silence, memory limits, and counters of the bytes on the wire.
"""

from __future__ import annotations

from atlantis_netcfg.routeros.api._session import WINDOW, Session, certificate_of, shown_certificate
from atlantis_netcfg.routeros.api._tls import may_cut_off
from atlantis_netcfg.routeros.api._values import (
    READING_WINDOW,
    CertificateMismatch,
    CertificateUnknown,
    Command,
    CommandError,
    Endpoint,
    FellSilent,
    LoginError,
    ProtocolError,
    Reply,
    SessionLost,
    Traffic,
    Trap,
    Unreachable,
)

__all__ = [
    "READING_WINDOW",
    "WINDOW",
    "CertificateMismatch",
    "CertificateUnknown",
    "Command",
    "CommandError",
    "Endpoint",
    "FellSilent",
    "LoginError",
    "ProtocolError",
    "Reply",
    "Session",
    "SessionLost",
    "Traffic",
    "Trap",
    "Unreachable",
    "certificate_of",
    "may_cut_off",
    "shown_certificate",
]
