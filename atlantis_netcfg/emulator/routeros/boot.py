"""A router as it comes from the factory, and what its adoption adds."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.answers import Caller
from atlantis_netcfg.emulator.routeros.commands._complete import mac_of
from atlantis_netcfg.emulator.routeros.console.run import run_file
from atlantis_netcfg.emulator.routeros.factory import default_configuration
from atlantis_netcfg.emulator.routeros.menus import BUILT_IN, INTERFACES, MODELLED, Menu, Shape
from atlantis_netcfg.emulator.routeros.store import Item
from atlantis_netcfg.emulator.routeros.values import reference, spell

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.routeros.core import Core

SYSTEM = Caller(0, "*sys", "full", "local", "", 0.0)
"""Who seeds the router and runs its schedulers."""
_MARK = "atlantis: management"
_LOOPBACK_ID = 0x1000000
"""Out of the way of the other interfaces; nobody has published the real one."""
_BUILTIN_USER = "system default user"


class SeedRefused(ValueError):
    """The seed of a spec is not something that this router would take."""


def boot(core: Core) -> None:
    """Fill the tables: the factory's rows, the spec's users, certificates and management address, then the seed."""
    for path in INTERFACES:
        core.store.table(path)
    for path in (*MODELLED, *BUILT_IN):
        if core.schema.has_menu(path):
            _factory(core, core.store.table(path).menu)
    _ports(core)
    _radios(core)
    _modem(core)
    _loopback(core)
    _people(core)
    if core.spec.factory:
        _seed(core, default_configuration(core.spec) + core.spec.seed)
    else:
        _certificates(core)
        _adopt(core)
    core.store.changes.clear()
    core.history.clear()
    core.log.clear()


def _factory(core: Core, menu: Menu) -> None:
    table = core.store.table(menu.path)
    if menu.shape is Shape.SETTINGS:
        table.items.append(Item(menu.first_id, {}, dict(menu.factory[0]) if menu.factory else {}))
    for row in menu.factory if menu.shape is not Shape.SETTINGS else ():
        table.items.append(Item(core.store.new_id(menu.path), {}, dict(row), dynamic=menu.factory_dynamic))
    for item in table.items:
        known = {name: value for name, value in (item.factory or {}).items() if name in {*table.args, "name"}}
        item.values = {name: _parse(core, menu, name, value) for name, value in known.items()}
        item.factory = {name: spell(value, core.store) for name, value in item.values.items()}


def _parse(core: Core, menu: Menu, name: str, value: str) -> str:
    return menu.by_name[name].kind.parse(value, core.store)


def _ports(core: Core) -> None:
    menu = MODELLED["/interface/ethernet"]
    table = core.store.table(menu.path)
    for number, port in enumerate(core.spec.ports, start=1):
        mac = mac_of(core.spec.name, number)
        factory = {"name": port, "mac-address": mac, "orig-mac-address": mac}
        table.items.append(Item(core.store.new_id(menu.path), dict(factory), factory))


def _radios(core: Core) -> None:
    """Radios whose driver is installed: without it they are not there (Manual, Packages)."""
    newer = any(package.startswith("wifi-") for package in core.spec.packages)
    path = "/interface/wifi" if newer else "/interface/wireless"
    if not core.schema.has_menu(path):
        return
    table = core.store.table(path)
    for number, radio in enumerate(core.spec.radios, start=len(core.spec.ports) + 1):
        mac = mac_of(core.spec.name, number)
        factory = {"name": radio.name, "mac-address": mac}
        if not newer:
            factory |= {"radio-name": mac.replace(":", ""), "ssid": "MikroTik", "band": "5ghz-a/n", "frequency": "5180"}
        table.items.append(Item(core.store.new_id(path), dict(factory), factory))


def _modem(core: Core) -> None:
    """The one row of a board with a modem; the device writes that roaming is off when it finds it."""
    if core.spec.modem is None or not core.schema.has_menu("/interface/lte"):
        return
    factory = {"name": core.spec.modem.name, "allow-roaming": "no"}
    core.store.table("/interface/lte").items.append(Item(core.store.new_id("/interface/lte"), dict(factory), factory))


def _loopback(core: Core) -> None:
    """The interface `lo`: exports of 7.16 are the oldest that name it."""
    if core.schema.at_least("7.16"):
        row = {"name": "lo"}
        core.store.table("/interface").items.append(Item(_LOOPBACK_ID, dict(row), row, dynamic=True))


def _people(core: Core) -> None:
    spec, path = core.spec, "/user"
    names = {user.name for user in spec.users}
    if "admin" not in names:
        everyone = core.store.refer("group", "full")
        admin = {"name": "admin", "group": everyone, "disabled": "yes", "comment": _BUILTIN_USER}
        core.store.insert(path, admin)
    for user in spec.users:
        values = {"name": user.name, "group": core.store.refer("group", user.group), "password": user.password}
        values |= {"disabled": "yes"} if user.disabled else {}
        values |= {"address": user.address} if user.address else {}
        values |= {"comment": _BUILTIN_USER} if user.name == "admin" else {}
        core.store.insert(path, values)


def _certificates(core: Core) -> None:
    for name in core.spec.certificates:
        core.store.insert("/certificate", {"name": name, "common-name": core.spec.name, "trusted": "yes"})


def _adopt(core: Core) -> None:
    management = core.spec.management
    store, service = core.store, core.store.table("/ip/service")
    port = store.id_of("interface", management.port)
    if port is not None:
        parsed = _parse(core, MODELLED["/ip/address"], "address", management.address)
        network = str(management.network)
        values = {"address": parsed, "interface": reference("interface", port), "network": network, "comment": _MARK}
        store.insert("/ip/address", values)
    for item in service.items:
        if store.text(service, item, "name") == "api-ssl" and core.spec.certificates:
            item.values["certificate"] = store.refer("certificate", core.spec.certificates[0])
    _seed(core, core.spec.seed)


def _seed(core: Core, text: str) -> None:
    error = run_file(core, SYSTEM, text).error if text else None
    if error is not None:
        raise SeedRefused(f"{core.spec.name}: the seed was refused: {error}")
