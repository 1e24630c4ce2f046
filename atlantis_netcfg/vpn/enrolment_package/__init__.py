"""The one file that a member gets: its profile, its page of instructions and its self-test, sealed for it alone.

The content is a pure function of the declaration, the identity and the contact: page, profile and test cannot disagree.
It exists in memory only until it is sealed: no step writes a secret to a disk. The same package reads it back
(`accept`), so that a declared host takes the same path as every partner.
"""

from __future__ import annotations

from atlantis_netcfg.vpn.enrolment_package.package import (
    Accepted,
    HandOut,
    NotAHandOut,
    OneTimePassphrase,
    Recipient,
    Sealing,
    WrongKey,
    accept,
    contents,
    handout,
    host_identity,
    open_handout,
)
from atlantis_netcfg.vpn.enrolment_package.profile import (
    NotAnIdentity,
    identity_file,
    inline,
    profile,
    read_identity,
    server_name,
)

__all__ = [
    "Accepted",
    "HandOut",
    "NotAHandOut",
    "NotAnIdentity",
    "OneTimePassphrase",
    "Recipient",
    "Sealing",
    "WrongKey",
    "accept",
    "contents",
    "handout",
    "host_identity",
    "identity_file",
    "inline",
    "open_handout",
    "profile",
    "read_identity",
    "server_name",
]
