"""The self-test, the public facts about one member that it needs, and the faults that it recognises.

The patterns are those of openvpn 2.4 to 2.6 (its `src/openvpn/`). A server refuses a certificate by silence (facts 7):
where causes cannot be told apart, the text says so. Filled in: `{endpoint}`, `{proto}`, `{now}`, `{line}`.
"""

from __future__ import annotations

import hashlib
import json
from typing import TYPE_CHECKING, Any, NamedTuple

from atlantis_netcfg.declaration.model import Transport
from atlantis_netcfg.render import template_folder
from atlantis_netcfg.vpn.enrolment_package.profile import remote
from atlantis_netcfg.vpn.enrolment_package.reachability import dds_port, reach, tunnel_of_server
from atlantis_netcfg.vpn.identity import Link

if TYPE_CHECKING:
    from atlantis_netcfg.core.secret import Secret
    from atlantis_netcfg.declaration import Declaration
    from atlantis_netcfg.vpn.identity import Identity, Member


class Fault(NamedTuple):
    """A fault that one line tells."""

    pattern: str
    """What is searched for in a line, for `re`."""
    what: str
    do: str


FAULTS = (
    Fault(
        r"Unrecognized option or missing",
        "this OpenVPN does not know a word of the profile: {line}",
        "Install OpenVPN 2.5 or later. Where that cannot be, ask for a hand-out for OpenVPN 2.4.",
    ),
    Fault(
        r"Cannot open TUN/TAP dev|Cannot ioctl TUNSETIFF|/dev/net/tun",
        "this computer gives OpenVPN no tunnel device",
        "Run the test as root. In a container or virtual machine its administrator has to allow /dev/net/tun.",
    ),
    Fault(
        r"certificate is not yet valid",
        "by this computer's clock ({now}) the control centre's certificate is not yet valid: the clock is behind",
        "Set the clock, then run the test again.",
    ),
    Fault(
        r"certificate has expired",
        "by this computer's clock ({now}) the control centre's certificate has expired",
        "Look whether the clock is right. If it is, tell the control centre.",
    ),
    Fault(
        r"VERIFY (X509NAME )?ERROR|VERIFY KU ERROR|VERIFY EKU ERROR",
        "what answers at {endpoint} is not the control centre's server",
        "Do not use this network for the VPN, and tell the control centre what network it is.",
    ),
    Fault(
        r"AUTH_FAILED",
        "the control centre does not admit this device's certificate: it was revoked, or a newer one is in use",
        "Use your newest hand-out. If this is the newest, ask the control centre.",
    ),
    Fault(
        r"server-pushed-halt|Received control message: HALT",
        "the control centre has just ended this device's session",
        "Ask the control centre.",
    ),
    Fault(
        r"ECONNREFUSED|Connection refused",
        "the control centre's computer answers, and its VPN server does not run",
        "Try again in some minutes, then tell the control centre.",
    ),
    Fault(
        r"Network is unreachable|No route to host|ENETUNREACH|EHOSTUNREACH",
        "this computer has no way to {endpoint}",
        "Connect it to the internet, then run the test again.",
    ),
    Fault(
        r"write UDP.*(Operation not permitted|Permission denied)|EPERM",
        "a firewall on this computer forbids what the VPN sends",
        "Allow {proto} to {endpoint}.",
    ),
    Fault(
        r"Cannot load|no start line|PEM_read|Insufficient key material|tls-crypt-v2 .*(error|fail)",
        "the profile is damaged: {line}",
        "Unpack the hand-out again. If that does not help, ask for a new one.",
    ),
)
REFUSED = (
    "the control centre answers, and then says nothing more: it does not take this device's certificate",
    (
        "It was revoked or has expired, or one of the two clocks is wrong. Look at this computer's ({now}), then ask "
        "the control centre."
    ),
)
"""What is wrong and what to do where a first answer came: the key that wraps is right, and the way is open."""
SILENCE = (
    "nothing comes back from {endpoint}",
    (
        "From here it cannot be told which it is: the network that you are in lets no {proto} to {endpoint} pass, or "
        "the control centre's server or its line is down, or it has another key (tls-crypt) than your profile. Try "
        "from another network, such as a telephone's. If it works there, ask the first one's administrator to allow "
        "{proto} to {endpoint}. If not, ask the control centre, and whether you need a new hand-out."
    ),
)
"""The same where nothing came."""

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
