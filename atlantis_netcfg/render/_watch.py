"""How often a link's canaries are asked, and how many answers decide: the declared times in packets of netwatch.

Each canary has three rows of `/tool netwatch` (templates/routeros/parts/netwatch.rsc.j2). One asks all the time. The
first question without an answer starts the second row, which leaves the link if all of its packets are lost, and the
first answer after that starts the third, which takes the link back if none of its packets is lost.
"""

from __future__ import annotations

from math import ceil
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers.policy import daily_bytes
from atlantis_netcfg.render.view import Judged

if TYPE_CHECKING:
    from atlantis_netcfg.declaration.model import Bearer, Failover

__all__ = ["judged"]

WATCH_S = 5.0
"""Below the 10 s of `check-gateway`, so that a link is held before that has missed it twice (11 s at the least)."""
_TIMEOUT_S, _METERED_TIMEOUT_S = 1.0, 3.0
_GAP_S = 5.0
"""The usual time between two packets; a test has so many packets at most:"""
_MOST_SILENT, _MOST_STEADY = 40, 60


def judged(bearer: Bearer, failover: Failover) -> Judged:
    """Return how a bearer with canaries is judged.

    From the first lost question to the decision to leave, at least `hold_down_s` pass: its time-out, the 3 s that a row
    of netwatch waits before it begins, the packets, the last time-out. At most one interval of the watch comes on top.
    """
    silence = min(max(2, ceil(failover.hold_down_s / _GAP_S)), _MOST_SILENT)
    gap_s = failover.hold_down_s / silence
    steady = min(max(2, ceil(failover.fail_back_s / _GAP_S) + 1), _MOST_STEADY)
    watch_s = float(failover.metered_probe_s) if bearer.metered else WATCH_S
    return Judged(
        checked=not bearer.metered,
        watch_s=watch_s,
        timeout_s=_METERED_TIMEOUT_S if bearer.metered else _TIMEOUT_S,
        silence=silence,
        silence_gap_s=gap_s if gap_s <= _GAP_S else failover.hold_down_s / (silence - 1),
        steady=steady,
        steady_gap_s=max(1.0, failover.fail_back_s / (steady - 1)),
        daily_bytes=daily_bytes(len(bearer.canaries), watch_s),
    )
