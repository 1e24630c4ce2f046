"""A site that is all twins, for the checklist: what a technician rehearses, and what a trainer breaks on purpose.

The routers are the emulated ones of every rehearsal; vehicles get receivers, modems and autopilots of their own, which
speak their real protocols on ports of this computer, and the gateway computer is what its programs would print. All of
it is a specification that follows from the declaration and is healthy; a fault changes one thing in it, and says which
items of the checklist have to notice.
"""

from __future__ import annotations

from atlantis_netcfg.checklist.runner.simulated._faults import FAULTS, RehearsedFault
from atlantis_netcfg.checklist.runner.simulated.environment import rehearsed_ears

__all__ = ["FAULTS", "RehearsedFault", "rehearsed_ears"]
