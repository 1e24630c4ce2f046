"""Would a plan cut the way by which we manage the device? Asked of the rows as the plan would leave them.

The way: the technician's address, the interface it comes in by (and the bridge ports behind it), the input filter, the
service with its certificate, the user and its policies, and the route of the answers. What is not understood counts
against the plan, unless it was the same before: then our session proves that it lets us through.
"""

from __future__ import annotations

import re

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
"""What must be read for the guard to see; a menu that is missing has no rows to it."""
WAY_BACK = (*INTERFACES, "/interface/bridge/port", "/ip/address", "/ip/route", "/routing/rule", "/routing/settings")
"""Those of them that decide where our answers leave: enough for a plan of routes alone that does not move them."""


def moves_answers(plan: _types.Plan, observation: _types.Observation, path: ManagementPath) -> bool:
    """Tell whether a plan of routes leads our answers another way; if not, all else judges them by rows as before."""
    later = State(simulate(observation.rows, plan), path)
    return _route.decisions(State(observation.rows, path)) != _route.decisions(later)


def objections(plan: _types.Plan, observation: _types.Observation, path: ManagementPath) -> tuple[str, ...]:
    """Return why the plan would cut `path`, one sentence each, with what to do instead; nothing if it would not.

    A new name of a port moves no packet, so that before and after are compared under the new names; how a port is
    called today is said beside them.
    """
    names = [action for action in plan.actions if action.layer is _types.Layer.NAMES]
    before = State(after(observation.rows, names), path)
    later = State(simulate(observation.rows, plan), path)
    link = tuple(_link.objections(before, later))
    # Without its address or interface there is no way back either: one reason is enough.
    route = () if link else tuple(_route.objections(before, later))
    reasons = (*link, *_firewall.firewall_objections(before, later), *_access.access_objections(before, later), *route)
    return tuple(dict.fromkeys(_with_names_of_today(reason, observation, before) for reason in reasons))


def _with_names_of_today(reason: str, observation: _types.Observation, renamed_state: State) -> str:
    lines = [
        f"{now['name']} is the port that is called {row['name']} today"
        for menu in INTERFACES
        for row, now in zip(observation.rows.get(menu, ()), renamed_state.all(menu), strict=True)
        if row.get("name") != now.get("name") and re.search(rf"(?<![\w-]){re.escape(now['name'])}(?![\w-])", reason)
    ]
    return f"{reason} ({', '.join(lines)})" if lines else reason


def touches(plan: _types.Plan, observation: _types.Observation, path: ManagementPath) -> bool:
    """Tell whether any action touches the path at all, even if all is well in the end."""
    rows = dict(observation.rows)
    for action in plan.actions:
        then = after(rows, (action,))
        if touches_path(action, State(rows, path), State(then, path)):
            return True
        rows = then
    return False
