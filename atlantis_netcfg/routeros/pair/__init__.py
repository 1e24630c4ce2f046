"""The two ends of a radio bridge as one transaction.

Both ends are read and planned before anything is sent, and a plan after which they would not find each other is
refused. Then each is put under its own rollback, the far end is changed first and the near end after it, and both are
proved from new sessions over the new link. Only then are they kept; if the link is not back within the declared time,
both return by themselves, also when our process has died.

What the far end's own rollback is, is said in the results: safe mode, whose device notices a dead link after about nine
minutes only, and, where device-mode lets the scheduler run, a job that looks at the declared moment.
"""

from __future__ import annotations

from atlantis_netcfg.routeros.pair._converge import converge_pair
from atlantis_netcfg.routeros.pair._end import Pair, Signal

__all__ = ["Pair", "Signal", "converge_pair"]
