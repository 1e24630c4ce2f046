"""Whose is this device: nobody's yet, ours, half ours, or somebody else's."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.bootstrap._menus import is_default, is_foreign
from atlantis_netcfg.bootstrap._steps import factory_users, prepare
from atlantis_netcfg.bootstrap.target import FACTORY_USER, TEMPORARY, Standing
from atlantis_netcfg.rsc import console_path

if TYPE_CHECKING:
    from datetime import datetime

    from atlantis_netcfg.bootstrap.target import Facts, Wish

__all__ = ["foreign", "recognise"]


def recognise(facts: Facts, wish: Wish, now: datetime) -> Standing:
    """Tell by users, certificates and the export.

    A device that is adopted may hold anything: it may have been provisioned since.
    """
    ours = any(user.get("name") == wish.user for user in facts.users)
    if ours and not prepare(facts, wish, now) and not _left(facts) and not factory_users(facts, wish):
        return Standing.ADOPTED
    if foreign(facts, wish):
        return Standing.SOMEONES
    marked = any("atlantis" in (dict(one.values).get("comment") or "") for one in facts.export.statements)
    return Standing.HALF if ours or marked else Standing.FACTORY


def _left(facts: Facts) -> bool:
    """Whether something of the default configuration, or of first contact, is still there."""
    return any(
        is_default(one) or (dict(one.values).get("comment") or "").startswith(TEMPORARY)
        for one in facts.export.statements
    )


def foreign(facts: Facts, wish: Wish) -> tuple[str, ...]:
    """What neither the factory nor this toolkit has put there: menus with their number of lines, names of users."""
    lines: dict[str, int] = {}
    for statement in facts.export.statements:
        if is_foreign(statement):
            lines[statement.menu] = lines.get(statement.menu, 0) + 1
    found = [f"{console_path(menu)} ({count})" for menu, count in lines.items()]
    users = [user.get("name", "") for user in facts.users if user.get("name") not in (FACTORY_USER, wish.user)]
    found += [f"user {name}" for name in users]
    certificates = [one.get("name", "") for one in facts.certificates]
    return (*found, *(f"certificate {name}" for name in certificates if name not in wish.certificates))
