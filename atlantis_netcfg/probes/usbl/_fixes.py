"""Fixes that a modem tells by itself, of either driver, in one shape; whoever wants them only listens."""

from __future__ import annotations

import math
from bisect import bisect_left
from dataclasses import dataclass
from itertools import accumulate
from typing import TYPE_CHECKING

from atlantis_netcfg.probes.acoustic import evologics, seatrac
from atlantis_netcfg.probes.acoustic.bands import SOUND_SPEED_MPS
from atlantis_netcfg.site.model import AcousticDriver

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.probes.answers import Transcript

__all__ = ["Told", "told"]

_USUAL_MPS = 1500.0
"""Sound speed for ranges, where the modem's own is not known or makes no sense."""


@dataclass(frozen=True, slots=True)
class Told:
    """One fix of a remote modem; None: it does not tell."""

    remote: int
    age_s: float
    """From the measurement to the end of the listening."""
    range_m: float | None
    """By the sound's time on the way."""
    distance_m: float | None
    """By the position."""
    rssi_db: float | None
    """Of an EvoLogics modem: those of others have another scale."""
    integrity: float | None
    accuracy: float | None
    fit_error: float | None
    """Of a SeaTrac beacon: 0 is best, above 3 poor."""
    suspect: bool = False
    """The modem itself does not trust it."""


def told(driver: AcousticDriver, transcript: Transcript) -> tuple[Told, ...]:
    """Every fix in a transcript, in its order."""
    made = _seatrac(transcript) if driver is AcousticDriver.SEATRAC else _evologics(transcript)
    return tuple(made)


def _evologics(transcript: Transcript) -> Iterator[Told]:
    heard = evologics.pieces(transcript.data)
    settings = evologics.settings(heard)
    declared = settings.values.get("Sound Speed") if settings else None
    low, high = SOUND_SPEED_MPS
    speed = declared if declared is not None and low <= declared <= high else _USUAL_MPS
    arrivals = _Arrivals(transcript)
    for fix in evologics.fixes(heard):
        yield Told(
            remote=fix.remote,
            age_s=arrivals.waited_s(fix.end) + fix.age_s,
            range_m=None if fix.propagation_us is None else fix.propagation_us * 1e-6 * speed,
            distance_m=None if fix.position_m is None else math.hypot(*fix.position_m),
            rssi_db=fix.rssi_db,
            integrity=fix.integrity,
            accuracy=fix.accuracy,
            fit_error=None,
        )


def _seatrac(transcript: Transcript) -> Iterator[Told]:
    arrivals = _Arrivals(transcript)
    for answer in seatrac.answers(transcript.data):
        fix = seatrac.fix(answer.record) if answer.number == seatrac.PING_RESPONSE else None
        if fix is not None:
            yield Told(
                remote=fix.beacon,
                age_s=arrivals.waited_s(answer.end),
                range_m=fix.range_m,
                distance_m=None,
                rssi_db=None,
                integrity=None,
                accuracy=None,
                fit_error=fix.fit_error,
                suspect=fix.suspect,
            )


class _Arrivals:
    """When each byte of a stream came."""

    def __init__(self, transcript: Transcript) -> None:
        self._ended_s = transcript.ended_s
        self._at = [at for at, _ in transcript.chunks]
        self._upto = list(accumulate(len(data) for _, data in transcript.chunks))

    def waited_s(self, end: int) -> float:
        """From when the byte before `end` came to the end of the listening."""
        chunk = bisect_left(self._upto, end)
        return max(0.0, self._ended_s - self._at[chunk]) if chunk < len(self._at) else 0.0
