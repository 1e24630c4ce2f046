"""USBL: acoustic positioning. The probe listens for positions, and pings only with a person's consent.

A working USBL sends fixes while somebody pings; no fix proves nothing, so silence is never a failure. Our own ping is
for SeaTrac beacons only, in the water. A beacon reports no source level, but it has a depth gauge: the script sends the
ping only after a response that shows the beacon below the surface. So a consent that was given too early, or for
another vehicle, makes no beacon transmit in air.

docs/engineers/probes.md describes how it could be deceived, and what prevents that.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist import report
from atlantis_netcfg.checklist.probes import base, usbl_fixes
from atlantis_netcfg.checklist.probes.acoustic import seatrac
from atlantis_netcfg.checklist.probes.acoustic.modem import (
    WATER,
    AcousticModem,
    ask_seatrac,
    declared_address,
    modem_of,
    not_understood,
    ping,
    question,
    transcript_or_judgement,
)
from atlantis_netcfg.checklist.probes.acoustic.status import damage
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory.model import AcousticDriver, UsblEndpoint
from atlantis_netcfg.links import LinkFinding

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping


_IDLE = rb"(?i)\$3A3B[0-9A-F]{4}[\r\n]"
_DEPTH_M = 0.3
_BELOW = (
    rb"(?i)\$10[0-9A-F][13579BDF][0-9A-F]{16}"  # flags with the environment, clock
    rb"[0-9A-F]{16}"  # supply, temperature, pressure
    rb"(?:(?:0[3-9A-F]|[1-9A-F][0-9A-F])[0-9A-F]{2}|[0-9A-F]{2}(?!00)[0-9A-F]{2})0000"  # 3 dm and deeper
)
_ANSWERED_S = 10.0
_READY_S = 6.0
"""For each response that allows the ping: a busy laptop delays them in a rehearsal, a busy vehicle always."""
_BUSY, _TIMEOUT = 0x30, 0x34


def ping_consent(name: str, beacon: int) -> base.Consent:
    """Return the consent that a person must give before a ping is transmitted."""
    return base.Consent(
        question=msg(
            f"{arg(name)} and the vehicle with the beacon {arg(beacon)} are in the water, nobody dives near them, "
            "and they may transmit one ping"
        )
    )


@dataclass(frozen=True, slots=True)
class Ping:
    """Check that the other beacon responds to a ping, and that its range is measured."""

    modem: AcousticModem
    name: str
    """Display name of the checklist row."""
    beacon: int
    consent: base.Consent | None
    """Consent that the step asks a person for; without it no ping is sent."""
    local: int | None = None
    """Declared number of the beacon that pings."""
    width_m: float | None = None
    """Width of the site's waters: the geofence from one side to the other."""

    def asks(self) -> tuple[base.Question, ...]:
        """Request transceiver and depth, then send the ping. Raises NeverSaid if no person is prompted."""
        return (self._question(),)

    def _question(self) -> base.Listen:
        end_pattern = rb"(?i)\$(?:42[0-9A-F]{2}%02X[0-9A-F]+|43[0-9A-F]{8}|40(?!00)[0-9A-F]{8})[\r\n]" % self.beacon
        say = (
            ask_seatrac(seatrac.TRANSCEIVER, _IDLE, within_s=_READY_S),
            ask_seatrac(seatrac.STATUS, _BELOW, within_s=_READY_S),
            # Twice: a script cannot work out the checksum of an answer, and a damaged one rarely shows a depth again.
            ask_seatrac(seatrac.STATUS, _BELOW, within_s=_READY_S),
            ping(self.beacon, self.consent, end_pattern, within_s=_ANSWERED_S),
        )
        return self.modem.listen(msg(f"ping from {arg(self.modem.where)}"), say, listen_s=0.0, turn=WATER)

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        """Judge whether the ping was sent, and which beacon responded."""
        transcript = transcript_or_judgement(self.modem, self.name, results[self._question().name])
        if isinstance(transcript, base.ProbeResult):
            return transcript
        answers = seatrac.answers(transcript.data)
        if not answers:
            return base.ProbeResult((damage(self.name, transcript) or not_understood(self.modem, self.name),))
        # The vehicle's own software may ping as well: only what follows our own ping is its answer.
        pings = [
            answer for answer in answers if answer.number == seatrac.PING and answer.record[1:2] == bytes([self.beacon])
        ]
        finding = self._judge_ping(pings[-1], answers, transcript) if pings else self._judge_not_sent(answers)
        return base.ProbeResult((finding,), tuple(_evidence(answers)))

    def _judge_ping(
        self, ping_reply: seatrac.SeatracAnswer, answers: tuple[seatrac.SeatracAnswer, ...], transcript: base.Transcript
    ) -> LinkFinding:
        other = msg(f"the beacon {arg(self.beacon)}")
        response = f"{seatrac.PING_RESPONSE:02X}"
        fixes = (
            entry
            for entry in usbl_fixes.read_fixes(self.modem.driver, transcript)
            if entry.form == response and entry.end > ping_reply.end
        )
        fix = next((item for item in fixes if item.remote == self.beacon), None)
        later = tuple(
            answer for answer in answers if answer.end > ping_reply.end and answer.record[1:2] == bytes([self.beacon])
        )
        error = seatrac.last(later, seatrac.PING_ERROR)
        if fix is not None and error is None and ping_reply.record[:1] == b"\x00":
            wrong = usbl_fixes.impossible(
                msg(f"the beacon of {arg(self.name)}"), fix, self.local, self.width_m, self.modem.driver
            )
            if wrong is not None:
                return wrong
            if fix.range_m is None:
                message = msg(f"{arg(other)} responded to the ping of {arg(self.name)}, but its range was not measured")
                return LinkFinding(
                    Verdict.WARN, "no-range", message, "ping again, and check that both heads are unobstructed"
                )
            far = msg(f"{arg(fix.range_m):.1f} m away")
            return LinkFinding(
                Verdict.PASS, "answered", msg(f"{arg(other)} responded to the ping of {arg(self.name)}, {arg(far)}")
            )
        if error is not None and error[:1] == bytes([_TIMEOUT]):
            hint = "check that both beacons are in the water and within range, and the number of the other one"
            return LinkFinding(
                Verdict.FAIL, "no-answer", msg(f"{arg(other)} did not respond to the ping of {arg(self.name)}"), hint
            )
        status = (error or ping_reply.record)[:1]
        if status not in {b"", b"\x00"}:
            why = msg("it is busy" if status[0] == _BUSY else f"its status is 0x{arg(status[0]):02X}")
            message = msg(f"the beacon of {arg(self.name)} did not execute the ping: {arg(why)}")
            return LinkFinding(
                Verdict.INCONCLUSIVE, "not-sent", message, "check again when the vehicle is not using it"
            )
        message = msg(f"the beacon of {arg(self.name)} sent a ping but did not report the result")
        return LinkFinding(Verdict.INCONCLUSIVE, "no-report", message, "check again")

    def _judge_not_sent(self, answers: tuple[seatrac.SeatracAnswer, ...]) -> LinkFinding:
        record = seatrac.last(answers, seatrac.STATUS)
        if record is None:
            message = msg(f"no ping was sent: the transceiver of {arg(self.name)} is not idle")
            return LinkFinding(
                Verdict.INCONCLUSIVE, "not-sent", message, "check again when the vehicle is not using it"
            )
        status = seatrac.status(record)
        if status is None or status.depth_m is None:
            message = msg(f"no ping was sent: the beacon of {arg(self.name)} does not report its depth")
            hint = "ask its crew to add environment data to the status output; without a depth nothing is sent"
            return LinkFinding(Verdict.INCONCLUSIVE, "depth-unknown", message, hint)
        if status.depth_m >= _DEPTH_M:
            # The transcript does not show what was sent: a depth that came too late sends no ping.
            message = msg(f"the beacon of {arg(self.name)} responded too late to be pinged, or not to the ping command")
            return LinkFinding(Verdict.INCONCLUSIVE, "no-report", message, "check again")
        message = msg(
            f"no ping was sent: the beacon of {arg(self.name)} measures a depth of {arg(status.depth_m):.1f} m, as if "
            "in air"
        )
        hint = msg(f"put the vehicle into the water: the ping needs a depth of {arg(_DEPTH_M)} m")
        return LinkFinding(Verdict.INCONCLUSIVE, "in-air", message, hint)


def _evidence(answers: tuple[seatrac.SeatracAnswer, ...]) -> Iterator[report.Evidence]:
    status = seatrac.status(seatrac.last(answers, seatrac.STATUS) or b"")
    if status is not None and status.depth_m is not None:
        yield report.Evidence(
            type=report.EvidenceType.READ, what="depth before the ping", value=f"{status.depth_m:.1f} m"
        )
    for answer in answers:
        fix = seatrac.fix(answer.record) if answer.number == seatrac.PING_RESPONSE else None
        if fix is not None and fix.range_m is not None:
            yield report.Evidence(
                type=report.EvidenceType.MEASURED,
                what=msg(f"range to the beacon {arg(fix.beacon)}"),
                value=f"{fix.range_m} m",
            )


def steps(cell: base.Cell) -> tuple[base.Step, ...]:
    """Return the step on reported fixes, and a ping if the inventory has a beacon for it."""
    modem, endpoint = modem_of(cell), cell.endpoints.usbl
    if modem is None or endpoint is None:
        return (_manual_step(cell),)
    passive = base.Step(
        name="",
        title=msg(f"The USBL of {arg(cell.name)} reports current fixes"),
        kind=report.ItemKind.AUTOMATIC,
        phase=report.Phase.WATER,
        probe=usbl_fixes.Fixes(
            modem,
            cell.name,
            endpoint.hears,
            endpoint.max_age_s,
            question(cell, modem),
            declared_address(cell, modem),
            _geofence_width_m(cell),
        ),
    )
    return (passive, *_ping(cell, modem, endpoint))


def _geofence_width_m(cell: base.Cell) -> float | None:
    fence = cell.site_config.checklist.geofence
    return None if fence is None else 2 * fence.radius_m


def _ping(cell: base.Cell, modem: AcousticModem, endpoint: UsblEndpoint) -> Iterator[base.Step]:
    if endpoint.ping is None:
        return
    if modem.driver is not AcousticDriver.SEATRAC:
        yield _pinged_by_a_person(cell, endpoint.ping)
        return
    consent = ping_consent(cell.name, endpoint.ping)
    yield base.Step(
        name="ping",
        title=msg(f"The beacon {arg(endpoint.ping)} responds to a ping from {arg(cell.name)}"),
        kind=report.ItemKind.ACTIVE,
        phase=report.Phase.WATER,
        probe=Ping(modem, cell.name, endpoint.ping, consent, declared_address(cell, modem), _geofence_width_m(cell)),
        consent=consent,
    )


def _pinged_by_a_person(cell: base.Cell, beacon: int) -> base.Step:
    """Return a step for a person: a modem other than SeaTrac measures ranges with messages, not pings."""
    return base.Step(
        name="ping",
        title=msg(f"The modem with the address {arg(beacon)} responds to {arg(cell.name)}"),
        kind=report.ItemKind.PERSON,
        phase=report.Phase.WATER,
        do=msg(
            f"With both in the water, make the software of {arg(cell.name)} locate the modem with the address "
            f"{arg(beacon)}."
        ),
        look_for="A position arrives, and its range roughly matches the chart.",
    )


def _manual_step(cell: base.Cell) -> base.Step:
    is_declared = cell.endpoints.usbl is not None
    why = "it has no address at this site" if is_declared else "it is not in the inventory"
    return base.Step(
        name="",
        title=msg(f"The USBL of {arg(cell.name)} reports its position"),
        kind=report.ItemKind.PERSON,
        phase=report.Phase.WATER,
        do=msg(
            f"The program cannot listen to the USBL of {arg(cell.name)}: {arg(why)}. With both transducers in the "
            "water, and never in air, have the vehicle located from its base, some metres away and in a known "
            "direction."
        ),
        look_for=(
            "A new position arrives every few seconds, in the right direction, with a range that roughly "
            "matches what you see; it follows the vehicle's movement."
        ),
    )
