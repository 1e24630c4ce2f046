"""The address, in the language of whatever configures the network of the image."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.image._errors import ImageRefused
from atlantis_netcfg.image.edits import Directory, File, Link, Remove

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.image.edits import Edit
    from atlantis_netcfg.image.wish import Seen, Static, Wish

__all__ = ["IFUPDOWN", "NETPLAN", "NETWORKD", "NETWORK_MANAGER", "PATHS", "RESOLVED", "network"]

NETPLAN, IFUPDOWN = "/usr/sbin/netplan", "/usr/sbin/ifup"
_IFUPDOWN_OLD = "/sbin/ifup"
NETWORK_MANAGER = "/usr/sbin/NetworkManager"
NETWORKD, RESOLVED = "/lib/systemd/systemd-networkd", "/lib/systemd/systemd-resolved"
_PLANS, _PROFILES = "/etc/netplan", "/etc/NetworkManager/system-connections"
_PLAN = "10-atlantis.yaml"
_PARTS = "/etc/systemd/network"
_WANTS = "/etc/systemd/system/multi-user.target.wants"
_RESOLV = "/etc/resolv.conf"
PATHS = (
    NETPLAN,
    IFUPDOWN,
    _IFUPDOWN_OLD,
    NETWORK_MANAGER,
    NETWORKD,
    RESOLVED,
    _PLANS,
    _PROFILES,
    _PARTS,
    _WANTS,
    _RESOLV,
)
"""What the planner asks about."""
_SAID = "# Written by `provision image`."


def network(seen: Seen, request: Wish) -> Iterator[Edit]:
    """One wired interface, with a fixed address or DHCP. Raises ImageRefused where nothing would configure it."""
    if NETPLAN in seen.present:
        others = (name for name in seen.listed.get(_PLANS, ()) if name.endswith(".yaml") and name != _PLAN)
        yield from (Remove(f"{_PLANS}/{name}") for name in others)
        yield from _folder(seen, _PLANS)
        yield File(f"{_PLANS}/{_PLAN}", _netplan(request).encode(), 0o600)
    elif {IFUPDOWN, _IFUPDOWN_OLD} & seen.present:
        if not request.interface:
            raise ImageRefused(
                "the image configures its network by ifupdown, which needs the interface's name",
                hint="declare `interface` of the host's image, like eth0",
            )
        yield File("/etc/network/interfaces", _interfaces(request).encode())
    elif NETWORK_MANAGER in seen.present:
        yield from _folder(seen, _PROFILES)
        yield File(f"{_PROFILES}/atlantis.nmconnection", _profile(request).encode(), 0o600)
    elif NETWORKD in seen.present:
        yield from _folder(seen, _PARTS)
        yield from _folder(seen, _WANTS)
        yield File(f"{_PARTS}/05-atlantis.network", _networkd(request).encode())
        yield Link(
            f"{_WANTS}/systemd-networkd.service", f"{NETWORKD.rpartition('/')[0]}/system/systemd-networkd.service"
        )
    else:
        raise ImageRefused(
            "nothing in the image would set its address: no netplan, ifupdown, NetworkManager or systemd-networkd"
        )
    if request.static is not None and RESOLVED not in seen.present and NETWORK_MANAGER not in seen.present:
        yield File(_RESOLV, f"{_SAID}\nsearch {request.static.domain}\nnameserver {request.static.gateway}\n".encode())


def _folder(seen: Seen, path: str) -> Iterator[Edit]:
    if path not in seen.present:
        yield Directory(path)


def _netplan(request: Wish) -> str:
    rows = [_SAID, "network:", "  version: 2", "  ethernets:", "    lan:", f"      match: {{name: {_match(request)}}}"]
    if request.static is None:
        rows.append("      dhcp4: true")
    else:
        rows += [
            "      dhcp4: false",
            f"      addresses: [{request.static.address}]",
            f"      routes: [{{to: 0.0.0.0/0, via: {request.static.gateway}}}]",
            f"      nameservers: {{addresses: [{request.static.gateway}], search: [{request.static.domain}]}}",
        ]
    return "".join(f"{row}\n" for row in rows)


def _match(request: Wish) -> str:
    return request.interface or '"e*"'


def _interfaces(request: Wish) -> str:
    name = request.interface
    start = f"{_SAID}\nauto lo\niface lo inet loopback\n\nallow-hotplug {name}\n"
    if request.static is None:
        return f"{start}iface {name} inet dhcp\n"
    return (
        f"{start}iface {name} inet static\n"
        f"    address {request.static.address}\n    gateway {request.static.gateway}\n"
        f"    dns-nameservers {request.static.gateway}\n    dns-search {request.static.domain}\n"
    )


def _profile(request: Wish) -> str:
    name = f"interface-name={request.interface}\n" if request.interface else ""
    return (
        f"{_SAID}\n[connection]\nid=atlantis\ntype=ethernet\nautoconnect-priority=100\n{name}\n{_ipv4(request.static)}"
    )


def _ipv4(static: Static | None) -> str:
    if static is None:
        return "[ipv4]\nmethod=auto\n"
    return (
        f"[ipv4]\nmethod=manual\naddress1={static.address},{static.gateway}\n"
        f"dns={static.gateway};\ndns-search={static.domain};\n"
    )


def _networkd(request: Wish) -> str:
    start = f"{_SAID}\n[Match]\nName={request.interface or 'e*'}\n\n[Network]\n"
    if request.static is None:
        return f"{start}DHCP=ipv4\n"
    address, gateway, domain = request.static.address, request.static.gateway, request.static.domain
    return f"{start}Address={address}\nGateway={gateway}\nDNS={gateway}\nDomains={domain}\n"
