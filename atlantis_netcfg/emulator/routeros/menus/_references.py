"""Arguments that reference rows of other menus, derived from the recorded router's completions.

If the words offered for an argument are the names of all rows of one menu, it references rows of that menu. If they are
those of several menus, its own name decides (`profile` of `/ip/hotspot/user`: `/ip/hotspot/user/profile`).
"""

from __future__ import annotations

from itertools import takewhile

from atlantis_netcfg.emulator.routeros import schema
from atlantis_netcfg.emulator.routeros.values import Ref, Refs

_INTERFACE, _LIST, _QUEUES, _LOOPBACK = "/interface", "/interface/list", "/queue/type", "lo"
_DEVICES = ("/file", "/port")
"""Menus that do not list every valid value: folders to be created, modems."""
_SPACES = {"/routing/table": "table"}


def references(path: str, name: str) -> Refs | None:
    """Return the type of an argument that references one or more rows, else None."""
    target = reference(path, name)
    # Queues of both directions: `queue=up/down` (exports of `/queue/simple`).
    return Refs(target, between="/" if target.spaces == (_QUEUES,) else ",") if target is not None else None


def reference(path: str, name: str) -> Ref | None:
    """Return the type of an argument that references one row, else None."""
    words = frozenset(schema.offered_values(path, name))
    interfaces, lists = words & schema.recorded_rows()[_INTERFACE], words & schema.recorded_rows()[_LIST]
    # Addresses are offered with the interfaces that may follow them, `lo` among them.
    if "interface" not in name and _LOOPBACK in interfaces:
        return None
    if lists != schema.recorded_rows()[_LIST]:
        lists = frozenset()
    spaces = [
        *(["interface"] if interfaces or (lists and "interface" in name and not name.endswith("list")) else []),
        *(["list"] if lists else []),
    ]
    menu = None if spaces else _referenced_menu(path, name)
    if menu is not None:
        return Ref((_SPACES.get(menu, menu),), tuple(sorted(words - schema.recorded_rows()[menu])))
    return Ref(tuple(spaces), tuple(sorted(words - interfaces - lists))) if spaces else None


def names_rows(path: str, name: str) -> bool:
    """Return whether an argument's offered values include rows, files or devices of the recorded router."""
    devices = schema.recorded_rows()[_INTERFACE].union(*(schema.recorded_rows()[menu] for menu in _DEVICES))
    return bool(schema.menus_named(path, name)) or not devices.isdisjoint(schema.offered_values(path, name))


def _referenced_menu(path: str, name: str) -> str | None:
    menus = schema.menus_named(path, name)
    if set(_DEVICES) & set(menus) or "address" in schema.description(path, name):
        return None
    if len(menus) == 1:
        return menus[0]
    fits = [menu for menu in menus if _alike(menu, name) and _common_depth(path, menu) > 1]
    return max(fits, key=lambda menu: (_alike(menu, name), _common_depth(path, menu), -menu.count("/")), default=None)


def _alike(menu: str, name: str) -> int:
    """Return how many path words a name ends with: 2 of `/ip/hotspot/user/profile` for `trial-user-profile`."""
    parts = menu.strip("/").split("/")
    return sum(name.removesuffix("s").endswith("-".join(parts[start:])) for start in range(len(parts)))


def _common_depth(path: str, menu: str) -> int:
    pairs = zip(path.split("/"), menu.split("/"), strict=False)
    return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], pairs))
