"""Guests: the entry of a temporary robot, added to and removed from `group_vars/all/guests.yml`.

Everything else in that file, including comments, is kept; `operations.common.inventory_files` validates and writes it.
"""

from __future__ import annotations

import re
import shutil
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core import errors
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory import Inventory, load, model
from atlantis_netcfg.inventory.new_inventory.yaml_text import document
from atlantis_netcfg.inventory.robots.reading import FOLDER
from atlantis_netcfg.runs import os_errors_as

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from atlantis_netcfg.inventory.new_inventory.yaml_text import Tree
    from atlantis_netcfg.vpn.authority.authority import Authority
    from atlantis_netcfg.vpn.identity import Member

FILE = "group_vars/all/guests.yml"
_HEAD = (
    "# yaml-language-server: $schema=../../.schema/guests.json",
    "# Robots that are here for a while: `provision robot invite` adds them, `provision robot dismiss` removes them.",
    "# You may give each `endpoints` and a `checklist`, as in vehicles.yml.",
)


class GuestLeftOver(errors.NetcfgError):
    """Parts of a removed guest still exist."""

    exit = errors.ExitCode.CHECKS_FAILED


@dataclass(frozen=True, slots=True)
class GuestEntry:
    """A guest's entry for the inventory."""

    name: str
    title: str
    kind: str
    partner: str
    until: str
    sites: tuple[str, ...]
    cells: tuple[str, ...]
    """Cells of the checklist row."""
    distribution: str | None = None
    openvpn: str | None = None

    @property
    def tree(self) -> dict[str, Tree]:
        """The entry in the order in which it is written."""
        columns = [str(column) for column in model.Column if column in self.cells]
        more: dict[str, Tree] = {"ethernet": True} if model.ETHERNET in self.cells else {}
        more |= {"distribution": self.distribution} if self.distribution is not None else {}
        more |= {"openvpn": self.openvpn} if self.openvpn is not None else {}
        return {
            "name": self.title,
            "kind": self.kind,
            "guest": True,
            "partner": self.partner,
            "until": self.until,
            "tested_at": list(self.sites),
            "table3": columns,
            **more,
        }

    def same(self, guest: model.Guest) -> bool:
        """Return whether the inventory has this guest already, ignoring fields that a person added."""
        expected_guest = model.Guest.model_validate(self.tree)
        names = ("name", "kind", "partner", "until", "tested_at", "table3", "ethernet", "distribution", "openvpn")
        return all(getattr(expected_guest, name) == getattr(guest, name) for name in names)


def text_of(root: Path) -> str | None:
    """Return the text of the guests file; None if it does not exist."""
    path = root / FILE
    with os_errors_as("the guests", path):
        return path.read_text(encoding="utf-8") if path.exists() else None


def with_guest(text: str | None, entry: GuestEntry) -> str:
    """Return the file with one more guest at its end."""
    result = document({"guests": {entry.name: entry.tree}}, _HEAD)
    if text is None:
        return result
    lines = result.partition("\nguests:\n")[2]
    start = text if re.search(r"^guests:", text, re.MULTILINE) else f"{text.rstrip()}\n---\nguests:\n"
    return msg(f"{arg(start.rstrip())}\n{arg(lines)}")


def without_guest(text: str, name: str) -> str | None:
    """Return the file without a guest; None if nothing remains. Comments before the next guest are kept."""
    lines = text.splitlines(keepends=True)
    key = re.compile(rf"  {re.escape(name)}:\s*(#.*)?")
    first = next((number for number, line in enumerate(lines) if key.fullmatch(line.rstrip("\n"))), None)
    if first is None:
        raise errors.UsageError(
            f"`{arg(name)}` is not written in {arg(FILE)} as this command writes it", hint="remove it by hand"
        )
    last = next((number for number in range(first + 1, len(lines)) if re.match(r" {0,2}\S", lines[number])), len(lines))
    remaining_text = "".join([*lines[:first], *lines[last:]])
    return None if remaining_text == "\n".join([*_HEAD, "---", "guests:"]) + "\n" else remaining_text


def declared_guest(inventory: Inventory, name: str) -> model.Guest | None:
    """Return the guest of that name, None if there is none; raise UsageError for a vehicle that is no guest."""
    result = inventory.vehicles.get(name)
    if result is None or isinstance(result, model.Guest):
        return result
    hint = "remove it by hand: these commands edit only guests.yml"
    raise errors.UsageError(f"`{arg(name)}` is in vehicles.yml, and is not a guest of this command", hint=hint)


def robot_file(root: Path, name: str) -> Path:
    """Return the path of the guest's robot configuration, which may not exist."""
    return root / FOLDER / f"{name}.yml"


def members_of(authority: Authority, name: str) -> tuple[Member, ...]:
    """Return the VPN members, valid or not, that were enrolled for this vehicle."""
    members = authority.membership().members.values()
    return tuple(member for member in members if member.vehicle == name and member.partner is not None)


def unknown(inventory: Inventory, name: str) -> errors.NoMatchError:
    """Return the error for a guest that does not exist."""
    guests = [key for key, vehicle in inventory.vehicles.items() if isinstance(vehicle, model.Guest)]
    near = errors.nearest(name, guests)
    hint = msg(f"did you mean `{arg(near)}`?" if near else f"guests: {arg(join(', ', guests) or 'none')}")
    return errors.NoMatchError(f"no such guest: `{arg(name)}`", hint=hint)


def remove_packages(authority: Authority, members: Sequence[Member]) -> None:
    """Delete the enrolment packages of these members, which have become useless."""
    for member in members:
        for certificate in member.certificates:
            shutil.rmtree(authority.folder / "handouts" / certificate.common_name, ignore_errors=True)


def left_over(root: Path, authority: Authority, name: str) -> tuple[str, ...]:
    """Return what remains of a removed guest, as text, read again from inventory and record."""
    leftovers = []
    if name in load(root).vehicles:
        leftovers.append(msg(f"`{arg(name)}` is still in {arg(FILE)}"))
    if (robot := robot_file(root, name)).exists():
        leftovers.append(msg(f"{arg(robot)} still exists"))
    for member in members_of(authority, name):
        if member.good:
            leftovers.append(msg(f"`{arg(member.name)}` still has a valid certificate"))
        places = [authority.folder / "handouts" / item.common_name for item in member.certificates]
        leftovers += [msg(f"{arg(place)} still exists") for place in places if place.exists()]
    return tuple(leftovers)
