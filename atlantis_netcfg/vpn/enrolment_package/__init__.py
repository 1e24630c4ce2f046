"""The one file that a member gets: its profile, its page of instructions and its self-test, sealed for it alone.

What is inside is a pure function of the declaration, of the identity and of whom to call: its page, its profile and its
test cannot say different things. It exists in memory only, until it is sealed: no step writes a secret to a disk. It is
read back by the same package (`accept`), so that a declared host takes the way of every partner.
"""

from __future__ import annotations

from atlantis_netcfg.vpn.enrolment_package._accept import Accepted, accept, host_identity
from atlantis_netcfg.vpn.enrolment_package._archive import NotAHandOut
from atlantis_netcfg.vpn.enrolment_package._handout import HandOut, contents, handout, open_handout
from atlantis_netcfg.vpn.enrolment_package._identity import NotAnIdentity, identity_file, inline, read_identity
from atlantis_netcfg.vpn.enrolment_package._profile import profile, server_name
from atlantis_netcfg.vpn.enrolment_package._sealed import OneTimePassphrase, Recipient, Sealing, WrongKey

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
