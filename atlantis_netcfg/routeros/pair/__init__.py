"""The two ends of a radio bridge, changed as one transaction.

Both ends are read and planned before anything is sent; a plan after which they would not connect is refused. Then each
end gets its own rollback, the far end is changed first and the near end after it, and both are verified in new sessions
over the new link. Only then the changes are kept. If the link is not back within the configured time, both ends roll
back on their own, also if our process has died.

The results report the far end's rollback: safe mode, where the device notices a dead link only after about nine
minutes, and, if device-mode allows the scheduler, a job that checks at the configured time.
"""

from __future__ import annotations

from atlantis_netcfg.routeros.pair._converge import converge_pair
from atlantis_netcfg.routeros.pair._end import Pair, Signal

__all__ = ["Pair", "Signal", "converge_pair"]
