"""The checks of `provision inventory doctor`: this laptop, before it is taken to a site.

    diagnosis = examine(inventory, "coastal", via=None, decrypt=vault.decrypt)

Each part (software, clock, network, keys, folders) reads the computer in one function and judges in others, which are
pure. Nothing is changed, no file is created, and no password is sent anywhere. At most one device is contacted: the
router of the named site, by one TLS connection without a login.
"""

from __future__ import annotations

import os
import pwd
from pathlib import Path
from typing import TYPE_CHECKING

from atlantis_netcfg.core import paths
from atlantis_netcfg.core.errors import NetcfgError, UsageError
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory import ALL, InventoryInvalid, choose, load
from atlantis_netcfg.operations.computers._access import is_computer
from atlantis_netcfg.operations.doctor import reachability
from atlantis_netcfg.operations.doctor.clock import clock_items
from atlantis_netcfg.operations.doctor.folders import folder_items, read_runs
from atlantis_netcfg.operations.doctor.items import Diagnosis, DoctorItem, DoctorSection
from atlantis_netcfg.operations.doctor.keys import authority_item, key_items
from atlantis_netcfg.operations.doctor.network import NetworkUnreadable, read_network
from atlantis_netcfg.operations.doctor.software import software_items
from atlantis_netcfg.runs import Store

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from atlantis_netcfg.inventory import Host, Inventory

__all__ = ["Diagnosis", "DoctorItem", "DoctorSection", "examine"]


def examine(inventory: Path, site: str | None, *, via: str | None, decrypt: Callable[[str], str]) -> Diagnosis:
    """Run all checks; raise NoMatchError or UsageError for an invalid argument.

    `decrypt` opens a value of the inventory's vault, and may ask for its password.
    """
    pilot_inventory, invalid = _inventory(inventory)
    hosts = _hosts(pilot_inventory, site)
    state, homeless = _state()
    read = read_runs(Store(state) if state is not None else None, site)
    authority = state / "vpn" if state is not None else None
    items = [*software_items(paths.checkout(), computers=any(map(is_computer, hosts)))]
    items += clock_items(paths.checkout(), read.runs, authority)
    items += _reachability_items(pilot_inventory, site, via, state)
    items += [invalid] if invalid is not None else []
    if pilot_inventory is not None and state is not None:
        items += key_items(pilot_inventory, hosts, decrypt, Store(state).pins, _home())
    items += [authority_item(authority)] if authority is not None else []
    items += [homeless] if homeless is not None else []
    items += folder_items(state, paths.checkout(), read) if state is not None else ()
    return Diagnosis(tuple(items), site, _next_command(pilot_inventory, site))


def _inventory(inventory: Path) -> tuple[Inventory | None, DoctorItem | None]:
    """Return the inventory, or the item that reports its errors."""
    try:
        return load(inventory), None
    except InventoryInvalid as error:
        number = len(error.findings)
        observation = msg(
            f"{arg(inventory)} has {arg(number)} error{'s' if number > 1 else ''}; dependent checks are skipped"
        )
        commands = ("provision inventory validate",)
        return None, DoctorItem(DoctorSection.KEYS, "declaration", Verdict.FAIL, observation, "", commands)


def _hosts(inventory: Inventory | None, site: str | None) -> tuple[Host, ...]:
    if inventory is None:
        return ()
    if site == ALL:
        raise UsageError(
            f"`site={arg(ALL)}`: a laptop is at one site", hint=f"choose one: {arg(join(', ', inventory.sites))}"
        )
    return choose(inventory, ALL if site is None else site)


def _state() -> tuple[Path | None, DoctorItem | None]:
    """Return the folder of the records, existing or not, or the item that reports that there is none."""
    try:
        return paths.state_place(), None
    except UsageError as error:
        item = DoctorItem(DoctorSection.FOLDERS, "record folder", Verdict.FAIL, str(error), error.hint or "")
        return None, item


def _home() -> Path:
    """Return the home in the password database, where OpenSSH looks for keys, regardless of `$HOME`."""
    try:
        return Path(pwd.getpwuid(os.geteuid()).pw_dir)
    except KeyError:  # then no key is in it
        return Path("/nonexistent")


def _reachability_items(
    inventory: Inventory | None, site: str | None, via: str | None, state: Path | None
) -> Iterator[DoctorItem]:
    try:
        if inventory is None or site is None:
            yield reachability.judge_ports(read_network(None))
            return
        for place in reachability.router_places(inventory, site, via, _pin_reader(state)):
            yield from _check_route(place)
    except NetworkUnreadable as trouble:
        yield DoctorItem(DoctorSection.WAY, "network", Verdict.INCONCLUSIVE, str(trouble))


def _pin_reader(state: Path | None) -> Callable[[str], str | None]:
    """Return a function for a device's pinned certificate; a damaged pin file is a separate item."""

    def read_pin(device: str) -> str | None:
        try:
            return Store(state).pins.get(device) if state is not None else None
        except NetcfgError:
            return None

    return read_pin


def _check_route(place: reachability.RouterPlace) -> Iterator[DoctorItem]:
    """Yield the items of the route to a router, and of the router itself if the route is correct."""
    if place.example:
        observation = msg(f"the addresses of {arg(place.site)} are examples, which match no real device")
        yield DoctorItem(DoctorSection.WAY, "way", Verdict.SKIP, observation)
        yield reachability.judge_ports(read_network(None))
        return
    way = reachability.judge_way(place, read_network(place.address))
    yield from way
    if (reason := reachability.why_not_contacted(place, way)) is not None:
        yield DoctorItem(DoctorSection.WAY, "router", Verdict.SKIP, reason)
    else:
        yield from reachability.judge_router(place, reachability.ask_router(place))


def _next_command(inventory: Inventory | None, site: str | None) -> str:
    """Return the next command to type if everything is in order."""
    if inventory is None:
        return ""
    example = inventory.pilot.example_values
    if site is None:
        return f"provision inventory doctor site={next(iter(inventory.sites))}"
    return f"provision site={site} --rehearse" if example else f"provision plan site={site}"
