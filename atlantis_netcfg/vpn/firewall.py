"""The server's firewall: the policy in nftables' words, as one file that is loaded whole or not at all.

Running connections are not asked for: each packet stands for itself, and only the answers of services are known by the
connection that they belong to. What the policy permits no longer is therefore cut as soon as the file is loaded.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from atlantis_netcfg.render import environment
from atlantis_netcfg.vpn.policy import ANYTHING, Protocol, policy

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.declaration import Declaration
    from atlantis_netcfg.vpn.identity import MembershipList
    from atlantis_netcfg.vpn.policy import Permission, Policy, Traffic

TABLE = "p_atlantis_vpn"
"""Of family inet."""
ADMITTED = "p_members"
"""The set without which nothing passes: an element that is taken out of it has no traffic from then on."""
_PING = "icmp type { echo-request, echo-reply }"
_ANSWER = "ct state established ct direction reply"


def firewall(declaration: Declaration, membership: MembershipList) -> str:
    """What `nft -f` loads, atomically and as often as one likes."""
    return text(policy(declaration, membership))


def text(matrix: Policy) -> str:
    """The same of a policy."""
    return (
        environment()
        .get_template("openvpn/vpn.nft.j2")
        .render(
            zones=matrix.zones,
            forward=[line for item in matrix.permissions for line in _forward(item)],
            input=[line for permission in matrix.permissions for line in _input(permission)],
        )
    )


def _forward(permission: Permission) -> Iterator[str]:
    """What passes the server."""
    if permission.source is None or permission.destination is None:
        return
    source, destination = permission.source.name, permission.destination.name
    yield f"ip saddr @{source} ip daddr @{destination} {_match(permission.traffic)}accept {_comment(permission.why)}"
    if permission.traffic.ports is not None:
        answer = f"{permission.traffic.protocol} sport {_ports(permission.traffic.ports)} {_ANSWER}"
        yield f"ip saddr @{destination} ip daddr @{source} {answer} accept {_comment('its answers')}"
    elif permission.traffic == ANYTHING and source != destination:
        yield f"ip saddr @{destination} ip daddr @{source} {_ANSWER} accept {_comment('its answers')}"


def _input(permission: Permission) -> Iterator[str]:
    """What the server receives; of pings it has only questions to expect, as answers are known by theirs."""
    if permission.source is not None and permission.destination is None:
        match = (
            "icmp type echo-request " if permission.traffic.protocol is Protocol.ICMP else _match(permission.traffic)
        )
        yield f"ip saddr @{permission.source.name} {match}accept {_comment(permission.why)}"


def _match(traffic: Traffic) -> str:
    """Either nothing, or words and a space."""
    if traffic.protocol is None:
        return ""
    if traffic.ports is None:
        return f"{_PING} " if traffic.protocol is Protocol.ICMP else f"meta l4proto {traffic.protocol} "
    return f"{traffic.protocol} dport {_ports(traffic.ports)} "


def _ports(ports: range) -> str:
    return str(ports[0]) if len(ports) == 1 else f"{ports[0]}-{ports[-1]}"


def _comment(why: str) -> str:
    """For people: a name of the inventory may hold what ends a string here, and nftables keeps 128 bytes."""
    return f'comment "{re.sub(r"[^A-Za-z0-9 ,.:?-]", "_", why)[:60]}"'
