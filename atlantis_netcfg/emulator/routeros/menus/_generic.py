"""Menus that are not modelled: only the knowledge of the command tree.

Values: if the console of 7.21.5 offered several words for an argument, only those are accepted, except where the list
is clearly incomplete (numbers, addresses and row names are never offered in full).
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from atlantis_netcfg.emulator.routeros.menus import _model
from atlantis_netcfg.emulator.routeros.menus._references import names_rows, references
from atlantis_netcfg.emulator.routeros.schema import Schema, description, offered_values
from atlantis_netcfg.emulator.routeros.values import Bool, Choices, Int, Not, Plausible, Ref, Text, ValueType

_NOT_PROPERTIES = {"copy-from", "numbers", "place-before"}
_EVERYWHERE = {"comment": _model.COMMENT, "disabled": _model.DISABLED_ARG}
_SECRETS = ("password", "passphrase", "private-key", "preshared-key", "pre-shared-key", "secret", "pin", "key")
_NEVER = {("/user/ssh-keys", "key")}
_NO_INTERFACE = ("/interface/list", "/interface/lte/apn")
_KINDS: dict[tuple[str, str], ValueType] = {
    ("/interface/vlan", "vlan-id"): Int(1, 4094),
    ("/queue/interface", "interface"): Ref(("interface",)),
}
_PORT, _ADDRESS = re.compile(r"(^|[.-])port$"), re.compile(r"(^|[.-])(address(es)?|gateway|host|servers?)$")
_NAME_PROPERTIES = {"/queue/interface": "interface"}
"""Menus whose rows are identified by a property other than `name`."""
_OPEN = (
    "arp-opcode baud-rate builtin-trust-store ca-certificate certificate chain code communities crl-store"
    " default-route-tables do-group-num do-select-num filter-dst-port filter-ip-protocol filter-mac-protocol"
    " filter-port filter-src-port group-authority group-master headers hop-limit incoming-filter"
    " input.limit-process-routes-ipv4 input.limit-process-routes-ipv6 insert-queue-before ip-protocol ipsec-policy"
    " ipv6-next-header jump-target label line-count mac-protocol max-block-size my-id new-hop-limit new-priority"
    " outgoing-filter per-connection-classifier protocol radius-mac-format remote-id rule select-dynamic-id ttl"
    " vlan-encap vlan-protocol"
)
"""Arguments that accept numbers, addresses or text besides the offered words, although the tree does not show it."""
_BY_PACKAGE = ("/disk",)
"""Menus whose offered words depend on packages that the recorded router did not have."""
_NAMES_REPEAT = ("/ip/smb/shares", "/ip/smb/users", "/routing/bgp/connection", "/routing/id")
"""Menus in which exports (7.1.5 to 7.19.4) contain several rows of one name."""


@dataclass(frozen=True, slots=True)
class BuiltIn:
    """Factory rows of a menu that is not modelled."""

    rows: tuple[dict[str, str], ...]
    since: str = "7.0"


def _named_rows(*names: str) -> tuple[dict[str, str], ...]:
    return tuple({"name": name} for name in names)


_QUEUES = (
    *(("default", "pfifo"), ("ethernet-default", "pfifo"), ("wireless-default", "sfq"), ("synchronous-default", "red")),
    *(("hotspot-default", "sfq"), ("pcq-upload-default", "pcq"), ("pcq-download-default", "pcq")),
    *(("only-hardware-queue", "none"), ("multi-queue-ethernet-default", "mq-pfifo"), ("default-small", "pfifo")),
)
BUILT_IN = {
    "/caps-man/manager/interface": BuiltIn(({"interface": "all"},)),
    "/ip/dhcp-client/option": BuiltIn(_named_rows("clientid_duid", "clientid", "hostname"), since="6.0"),
    "/ip/firewall/service-port": BuiltIn(
        _named_rows("ftp", "tftp", "irc", "h323", "sip", "pptp", "rtsp", "udplite", "dccp", "sctp")
    ),
    "/ip/hotspot/profile": BuiltIn(_named_rows("default"), since="6.0"),
    "/ip/hotspot/service-port": BuiltIn(_named_rows("ftp")),
    "/ip/hotspot/user": BuiltIn(_named_rows("default-trial"), since="6.0"),
    "/ip/hotspot/user/profile": BuiltIn(_named_rows("default"), since="6.0"),
    "/ip/ipsec/mode-config": BuiltIn(_named_rows("request-only")),
    "/ip/ipsec/policy": BuiltIn(({},)),
    "/ip/ipsec/policy/group": BuiltIn(_named_rows("default"), since="6.0"),
    "/ip/ipsec/profile": BuiltIn(_named_rows("default")),
    "/ip/ipsec/proposal": BuiltIn(_named_rows("default")),
    "/ip/smb/shares": BuiltIn(_named_rows("pub"), since="7.10"),
    "/ip/smb/users": BuiltIn(_named_rows("guest"), since="7.14beta1"),
    "/ipv6/dhcp-relay/option": BuiltIn(_named_rows("client_mac")),
    "/ipv6/nd": BuiltIn(({"interface": "all"},)),
    "/port": BuiltIn(_named_rows("serial0", "serial1")),
    "/ppp/profile": BuiltIn(
        ({".id": "*0", "name": "default"}, {".id": "*FFFFFFFE", "name": "default-encryption"}), since="6.0"
    ),
    "/queue/type": BuiltIn(tuple({"name": name, "kind": kind} for name, kind in _QUEUES), since="6.0"),
    "/routing/bgp/template": BuiltIn(_named_rows("default")),
    "/snmp/community": BuiltIn(_named_rows("public")),
    "/tool/romon/port": BuiltIn(({"interface": "all"},)),
}
"""Rows limited to what exports of 6.49 to 7.23 set (`set [ find default=yes ]`, `set 0`, `set default`).

Names as in the Manual: IPsec, Services, SMB, SNMP, HotSpot, PPP, BGP.
No export shows how many serial ports a board has: two.
"""
_OF_THE_BOARD = ("/app", "/disk", "/system/console", "/system/leds")
"""Menus whose rows depend on disks, LEDs and packages of a board, although more can be added."""


def generic(schema: Schema, path: str) -> _model.EmulatedMenu:
    """Build a menu from the command tree."""
    names = schema.arguments(path, "add") | schema.arguments(path, "set")
    built_in = BUILT_IN.get(path)
    factory = built_in.rows if built_in is not None and schema.at_least(built_in.since) else ()
    interface = path.startswith("/interface/") and "name" in names and not path.startswith(_NO_INTERFACE)
    unique = (_model.Unique(("name",), "failure: item with such name already exists"),) if "name" in names else ()
    unique = () if path in _NAMES_REPEAT else unique
    name_property, shape = _NAME_PROPERTIES.get(path, "name"), _shape(schema, path)
    is_fixed = shape is _model.Shape.FIXED_ROWS and schema.has_command(path, "set") and path not in _NAME_PROPERTIES
    return _model.EmulatedMenu(
        path,
        shape,
        unmodelled_arguments(path, names.union(*factory, {_NAME_PROPERTIES.get(path, "")}) - {"", ".id"}),
        noun=path.rpartition("/")[2].replace("-", " "),
        space="interface" if interface else "",
        name_property=name_property,
        unique=unique,
        factory=factory,
        builtin_flag="default" if factory else "",
        select=_model.Select.NAME if path in _NAME_PROPERTIES else _model.Select.INDEX,
        of_the_board=path in _OF_THE_BOARD or (is_fixed and not factory),
    )


def unmodelled_arguments(path: str, names: frozenset[str]) -> tuple[_model.Arg, ...]:
    """Build arguments whose values are not checked."""
    return tuple(
        _EVERYWHERE.get(name)
        or _model.Arg(name, _kind(path, name), secret=name.endswith(_SECRETS), never=(path, name) in _NEVER)
        for name in sorted(names - _NOT_PROPERTIES)
    )


def _shape(schema: Schema, path: str) -> _model.Shape:
    commands = schema.commands(path)
    if "add" in commands:
        return _model.Shape.LIST
    if "numbers" in schema.arguments(path, "set") or ("find" in commands and "set" not in commands):
        return _model.Shape.FIXED_ROWS
    return _model.Shape.SETTINGS


def _kind(path: str, name: str) -> ValueType:
    values = offered_values(path, name)
    if values == ("no", "yes"):
        return Bool()
    target = references(path, name)
    if target is not None:
        return Not(target)
    if name == "tcp-flags":
        return Choices(values, has_signs=True)
    described_otherwise = "|" not in (description(path, name) or "|")
    is_open = name in _OPEN.split() or described_otherwise or names_rows(path, name) or path.startswith(_BY_PACKAGE)
    return Not(Choices(values, is_ordered=False)) if values[1:] and not is_open else _text(path, name)


def _text(path: str, name: str) -> ValueType:
    if _PORT.search(name):
        return Plausible(ports=True)
    address = _ADDRESS.search(name) or "IP address" in description(path, name)
    return Plausible() if address else _KINDS.get((path, name), Text())
