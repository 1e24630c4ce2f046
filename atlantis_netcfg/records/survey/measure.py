"""The survey loop: read the unit at every step, and send a few test packets when the hourly budget allows it.

The budget sets the interval between tests. Each test has a maximum cost, which its guard enforces. The next test
starts late enough that no period of one hour holds more than the budget. Between tests the unit is still read,
which costs nothing on the link.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final, Protocol

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.messages import arg
from atlantis_netcfg.links.qualify import session
from atlantis_netcfg.links.qualify.budget import Budget, BudgetGuard
from atlantis_netcfg.links.qualify.figures import train_figures
from atlantis_netcfg.links.qualify.grids import message_bytes, train_bytes
from atlantis_netcfg.links.qualify.messages import MessagePlan, MessageStream
from atlantis_netcfg.links.qualify.reflector import stamp
from atlantis_netcfg.links.qualify.samples import MessageResult, ReplySample
from atlantis_netcfg.links.qualify.transfers import message_figures
from atlantis_netcfg.records.survey.points import SurveyPoint
from atlantis_netcfg.records.survey.positions import TrackPosition

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from datetime import datetime

    from atlantis_netcfg.links.qualify.samples import Sample
    from atlantis_netcfg.links.qualify.transport import DatagramTransport
    from atlantis_netcfg.records.survey.positions import PositionSource

HOUR_S: Final = 3600.0
MAX_MB: Final = 2.0
_TIMEOUT_S: Final = 2.0
_QUESTIONS: Final = 3
_TRAIN: Final = session.TrainPlan(stamp.AUTHENTICATED_SIZE, 0.2, 1.0, timeout_s=_TIMEOUT_S)
_MESSAGE: Final = MessagePlan(9600, 1.0, 1.0, timeout_s=_TIMEOUT_S, give_up_s=4 * _TIMEOUT_S)
_LOOK_S: Final = 0.5
"""Interval in seconds at which due steps are checked."""
ANOTHER_LINK: Final = "another link carries the traffic"
BUDGET: Final = "the hourly budget"
NO_ANSWER: Final = "no response"
STOP_REASON: Final = "it was stopped"
NOT_CONFIRMED: Final = "the receiver did not confirm the message"
NOTHING_SENT: Final = "nothing is sent"


class HourlyBudgetError(UsageError, ValueError):
    """Raised when the hourly budget is too small for a test."""


@dataclass(frozen=True, slots=True)
class SurveyPlan:
    """Interval of points, and budget of the tests."""

    step_s: float = 30.0
    """Longest interval between points in seconds; a point is also taken whenever the budget allows a test."""
    step_m: float | None = 50.0
    """Longest distance between points in metres; None: by time only."""
    hourly_bytes: int = round(MAX_MB * 1_000_000)
    train: session.TrainPlan = _TRAIN
    message: MessagePlan = _MESSAGE
    max_seconds: float | None = None

    def test_bytes(self, headers: int) -> int:
        """Return the maximum cost of a test: all packets with replies, and all acknowledgement requests."""
        answer = stamp.AUTHENTICATED_SIZE + stamp.HMAC_TLV_SIZE + stamp.ACKNOWLEDGEMENT_SIZE
        questions = _QUESTIONS * 2 * (answer + headers)
        return train_bytes(self.train, headers) + message_bytes(self.message, headers) + questions

    def test_every_s(self, headers: int) -> float:
        """Return the shortest test interval that the budget allows. Raises HourlyBudgetError.

        An hour holds at most the tests that start in it, one more (fence post), and the end of the one before it.
        """
        cost = self.test_bytes(headers)
        if self.hourly_bytes < 3 * cost:
            raise HourlyBudgetError(
                f"{arg(self.hourly_bytes)} bytes per hour are not enough: a test needs up to {arg(cost)}, and three "
                "must fit",
                hint=f"use `--max-mb {arg(3.01 * cost / 1000000):.2f}` or more, or `--radio-only`, which sends nothing",
            )
        return HOUR_S * cost / (self.hourly_bytes - 2 * cost)


@dataclass(frozen=True, slots=True)
class RadioSample:
    """Values read from the 4G unit; None where the unit did not report one."""

    registration: str | None = None
    technology: str | None = None
    operator: str | None = None
    band: str | None = None
    cell: str | None = None
    rsrp_dbm: float | None = None
    rsrq_db: float | None = None
    sinr_db: float | None = None
    no_radio: str = ""


class RadioReader(Protocol):
    """Reads the unit and the router, both over the site's own network."""

    def read(self) -> RadioSample:
        """Read the unit; a failure is recorded in the sample."""

    def carried_by(self) -> str | None:
        """Return the link that carries the site's traffic, from the router's routes; None if unknown."""


class SurveyClock(Protocol):
    """Clock of a survey; the emulated implementation does not really wait."""

    def now_s(self) -> float:
        """Return the seconds of a monotonic clock."""

    def utc(self) -> datetime:
        """Return the date and time in UTC."""

    def wait(self, seconds: float) -> None:
        """Wait for this many seconds."""


@dataclass(frozen=True, slots=True)
class TestSample:
    """Result of one test."""

    __test__ = False

    sent: int | None = None
    lost: int | None = None
    rtt_min_s: float | None = None
    rtt_median_s: float | None = None
    rtt_max_s: float | None = None
    goodput_up_bps: float | None = None
    no_test: str = ""
    test_bytes: int = 0
    carried_by: str | None = None


@dataclass(slots=True)
class LinkTester:
    """Sends a packet train and, if replies arrive, one message; each within the cost of one test."""

    plan: SurveyPlan
    transport: DatagramTransport
    peer: session.ReflectorPeer
    write: Callable[[Sample], None]

    def test(self, number: int) -> TestSample:
        """Run one test now; a test stopped by Ctrl-C is marked as stopped."""
        budget = Budget(max_bytes=self.plan.test_bytes(self.transport.headers))
        guard = BudgetGuard(budget, lambda: self.transport.now_ns() / session.SECOND, self.transport.headers)
        sample, was_stopped = self._run_train(guard, f"point-{number}")
        if sample.rtt_median_s is not None and not was_stopped:
            rate, was_stopped = self._run_message(guard, f"point-{number}-load")
            sample = replace(sample, goodput_up_bps=rate, no_test=NOT_CONFIRMED if rate is None else "")
        reason = STOP_REASON if was_stopped else sample.no_test
        return replace(sample, no_test=reason, test_bytes=guard.sent_bytes + guard.received_bytes)

    def _run_train(self, guard: BudgetGuard, name: str) -> tuple[TestSample, bool]:
        samples: list[Sample] = []
        # The reflector's counters would be one more question: a few packets do not tell the direction of a loss.
        train = session.Train(name, self.plan.train, replace(self.peer, counts=False), self.transport, samples.append)
        was_stopped = self._run(
            guard, train, samples, lambda: len(_answered_sequences(samples)) >= self.plan.train.packets
        )
        figures = train_figures(samples, name)
        sample = TestSample(figures.loss.sent, figures.loss.lost, no_test=NO_ANSWER)
        if figures.rtt is not None:
            rtt = figures.rtt
            sample = replace(sample, rtt_min_s=rtt.min, rtt_median_s=rtt.p50, rtt_max_s=rtt.max, no_test="")
        return sample, was_stopped

    def _run_message(self, guard: BudgetGuard, name: str) -> tuple[float | None, bool]:
        samples: list[Sample] = []
        message = MessageStream(name, self.plan.message, self.peer, self.transport, samples.append)
        was_stopped = self._run(guard, message, samples, lambda: any(map(_is_complete, samples)))
        figures = message_figures(samples, name)
        return (None if figures is None or not figures.received_count else figures.busy_bps), was_stopped

    def _run(
        self, guard: BudgetGuard, stream: session.PacketStream, samples: Sequence[Sample], complete: Callable[[], bool]
    ) -> bool:
        """Run a stream until it is complete; return True if Ctrl-C stopped it (`session.run` also ends on Ctrl-C)."""
        reason = session.run(self.transport, self.peer, [stream], guard, stop=complete)
        for sample in samples:
            self.write(sample)
        return reason == session.EndReason.STOPPED and not complete()


def _is_complete(sample: Sample) -> bool:
    """Return True for the result of a message that is no longer in flight."""
    return isinstance(sample, MessageResult) and not sample.in_flight


def _answered_sequences(samples: Sequence[Sample]) -> set[int]:
    return {sample.sequence for sample in samples if isinstance(sample, ReplySample)}


@dataclass(slots=True)
class RunningSurvey:
    """A survey in progress; `run` continues until it is stopped or its time is over."""

    plan: SurveyPlan
    link: str
    positions: PositionSource
    radio: RadioReader
    tester: LinkTester | None
    """None: no test packets are sent."""
    clock: SurveyClock
    write: Callable[[SurveyPoint], None]
    points: list[SurveyPoint] = field(default_factory=list)
    _begin_s: float = 0.0
    _next_test_s: float = 0.0
    _again_s: float = 0.0
    """Earliest time of another point for a test while another link carries the traffic."""
    _last_s: float | None = None
    _last: TrackPosition | None = None

    def begin(self) -> None:
        """Start the clocks of the survey."""
        self._begin_s = self._next_test_s = self._again_s = self.clock.now_s()

    def run(self) -> str:
        """Take points by time and distance; return the end reason. After KeyboardInterrupt all points are kept."""
        self.begin()
        try:
            while not self._is_over():
                if self._is_due() and self.take().no_test == STOP_REASON:
                    return session.EndReason.STOPPED
                self.clock.wait(_LOOK_S)
        except KeyboardInterrupt:
            return session.EndReason.STOPPED
        return session.EndReason.DONE

    def _is_over(self) -> bool:
        limit = self.plan.max_seconds
        return limit is not None and self.clock.now_s() - self._begin_s >= limit

    def _is_due(self) -> bool:
        now_s = self.clock.now_s()
        if self._last_s is None or now_s - self._last_s >= self.plan.step_s:
            return True
        if self.tester is not None and now_s >= max(self._next_test_s, self._again_s):
            return True
        here = self.positions.position() if self.plan.step_m is not None and self._last is not None else None
        if not isinstance(here, TrackPosition) or self._last is None or self.plan.step_m is None:
            return False
        return here.distance_m(self._last) >= self.plan.step_m

    def take(self) -> SurveyPoint:
        """Take one point at the current position, and write it."""
        begun_s = self._last_s = self.clock.now_s()
        radio = self.radio.read()
        here = self.positions.position()
        at, at_s = self.clock.utc(), self.clock.now_s()
        self._last = here if isinstance(here, TrackPosition) else self._last
        test = self._test()
        point = SurveyPoint(
            number=len(self.points) + 1,
            at=at,
            at_s=round(at_s - self._begin_s, 3),
            read_s=round(at_s - begun_s, 3),
            **self._position(here),
            **_fields(radio),
            **_fields(test),
            moved_m=self._distance_moved(here) if test.sent is not None else None,
        )
        self.points.append(point)
        self.write(point)
        return point

    @staticmethod
    def _position(here: TrackPosition | str) -> dict[str, Any]:
        if not isinstance(here, TrackPosition):
            return {"no_position": str(here)}
        place = {"latitude": round(here.latitude, 7), "longitude": round(here.longitude, 7), "place": here.place}
        return {**place, "fix_age_s": here.age_s, "hdop": here.hdop}

    def _distance_moved(self, here: TrackPosition | str) -> float | None:
        there = self.positions.position()
        if not isinstance(here, TrackPosition) or not isinstance(there, TrackPosition):
            return None
        return round(here.distance_m(there), 1)

    def _test(self) -> TestSample:
        """Run a test if the budget and the link in use allow it."""
        tester, now_s = self.tester, self.clock.now_s()
        if tester is None:
            return TestSample(no_test=NOTHING_SENT)
        if now_s < self._next_test_s:
            return TestSample(no_test=BUDGET)
        carried_by = self.radio.carried_by()
        if carried_by is not None and carried_by != self.link:
            self._again_s = now_s + self.plan.step_s
            return TestSample(no_test=ANOTHER_LINK, carried_by=carried_by)
        now_s = self.clock.now_s()
        self._next_test_s = now_s + self.plan.test_every_s(tester.transport.headers)
        return replace(tester.test(len(self.points) + 1), carried_by=carried_by)


def _fields(sample: RadioSample | TestSample) -> dict[str, Any]:
    return {name: getattr(sample, name) for name in sample.__dataclass_fields__}


_STEP = re.compile(r"(\d{1,5}(?:\.\d{1,2})?)(m|s)")
_LEAST_S, _LEAST_M = 2.0, 1.0


def parse_steps(text: str | None) -> tuple[float | None, float]:
    """Read `every=50m,30s`, `every=10s`, `every=20m`: metres (None: by time alone) and seconds. Raises UsageError."""
    plan = SurveyPlan()
    if text is None:
        return plan.step_m, plan.step_s
    matches = [_STEP.fullmatch(part.strip()) for part in text.split(",")]
    step_by_unit = {match[2]: float(match[1]) for match in matches if match is not None}
    if None in matches or len(step_by_unit) != len(matches):
        raise UsageError(
            f"`every={arg(text)}` is not a valid interval", hint="give metres, seconds, or both: `every=50m,30s`"
        )
    if step_by_unit.get("s", _LEAST_S) < _LEAST_S or step_by_unit.get("m", _LEAST_M) < _LEAST_M:
        raise UsageError(
            f"`every={arg(text)}` is too frequent",
            hint=f"use at least {arg(_LEAST_S):g} s and {arg(_LEAST_M):g} m: the unit is read each time",
        )
    return step_by_unit.get("m"), step_by_unit.get("s", plan.step_s)


def parse_hourly_budget(text: str) -> int:
    """Parse `--max-mb` into bytes per hour; the maximum is 2 MB. Raises UsageError."""
    if not re.fullmatch(r"\d{1,3}(\.\d{1,6})?", text) or not 0 < float(text) <= MAX_MB:
        raise UsageError(
            f"`--max-mb {arg(text)}` is not a valid budget",
            hint=f"give megabytes per hour, {arg(MAX_MB):g} at most: `--max-mb 0.5`",
        )
    return round(float(text) * 1_000_000)
