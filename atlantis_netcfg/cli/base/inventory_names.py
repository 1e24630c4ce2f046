"""Names in an inventory, for hints and completion: read quickly, without validation.

A missing or invalid file yields the names before its first error, and never raises: these names are suggestions for a
person, and no command relies on them.
"""

from __future__ import annotations

from contextlib import suppress
from enum import Enum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path


class Values(Enum):
    """Kinds of argument values known from the inventory or this laptop, for completion and hints."""

    SITE = "sites"
    HOST = "hosts"
    VEHICLE = "vehicles"
    PARTNER = "partners"
    RUN = "runs"
    RUN_OR_LATEST = "runs, or `latest`"


_ANY = "*"
_SITES = ("all", "children", "sites", "children")
_PLACES = {
    Values.SITE: ("hosts.yml", _SITES),
    Values.HOST: ("hosts.yml", (*_SITES, _ANY, "hosts")),
    Values.VEHICLE: ("group_vars/all/vehicles.yml", ("vehicles",)),
    Values.PARTNER: ("group_vars/all/partners.yml", ("partners",)),
}
"""File and mapping whose keys are these names (`atlantis_netcfg/inventory/loader.py`)."""


def folder_of(command_line: Sequence[str]) -> Path:
    """Return the inventory folder of a command line: the given one, otherwise the checkout's own."""
    from atlantis_netcfg.core import paths

    inventories = [word.partition("=")[2] for word in command_line if word.startswith("inventory=")]
    return paths.inventory_folder(inventories[-1] if inventories else None).expanduser()


def names(folder: Path, values: Values, site: str = "") -> list[str]:
    """Return the names of one kind in the order of the file; hosts only of `site` if it is given."""
    if values not in _PLACES:
        return []
    file, route = _PLACES[values]
    if site and values is Values.HOST:
        route = (*_SITES, site, "hosts")
    return [*dict.fromkeys(_keys(folder / file, route))]


def kind_of(folder: Path, name: str) -> Values | None:
    """Return the kind of a name in the inventory; None if it is unknown."""
    return next((values for values in _PLACES if name in names(folder, values)), None)


def _keys(path: Path, route: tuple[str, ...]) -> Iterator[str]:
    """Yield the keys of the mappings at `route` in a YAML file, up to its first error."""
    import yaml

    keys: list[str | None] = []
    """Current key of each open collection; None before the first key, and in a list."""
    at_key: list[bool] = []
    with suppress(OSError, UnicodeDecodeError, yaml.YAMLError):
        text = path.read_text(encoding="utf-8")
        for event in yaml.parse(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader)):
            if isinstance(event, yaml.CollectionStartEvent):
                keys.append(None)
                at_key.append(isinstance(event, yaml.MappingStartEvent))
                continue
            if isinstance(event, yaml.CollectionEndEvent):
                keys.pop()
                at_key.pop()
            elif not isinstance(event, yaml.ScalarEvent | yaml.AliasEvent):
                continue
            elif at_key and at_key[-1]:
                keys[-1] = str(getattr(event, "value", ""))
                at_key[-1] = False
                if _matches(keys[:-1], route):
                    yield str(keys[-1])
                continue
            if keys and keys[-1] is not None:  # a value has ended, and it was one of a mapping
                at_key[-1] = True


def _matches(keys: Sequence[str | None], route: tuple[str, ...]) -> bool:
    return len(keys) == len(route) and all(
        key is not None and step in (_ANY, key) for key, step in zip(keys, route, strict=True)
    )
