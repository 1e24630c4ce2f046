"""What holds for every listening: a stream comes, from the right vehicle, and that vehicle is not armed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.probes.answers import Trouble
from atlantis_netcfg.verdicts import Verdict

if TYPE_CHECKING:
    from atlantis_netcfg.probes.answers import Transcript
    from atlantis_netcfg.probes.rc_rf.stream import Heard
    from atlantis_netcfg.probes.rc_rf.wanted import Wanted

__all__ = ["armed", "unusable"]

_INCONCLUSIVE, _FAIL = Verdict.INCONCLUSIVE, Verdict.FAIL


def armed(heard: Heard, wanted: Wanted) -> Finding | None:
    """Say that an autopilot is armed, whichever: nobody listens on beside propellers that may turn."""
    hot = [number for number in heard.autopilots if any(beat.armed for beat in heard.systems[number].beats)]
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
    if wanted.system_id not in heard.autopilots:
        return _absent(heard, wanted)
    return None


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


def _absent(heard: Heard, wanted: Wanted) -> Finding:
    if heard.autopilots:
        found = ", ".join(map(str, heard.autopilots))
        message = f"{wanted.name} should be system {wanted.system_id}, and what is heard is system {found}"
        hint = "this is another vehicle, or `system_id:` differs from the autopilot's (SYSID_THISMAV, MAV_SYS_ID)"
        return Finding(_FAIL, "other-system", message, hint)
    message = f"MAVLink arrives at {wanted.end}, and no autopilot's heartbeat in it within {heard.ended_s:.0f} s"
    return Finding(_FAIL, "no-heartbeat", message, "look whether the companion computer still hears its autopilot")
