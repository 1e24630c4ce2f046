"""Whether the modems of a site can talk to each other at all: their settings side by side, from what each has told."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.checklist.probes.acoustic import evologics
from atlantis_netcfg.checklist.probes.acoustic.bands import plain
from atlantis_netcfg.checklist.probes.acoustic.beacon import Beacon
from atlantis_netcfg.checklist.probes.acoustic.status import Reading
from atlantis_netcfg.checklist.probes.results import Transcript
from atlantis_netcfg.checklist.probes.step import Judged
from atlantis_netcfg.checklist.report import Evidence, EvidenceType
from atlantis_netcfg.core.verdicts import Verdict

if TYPE_CHECKING:
    from collections.abc import Hashable, Iterable, Iterator, Mapping

    from atlantis_netcfg.checklist.probes.requests import Listen, Question
    from atlantis_netcfg.checklist.probes.results import Answer

__all__ = ["EvologicsFleet", "Member", "SeatracFleet"]

_HIGHEST = (2, 6, 14, 30, 62, 126, 254)
_PACKET_MS = (50, 1000)
_CARRIERS = ((0, 1), (1, 0), (2, 2))
"""Waveform ids that hear each other."""
_LISTED = ("Local Address", "Highest Address", "Carrier Waveform ID", "Packet Time")
_PHY = "ATI1"


@dataclass(frozen=True, slots=True)
class Member:
    """A modem of the fleet."""

    name: str
    """The row in words."""
    question: Listen
    declared: int | None
    """Acoustic address or beacon number; None: nobody declares it."""


def _asked(members: tuple[Member, ...]) -> tuple[Question, ...]:
    return tuple(dict.fromkeys(member.question for member in members))


def _transcript(member: Member, results: Mapping[str, Answer]) -> Transcript:
    transcript = results[member.question.name]
    if not isinstance(transcript, Transcript):
        raise TypeError(transcript)
    return transcript


def _not_compared(names: Iterable[str], result: int) -> Iterator[Finding]:
    missing = ", ".join(names)
    if missing:
        rest = "the others agree or not without it" if result > 1 else "a comparison needs two"
        message = f"the modem settings of {missing} could not be read: {rest}"
        hint = "settle the item of that modem itself first, and check again"
        yield Finding(Verdict.INCONCLUSIVE, "not-compared", message, hint)


def _strangers(members: tuple[Member, ...], addresses: Mapping[str, int]) -> Iterator[Finding]:
    for member in members:
        address = addresses.get(member.name, member.declared)
        if member.declared is not None and address != member.declared:
            message = f"a modem with the address {address} answers for {member.name}, and {member.declared} is declared"
            hint = "settle the item of that modem itself first, and check again"
            yield Finding(Verdict.INCONCLUSIVE, "not-compared", f"{message}: its own is not compared", hint)


def _listed(values: Mapping[str, object]) -> str:
    return ", ".join(f"{name} {value}" for name, value in values.items())


def _same(what: str, code: str, values: Mapping[str, Hashable], hint: str, *, verdict: Verdict) -> Iterator[Finding]:
    if len(set(values.values())) > 1:
        yield Finding(verdict, code, f"the modems differ in their {what}: {_listed(values)}", hint)


def _unique(what: str, values: Mapping[str, int]) -> Iterator[Finding]:
    for number in sorted(set(values.values())):
        names = [name for name, local in values.items() if local == number]
        if len(names) > 1:
            message = f"{' and '.join(names)} have the same {what}, {number}"
            hint = "have the crew of one of them set another one; the declaration says which belongs to whom"
            yield Finding(Verdict.FAIL, "duplicate-address", message, hint)


@dataclass(frozen=True, slots=True)
class EvologicsFleet:
    """The EvoLogics modems of the site agree in all that they must agree in."""

    members: tuple[Member, ...]

    def asks(self) -> tuple[Question, ...]:
        """The same scripts as the items of the modems themselves."""
        return _asked(self.members)

    def judge(self, results: Mapping[str, Answer]) -> Judged:
        """Compare what `AT&V` told."""
        readings = {member.name: Reading.of(_transcript(member, results)) for member in self.members}
        result = {
            name: {expected: value for expected in _LISTED if (value := reading.setting(expected)) is not None}
            for name, reading in readings.items()
        }
        whole = {name: values for name, values in result.items() if len(values) == len(_LISTED)}
        findings = [*_not_compared((name for name in readings if name not in whole), len(whole))]
        if len(whole) > 1:
            findings += self._compared(whole, readings)
        findings += _strangers(self.members, {name: values["Local Address"] for name, values in whole.items()})
        evidence = tuple(
            Evidence(type=EvidenceType.READ, what=name, value=_listed(values)) for name, values in whole.items()
        )
        return Judged(tuple(findings) or (_agree(whole),), evidence)

    def _compared(self, result: Mapping[str, Mapping[str, int]], readings: Mapping[str, Reading]) -> Iterator[Finding]:
        of = {expected: {name: values[expected] for name, values in result.items()} for expected in _LISTED}
        yield from _unique("acoustic address", of["Local Address"])
        hint = "have the crews set the same highest address on all modems: " + ", ".join(map(str, _HIGHEST))
        yield from _same(
            "highest address", "highest-address-differs", of["Highest Address"], hint, verdict=Verdict.FAIL
        )
        yield from _wrong("highest address", "highest-address", of["Highest Address"], _HIGHEST, hint)
        hint = "have the crews set the same packet time on all modems, between 50 and 1000 ms"
        yield from _same("packet time (ms)", "packet-time-differs", of["Packet Time"], hint, verdict=Verdict.FAIL)
        allowed = range(_PACKET_MS[0], _PACKET_MS[1] + 1)
        yield from _wrong("packet time (ms)", "packet-time", of["Packet Time"], allowed, hint)
        yield from _carriers(of["Carrier Waveform ID"])
        words = {name: evologics.answer(readings[name].heard, _PHY) for name in result}
        hint = "compare the models on the modems' labels: only modems of the same frequency band hear each other"
        known = {name: word for name, word in words.items() if word}
        yield from _same("physical layer", "band-differs", known, hint, verdict=Verdict.WARN)


def _wrong(
    what: str, code: str, values: Mapping[str, int], allowed: range | tuple[int, ...], hint: str
) -> Iterator[Finding]:
    for name, value in values.items():
        if value not in allowed:
            yield Finding(Verdict.FAIL, code, f"the {what} of {name} is {value}, which modems do not have", hint)


def _carriers(values: Mapping[str, int]) -> Iterator[Finding]:
    deaf = [
        f"{a} ({values[a]}) and {b} ({values[b]})"
        for a, b in combinations(values, 2)
        if (values[a], values[b]) not in _CARRIERS
    ]
    if deaf:
        message = f"carrier waveforms that do not hear each other: {'; '.join(deaf)}"
        hint = "have the crews set carrier waveform 2 on all modems; 0 and 1 are for a pair"
        yield Finding(Verdict.FAIL, "carriers", message, hint)


def _agree(result: Mapping[str, Mapping[str, int]]) -> Finding:
    addresses = ", ".join(f"{name} {values['Local Address']}" for name, values in result.items())
    return Finding(Verdict.PASS, "agree", f"the modems agree with each other; addresses: {addresses}")


@dataclass(frozen=True, slots=True)
class SeatracFleet:
    """The SeaTrac beacons of the site have numbers of their own and count with the same sound speed."""

    members: tuple[Member, ...]

    def asks(self) -> tuple[Question, ...]:
        """The same scripts as the items of the beacons themselves."""
        return _asked(self.members)

    def judge(self, results: Mapping[str, Answer]) -> Judged:
        """Compare their settings."""
        beacons = {member.name: Beacon.of(_transcript(member, results)).settings for member in self.members}
        values = {name: settings for name, settings in beacons.items() if settings is not None}
        findings = [*_not_compared((name for name in beacons if name not in values), len(values))]
        numbers = {name: settings.beacon for name, settings in values.items()}
        sound = {
            name: "by itself" if settings.auto_sound_speed else f"{plain(settings.sound_speed_mps)} m/s"
            for name, settings in values.items()
        }
        if len(values) > 1:
            findings += _unique("beacon number", numbers)
            hint = "have the crews set the same sound speed on all beacons, or let all work it out"
            findings += _same("sound speed", "sound-speed-differs", sound, hint, verdict=Verdict.WARN)
        findings += _strangers(self.members, numbers)
        evidence = tuple(
            Evidence(type=EvidenceType.READ, what=name, value=f"number {numbers[name]}, sound speed {sound[name]}")
            for name in values
        )
        listed = _listed(numbers)
        passed = Finding(Verdict.PASS, "agree", f"the beacons agree with each other; numbers: {listed}")
        return Judged(tuple(findings) or (passed,), evidence)
