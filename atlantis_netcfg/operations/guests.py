"""Guests: the entry of a robot that is here for a while, written to and taken out of `group_vars/all/guests.yml`.

Whatever else stands in that file, comments too, stays; `operations.inventory_files` validates and writes it.
"""

from __future__ import annotations

import re
import shutil
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core import errors
from atlantis_netcfg.inventory import Declaration, load, model
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
    "# Robots that are here for a while: `provision guest add` writes them, `provision guest end` takes them out.",
    "# You may give each `endpoints` and a `checklist`, as in vehicles.yml.",
)


class GuestLeftOver(errors.NetcfgError):
    """Something of a guest that was ended is still there."""

    exit = errors.ExitCode.CHECKS_FAILED


@dataclass(frozen=True, slots=True)
class GuestEntry:
    """What is declared of a guest."""

    name: str
    title: str
    kind: str
    partner: str
    until: str
    sites: tuple[str, ...]
    cells: tuple[str, ...]
    """Columns of the checklist."""
    distribution: str | None = None
    openvpn: str | None = None

    @property
    def tree(self) -> dict[str, Tree]:
        """As it is written, in this order."""
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
        """Whether this guest is declared already; what a person has added is left out of it."""
        expected_guest = model.Guest.model_validate(self.tree)
        names = ("name", "kind", "partner", "until", "tested_at", "table3", "ethernet", "distribution", "openvpn")
        return all(getattr(expected_guest, name) == getattr(guest, name) for name in names)


def text_of(root: Path) -> str | None:
    """The file as it is; None: there is none."""
    path = root / FILE
    with os_errors_as("the guests", path):
        return path.read_text(encoding="utf-8") if path.exists() else None


def with_guest(text: str | None, entry: GuestEntry) -> str:
    """The file with one more, at its end."""
    result = document({"guests": {entry.name: entry.tree}}, _HEAD)
    if text is None:
        return result
    lines = result.partition("\nguests:\n")[2]
    start = text if re.search(r"^guests:", text, re.MULTILINE) else f"{text.rstrip()}\n---\nguests:\n"
    return f"{start.rstrip()}\n{lines}"


def without_guest(text: str, name: str) -> str | None:
    """The file without one; None: nothing is left of it. Comments before the next one are the next one's."""
    lines = text.splitlines(keepends=True)
    key = re.compile(rf"  {re.escape(name)}:\s*(#.*)?")
    first = next((number for number, line in enumerate(lines) if key.fullmatch(line.rstrip("\n"))), None)
    if first is None:
        raise errors.UsageError(
            f"`{name}` is not written in {FILE} as this command writes it", hint="remove it there by hand"
        )
    last = next((number for number in range(first + 1, len(lines)) if re.match(r" {0,2}\S", lines[number])), len(lines))
    remaining_text = "".join([*lines[:first], *lines[last:]])
    return None if remaining_text == "\n".join([*_HEAD, "---", "guests:"]) + "\n" else remaining_text


def declared_guest(declaration: Declaration, name: str) -> model.Guest | None:
    """The guest of that name; None: there is none. Raises UsageError for a vehicle that is no such guest."""
    result = declaration.vehicles.get(name)
    if result is None or isinstance(result, model.Guest):
        return result
    hint = "remove it there by hand: these commands write and remove what stands in guests.yml alone"
    raise errors.UsageError(f"`{name}` is declared in vehicles.yml, and no guest of this command", hint=hint)


def robot_file(root: Path, name: str) -> Path:
    """Where the configuration of its robot stands, if it was saved."""
    return root / FOLDER / f"{name}.yml"


def members_of(authority: Authority, name: str) -> tuple[Member, ...]:
    """Members of the VPN, good or not, that were let in as this vehicle."""
    members = authority.membership().members.values()
    return tuple(member for member in members if member.vehicle == name and member.partner is not None)


def unknown(declaration: Declaration, name: str) -> errors.NoMatchError:
    """There is no such guest, and never was."""
    guests = [key for key, vehicle in declaration.vehicles.items() if isinstance(vehicle, model.Guest)]
    near = errors.nearest(name, guests)
    hint = f"did you mean `{near}`?" if near else f"there are: {', '.join(guests) or 'none'}"
    return errors.NoMatchError(f"there is no guest `{name}`", hint=hint)


def remove_handouts(authority: Authority, members: Sequence[Member]) -> None:
    """Remove the sealed files that were made for them: nothing that they open is of use any more."""
    for member in members:
        for certificate in member.certificates:
            shutil.rmtree(authority.folder / "handouts" / certificate.common_name, ignore_errors=True)


def left_over(root: Path, authority: Authority, name: str) -> tuple[str, ...]:
    """What is still there of a guest that was ended, in words; read anew from the declaration and the record."""
    leftovers = []
    if name in load(root).vehicles:
        leftovers.append(f"`{name}` still stands in {FILE}")
    if (robot := robot_file(root, name)).exists():
        leftovers.append(f"{robot} is still there")
    for member in members_of(authority, name):
        if member.good:
            leftovers.append(f"`{member.name}` still has a good certificate")
        places = [authority.folder / "handouts" / item.common_name for item in member.certificates]
        leftovers += [f"{place} is still there" for place in places if place.exists()]
    return tuple(leftovers)
