"""Menus that the table does not model: what the command tree says of them, and no more.

Values: where the console of 7.21.5 offered several words for an argument, those are all it takes, but for the arguments
of which the list itself shows that it is only a part (numbers, addresses and names of rows are never offered in full).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.menus._model import COMMENT, DISABLED, Arg, Menu, Shape, Unique
from atlantis_netcfg.emulator.routeros.schema import offered
from atlantis_netcfg.emulator.routeros.values import Bool, Choices, Int, Kind, Not, Ref, Refs, Text

if TYPE_CHECKING:
    from atlantis_netcfg.emulator.routeros.schema import Schema

__all__ = ["generic", "unmodelled"]

_NOT_PROPERTIES = {"copy-from", "numbers", "place-before"}
_EVERYWHERE = {"comment": COMMENT, "disabled": DISABLED}
_SECRETS = ("password", "passphrase", "private-key", "preshared-key", "pre-shared-key", "secret", "pin", "key")
_NEVER = {("/user/ssh-keys", "key")}
_NO_INTERFACE = ("/interface/list", "/interface/lte/apn")
_KINDS: dict[tuple[str, str], Kind] = {("/interface/vlan", "vlan-id"): Int(1, 4094)}
_INTERFACES = frozenset({"primary", "tagged", "untagged", "mvrp-forbidden"})
"""Arguments that name interfaces without saying so in their name."""
_ROWS = frozenset({"<l2tp>", "clientid", "default", "ether1", "full", "lo", "main", "serial0", "skins/"})
"""What other menus of the recorded router hold: names of rows, of which every router has its own."""
_OPEN = frozenset(
    [
        "address-list-timeout",
        "advertise-timeout",
        "arp-opcode",
        "baud-rate",
        "builtin-trust-store",
        "ca-certificate",
        "certificate",
        "chain",
        "code",
        "communities",
        "crl-store",
        "do-group-num",
        "do-select-num",
        "filter-dst-port",
        "filter-ip-protocol",
        "filter-mac-protocol",
        "filter-port",
        "filter-src-port",
        "group-authority",
        "group-master",
        "hop-limit",
        "incoming-filter",
        "input.limit-process-routes-ipv4",
        "input.limit-process-routes-ipv6",
        "insert-queue-before",
        "ip-protocol",
        "ipsec-policy",
        "ipv6-next-header",
        "jump-target",
        "label",
        "line-count",
        "mac-protocol",
        "max-block-size",
        "mode-config",
        "my-id",
        "new-hop-limit",
        "new-priority",
        "outgoing-filter",
        "per-connection-classifier",
        "preshared-key",
        "private-key",
        "protocol",
        "radius-mac-format",
        "remote-id",
        "rule",
        "select-dynamic-id",
        "transition-time",
        "ttl",
        "vlan-encap",
        "vlan-protocol",
        "vrf",
    ]
)
"""Arguments that take numbers, addresses, texts or names of rows beside the words that are offered."""
_BY_PACKAGE = ("/disk",)
"""Menus whose words depend on packages that the recorded router did not have."""


def generic(schema: Schema, path: str) -> Menu:
    """Make the menu of a path that the command tree has."""
    names = schema.arguments(path, "add") | schema.arguments(path, "set")
    interface = path.startswith("/interface/") and "name" in names and not path.startswith(_NO_INTERFACE)
    unique = (Unique(("name",), "failure: item with such name already exists"),) if "name" in names else ()
    return Menu(
        path,
        _shape(schema, path),
        unmodelled(path, names),
        noun=path.rpartition("/")[2].replace("-", " "),
        space="interface" if interface else "",
        unique=unique,
        modelled=False,
    )


def unmodelled(path: str, names: frozenset[str]) -> tuple[Arg, ...]:
    """Make the arguments of these names: their values are taken as they come."""
    return tuple(
        _EVERYWHERE.get(name)
        or Arg(name, _kind(path, name), secret=name.endswith(_SECRETS), never=(path, name) in _NEVER)
        for name in sorted(names - _NOT_PROPERTIES)
    )


def _shape(schema: Schema, path: str) -> Shape:
    commands = schema.commands(path)
    if "add" in commands:
        return Shape.LIST
    if "numbers" in schema.arguments(path, "set") or ("find" in commands and "set" not in commands):
        return Shape.FIXED
    return Shape.SETTINGS


def _kind(path: str, name: str) -> Kind:
    values = offered(path, name)
    if values == ("no", "yes"):
        return Bool()
    named = _rows(name, values)
    if named is not None:
        return Not(Refs(named))
    if len(values) > 1 and name not in _OPEN and not _ROWS & set(values) and not path.startswith(_BY_PACKAGE):
        return Not(Choices(values, ordered=False))
    return _KINDS.get((path, name), Text())


def _rows(name: str, values: tuple[str, ...]) -> Ref | None:
    """Return what an argument takes that names interfaces or lists of them, and None for every other."""
    if "ether1" in values and ("interface" in name or name in _INTERFACES):
        return Ref(("interface", "list"), tuple(value for value in values if value not in _ROWS))
    return Ref(("list",), values) if {"all", "none"} <= set(values) and name.endswith("list") else None
