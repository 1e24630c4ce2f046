"""The self-test and what it has to know: public facts of one member, in a file beside it."""

from __future__ import annotations

import hashlib
import json
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.declaration.model import Transport
from atlantis_netcfg.render import template_folder
from atlantis_netcfg.vpn.enrolment_package._faults import FAULTS, REFUSED, SILENCE
from atlantis_netcfg.vpn.enrolment_package._profile import remote
from atlantis_netcfg.vpn.enrolment_package._reach import dds_port, reach, tunnel_of_server
from atlantis_netcfg.vpn.identity import Link

if TYPE_CHECKING:
    from atlantis_netcfg.core.secret import Secret
    from atlantis_netcfg.declaration import Declaration
    from atlantis_netcfg.vpn.identity import Identity, Member

__all__ = ["facts", "program"]

_WAIT_S = {Link.FIBRE: 20, Link.LTE: 40, Link.SATELLITE: 120}
"""How long the tunnel may take; by satellite it was seen up in 4 to 35 s (facts 9)."""
_FEW = 3
"""Computers that are pinged besides the server."""


def program() -> str:
    """The text of the self-test, the same for all members: Python 3.8, standard library alone."""
    return (template_folder() / "handout" / "self_test.py").read_text(encoding="utf-8")


def facts(declaration: Declaration, identity: Identity, profile: Secret, file_name: str, contact: str) -> str:
    """What the self-test compares with, as JSON; of the profile only its hash."""
    member, certificate, vpn = identity.member, identity.certificate, declaration.pilot.vpn
    values: dict[str, Any] = {
        "pilot": declaration.pilot.name,
        "name": member.name,
        "address": str(member.address),
        "endpoint": str(remote(declaration, member)),
        "port": vpn.port,
        "proto": "udp" if vpn.transport is Transport.UDP else "tcp",
        "server": str(tunnel_of_server(declaration)),
        "not_before": int(certificate.not_before.timestamp()),
        "not_after": int(certificate.not_after.timestamp()),
        "wrap": str(certificate.wrap),
        "profile": file_name,
        "profile_sha256": hashlib.sha256(profile.reveal().encode()).hexdigest(),
        "wait_s": _WAIT_S[member.link],
        "ping": _pinged(declaration, member),
        "dds_port": dds_port(declaration, member),
        "contact": contact,
        "faults": [list(item) for item in FAULTS],
        "refused": list(REFUSED),
        "silence": list(SILENCE),
    }
    return json.dumps(values, indent=1, ensure_ascii=False) + "\n"


def _pinged(declaration: Declaration, member: Member) -> list[list[str]]:
    """Computers of ours that answer pings, the server aside: it is asked first."""
    server = tunnel_of_server(declaration)
    found = {
        address: name
        for item in reach(declaration, member)
        if item.ping
        for name, address in item.hosts
        if address not in {server, member.address}
    }
    return [[name, str(address)] for address, name in list(found.items())[:_FEW]]
