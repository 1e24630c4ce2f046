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


def armed(heard: Heard, wanted: Wanted) -> Finding | None:
    """Say that an autopilot is armed, whichever: nobody listens on beside propellers that may turn."""
    hot = [number for number, system in heard.systems.items() if system.armed]
    if not hot:
        return None
    who = wanted.name if wanted.system_id in hot else f"system {hot[0]}"
    message = f"STOP AT ONCE: {who} is armed, its propellers may start"
    return Finding(
        _FAIL, "armed", message, "keep clear, have the pilot disarm it and take the battery off; then begin again"
    )


def unusable(answer: Transcript, heard: Heard, wanted: Wanted) -> Finding | None:
    """Say why the stream tells nothing of the vehicle; None: it does."""
    if not heard.heard_bytes:
        return _unheard(answer, wanted) if answer.trouble is not None else _silent(heard, wanted)
    if not heard.good:
        message = f"what arrives at {wanted.end} is not MAVLink: {heard.heard_bytes} bytes, no whole frame among them"
        return Finding(_FAIL, "not-mavlink", message, "compare `port:` with the port to which the stream is forwarded")
    system = heard.systems.get(wanted.system_id, System())
    return None if system.beats else _absent(heard, system, wanted)


def doubts(heard: Heard, wanted: Wanted) -> Iterator[Finding]:
    """Say why it may be somebody else, or of another time, that is heard; a person may know better."""
    system = heard.systems[wanted.system_id]
    if wanted.address is None:
        came = f"it came from {', '.join(system.senders)}" if any(system.senders) else "nobody has looked"
        message = f"nobody has declared from which address the stream of {wanted.name} comes; {came}"
        hint = "write `endpoints.rc_rf.address`, or reserve its address in `site.lan.reservations`"
        yield Finding(_INCONCLUSIVE, "sender-unknown", message, hint)
    if system.overrides:
        message = f"a ground station sends channels to {wanted.name} in place of its remote control"
        hint = "switch the joystick of the ground station off, then repeat this item"
        yield Finding(_INCONCLUSIVE, "overridden", message, hint)
    apart = [ahead for ahead in system.ahead_s if abs(ahead) > APART_S]
    if apart:
        word = "ahead" if apart[0] > 0 else "old"
        message = f"by its own clock the stream of {wanted.name} is {abs(apart[0]) / 60:.0f} min {word}"
        hint = f"is a recorded flight played at {wanted.end}? If it is live, look at the clocks of both"
        yield Finding(_INCONCLUSIVE, "of-another-time", message, hint)
    yield from _flow(system, heard, wanted)


def _flow(system: System, heard: Heard, wanted: Wanted) -> Iterator[Finding]:
    """The autopilot counts the time, and that count goes on as fast as time does."""
    told = system.channels
    if not told:
        return
    if len(told) == 1:
        message = (
            f"{wanted.name}'s channels came once within {heard.ended_s:.0f} s: whether they are alive is not known"
        )
        yield Finding(_INCONCLUSIVE, "once", message, "let its people send RC_CHANNELS four times a second")
        return
    counts = [one.boot_ms / 1000 for one in told]
    passed, went = told[-1].at_s - told[0].at_s, counts[-1] - counts[0]
    back = any(after < before - 1 for before, after in pairwise(counts))
    if len(set(counts)) == 1:
        message = f"the same channels of {wanted.name} came {len(told)} times: its autopilot's count stands still"
        hint = "something repeats one message: look at what forwards the stream, and at the autopilot"
        yield Finding(_FAIL, "frozen", message, hint)
    elif back or not passed / 2 - 1 <= went <= passed * 2 + 2:
        message = f"{wanted.name}'s autopilot has counted {went:.0f} s in {passed:.0f} s: what comes is not of now"
        hint = f"is a recorded flight played at {wanted.end}? Else the autopilot was restarted: repeat this item"
        yield Finding(_INCONCLUSIVE, "not-live", message, hint)


def _silent(heard: Heard, wanted: Wanted) -> Finding:
    message = f"nothing arrived at {wanted.end} in {heard.ended_s:.0f} s"
    hint = f"switch {wanted.name} on, and let its companion computer forward the MAVLink stream to {wanted.end}"
    return Finding(_INCONCLUSIVE, "silent", message, hint)


def _unheard(answer: Transcript, wanted: Wanted) -> Finding:
    said = f": {answer.words}" if answer.words else ""
    if answer.trouble is Trouble.NO_PLACE:
        message = f"nobody has listened to {wanted.name}: {wanted.place} was not reached{said}"
        return Finding(
            _INCONCLUSIVE, "place-not-reached", message, f"bring {wanted.place} back first, then repeat this item"
        )
    if answer.trouble is Trouble.BUSY:
        message = f"{wanted.end} is in use by another program, which gets the stream{said}"
        hint = "close the ground station there, or let the stream be forwarded to a second port and declare that"
        return Finding(_INCONCLUSIVE, "in-use", message, hint)
    if answer.trouble is Trouble.DENIED:
        message = f"{wanted.end} may not be opened{said}"
        return Finding(
            _INCONCLUSIVE, "not-allowed", message, "declare a port above 1023, and look at the firewall there"
        )
    message = f"nobody could listen at {wanted.end}{said}"
    return Finding(_INCONCLUSIVE, "not-heard", message, f"look at {wanted.place}, then repeat this item")


def _absent(heard: Heard, system: System, wanted: Wanted) -> Finding:
    if system.senders:
        came = ", ".join(system.senders)
        message = f"system {wanted.system_id} is heard from {came}, and {wanted.name} has {wanted.address}"
        hint = (
            "another vehicle may have this system id; if another computer forwards it, write `endpoints.rc_rf.address`"
        )
        return Finding(_INCONCLUSIVE, "other-sender", message, hint)
    if system.components:
        found = ", ".join(map(str, system.components))
        message = f"of system {wanted.system_id} component {found} is heard, and not its autopilot, which is 1"
        hint = "let its people forward what the autopilot itself sends; a camera or a computer beside it proves nothing"
        return Finding(_INCONCLUSIVE, "other-component", message, hint)
    if heard.autopilots:
        found = ", ".join(map(str, heard.autopilots))
        message = f"{wanted.name} should be system {wanted.system_id}, and what is heard is system {found}"
        hint = "this is another vehicle, or `system_id:` differs from the autopilot's (SYSID_THISMAV, MAV_SYS_ID)"
        return Finding(_FAIL, "other-system", message, hint)
    message = f"MAVLink arrives at {wanted.end}, and no autopilot's heartbeat in it within {heard.ended_s:.0f} s"
    return Finding(_FAIL, "no-heartbeat", message, "look whether the companion computer still hears its autopilot")
