"""What may be said into a stream: closed lists of each device's own language, looked at once more before the wire."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes.acoustic import allowed

if TYPE_CHECKING:
    from atlantis_netcfg.checklist.probes.requests import Listen

__all__ = ["PLAIN", "refused"]

PLAIN: tuple[bytes, ...] = (rb'\?WATCH=\{"enable":true,"json":true\};?\r?\n', rb"\?(VERSION|DEVICES|POLL);?\r?\n")
"""Full matches of whole sayings that only read, where a device's language needs no table: gpsd's."""
_PLAIN = tuple(re.compile(saying) for saying in PLAIN)


def refused(listen: Listen, *, active: bool) -> str | None:
    """Say what of a script must not be sent, and why; None: all of it may.

    `active`: the script belongs to an active step, and a person has consented. Nothing is said to a UDP port.
    """
    if listen.say and listen.transport == "udp":
        return "nothing is ever sent to a stream that arrives by UDP"
    for say in listen.say:
        if any(plain.fullmatch(say.data) for plain in _PLAIN):
            continue
        if reason := allowed.refused(say.data, active=active):
            return reason
    return None
