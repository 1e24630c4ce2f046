"""What holds for every listening: a stream comes, now, from the right vehicle's autopilot, which is not armed."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.checklist.probes.rc_rf.stream import System
from atlantis_netcfg.checklist.probes.results import Trouble
from atlantis_netcfg.core.verdicts import Verdict

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.checklist.probes.rc_rf.stream import Heard
    from atlantis_netcfg.checklist.probes.rc_rf.wanted import Wanted
    from atlantis_netcfg.checklist.probes.results import Transcript

__all__ = ["armed", "doubts", "unusable"]

_INCONCLUSIVE, _FAIL = Verdict.INCONCLUSIVE, Verdict.FAIL
APART_S = 60.0
"""Clocks of an autopilot and of who listens: a live stream is not so far off."""


def armed(received: Heard, expected: Wanted) -> Finding | None:
    """Say that an autopilot is armed, whichever: nobody listens on beside propellers that may turn."""
    hot = [number for number, system in received.systems.items() if system.armed]
    if not hot:
        return None
    who = expected.name if expected.system_id in hot else f"system {hot[0]}"
    message = f"STOP AT ONCE: {who} is armed, its propellers may start"
    return Finding(
        _FAIL, "armed", message, "keep clear, have the pilot disarm it and take the battery off; then begin again"
    )


def unusable(answer: Transcript, received: Heard, expected: Wanted) -> Finding | None:
    """Say why the stream tells nothing of the vehicle; None: it does."""
    if not received.heard_bytes:
        return _unheard(answer, expected) if answer.trouble is not None else _silent(received, expected)
    if not received.good:
        message = (
            f"what arrives at {expected.end} is not MAVLink: {received.heard_bytes} bytes, no whole frame among them"
        )
        return Finding(_FAIL, "not-mavlink", message, "compare `port:` with the port to which the stream is forwarded")
    system = received.systems.get(expected.system_id, System())
    return None if system.beats else _absent(received, system, expected)


def doubts(received: Heard, expected: Wanted) -> Iterator[Finding]:
    """Say why it may be somebody else, or of another time, that is heard; a person may know better."""
    system = received.systems[expected.system_id]
    if expected.address is None:
        result = f"it came from {', '.join(system.senders)}" if any(system.senders) else "nobody has looked"
        message = f"nobody has declared from which address the stream of {expected.name} comes; {result}"
        hint = "write `endpoints.rc_rf.address`, or reserve its address in `site.lan.reservations`"
        yield Finding(_INCONCLUSIVE, "sender-unknown", message, hint)
    if system.overrides:
        message = f"a ground station sends channels to {expected.name} in place of its remote control"
        hint = "switch the joystick of the ground station off, then repeat this item"
        yield Finding(_INCONCLUSIVE, "overridden", message, hint)
    apart = [ahead for ahead in system.ahead_s if abs(ahead) > APART_S]
    if apart:
        word = "ahead" if apart[0] > 0 else "old"
        message = f"by its own clock the stream of {expected.name} is {abs(apart[0]) / 60:.0f} min {word}"
        hint = f"is a recorded flight played at {expected.end}? If it is live, look at the clocks of both"
        yield Finding(_INCONCLUSIVE, "of-another-time", message, hint)
    yield from _flow(system, received, expected)


def _flow(system: System, received: Heard, expected: Wanted) -> Iterator[Finding]:
    """The autopilot counts the time, and that count goes on as fast as time does."""
    result = system.channels
    if not result:
        return
    if len(result) == 1:
        message = (
            f"{expected.name}'s channels came once within {received.ended_s:.0f} s: whether they are alive is not known"
        )
        yield Finding(_INCONCLUSIVE, "once", message, "let its people send RC_CHANNELS four times a second")
        return
    counts = [channels.boot_ms / 1000 for channels in result]
    passed, went = result[-1].at_s - result[0].at_s, counts[-1] - counts[0]
    back = any(after < before - 1 for before, after in pairwise(counts))
    if len(set(counts)) == 1:
        message = f"the same channels of {expected.name} came {len(result)} times: its autopilot's count stands still"
        hint = "something repeats one message: look at what forwards the stream, and at the autopilot"
        yield Finding(_FAIL, "frozen", message, hint)
    elif back or not passed / 2 - 1 <= went <= passed * 2 + 2:
        message = f"{expected.name}'s autopilot has counted {went:.0f} s in {passed:.0f} s: what comes is not of now"
        hint = f"is a recorded flight played at {expected.end}? Else the autopilot was restarted: repeat this item"
        yield Finding(_INCONCLUSIVE, "not-live", message, hint)


def _silent(received: Heard, expected: Wanted) -> Finding:
    message = f"nothing arrived at {expected.end} in {received.ended_s:.0f} s"
    hint = f"switch {expected.name} on, and let its companion computer forward the MAVLink stream to {expected.end}"
    return Finding(_INCONCLUSIVE, "silent", message, hint)


def _unheard(answer: Transcript, expected: Wanted) -> Finding:
    text = f": {answer.words}" if answer.words else ""
    if answer.trouble is Trouble.NO_PLACE:
        message = f"nobody has listened to {expected.name}: {expected.place} was not reached{text}"
        return Finding(
            _INCONCLUSIVE, "place-not-reached", message, f"bring {expected.place} back first, then repeat this item"
        )
    if answer.trouble is Trouble.BUSY:
        message = f"{expected.end} is in use by another program, which gets the stream{text}"
        hint = "close the ground station there, or let the stream be forwarded to a second port and declare that"
        return Finding(_INCONCLUSIVE, "in-use", message, hint)
    if answer.trouble is Trouble.DENIED:
        message = f"{expected.end} may not be opened{text}"
        return Finding(
            _INCONCLUSIVE, "not-allowed", message, "declare a port above 1023, and look at the firewall there"
        )
    message = f"nobody could listen at {expected.end}{text}"
    return Finding(_INCONCLUSIVE, "not-heard", message, f"look at {expected.place}, then repeat this item")


def _absent(received: Heard, system: System, expected: Wanted) -> Finding:
    if system.senders:
        result = ", ".join(system.senders)
        message = f"system {expected.system_id} is heard from {result}, and {expected.name} has {expected.address}"
        hint = (
            "another vehicle may have this system id; if another computer forwards it, write `endpoints.rc_rf.address`"
        )
        return Finding(_INCONCLUSIVE, "other-sender", message, hint)
    if system.components:
        found = ", ".join(map(str, system.components))
        message = f"of system {expected.system_id} component {found} is heard, and not its autopilot, which is 1"
        hint = "let its people forward what the autopilot itself sends; a camera or a computer beside it proves nothing"
        return Finding(_INCONCLUSIVE, "other-component", message, hint)
    if received.autopilots:
        found = ", ".join(map(str, received.autopilots))
        message = f"{expected.name} should be system {expected.system_id}, and what is heard is system {found}"
        hint = "this is another vehicle, or `system_id:` differs from the autopilot's (SYSID_THISMAV, MAV_SYS_ID)"
        return Finding(_FAIL, "other-system", message, hint)
    message = f"MAVLink arrives at {expected.end}, and no autopilot's heartbeat in it within {received.ended_s:.0f} s"
    return Finding(_FAIL, "no-heartbeat", message, "look whether the companion computer still hears its autopilot")
