"""Would a plan cut the way by which we manage the device? Asked of the rows as the plan would leave them.

The way: the technician's address, the interface it comes in by (and the bridge ports behind it), the input filter, the
service with its certificate, the user and its policies, and the route of the answers. What is not understood counts
against the plan, unless it was the same before: then our session proves that it lets us through.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.routeros.guard import _access, _firewall, _link, _route
from atlantis_netcfg.routeros.guard._state import ManagementPath, State
from atlantis_netcfg.routeros.guard._touch import touches_path
from atlantis_netcfg.routeros.planner import after, simulate

if TYPE_CHECKING:
    from atlantis_netcfg.routeros._types import Observed, Plan

__all__ = ["MENUS", "ManagementPath", "objections", "touches"]

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
    "/user",
    "/user/group",
)
"""What must be read for the guard to see; a menu that is missing has no rows to it."""


def objections(plan: Plan, observed: Observed, path: ManagementPath) -> tuple[str, ...]:
    """Return why the plan would cut `path`, one sentence each, with what to do instead; nothing if it would not."""
    before = State(observed.rows, path)
    later = State(simulate(observed.rows, plan), path)
    link = tuple(_link.objections(before, later))
    # Without its address or interface there is no way back either: one reason is enough.
    route = () if link else tuple(_route.objections(before, later))
    return tuple(
        dict.fromkeys((*link, *_firewall.objections(before, later), *_access.objections(before, later), *route))
    )


def touches(plan: Plan, observed: Observed, path: ManagementPath) -> bool:
    """Tell whether any action touches the path at all, even if all is well in the end."""
    rows = dict(observed.rows)
    for action in plan.actions:
        then = after(rows, (action,))
        if touches_path(action, State(rows, path), State(then, path)):
            return True
        rows = then
    return False
