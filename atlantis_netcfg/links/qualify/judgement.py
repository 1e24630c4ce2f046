"""Verdicts on figures against a named profile of thresholds, in the terms of ITU-T Y.1564 and RFC 6349.

A figure that is missing, or computed from too few packets or responses, is INCONCLUSIVE. So are gaps that a train was
too short for, or that one of its ends cut off, and a loss that the reflector partly caused by refusing what exceeded
its rate. A train without any response fails only if it was longer than a satellite's gap.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING, Final

import yaml
from pydantic import BaseModel, ConfigDict, TypeAdapter

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, join, msg

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from atlantis_netcfg.links.qualify.figures import TrainFigures
    from atlantis_netcfg.links.qualify.transfers import MessageFigures

SILENCE_S: Final = 90.0
"""Silence in seconds that proves that a link carries nothing: longer than the longest gap of a satellite."""
_SHORT_S: Final = 0.5


class QualifyProfile(BaseModel):
    """Thresholds for a verdict; `profiles.yml` explains each of them."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    ftd_s: float
    fdv_s: float
    flr: float
    gap_s: float
    avail: float
    buffer_delay: float
    min_samples: int


class NoSuchProfile(UsageError, KeyError):
    """No profile of thresholds has this name."""

    def __str__(self) -> str:
        return str(self.args[0])


@dataclass(frozen=True, slots=True)
class Judgement:
    """The verdict on one criterion: the measured value, its limit, and the reason."""

    criterion: str
    measured: float | None
    limit: float
    unit: str
    verdict: Verdict
    reason: str


@cache
def profiles() -> Mapping[str, QualifyProfile]:
    """Return all shipped profiles by name."""
    text = resources.files("atlantis_netcfg.links.qualify").joinpath("profiles.yml").read_text("utf-8")
    return TypeAdapter(dict[str, QualifyProfile]).validate_python(yaml.safe_load(text))


def profile(name: str) -> QualifyProfile:
    """Return a profile of thresholds by name; raise NoSuchProfile."""
    if name not in profiles():
        raise NoSuchProfile(
            f"unknown threshold profile `{arg(name)}`", hint=f"choose one of: {arg(join(', ', profiles()))}"
        )
    return profiles()[name]


def judge(
    idle: TrainFigures,
    limits: QualifyProfile,
    under_load: TrainFigures | None = None,
    load: MessageFigures | None = None,
) -> Sequence[Judgement]:
    """Judge an idle train and, if given, the round trips of a train beside a load that filled the link."""
    loss = idle.loss
    known_count = loss.sent - loss.in_flight
    span_s = known_count * idle.interval_s
    if idle.rtt is None:
        return [_silence(idle, limits, span_s)]
    few = msg(
        f"only {arg(known_count)} packets, at least {arg(limits.min_samples)} are needed"
        if known_count < limits.min_samples
        else ""
    )
    seldom = few
    if not few and 2 * idle.rtt.n < limits.min_samples:
        seldom = msg(f"only {arg(idle.rtt.n)} responses, at least {arg(-(-limits.min_samples // 2))} are needed")
    judgements = [_judge_maximum("FTD, round trip, 95 %", idle.rtt.p95, limits.ftd_s, "s", seldom)]
    for criterion, variation in (("FDV up, 95 %", idle.up), ("FDV down, 95 %", idle.down)):
        value = None if variation is None else variation.above_min.p95
        judgements.append(_judge_maximum(criterion, value, limits.fdv_s, "s", seldom))
    judgements += _frame_loss(idle, limits, few)
    judgements.append(_longest_gap(idle, limits, span_s))
    # Packets that are a second apart cannot show a gap of one second.
    can_see_gaps = span_s and idle.interval_s <= _SHORT_S
    judgements.append(
        _judge_minimum("AVAIL", 1.0 - idle.gaps.beyond_1_s / span_s if can_see_gaps else None, limits.avail, few)
    )
    doubt = "the offered rate is unknown" if load is None else load.doubt(idle.flr.share_up)
    judgements.append(_buffer_delay(idle, under_load, limits, doubt))
    return judgements


def _frame_loss(idle: TrainFigures, limits: QualifyProfile, few: str) -> Iterator[Judgement]:
    """Judge the loss outside of gaps; gaps are judged by their length and by the availability."""
    flr, loss, least = idle.flr, idle.loss, -(-limits.min_samples // 2)
    rate_doubt = msg(f"the reflector refused {arg(loss.limited)} packets above its rate limit" if loss.limited else "")
    rest = msg(
        f"only {arg(flr.packets)} packets outside of gaps, at least {arg(least)} are needed"
        if flr.packets < least
        else ""
    )

    def judge_share(name: str, share: float | None, doubt: str) -> Judgement:
        return _judge_maximum(
            name, share, limits.flr, "", doubt or (rest if share is None or share <= limits.flr else "")
        )

    if flr.up is None:
        yield judge_share(msg(f"FLR, both directions ({arg(loss.why)})"), flr.both, few or rate_doubt)
    else:
        yield judge_share("FLR up", flr.up, few or rate_doubt)
        yield judge_share("FLR down", flr.down, few)


def _longest_gap(idle: TrainFigures, limits: QualifyProfile, span_s: float) -> Judgement:
    longest, at_most, doubt = idle.gaps.longest_s, idle.gaps.at_most_s, ""
    if longest <= limits.gap_s:
        if span_s <= limits.gap_s:
            doubt = msg(f"a gap of {arg(limits.gap_s):g} s cannot be detected in {arg(span_s):.3g} s")
        elif at_most is None or at_most > limits.gap_s:
            doubt = "a gap at the beginning or end of the packet train may have been longer"
    return _judge_maximum("longest gap", longest, limits.gap_s, "s", doubt)


def _silence(idle: TrainFigures, limits: QualifyProfile, span_s: float) -> Judgement:
    proves = span_s >= SILENCE_S
    reason = msg(f"no response for {arg(span_s):.0f} s")
    if not proves:
        reason += msg(f"; a satellite gap may last as long, so at least {arg(SILENCE_S):.0f} s are needed")
    gap = idle.gaps.longest_s
    return Judgement(
        "AVAIL", 0.0 if gap else None, limits.avail, "", Verdict.FAIL if proves else Verdict.INCONCLUSIVE, reason
    )


def _buffer_delay(idle: TrainFigures, under_load: TrainFigures | None, limits: QualifyProfile, doubt: str) -> Judgement:
    name = "buffer delay (RFC 6349)"
    if under_load is None or under_load.rtt is None or idle.rtt is None or idle.rtt.p50 <= 0:
        return _judge_maximum(name, None, limits.buffer_delay, "", "")
    return _judge_maximum(name, (under_load.rtt.p50 - idle.rtt.p50) / idle.rtt.p50, limits.buffer_delay, "", doubt)


def _judge_maximum(name: str, value: float | None, limit: float, unit: str, doubt: str) -> Judgement:
    return _judgement(name, value, limit, unit, doubt, holds=value is not None and value <= limit)


def _judge_minimum(name: str, value: float | None, limit: float, doubt: str) -> Judgement:
    return _judgement(name, value, limit, "", doubt, holds=value is not None and value >= limit)


def _judgement(  # noqa: PLR0913 - what it is made of
    name: str, value: float | None, limit: float, unit: str, doubt: str, *, holds: bool
) -> Judgement:
    if value is None:
        return Judgement(name, None, limit, unit, Verdict.INCONCLUSIVE, "not measured")
    if doubt:
        return Judgement(name, value, limit, unit, Verdict.INCONCLUSIVE, doubt)
    verdict = Verdict.PASS if holds else Verdict.FAIL
    return Judgement(name, value, limit, unit, verdict, "within the limit" if holds else "outside the limit")
