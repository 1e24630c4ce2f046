"""Who may log in (Manual, User; Manual, API: Login)."""

from __future__ import annotations

from ipaddress import ip_address, ip_network
from typing import TYPE_CHECKING

from atlantis_netcfg.twin.answers import Caller, Trap

if TYPE_CHECKING:
    from collections.abc import Callable

    from atlantis_netcfg.twin.core import Core

__all__ = ["admit"]

_REFUSED = "invalid user name or password (6)"
_POLICIES = {"api-ssl": "api", "console": "local"}


def admit(core: Core, user: str, right: Callable[[str], bool], via: str, address: str) -> Caller:
    """Return the new session. Raises Trap, in the same words whatever is wrong about name, password or address."""
    table = core.store.table("/user")
    for item in table.items:
        if core.store.text(table, item, "name") != user or core.store.text(table, item, "disabled") == "yes":
            continue
        if not right(core.store.text(table, item, "password") or "") or not _from(item.values, address):
            break
        group = core.store.text(table, item, "group") or ""
        caller = Caller(core.number(), user, group, via, address, core.now())
        if _POLICIES.get(via, via) not in core.policies(caller):
            break
        core.note("system,info,account", f"user {user} logged in{_place(address)} via {via}")
        return caller
    core.note("system,error,critical", f"login failure for user {user}{_place(address)} via {via}")
    raise Trap(_REFUSED)


def _place(address: str) -> str:
    return f" from {address}" if address else ""


def _from(values: dict[str, str], address: str) -> bool:
    allowed = values.get("address", "")
    if not address:
        return True  # a local console
    caller = ip_address(address)
    return not allowed or any(caller in ip_network(part) for part in allowed.split(","))
