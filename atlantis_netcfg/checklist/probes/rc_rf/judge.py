"""Whether the remote control reaches the autopilot, as far as the stream tells."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.checklist.probes.rc_rf.stream import RSSI_UNKNOWN
from atlantis_netcfg.core.verdicts import Verdict

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.checklist.probes.rc_rf.stream import Channels, Heard, System
    from atlantis_netcfg.checklist.probes.rc_rf.wanted import Wanted

__all__ = ["FRESH_S", "HIGH_US", "LOW_US", "judge", "no_channels", "odd"]

FRESH_S = 3.0
"""Heartbeats come once a second, channels at least so."""
LOW_US, HIGH_US = 900, 2100
UNSTEADY = 0.25
"""RSSI that swings by more than this share of its highest value; the scale is the vehicle's own."""
BAD_SHARE = 0.05


def judge(received: Heard, expected: Wanted) -> tuple[Finding, ...]:
    """Judge a stream in which the vehicle is heard; one that is well in every respect has one finding, which passes."""
    system = received.systems[expected.system_id]
    found = (
        *_alive(received, system, expected),
        *_receiver(system, expected),
        *_rssi(system, expected),
        *_damaged(received, expected),
    )
    return found or (_well(system, expected),)


def _alive(received: Heard, system: System, expected: Wanted) -> Iterator[Finding]:
    age_s = received.ended_s - system.beats[-1].at_s
    if age_s > FRESH_S:
        message = f"{expected.name}'s last heartbeat is {age_s:.0f} s old"
        yield Finding(
            Verdict.FAIL, "heartbeat-lost", message, "look at the autopilot's power and the forwarding of its stream"
        )
    if not system.channels:
        yield no_channels(received, expected)
        return
    last = system.channels[-1]
    channels_age_s = received.ended_s - last.at_s
    if channels_age_s > max(FRESH_S, age_s):
        message = f"{expected.name}'s channels have stopped {channels_age_s:.0f} s ago, its heartbeats go on"
        yield Finding(
            Verdict.FAIL,
            "channels-stale",
            message,
            "look at the remote control's receiver and its cable to the autopilot",
        )
    if not last.count or all(value is None for value in last.values):
        message = f"{expected.name}'s autopilot sees no channel of the remote control"
        yield Finding(
            Verdict.FAIL,
            "no-receiver",
            message,
            "switch the transmitter on, then look at the receiver's cable and binding",
        )
    elif strange := odd(last):
        message = f"{expected.name}'s channels are outside {LOW_US} to {HIGH_US} us: {strange}"
        yield Finding(
            Verdict.FAIL,
            "channels-odd",
            message,
            "calibrate the remote control, and look at the receiver's failsafe values",
        )


def no_channels(received: Heard, expected: Wanted) -> Finding:
    """Say that no RC_CHANNELS came: that is a setting as well, so nothing follows."""
    message = f"{expected.name} sends no RC_CHANNELS within {received.ended_s:.0f} s"
    hint = (
        "let its people add RC_CHANNELS to the stream (ArduPilot: SRx_RC_CHAN; PX4: mavlink stream); we ask for nothing"
    )
    return Finding(Verdict.INCONCLUSIVE, "no-channels", message, hint)


def odd(channels: Channels) -> str:
    """The channels whose values are out of range, in words; empty: none."""
    strange = [
        f"channel {number}: {value}"
        for number, value in enumerate(channels.values, 1)
        if value is not None and not LOW_US <= value <= HIGH_US
    ]
    return ", ".join(strange)


def _receiver(system: System, expected: Wanted) -> Iterator[Finding]:
    if not system.receiver:
        message = f"{expected.name} sends no SYS_STATUS: its autopilot's own opinion of the receiver is not known"
        yield Finding(Verdict.WARN, "no-sys-status", message, "let its people add SYS_STATUS to the stream")
        return
    last = system.receiver[-1]
    if not last.present:
        message = f"{expected.name}'s autopilot has no receiver of a remote control"
        yield Finding(
            Verdict.FAIL, "receiver-absent", message, "look at the receiver's cable and the autopilot's RC protocol"
        )
    elif not last.enabled:
        message = f"{expected.name}'s autopilot has the remote control switched off"
        yield Finding(
            Verdict.FAIL, "receiver-disabled", message, "let its people enable the remote control in the autopilot"
        )
    elif not last.healthy:
        message = f"{expected.name}'s autopilot says that the remote control's receiver is not healthy"
        yield Finding(
            Verdict.FAIL, "receiver-unhealthy", message, "switch the transmitter on, and look at the receiver's antenna"
        )


def _rssi(system: System, expected: Wanted) -> Iterator[Finding]:
    result = [channel.rssi for channel in system.channels if channel.count]
    known = [rssi for rssi in result if rssi != RSSI_UNKNOWN]
    if result and not known:
        message = f"{expected.name} does not tell how strong the remote control is heard (rssi 255)"
        yield Finding(Verdict.WARN, "rssi-unknown", message, "rely on the range test by a person")
    if not known:
        return
    if expected.rssi_low is not None and min(known) < expected.rssi_low:
        message = (
            f"the remote control of {expected.name} is heard with rssi {min(known)}, below its own {expected.rssi_low}"
        )
        yield Finding(
            Verdict.WARN, "rssi-low", message, "look at both antennas; the value is compared with this vehicle's only"
        )
    if max(known) - min(known) > UNSTEADY * max(known):
        message = f"the remote control of {expected.name} is heard unsteadily: rssi {min(known)} to {max(known)}"
        yield Finding(
            Verdict.WARN, "rssi-unsteady", message, "look at both antennas, and for other transmitters of the band"
        )
    elif not max(known):
        message = f"{expected.name} tells rssi 0: no signal, or nobody has set up how it is measured"
        yield Finding(
            Verdict.WARN, "rssi-zero", message, "rely on the range test by a person, or set up RSSI in the autopilot"
        )


def _damaged(received: Heard, expected: Wanted) -> Iterator[Finding]:
    total = received.good + received.bad
    if received.bad > 1 and received.bad > BAD_SHARE * total:
        message = f"{received.bad} of {total} pieces of the stream at {expected.end} are damaged"
        yield Finding(
            Verdict.WARN, "damaged", message, "look at the telemetry radio or serial line that carries the stream"
        )


def _well(system: System, expected: Wanted) -> Finding:
    last = system.channels[-1]
    message = f"{expected.name} is disarmed and hears its remote control: {last.count} channels, rssi {last.rssi}"
    return Finding(Verdict.PASS, "rc-heard", message)
