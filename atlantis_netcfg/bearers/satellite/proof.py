"""What probes over the satellite have shown: reached, refused, or nothing that proves anything.

Gaps without IP of up to 70 s are ordinary on this link (FFI report 20/01338), so silence counts only after a window of
at least 90 s; and silence of UDP proves nothing unless the protocol answers by itself, as NTP and OpenVPN do.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from atlantis_netcfg.bearers.status import Finding
from atlantis_netcfg.core.verdicts import Verdict

__all__ = ["WINDOW_S", "Attempt", "Expected", "Outcome", "Probe", "judge_attempt"]

WINDOW_S = 90.0
"""The shortest time of silence after which something counts as not reached."""


class Expected(StrEnum):
    """What the declaration says of a target."""

    REACHED = "reached"
    REFUSED = "refused"


class Outcome(StrEnum):
    """What was seen."""

    ANSWERED = "answered"
    SILENT = "silent"
    """Nothing came back within the window."""
    REFUSED_HERE = "refused here"
    """The router itself refused the packet, so that nothing was sent."""
    NOT_TRIED = "not tried"
    """There is no way to ask this target from the router; `note` says why."""


class Probe(StrEnum):
    """How a target was tried."""

    ICMP = "icmp"
    TCP = "tcp"
    UDP_COUNTER = "udp, answers counted by the filter"
    TUNNEL = "openvpn, answers counted by the filter"
    """While the tunnel is down its client asks again and again, so that here silence does count."""
    TIME = "ntp, answers counted by the filter"
    """The time client was made to ask; its server answers everybody, so that here silence does count."""
    NONE = "none"


@dataclass(frozen=True, slots=True)
class Attempt:
    """One target, tried once."""

    name: str
    target: str
    """As a person would say it: `203.0.113.2 udp 1194`."""
    expected: Expected
    probe: Probe
    outcome: Outcome
    after_s: float | None = None
    """Until the first answer."""
    window_s: float = 0.0
    """How long it was tried."""
    filter_open: bool = False
    """Whether the router's filter was opened for this target, so that the terminal alone decided."""
    note: str = ""


def judge_attempt(attempt: Attempt, *, link_seen: bool) -> Finding:
    """Judge one attempt: PASS, FAIL, or INCONCLUSIVE where silence or a missing way proves nothing.

    `link_seen`: something was reached over the satellite in the same run; over a dead link everything looks refused.
    """
    if attempt.outcome is Outcome.NOT_TRIED:
        message = f"{attempt.name} ({attempt.target}) could not be tried: {attempt.note}"
        return Finding(Verdict.INCONCLUSIVE, "not-tried", message)
    if attempt.expected is Expected.REACHED:
        return _reached(attempt)
    if attempt.outcome is Outcome.SILENT and not link_seen:
        message = f"{attempt.name} ({attempt.target}) did not answer, but nothing else was reached over the satellite"
        return Finding(Verdict.INCONCLUSIVE, "link-not-seen", message, "is the terminal connected? Then try again")
    return _refused(attempt)


def _reached(attempt: Attempt) -> Finding:
    who = f"{attempt.name} ({attempt.target})"
    if attempt.outcome is Outcome.ANSWERED:
        after = "" if attempt.after_s is None else f" after {attempt.after_s:.0f} s"
        return Finding(Verdict.PASS, "reached", f"{who} was reached{after} over the satellite")
    if attempt.outcome is Outcome.REFUSED_HERE:
        hint = "provision the site first: its filter is not the declared one"
        return Finding(Verdict.FAIL, "refused-by-the-router", f"{who} is allowed, and the router refuses it", hint)
    if attempt.window_s < WINDOW_S or attempt.probe is Probe.UDP_COUNTER:
        why = attempt.note or f"{attempt.window_s:.0f} s of silence are an ordinary gap of this link"
        return Finding(Verdict.INCONCLUSIVE, "silent", f"{who} did not answer: {why}", "try again later, or longer")
    message = f"{who} did not answer in {attempt.window_s:.0f} s over the satellite"
    hint = "is the terminal connected, and does its own allow-list hold this target?"
    return Finding(Verdict.FAIL, "not-reached", message, hint)


def _refused(attempt: Attempt) -> Finding:
    who = f"{attempt.name} ({attempt.target})"
    if attempt.outcome is Outcome.ANSWERED:
        if attempt.filter_open:
            message = f"{who} was reached with the router's filter open: only the router enforces the allow-list"
            hint = "enter the declared destinations on the terminal's page"
            return Finding(Verdict.WARN, "only-the-router-enforces", message, hint)
        hint = "`provision site=…` brings the filter back; `provision drift site=…` first tells what has changed"
        return Finding(Verdict.FAIL, "leak", f"{who} is not allowed, and was reached over the satellite", hint)
    if attempt.outcome is Outcome.REFUSED_HERE:
        return Finding(Verdict.PASS, "refused", f"{who} is refused by the router, nothing was sent")
    if attempt.filter_open and attempt.window_s < WINDOW_S:
        message = f"{who} did not answer in {attempt.window_s:.0f} s: too short to tell a refusal from a gap"
        return Finding(Verdict.INCONCLUSIVE, "silent", message, "try again with a longer window")
    if attempt.filter_open:
        message = f"{who} did not answer in {attempt.window_s:.0f} s with the router's filter open"
        return Finding(Verdict.PASS, "refused-beyond", f"{message}: the terminal or the network refuses it")
    return Finding(Verdict.PASS, "refused", f"{who} was not reached in {attempt.window_s:.0f} s")
