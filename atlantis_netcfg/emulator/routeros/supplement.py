"""What the command trees cannot know, as visible tables: hardware that a Cloud Hosted Router lacks, and packages.

Sources: Manual, CLI reference (`/interface/ethernet`, `/interface/ethernet/poe`, `/system/routerboard`); Manual,
Packages. What versions between and below the trees have is in `boundaries.py`.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["ADDED", "BOARD_FEATURES", "PACKAGE_MENUS", "UNSEEN", "UNSEEN_6", "WITHIN_ROUTEROS", "Added"]

BOARD_FEATURES = frozenset({"poe", "routerboard"})
UNSEEN = (
    "/interface/ethernet/switch",
    "/system/routerboard/mode-button",
    "/system/routerboard/reset-button",
    "/system/routerboard/wps-button",
    "/system/swos",
    "/zerotier",
)
"""Menus of boards that exports (7.1 to 7.23) hold and no published tree shows; each board has some of them."""
UNSEEN_6 = ("/system/lcd", "/tool/user-manager")
"""Menus of RouterOS 6 that its exports hold; no tree of that version is published."""


@dataclass(frozen=True, slots=True)
class Added:
    """A command, and arguments, that a device has and the tree does not show; `feature` is of BOARD_FEATURES."""

    menu: str
    command: str
    arguments: tuple[str, ...] = ()
    since: str = "6.0"
    feature: str | None = None


_CHANGE = ("add", "set")
_POE = (
    "poe-out",
    "poe-priority",
    "poe-voltage",
    "power-cycle-interval",
    "power-cycle-ping-address",
    "power-cycle-ping-enabled",
    "power-cycle-ping-timeout",
)
_PRINT = ("as-value", "brief", "count-only", "detail", "interval", "proplist", "terse", "where", "without-paging")
_GET = ("as-string", "number", "value-name")
_ROUTERBOARD = (
    "auto-upgrade",
    "boot-delay",
    "boot-device",
    "boot-protocol",
    "cpu-frequency",
    "enable-jumper-reset",
    "enter-setup-on",
    "force-backup-booter",
    "preboot-etherboot",
    "preboot-etherboot-server",
    "silent-boot",
)

ADDED = (
    Added("/interface/ethernet", "set", _POE, feature="poe"),
    Added("/interface/ethernet/poe", "print", _PRINT, feature="poe"),
    Added("/interface/ethernet/poe", "get", _GET, feature="poe"),
    Added("/interface/ethernet/poe", "find", ("where",), feature="poe"),
    Added("/interface/ethernet/poe", "set", (*_POE, "numbers"), feature="poe"),
    Added("/interface/ethernet/poe", "monitor", ("as-value", "numbers", "once"), feature="poe"),
    Added("/interface/ethernet/poe", "power-cycle", ("duration", "numbers"), feature="poe"),
    Added("/ip/neighbor/discovery-settings", "set", ("lldp-poe-power",), feature="poe"),
    Added("/system/routerboard", "print", ("as-value", "without-paging"), feature="routerboard"),
    Added("/system/routerboard", "get", ("value-name",), feature="routerboard"),
    Added("/system/routerboard/settings", "print", ("as-value", "without-paging"), feature="routerboard"),
    Added("/system/routerboard/settings", "get", ("value-name",), feature="routerboard"),
    Added("/system/routerboard/settings", "set", _ROUTERBOARD, feature="routerboard"),
    *(Added("/ip/firewall/filter", each, ("hw-offload",), since="7.21", feature="routerboard") for each in _CHANGE),
    *(Added("/ip/route", each, ("suppress-hw-offload",), since="7.21", feature="routerboard") for each in _CHANGE),
)
"""At 7.21 the two arguments of hardware offloading left the tree of the Cloud Hosted Router, which has no switch chip;
the manual (L3 Hardware Offloading) still describes them. Assumption: board-hw-offload"""

WITHIN_ROUTEROS = {"wireless": "7.13"}
"""Before that version the package was part of RouterOS itself (Manual, Packages)."""

PACKAGE_MENUS = (
    ("calea", "/interface/bridge/calea"),
    ("calea", "/ip/firewall/calea"),
    ("calea", "/tool/calea"),
    ("container", "/app"),
    ("container", "/container"),
    ("dude", "/dude"),
    ("gps", "/system/gps"),
    ("iot", "/iot"),
    ("iot", "/lora"),
    ("rose-storage", "/file/rsync-daemon"),
    ("rose-storage", "/file/sync"),
    ("tr069-client", "/tr069-client"),
    ("ups", "/system/ups"),
    ("user-manager", "/user-manager"),
    ("wireless", "/caps-man"),
    ("wireless", "/interface/wireless"),
)
