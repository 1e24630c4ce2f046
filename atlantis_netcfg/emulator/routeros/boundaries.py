"""Which version brought a menu, command or argument that the oldest shipped tree has.

A router is held to the newest shipped tree that is not newer than itself, routers before 7.16 to that of 7.16. These
rows say what routers before 7.16 lack of it.

What is known, and what is not:

* 7.9 to 7.16: the first published tree that shows a name (`tikoci/restraml`, one or more trees for every minor
  version). Kept here for the menus that the twin models, for whole menus, and for what our engine sends; below 7.15 one
  tree for each minor version was published, so that the patch is uncertain.
* 6.49 and 7.0 to 7.8: no tree was published. The rows marked `MANUAL` and `EXPORT` say what is known to be newer than
  RouterOS 6; everything else is taken to be as in 7.16, which it surely is not, and what RouterOS 6 had and 7 has not
  (`/ip route routing-mark=`, `/ip route rule`, `primary-ntp`) is refused.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

__all__ = ["BOUNDARIES", "Boundary", "Source"]


class Source(StrEnum):
    """Where a row comes from."""

    TREE = "command trees of tikoci/restraml"
    MANUAL = "Manual: Moving from ROSv6 to ROSv7, OpenVPN, VRF, NTP, Device-mode, WireGuard, Container, Netwatch"
    EXPORT = "verbose exports of RouterOS 6.43.8 do not show it"
    ASSUMED = "first seen in the tree of 7.9, not known to any description of RouterOS 6"
    """Assumption: first-versions"""


@dataclass(frozen=True, slots=True)
class Boundary:
    """A menu (with all below it), a command, or arguments, that routers have from `since` on."""

    menu: str
    commands: tuple[str, ...] = ()
    """Empty: the whole menu."""
    arguments: tuple[str, ...] = ()
    """Empty: the whole command."""
    since: str = field(kw_only=True)
    source: Source = Source.TREE


_SET = ("set",)
_ADD = ("add", "set")


def _row(since: str, menu: str, commands: tuple[str, ...], words: str, source: Source = Source.TREE) -> Boundary:
    return Boundary(menu, commands, tuple(words.split()), since=since, source=source)


def _menus(since: str, source: Source, words: str) -> tuple[Boundary, ...]:
    return tuple(Boundary(menu, since=since, source=source) for menu in words.split())


_BELOW_7_16 = (
    _row("7.10", "/ip/dns", _SET, "address-list-extra-time"),
    _row("7.10", "/ip/firewall/nat", _ADD, "randomise-ports"),
    _row("7.10", "/snmp", _SET, "engine-id-suffix"),
    *_menus("7.10", Source.TREE, "/mpls/settings /routing/bfd"),
    _row("7.11", "/tool/netwatch", _ADD, "src-address"),
    *_menus("7.11", Source.TREE, "/iot/bluetooth/peripheral-devices /iot/lora /iot/mqtt/subscriptions"),
    *_menus("7.11", Source.TREE, "/lora/joineui /lora/netid"),
    *_menus("7.12", Source.TREE, "/interface/macvlan /iot/bluetooth/connections /iot/modbus/security-rules"),
    *_menus("7.12", Source.TREE, "/routing/settings"),
    _row("7.13", "/", ("export",), "where"),
    Boundary("/file", ("read",), since="7.13"),
    _row("7.13", "/file", _SET, "name"),
    _row("7.13", "/interface/bridge", _ADD, "port-cost-mode"),
    Boundary("/interface/bridge/port", ("unset",), since="7.13"),
    _row("7.13", "/interface/lte", _SET, "sms-read"),
    _row("7.13", "/interface/lte/settings", _SET, "info-polling-interval"),
    *_menus("7.13", Source.TREE, "/interface/wifi /ip/nat-pmp /routing/isis /system/rtrace"),
    *_menus("7.14", Source.TREE, "/disk/settings"),
    _row("7.14", "/interface/wifi", _ADD, "configuration.distance"),
    _row("7.14", "/interface/wifi/configuration", _ADD, "distance"),
    _row("7.14", "/system/note", _SET, "show-at-cli-login"),
    *_menus("7.15", Source.TREE, "/console/settings /interface/bridge/vlan/mvrp /ip/dns/adlist /ip/media"),
    _row("7.15", "/interface/bridge", _ADD, "mvrp"),
    _row("7.15", "/interface/bridge/port", _ADD, "mvrp-applicant-state mvrp-registrar-state"),
    _row("7.15", "/interface/ethernet", _SET, "sfp-ignore-rx-los"),
    _row("7.15", "/certificate", ("import",), "trusted"),
    _row("7.15", "/ip/dns", _SET, "vrf"),
    _row("7.15", "/ip/neighbor/discovery-settings", _SET, "lldp-mac-phy-config lldp-max-frame-size"),
    *_menus("7.16", Source.TREE, "/file/rsync-daemon"),
    _row("7.16", "/", ("import",), "dry-run"),
    _row("7.16", "/certificate", ("import",), "no-key-export"),
    _row("7.16", "/interface/bridge", _ADD, "forward-reserved-addresses max-learned-entries"),
    _row("7.16", "/interface/lte", _SET, "sms-protocol"),
    _row("7.16", "/ip/dns", _SET, "mdns-repeat-ifaces"),
    _row("7.16", "/ip/settings", _SET, "ipv4-multipath-hash-policy"),
    _row("7.16", "/ip/neighbor/discovery-settings", _SET, "discover-interval lldp-vlan-info"),
    _row("7.16", "/ip/service", _SET, "max-sessions"),
    _row("7.16", "/ipv6/settings", _SET, "multipath-hash-policy"),
    _row("7.16", "/tool/netwatch", _ADD, "accept-icmp-time-exceeded dns-server record-type ttl"),
    _row("7.16", "/user", _ADD, "inactivity-policy inactivity-timeout"),
)

_NEWER_THAN_6 = (
    *_menus("7.0", Source.MANUAL, "/routing/table /routing/rule /routing/route /routing/settings /routing/id"),
    *_menus("7.0", Source.MANUAL, "/ip/vrf /interface/wireguard /container /interface/veth /zerotier"),
    *_menus("7.0", Source.MANUAL, "/interface/wifi /interface/macvlan /interface/vxlan/vteps /system/device-mode"),
    *_menus("7.0", Source.MANUAL, "/routing/bgp/connection /routing/bgp/template /routing/ospf/interface-template"),
    *_menus("7.0", Source.MANUAL, "/routing/filter/rule /system/ntp/client/servers"),
    _row("7.0", "/ip/route", _ADD, "routing-table blackhole suppress-hw-offload", Source.MANUAL),
    _row("7.0", "/interface/ovpn-client", _ADD, "protocol", Source.MANUAL),
    _row("7.0", "/interface/ovpn-client", _ADD, "disconnect-notify use-peer-dns", Source.ASSUMED),
    _row("7.9", "/interface/ovpn-client", _ADD, "route-nopull tls-version", Source.TREE),
    Boundary("/interface/ovpn-client", ("import-ovpn-configuration",), since="7.9"),
    _row("7.0", "/ip/service", _SET, "vrf", Source.EXPORT),
    _row("7.0", "/ip/socks", _SET, "vrf", Source.EXPORT),
    _row("7.0", "/system/ntp/client", _SET, "mode servers vrf", Source.EXPORT),
    Boundary("/file", ("add",), since="7.9", source=Source.ASSUMED),
    _row("7.9", "/", ("execute",), "as-string", Source.ASSUMED),
    _row("7.0", "/", ("export",), "show-sensitive", Source.MANUAL),
    Boundary("/console", ("inspect",), since="7.9", source=Source.ASSUMED),
    _row("7.9", "/tool/netwatch", _ADD, "name type", Source.ASSUMED),
)

BOUNDARIES: tuple[Boundary, ...] = (*_NEWER_THAN_6, *_BELOW_7_16)
