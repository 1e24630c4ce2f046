"""What the trees do not show although devices have it, by name: reviewed, and each is really absent from them."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Hole:
    """A menu, a command (`command`) or an argument of it (`argument`) that no shipped tree has."""

    menu: str
    why: str
    command: str = ""
    argument: str = ""


_NO_POE = "a Cloud Hosted Router, from which the trees come, feeds no port (manual, PoE-Out)"
_NO_BOARD = "a Cloud Hosted Router is no RouterBOARD (manual, RouterBOARD)"
_KEY = "the row's own key: `set` names the row by `numbers`, the property is only printed"
_API = "a word of the API protocol, not of the console (manual, API)"

_POE = (
    "poe-out",
    "poe-priority",
    "poe-voltage",
    "power-cycle-interval",
    "power-cycle-ping-address",
    "power-cycle-ping-enabled",
    "power-cycle-ping-timeout",
)

HOLES = (
    Hole("/interface/ethernet/poe", _NO_POE),
    *(Hole("/interface/ethernet", _NO_POE, "set", name) for name in _POE),
    Hole("/ip/neighbor/discovery-settings", _NO_POE, "set", "lldp-poe-power"),
    Hole("/system/routerboard", _NO_BOARD),
    Hole("/lcd", _NO_BOARD),
    Hole("/interface/ethernet/switch", "a Cloud Hosted Router has no switch chip (manual, Switch Chip Features)"),
    Hole("/interface/w60g", "no 60 GHz radio (manual, W60G)"),
    Hole("/zerotier", "not in the set of x86 packages (manual, ZeroTier)"),
    Hole("/interface/ethernet", _KEY, "set", "default-name"),
    Hole("/interface/lte", _KEY, "set", "default-name"),
    Hole("/interface/wifi", _KEY, "set", "default-name"),
    Hole("/interface/wireless", _KEY, "set", "default-name"),
    Hole("/ip/service", _KEY, "set", "name"),
    Hole("/", _API, "login"),
    Hole("/", _API, "cancel"),
)

SINCE_ABSENT = {("/ip/firewall/filter", "hw-offload"): "7.21", ("/ip/route", "suppress-hw-offload"): "7.21"}
"""Arguments that left the tree of the Cloud Hosted Router at a version, while boards with a switch chip kept them
(inferred: the manual, L3 Hardware Offloading, still describes them)."""


def known(menu: str, command: str = "", argument: str = "") -> bool:
    """Is it, or is it below, one of the holes."""
    for hole in HOLES:
        if not hole.command and (menu == hole.menu or menu.startswith(hole.menu + "/")):
            return True
        if (hole.menu, hole.command) == (menu, command) and hole.argument in ("", argument):
            return True
    return False
