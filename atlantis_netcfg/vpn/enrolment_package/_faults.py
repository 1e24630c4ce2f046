"""What openvpn says where it does not connect, in words for whoever stands before it: rows that the self-test carries.

The words searched for are those of openvpn 2.4 to 2.6 (its `src/openvpn/`). A server refuses a certificate by silence
(facts 7), so that what cannot be told apart is said to be so. Filled in: `{endpoint}`, `{proto}`, `{now}`, `{line}`.
"""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["FAULTS", "REFUSED", "SILENCE", "Fault"]


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
