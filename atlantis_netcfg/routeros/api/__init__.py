"""The wire to a RouterOS device: one asyncio session over api-ssl with a pinned certificate.

The protocol layer of librouteros (lengths of words) under a tagged multiplexer of ours: a window of commands travels in
one write and costs one round trip, which is what counts on a link of 700 ms. Added to librouteros: tags, TLS with a pin
that is checked before the login is sent, five-byte lengths, strings kept as the device has them (nothing is cast, no
byte dropped), time-outs by silence, limits on memory, counters of what the wire carries.
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
