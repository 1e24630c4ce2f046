"""The USBL column: fixes of the expected modems are listened for; nobody is made to ping."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.probes.acoustic import evologics, seatrac
from atlantis_netcfg.probes.acoustic.bands import INTEGRITY_LOW, RSSI_DB
from atlantis_netcfg.probes.acoustic.beacon import damage
from atlantis_netcfg.probes.acoustic.trouble import not_understood, said
from atlantis_netcfg.probes.step import Judged
from atlantis_netcfg.probes.usbl._fixes import Told, told
from atlantis_netcfg.report.checklist import Evidence, EvidenceType
from atlantis_netcfg.site.model import AcousticDriver
from atlantis_netcfg.verdicts import Verdict

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from atlantis_netcfg.probes.acoustic.modem import Modem
    from atlantis_netcfg.probes.answers import Answer, Transcript
    from atlantis_netcfg.probes.questions import Listen, Question

__all__ = ["Fixes"]

_FIT_POOR = 3.0
_OFF_SHARE, _OFF_M = 0.05, 0.5
"""Range and position may differ by so much: a share of the range, and at least some metres."""
_NOBODY = "let the other modem ping or send, with both in the water, and listen again; silence proves nothing"
_OUTPUT = "AT?ZU"


@dataclass(frozen=True, slots=True)
class Fixes:
    """The USBL tells fresh fixes of the modems that it should hear."""

    modem: Modem
    name: str
    """The row in words."""
    hears: tuple[int, ...]
    """Acoustic addresses; none: anybody's."""
    max_age_s: float
    question: Listen

    def asks(self) -> tuple[Question, ...]:
        """The script of the acoustic column, with a listening behind it."""
        return (self.question,)

    def judge(self, heard: Mapping[str, Answer]) -> Judged:
        """Judge the fixes that came while it was listened."""
        transcript = said(self.modem, self.name, heard[self.question.name])
        if isinstance(transcript, Judged):
            return transcript
        fixes = told(self.modem.driver, transcript)
        if not fixes and not self._understood(transcript):
            return Judged((self._foreign(transcript),))
        remotes = self.hears or tuple(sorted({fix.remote for fix in fixes}))
        findings = tuple(
            finding
            for remote in remotes
            for finding in self._of(remote, [fix for fix in fixes if fix.remote == remote], transcript)
        )
        if not any(fix.remote in remotes for fix in fixes):
            findings = (self._nothing(fixes, transcript),)
        return Judged(findings, tuple(_evidence(fixes)))

    def _understood(self, transcript: Transcript) -> bool:
        if self.modem.driver is AcousticDriver.SEATRAC:
            return bool(seatrac.answers(transcript.data))
        pieces = evologics.pieces(transcript.data)
        return any(piece.command for piece in pieces) or evologics.state(pieces) is not None

    def _foreign(self, transcript: Transcript) -> Finding:
        seatrac_s = self.modem.driver is AcousticDriver.SEATRAC
        return (damage(self.name, transcript) if seatrac_s else None) or not_understood(self.modem, self.name)

    def _nothing(self, fixes: tuple[Told, ...], transcript: Transcript) -> Finding:
        if self.modem.driver is AcousticDriver.EVOLOGICS:
            switched = evologics.number(evologics.answer(evologics.pieces(transcript.data), _OUTPUT))
            if switched == 0 and not fixes:
                message = f"the USBL of {self.name} keeps its fixes to itself: their output is switched off (AT?ZU 0)"
                hint = "have its crew switch the output of fixes on: this tool never does"
                return Finding(Verdict.INCONCLUSIVE, "output-off", message, hint)
        whose = f" of {_addresses(self.hears)}" if self.hears else ""
        others = sorted({fix.remote for fix in fixes})
        beside = f", only of {_addresses(tuple(others))}" if others else ""
        message = (
            f"the USBL of {self.name} told no fix{whose} within {transcript.ended_s:.0f} s{beside}: nobody pinging?"
        )
        return Finding(Verdict.INCONCLUSIVE, "no-fixes", message, _NOBODY)

    def _of(self, remote: int, fixes: list[Told], transcript: Transcript) -> Iterator[Finding]:
        who = f"the USBL of {self.name}"
        if not fixes:
            message = f"{who} told no fix of the address {remote} within {transcript.ended_s:.0f} s"
            yield Finding(Verdict.INCONCLUSIVE, "not-heard", message, _NOBODY)
            return
        last = fixes[-1]
        far = "" if last.range_m is None else f", {last.range_m:.1f} m away"
        counted = f"{len(fixes)} fix{'es' if len(fixes) > 1 else ''} of the address {remote}"
        if last.age_s > self.max_age_s:
            message = f"{who} told {counted}, but none for {last.age_s:.0f} s"
            yield Finding(Verdict.WARN, "stale", message, f"look why they ended, and listen again: {_NOBODY}")
        else:
            yield Finding(Verdict.PASS, "heard", f"{who} told {counted}{far}")
        yield from _quality(who, remote, last)


def _quality(who: str, remote: int, fix: Told) -> Iterator[Finding]:
    of = f"of the address {remote}"
    if fix.range_m is None:
        hint = "a direction without a range is all that a receiver without its own ping gets; look how it is pinged"
        yield Finding(Verdict.WARN, "direction-only", f"{who} tells only the direction {of}, and no range", hint)
    elif fix.distance_m is not None and abs(fix.range_m - fix.distance_m) > max(_OFF_M, _OFF_SHARE * fix.range_m):
        message = f"{who} puts {of[3:]} at {fix.distance_m:.1f} m, and the sound's time says {fix.range_m:.1f} m"
        hint = "compare the sound speed that is set with the water's; echoes of a wall make such fixes, too"
        yield Finding(Verdict.WARN, "range-mismatch", message, hint)
    low, high = RSSI_DB
    if fix.rssi_db is not None and not low <= fix.rssi_db <= high:
        weak = fix.rssi_db < low
        message = f"{who} hears {of[3:]} too {'weakly' if weak else 'strongly'}: {fix.rssi_db:.0f} dB"
        hint = "look at the transducers and what is between them" if weak else "move the modems apart"
        yield Finding(Verdict.WARN, "signal-weak" if weak else "signal-strong", message, hint)
    if fix.integrity is not None and fix.integrity < INTEGRITY_LOW:
        message = f"{who} hears {of[3:]} poorly: integrity {fix.integrity:.0f}, good is {INTEGRITY_LOW}"
        hint = "look for echoes (walls, the hull, the surface) and noise, and listen again"
        yield Finding(Verdict.WARN, "integrity-low", message, hint)
    if fix.suspect or (fix.fit_error is not None and fix.fit_error > _FIT_POOR):
        hint = "look for echoes and noise, and whether the beacon's head is free on all sides"
        yield Finding(Verdict.WARN, "poor-fit", f"{who} does not trust its own fix {of}", hint)


def _addresses(addresses: tuple[int, ...]) -> str:
    word = "the addresses" if len(addresses) > 1 else "the address"
    return f"{word} {', '.join(map(str, addresses))}"


def _evidence(fixes: tuple[Told, ...]) -> Iterator[Evidence]:
    for remote in sorted({fix.remote for fix in fixes}):
        its = [fix for fix in fixes if fix.remote == remote]
        yield Evidence(type=EvidenceType.MEASURED, what=f"fixes of the address {remote}", value="; ".join(_told(its)))


def _told(fixes: list[Told]) -> Iterator[str]:
    last = fixes[-1]
    yield f"{len(fixes)}"
    yield f"last {last.age_s:.1f} s old"
    if last.range_m is not None:
        yield f"range {last.range_m:.2f} m"
    if last.distance_m is not None:
        yield f"position {last.distance_m:.2f} m away"
    if last.rssi_db is not None:
        yield f"signal {last.rssi_db:.0f} dB"
    if last.integrity is not None:
        yield f"integrity {last.integrity:.0f}"
    if last.accuracy is not None:
        yield f"accuracy {last.accuracy:g} rad"
    if last.fit_error is not None:
        yield f"fit error {last.fit_error:.2f}"
