"""Time: the zone and the servers."""

from __future__ import annotations

from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError, available_timezones

from atlantis_netcfg.core.suggest import nearest
from atlantis_netcfg.declaration._draft import Draft, Part, Rule

if TYPE_CHECKING:
    from collections.abc import Iterator
    from ipaddress import IPv4Address

    from atlantis_netcfg.declaration.findings import Finding


def zone(draft: Draft) -> Iterator[Finding]:
    """The zone is one of the IANA database, which RouterOS uses as well. A machine without the database cannot tell."""
    if draft.pilot is None or _exists(draft.pilot.time_zone):
        return
    known = available_timezones()
    if known:
        near = nearest(draft.pilot.time_zone, known)
        hint = f"did you mean `{near}`?" if near else "a time zone is like Europe/Lisbon"
        yield draft.wrong(Part("pilot"), ("time_zone",), f"there is no time zone `{draft.pilot.time_zone}`", hint)


def _exists(name: str) -> bool:
    try:
        ZoneInfo(name)
    except (ZoneInfoNotFoundError, ValueError, OSError):  # OSError: a folder of the database, like `Europe`
        return False
    return True


def servers(draft: Draft) -> Iterator[Finding]:
    """A time server stands once."""
    if draft.pilot is None:
        return
    seen: dict[IPv4Address, str] = {}
    for index, time_server in enumerate(draft.pilot.time_servers):
        if time_server.address in seen:
            message = f"{time_server.address} is already the address of {seen[time_server.address]}"
            yield draft.wrong(Part("pilot"), ("time_servers", index, "address"), message, "name another server")
        seen.setdefault(time_server.address, time_server.name)


RULES: tuple[Rule, ...] = (zone, servers)
