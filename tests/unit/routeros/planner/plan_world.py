"""Devices for tests, written as the text that a technician would read on them."""

from atlantis_netcfg.core.versions import Version
from atlantis_netcfg.routeros._types import Facts, Observation, Plan, Row
from atlantis_netcfg.routeros.commands import console
from atlantis_netcfg.routeros.menus import MENUS
from atlantis_netcfg.routeros.rsc import parse

POLICIES = frozenset({"local", "ssh", "reboot", "read", "write", "policy", "test", "password", "sensitive", "api"})


def facts(version: str = "7.18.2", policies: frozenset[str] = POLICIES) -> Facts:
    return Facts(
        identity="router",
        version=Version.parse(version),
        board="RB5009UPr+S+",
        architecture="arm64",
        device_mode={"mode": "advanced"},
        packages=("routeros",),
        policies=policies,
        has_safe_mode=True,
        safe_mode_owner=None,
        session_address="10.64.101.10",
        history=0,
    )


def rows(text: str) -> dict[str, tuple[Row, ...]]:
    """Rows of all menus; ids count from *1 in each menu; any property may be given, flags included."""
    found: dict[str, list[Row]] = {path: [] for path in MENUS}
    for statement in parse(text).statements:
        menu = found[statement.menu]
        keys = dict(statement.find or ())
        if statement.target is not None:
            keys = {MENUS[statement.menu].keys[0]: statement.target}
        menu.append({".id": f"*{len(menu) + 1}", **keys, **{name: value or "" for name, value in statement.values}})
    return {path: tuple(each) for path, each in found.items()}


def observed(text: str, version: str = "7.18.2", policies: frozenset[str] = POLICIES) -> Observation:
    return Observation(facts(version, policies), rows(text))


def lines(plan: Plan) -> list[str]:
    return [console(action) for action in plan.actions]
