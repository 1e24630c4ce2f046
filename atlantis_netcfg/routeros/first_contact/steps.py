"""Steps of first contact: a pure function of what was read; completed steps are not planned again.

Also here: reading a device through its console and classifying it (factory-fresh, adopted, partly adopted, or
configured by others), and the types (target state, facts, routes to the console, result).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from enum import StrEnum
from ipaddress import IPv4Interface
from typing import TYPE_CHECKING, Protocol

from atlantis_netcfg.core.errors import DeviceError
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.routeros import rsc
from atlantis_netcfg.routeros.console import types

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from atlantis_netcfg.core.secret import Secret


CLEARED_MENUS = (
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
_TOLERATED_MENUS = {
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
"""Menus in which default configurations set something, with the settings where they are known."""
_BUILTIN_LISTS = ("all", "none", "dynamic", "static")


def comment_is_ours(comment: str) -> bool:
    """Return True if the comment is one of this toolkit's."""
    return comment.startswith("atlantis")


def is_default(statement: rsc.Statement) -> bool:
    """Return True if the factory script created this row."""
    values = dict(statement.values)
    comment = values.get("comment") or ""
    if statement.verb != "add":
        return False
    return comment.startswith("defconf") or values.get("name") in _KNOWN_NAMES.get(statement.menu, ())


def is_foreign(statement: rsc.Statement) -> bool:
    """Return True if neither the factory nor this toolkit wrote this line of an export."""
    values = dict(statement.values)
    if comment_is_ours(values.get("comment") or "") or is_default(statement):
        return False
    if statement.menu == "/ip/service":
        return statement.target != "api-ssl"
    if statement.verb == "add" or statement.menu not in _TOLERATED_MENUS:
        return True
    allowed_values = _TOLERATED_MENUS[statement.menu]
    return allowed_values is not None and not set(values) <= set(allowed_values)


def removable(menu: str, rows: tuple[Row, ...]) -> list[Row]:
    """Return the rows to remove, in a possible order: firewall rules from the last one.

    Rows written by this toolkit are kept, except those for first contact only.
    """
    removals = [row for row in rows if _is_removable(menu, row)]
    return removals[::-1]


def _is_removable(menu: str, row: Row) -> bool:
    comment = row.get("comment", "")
    if any(row.get(flag) in ("true", "yes") for flag in ("dynamic", "builtin", "default")):
        return False
    if menu == "/interface/list" and row.get("name") in _BUILTIN_LISTS:
        return False
    return comment.startswith(TEMPORARY) or not comment_is_ours(comment)


def resets(version: Version) -> Mapping[str, Mapping[str, str]]:
    """Return the RouterOS defaults that replace the default configuration (Manual, CLI reference of each menu)."""
    discover_list = "!dynamic" if version < Version(7, 0) else "static"
    return {
        "/ip/dns": {"allow-remote-requests": "no"},
        "/ip/neighbor/discovery-settings": {"discover-interface-list": discover_list},
        "/tool/mac-server": {"allowed-interface-list": "all"},
        "/tool/mac-server/mac-winbox": {"allowed-interface-list": "all"},
        "/disk/settings": {"auto-media-interface": "none", "auto-media-sharing": "no", "auto-smb-sharing": "no"},
    }


PORT_S = 30.0
"""Timeout of steps that may disconnect a laptop on the port that leaves the bridge."""
SIGN_S = 600.0
"""Timeout for signing: a small CPU takes minutes for an RSA key."""
_DAYS_VALID = 3650
_KEY_SIZE = 2048
_USAGE = "digital-signature,key-encipherment,tls-server"
_CLOCK_OFF = timedelta(days=2)
_TRUE = ("true", "yes")
_RADIOS = ("/interface/wireless", "/interface/wifi")


@dataclass(frozen=True, slots=True)
class ConsoleLine:
    """One line for the console; `secrets` are values in it that must not be shown."""

    text: str
    secrets: tuple[Secret, ...] = ()
    timeout_s: float = 180.0


@dataclass(frozen=True, slots=True)
class AdoptionStep:
    """A group of lines; `title` is shown to the user, `is_guarded` requests safe mode."""

    key: str
    title: str
    lines: tuple[ConsoleLine, ...]
    is_guarded: bool = False


def prepare(facts: BoxFacts, target: AdoptionTarget, now: datetime) -> tuple[AdoptionStep, ...]:
    """Return the steps that add our access beside the current one. `now`: the laptop's clock, UTC."""
    steps = (
        _clock(facts, now),
        _user(facts, target),
        _certificate(facts, target),
        _service(facts, target),
        _port(facts, target),
    )
    return tuple(step for step in steps if step is not None and step.lines)


def clear(facts: BoxFacts) -> tuple[AdoptionStep, ...]:
    """Return the steps that remove the default configuration and other rows in its menus; for the management port."""
    lines: list[ConsoleLine] = [*_radios_off(facts)]
    back = _reset_lines(facts)
    for menu in CLEARED_MENUS:
        if menu == "/interface/list/member":
            lines += back
        lines += [
            ConsoleLine(f"{rsc.console_path(menu)} remove {row['.id']}") for row in removable(menu, facts.rows[menu])
        ]
    if not lines:
        return ()
    return (
        AdoptionStep(
            "clear",
            msg(f"remove the default configuration ({arg(len(lines))} commands)"),
            tuple(lines),
            is_guarded=True,
        ),
    )


def _radios_off(facts: BoxFacts) -> Iterator[ConsoleLine]:
    """Yield lines that disable the factory's open Wi-Fi, which would lose its firewall.

    A radio with our comment has been provisioned, and is kept.
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
            where = " ".join(f"{name}={rsc.quote(value or '')}" for name, value in statement.find)
            yield ConsoleLine(f"{rsc.console_path(statement.menu)} set [ find {where} ] disabled=yes")


def close_door(facts: BoxFacts, target: AdoptionTarget) -> tuple[AdoptionStep, ...]:
    """Return the step that disables all users except ours."""
    names = factory_users(facts, target)
    lines = tuple(ConsoleLine(f"/user disable {rsc.quote(name)}") for name in names)
    return (AdoptionStep("users", msg(f"disable user {arg(join(', ', names))}"), lines),) if lines else ()


def factory_users(facts: BoxFacts, target: AdoptionTarget) -> list[str]:
    """Return the enabled users other than ours."""
    users = [user for user in facts.users if user.get("disabled") not in _TRUE]
    return [user["name"] for user in users if user.get("name") not in (None, target.user)]


def _clock(facts: BoxFacts, now: datetime) -> AdoptionStep | None:
    """Return the step that sets the clock: without a battery it starts in 1970, and the certificate would expire."""
    if facts.now is not None and abs(facts.now - now) < _CLOCK_OFF:
        return None
    date = now.strftime("%Y-%m-%d") if facts.version >= Version(7, 10) else now.strftime("%b/%d/%Y").lower()
    line = ConsoleLine(f"/system clock set date={date} time={now:%H:%M:%S}")
    return AdoptionStep("clock", msg(f"set the clock ({arg(date)}, UTC)"), (line,))


def _user(facts: BoxFacts, target: AdoptionTarget) -> AdoptionStep | None:
    password = f"password={_quote_value(target.password.reveal())}"
    account = next((user for user in facts.users if user.get("name") == target.user), None)
    if account is None:
        line = ConsoleLine(
            f"/user add name={rsc.quote(target.user)} group=full {password} comment=atlantis", (target.password,)
        )
        return AdoptionStep("user", msg(f"add user {arg(target.user)} (group full)"), (line,))
    if account.get("group") == "full" and account.get("disabled") not in _TRUE:
        return None
    line = ConsoleLine(f"/user set {rsc.quote(target.user)} group=full disabled=no {password}", (target.password,))
    return AdoptionStep("user", msg(f"enable user {arg(target.user)} (group full)"), (line,))


def _certificate(facts: BoxFacts, target: AdoptionTarget) -> AdoptionStep | None:
    """Return the step for a self-signed certificate; it is pinned (Manual, Certificates: no `ca`, self-signed)."""
    match = next((certificate for certificate in facts.certificates if certificate.get("name") == CERTIFICATE), None)
    sign = ConsoleLine(f"/certificate sign {CERTIFICATE}", timeout_s=SIGN_S)
    if match is None:
        names = rsc.quote(f"IP:{target.host},DNS:{target.name}")
        add = ConsoleLine(
            f"/certificate add name={CERTIFICATE} common-name={rsc.quote(target.name)} subject-alt-name={names} "
            f"key-size={_KEY_SIZE} days-valid={_DAYS_VALID} key-usage={_USAGE}"
        )
        return AdoptionStep("certificate", msg(f"create certificate {arg(CERTIFICATE)} on the device"), (add, sign))
    if not match.get("fingerprint"):
        return AdoptionStep("certificate", msg(f"sign certificate {arg(CERTIFICATE)} on the device"), (sign,))
    return None


def _service(facts: BoxFacts, target: AdoptionTarget) -> AdoptionStep | None:
    service = next((row for row in facts.services if row.get("name") == "api-ssl" and "port" in row), {})
    desired_values = {"certificate": CERTIFICATE, "port": str(target.api_port)}
    if (
        all(service.get(name) == value for name, value in desired_values.items())
        and service.get("disabled") not in _TRUE
    ):
        return None
    line = ConsoleLine(f"/ip service set api-ssl certificate={CERTIFICATE} disabled=no port={target.api_port}")
    return AdoptionStep("api-ssl", msg(f"api-ssl with that certificate on port {arg(target.api_port)}"), (line,))


def _port(facts: BoxFacts, target: AdoptionTarget) -> AdoptionStep | None:
    """Return the step that frees the management port, gives it its address, and lets it through the firewall."""
    name = next((row.get("name", "") for row in facts.ethernets if row.get("default-name") == target.port), target.port)
    addresses = facts.rows["/ip/address"]
    there = any(row.get("address") == target.address and row.get("interface") == name for row in addresses)
    lines = [*_free_port(facts, name)]
    stale = [row for row in addresses if row.get("address") == target.address and row.get("interface") != name]
    lines += [ConsoleLine(f"/ip address remove {row['.id']}") for row in stale if row.get("dynamic") not in _TRUE]
    if not there or lines:
        lines += _let_in(facts, name)
    if not there:
        value = f"address={target.address} interface={rsc.quote(name)}"
        lines.append(ConsoleLine(f"/ip address add {value} comment={rsc.quote(MARK)}"))
    title = msg(f"management address {arg(target.address)} on {arg(target.port)}")
    soon = tuple(replace(line, timeout_s=PORT_S) for line in lines)
    return AdoptionStep("management", title, soon, is_guarded=True) if lines else None


def _free_port(facts: BoxFacts, name: str) -> Iterator[ConsoleLine]:
    ethernet = next((row for row in facts.ethernets if row.get("name") == name), {})
    if ethernet.get("disabled") in _TRUE:
        yield ConsoleLine(f"/interface ethernet enable {rsc.quote(name)}")
    for menu in ("/interface/bridge/port", "/ip/dhcp-client"):
        for row in facts.rows[menu]:
            if row.get("interface") == name and row.get("dynamic") not in _TRUE:
                yield ConsoleLine(f"{rsc.console_path(menu)} remove {row['.id']}")


def _let_in(facts: BoxFacts, name: str) -> list[ConsoleLine]:
    """Return one rule before all others; it is removed together with them."""
    rules = [row for row in facts.rows["/ip/firewall/filter"] if row.get("dynamic") not in _TRUE]
    if not rules or any(row.get("comment", "") == TEMPORARY for row in rules):
        return []
    rule = f"chain=input action=accept in-interface={rsc.quote(name)} comment={rsc.quote(TEMPORARY)}"
    return [ConsoleLine(f"/ip firewall filter add {rule} place-before={rules[0]['.id']}")]


def _reset_lines(facts: BoxFacts) -> list[ConsoleLine]:
    lines = []
    for menu, plain in resets(facts.version).items():
        device_row: Row = {}
        for statement in facts.export.statements:
            if statement.menu == menu and statement.verb == "set":
                device_row |= {name: value or "" for name, value in statement.values}
        change = {name: value for name, value in plain.items() if device_row.get(name, value) != value}
        if change:
            values = " ".join(f"{name}={rsc.quote(value)}" for name, value in change.items())
            lines.append(ConsoleLine(f"{rsc.console_path(menu)} set {values}"))
    return lines


def _quote_value(value: str) -> str:
    """Quote a value for the command line; an empty value must be quoted, too."""
    return rsc.quote(value) if value else '""'


def recognise(facts: BoxFacts, target: AdoptionTarget, now: datetime) -> DeviceState:
    """Classify the device by its users, certificates and export.

    An adopted device may contain anything else: it may have been provisioned since.
    """
    ours = any(user.get("name") == target.user for user in facts.users)
    if ours and not prepare(facts, target, now) and not _has_leftovers(facts) and not factory_users(facts, target):
        return DeviceState.ADOPTED
    if foreign(facts, target):
        return DeviceState.SOMEONES
    has_marks = any(
        "atlantis" in (dict(statement.values).get("comment") or "") for statement in facts.export.statements
    )
    return DeviceState.HALF if ours or has_marks else DeviceState.FACTORY


def _has_leftovers(facts: BoxFacts) -> bool:
    """Return True if parts of the default configuration, or of first contact, remain."""
    return any(
        is_default(statement) or (dict(statement.values).get("comment") or "").startswith(TEMPORARY)
        for statement in facts.export.statements
    )


def foreign(facts: BoxFacts, target: AdoptionTarget) -> tuple[str, ...]:
    """Return what others have configured: menus with their number of lines, and user names."""
    lines: dict[str, int] = {}
    for statement in facts.export.statements:
        if is_foreign(statement):
            lines[statement.menu] = lines.get(statement.menu, 0) + 1
    items = [msg(f"{arg(rsc.console_path(menu))} ({arg(count)})") for menu, count in lines.items()]
    users = [user.get("name", "") for user in facts.users if user.get("name") not in (FACTORY_USER, target.user)]
    items += [msg(f"user {arg(name)}") for name in users]
    certificates = [certificate.get("name", "") for certificate in facts.certificates]
    return (*items, *(msg(f"certificate {arg(name)}") for name in certificates if name not in target.certificates))


_NO_MENU = ("bad command name", "no such command", "expected end of command", "syntax error")


def look(console: types.Console) -> BoxFacts:
    """Read everything that first contact needs. Raises DeviceError if it is not RouterOS or cannot be read."""
    resource = _settings(console, "/system/resource") or {}
    try:
        version = Version.parse(resource.get("version", ""))
    except ValueError as error:
        raise DeviceError("the console does not respond like RouterOS: no version was read") from error
    option = " hide-sensitive" if version < Version(7, 0) else ""
    text = console.run(f"/export{option}")
    try:
        export = rsc.parse(text, "the device's export")
    except rsc.RscError as error:
        raise DeviceError(f"the device's export could not be read: {arg(error)}") from error
    return BoxFacts(
        version=version,
        board=resource.get("board-name", ""),
        architecture=resource.get("architecture-name", ""),
        packages=_packages(console),
        device_mode=_settings(console, "/system/device-mode"),
        now=_clock_of(_settings(console, "/system/clock") or {}),
        users=_rows(console, "/user"),
        certificates=_rows(console, "/certificate"),
        services=_rows(console, "/ip/service"),
        ethernets=_rows(console, "/interface/ethernet"),
        rows={menu: _rows(console, menu) for menu in CLEARED_MENUS},
        export=export,
        text=text,
    )


def fingerprint(console: types.Console, certificate: str) -> str:
    """Return the SHA-256 of a certificate as printed on the console; empty before it is signed."""
    matches = [row for row in _rows(console, "/certificate") if row.get("name") == certificate]
    return matches[0].get("fingerprint", "").replace(":", "").lower() if matches else ""


def _rows(console: types.Console, menu: str) -> tuple[Row, ...]:
    """Return the rows of a menu; none if the version or packages lack the menu."""
    try:
        return tuple(console.rows(rsc.console_path(menu)))
    except types.ConsoleCommandError as refused:
        if refused.words.startswith(_NO_MENU):
            return ()
        raise


def _settings(console: types.Console, menu: str) -> Row | None:
    """Return the single row of a settings menu, which has no `detail`."""
    try:
        rows = types.parse_rows(console.run(f":put [{rsc.console_path(menu)} print as-value]").replace("\n", ""))
    except types.ConsoleCommandError as refused:
        if refused.words.startswith(_NO_MENU):
            return None
        raise
    return rows[0] if rows else None


def _packages(console: types.Console) -> tuple[str, ...]:
    rows = _rows(console, "/system/package")
    return tuple(row.get("name", "") for row in rows if row.get("disabled") not in ("true", "yes"))


def _clock_of(row: Row) -> datetime | None:
    """Return the device's clock; before 7.10 months are names."""
    text = f"{row.get('date', '')} {row.get('time', '')}"
    for form in ("%Y-%m-%d %H:%M:%S", "%b/%d/%Y %H:%M:%S"):
        try:
            return datetime.strptime(text.title() if "/" in text else text, form).replace(tzinfo=UTC)
        except ValueError:
            continue
    return None


Row = dict[str, str]


FACTORY_ADDRESS = "192.168.88.1"


FACTORY_USER = "admin"


CERTIFICATE = "atlantis-api"


MARK = "atlantis: management"
"""Comment of the management address."""


TEMPORARY = "atlantis: first contact"
"""Comment of rows that exist only until first contact is complete."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AdoptionTarget:
    """The adopted state of one router, from the inventory."""

    name: str
    user: str
    password: Secret
    address: str
    """Address on the management port, with prefix length."""
    technician: str
    """The laptop's own address in the management network."""
    port: str
    """Factory name of the management port."""
    ports: tuple[str, ...]
    """Factory names of all declared ports."""
    model: str | None = None
    api_port: int = 8729
    features: Mapping[str, str] = field(default_factory=dict)
    """Features of device-mode that the declared text needs, each with the menu that needs it."""
    radio: bool = False
    """Whether the declared text configures a wireless interface."""
    certificates: tuple[str, ...] = (CERTIFICATE,)
    """Certificates that the declared text refers to; somebody may have imported them already."""

    @property
    def host(self) -> str:
        """The management address without its prefix length."""
        return str(IPv4Interface(self.address).ip)

    @property
    def laptop(self) -> str:
        """The address and prefix to enter in the laptop's network settings."""
        return f"{self.technician}/{IPv4Interface(self.address).network.prefixlen}"


class DeviceState(StrEnum):
    """Ownership of the device."""

    FACTORY = "factory-fresh"
    HALF = "partly adopted by an earlier run"
    ADOPTED = "adopted"
    SOMEONES = "configured by somebody"


@dataclass(frozen=True, slots=True, kw_only=True)
class BoxFacts:
    """Properties of a device, read on its console."""

    version: Version
    board: str
    architecture: str
    packages: tuple[str, ...]
    device_mode: Mapping[str, str] | None
    """Settings of device-mode; None: the device has no device-mode."""
    now: datetime | None
    """The device's clock; None if it could not be read."""
    users: tuple[Row, ...]
    certificates: tuple[Row, ...]
    services: tuple[Row, ...]
    ethernets: tuple[Row, ...]
    rows: Mapping[str, tuple[Row, ...]]
    """Rows of the menus that a default configuration fills, by menu."""
    export: rsc.Export
    text: str
    """The export as printed, without secrets."""


class ConsoleRoute(Protocol):
    """A route to a device's console."""

    label: str
    """Readable name of the route: an address, or a serial line."""
    serial: bool

    def open(self, user: str, password: Secret) -> types.Console:
        """Log in. Raises ConsoleUnreachable, ConsoleLoginError, HostKeyMismatch, ConsoleLost."""

    def prove(self, pin: str) -> None:
        """Log in by api-ssl as our user, under this certificate alone. Raises ConsoleUnreachable, NetcfgError."""

    def meet(self) -> None:
        """Read the SSH host key without a login, if it is unknown. Raises NetcfgError."""


class ConsoleRoutes(Protocol):
    """The two routes to the console, and the known host key."""

    first: ConsoleRoute
    """Port to which the technician is connected."""
    final: ConsoleRoute
    """The management address."""

    @property
    def host_key(self) -> str | None:
        """The host key presented by the device; None before the first SSH connection."""


class AdoptionStatus(StrEnum):
    """Result of first contact."""

    ALREADY = "unchanged"
    PLANNED = "planned"
    ADOPTED = "changed"


@dataclass(frozen=True, slots=True)
class AdoptionOutcome:
    """Result of first contact; `notes` lists what was not verified, and what to do next."""

    status: AdoptionStatus
    standing: DeviceState
    steps: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    facts: BoxFacts | None = None
