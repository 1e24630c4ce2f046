"""`provision validate`: check the whole pilot, contact nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli._arguments import INVENTORY, JSON, Command
from atlantis_netcfg.core.errors import ExitCode

if TYPE_CHECKING:
    from pathlib import Path

    from atlantis_netcfg.cli._arguments import Arguments
    from atlantis_netcfg.declaration import Declaration, InventoryInvalid

COMMAND = Command(
    "validate",
    "check the whole declaration and list every error with its place",
    words=(INVENTORY,),
    flags=(JSON,),
    details="No device is contacted and no vault password is asked for: vaulted secrets stay closed.",
)


def run(arguments: Arguments) -> ExitCode:
    """Say what was checked, or list every error."""
    from pathlib import Path

    from atlantis_netcfg.core import paths
    from atlantis_netcfg.declaration import InventoryInvalid, load

    named = arguments.optional("inventory")
    inventory = Path(named) if named else paths.checkout() / "inventory"
    try:
        declaration = load(inventory)
    except InventoryInvalid as error:
        return _refuse(error, inventory, as_json=arguments.flag("json"))
    return _confirm(declaration, as_json=arguments.flag("json"))


def _refuse(error: InventoryInvalid, inventory: Path, *, as_json: bool) -> ExitCode:
    import dataclasses
    import sys

    if as_json:
        _print_json(error.exit, inventory, errors=[dataclasses.asdict(finding) for finding in error.findings])
    else:
        print(error, file=sys.stderr)
    return error.exit


def _confirm(declaration: Declaration, *, as_json: bool) -> ExitCode:
    from collections import Counter

    kinds = Counter(host.device.kind for host in declaration.hosts.values())
    checked = {
        "sites": [f"{site} ({len(declaration.site_hosts(site))} hosts)" for site in declaration.sites],
        "hosts": [f"{count} {kind}" for kind, count in kinds.items()],
        "vehicles": list(declaration.vehicles),
        "partners": list(declaration.partners),
    }
    counts = {name: len(getattr(declaration, name)) for name in checked}
    if as_json:
        _print_json(ExitCode.DONE, declaration.root, errors=[], checked=counts, revision=declaration.revision)
        return ExitCode.DONE
    print(f"{declaration.root}: no errors")
    for name, some in checked.items():
        print(f"  {counts[name]:>3} {name:<9} {', '.join(some)}".rstrip())
    if declaration.pilot.example_values:
        rehearsal = f"`provision site={next(iter(declaration.sites))} --rehearse`"
        print(f"It still holds example values: only rehearsals use it ({rehearsal}).")
    return ExitCode.DONE


def _print_json(code: ExitCode, inventory: Path, **more: object) -> None:
    import json

    print(json.dumps({"exit": int(code), "inventory": str(inventory), **more}, ensure_ascii=False))
