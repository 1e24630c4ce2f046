"""The menus that a default configuration fills, in the order in which they can be emptied.

Source: public exports of factory-fresh boards with RouterOS 6.49 to 7.21, and Manual, Default configurations. What a
row refers to comes after the row: a list can go when no setting and no rule names it any more.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.bootstrap.target import TEMPORARY
from atlantis_netcfg.core.versions import Version

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.bootstrap.target import Row
    from atlantis_netcfg.rsc import Statement

__all__ = ["CLEARED", "comment_is_ours", "is_default", "is_foreign", "removable", "resets"]

CLEARED = (
    "/ip/dhcp-client",
    "/ipv6/dhcp-client",
    "/ip/firewall/nat",
    "/ip/firewall/mangle",
    "/ip/firewall/raw",
    "/ip/firewall/filter",
    "/ip/firewall/address-list",
    "/ipv6/firewall/filter",
    "/ipv6/firewall/address-list",
    "/ip/dhcp-server/lease",
    "/ip/dhcp-server/network",
    "/ip/dhcp-server",
    "/ip/pool",
    "/ip/dns/static",
    "/interface/list/member",
    "/interface/list",
    "/ip/address",
    "/interface/bridge/port",
    "/interface/bridge",
)
_KNOWN_NAMES = {
    "/ip/pool": ("default-dhcp", "dhcp"),
    "/ip/dhcp-server": ("defconf", "default"),
}
_TOLERATED = {
    "/disk": None,
    "/disk/settings": None,
    "/interface/ethernet/switch": None,
    "/interface/ethernet/switch/port": None,
    "/interface/lte": None,
    "/interface/lte/apn": None,
    "/interface/wifi": None,
    "/interface/wireless": None,
    "/interface/wireless/security-profiles": None,
    "/ip/dns": ("allow-remote-requests",),
    "/ip/neighbor/discovery-settings": ("discover-interface-list",),
    "/port": None,
    "/system/clock": None,
    "/system/note": ("show-at-login",),
    "/system/routerboard/settings": None,
    "/tool/mac-server": ("allowed-interface-list",),
    "/tool/mac-server/mac-winbox": ("allowed-interface-list",),
}
"""Menus in which default configurations set something, and what, where that is known."""
_BUILTIN_LISTS = ("all", "none", "dynamic", "static")


def comment_is_ours(comment: str) -> bool:
    """Whether a row is one of this toolkit's."""
    return comment.startswith("atlantis")


def is_default(statement: Statement) -> bool:
    """Whether the factory's script made this row."""
    values = dict(statement.values)
    comment = values.get("comment") or ""
    if statement.verb != "add":
        return False
    return comment.startswith("defconf") or values.get("name") in _KNOWN_NAMES.get(statement.menu, ())


def is_foreign(statement: Statement) -> bool:
    """Whether neither the factory nor this toolkit wrote this line of an export."""
    values = dict(statement.values)
    if comment_is_ours(values.get("comment") or "") or is_default(statement):
        return False
    if statement.menu == "/ip/service":
        return statement.target != "api-ssl"
    if statement.verb == "add" or statement.menu not in _TOLERATED:
        return True
    allowed = _TOLERATED[statement.menu]
    return allowed is not None and not set(values) <= set(allowed)


def removable(menu: str, rows: tuple[Row, ...]) -> list[Row]:
    """Rows of a menu that are to go, in the order in which they may: firewalls from their end.

    What this toolkit wrote stays, but for what was only meant for first contact.
    """
    found = [row for row in rows if _goes(menu, row)]
    return found[::-1]


def _goes(menu: str, row: Row) -> bool:
    comment = row.get("comment", "")
    if any(row.get(flag) in ("true", "yes") for flag in ("dynamic", "builtin", "default")):
        return False
    if menu == "/interface/list" and row.get("name") in _BUILTIN_LISTS:
        return False
    return comment.startswith(TEMPORARY) or not comment_is_ours(comment)


def resets(version: Version) -> Mapping[str, Mapping[str, str]]:
    """What the settings of a default configuration are without one (Manual, CLI reference of each menu)."""
    discovered = "!dynamic" if version < Version(7, 0) else "static"
    return {
        "/ip/dns": {"allow-remote-requests": "no"},
        "/ip/neighbor/discovery-settings": {"discover-interface-list": discovered},
        "/tool/mac-server": {"allowed-interface-list": "all"},
        "/tool/mac-server/mac-winbox": {"allowed-interface-list": "all"},
        "/disk/settings": {"auto-media-interface": "none", "auto-media-sharing": "no", "auto-smb-sharing": "no"},
    }
