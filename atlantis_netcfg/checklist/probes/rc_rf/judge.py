"""Judge from the stream whether the remote control reaches the autopilot.

For every stream: it arrives, is current, and comes from the right vehicle's autopilot, which is not armed. For the
remote control: channels arrive, and change while the pilot moves the sticks.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from statistics import correlation
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes.base import Transcript, Trouble
from atlantis_netcfg.checklist.probes.rc_rf.stream import RSSI_UNKNOWN, Channels, Stream, System
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.links import LinkFinding

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence


FRESH_S = 3.0
"""Maximum age: heartbeats arrive once a second, channels at least as often."""
LOW_US, HIGH_US = 900, 2100
UNSTEADY = 0.25
"""RSSI is unsteady if it swings by more than this share of its highest value; the scale is the vehicle's own."""
BAD_SHARE = 0.05


def judge(stream: Stream, expectation: RcExpectation) -> tuple[LinkFinding, ...]:
    """Judge a stream with the vehicle's data; without problems there is a single finding, which passes."""
    system = stream.systems[expectation.system_id]
    findings = (
        *_check_heartbeat(stream, system, expectation),
        *_receiver_findings(system, expectation),
        *_rssi(system, expectation),
        *_check_damage(stream, expectation),
    )
    return findings or (_good_finding(system, expectation),)


def _check_heartbeat(stream: Stream, system: System, expectation: RcExpectation) -> Iterator[LinkFinding]:
    age_s = stream.ended_s - system.beats[-1].at_s
    if age_s > FRESH_S:
        message = msg(f"the last heartbeat of {arg(expectation.name)} is {arg(age_s):.0f} s old")
        yield LinkFinding(
            Verdict.FAIL, "heartbeat-lost", message, "check the autopilot's power and the forwarding of its stream"
        )
    if not system.channels:
        yield no_channels(stream, expectation)
        return
    last = system.channels[-1]
    channels_age_s = stream.ended_s - last.at_s
    if channels_age_s > max(FRESH_S, age_s):
        message = msg(
            f"the channels of {arg(expectation.name)} stopped {arg(channels_age_s):.0f} s ago, but its heartbeats "
            "continue"
        )
        yield LinkFinding(
            Verdict.FAIL,
            "channels-stale",
            message,
            "check the remote control's receiver and its cable to the autopilot",
        )
    if not last.count or all(value is None for value in last.values):
        message = msg(f"the autopilot of {arg(expectation.name)} receives no channel of the remote control")
        yield LinkFinding(
            Verdict.FAIL,
            "no-receiver",
            message,
            "switch the transmitter on, then check the receiver's cable and binding",
        )
    elif strange := odd(last):
        message = msg(
            f"the channels of {arg(expectation.name)} are outside {arg(LOW_US)} to {arg(HIGH_US)} us: {arg(strange)}"
        )
        yield LinkFinding(
            Verdict.FAIL,
            "channels-odd",
            message,
            "calibrate the remote control, and check the receiver's failsafe values",
        )


def no_channels(stream: Stream, expectation: RcExpectation) -> LinkFinding:
    """Return the finding for a stream without RC_CHANNELS, which may be due to a setting, so nothing follows."""
    message = msg(f"{arg(expectation.name)} sent no RC_CHANNELS within {arg(stream.ended_s):.0f} s")
    hint = (
        "ask its operators to add RC_CHANNELS to the stream (ArduPilot: SRx_RC_CHAN; PX4: mavlink stream); this "
        "program requests nothing"
    )
    return LinkFinding(Verdict.INCONCLUSIVE, "no-channels", message, hint)


def odd(channels: Channels) -> str:
    """Describe the channels whose values are out of range; empty if there are none."""
    strange = [
        msg(f"channel {arg(number)}: {arg(value)}")
        for number, value in enumerate(channels.values, 1)
        if value is not None and not LOW_US <= value <= HIGH_US
    ]
    return join(", ", strange)


def _receiver_findings(system: System, expectation: RcExpectation) -> Iterator[LinkFinding]:
    if not system.receiver:
        message = msg(
            f"{arg(expectation.name)} sends no SYS_STATUS: what its autopilot reports about the receiver is unknown"
        )
        yield LinkFinding(Verdict.WARN, "no-sys-status", message, "ask its operators to add SYS_STATUS to the stream")
        return
    last = system.receiver[-1]
    if not last.present:
        message = msg(f"the autopilot of {arg(expectation.name)} has no remote-control receiver")
        yield LinkFinding(
            Verdict.FAIL, "receiver-absent", message, "check the receiver's cable and the autopilot's RC protocol"
        )
    elif not last.is_enabled:
        message = msg(f"the autopilot of {arg(expectation.name)} has the remote control disabled")
        yield LinkFinding(
            Verdict.FAIL,
            "receiver-disabled",
            message,
            "ask its operators to enable the remote control in the autopilot",
        )
    elif not last.healthy:
        message = msg(f"the autopilot of {arg(expectation.name)} reports the remote-control receiver as unhealthy")
        yield LinkFinding(
            Verdict.FAIL, "receiver-unhealthy", message, "switch the transmitter on, and check the receiver's antenna"
        )


def _rssi(system: System, expectation: RcExpectation) -> Iterator[LinkFinding]:
    result = [channel.rssi for channel in system.channels if channel.count]
    known_rssi = [rssi for rssi in result if rssi != RSSI_UNKNOWN]
    if result and not known_rssi:
        message = msg(f"{arg(expectation.name)} does not report the signal strength of the remote control (rssi 255)")
        yield LinkFinding(Verdict.WARN, "rssi-unknown", message, "rely on the manual range test")
    if not known_rssi:
        return
    if expectation.rssi_low is not None and min(known_rssi) < expectation.rssi_low:
        message = msg(
            f"the remote control of {arg(expectation.name)} has rssi {arg(min(known_rssi))}, below its own limit "
            f"{arg(expectation.rssi_low)}"
        )
        yield LinkFinding(
            Verdict.WARN, "rssi-low", message, "check both antennas; the value is only comparable within this vehicle"
        )
    if max(known_rssi) - min(known_rssi) > UNSTEADY * max(known_rssi):
        message = msg(
            f"the signal of the remote control of {arg(expectation.name)} is unsteady: rssi {arg(min(known_rssi))} to "
            f"{arg(max(known_rssi))}"
        )
        yield LinkFinding(
            Verdict.WARN, "rssi-unsteady", message, "check both antennas, and for other transmitters in the band"
        )
    elif not max(known_rssi):
        message = msg(f"{arg(expectation.name)} reports rssi 0: no signal, or RSSI is not set up")
        yield LinkFinding(
            Verdict.WARN, "rssi-zero", message, "rely on the manual range test, or set up RSSI in the autopilot"
        )


def _check_damage(stream: Stream, expectation: RcExpectation) -> Iterator[LinkFinding]:
    total = stream.good + stream.bad
    if stream.bad > 1 and stream.bad > BAD_SHARE * total:
        message = msg(f"{arg(stream.bad)} of {arg(total)} pieces of the stream at {arg(expectation.end)} are corrupted")
        yield LinkFinding(
            Verdict.WARN, "damaged", message, "check the telemetry radio or serial line that carries the stream"
        )


def _good_finding(system: System, expectation: RcExpectation) -> LinkFinding:
    last = system.channels[-1]
    message = msg(
        f"{arg(expectation.name)} is disarmed and receives its remote control: {arg(last.count)} channels, rssi "
        f"{arg(last.rssi)}"
    )
    return LinkFinding(Verdict.PASS, "rc-heard", message)


_INCONCLUSIVE, _FAIL = Verdict.INCONCLUSIVE, Verdict.FAIL
APART_S = 60.0
"""Clocks of an autopilot and of the listener: those of a live stream differ by less."""


def check_disarmed(stream: Stream, expectation: RcExpectation) -> LinkFinding | None:
    """Return a finding if any autopilot is armed: nobody may stay near propellers that may start."""
    hot = [number for number, system in stream.systems.items() if system.is_armed]
    if not hot:
        return None
    who = expectation.name if expectation.system_id in hot else msg(f"system {arg(hot[0])}")
    message = msg(f"STOP AT ONCE: {arg(who)} is armed; its propellers may start")
    return LinkFinding(
        _FAIL, "armed", message, "keep clear; ask the pilot to disarm it and remove the battery; then start again"
    )


def unusable(answer: Transcript, stream: Stream, expectation: RcExpectation) -> LinkFinding | None:
    """Return the finding for a stream without usable data of the vehicle; None if it has data."""
    if not stream.heard_bytes:
        return (
            _not_listened_finding(answer, expectation) if answer.trouble is not None else _silent(stream, expectation)
        )
    if not stream.good:
        message = msg(
            f"the data at {arg(expectation.end)} is not MAVLink: {arg(stream.heard_bytes)} bytes without one complete "
            "frame"
        )
        return LinkFinding(
            _FAIL, "not-mavlink", message, "compare `port:` with the port to which the stream is forwarded"
        )
    system = stream.systems.get(expectation.system_id, System())
    return None if system.beats else _absence_finding(stream, system, expectation)


def doubts(stream: Stream, expectation: RcExpectation) -> Iterator[LinkFinding]:
    """Yield findings for data that may come from another sender or time; a person may know better."""
    system = stream.systems[expectation.system_id]
    if expectation.address is None:
        result = msg(f"it came from {arg(join(', ', system.senders))}" if any(system.senders) else "not checked")
        message = msg(f"the inventory has no source address for the stream of {arg(expectation.name)}; {arg(result)}")
        hint = "set `endpoints.rc_rf.address`, or reserve its address in `site.lan.reservations`"
        yield LinkFinding(_INCONCLUSIVE, "sender-unknown", message, hint)
    if system.overrides:
        message = msg(f"a ground station sends channels to {arg(expectation.name)} instead of its remote control")
        hint = "switch off the ground station's joystick, then repeat this item"
        yield LinkFinding(_INCONCLUSIVE, "overridden", message, hint)
    apart = [ahead for ahead in system.ahead_s if abs(ahead) > APART_S]
    if apart:
        span = msg(f"{arg(abs(apart[0]) / 60):.0f} min {'ahead' if apart[0] > 0 else 'old'}")
        message = msg(f"by its own clock, the stream of {arg(expectation.name)} is {arg(span)}")
        hint = msg(
            f"check whether a recorded flight is replayed at {arg(expectation.end)}; if the stream is live, check both "
            "clocks"
        )
        yield LinkFinding(_INCONCLUSIVE, "of-another-time", message, hint)
    yield from _flow(system, stream, expectation)


def _flow(system: System, stream: Stream, expectation: RcExpectation) -> Iterator[LinkFinding]:
    """Yield findings if the autopilot's clock does not advance at the rate of real time."""
    result = system.channels
    if not result:
        return
    if len(result) == 1:
        message = msg(
            f"the channels of {arg(expectation.name)} came only once within {arg(stream.ended_s):.0f} s: cannot tell "
            "whether they are live"
        )
        yield LinkFinding(_INCONCLUSIVE, "once", message, "ask its operators to send RC_CHANNELS four times a second")
        return
    counts = [channels.boot_ms / 1000 for channels in result]
    elapsed_s, went = result[-1].at_s - result[0].at_s, counts[-1] - counts[0]
    back = any(after < before - 1 for before, after in pairwise(counts))
    if len(set(counts)) == 1:
        message = msg(
            f"the same channels of {arg(expectation.name)} came {arg(len(result))} times: its autopilot's time does "
            "not advance"
        )
        hint = "something repeats one message: check what forwards the stream, and the autopilot"
        yield LinkFinding(_FAIL, "frozen", message, hint)
    elif back or not elapsed_s / 2 - 1 <= went <= elapsed_s * 2 + 2:
        message = msg(
            f"the autopilot of {arg(expectation.name)} advanced {arg(went):.0f} s in {arg(elapsed_s):.0f} s: the data "
            "is not live"
        )
        hint = msg(
            f"check whether a recorded flight is replayed at {arg(expectation.end)}; otherwise the autopilot was "
            "restarted: repeat this item"
        )
        yield LinkFinding(_INCONCLUSIVE, "not-live", message, hint)


def _silent(stream: Stream, expectation: RcExpectation) -> LinkFinding:
    message = msg(f"nothing arrived at {arg(expectation.end)} in {arg(stream.ended_s):.0f} s")
    hint = msg(
        f"switch {arg(expectation.name)} on, and set its companion computer to forward the MAVLink stream to "
        f"{arg(expectation.end)}"
    )
    return LinkFinding(_INCONCLUSIVE, "silent", message, hint)


def _not_listened_finding(answer: Transcript, expectation: RcExpectation) -> LinkFinding:
    text = msg(f": {arg(answer.words)}" if answer.words else "")
    if answer.trouble is Trouble.NO_PLACE:
        message = msg(f"{arg(expectation.name)} was not checked: {arg(expectation.place)} was not reachable{arg(text)}")
        return LinkFinding(
            _INCONCLUSIVE,
            "place-not-reached",
            message,
            msg(f"make {arg(expectation.place)} reachable, then repeat this item"),
        )
    if answer.trouble is Trouble.BUSY:
        message = msg(f"{arg(expectation.end)} is in use by another program, which receives the stream{arg(text)}")
        hint = "close the ground station there, or forward the stream to a second port and put that in the inventory"
        return LinkFinding(_INCONCLUSIVE, "in-use", message, hint)
    if answer.trouble is Trouble.DENIED:
        message = msg(f"no permission to open {arg(expectation.end)}{arg(text)}")
        return LinkFinding(
            _INCONCLUSIVE,
            "not-allowed",
            message,
            "use a port above 1023 in the inventory, and check the firewall there",
        )
    message = msg(f"could not listen at {arg(expectation.end)}{arg(text)}")
    return LinkFinding(
        _INCONCLUSIVE, "not-heard", message, msg(f"check {arg(expectation.place)}, then repeat this item")
    )


def _absence_finding(stream: Stream, system: System, expectation: RcExpectation) -> LinkFinding:
    if system.senders:
        result = join(", ", system.senders)
        message = msg(
            f"system {arg(expectation.system_id)} comes from {arg(result)}, but {arg(expectation.name)} has "
            f"{arg(expectation.address)}"
        )
        hint = (
            "another vehicle may have this system id; if another computer forwards the stream, set "
            "`endpoints.rc_rf.address`"
        )
        return LinkFinding(_INCONCLUSIVE, "other-sender", message, hint)
    if system.components:
        ids = join(", ", map(str, system.components))
        message = msg(
            f"from system {arg(expectation.system_id)}, component {arg(ids)} is received, but not its autopilot, which "
            "is component 1"
        )
        hint = (
            "ask its operators to forward what the autopilot itself sends; data from a camera or companion "
            "computer is no proof"
        )
        return LinkFinding(_INCONCLUSIVE, "other-component", message, hint)
    if stream.autopilots:
        ids = join(", ", map(str, stream.autopilots))
        message = msg(
            f"{arg(expectation.name)} should be system {arg(expectation.system_id)}, but system {arg(ids)} is received"
        )
        hint = (
            "this is another vehicle, or `system_id:` differs from the autopilot's setting (SYSID_THISMAV, MAV_SYS_ID)"
        )
        return LinkFinding(_FAIL, "other-system", message, hint)
    message = msg(
        f"MAVLink arrives at {arg(expectation.end)}, but no autopilot heartbeat within {arg(stream.ended_s):.0f} s"
    )
    return LinkFinding(
        _FAIL, "no-heartbeat", message, "check whether the companion computer still receives data from its autopilot"
    )


MOVED_US = 100
"""More than noise and trims: a tenth of a stick's travel."""
AXES = 4
"""Axes of two sticks."""
AS_ONE = 0.98
"""From this correlation on, two channels are one movement; a hand does not hold two axes so well together."""
MIN_CHANNEL_SETS = 3
"""Fewer sets of channels do not show a movement."""


def ranges(channels: Sequence[Channels]) -> dict[int, tuple[int, int]]:
    """Return the lowest and highest value of each channel that moved."""
    result = {}
    for number in range(max((channel.count for channel in channels), default=0)):
        values = [item.values[number] for item in channels if number < item.count]
        known_values = [value for value in values if value is not None]
        if known_values and max(known_values) - min(known_values) >= MOVED_US:
            result[number + 1] = (min(known_values), max(known_values))
    return result


def judge_moved(stream: Stream, expectation: RcExpectation) -> LinkFinding:
    """Judge a stream with data of the vehicle, disarmed."""
    channels = stream.systems[expectation.system_id].channels
    if not channels:
        return no_channels(stream, expectation)
    if len(channels) < MIN_CHANNEL_SETS:
        message = msg(
            f"the channels of {arg(expectation.name)} came only {arg(len(channels))} times while the sticks moved"
        )
        return LinkFinding(
            Verdict.INCONCLUSIVE, "few-channels", message, "ask its operators to send RC_CHANNELS four times a second"
        )
    moved_ranges = ranges(channels)
    if not moved_ranges:
        message = msg(
            f"none of {arg(expectation.name)}'s {arg(channels[-1].count)} channels moved while the pilot moved the "
            "sticks"
        )
        hint = "check that the transmitter is on, and bound to this vehicle only; then repeat"
        return LinkFinding(Verdict.FAIL, "no-movement", message, hint)
    channel_list = join(", ", map(str, moved_ranges))
    axes = [number for number in moved_ranges if number <= AXES]
    if len(axes) < AXES:
        message = msg(f"channels that moved: {arg(channel_list)}; two sticks have {arg(AXES)} axes")
        return LinkFinding(Verdict.WARN, "few-moved", message, "repeat, and move both sticks over their full range")
    if _as_one(channels, axes):
        message = msg(
            f"channels {arg(join(', ', map(str, axes)))} of {arg(expectation.name)} move identically, which two sticks "
            "in circles do not cause"
        )
        hint = "check for a joystick or a program in place of the remote control; repeat, each stick in circles"
        return LinkFinding(Verdict.INCONCLUSIVE, "lockstep", message, hint)
    return LinkFinding(
        Verdict.PASS, "moved", msg(f"the channels of {arg(expectation.name)} follow the sticks: {arg(channel_list)}")
    )


def _as_one(channels: Sequence[Channels], axes: Sequence[int]) -> bool:
    """Return whether all axes move together with the first, in the same or the opposite direction."""
    rows = [[channel.values[axis - 1] for axis in axes] for channel in channels if channel.count >= max(axes)]
    whole = [values for row in rows if len(values := tuple(item for item in row if item is not None)) == len(axes)]
    ways = [*zip(*whole, strict=True)] if len(whole) >= MIN_CHANNEL_SETS else []
    if not ways or any(len({*way}) == 1 for way in ways):
        return True  # they were never seen to move beside each other
    first, *others = ways
    return all(abs(correlation(first, other)) >= AS_ONE for other in others)


@dataclass(frozen=True, slots=True)
class RcExpectation:
    """Expected remote control stream of one vehicle."""

    name: str
    """Name of the checklist row: `Stork`."""
    place: str
    """Computer that listens: `coastal-gateway`, `this computer`."""
    port: int
    system_id: int = 1
    rssi_low: int | None = None
    address: str | None = None
    """Address that its stream comes from; None: not declared."""

    @property
    def end(self) -> str:
        """Endpoint at which the stream arrives."""
        return msg(f"UDP port {arg(self.port)} of {arg(self.place)}")
