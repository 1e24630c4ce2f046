"""The acoustic column of an EvoLogics modem: what it says of itself, read and never changed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.checklist.probes.acoustic import evologics
from atlantis_netcfg.checklist.probes.acoustic.bands import (
    AIR_LEVEL,
    INTEGRITY_LOW,
    RSSI_DB,
    SOUND_SPEED_MPS,
    STATES,
    level_words,
    plain,
)
from atlantis_netcfg.checklist.probes.acoustic.errors import not_understood, said, two_modems, whose_unknown
from atlantis_netcfg.checklist.probes.step import Judged
from atlantis_netcfg.checklist.report import Evidence, EvidenceType
from atlantis_netcfg.core.verdicts import Verdict

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from atlantis_netcfg.checklist.probes.acoustic.modem import Modem
    from atlantis_netcfg.checklist.probes.requests import Listen, Question
    from atlantis_netcfg.checklist.probes.results import Answer, Transcript

__all__ = ["EvologicsStatus", "Reading"]

_READINGS = (
    ("firmware", "ATI0", ""),
    ("state", "AT?S", ""),
    ("signal of the last reception", "AT?E", " dB"),
    ("integrity of the last reception", "AT?I", ""),
    ("propagation time of the last reception", "AT?T", " us"),
    ("battery", "AT?BV", " V"),
)
"""Evidence: what, query, unit."""


@dataclass(frozen=True, slots=True)
class Reading:
    """Everything that a modem told, in one value; None: not told."""

    heard: tuple[evologics.Piece, ...]
    settings: evologics.Settings | None

    @classmethod
    def of(cls, transcript: Transcript) -> Reading:
        """Read a transcript."""
        received = evologics.pieces(transcript.data)
        return cls(received, evologics.settings(received))

    @property
    def understood(self) -> bool:
        """Whether anything of it is an EvoLogics modem's."""
        framed = any(piece.command for piece in self.heard)
        return framed or self.settings is not None or evologics.state(self.heard) is not None

    @property
    def address(self) -> int | None:
        """Local Address."""
        return self.setting("Local Address", "AT?AL")

    @property
    def addresses(self) -> frozenset[int]:
        """Every one that was told and is in force: more than one is two modems at one end."""
        if self.settings is not None and "Local Address" in self.settings.pending:
            return frozenset()
        listed = [evologics.settings((piece,)) for piece in self.heard if piece.command == "AT&V"]
        queried = [evologics.number(piece.text) for piece in self.heard if piece.command == "AT?AL"]
        local = [settings.values.get("Local Address") for settings in listed if settings is not None]
        return frozenset(int(item) for item in (*local, *queried, self.address) if item is not None)

    @property
    def level(self) -> int | None:
        """Source Level."""
        return self.setting("Source Level", "AT?L")

    def setting(self, name: str, query: str | None = None) -> int | None:
        """A setting of the listing, else of its own query."""
        if self.settings is not None and name in self.settings.values:
            return self.settings.values[name]
        result = self.number(query) if query else None
        return int(result) if result is not None else None

    def number(self, query: str) -> float | None:
        """The number that a query was answered with."""
        return evologics.number(evologics.answer(self.heard, query))


@dataclass(frozen=True, slots=True)
class EvologicsStatus:
    """The modem listens, with the address, level and sound speed that it should have."""

    modem: Modem
    name: str
    """The row in words."""
    declared: int | None
    """Acoustic address."""
    question: Listen

    def asks(self) -> tuple[Question, ...]:
        """One script of reading queries."""
        return (self.question,)

    def judge(self, results: Mapping[str, Answer]) -> Judged:
        """Judge what the modem told."""
        transcript = said(self.modem, self.name, results[self.question.name])
        if isinstance(transcript, Judged):
            return transcript
        reading = Reading.of(transcript)
        if not reading.understood:
            return Judged((not_understood(self.modem, self.name),))
        return Judged(tuple(self._findings(reading)), tuple(_evidence(reading)))

    def _findings(self, reading: Reading) -> Iterator[Finding]:
        yield self._state(reading)
        yield from self._address(reading)
        yield from self._level(reading)
        yield from self._sound(reading)
        yield from self._reception(reading)
        yield from self._pending(reading)

    def _state(self, reading: Reading) -> Finding:
        state = evologics.state(reading.heard)
        if state is None:
            words = evologics.trouble_words(reading.heard, "AT?S")
            message = f"the modem of {self.name} does not tell its state" + (f": it says `{words}`" if words else "")
            hint = "check again in a minute; if it stays so, compare the firmware with another modem's"
            return Finding(Verdict.INCONCLUSIVE, "no-state", message, hint)
        if state not in STATES:
            message = f"the modem of {self.name} is in a state that nobody here knows: `{state}`"
            return Finding(Verdict.INCONCLUSIVE, "state-unknown", message, "ask its maker what that state means")
        verdict, code, sentence, advice = STATES[state]
        return Finding(verdict, code, f"the modem of {self.name} {sentence}", advice)

    def _address(self, reading: Reading) -> Iterator[Finding]:
        address, highest = reading.address, reading.setting("Highest Address")
        if self.declared is None:
            yield whose_unknown(self.modem, self.name)
        if address is None:
            if self.declared is not None:
                message = f"the modem of {self.name} does not tell its address; {self.declared} is declared"
                hint = "check again: what does not answer in time is left out"
                yield Finding(Verdict.INCONCLUSIVE, "address-unknown", message, hint)
            return
        if len(reading.addresses) > 1:
            yield two_modems(self.modem, self.name, reading.addresses)
        if self.declared is not None and address != self.declared:
            message = f"the modem of {self.name} has the acoustic address {address}, and {self.declared} is declared"
            hint = "have its crew set the address, or correct `acoustic_address` in the declaration"
            yield Finding(Verdict.FAIL, "wrong-address", message, hint)
        if address < 1 or (highest is not None and address > highest):
            message = (
                f"the acoustic address {address} of {self.name} is not between 1 and its highest one, {highest or '?'}"
            )
            hint = "have its crew set an address within the range, the same highest address on all modems"
            yield Finding(Verdict.FAIL, "address-out-of-range", message, hint)

    def _level(self, reading: Reading) -> Iterator[Finding]:
        level = reading.level
        if level is None:
            message = f"the modem of {self.name} does not tell its source level"
            yield Finding(Verdict.WARN, "level-unknown", message, "keep it from transmitting until it is in the water")
        elif level != AIR_LEVEL:
            message = f"the source level of {self.name} is {level_words(level)}; only {AIR_LEVEL} may sound in air"
            hint = f"keep it from transmitting until it is in the water, or have its crew set level {AIR_LEVEL}"
            yield Finding(Verdict.WARN, "loud-for-air", message, hint)

    def _sound(self, reading: Reading) -> Iterator[Finding]:
        speed = reading.setting("Sound Speed")
        low, high = SOUND_SPEED_MPS
        if speed is not None and not low <= speed <= high:
            message = f"the modem of {self.name} counts with a sound speed of {speed} m/s, which water does not have"
            hint = (
                f"have its crew set the sound speed of the place, between {low} and {high} m/s: all ranges hang on it"
            )
            yield Finding(Verdict.FAIL, "sound-speed", message, hint)

    def _reception(self, reading: Reading) -> Iterator[Finding]:
        rssi, integrity = reading.number("AT?E"), reading.number("AT?I")
        if rssi and not RSSI_DB[0] <= rssi <= RSSI_DB[1]:
            weak = rssi < RSSI_DB[0]
            message = f"the last reception of {self.name} was too {'weak' if weak else 'strong'}: {plain(rssi)} dB"
            hint = "look at the transducers and what is between them" if weak else "move the modems apart"
            yield Finding(Verdict.WARN, "signal-weak" if weak else "signal-strong", message, hint)
        if integrity and integrity < INTEGRITY_LOW:
            message = (
                f"the last reception of {self.name} was poor: integrity {plain(integrity)}, good is {INTEGRITY_LOW}"
            )
            hint = "look for echoes (walls, the hull, the surface) and noise, and check again"
            yield Finding(Verdict.WARN, "integrity-low", message, hint)

    def _pending(self, reading: Reading) -> Iterator[Finding]:
        if reading.settings is not None and reading.settings.pending:
            names = ", ".join(reading.settings.pending)
            message = f"the modem of {self.name} has changes that are not in force yet: {names}"
            yield Finding(Verdict.WARN, "pending", message, "have its crew finish or drop them")


def _evidence(reading: Reading) -> Iterator[Evidence]:
    for what, query, unit in _READINGS:
        value = evologics.answer(reading.heard, query)
        if value:
            yield Evidence(type=EvidenceType.READ, what=what, value=value[:120] + unit)
    if reading.settings is not None:
        for name, setting in reading.settings.values.items():
            yield Evidence(type=EvidenceType.READ, what=name, value=str(setting))
