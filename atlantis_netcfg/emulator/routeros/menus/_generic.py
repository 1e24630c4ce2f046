"""Menus that the table does not model: what the command tree says of them, and no more.

Values: where the console of 7.21.5 offered several words for an argument, those are all it takes, but for the arguments
of which the list itself shows that it is only a part (numbers, addresses and names of rows are never offered in full).
"""

from __future__ import annotations

from dataclasses import dataclass

from atlantis_netcfg.emulator.routeros.menus._model import COMMENT, DISABLED, Arg, EmulatedMenu, Shape, Unique
from atlantis_netcfg.emulator.routeros.schema import Schema, offered
from atlantis_netcfg.emulator.routeros.values import Bool, Choices, Int, Not, Ref, Refs, Text, ValueType

_NOT_PROPERTIES = {"copy-from", "numbers", "place-before"}
_EVERYWHERE = {"comment": COMMENT, "disabled": DISABLED}
_SECRETS = ("password", "passphrase", "private-key", "preshared-key", "pre-shared-key", "secret", "pin", "key")
_NEVER = {("/user/ssh-keys", "key")}
_NO_INTERFACE = ("/interface/list", "/interface/lte/apn")
_KINDS: dict[tuple[str, str], ValueType] = {("/interface/vlan", "vlan-id"): Int(1, 4094)}
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
        "headers",
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
_NAMES_REPEAT = ("/ip/smb/shares", "/ip/smb/users", "/routing/bgp/connection", "/routing/id")
"""Menus of which exports (7.1.5 to 7.19.4) hold several rows of one name."""


@dataclass(frozen=True, slots=True)
class BuiltIn:
    """Rows that a factory-new router has in a menu which the table does not model."""

    rows: tuple[dict[str, str], ...]
    since: str = "7.0"


def _named(*names: str) -> tuple[dict[str, str], ...]:
    return tuple({"name": name} for name in names)


BUILT_IN = {
    "/caps-man/manager/interface": BuiltIn(({"interface": "all"},)),
    "/ip/firewall/service-port": BuiltIn(
        _named("ftp", "tftp", "irc", "h323", "sip", "pptp", "rtsp", "udplite", "dccp", "sctp")
    ),
    "/ip/hotspot/profile": BuiltIn(_named("default"), since="6.0"),
    "/ip/hotspot/service-port": BuiltIn(_named("ftp")),
    "/ip/ipsec/mode-config": BuiltIn(_named("request-only")),
    "/ip/ipsec/policy": BuiltIn(({},)),
    "/ip/ipsec/profile": BuiltIn(_named("default")),
    "/ip/ipsec/proposal": BuiltIn(_named("default")),
    "/ip/smb/shares": BuiltIn(_named("pub"), since="7.10"),
    "/ip/smb/users": BuiltIn(_named("guest"), since="7.14beta1"),
    "/ipv6/nd": BuiltIn(({"interface": "all"},)),
    "/port": BuiltIn(_named("serial0", "serial1")),
    "/ppp/profile": BuiltIn(_named("default", "default-encryption")),
    "/routing/bgp/template": BuiltIn(_named("default")),
    "/snmp/community": BuiltIn(_named("public")),
}
"""Only what exports of 6.49 to 7.23 set of them (`set [ find default=yes ]`, `set 0`, `set default`), under the names
of the Manual: IPsec, Services, SMB, SNMP, HotSpot, PPP, BGP. No export tells how many serial ports a board has: two."""
OF_THE_BOARD = ("/app", "/disk", "/system/resource/irq/rps")
"""Menus whose rows come with disks, processors and packages of a board: the twin does not have them."""


def generic(schema: Schema, path: str) -> EmulatedMenu:
    """Make the menu of a path that the command tree has."""
    names = schema.arguments(path, "add") | schema.arguments(path, "set")
    built_in = BUILT_IN.get(path)
    factory = built_in.rows if built_in is not None and schema.at_least(built_in.since) else ()
    interface = path.startswith("/interface/") and "name" in names and not path.startswith(_NO_INTERFACE)
    unique = (Unique(("name",), "failure: item with such name already exists"),) if "name" in names else ()
    unique = () if path in _NAMES_REPEAT else unique
    return EmulatedMenu(
        path,
        _shape(schema, path),
        unmodelled(path, names.union(*factory)),
        noun=path.rpartition("/")[2].replace("-", " "),
        space="interface" if interface else "",
        unique=unique,
        factory=factory,
        builtin_flag="default" if factory else "",
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


def _kind(path: str, name: str) -> ValueType:
    values = offered(path, name)
    if values == ("no", "yes"):
        return Bool()
    named = _rows(name, values)
    if named is not None:
        return Not(Refs(named))
    if name == "tcp-flags":
        return Choices(values, signed=True)
    if len(values) > 1 and name not in _OPEN and not _ROWS & set(values) and not path.startswith(_BY_PACKAGE):
        return Not(Choices(values, ordered=False))
    return _KINDS.get((path, name), Text())


def _rows(name: str, values: tuple[str, ...]) -> Ref | None:
    """Return what an argument takes that names interfaces or lists of them, and None for every other."""
    if "ether1" in values and ("interface" in name or name in _INTERFACES):
        return Ref(("interface", "list"), tuple(value for value in values if value not in _ROWS))
    return Ref(("list",), values) if {"all", "none"} <= set(values) and name.endswith("list") else None
