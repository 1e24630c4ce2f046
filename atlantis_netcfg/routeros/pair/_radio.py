"""Which rows are about radio, what one of them amounts to, and how a radio says that it is connected."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.routeros._types import Verb
from atlantis_netcfg.routeros.api import Command

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from atlantis_netcfg.routeros._types import Action, Row

__all__ = ["LEGACY", "MENUS", "WIFI", "Radio", "drops_link", "level_dbm", "radio_of", "registrations", "touches_radio"]

LEGACY, WIFI = "/interface/wireless", "/interface/wifi"
_PARTS = ("channel", "security", "datapath")
MENUS = (
    LEGACY,
    f"{LEGACY}/security-profiles",
    f"{LEGACY}/connect-list",
    f"{LEGACY}/access-list",
    WIFI,
    *(f"{WIFI}/{part}" for part in ("configuration", *_PARTS)),
)
"""Menus in which two ends have to agree."""
_IDLE = frozenset({"comment", "name", "arp", "arp-timeout"})
"""Properties with which a radio goes on as it was."""
_LISTS = (f"{LEGACY}/connect-list", f"{LEGACY}/access-list")


@dataclass(frozen=True, slots=True)
class Radio:
    """One radio as the rows say; `values` has what it inherits, by the names of `/interface/wifi`."""

    menu: str
    name: str
    """Factory name."""
    mac: str
    values: Mapping[str, str]

    def get(self, name: str, default: str = "") -> str:
        """Return one property."""
        return self.values.get(name, default)


def touches_radio(actions: Sequence[Action]) -> bool:
    """Tell whether anything of a plan could end or change the link."""
    return any(drops_link(action) for action in actions)


def drops_link(action: Action) -> bool:
    """Tell whether an action may interrupt the link: settings of a radio or of a profile, and lists of whom it takes.

    A profile that is new is harmless until somebody names it.
    """
    if action.menu not in MENUS:
        return False
    if action.verb is Verb.ADD:
        return action.menu in _LISTS
    return action.verb is not Verb.SET or any(name.lstrip("!") not in _IDLE for name, _ in action.values)


def radio_of(rows: Mapping[str, tuple[Row, ...]], name: str = "") -> Radio | None:
    """Return the radio with this factory name, else the first one of the device; None if it has none."""
    for menu, resolve in ((LEGACY, _legacy), (WIFI, _wifi)):
        for row in rows.get(menu, ()):
            if row.get("default-name") and name in ("", row["default-name"]):
                return Radio(menu, row["default-name"], row.get("mac-address", ""), resolve(rows, row))
    return None


def _legacy(rows: Mapping[str, tuple[Row, ...]], row: Row) -> Mapping[str, str]:
    """Return the radio's row, and its security profile's with `security.` before the names."""
    desired = row.get("security-profile", "default")
    profiles = rows.get(f"{LEGACY}/security-profiles", ())
    profile = next((each for each in profiles if each.get("name") == desired), {})
    return {**{f"security.{name}": value for name, value in profile.items()}, **row}


def _wifi(rows: Mapping[str, tuple[Row, ...]], row: Row) -> Mapping[str, str]:
    """Resolve inheritance: interface, its profiles, its configuration profile, profiles of that (Manual, WiFi)."""
    configuration = _named(rows, "configuration", row)
    inside = {
        (name if "." in name or name in _PARTS else f"configuration.{name}"): value
        for name, value in configuration.items()
    }
    layers = [*_profiles(rows, configuration), inside, *_profiles(rows, row), row]
    return {name: value for layer in layers for name, value in layer.items()}


def _profiles(rows: Mapping[str, tuple[Row, ...]], row: Row) -> list[Mapping[str, str]]:
    return [{f"{part}.{name}": value for name, value in _named(rows, part, row).items()} for part in _PARTS]


def _named(rows: Mapping[str, tuple[Row, ...]], part: str, row: Row) -> Row:
    name = row.get(part, "")
    return next((each for each in rows.get(f"{WIFI}/{part}", ()) if name and each.get("name") == name), {})


def registrations(menu: str) -> Command:
    """Return the command that lists whom the radios of a menu are connected to."""
    return Command(f"{menu}/registration-table/print", ((".proplist", "interface,mac-address,signal-strength,signal"),))


def level_dbm(row: Row) -> float | None:
    """Read the level of a registration: `-48dBm@6Mbps` of the older driver, `-48` of the newer; None: it says none."""
    text = row.get("signal-strength") or row.get("signal", "")
    number = text.partition("dBm")[0]
    try:
        return float(number)
    except ValueError:
        return None
