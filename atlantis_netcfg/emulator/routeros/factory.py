"""The default configuration of a router as it comes out of its box, and the laptop's place in it.

Manual, Default configurations: "RouterMode": the first port is WAN with a DHCP client behind a firewall, all others are
bridged, with 192.168.88.1/24 and a DHCP server. The rows are those of public exports of RB5009UPr+S+ with 7.16.2 and
7.20.6; what a board adds for its disks and radios is left out.

A box of one port and a radio comes as "CPE Router": the radio is the WAN, a station that looks for its access point,
and the port has the address and the DHCP server itself, without a bridge. A few models for bridges (DynaDish) come with
both in a bridge instead, and are not emulated.

Assumption: factory-cpe
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.rsc import quote

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.emulator.routeros.spec import RouterSpec

ADDRESS = "192.168.88.1"
_NETWORK = "192.168.88.0/24"
_STATES = "established,related,untracked"
_BAD_IPV6 = {
    "::/128": "unspecified address",
    "::1/128": "lo",
    "fec0::/10": "site-local",
    "::ffff:0.0.0.0/96": "ipv4-mapped",
    "::/96": "ipv4 compat",
    "100::/64": "discard only ",
    "2001:db8::/32": "documentation",
    "2001:10::/28": "ORCHID",
    "3ffe::/16": "6bone",
}


def default_configuration(spec: RouterSpec) -> str:
    """Export-style text of what the factory puts on this board."""
    return "".join(f"{line}\n" for line in (*_lan(spec), *_firewall(), *_firewall6(), *_tools()))


def _is_cpe(spec: RouterSpec) -> bool:
    return len(spec.ports) == 1 and bool(spec.radios)


def _lan(spec: RouterSpec) -> Iterator[str]:
    if _is_cpe(spec):
        station = _station(spec)
        yield from station
        yield from _served(inside=spec.ports[0], outside=spec.radios[0].name if station else None)
        return
    wan, *lan = spec.ports
    yield "/interface bridge add comment=defconf name=bridge"
    for port in lan:
        yield f"/interface bridge port add bridge=bridge comment=defconf interface={port}"
    yield from _served(inside="bridge", outside=wan)


def _station(spec: RouterSpec) -> tuple[str, ...]:
    """Switch the radio on, where a package drives it; otherwise there is no such interface."""
    radio = spec.radios[0].name
    if "wireless" in spec.packages:
        return (f"/interface wireless set [ find default-name={radio} ] disabled=no mode=station ssid=MikroTik",)
    if any(package.startswith("wifi-") for package in spec.packages):
        return (f"/interface wifi set [ find default-name={radio} ] configuration.mode=station disabled=no",)
    return ()


def _served(inside: str, outside: str | None) -> Iterator[str]:
    """What the factory serves on the inside, and asks for on the outside, where there is one."""
    yield "/interface list add comment=defconf name=WAN"
    yield "/interface list add comment=defconf name=LAN"
    yield "/ip pool add name=default-dhcp ranges=192.168.88.10-192.168.88.254"
    yield f"/ip dhcp-server add address-pool=default-dhcp interface={inside} name=defconf"
    yield "/ip neighbor discovery-settings set discover-interface-list=LAN"
    yield f"/interface list member add comment=defconf interface={inside} list=LAN"
    if outside is not None:
        yield f"/interface list member add comment=defconf interface={outside} list=WAN"
    yield f"/ip address add address={ADDRESS}/24 comment=defconf interface={inside}"
    if outside is not None:
        yield f"/ip dhcp-client add comment=defconf interface={outside}"
    yield f"/ip dhcp-server network add address={_NETWORK} comment=defconf dns-server={ADDRESS} gateway={ADDRESS}"
    yield "/ip dns set allow-remote-requests=yes"
    yield f"/ip dns static add address={ADDRESS} comment=defconf name=router.lan"


def _firewall() -> Iterator[str]:
    rules = (
        ("input", "accept", "accept established,related,untracked", f"connection-state={_STATES}"),
        ("input", "drop", "drop invalid", "connection-state=invalid"),
        ("input", "accept", "accept ICMP", "protocol=icmp"),
        ("input", "accept", "accept to local loopback (for CAPsMAN)", "dst-address=127.0.0.1"),
        ("input", "drop", "drop all not coming from LAN", "in-interface-list=!LAN"),
        ("forward", "accept", "accept in ipsec policy", "ipsec-policy=in,ipsec"),
        ("forward", "accept", "accept out ipsec policy", "ipsec-policy=out,ipsec"),
        ("forward", "fasttrack-connection", "fasttrack", "connection-state=established,related"),
        ("forward", "accept", "accept established,related, untracked", f"connection-state={_STATES}"),
        ("forward", "drop", "drop invalid", "connection-state=invalid"),
        (
            "forward",
            "drop",
            "drop all from WAN not DSTNATed",
            "connection-nat-state=!dstnat connection-state=new in-interface-list=WAN",
        ),
    )
    for chain, action, comment, rest in rules:
        yield f"/ip firewall filter add action={action} chain={chain} comment={_comment(comment)} {rest}"
    rest = "ipsec-policy=out,none out-interface-list=WAN"
    yield f"/ip firewall nat add action=masquerade chain=srcnat comment={_comment('masquerade')} {rest}"


def _firewall6() -> Iterator[str]:
    for address, comment in _BAD_IPV6.items():
        yield f"/ipv6 firewall address-list add address={address} comment={_comment(comment)} list=bad_ipv6"
    rules = (
        ("input", "accept", "accept established,related,untracked", f"connection-state={_STATES}"),
        ("input", "drop", "drop invalid", "connection-state=invalid"),
        ("input", "accept", "accept ICMPv6", "protocol=icmpv6"),
        ("input", "drop", "drop everything else not coming from LAN", "in-interface-list=!LAN"),
        ("forward", "accept", "accept established,related,untracked", f"connection-state={_STATES}"),
        ("forward", "drop", "drop invalid", "connection-state=invalid"),
        ("forward", "drop", "drop packets with bad src ipv6", "src-address-list=bad_ipv6"),
        ("forward", "drop", "drop packets with bad dst ipv6", "dst-address-list=bad_ipv6"),
        ("forward", "accept", "accept ICMPv6", "protocol=icmpv6"),
        ("forward", "drop", "drop everything else not coming from LAN", "in-interface-list=!LAN"),
    )
    for chain, action, comment, rest in rules:
        yield f"/ipv6 firewall filter add action={action} chain={chain} comment={_comment(comment)} {rest}"


def _tools() -> Iterator[str]:
    yield "/tool mac-server set allowed-interface-list=LAN"
    yield "/tool mac-server mac-winbox set allowed-interface-list=LAN"


def _comment(text: str) -> str:
    return quote(f"defconf: {text}")
