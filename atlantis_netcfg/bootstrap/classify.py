"""Read a device through its console, and classify it: factory-fresh, adopted, half adopted, or configured by others."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING

from atlantis_netcfg.bootstrap.steps import CLEARED, factory_users, is_default, is_foreign, prepare
from atlantis_netcfg.bootstrap.target import FACTORY_USER, TEMPORARY, DeviceState, Facts, Row
from atlantis_netcfg.console.types import ConsoleRefused, parse_rows
from atlantis_netcfg.core.errors import DeviceFailed
from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.rsc import RscError, console_path, parse

if TYPE_CHECKING:
    from atlantis_netcfg.bootstrap.target import Target
    from atlantis_netcfg.console.types import Console


def recognise(facts: Facts, target: Target, now: datetime) -> DeviceState:
    """Tell by users, certificates and the export.

    A device that is adopted may hold anything: it may have been provisioned since.
    """
    ours = any(user.get("name") == target.user for user in facts.users)
    if ours and not prepare(facts, target, now) and not _left(facts) and not factory_users(facts, target):
        return DeviceState.ADOPTED
    if foreign(facts, target):
        return DeviceState.SOMEONES
    marked = any("atlantis" in (dict(statement.values).get("comment") or "") for statement in facts.export.statements)
    return DeviceState.HALF if ours or marked else DeviceState.FACTORY


def _left(facts: Facts) -> bool:
    """Whether something of the default configuration, or of first contact, is still there."""
    return any(
        is_default(statement) or (dict(statement.values).get("comment") or "").startswith(TEMPORARY)
        for statement in facts.export.statements
    )


def foreign(facts: Facts, target: Target) -> tuple[str, ...]:
    """What neither the factory nor this toolkit has put there: menus with their number of lines, names of users."""
    lines: dict[str, int] = {}
    for statement in facts.export.statements:
        if is_foreign(statement):
            lines[statement.menu] = lines.get(statement.menu, 0) + 1
    found = [f"{console_path(menu)} ({count})" for menu, count in lines.items()]
    users = [user.get("name", "") for user in facts.users if user.get("name") not in (FACTORY_USER, target.user)]
    found += [f"user {name}" for name in users]
    certificates = [certificate.get("name", "") for certificate in facts.certificates]
    return (*found, *(f"certificate {name}" for name in certificates if name not in target.certificates))


_NO_MENU = ("bad command name", "no such command", "expected end of command", "syntax error")


def look(console: Console) -> Facts:
    """Read everything that first contact decides by. Raises DeviceFailed if it is no RouterOS that can be read."""
    resource = _settings(console, "/system/resource") or {}
    try:
        version = Version.parse(resource.get("version", ""))
    except ValueError as error:
        raise DeviceFailed("the console does not answer like RouterOS: no version was read") from error
    hidden = " hide-sensitive" if version < Version(7, 0) else ""
    text = console.run(f"/export{hidden}")
    try:
        export = parse(text, "the device's export")
    except RscError as error:
        raise DeviceFailed(f"the device's export could not be read: {error}") from error
    return Facts(
        version=version,
        board=resource.get("board-name", ""),
        architecture=resource.get("architecture-name", ""),
        packages=_packages(console),
        device_mode=_settings(console, "/system/device-mode"),
        now=_clock(_settings(console, "/system/clock") or {}),
        users=_rows(console, "/user"),
        certificates=_rows(console, "/certificate"),
        services=_rows(console, "/ip/service"),
        ethernets=_rows(console, "/interface/ethernet"),
        rows={menu: _rows(console, menu) for menu in CLEARED},
        export=export,
        text=text,
    )


def fingerprint(console: Console, certificate: str) -> str:
    """SHA-256 of a certificate on the device, as its console prints it; empty before it is signed."""
    found = [row for row in _rows(console, "/certificate") if row.get("name") == certificate]
    return found[0].get("fingerprint", "").replace(":", "").lower() if found else ""


def _rows(console: Console, menu: str) -> tuple[Row, ...]:
    """Rows of a menu; none where this version or these packages do not have the menu."""
    try:
        return tuple(console.rows(console_path(menu)))
    except ConsoleRefused as refused:
        if refused.words.startswith(_NO_MENU):
            return ()
        raise


def _settings(console: Console, menu: str) -> Row | None:
    """The one row of a menu of settings, which have no `detail`."""
    try:
        rows = parse_rows(console.run(f":put [{console_path(menu)} print as-value]").replace("\n", ""))
    except ConsoleRefused as refused:
        if refused.words.startswith(_NO_MENU):
            return None
        raise
    return rows[0] if rows else None


def _packages(console: Console) -> tuple[str, ...]:
    rows = _rows(console, "/system/package")
    return tuple(row.get("name", "") for row in rows if row.get("disabled") not in ("true", "yes"))


def _clock(row: Row) -> datetime | None:
    """The device's clock; before 7.10 it writes months by name."""
    text = f"{row.get('date', '')} {row.get('time', '')}"
    for form in ("%Y-%m-%d %H:%M:%S", "%b/%d/%Y %H:%M:%S"):
        try:
            return datetime.strptime(text.title() if "/" in text else text, form).replace(tzinfo=UTC)
        except ValueError:
            continue
    return None
