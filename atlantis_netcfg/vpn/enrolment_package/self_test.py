"""The self-test: its programs, the public facts about one member, and the faults that it recognises.

The patterns are those of openvpn 2.4 to 2.6 (its `src/openvpn/`). A server refuses a certificate silently (facts 7):
the text tells which causes cannot be distinguished. Placeholders: `{endpoint}`, `{proto}`, `{now}`, `{line}`.
"""

from __future__ import annotations

import hashlib
import json
from typing import TYPE_CHECKING, Any, NamedTuple

from atlantis_netcfg.inventory.model import Transport
from atlantis_netcfg.routeros.render import template_folder
from atlantis_netcfg.vpn.enrolment_package import page
from atlantis_netcfg.vpn.enrolment_package.profile import remote

if TYPE_CHECKING:
    from atlantis_netcfg.core.secret import Secret
    from atlantis_netcfg.inventory import Inventory
    from atlantis_netcfg.vpn.identity import Identity, Member


class SelfTestFault(NamedTuple):
    """A fault recognised by one log line."""

    pattern: str
    """Regular expression for `re`, searched for in a line."""
    what: str
    do: str


FAULTS = (
    SelfTestFault(
        r"Unrecognized option or missing",
        "this OpenVPN does not support a line of the profile: {line}",
        "Install OpenVPN 2.5 or later. If that is not possible, request an enrolment package for OpenVPN 2.4.",
    ),
    SelfTestFault(
        r"Cannot open TUN/TAP dev|Cannot ioctl TUNSETIFF|/dev/net/tun",
        "OpenVPN cannot open a tunnel device on this computer",
        "Run the test as root. In a container or virtual machine, the administrator must allow /dev/net/tun.",
    ),
    SelfTestFault(
        r"certificate is not yet valid",
        "the control centre's certificate is not yet valid according to this computer's clock ({now}): the clock is "
        "behind",
        "Set the clock and run the test again.",
    ),
    SelfTestFault(
        r"certificate has expired",
        "the control centre's certificate has expired according to this computer's clock ({now})",
        "Check the clock. If it is right, tell the control centre.",
    ),
    SelfTestFault(
        r"VERIFY (X509NAME )?ERROR|VERIFY KU ERROR|VERIFY EKU ERROR",
        "the server at {endpoint} does not present the control centre's certificate",
        "Do not use this network for the VPN. Tell the control centre which network it is.",
    ),
    SelfTestFault(
        r"AUTH_FAILED",
        "the control centre does not accept this device's certificate",
        "Usually it was revoked, or a newer one is in use. Use your newest enrolment package. If this is the "
        "newest, ask the control centre.",
    ),
    SelfTestFault(
        r"server-pushed-halt|Received control message: HALT",
        "the control centre has just closed this device's session",
        "Ask the control centre.",
    ),
    SelfTestFault(
        r"ECONNREFUSED|Connection refused",
        "{endpoint} refuses the connection: no server listens there, or a firewall rejects the packets",
        "The test cannot tell which. Try again in a few minutes, then from another network, then tell the control "
        "centre.",
    ),
    SelfTestFault(
        r"Network is unreachable|No route to host|ENETUNREACH|EHOSTUNREACH",
        "this computer has no route to {endpoint}",
        "Connect it to the internet and run the test again.",
    ),
    SelfTestFault(
        r"write UDP.*(Operation not permitted|Permission denied)|EPERM",
        "a firewall on this computer blocks the VPN's packets",
        "Allow {proto} to {endpoint}.",
    ),
    SelfTestFault(
        r"Cannot load|no start line|PEM_read|Insufficient key material|tls-crypt-v2 .*(error|fail)",
        "the profile is damaged: {line}",
        "Unpack the enrolment package again. If that does not help, request a new one.",
    ),
)
REFUSAL = (
    "{endpoint} sent a first response and then nothing more",
    (
        "Usually the server rejects this device's certificate: it was revoked or has expired, or one of the two "
        "clocks is wrong. Check this computer's clock ({now}). A network that drops large packets looks the "
        "same: try another network. Then ask the control centre."
    ),
)
"""Problem and correction if only a first reply came: the wrapping key is right, and the route is open."""
SILENCE = (
    "{endpoint} does not respond",
    (
        "The test cannot tell why: this network may block {proto} to {endpoint}, the control centre's server or "
        "its internet link may be down, or its key (tls-crypt) differs from your profile's. Try from another "
        "network, such as a telephone's. If it works there, ask the first network's administrator to allow "
        "{proto} to {endpoint}. If not, ask the control centre whether you need a new enrolment package."
    ),
)
"""Problem and correction if no reply came."""

_FEW = 3
"""Maximum number of computers that are pinged besides the server."""


def program(name: str) -> str:
    """Return a self-test, the same for all members: `self-test.py` (Python 3.8, standard library), or `self-test.ps1`.

    The second, for Windows PowerShell 5.1 and later, was never run, for lack of Windows and PowerShell. Tests check its
    syntax, and limit it to a short list of commands and types.
    """
    return (template_folder() / "handout" / name.replace("-", "_")).read_text(encoding="utf-8")


def facts(inventory: Inventory, identity: Identity, profile: Secret, file_name: str, contact: str) -> str:
    """Return the expected values for the self-test, as JSON; of the profile only its hash."""
    member, certificate, vpn = identity.member, identity.certificate, inventory.pilot.vpn
    values: dict[str, Any] = {
        "pilot": inventory.pilot.name,
        "name": member.name,
        "address": str(member.address),
        "endpoint": str(remote(inventory, member)),
        "port": vpn.port,
        "proto": "udp" if vpn.transport is Transport.UDP else "tcp",
        "server": str(page.tunnel_of_server(inventory)),
        "not_before": int(certificate.not_before.timestamp()),
        "not_after": int(certificate.not_after.timestamp()),
        "wrap": str(certificate.wrap),
        "profile": file_name,
        "profile_sha256": hashlib.sha256(profile.reveal().encode()).hexdigest(),
        "wait_s": page.WAIT_S[member.link],
        "ping": _find_ping_targets(inventory, member),
        "dds_port": page.dds_port(inventory, member),
        "contact": contact,
        "faults": [list(item) for item in FAULTS],
        "refused": list(REFUSAL),
        "silence": list(SILENCE),
    }
    return json.dumps(values, indent=1, ensure_ascii=False) + "\n"


def _find_ping_targets(inventory: Inventory, member: Member) -> list[list[str]]:
    """Return our computers that reply to pings, except the server, which is tested first."""
    server = page.tunnel_of_server(inventory)
    name_by_address = {
        address: name
        for item in page.reach(inventory, member)
        if item.ping
        for name, address in item.hosts
        if address not in {server, member.address}
    }
    return [[name, str(address)] for address, name in list(name_by_address.items())[:_FEW]]
