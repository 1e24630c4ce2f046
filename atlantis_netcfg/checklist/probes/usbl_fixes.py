"""Fixes that a modem sends unsolicited, of either driver, in one form: the probe listens and triggers no ping."""

from __future__ import annotations

import math
from bisect import bisect_left
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes import base
from atlantis_netcfg.checklist.probes.acoustic import evologics, seatrac, status
from atlantis_netcfg.checklist.probes.acoustic.modem import AcousticModem, not_understood, transcript_or_judgement
from atlantis_netcfg.checklist.report import Evidence, EvidenceType
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory.model import AcousticDriver
from atlantis_netcfg.links import LinkFinding

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence


_USUAL_MPS = 1500.0
"""Sound speed for ranges if the modem's own is not known or makes no sense."""
_REACH_M = {AcousticDriver.EVOLOGICS: 10_000.0, AcousticDriver.SEATRAC: 2_000.0}
"""No modem of that maker receives from farther away."""
_UNDECLARED_M = 2_000.0
"""Larger distances are accepted only if the geofence says that the site is that wide."""
_NEAREST_M = 0.1
_OFF_SHARE, _OFF_M = 0.05, 0.5
"""Permitted difference of range and position: a share of the range, and at least some metres."""
_GROSS_SHARE, _GROSS_M = 0.35, 2.0
"""No sound speed of water explains a larger difference."""
_FIT_POOR = 3.0
_ACCURACY_POOR, _ACCURACY_NONE = 0.5, math.pi / 2
"""In radians; from a right angle on, the fix does not even show the side."""
_SIGNAL_NONE_DB = -200.0
_FUTURE_S = 0.5
_SINCE_1970_S = 1e9
"""A clock with a larger value was set to the time of day; others count from when the modem was switched on."""
_NOBODY = (
    "make the other modem ping or send, with both in the water, and listen again; without a signal nothing is proved"
)
_OUTPUT = "AT?ZU"
_ECHOES = "check for echoes and noise, and that the beacon's head is unobstructed on all sides"
_REPLAY = "check whether a recorded log is replayed here instead of the modem, then restart the modem's software"


@dataclass(frozen=True, slots=True)
class UsblFix:
    """One fix of a remote modem; None: not reported."""

    remote: int
    end: int
    """Offset of its end in the stream."""
    waited_s: float
    """From its arrival to the end of listening."""
    received_at: float
    """Arrival, seconds since 1970 by the clock of the computer that listens."""
    stamp: object
    """Identifies the measurement: its time, otherwise all measured values."""
    form: str
    """Form of the report; a modem may report one measurement in two forms."""
    range_m: float | None
    """Distance from the travel time of the sound."""
    distance_m: float | None
    """Distance from the position."""
    has_direction: bool
    clock_s: float | None = None
    """Modem clock when it reported the fix."""
    delay_s: float = 0.0
    """From the measurement to the report, by the modem's clock."""
    to: int | None = None
    """SeaTrac beacons only: beacon that the response was addressed to."""
    rssi_db: float | None = None
    """EvoLogics modems only: others have another scale."""
    integrity: float | None = None
    accuracy: float | None = None
    fit_error: float | None = None
    """SeaTrac beacons only: 0 is best, above 3 poor."""
    suspect: bool = False
    """Whether the modem itself does not trust it."""

    @property
    def age_s(self) -> float:
        """Seconds from the measurement to the end of listening."""
        return self.waited_s + max(0.0, self.delay_s)


def read_fixes(driver: AcousticDriver, transcript: base.Transcript) -> tuple[UsblFix, ...]:
    """Return every fix in a transcript, in order."""
    fixes = _seatrac(transcript) if driver is AcousticDriver.SEATRAC else _evologics(transcript)
    return tuple(fixes)


def _evologics(transcript: base.Transcript) -> Iterator[UsblFix]:
    pieces = evologics.pieces(transcript.data)
    settings = evologics.settings(pieces)
    modem_speed = settings.values.get("Sound Speed") if settings else None
    low, high = status.SOUND_SPEED_MPS
    speed = modem_speed if modem_speed is not None and low <= modem_speed <= high else _USUAL_MPS
    arrivals = _Arrivals(transcript)
    for fix in evologics.fixes(pieces):
        yield UsblFix(
            remote=fix.remote,
            end=fix.end,
            waited_s=transcript.ended_s - arrivals.at_s(fix.end),
            received_at=transcript.began + arrivals.at_s(fix.end),
            stamp=fix.measured_s,
            form="direction" if fix.position_m is None else "position",
            range_m=None if fix.propagation_us is None else fix.propagation_us * 1e-6 * speed,
            distance_m=None if fix.position_m is None else math.hypot(*fix.position_m),
            has_direction=True,
            clock_s=fix.clock_s,
            delay_s=fix.clock_s - fix.measured_s,
            rssi_db=fix.rssi_db,
            integrity=fix.integrity,
            accuracy=fix.accuracy,
        )


def _seatrac(transcript: base.Transcript) -> Iterator[UsblFix]:
    arrivals = _Arrivals(transcript)
    for answer in seatrac.answers(transcript.data):
        if answer.number not in {seatrac.PING_RESPONSE, seatrac.NAV_QUERY_RESPONSE}:
            continue
        fix = seatrac.fix(answer.record)
        if fix is None or (fix.range_m is None and fix.azimuth_deg is None):
            continue
        yield UsblFix(
            remote=fix.beacon,
            end=answer.end,
            waited_s=transcript.ended_s - arrivals.at_s(answer.end),
            received_at=transcript.began + arrivals.at_s(answer.end),
            stamp=answer.record,
            form=f"{answer.number:02X}",
            range_m=fix.range_m,
            distance_m=None if fix.position_m is None else math.hypot(*fix.position_m),
            has_direction=fix.azimuth_deg is not None,
            to=fix.to,
            fit_error=fix.fit_error,
            suspect=fix.suspect,
        )


class _Arrivals:
    """Arrival time of each byte of a stream."""

    def __init__(self, transcript: base.Transcript) -> None:
        self._ended_s = transcript.ended_s
        self._at = [at for at, _ in transcript.chunks]
        self._upto = list(accumulate(len(data) for _, data in transcript.chunks))

    def at_s(self, end: int) -> float:
        """Return when the byte before `end` arrived, in seconds since listening began."""
        chunk = bisect_left(self._upto, end)
        return min(self._ended_s, self._at[chunk]) if chunk < len(self._at) else self._ended_s


def impossible(
    who: str, fix: UsblFix, local: int | None, width_m: float | None, driver: AcousticDriver
) -> LinkFinding | None:
    """Return why a fix is certainly wrong; None if it may be true.

    `local`: address of the reporting modem; `width_m`: width of the site's waters, if it is in the inventory.
    """
    whose = msg(f"the address {arg(fix.remote)}")
    if fix.delay_s < -_FUTURE_S:
        message = msg(
            f"{arg(who)} reports a fix of {arg(whose)} measured {arg(-fix.delay_s):.0f} s from now by its own clock"
        )
        return LinkFinding(Verdict.FAIL, "time-impossible", message, _REPLAY)
    if fix.remote == local:
        message = msg(f"{arg(who)} reports fixes of {arg(whose)}, which is its own address")
        return LinkFinding(Verdict.FAIL, "own-address", message, "give one of the two modems another address")
    if local is not None and fix.to not in {None, 0, local}:
        message = msg(
            f"{arg(who)} reports a fix of {arg(whose)} addressed to the beacon {arg(fix.to)}, but it is the beacon "
            f"{arg(local)}"
        )
        hint = "check which beacon is connected here: responses to another beacon are not its own fixes"
        return LinkFinding(Verdict.FAIL, "other-beacon", message, hint)
    return _check_distance(who, whose, fix, width_m, driver) or _absurd(who, whose, fix)


def _check_distance(
    who: str, whose: str, fix: UsblFix, width_m: float | None, driver: AcousticDriver
) -> LinkFinding | None:
    far_m = [metres for metres in (fix.range_m, fix.distance_m) if metres is not None]
    if far_m and min(far_m) <= _NEAREST_M:
        message = msg(
            f"{arg(who)} puts {arg(whose)} at {arg(min(far_m)):.1f} m, which is its own position: zeros instead of "
            "measured values"
        )
        hint = "restart the modem, and the program that forwards its fixes"
        return LinkFinding(Verdict.FAIL, "position-null", message, hint)
    if far_m and (away := _too_far(who, whose, max(far_m), width_m, driver)) is not None:
        return away
    if _has_range_mismatch(fix, _GROSS_SHARE, _GROSS_M):
        return LinkFinding(Verdict.FAIL, "range-mismatch", _mismatch(who, whose, fix), _MISMATCH)
    return None


def _too_far(who: str, whose: str, far_m: float, width_m: float | None, driver: AcousticDriver) -> LinkFinding | None:
    widest = min(_REACH_M[driver], width_m if width_m is not None else _REACH_M[driver])
    if far_m > widest:
        limit = msg(
            "beyond the range of such a modem"
            if widest == _REACH_M[driver]
            else f"the site is {arg(widest):.0f} m wide"
        )
        hint = (
            "compare it with the actual position; correct `checklist.geofence` of the site if the test area is larger"
        )
        return LinkFinding(
            Verdict.FAIL, "too-far", msg(f"{arg(who)} puts {arg(whose)} {arg(far_m):.0f} m away: {arg(limit)}"), hint
        )
    if width_m is None and far_m > _UNDECLARED_M:
        message = msg(f"{arg(who)} puts {arg(whose)} {arg(far_m):.0f} m away; the inventory has no width of the site")
        return LinkFinding(Verdict.INCONCLUSIVE, "far-away", message, "set `checklist.geofence` of the site")
    return None


def _has_range_mismatch(fix: UsblFix, share: float, metres: float) -> bool:
    is_known = fix.range_m is not None and fix.distance_m is not None
    return is_known and abs((fix.range_m or 0.0) - (fix.distance_m or 0.0)) > max(metres, share * (fix.range_m or 0.0))


def _mismatch(who: str, whose: str, fix: UsblFix) -> str:
    return msg(
        f"{arg(who)} puts {arg(whose)} at {arg(fix.distance_m):.1f} m, but the travel time of the sound gives "
        f"{arg(fix.range_m):.1f} m"
    )


_MISMATCH = "compare the configured sound speed with the water's; wall echoes also cause such fixes"


def _absurd(who: str, whose: str, fix: UsblFix) -> LinkFinding | None:
    """Return a finding for a value that no reception can have."""
    values = (
        ("an accuracy", fix.accuracy, "rad", fix.accuracy is not None and not 0 <= fix.accuracy <= _ACCURACY_NONE),
        ("a signal", fix.rssi_db, "dB", fix.rssi_db is not None and not _SIGNAL_NONE_DB < fix.rssi_db < 0),
        ("an integrity", fix.integrity, "", fix.integrity is not None and fix.integrity <= 0),
        ("a fit error", fix.fit_error, "", fix.fit_error is not None and fix.fit_error < 0),
    )
    odd = next(
        (msg(f"{arg(what)} of {arg(value):g} {arg(unit)}").rstrip() for what, value, unit, wrong in values if wrong),
        None,
    )
    if odd is None:
        return None
    message = msg(f"{arg(who)} reports a fix of {arg(whose)} with {arg(odd)}, which gives no valid direction")
    return LinkFinding(
        Verdict.FAIL, "values-impossible", message, msg(f"check whether anything is received at all; {arg(_ECHOES)}")
    )


@dataclass(frozen=True, slots=True)
class Fixes:
    """Check that the USBL reports fresh fixes of the modems that it should receive."""

    modem: AcousticModem
    name: str
    """Display name of the checklist row."""
    hears: tuple[int, ...]
    """Acoustic addresses; empty: any."""
    max_age_s: float
    question: base.Listen
    expected_address: int | None = None
    """Acoustic address of the modem itself; None: not declared."""
    width_m: float | None = None
    """Width of the site's waters: the geofence from one side to the other."""

    def asks(self) -> tuple[base.Question, ...]:
        """Return the script of the acoustic column, followed by listening."""
        return (self.question,)

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        """Judge the fixes that arrived while listening."""
        transcript = transcript_or_judgement(self.modem, self.name, results[self.question.name])
        if isinstance(transcript, base.ProbeResult):
            return transcript
        fixes = read_fixes(self.modem.driver, transcript)
        if not fixes and not self._is_recognized(transcript):
            return base.ProbeResult((self._foreign_finding(transcript),))
        remotes = self.hears or tuple(sorted({fix.remote for fix in fixes}))
        if not any(fix.remote in remotes for fix in fixes):
            return base.ProbeResult(
                (self._no_fix_finding(fixes, transcript), *self._whose(transcript)), tuple(_evidence(fixes))
            )
        local = self._local_address(transcript)
        findings = tuple(
            finding
            for remote in remotes
            for finding in self._of(remote, [fix for fix in fixes if fix.remote == remote], local, transcript)
        )
        return base.ProbeResult(
            (*findings, *self._out_of_step(fixes), *self._whose(transcript)), tuple(_evidence(fixes))
        )

    @property
    def _who(self) -> str:
        return msg(f"the USBL of {arg(self.name)}")

    def _local_address(self, transcript: base.Transcript) -> int | None:
        """Return the address reported by the modem itself; None if it does not report it."""
        if self.modem.driver is AcousticDriver.SEATRAC:
            settings = status.Beacon.of(transcript).settings
            return None if settings is None else settings.beacon
        return status.AcousticReading.of(transcript).address

    def _whose(self, transcript: base.Transcript) -> Iterator[LinkFinding]:
        """Yield findings if the modem is not the expected one, or the inventory lacks the modems to receive."""
        local = self._local_address(transcript)
        if local is not None and self.expected_address is not None and local != self.expected_address:
            message = msg(
                f"{arg(self._who)} has the acoustic address {arg(local)}; the inventory says "
                f"{arg(self.expected_address)}"
            )
            hint = "check whose modem responds here, or correct `acoustic_address` in the inventory"
            yield LinkFinding(Verdict.FAIL, "wrong-address", message, hint)
        if not self.hears:
            message = msg(
                f"the inventory does not say which addresses {arg(self._who)} should receive: fixes of any address "
                "count"
            )
            yield LinkFinding(Verdict.WARN, "whose-unknown", message, "set `hears` under its `endpoints.usbl`")

    def _is_recognized(self, transcript: base.Transcript) -> bool:
        if self.modem.driver is AcousticDriver.SEATRAC:
            return bool(seatrac.answers(transcript.data))
        pieces = evologics.pieces(transcript.data)
        return any(piece.command for piece in pieces) or evologics.state(pieces) is not None

    def _foreign_finding(self, transcript: base.Transcript) -> LinkFinding:
        seatrac_s = self.modem.driver is AcousticDriver.SEATRAC
        return (status.damage(self.name, transcript) if seatrac_s else None) or not_understood(self.modem, self.name)

    def _no_fix_finding(self, fixes: tuple[UsblFix, ...], transcript: base.Transcript) -> LinkFinding:
        if self.modem.driver is AcousticDriver.EVOLOGICS:
            output_state = evologics.number(evologics.answer(evologics.pieces(transcript.data), _OUTPUT))
            if output_state == 0 and not fixes:
                message = msg(f"{arg(self._who)} does not output its fixes: the output is switched off (AT?ZU 0)")
                hint = "ask its crew to switch the output of fixes on: this program never does"
                return LinkFinding(Verdict.INCONCLUSIVE, "output-off", message, hint)
        whose = msg(f" of {arg(_addresses(self.hears))}" if self.hears else "")
        others = sorted({fix.remote for fix in fixes})
        beside = msg(f", only of {arg(_addresses(tuple(others)))}" if others else "")
        message = msg(
            f"{arg(self._who)} reported no fix{arg(whose)} within {arg(transcript.ended_s):.0f} s{arg(beside)}: "
            "possibly nothing pings"
        )
        return LinkFinding(Verdict.INCONCLUSIVE, "no-fixes", message, _NOBODY)

    def _of(
        self, remote: int, fixes: list[UsblFix], local: int | None, transcript: base.Transcript
    ) -> Iterator[LinkFinding]:
        """Judge the fixes of one modem: possible, current, and more than one measurement."""
        if not fixes:
            message = msg(
                f"{arg(self._who)} reported no fix of the address {arg(remote)} within {arg(transcript.ended_s):.0f} s"
            )
            yield LinkFinding(Verdict.INCONCLUSIVE, "not-heard", message, _NOBODY)
            return
        again = _again(fixes)
        if again is not None:
            message = msg(f"{arg(self._who)} reports {arg(again)} of the address {arg(remote)}")
            yield LinkFinding(Verdict.FAIL, "repeated", message, _REPLAY)
            return
        # One measurement is as old as when it was told first.
        measurements = list({fix.stamp: fix for fix in reversed(fixes)}.values())[::-1]
        wrong = {id(fix): finding for fix in measurements if (finding := self._judge_fix(fix, local)) is not None}
        good = [fix for fix in measurements if id(fix) not in wrong]
        if len(good) <= len(wrong):
            yield next(wrong[id(fix)] for fix in reversed(measurements) if id(fix) in wrong)
            return
        yield from self._fix_findings(remote, good, len(fixes))
        if wrong:
            message = msg(
                f"{arg(len(wrong))} of {arg(len(measurements))} fixes of the address {arg(remote)} are impossible: "
                f"{arg(_first_message(wrong))}"
            )
            yield LinkFinding(Verdict.WARN, "some-impossible", message, msg(f"listen again; {arg(_ECHOES)}"))

    def _judge_fix(self, fix: UsblFix, local: int | None) -> LinkFinding | None:
        of = msg(f"of the address {arg(fix.remote)}")
        finding = impossible(self._who, fix, local, self.width_m, self.modem.driver)
        if finding is not None:
            return finding
        if fix.delay_s > self.max_age_s:
            message = msg(
                f"{arg(self._who)} reports a fix {arg(of)} that was measured {arg(fix.delay_s):.0f} s earlier"
            )
            return LinkFinding(Verdict.FAIL, "stale", message, _REPLAY)
        if fix.clock_s is not None and fix.clock_s >= _SINCE_1970_S and fix.received_at >= _SINCE_1970_S:
            ahead_s = fix.clock_s - fix.received_at
            if abs(ahead_s) > self.max_age_s:
                apart = msg(f"{arg(abs(ahead_s)):.0f} s {'behind' if ahead_s < 0 else 'ahead of'}")
                message = msg(f"{arg(self._who)} reports a fix {arg(of)} with a time {arg(apart)} the clock here")
                hint = msg(f"set the modem's clock; if it is right: {arg(_REPLAY)}")
                return LinkFinding(Verdict.INCONCLUSIVE, "clock-differs", message, hint)
        if fix.suspect:
            return LinkFinding(
                Verdict.INCONCLUSIVE,
                "not-trusted",
                msg(f"{arg(self._who)} marks its own fix {arg(of)} as unreliable"),
                _ECHOES,
            )
        return None

    def _fix_findings(self, remote: int, good: Sequence[UsblFix], count: int) -> Iterator[LinkFinding]:
        last = good[-1]
        far = msg("" if last.range_m is None else f", {arg(last.range_m):.1f} m away")
        count_text = msg(f"{arg(count)} fix{'es' if count > 1 else ''} of the address {arg(remote)}")
        if last.age_s > self.max_age_s:
            message = msg(f"{arg(self._who)} reported {arg(count_text)}, but none for {arg(last.age_s):.0f} s")
            yield LinkFinding(
                Verdict.INCONCLUSIVE,
                "ended",
                message,
                msg(f"find out why they stopped, and listen again: {arg(_NOBODY)}"),
            )
            return
        yield LinkFinding(Verdict.PASS, "heard", msg(f"{arg(self._who)} reported {arg(count_text)}{arg(far)}"))
        if len(good) == 1:
            message = msg(f"only one fix of the address {arg(remote)} arrived: cannot tell whether more follow")
            yield LinkFinding(Verdict.WARN, "one-fix", message, "have it pinged every few seconds, and listen again")
        yield from _quality(self._who, remote, last)

    def _out_of_step(self, fixes: tuple[UsblFix, ...]) -> Iterator[LinkFinding]:
        """Yield a finding if the modem's clock drifts from ours, as with delayed or recorded data."""
        apart = [fix.clock_s - fix.received_at for fix in fixes if fix.clock_s is not None]
        if apart and max(apart) - min(apart) > self.max_age_s:
            far_s = max(apart) - min(apart)
            message = msg(
                f"the clock of {arg(self._who)} drifts from the clock here by {arg(far_s):.0f} s while fixes arrive"
            )
            hint = msg(f"listen again: delayed fixes arrive all at once; if nothing changes: {arg(_REPLAY)}")
            yield LinkFinding(Verdict.INCONCLUSIVE, "out-of-step", message, hint)


def _again(fixes: list[UsblFix]) -> str | None:
    """Return a description if the same measurement is repeated, or returns after another; else None."""
    keys = [(fix.form, fix.stamp) for fix in fixes]
    if len(keys) > len({fix.form for fix in fixes}) and len({fix.stamp for fix in fixes}) == 1:
        return msg(f"one fix {arg(len(keys))} times")
    for form in {fix.form for fix in fixes}:
        stamps = [fix.stamp for fix in fixes if fix.form == form]
        runs = [stamp for place, stamp in enumerate(stamps) if not place or stamp != stamps[place - 1]]
        back = [item for item, then in pairwise(runs) if _is_before(then, item)]
        if len(runs) > len(set(runs)) or back:
            return "fixes that it reported before"
    return None


def _is_before(then: object, item: object) -> bool:
    return isinstance(then, float) and isinstance(item, float) and then < item


def _first_message(wrong: Mapping[int, LinkFinding]) -> str:
    return next(iter(wrong.values())).message


def _quality(who: str, remote: int, fix: UsblFix) -> Iterator[LinkFinding]:
    of = msg(f"of the address {arg(remote)}")
    if fix.range_m is None:
        hint = "a receiver that does not ping itself gets only a direction, no range; check how it is pinged"
        yield LinkFinding(
            Verdict.WARN, "direction-only", msg(f"{arg(who)} reports only the direction {arg(of)}, no range"), hint
        )
    elif not fix.has_direction:
        hint = "a SeaTrac X110 measures no direction: connect the X150, or remove it from the column"
        yield LinkFinding(
            Verdict.WARN, "range-only", msg(f"{arg(who)} reports only the range {arg(of)}, no direction"), hint
        )
    elif _has_range_mismatch(fix, _OFF_SHARE, _OFF_M):
        yield LinkFinding(Verdict.WARN, "range-mismatch", _mismatch(who, of[3:], fix), _MISMATCH)
    low, high = status.RSSI_DB
    if fix.rssi_db is not None and not low <= fix.rssi_db <= high:
        weak = fix.rssi_db < low
        message = msg(
            f"{arg(who)} hears {arg(of[3:])} too {'weakly' if weak else 'strongly'}: {arg(fix.rssi_db):.0f} dB"
        )
        hint = "check the transducers and what is between them" if weak else "move the modems apart"
        yield LinkFinding(Verdict.WARN, "signal-weak" if weak else "signal-strong", message, hint)
    if fix.integrity is not None and fix.integrity < status.INTEGRITY_LOW:
        message = msg(
            f"{arg(who)} receives a poor signal {arg(of)}: integrity {arg(fix.integrity):.0f}, good is "
            f"{arg(status.INTEGRITY_LOW)}"
        )
        hint = "check for echoes (walls, the hull, the surface) and noise, and listen again"
        yield LinkFinding(Verdict.WARN, "integrity-low", message, hint)
    if fix.accuracy is not None and fix.accuracy > _ACCURACY_POOR:
        message = msg(f"{arg(who)} knows the direction {arg(of)} only to {arg(math.degrees(fix.accuracy)):.0f} degrees")
        yield LinkFinding(Verdict.WARN, "accuracy-poor", message, _ECHOES)
    if fix.fit_error is not None and fix.fit_error > _FIT_POOR:
        poor = msg(f"fit error {arg(fix.fit_error):.1f}, good is below {arg(_FIT_POOR):g}")
        message = msg(f"{arg(who)} measured a poor direction {arg(of)}: {arg(poor)}")
        yield LinkFinding(Verdict.WARN, "poor-fit", message, _ECHOES)


def _addresses(addresses: tuple[int, ...]) -> str:
    word = "the addresses" if len(addresses) > 1 else "the address"
    return f"{word} {', '.join(map(str, addresses))}"


def _evidence(fixes: tuple[UsblFix, ...]) -> Iterator[Evidence]:
    for remote in sorted({fix.remote for fix in fixes}):
        its = [fix for fix in fixes if fix.remote == remote]
        yield Evidence(
            type=EvidenceType.MEASURED,
            what=msg(f"fixes of the address {arg(remote)}"),
            value=join("; ", _fix_values(its)),
        )


def _fix_values(fixes: list[UsblFix]) -> Iterator[str]:
    last = fixes[-1]
    yield f"{len(fixes)}"
    yield msg(f"last {arg(last.age_s):.1f} s old")
    if last.range_m is not None:
        yield msg(f"range {arg(last.range_m):.2f} m")
    if last.distance_m is not None:
        yield msg(f"position {arg(last.distance_m):.2f} m away")
    if last.rssi_db is not None:
        yield msg(f"signal {arg(last.rssi_db):.0f} dB")
    if last.integrity is not None:
        yield msg(f"integrity {arg(last.integrity):.0f}")
    if last.accuracy is not None:
        yield msg(f"accuracy {arg(last.accuracy):g} rad")
    if last.fit_error is not None:
        yield msg(f"fit error {arg(last.fit_error):.2f}")
