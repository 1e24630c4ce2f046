"""Checks whether a plan would cut our own management access, using the rows that the plan would leave.

Checked are the technician's address, the interface it comes in by (and the bridge ports behind it), the input filter,
the service with its certificate, the user and its policies, and the route of the replies. What we cannot evaluate
counts against the plan, unless it was the same before: then our session proves that it lets us through.
"""

from __future__ import annotations

import re

from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.routeros import _types
from atlantis_netcfg.routeros.guard import _access, _firewall, _link, _route
from atlantis_netcfg.routeros.guard._access import touches_path
from atlantis_netcfg.routeros.guard._state import INTERFACES, ManagementPath, State
from atlantis_netcfg.routeros.planner import after, simulate

__all__ = ["MENUS", "WAY_BACK", "ManagementPath", "moves_answers", "objections", "touches"]

MENUS = (
    "/certificate",
    "/interface/bridge",
    "/interface/bridge/port",
    "/interface/ethernet",
    "/interface/list",
    "/interface/list/member",
    "/interface/ovpn-client",
    "/ip/address",
    "/ip/dhcp-client",
    "/ip/firewall/address-list",
    "/ip/firewall/filter",
    "/ip/firewall/mangle",
    "/ip/firewall/nat",
    "/ip/route",
    "/ip/service",
    "/routing/rule",
    "/routing/settings",
    "/user",
    "/user/group",
)
"""Menus that the guard needs; a missing menu counts as empty."""
WAY_BACK = (*INTERFACES, "/interface/bridge/port", "/ip/address", "/ip/route", "/routing/rule", "/routing/settings")
"""Menus that decide where our replies leave: enough for a plan of routes only that does not move them."""


def moves_answers(plan: _types.Plan, observation: _types.Observation, path: ManagementPath) -> bool:
    """Return True if a routing plan changes the route of our replies; if not, all other checks use the old rows."""
    later = State(simulate(observation.rows, plan), path)
    return _route.decisions(State(observation.rows, path)) != _route.decisions(later)


def objections(plan: _types.Plan, observation: _types.Observation, path: ManagementPath) -> tuple[str, ...]:
    """Return why the plan would cut `path`, one sentence each with a remedy; empty if it would not.

    Renaming a port moves no packet. So before and after are compared under the new names, and the current port name is
    printed beside them.
    """
    names = [action for action in plan.actions if action.layer is _types.Layer.NAMES]
    before = State(after(observation.rows, names), path)
    later = State(simulate(observation.rows, plan), path)
    link = tuple(_link.objections(before, later))
    # Without its address or interface there is no way back either: one reason is enough.
    route = () if link else tuple(_route.objections(before, later))
    reasons = (*link, *_firewall.firewall_objections(before, later), *_access.access_objections(before, later), *route)
    return tuple(dict.fromkeys(_with_current_names(reason, observation, before) for reason in reasons))


def _with_current_names(reason: str, observation: _types.Observation, renamed_state: State) -> str:
    lines = [
        msg(f"{arg(now['name'])} is the port that is now called {arg(row['name'])}")
        for menu in INTERFACES
        for row, now in zip(observation.rows.get(menu, ()), renamed_state.all(menu), strict=True)
        if row.get("name") != now.get("name") and re.search(rf"(?<![\w-]){re.escape(now['name'])}(?![\w-])", reason)
    ]
    return msg(f"{arg(reason)} ({arg(join(', ', lines))})") if lines else reason


def touches(plan: _types.Plan, observation: _types.Observation, path: ManagementPath) -> bool:
    """Return True if any action touches the path, even if the final state is correct."""
    rows = dict(observation.rows)
    for action in plan.actions:
        then = after(rows, (action,))
        if touches_path(action, State(rows, path), State(then, path)):
            return True
        rows = then
    return False
