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
        "this OpenVPN does not know a word of the profile: {line}",
        "Install OpenVPN 2.5 or later. Where that cannot be, ask for a hand-out for OpenVPN 2.4.",
    ),
    SelfTestFault(
        r"Cannot open TUN/TAP dev|Cannot ioctl TUNSETIFF|/dev/net/tun",
        "this computer gives OpenVPN no tunnel device",
        "Run the test as root. In a container or virtual machine its administrator has to allow /dev/net/tun.",
    ),
    SelfTestFault(
        r"certificate is not yet valid",
        "by this computer's clock ({now}) the control centre's certificate is not yet valid: the clock is behind",
        "Set the clock, then run the test again.",
    ),
    SelfTestFault(
        r"certificate has expired",
        "by this computer's clock ({now}) the control centre's certificate has expired",
        "Look whether the clock is right. If it is, tell the control centre.",
    ),
    SelfTestFault(
        r"VERIFY (X509NAME )?ERROR|VERIFY KU ERROR|VERIFY EKU ERROR",
        "what answers at {endpoint} does not show the certificate of the control centre's server",
        "Do not use this network for the VPN, and tell the control centre what network it is.",
    ),
    SelfTestFault(
        r"AUTH_FAILED",
        "the control centre does not admit this device's certificate",
        "Most often it was revoked, or a newer one is in use. Use your newest hand-out. If this is the newest, ask the "
        "control centre.",
    ),
    SelfTestFault(
        r"server-pushed-halt|Received control message: HALT",
        "the control centre has just ended this device's session",
        "Ask the control centre.",
    ),
    SelfTestFault(
        r"ECONNREFUSED|Connection refused",
        "what is sent to {endpoint} is refused at once: nobody listens there, or a firewall refuses it",
        "From here it cannot be told which. Try again in some minutes, then from another network, then tell the "
        "control centre.",
    ),
    SelfTestFault(
        r"Network is unreachable|No route to host|ENETUNREACH|EHOSTUNREACH",
        "this computer has no way to {endpoint}",
        "Connect it to the internet, then run the test again.",
    ),
    SelfTestFault(
        r"write UDP.*(Operation not permitted|Permission denied)|EPERM",
        "a firewall on this computer forbids what the VPN sends",
        "Allow {proto} to {endpoint}.",
    ),
    SelfTestFault(
        r"Cannot load|no start line|PEM_read|Insufficient key material|tls-crypt-v2 .*(error|fail)",
        "the profile is damaged: {line}",
        "Unpack the hand-out again. If that does not help, ask for a new one.",
    ),
)
REFUSAL = (
    "a first answer came from {endpoint}, and then nothing more",
    (
        "Most often the server does not take this device's certificate: it was revoked or has expired, or one of the "
        "two clocks is wrong. Look at this computer's ({now}). A network that loses large packets looks the same: try "
        "another one. Then ask the control centre."
    ),
)
"""Problem and correction if only a first reply came: the wrapping key is right, and the route is open."""
SILENCE = (
    "nothing comes back from {endpoint}",
    (
        "From here it cannot be told which it is: the network that you are in lets no {proto} to {endpoint} pass, or "
        "the control centre's server or its line is down, or it has another key (tls-crypt) than your profile. Try "
        "from another network, such as a telephone's. If it works there, ask the first one's administrator to allow "
        "{proto} to {endpoint}. If not, ask the control centre, and whether you need a new hand-out."
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
