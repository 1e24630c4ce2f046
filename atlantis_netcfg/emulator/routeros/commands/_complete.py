"""What RouterOS fills in itself when a row is added or set: names, networks, MAC addresses."""

from __future__ import annotations

import hashlib
from datetime import UTC, datetime
from ipaddress import IPv4Interface
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.answers import Category, Trap

if TYPE_CHECKING:
    from collections.abc import Callable

    from atlantis_netcfg.emulator.routeros.core import Core

_NAMES = {
    "/interface/bridge": ("bridge", "interface"),
    "/interface/ovpn-client": ("ovpn-out", "interface"),
    "/interface/wifi": ("wifi", "interface"),
    "/interface/wireless": ("wlan", "interface"),
    "/ip/dhcp-server": ("dhcp", ""),
    "/ip/pool": ("pool", ""),
    "/routing/table": ("table", ""),
    "/system/scheduler": ("schedule", ""),
    "/user/group": ("group", ""),
}


def complete(core: Core, menu: str, values: dict[str, str], changed: frozenset[str] | None = None) -> None:
    """Fill in what was left out; `changed` are the arguments of a set, None means that the row is new."""
    if changed is None and menu in _NAMES and "name" not in values:
        values["name"] = _free_name(core, menu)
    extra = _MORE.get(menu)
    if extra is not None:
        extra(core, values, changed)


def _free_name(core: Core, menu: str) -> str:
    stem, space = _NAMES[menu]
    tables = list(core.store.space_tables(space)) if space else [core.store.table(menu)]
    taken = {core.store.text(table, item, "name") for table in tables for item in table.items}
    return next(name for name in (f"{stem}{number}" for number in range(1, len(taken) + 2)) if name not in taken)


def mac_of(name: str, number: int) -> str:
    """Make a MAC address of MikroTik's for a router's interface, the same in every run."""
    digest = hashlib.sha256(name.encode()).digest()
    return ":".join(f"{byte:02X}" for byte in (0x48, 0xA9, 0x8A, digest[0], digest[1], number & 0xFF))


def _address(_core: Core, values: dict[str, str], changed: frozenset[str] | None) -> None:
    """The network follows from the address, unless it was given too; `netmask` stands for the prefix length."""
    if mask := values.pop("netmask", None):
        host = values["address"].partition("/")[0]
        try:
            values["address"] = str(IPv4Interface(f"{host}/{mask}"))
        except ValueError as error:
            raise Trap("invalid value for argument netmask", Category.ARGUMENT) from error
    values.pop("broadcast", None)
    follows = "network" not in values if changed is None else "address" in changed and "network" not in changed
    if follows:
        values["network"] = str(IPv4Interface(values["address"]).network.network_address)


def _tunnel(core: Core, values: dict[str, str], _changed: frozenset[str] | None) -> None:
    values.setdefault("mac-address", mac_of(core.spec.name + values.get("name", ""), 0xFE))


def _clock(core: Core, values: dict[str, str], _changed: frozenset[str] | None) -> None:
    """Date and time are the clock's, not the configuration's; without them it goes on as it went."""
    if not {"date", "time"} & values.keys():
        return
    now = core.time()
    form = "%Y-%m-%d" if core.schema.at_least("7.10") else "%b/%d/%Y"
    date = values.pop("date", now.strftime(form).lower())
    time = values.pop("time", now.strftime("%H:%M:%S"))
    try:
        core.set_clock(datetime.strptime(f"{date} {time}", f"{form} %H:%M:%S").replace(tzinfo=UTC))
    except ValueError as error:
        wrong = "time" if _reads(date, form) else "date"
        raise Trap(f"invalid value for argument {wrong}", Category.ARGUMENT) from error


def _reads(text: str, form: str) -> bool:
    try:
        return bool(datetime.strptime(text, form).replace(tzinfo=UTC))
    except ValueError:
        return False


def _schedule(core: Core, values: dict[str, str], _changed: frozenset[str] | None) -> None:
    """A job without a start starts now."""
    values.setdefault("start-time", core.time().strftime("%H:%M:%S"))
    if values["start-time"] != "startup":
        values.setdefault("start-date", core.stamp().split()[0])


_MORE: dict[str, Callable[[Core, dict[str, str], frozenset[str] | None], None]] = {
    "/ip/address": _address,
    "/interface/ovpn-client": _tunnel,
    "/system/clock": _clock,
    "/system/scheduler": _schedule,
}
