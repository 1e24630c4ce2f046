"""Whether the router lets us in: the service, its certificate, the user and the user's group."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.routeros.guard._packet import Answer, in_networks
from atlantis_netcfg.routeros.guard._state import is_set
from atlantis_netcfg.routeros.menus import MENUS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.routeros._types import Row
    from atlantis_netcfg.routeros.guard._state import State

POLICIES = frozenset({"api", "read", "write", "policy", "test", "sensitive"})
"""What provisioning cannot do without."""

_ENOUGH_SESSIONS = 2


def objections(before: State, after: State) -> Iterator[str]:
    """Yield what would keep a new session of ours out."""
    yield from _service(before, after)
    yield from _user(before, after)
    yield from _group(before, after)


def _service(before: State, after: State) -> Iterator[str]:
    path = before.path
    old = before.find("/ip/service", "name", path.service)
    new = after.find("/ip/service", "name", path.service)
    if old is None or new is None:
        return
    text = f"/ip service: {path.service}, which this session uses,"
    if is_set(new, "disabled") and not is_set(old, "disabled"):
        yield f"{text} would be disabled: leave it enabled"
    if _form("port", old) != _form("port", new):
        yield (
            f"{text} would move from port {old.get('port')} to {new.get('port')}: leave the port, or enter the new one "
            f"in the inventory and change it on the router by hand"
        )
    if _admits(old, before) and not _admits(new, after):
        yield f"{text} would admit only {new.get('address')}, not you at {path.technician}: add your address"
    if _form("certificate", old) != _form("certificate", new):
        yield (
            f"{text} would change its certificate from {old.get('certificate', 'none')} to "
            f"{new.get('certificate', 'none')}, and we would not know the router again: leave it"
        )
    if _form("vrf", old) != _form("vrf", new):
        yield f"{text} would listen in {new.get('vrf')} only: leave vrf={old.get('vrf', 'main')}"
    if int(new.get("max-sessions", "20")) < _ENOUGH_SESSIONS <= int(old.get("max-sessions", "20")):
        yield f"{text} would take one session only, and a change is verified by a second: raise max-sessions"


def _form(name: str, row: Row) -> str:
    return MENUS["/ip/service"].form(name, row)


def _admits(row: Row, state: State) -> bool:
    return in_networks(row.get("address", ""), state.technician) is not Answer.NO


def _user(before: State, after: State) -> Iterator[str]:
    name = before.path.user
    old, new = before.find("/user", "name", name), after.find("/user", "name", name)
    if old is None:
        return
    if new is None:
        yield f"/user: {name}, as whom we are logged in, would be removed: keep that user"
    elif is_set(new, "disabled") and not is_set(old, "disabled"):
        yield f"/user: {name}, as whom we are logged in, would be disabled: leave it enabled"
    elif _admits(old, before) and not _admits(new, after):
        yield (
            f"/user: {name}, as whom we are logged in, would be admitted only from {new.get('address')}, not from "
            f"{before.path.technician}: add your address"
        )


def _group(before: State, after: State) -> Iterator[str]:
    lost = sorted((_policies(before) - _policies(after)) & POLICIES)
    if lost and after.find("/user", "name", before.path.user) is not None:
        yield f"/user group: {before.path.user} would lose the policies {', '.join(lost)}: keep them in its group"


def _policies(state: State) -> frozenset[str]:
    user = state.find("/user", "name", state.path.user) or {}
    group = state.find("/user/group", "name", user.get("group", "")) or {}
    return frozenset(word for word in group.get("policy", "").split(",") if word and not word.startswith("!"))
