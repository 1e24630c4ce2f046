"""What can be broken in a rehearsal, by name: one thing each, and the items of the checklist that have to notice.

The things are those of the shipped inventory's coastal testbed; of another declaration only what it has is offered.
"""

from __future__ import annotations

from atlantis_netcfg.operations.checking.rehearsed import _of_routers, _of_the_gateway, _of_vehicles
from atlantis_netcfg.operations.checking.rehearsed._fault import Fault

__all__ = ["FAULTS", "Fault"]

FAULTS = {**_of_vehicles.FAULTS, **_of_the_gateway.FAULTS, **_of_routers.FAULTS}
"""Name to fault; they may be put together."""
