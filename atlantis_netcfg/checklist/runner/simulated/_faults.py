"""What can be broken in a rehearsal, by name: one thing each, and the items of the checklist that have to notice.

The things are those of the shipped inventory's coastal testbed; of another declaration only what it has is offered.
"""

from __future__ import annotations

from atlantis_netcfg.checklist.runner.simulated import faults_gateway, faults_routers, faults_vehicles
from atlantis_netcfg.checklist.runner.simulated._fault import Fault

__all__ = ["FAULTS", "Fault"]

FAULTS = {**faults_vehicles.FAULTS, **faults_gateway.FAULTS, **faults_routers.FAULTS}
"""Name to fault; they may be put together."""
