"""Acoustic column of EvoLogics modems and SeaTrac beacons: their reported state, read and never changed.

Also the limits and texts by which both are judged.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes import base
from atlantis_netcfg.checklist.probes.acoustic import evologics, seatrac
from atlantis_netcfg.checklist.probes.acoustic.modem import (
    AcousticModem,
    not_understood,
    transcript_or_judgement,
    two_modems,
    whose_unknown,
)
from atlantis_netcfg.checklist.report import Evidence, EvidenceType
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.links import LinkFinding

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping


SOUND_SPEED_MPS = (1300, 1700)
"""Sound speeds of water that an EvoLogics modem accepts (BIR)."""
RSSI_DB = (-85, -20)
"""Usable range of an EvoLogics modem: weaker is lost, stronger overdrives it (BIR)."""
INTEGRITY_LOW = 100
"""Integrity below this is weak reception (BIR)."""
LEVELS = {0: "maximum", 1: "-6 dB", 2: "-12 dB", 3: "-20 dB"}
"""Source level of an EvoLogics modem."""
AIR_LEVEL = 3
"""The only source level for a modem in air: louder ones damage the transducer."""

_OFF = "switch the modem off and on, or ask its crew to make it listen: this program never does"
STATES: dict[str, tuple[Verdict, str, str, str | None]] = {
    "INITIATION LISTEN": (Verdict.PASS, "listens", "listens", None),
    "INITIATION ESTABLISH": (
        Verdict.WARN,
        "connecting",
        "is setting up a connection",
        "wait a minute, then check again",
    ),
    "INITIATION DISCONNECT": (Verdict.WARN, "connecting", "is ending a connection", "wait a minute, then check again"),
    "ONLINE": (
        Verdict.WARN,
        "connected",
        "has an open acoustic connection",
        "let the vehicle end it, then check again",
    ),
    "BACKOFF": (Verdict.WARN, "backing-off", "waits after a collision with another modem", "check again in a minute"),
    "OFFLINE READY": (Verdict.FAIL, "offline", "has its acoustic side switched off (OFFLINE READY)", _OFF),
    "OFFLINE CONNECTION FAILED": (Verdict.FAIL, "offline", "has lost a connection and does not listen", _OFF),
    "OFFLINE TERMINATED": (Verdict.FAIL, "offline", "was stopped and does not listen", _OFF),
    "OFFLINE ALARM": (
        Verdict.FAIL,
        "alarm",
        "has an internal error (OFFLINE ALARM)",
        "switch the modem off and on; if the alarm returns, contact its manufacturer",
    ),
    "NOISE": (
        Verdict.FAIL,
        "noise",
        "cannot connect: there is too much noise around it (NOISE)",
        "check for a running pump, thruster or echo sounder nearby, and whether the transducer is in the water",
    ),
    "DEAF": (
        Verdict.FAIL,
        "deaf",
        "cannot receive (DEAF)",
        "check the transducer and its cable; in air a modem may be deaf: check again in the water",
    ),
}
"""State of an EvoLogics modem -> verdict, code, sentence, hint."""


def level_words(level: int) -> str:
    """Format a source level: `1 (-6 dB)`."""
    return msg(f"{arg(level)} ({arg(LEVELS[level])})" if level in LEVELS else f"{arg(level)} (unknown)")


def plain(value: float) -> str:
    """Format a number without trailing zeros."""
    return f"{value:.2f}".rstrip("0").rstrip(".")


_READINGS = (
    ("firmware", "ATI0", ""),
    ("state", "AT?S", ""),
    ("signal of the last reception", "AT?E", " dB"),
    ("integrity of the last reception", "AT?I", ""),
    ("propagation time of the last reception", "AT?T", " us"),
    ("battery", "AT?BV", " V"),
)
"""Evidence: name, query, unit."""


@dataclass(frozen=True, slots=True)
class AcousticReading:
    """All data reported by a modem; None: not reported."""

    replies: tuple[evologics.Piece, ...]
    settings: evologics.EvologicsSettings | None

    @classmethod
    def of(cls, transcript: base.Transcript) -> AcousticReading:
        """Read a transcript."""
        replies = evologics.pieces(transcript.data)
        return cls(replies, evologics.settings(replies))

    @property
    def is_evologics(self) -> bool:
        """Whether any of the data come from an EvoLogics modem."""
        has_frame = any(piece.command for piece in self.replies)
        return has_frame or self.settings is not None or evologics.state(self.replies) is not None

    @property
    def address(self) -> int | None:
        """Local address of the modem."""
        return self.setting("Local Address", "AT?AL")

    @property
    def addresses(self) -> frozenset[int]:
        """All reported addresses in force; more than one means that two modems share an endpoint."""
        if self.settings is not None and "Local Address" in self.settings.pending:
            return frozenset()
        setting_replies = [evologics.settings((piece,)) for piece in self.replies if piece.command == "AT&V"]
        queried_addresses = [evologics.number(piece.text) for piece in self.replies if piece.command == "AT?AL"]
        local = [settings.values.get("Local Address") for settings in setting_replies if settings is not None]
        return frozenset(int(item) for item in (*local, *queried_addresses, self.address) if item is not None)

    @property
    def level(self) -> int | None:
        """Source level of the modem."""
        return self.setting("Source Level", "AT?L")

    def setting(self, name: str, query: str | None = None) -> int | None:
        """Return a setting from the listing, otherwise from its own query."""
        if self.settings is not None and name in self.settings.values:
            return self.settings.values[name]
        result = self.number(query) if query else None
        return int(result) if result is not None else None

    def number(self, query: str) -> float | None:
        """Return the number in the response to a query."""
        return evologics.number(evologics.answer(self.replies, query))


@dataclass(frozen=True, slots=True)
class EvologicsStatus:
    """Check that the modem listens, with the expected address, source level and sound speed."""

    modem: AcousticModem
    name: str
    """Display name of the checklist row."""
    expected_address: int | None
    """Acoustic address."""
    question: base.Listen

    def asks(self) -> tuple[base.Question, ...]:
        """Return one script of read-only queries."""
        return (self.question,)

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        """Judge the data reported by the modem."""
        transcript = transcript_or_judgement(self.modem, self.name, results[self.question.name])
        if isinstance(transcript, base.ProbeResult):
            return transcript
        reading = AcousticReading.of(transcript)
        if not reading.is_evologics:
            return base.ProbeResult((not_understood(self.modem, self.name),))
        return base.ProbeResult(tuple(self._findings(reading)), tuple(_evidence(reading)))

    def _findings(self, reading: AcousticReading) -> Iterator[LinkFinding]:
        yield self._state(reading)
        yield from self._address(reading)
        yield from self._level(reading)
        yield from self._sound(reading)
        yield from self._reception(reading)
        yield from self._pending(reading)

    def _state(self, reading: AcousticReading) -> LinkFinding:
        state = evologics.state(reading.replies)
        if state is None:
            words = evologics.trouble_words(reading.replies, "AT?S")
            message = msg(
                f"the modem of {arg(self.name)} does not report its state"
                + (f": it says `{arg(words)}`" if words else "")
            )
            hint = "check again in a minute; if nothing changes, compare the firmware with another modem's"
            return LinkFinding(Verdict.INCONCLUSIVE, "no-state", message, hint)
        if state not in STATES:
            message = msg(f"the modem of {arg(self.name)} is in an unknown state: `{arg(state)}`")
            return LinkFinding(
                Verdict.INCONCLUSIVE, "state-unknown", message, "ask its manufacturer what that state means"
            )
        verdict, code, sentence, advice = STATES[state]
        return LinkFinding(verdict, code, msg(f"the modem of {arg(self.name)} {arg(sentence)}"), advice)

    def _address(self, reading: AcousticReading) -> Iterator[LinkFinding]:
        address, highest = reading.address, reading.setting("Highest Address")
        if self.expected_address is None:
            yield whose_unknown(self.modem, self.name)
        if address is None:
            if self.expected_address is not None:
                message = msg(
                    f"the modem of {arg(self.name)} does not report its address; the inventory says "
                    f"{arg(self.expected_address)}"
                )
                hint = "check again: a late response is not counted"
                yield LinkFinding(Verdict.INCONCLUSIVE, "address-unknown", message, hint)
            return
        if len(reading.addresses) > 1:
            yield two_modems(self.modem, self.name, reading.addresses)
        if self.expected_address is not None and address != self.expected_address:
            message = msg(
                f"the modem of {arg(self.name)} has the acoustic address {arg(address)}; the inventory says "
                f"{arg(self.expected_address)}"
            )
            hint = "ask its crew to set the address, or correct `acoustic_address` in the inventory"
            yield LinkFinding(Verdict.FAIL, "wrong-address", message, hint)
        if address < 1 or (highest is not None and address > highest):
            message = msg(
                f"the acoustic address {arg(address)} of {arg(self.name)} is not between 1 and its highest address, "
                f"{arg(highest or '?')}"
            )
            hint = "ask its crew to set an address within the range; the highest address must be the same on all modems"
            yield LinkFinding(Verdict.FAIL, "address-out-of-range", message, hint)

    def _level(self, reading: AcousticReading) -> Iterator[LinkFinding]:
        level = reading.level
        if level is None:
            message = msg(f"the modem of {arg(self.name)} does not report its source level")
            yield LinkFinding(
                Verdict.WARN, "level-unknown", message, "keep it from transmitting until it is in the water"
            )
        elif level != AIR_LEVEL:
            message = msg(
                f"the source level of {arg(self.name)} is {arg(level_words(level))}; only {arg(AIR_LEVEL)} is allowed "
                "in air"
            )
            hint = msg(
                f"keep it from transmitting until it is in the water, or ask its crew to set level {arg(AIR_LEVEL)}"
            )
            yield LinkFinding(Verdict.WARN, "loud-for-air", message, hint)

    def _sound(self, reading: AcousticReading) -> Iterator[LinkFinding]:
        speed = reading.setting("Sound Speed")
        low, high = SOUND_SPEED_MPS
        if speed is not None and not low <= speed <= high:
            message = msg(
                f"the modem of {arg(self.name)} uses a sound speed of {arg(speed)} m/s, which is impossible in water"
            )
            hint = msg(
                f"ask its crew to set the local sound speed, between {arg(low)} and {arg(high)} m/s: all ranges depend "
                "on it"
            )
            yield LinkFinding(Verdict.FAIL, "sound-speed", message, hint)

    def _reception(self, reading: AcousticReading) -> Iterator[LinkFinding]:
        rssi, integrity = reading.number("AT?E"), reading.number("AT?I")
        if rssi and not RSSI_DB[0] <= rssi <= RSSI_DB[1]:
            weak = rssi < RSSI_DB[0]
            message = msg(
                f"the last reception of {arg(self.name)} was too {'weak' if weak else 'strong'}: {arg(plain(rssi))} dB"
            )
            hint = "check the transducers and what is between them" if weak else "move the modems apart"
            yield LinkFinding(Verdict.WARN, "signal-weak" if weak else "signal-strong", message, hint)
        if integrity and integrity < INTEGRITY_LOW:
            message = msg(
                f"the last reception of {arg(self.name)} was poor: integrity {arg(plain(integrity))}, good is "
                f"{arg(INTEGRITY_LOW)}"
            )
            hint = "check for echoes (walls, the hull, the surface) and noise, then check again"
            yield LinkFinding(Verdict.WARN, "integrity-low", message, hint)

    def _pending(self, reading: AcousticReading) -> Iterator[LinkFinding]:
        if reading.settings is not None and reading.settings.pending:
            names = join(", ", reading.settings.pending)
            message = msg(f"the modem of {arg(self.name)} has changes that are not active yet: {arg(names)}")
            yield LinkFinding(Verdict.WARN, "pending", message, "ask its crew to apply or discard them")


def _evidence(reading: AcousticReading) -> Iterator[Evidence]:
    for what, query, unit in _READINGS:
        value = evologics.answer(reading.replies, query)
        if value:
            yield Evidence(type=EvidenceType.READ, what=what, value=value[:120] + unit)
    if reading.settings is not None:
        for name, setting in reading.settings.values.items():
            yield Evidence(type=EvidenceType.READ, what=name, value=str(setting))


BEACONS = range(1, 16)
_IDLE = 0x3B
_WORKING = {0x30: "is busy", 0x3C: "transmits", 0x3D: "waits for a response", 0x3E: "receives", 0x3F: "answers"}
"""States of the transceiver in which it is in use."""
_STOP_STATE = 0x3A


@dataclass(frozen=True, slots=True)
class Beacon:
    """All data reported by a beacon; None: not reported."""

    replies: tuple[seatrac.SeatracAnswer, ...]
    settings: seatrac.SeatracSettings | None
    status: seatrac.BeaconStatus | None
    info: str | None
    state: int | None
    """State of its transceiver."""
    numbers: frozenset[int]
    """All reported beacon numbers; more than one means two beacons at one endpoint."""

    @classmethod
    def of(cls, transcript: base.Transcript) -> Beacon:
        """Read a transcript."""
        replies = seatrac.answers(transcript.data)
        state = seatrac.last(replies, seatrac.TRANSCEIVER)
        result = (seatrac.settings(answer.record) for answer in replies if answer.number == seatrac.SETTINGS)
        return cls(
            replies,
            seatrac.settings(seatrac.last(replies, seatrac.SETTINGS) or b""),
            seatrac.status(seatrac.last(replies, seatrac.STATUS) or b""),
            seatrac.info(seatrac.last(replies, seatrac.INFO) or b""),
            state[0] if state else None,
            frozenset(settings.beacon for settings in result if settings is not None),
        )


def damage(name: str, transcript: base.Transcript) -> LinkFinding | None:
    """Return a finding if responses had a wrong checksum; otherwise None."""
    damage_count = seatrac.count_damaged(transcript.data)
    if not damage_count:
        return None
    whole = len(seatrac.answers(transcript.data))
    message = msg(
        f"{arg(damage_count)} of {arg(damage_count + whole)} responses of the beacon of {arg(name)} had a wrong "
        "checksum"
    )
    hint = "check the serial cable and its rate (`baud`), and whether two programs write to the port"
    return LinkFinding(Verdict.WARN if whole else Verdict.INCONCLUSIVE, "checksum", message, hint)


@dataclass(frozen=True, slots=True)
class SeatracStatus:
    """Check that the beacon works and is idle, with the expected number and sound speed."""

    modem: AcousticModem
    name: str
    """Display name of the checklist row."""
    expected_address: int | None
    """Beacon id."""
    question: base.Listen

    def asks(self) -> tuple[base.Question, ...]:
        """Return one script of read-only commands."""
        return (self.question,)

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        """Judge the data reported by the beacon."""
        transcript = transcript_or_judgement(self.modem, self.name, results[self.question.name])
        if isinstance(transcript, base.ProbeResult):
            return transcript
        damage_finding = damage(self.name, transcript)
        beacon = Beacon.of(transcript)
        if not beacon.replies:
            return base.ProbeResult((damage_finding or not_understood(self.modem, self.name),))
        findings = (self._state(beacon), *self._number(beacon), *self._sound(beacon))
        return base.ProbeResult(
            (*findings, damage_finding) if damage_finding else findings, tuple(_beacon_evidence(beacon))
        )

    def _state(self, beacon: Beacon) -> LinkFinding:
        who, state = msg(f"the beacon of {arg(self.name)}"), beacon.state
        if state is None:
            hint = "check again in a minute; a busy beacon responds late"
            return LinkFinding(
                Verdict.INCONCLUSIVE, "no-state", msg(f"{arg(who)} does not report the state of its transceiver"), hint
            )
        if state == _IDLE:
            return LinkFinding(Verdict.PASS, "listens", msg(f"{arg(who)} listens"))
        if state == _STOP_STATE:
            hint = "switch the beacon off and on: this program never starts it"
            return LinkFinding(Verdict.FAIL, "stopped", msg(f"the transceiver of {arg(who)} is stopped"), hint)
        if state in _WORKING:
            hint = "check again when the vehicle is not using it"
            return LinkFinding(Verdict.WARN, "working", msg(f"{arg(who)} {arg(_WORKING[state])} at the moment"), hint)
        message = msg(f"{arg(who)} is in an unknown state: 0x{arg(state):02X}")
        return LinkFinding(Verdict.INCONCLUSIVE, "state-unknown", message, "ask its manufacturer what that state means")

    def _number(self, beacon: Beacon) -> Iterator[LinkFinding]:
        if self.expected_address is None:
            yield whose_unknown(self.modem, self.name)
        if beacon.settings is None:
            hint = "check again; a settings record shorter than expected is not read"
            yield LinkFinding(
                Verdict.INCONCLUSIVE,
                "settings-unknown",
                msg(f"the beacon of {arg(self.name)} does not report its settings"),
                hint,
            )
            return
        if len(beacon.numbers) > 1:
            yield two_modems(self.modem, self.name, beacon.numbers)
        number = beacon.settings.beacon
        if self.expected_address is not None and number != self.expected_address:
            message = msg(
                f"the beacon of {arg(self.name)} has the number {arg(number)}; the inventory says "
                f"{arg(self.expected_address)}"
            )
            hint = "ask its crew to set the number, or correct `acoustic_address` in the inventory"
            yield LinkFinding(Verdict.FAIL, "wrong-address", message, hint)
        if number not in BEACONS:
            message = msg(f"the beacon of {arg(self.name)} has the number {arg(number)}; valid numbers are 1 to 15")
            yield LinkFinding(
                Verdict.FAIL, "address-out-of-range", message, "ask its crew to set a number that no other beacon has"
            )

    def _sound(self, beacon: Beacon) -> Iterator[LinkFinding]:
        speed = beacon.status.sound_speed_mps if beacon.status else None
        if speed is None and beacon.settings is not None and not beacon.settings.auto_sound_speed:
            speed = beacon.settings.sound_speed_mps
        low, high = SOUND_SPEED_MPS
        if speed is not None and not low <= speed <= high:
            who = msg(f"the beacon of {arg(self.name)}")
            message = msg(f"{arg(who)} uses a sound speed of {arg(plain(speed))} m/s, which is impossible in water")
            hint = "ask its crew to let the beacon compute it, or to set the local one: all ranges depend on it"
            yield LinkFinding(Verdict.FAIL, "sound-speed", message, hint)


def _beacon_evidence(beacon: Beacon) -> Iterator[Evidence]:
    for what, value in _beacon_values(beacon):
        if value is not None:
            yield Evidence(type=EvidenceType.READ, what=what, value=value)


def _beacon_values(beacon: Beacon) -> Iterator[tuple[str, str | None]]:
    yield "beacon", beacon.info
    if beacon.state is not None:
        yield "transceiver", f"0x{beacon.state:02X}"
    if beacon.settings is not None:
        yield "number", str(beacon.settings.beacon)
        yield "configured sound speed", f"{plain(beacon.settings.sound_speed_mps)} m/s"
    if beacon.status is not None:
        yield "supply", _with_unit(beacon.status.supply_v, "V")
        yield "depth", _with_unit(beacon.status.depth_m, "m")
        yield "sound speed in use", _with_unit(beacon.status.sound_speed_mps, "m/s")


def _with_unit(value: float | None, unit: str) -> str | None:
    return None if value is None else f"{plain(value)} {unit}"
