"""Plan the steps of first contact: a pure function of what was read; finished steps are not planned again."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import timedelta
from typing import TYPE_CHECKING

from atlantis_netcfg.bootstrap.target import CERTIFICATE, MARK, TEMPORARY
from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.rsc import console_path, quote

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from datetime import datetime

    from atlantis_netcfg.bootstrap.target import Facts, Row, Target
    from atlantis_netcfg.core.secret import Secret
    from atlantis_netcfg.rsc import Statement


CLEARED = (
    "/ip/dhcp-client",
    "/ipv6/dhcp-client",
    "/ip/firewall/nat",
    "/ip/firewall/mangle",
    "/ip/firewall/raw",
    "/ip/firewall/filter",
    "/ip/firewall/address-list",
    "/ipv6/firewall/filter",
    "/ipv6/firewall/address-list",
    "/ip/dhcp-server/lease",
    "/ip/dhcp-server/network",
    "/ip/dhcp-server",
    "/ip/pool",
    "/ip/dns/static",
    "/interface/list/member",
    "/interface/list",
    "/ip/address",
    "/interface/bridge/port",
    "/interface/bridge",
)
_KNOWN_NAMES = {
    "/ip/pool": ("default-dhcp", "dhcp"),
    "/ip/dhcp-server": ("defconf", "default"),
}
_TOLERATED = {
    "/disk": None,
    "/disk/settings": None,
    "/interface/ethernet/switch": None,
    "/interface/ethernet/switch/port": None,
    "/interface/lte": None,
    "/interface/lte/apn": None,
    "/interface/wifi": None,
    "/interface/wireless": None,
    "/interface/wireless/security-profiles": None,
    "/ip/dns": ("allow-remote-requests",),
    "/ip/neighbor/discovery-settings": ("discover-interface-list",),
    "/port": None,
    "/system/clock": None,
    "/system/note": ("show-at-login",),
    "/system/routerboard/settings": None,
    "/tool/mac-server": ("allowed-interface-list",),
    "/tool/mac-server/mac-winbox": ("allowed-interface-list",),
}
"""Menus in which default configurations set something, and what, where that is known."""
_BUILTIN_LISTS = ("all", "none", "dynamic", "static")


def comment_is_ours(comment: str) -> bool:
    """Whether a row is one of this toolkit's."""
    return comment.startswith("atlantis")


def is_default(statement: Statement) -> bool:
    """Whether the factory's script made this row."""
    values = dict(statement.values)
    comment = values.get("comment") or ""
    if statement.verb != "add":
        return False
    return comment.startswith("defconf") or values.get("name") in _KNOWN_NAMES.get(statement.menu, ())


def is_foreign(statement: Statement) -> bool:
    """Whether neither the factory nor this toolkit wrote this line of an export."""
    values = dict(statement.values)
    if comment_is_ours(values.get("comment") or "") or is_default(statement):
        return False
    if statement.menu == "/ip/service":
        return statement.target != "api-ssl"
    if statement.verb == "add" or statement.menu not in _TOLERATED:
        return True
    allowed = _TOLERATED[statement.menu]
    return allowed is not None and not set(values) <= set(allowed)


def removable(menu: str, rows: tuple[Row, ...]) -> list[Row]:
    """Rows of a menu that are to go, in the order in which they may: firewalls from their end.

    What this toolkit wrote stays, but for what was only meant for first contact.
    """
    found = [row for row in rows if _goes(menu, row)]
    return found[::-1]


def _goes(menu: str, row: Row) -> bool:
    comment = row.get("comment", "")
    if any(row.get(flag) in ("true", "yes") for flag in ("dynamic", "builtin", "default")):
        return False
    if menu == "/interface/list" and row.get("name") in _BUILTIN_LISTS:
        return False
    return comment.startswith(TEMPORARY) or not comment_is_ours(comment)


def resets(version: Version) -> Mapping[str, Mapping[str, str]]:
    """What the settings of a default configuration are without one (Manual, CLI reference of each menu)."""
    discovered = "!dynamic" if version < Version(7, 0) else "static"
    return {
        "/ip/dns": {"allow-remote-requests": "no"},
        "/ip/neighbor/discovery-settings": {"discover-interface-list": discovered},
        "/tool/mac-server": {"allowed-interface-list": "all"},
        "/tool/mac-server/mac-winbox": {"allowed-interface-list": "all"},
        "/disk/settings": {"auto-media-interface": "none", "auto-media-sharing": "no", "auto-smb-sharing": "no"},
    }


PORT_S = 30.0
"""A laptop on the very port that leaves the bridge hears nothing any more: it is told soon."""
SIGN_S = 600.0
"""A small CPU takes minutes for an RSA key."""
_DAYS_VALID = 3650
_KEY_SIZE = 2048
_USAGE = "digital-signature,key-encipherment,tls-server"
_CLOCK_OFF = timedelta(days=2)
_TRUE = ("true", "yes")
_RADIOS = ("/interface/wireless", "/interface/wifi")


@dataclass(frozen=True, slots=True)
class Line:
    """One line for the console; `secrets` are values in it that nobody may read."""

    text: str
    secrets: tuple[Secret, ...] = ()
    timeout_s: float = 180.0


@dataclass(frozen=True, slots=True)
class Step:
    """Lines that belong together; `title` is for a person, `guarded` for safe mode."""

    key: str
    title: str
    lines: tuple[Line, ...]
    guarded: bool = False


def prepare(facts: Facts, target: Target, now: datetime) -> tuple[Step, ...]:
    """What is added beside the way in use, which it leaves alone. `now`: the laptop's clock, UTC."""
    steps = (
        _clock(facts, now),
        _user(facts, target),
        _certificate(facts, target),
        _service(facts, target),
        _port(facts, target),
    )
    return tuple(step for step in steps if step is not None and step.lines)


def clear(facts: Facts) -> tuple[Step, ...]:
    """Remove the default configuration (and whatever stands in its menus); to be typed over the management port."""
    lines: list[Line] = [*_radios_off(facts)]
    back = _resets(facts)
    for menu in CLEARED:
        if menu == "/interface/list/member":
            lines += back
        lines += [Line(f"{console_path(menu)} remove {row['.id']}") for row in removable(menu, facts.rows[menu])]
    if not lines:
        return ()
    return (Step("clear", f"remove the default configuration ({len(lines)} commands)", tuple(lines), guarded=True),)


def _radios_off(facts: Facts) -> Iterator[Line]:
    """Switch off what the factory has on the air, open and without a firewall behind it any more.

    A radio that carries our comment has been provisioned, and stays.
    """
    for statement in facts.export.statements:
        values = dict(statement.values)
        ours = (values.get("comment") or "").startswith("atlantis")
        if (
            statement.menu in _RADIOS
            and statement.verb == "set"
            and statement.find
            and values.get("disabled") == "no"
            and not ours
        ):
            where = " ".join(f"{name}={quote(value or '')}" for name, value in statement.find)
            yield Line(f"{console_path(statement.menu)} set [ find {where} ] disabled=yes")


def close_door(facts: Facts, target: Target) -> tuple[Step, ...]:
    """Disable everybody but our user."""
    names = factory_users(facts, target)
    lines = tuple(Line(f"/user disable {quote(name)}") for name in names)
    return (Step("users", f"disable user {', '.join(names)}", lines),) if lines else ()


def factory_users(facts: Facts, target: Target) -> list[str]:
    """Users besides ours who may log in."""
    users = [user for user in facts.users if user.get("disabled") not in _TRUE]
    return [user["name"] for user in users if user.get("name") not in (None, target.user)]


def _clock(facts: Facts, now: datetime) -> Step | None:
    """A box without battery wakes up in 1970: its certificate would have expired before it is used."""
    if facts.now is not None and abs(facts.now - now) < _CLOCK_OFF:
        return None
    date = now.strftime("%Y-%m-%d") if facts.version >= Version(7, 10) else now.strftime("%b/%d/%Y").lower()
    line = Line(f"/system clock set date={date} time={now:%H:%M:%S}")
    return Step("clock", f"set the clock ({date}, UTC)", (line,))


def _user(facts: Facts, target: Target) -> Step | None:
    password = f"password={_typed(target.password.reveal())}"
    found = next((user for user in facts.users if user.get("name") == target.user), None)
    if found is None:
        line = Line(f"/user add name={quote(target.user)} group=full {password} comment=atlantis", (target.password,))
        return Step("user", f"add user {target.user} (group full)", (line,))
    if found.get("group") == "full" and found.get("disabled") not in _TRUE:
        return None
    line = Line(f"/user set {quote(target.user)} group=full disabled=no {password}", (target.password,))
    return Step("user", f"let user {target.user} in (group full)", (line,))


def _certificate(facts: Facts, target: Target) -> Step | None:
    """Self-signed: it is pinned, nobody follows a chain (Manual, Certificates: without `ca` it signs itself)."""
    found = next((certificate for certificate in facts.certificates if certificate.get("name") == CERTIFICATE), None)
    sign = Line(f"/certificate sign {CERTIFICATE}", timeout_s=SIGN_S)
    if found is None:
        names = quote(f"IP:{target.host},DNS:{target.name}")
        add = Line(
            f"/certificate add name={CERTIFICATE} common-name={quote(target.name)} subject-alt-name={names} "
            f"key-size={_KEY_SIZE} days-valid={_DAYS_VALID} key-usage={_USAGE}"
        )
        return Step("certificate", f"make certificate {CERTIFICATE} on the device", (add, sign))
    if not found.get("fingerprint"):
        return Step("certificate", f"sign certificate {CERTIFICATE} on the device", (sign,))
    return None


def _service(facts: Facts, target: Target) -> Step | None:
    found = next((row for row in facts.services if row.get("name") == "api-ssl" and "port" in row), {})
    desired = {"certificate": CERTIFICATE, "port": str(target.api_port)}
    if all(found.get(name) == value for name, value in desired.items()) and found.get("disabled") not in _TRUE:
        return None
    line = Line(f"/ip service set api-ssl certificate={CERTIFICATE} disabled=no port={target.api_port}")
    return Step("api-ssl", f"api-ssl with that certificate on port {target.api_port}", (line,))


def _port(facts: Facts, target: Target) -> Step | None:
    """The management port out of the bridge, with its address, and let in by whatever firewall there is."""
    name = next((row.get("name", "") for row in facts.ethernets if row.get("default-name") == target.port), target.port)
    addresses = facts.rows["/ip/address"]
    there = any(row.get("address") == target.address and row.get("interface") == name for row in addresses)
    lines = [*_freed(facts, name)]
    stale = [row for row in addresses if row.get("address") == target.address and row.get("interface") != name]
    lines += [Line(f"/ip address remove {row['.id']}") for row in stale if row.get("dynamic") not in _TRUE]
    if not there or lines:
        lines += _let_in(facts, name)
    if not there:
        value = f"address={target.address} interface={quote(name)}"
        lines.append(Line(f"/ip address add {value} comment={quote(MARK)}"))
    title = f"management address {target.address} on {target.port}"
    soon = tuple(replace(line, timeout_s=PORT_S) for line in lines)
    return Step("management", title, soon, guarded=True) if lines else None


def _freed(facts: Facts, name: str) -> Iterator[Line]:
    ethernet = next((row for row in facts.ethernets if row.get("name") == name), {})
    if ethernet.get("disabled") in _TRUE:
        yield Line(f"/interface ethernet enable {quote(name)}")
    for menu in ("/interface/bridge/port", "/ip/dhcp-client"):
        for row in facts.rows[menu]:
            if row.get("interface") == name and row.get("dynamic") not in _TRUE:
                yield Line(f"{console_path(menu)} remove {row['.id']}")


def _let_in(facts: Facts, name: str) -> list[Line]:
    """One rule before all others; it goes with them."""
    rules = [row for row in facts.rows["/ip/firewall/filter"] if row.get("dynamic") not in _TRUE]
    if not rules or any(row.get("comment", "") == TEMPORARY for row in rules):
        return []
    rule = f"chain=input action=accept in-interface={quote(name)} comment={quote(TEMPORARY)}"
    return [Line(f"/ip firewall filter add {rule} place-before={rules[0]['.id']}")]


def _resets(facts: Facts) -> list[Line]:
    lines = []
    for menu, plain in resets(facts.version).items():
        device_row: Row = {}
        for statement in facts.export.statements:
            if statement.menu == menu and statement.verb == "set":
                device_row |= {name: value or "" for name, value in statement.values}
        change = {name: value for name, value in plain.items() if device_row.get(name, value) != value}
        if change:
            values = " ".join(f"{name}={quote(value)}" for name, value in change.items())
            lines.append(Line(f"{console_path(menu)} set {values}"))
    return lines


def _typed(value: str) -> str:
    """A value for the command line; an empty one is refused bare."""
    return quote(value) if value else '""'
