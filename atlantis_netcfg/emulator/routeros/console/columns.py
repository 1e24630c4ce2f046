"""Which columns `print` shows of a menu, which marks it puts before a row, and which menus it always shows in detail.

Columns are those of public transcripts (networktocode/ntc-templates, `tests/mikrotik_routeros`; ytti/oxidized,
`spec/model/data`) where there is one; a menu without a line here shows its first arguments.

Assumption: console-columns
"""

from __future__ import annotations

__all__ = ["COLUMNS", "DETAILED", "FLAGS", "QUOTED", "flag_letters"]

COLUMNS: dict[str, tuple[str, ...]] = {
    "/certificate": ("name", "common-name", "subject-alt-name", "fingerprint"),
    "/file": ("name", "type", "size", "creation-time", "last-modified"),
    "/interface": ("name", "type", "actual-mtu", "l2mtu", "max-l2mtu", "mac-address"),
    "/interface/bridge/port": ("interface", "bridge", "hw", "pvid", "priority", "path-cost", "horizon"),
    "/interface/ethernet": ("name", "mtu", "mac-address", "arp", "switch"),
    "/interface/ethernet/poe": (
        "name",
        "poe-out",
        "poe-priority",
        "power-cycle-ping-enabled",
        "power-cycle-interval",
    ),
    "/interface/list": ("name",),
    "/interface/list/member": ("list", "interface"),
    "/interface/vlan": ("name", "mtu", "arp", "vlan-id", "interface"),
    "/ip/address": ("address", "network", "interface"),
    "/ip/dhcp-client": ("interface", "use-peer-dns", "add-default-route", "status", "address"),
    "/ip/dhcp-server": ("name", "interface", "address-pool", "lease-time"),
    "/ip/dhcp-server/network": ("address", "gateway", "dns-server"),
    "/ip/dns/static": ("name", "type", "address", "ttl"),
    "/ip/firewall/address-list": ("list", "address", "creation-time", "timeout"),
    "/ip/pool": ("name", "ranges"),
    "/ip/route": ("dst-address", "gateway", "routing-table", "distance"),
    "/ip/service": ("name", "port", "address", "certificate", "vrf", "max-sessions"),
    "/ipv6/address": ("address", "from-pool", "interface", "advertise"),
    "/log": ("time", "topics", "message"),
    "/routing/table": ("name",),
    "/system/history": ("action", "by", "policy", "time"),
    "/system/logging": ("topics", "action"),
    "/system/package": ("name", "version", "build-time", "size"),
    "/system/scheduler": ("name", "start-date", "start-time", "interval", "on-event", "run-count"),
    "/tool/netwatch": ("type", "host", "timeout", "interval", "status", "since"),
    "/user": ("name", "group", "address", "last-logged-in"),
    "/user/active": ("when", "name", "address", "via"),
}

DETAILED = frozenset(
    {
        "/interface/bridge",
        "/interface/lte",
        "/interface/wireless",
        "/interface/wireless/security-profiles",
        "/ip/firewall/filter",
        "/ip/firewall/mangle",
        "/ip/firewall/nat",
        "/ip/firewall/raw",
        "/ipv6/firewall/filter",
        "/queue/simple",
        "/routing/rule",
        "/system/script",
        "/user/group",
    }
)

FLAGS: dict[str, str] = {
    "dynamic": "D",
    "disabled": "X",
    "invalid": "I",
    "inactive": "I",
    "builtin": "*",
    "default": "*",
    "radius": "R",
    "running": "R",
    "active": "A",
    "undoable": "U",
    "redoable": "R",
    "floating-undo": "F",
    "expired": "E",
    "authority": "A",
    "private-key": "K",
    "trusted": "T",
    "slave": "S",
    "static": "s",
    "connect": "c",
    "connection": "c",
    "ecmp": "+",
    "hw-offload": "H",
}
"""Letter by property; those that are true stand before the row in this order."""

QUOTED = frozenset(
    {
        "by",
        "comment",
        "contents",
        "default-name",
        "group",
        "identity",
        "log-prefix",
        "message",
        "name",
        "note",
        "on-event",
        "owner",
        "platform",
        "redo",
        "source",
        "supplicant-identity",
        "type",
        "undo",
        "version",
    }
)
"""Properties of kind text: `print detail` quotes them always, others where a value holds a space."""


def flag_letters(row: dict[str, str], flags: tuple[str, ...]) -> str:
    """The marks before a row."""
    return "".join(FLAGS[name] for name in flags if row.get(name) in ("true", "yes"))
