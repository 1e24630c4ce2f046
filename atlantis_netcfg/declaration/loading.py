"""From an inventory directory to a `Declaration`, or to all errors of the whole pilot in one pass."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import NothingMatched
from atlantis_netcfg.declaration._files import HOSTS, Sources, scan
from atlantis_netcfg.declaration._hosts import lay_out
from atlantis_netcfg.declaration._near import choices
from atlantis_netcfg.declaration._parts import draft
from atlantis_netcfg.declaration._variables import gather
from atlantis_netcfg.declaration._vault import CLOSED
from atlantis_netcfg.declaration.declaration import Declaration, Host
from atlantis_netcfg.declaration.findings import Finding, InventoryInvalid
from atlantis_netcfg.declaration.rules import RULES

if TYPE_CHECKING:
    from atlantis_netcfg.declaration._draft import Draft
    from atlantis_netcfg.declaration._hosts import Layout
    from atlantis_netcfg.declaration._node import Node
    from atlantis_netcfg.declaration._vault import Decrypt

__all__ = ["load", "validate"]


def load(inventory: Path, *, decrypt: Decrypt | None = None) -> Declaration:
    """Read and check the whole pilot.

    Raises InventoryInvalid with every error, NothingMatched where there is no inventory, no site or no host. Without
    `decrypt` vaulted secrets stay sealed: they can be declared and compared, not revealed.
    """
    sources, found, findings = _examine(inventory, decrypt)
    pilot = found.pilot if found is not None else None
    if findings or found is None or pilot is None:
        raise InventoryInvalid(findings)
    hosts = {name: Host(name, site, found.devices[name]) for name, site in found.layout.hosts.items()}
    digest = hashlib.sha256()
    for name, data in sorted(sources.contents.items()):
        digest.update(f"{name.removeprefix(sources.shown)}\0{len(data)}\0".encode() + data)
    return Declaration(
        inventory, pilot, found.partners, found.vehicles, found.sites, hosts, revision=digest.hexdigest()
    )


def validate(inventory: Path, *, decrypt: Decrypt | None = None) -> list[Finding]:
    """Every error of the inventory, sorted by place; raises NothingMatched as `load` does."""
    return _examine(inventory, decrypt)[2]


def _examine(inventory: Path, decrypt: Decrypt | None) -> tuple[Sources, Draft | None, list[Finding]]:
    sources = scan(_existing(inventory), _shown(inventory))
    root, findings = sources.read(inventory / HOSTS, decrypt)
    if root is None and findings:
        return sources, None, sorted({*findings, *sources.findings})
    layout = _filled(root, findings, sources.shown)
    variables = gather(sources, layout, decrypt)
    found, wrong = draft(layout, variables)
    findings += [*sources.findings, *layout.findings, *variables.findings, *wrong]
    for rule in RULES:
        findings.extend(rule(found))
    return sources, found, _one_closed(sorted(set(findings)))


def _one_closed(findings: list[Finding]) -> list[Finding]:
    """One wrong password closes every vaulted value: tell the first of them, and how many more there are."""
    closed = [finding for finding in findings if finding.message == CLOSED]
    if len(closed) < 2:  # noqa: PLR2004 - one is told as it is
        return findings
    first = replace(closed[0], message=f"{CLOSED}, nor {len(closed) - 1} more of the inventory")
    return [first if finding is closed[0] else finding for finding in findings if finding not in closed[1:]]


def _filled(root: Node | None, findings: list[Finding], shown: str) -> Layout:
    """The layout of hosts.yml; zero sites or zero hosts without an error that says why is never a green nothing."""
    layout = lay_out(root) if root is not None else None
    if layout is None or not (layout.sites or layout.findings or findings):
        raise NothingMatched(
            f"{shown}/{HOSTS} declares no site",
            hint="write all: children: sites: children: <site>: hosts: <host>:",
        )
    if not (layout.hosts or layout.findings or findings):
        raise NothingMatched(
            f"{shown}/{HOSTS} declares no host", hint=f"add hosts below a site; the sites are: {choices(layout.sites)}"
        )
    return layout


def _shown(inventory: Path) -> str:
    """The directory's name in errors: as a person in the current directory would type it."""
    path = inventory.absolute()
    here = Path.cwd()
    return path.relative_to(here).as_posix() if path.is_relative_to(here) and path != here else inventory.as_posix()


def _existing(inventory: Path) -> Path:
    if not inventory.is_dir():
        parent = inventory.absolute().parent
        near = [path.name for path in sorted(parent.iterdir()) if (path / HOSTS).is_file()] if parent.is_dir() else []
        hint = f"inventories here: {choices(near)}" if near else f"an inventory is a directory with {HOSTS} in it"
        what = "is a file" if inventory.exists() else "does not exist"
        raise NothingMatched(f"the inventory directory {inventory} {what}", hint=hint)
    if not (inventory / HOSTS).exists():
        there = [path.name for path in sorted(inventory.iterdir())]
        hint = f"it holds: {choices(there)}" if there else "it is empty"
        raise NothingMatched(f"there is no {HOSTS} in {inventory}", hint=hint)
    return inventory
