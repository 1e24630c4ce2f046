"""An emulated site for the checklist, for rehearsals by technicians and faults set by trainers.

The routers are the emulated ones of every rehearsal. Vehicles have emulated receivers, modems and autopilots, which use
their real protocols on ports of this computer. Program output of the gateway computer is simulated. All of this is a
specification derived from the inventory, without faults; a fault changes one thing in it, and lists the checklist items
that have to detect it.
"""

from __future__ import annotations

from atlantis_netcfg.checklist.runner.simulated._faults import FAULTS, RehearsedFault
from atlantis_netcfg.checklist.runner.simulated.environment import rehearsed_ears

__all__ = ["FAULTS", "RehearsedFault", "rehearsed_ears"]
