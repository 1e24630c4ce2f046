"""The one file that a member gets: its profile, its page of instructions and its self-test, sealed for it alone.

A hand-out is a pure function of the declaration and of the identity, so that what was handed out can be told from its
hash. It exists in memory only, until it is sealed: no step writes a secret to a disk. What is in it is read back by the
same package (`accept`), so that a declared host takes the way of every partner.
"""

from __future__ import annotations

from atlantis_netcfg.vpn.handout._identity import NotAnIdentity, identity_file, inline, read_identity
from atlantis_netcfg.vpn.handout._profile import profile, server_name

__all__ = ["NotAnIdentity", "identity_file", "inline", "profile", "read_identity", "server_name"]
