"""The acoustic column of a SeaTrac beacon: what it says of itself, read and never changed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.checklist.probes.acoustic import seatrac
from atlantis_netcfg.checklist.probes.acoustic.bands import SOUND_SPEED_MPS, plain
from atlantis_netcfg.checklist.probes.acoustic.errors import not_understood, said, two_modems, whose_unknown
from atlantis_netcfg.checklist.probes.step import Judged
from atlantis_netcfg.checklist.report import Evidence, EvidenceType
from atlantis_netcfg.core.verdicts import Verdict

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from atlantis_netcfg.checklist.probes.acoustic.modem import Modem
    from atlantis_netcfg.checklist.probes.requests import Listen, Question
    from atlantis_netcfg.checklist.probes.results import Answer, Transcript

__all__ = ["BEACONS", "Beacon", "SeatracStatus", "damage"]

BEACONS = range(1, 16)
_IDLE = 0x3B
_WORKING = {0x30: "is busy", 0x3C: "transmits", 0x3D: "waits for an answer", 0x3E: "receives", 0x3F: "answers"}
"""States of the transceiver in which somebody uses it."""
_STOPPED = 0x3A


@dataclass(frozen=True, slots=True)
class Beacon:
    """Everything that a beacon told, in one value; None: not told."""

    heard: tuple[seatrac.Answer, ...]
    settings: seatrac.Settings | None
    status: seatrac.Status | None
    info: str | None
    state: int | None
    """Of its transceiver."""
    numbers: frozenset[int]
    """Every one that was told: more than one is two beacons at one end."""

    @classmethod
    def of(cls, transcript: Transcript) -> Beacon:
        """Read a transcript."""
        received = seatrac.answers(transcript.data)
        state = seatrac.last(received, seatrac.TRANSCEIVER)
        result = (seatrac.settings(answer.record) for answer in received if answer.number == seatrac.SETTINGS)
        return cls(
            received,
            seatrac.settings(seatrac.last(received, seatrac.SETTINGS) or b""),
            seatrac.status(seatrac.last(received, seatrac.STATUS) or b""),
            seatrac.info(seatrac.last(received, seatrac.INFO) or b""),
            state[0] if state else None,
            frozenset(settings.beacon for settings in result if settings is not None),
        )


def damage(name: str, transcript: Transcript) -> Finding | None:
    """Say that answers came with a wrong sum."""
    damaged = seatrac.damaged(transcript.data)
    if not damaged:
        return None
    whole = len(seatrac.answers(transcript.data))
    message = f"{damaged} of {damaged + whole} answers of the beacon of {name} came with a wrong checksum"
    hint = "look at the serial cable and its rate (`baud`), and whether two programs write to the port"
    return Finding(Verdict.WARN if whole else Verdict.INCONCLUSIVE, "checksum", message, hint)


@dataclass(frozen=True, slots=True)
class SeatracStatus:
    """The beacon is alive and idle, with the number and sound speed that it should have."""

    modem: Modem
    name: str
    """The row in words."""
    declared: int | None
    """Beacon id."""
    question: Listen

    def asks(self) -> tuple[Question, ...]:
        """One script of reading commands."""
        return (self.question,)

    def judge(self, results: Mapping[str, Answer]) -> Judged:
        """Judge what the beacon told."""
        transcript = said(self.modem, self.name, results[self.question.name])
        if isinstance(transcript, Judged):
            return transcript
        damaged = damage(self.name, transcript)
        beacon = Beacon.of(transcript)
        if not beacon.heard:
            return Judged((damaged or not_understood(self.modem, self.name),))
        findings = (self._state(beacon), *self._number(beacon), *self._sound(beacon))
        return Judged((*findings, damaged) if damaged else findings, tuple(_evidence(beacon)))

    def _state(self, beacon: Beacon) -> Finding:
        who, state = f"the beacon of {self.name}", beacon.state
        if state is None:
            hint = "check again in a minute; a beacon that the vehicle keeps busy answers late"
            return Finding(Verdict.INCONCLUSIVE, "no-state", f"{who} does not tell what its transceiver does", hint)
        if state == _IDLE:
            return Finding(Verdict.PASS, "listens", f"{who} listens")
        if state == _STOPPED:
            hint = "switch the beacon off and on: this tool never starts it"
            return Finding(Verdict.FAIL, "stopped", f"{who} has its transceiver stopped", hint)
        if state in _WORKING:
            hint = "check again when the vehicle does not use it"
            return Finding(Verdict.WARN, "working", f"{who} {_WORKING[state]} at the moment", hint)
        message = f"{who} is in a state that nobody here knows: 0x{state:02X}"
        return Finding(Verdict.INCONCLUSIVE, "state-unknown", message, "ask its maker what that state means")

    def _number(self, beacon: Beacon) -> Iterator[Finding]:
        if self.declared is None:
            yield whose_unknown(self.modem, self.name)
        if beacon.settings is None:
            hint = "check again; a longer record than ours is read, a shorter one is not"
            yield Finding(
                Verdict.INCONCLUSIVE, "settings-unknown", f"the beacon of {self.name} does not tell its settings", hint
            )
            return
        if len(beacon.numbers) > 1:
            yield two_modems(self.modem, self.name, beacon.numbers)
        number = beacon.settings.beacon
        if self.declared is not None and number != self.declared:
            message = f"the beacon of {self.name} has the number {number}, and {self.declared} is declared"
            hint = "have its crew set the number, or correct `acoustic_address` in the declaration"
            yield Finding(Verdict.FAIL, "wrong-address", message, hint)
        if number not in BEACONS:
            message = f"the beacon of {self.name} has the number {number}; there are 1 to 15"
            yield Finding(Verdict.FAIL, "address-out-of-range", message, "have its crew set one that nobody else has")

    def _sound(self, beacon: Beacon) -> Iterator[Finding]:
        speed = beacon.status.sound_speed_mps if beacon.status else None
        if speed is None and beacon.settings is not None and not beacon.settings.auto_sound_speed:
            speed = beacon.settings.sound_speed_mps
        low, high = SOUND_SPEED_MPS
        if speed is not None and not low <= speed <= high:
            who = f"the beacon of {self.name}"
            message = f"{who} counts with a sound speed of {plain(speed)} m/s, which water does not have"
            hint = "have its crew let the beacon work it out, or set that of the place: all ranges hang on it"
            yield Finding(Verdict.FAIL, "sound-speed", message, hint)


def _evidence(beacon: Beacon) -> Iterator[Evidence]:
    for what, value in _read(beacon):
        if value is not None:
            yield Evidence(type=EvidenceType.READ, what=what, value=value)


def _read(beacon: Beacon) -> Iterator[tuple[str, str | None]]:
    yield "beacon", beacon.info
    if beacon.state is not None:
        yield "transceiver", f"0x{beacon.state:02X}"
    if beacon.settings is not None:
        yield "number", str(beacon.settings.beacon)
        yield "sound speed that is set", f"{plain(beacon.settings.sound_speed_mps)} m/s"
    if beacon.status is not None:
        yield "supply", _with(beacon.status.supply_v, "V")
        yield "depth", _with(beacon.status.depth_m, "m")
        yield "sound speed in use", _with(beacon.status.sound_speed_mps, "m/s")


def _with(value: float | None, unit: str) -> str | None:
    return None if value is None else f"{plain(value)} {unit}"
