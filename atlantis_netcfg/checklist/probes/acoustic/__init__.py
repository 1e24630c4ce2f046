"""Acoustic modems of the vehicles, read without disturbing them, and never made to transmit in air.

Two drivers (EvoLogics S2C, Blueprint SeaTrac) read from closed lists of commands; every transmission is a separate step
that needs a person's consent, in the water. A modem that is in use by its vehicle is left alone: that is no failure.
One request, sent once, serves the columns acoustic and USBL and the fleet comparison.

The fleet: comparing the settings of all modems of a site shows whether they can communicate at all.

A message from modem to modem needs a person's consent, water, and a modem that is not too loud. A script cannot decide,
but it can stop: it reads the state, then the modem's address, then the source level, and sends the message only after
responses that allow it, so that nobody else's modem transmits. Those responses must come alone (plain-text
notifications aside): nothing inside a received message is accepted as one, and in doubt nothing is sent.

docs/engineers/probes.md describes how it could be deceived, and what prevents that.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist import report
from atlantis_netcfg.checklist.probes import base
from atlantis_netcfg.checklist.probes.acoustic import evologics, status
from atlantis_netcfg.checklist.probes.acoustic.modem import (
    WATER,
    AcousticModem,
    ask_at,
    declared_address,
    message,
    modem_of,
    modems,
    not_understood,
    question,
    transcript_or_judgement,
)
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, conjunction, join, msg
from atlantis_netcfg.inventory.model import AcousticDriver, Column
from atlantis_netcfg.links import LinkFinding

if TYPE_CHECKING:
    from collections.abc import Hashable, Iterable, Iterator, Mapping


__all__ = ["steps"]


_HIGHEST = (2, 6, 14, 30, 62, 126, 254)
_PACKET_MS = (50, 1000)
_CARRIERS = ((0, 1), (1, 0), (2, 2))
"""Pairs of waveform ids that can receive each other."""
_COMPARED_SETTINGS = ("Local Address", "Highest Address", "Carrier Waveform ID", "Packet Time")
_PHY = "ATI1"


@dataclass(frozen=True, slots=True)
class ModemMember:
    """A modem in the fleet comparison."""

    name: str
    """Display name of the checklist row."""
    question: base.Listen
    expected_address: int | None
    """Acoustic address or beacon number; None: not declared."""


def _requests(members: tuple[ModemMember, ...]) -> tuple[base.Question, ...]:
    return tuple(dict.fromkeys(member.question for member in members))


def _transcript(member: ModemMember, results: Mapping[str, base.Answer]) -> base.Transcript:
    transcript = results[member.question.name]
    if not isinstance(transcript, base.Transcript):
        raise TypeError(transcript)
    return transcript


def _not_compared_findings(names: Iterable[str], result: int) -> Iterator[LinkFinding]:
    missing = join(", ", names)
    if missing:
        rest = "the others are compared without it" if result > 1 else "a comparison needs at least two"
        message = msg(f"the modem settings of {arg(missing)} could not be read: {arg(rest)}")
        hint = "first resolve the item of that modem, then check again"
        yield LinkFinding(Verdict.INCONCLUSIVE, "not-compared", message, hint)


def _wrong_address_findings(members: tuple[ModemMember, ...], addresses: Mapping[str, int]) -> Iterator[LinkFinding]:
    for member in members:
        address = addresses.get(member.name, member.expected_address)
        if member.expected_address is not None and address != member.expected_address:
            message = msg(
                f"a modem with the address {arg(address)} responds for {arg(member.name)}, but the inventory has "
                f"{arg(member.expected_address)}"
            )
            hint = "first resolve the item of that modem, then check again"
            yield LinkFinding(
                Verdict.INCONCLUSIVE, "not-compared", msg(f"{arg(message)}: its settings are not compared"), hint
            )


def _join_values(values: Mapping[str, object]) -> str:
    return join(", ", (f"{name} {value}" for name, value in values.items()))


def _require_same(
    what: str, code: str, values: Mapping[str, Hashable], hint: str, *, verdict: Verdict
) -> Iterator[LinkFinding]:
    if len(set(values.values())) > 1:
        yield LinkFinding(
            verdict, code, msg(f"the modems differ in their {arg(what)}: {arg(_join_values(values))}"), hint
        )


def _require_unique(what: str, values: Mapping[str, int]) -> Iterator[LinkFinding]:
    for number in sorted(set(values.values())):
        names = [name for name, local in values.items() if local == number]
        if len(names) > 1:
            message = msg(f"{arg(conjunction(names))} have the same {arg(what)}, {arg(number)}")
            hint = "ask the crew of one of them to set another value; the inventory shows which belongs to whom"
            yield LinkFinding(Verdict.FAIL, "duplicate-address", message, hint)


@dataclass(frozen=True, slots=True)
class EvologicsFleet:
    """Check that the EvoLogics modems of a site agree in all settings that must be equal."""

    members: tuple[ModemMember, ...]

    def asks(self) -> tuple[base.Question, ...]:
        """Return the same scripts as the items of the modems themselves."""
        return _requests(self.members)

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        """Compare the settings reported by `AT&V`."""
        readings = {member.name: status.AcousticReading.of(_transcript(member, results)) for member in self.members}
        result = {
            name: {key: value for key in _COMPARED_SETTINGS if (value := reading.setting(key)) is not None}
            for name, reading in readings.items()
        }
        whole = {name: values for name, values in result.items() if len(values) == len(_COMPARED_SETTINGS)}
        findings = [*_not_compared_findings((name for name in readings if name not in whole), len(whole))]
        if len(whole) > 1:
            findings += self._compare(whole, readings)
        findings += _wrong_address_findings(
            self.members, {name: values["Local Address"] for name, values in whole.items()}
        )
        evidence = tuple(
            report.Evidence(type=report.EvidenceType.READ, what=name, value=_join_values(values))
            for name, values in whole.items()
        )
        return base.ProbeResult(tuple(findings) or (_agreement_finding(whole),), evidence)

    def _compare(
        self, result: Mapping[str, Mapping[str, int]], readings: Mapping[str, status.AcousticReading]
    ) -> Iterator[LinkFinding]:
        of = {key: {name: values[key] for name, values in result.items()} for key in _COMPARED_SETTINGS}
        yield from _require_unique("acoustic address", of["Local Address"])
        hint = msg(
            "ask the crews to set the same highest address on all modems: " + str(arg(join(", ", map(str, _HIGHEST))))
        )
        yield from _require_same(
            "highest address", "highest-address-differs", of["Highest Address"], hint, verdict=Verdict.FAIL
        )
        yield from _require_allowed("highest address", "highest-address", of["Highest Address"], _HIGHEST, hint)
        hint = "ask the crews to set the same packet time on all modems, between 50 and 1000 ms"
        yield from _require_same(
            "packet time (ms)", "packet-time-differs", of["Packet Time"], hint, verdict=Verdict.FAIL
        )
        allowed_range = range(_PACKET_MS[0], _PACKET_MS[1] + 1)
        yield from _require_allowed("packet time (ms)", "packet-time", of["Packet Time"], allowed_range, hint)
        yield from _check_carriers(of["Carrier Waveform ID"])
        words = {name: evologics.answer(readings[name].replies, _PHY) for name in result}
        hint = "compare the models on the modems' labels: modems receive each other only in the same frequency band"
        physical_layers = {name: word for name, word in words.items() if word}
        yield from _require_same("physical layer", "band-differs", physical_layers, hint, verdict=Verdict.WARN)


def _require_allowed(
    what: str, code: str, values: Mapping[str, int], allowed_values: range | tuple[int, ...], hint: str
) -> Iterator[LinkFinding]:
    for name, value in values.items():
        if value not in allowed_values:
            yield LinkFinding(
                Verdict.FAIL,
                code,
                msg(f"the {arg(what)} of {arg(name)} is {arg(value)}, which no modem supports"),
                hint,
            )


def _check_carriers(values: Mapping[str, int]) -> Iterator[LinkFinding]:
    deaf = [
        msg(f"{arg(a)} ({arg(values[a])}) and {arg(b)} ({arg(values[b])})")
        for a, b in combinations(values, 2)
        if (values[a], values[b]) not in _CARRIERS
    ]
    if deaf:
        message = msg(f"incompatible carrier waveforms: {arg(join('; ', deaf))}")
        hint = "ask the crews to set carrier waveform 2 on all modems; 0 and 1 are for a pair"
        yield LinkFinding(Verdict.FAIL, "carriers", message, hint)


def _agreement_finding(result: Mapping[str, Mapping[str, int]]) -> LinkFinding:
    addresses = join(", ", (f"{name} {values['Local Address']}" for name, values in result.items()))
    return LinkFinding(Verdict.PASS, "agree", msg(f"the settings of the modems match; addresses: {arg(addresses)}"))


@dataclass(frozen=True, slots=True)
class SeatracFleet:
    """Check that the SeaTrac beacons of a site have different numbers and use the same sound speed."""

    members: tuple[ModemMember, ...]

    def asks(self) -> tuple[base.Question, ...]:
        """Return the same scripts as the items of the beacons themselves."""
        return _requests(self.members)

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        """Compare the settings of the beacons."""
        beacons = {member.name: status.Beacon.of(_transcript(member, results)).settings for member in self.members}
        values = {name: settings for name, settings in beacons.items() if settings is not None}
        findings = [*_not_compared_findings((name for name in beacons if name not in values), len(values))]
        numbers = {name: settings.beacon for name, settings in values.items()}
        sound = {
            name: "by itself" if settings.auto_sound_speed else f"{status.plain(settings.sound_speed_mps)} m/s"
            for name, settings in values.items()
        }
        if len(values) > 1:
            findings += _require_unique("beacon number", numbers)
            hint = "ask the crews to set the same sound speed on all beacons, or to let all beacons calculate it"
            findings += _require_same("sound speed", "sound-speed-differs", sound, hint, verdict=Verdict.WARN)
        findings += _wrong_address_findings(self.members, numbers)
        evidence = tuple(
            report.Evidence(
                type=report.EvidenceType.READ,
                what=name,
                value=msg(f"number {arg(numbers[name])}, sound speed {arg(sound[name])}"),
            )
            for name in values
        )
        number_list = _join_values(numbers)
        success = LinkFinding(
            Verdict.PASS, "agree", msg(f"the settings of the beacons match; numbers: {arg(number_list)}")
        )
        return base.ProbeResult(tuple(findings) or (success,), evidence)


TEXT = "ATLANTIS"
_TEXT_ONLY = rb"\A(?:\+{0,2}[\w,.:-]*\r?\n)?(?:\+\+\+AT:\d+:(?!RECV(?!START|END|FAILED))[A-Z]+[^\r\n]*\r\n)*"
"""Rest of a notification cut by the last response, then whole notifications; none holds a message."""
_LISTENS = _TEXT_ONLY + rb"\+\+\+AT\?S:\d+:INITIATION LISTEN[^\r\n]*\r\n"
_LEVELS = (1, 2, 3)
"""Permitted source levels, without the maximum: nobody needs it within a port."""
_QUIET = _TEXT_ONLY + rb"\+\+\+AT\?L:1:[123]\r\n"
_DELIVERED_S = 20.0
"""Seconds for a delivery: a modem retries by itself before it gives up."""


def message_consent(name: str, partner: int) -> base.Consent:
    """Return the consent that a person must give before a message is transmitted."""
    return base.Consent(
        question=msg(
            f"{arg(name)} and the modem with the acoustic address {arg(partner)} are in the water, nobody dives near "
            "them, and they may transmit one message"
        )
    )


@dataclass(frozen=True, slots=True)
class EvologicsMessage:
    """Check that a message reaches the partner's modem, which acknowledges it."""

    modem: AcousticModem
    name: str
    """Display name of the checklist row."""
    expected_address: int | None
    """Acoustic address; None: any modem may be there, which the modem's own item reports."""
    partner: int
    """Acoustic address of the other modem."""
    consent: base.Consent | None
    """Consent that the step asks a person for; without it no message is sent."""

    def asks(self) -> tuple[base.Question, ...]:
        """Request state, address and source level, then send the message. Raises NeverSaid if no person is prompted."""
        return (self._question(),)

    def _question(self) -> base.Listen:
        end_pattern = (
            rb"(?:DELIVERED|FAILED)IM,%d\r?\n|\+\+\+AT\*SENDIM[^:\r\n]*:\d+:(?:ERROR|BUSY)|(?:\A|\n)(?:ERROR|BUSY)"
            % self.partner
        )
        say = (
            ask_at("AT?S", _LISTENS),
            ask_at("AT?AL", _TEXT_ONLY + rb"\+\+\+AT\?AL:\d+:%s\r\n" % _address_pattern(self.expected_address)),
            ask_at("AT?L", _QUIET),
            message(TEXT, self.partner, self.consent, end_pattern, within_s=_DELIVERED_S),
        )
        return self.modem.listen(msg(f"message from {arg(self.modem.where)}"), say, listen_s=0.0, turn=WATER)

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        """Judge whether the message was sent, and what the partner reported."""
        transcript = transcript_or_judgement(self.modem, self.name, results[self._question().name])
        if isinstance(transcript, base.ProbeResult):
            return transcript
        pieces = evologics.pieces(transcript.data)
        if not any(piece.command for piece in pieces):
            return base.ProbeResult((not_understood(self.modem, self.name),))
        level = evologics.number(evologics.answer(pieces, "AT?L"))
        evidence = (
            ()
            if level is None
            else (
                report.Evidence(
                    type=report.EvidenceType.READ,
                    what="source level before the message",
                    value=status.level_words(int(level)),
                ),
            )
        )
        is_accepted = evologics.answer(pieces, "AT*SENDIM") == "OK"
        refusal = evologics.trouble_words(pieces, "AT*SENDIM")
        if is_accepted:
            # The vehicle's own software may send as well: only what follows our own message is its report.
            at = next(place for place, entry in enumerate(pieces) if _is_send(entry) and entry.text == "OK")
            reports = tuple(item.text for item in pieces[at:] if item.command == evologics.NOTIFICATION)
            return base.ProbeResult((self._judge_report(reports),), evidence)
        return base.ProbeResult((self._judge_refusal(pieces, level, refusal),), evidence)

    def _judge_report(self, lines: tuple[str, ...]) -> LinkFinding:
        to = msg(f"the modem with address {arg(self.partner)}")
        if f"DELIVEREDIM,{self.partner}" in lines:
            return LinkFinding(
                Verdict.PASS,
                "delivered",
                msg(f"a message of {arg(self.name)} reached {arg(to)}, which acknowledged it"),
            )
        if f"FAILEDIM,{self.partner}" in lines:
            hint = "check that both modems are in the water, within range of each other, and have matching settings"
            return LinkFinding(
                Verdict.FAIL,
                "not-delivered",
                msg(f"{arg(to)} did not acknowledge the message of {arg(self.name)}"),
                hint,
            )
        hint = "check again; the modem may still have been retrying when the time ran out"
        message = msg(f"the modem of {arg(self.name)} sent a message and does not report the outcome")
        return LinkFinding(Verdict.INCONCLUSIVE, "no-report", message, hint)

    def _judge_refusal(
        self, pieces: tuple[evologics.Piece, ...], level: float | None, refusal: str | None
    ) -> LinkFinding:
        state = evologics.state(pieces)
        if state is not None and state != "INITIATION LISTEN":
            message = msg(f"no message was sent: the modem of {arg(self.name)} is not listening ({arg(state)})")
            return LinkFinding(Verdict.INCONCLUSIVE, "not-sent", message, "first resolve the item of that modem")
        address = evologics.number(evologics.answer(pieces, "AT?AL"))
        if address is not None and self.expected_address is not None and address != self.expected_address:
            message = msg(
                f"no message was sent: the modem of {arg(self.name)} has the acoustic address {arg(address):.0f}, and"
            )
            hint = "first resolve the item of that modem"
            return LinkFinding(
                Verdict.FAIL,
                "wrong-address",
                msg(f"{arg(message)} the inventory says {arg(self.expected_address)}"),
                hint,
            )
        if level is not None and level not in _LEVELS:
            message = msg(
                f"no message was sent: the source level of {arg(self.name)} is {arg(status.level_words(int(level)))}"
            )
            hint = "ask its crew to set a level between 1 and 3 (3 is the quietest), then check again"
            return LinkFinding(Verdict.INCONCLUSIVE, "too-loud", message, hint)
        if refusal:
            message = msg(f"the modem of {arg(self.name)} rejected the message: `{arg(refusal[:60])}`")
            return LinkFinding(
                Verdict.INCONCLUSIVE, "not-taken", message, "check again when the vehicle is not using it"
            )
        message = msg(
            f"no message was sent: the modem of {arg(self.name)} did not report an address and a source level that "
            "allow it"
        )
        hint = "check again when the modem is not receiving; a pending level change also prevents sending"
        return LinkFinding(Verdict.INCONCLUSIVE, "not-sent", message, hint)


def _address_pattern(address: int | None) -> bytes:
    return rb"\d+" if address is None else b"%d" % address


def _is_send(piece: evologics.Piece) -> bool:
    return piece.command is not None and piece.command.partition(",")[0] == "AT*SENDIM"


def steps(cell: base.Cell) -> tuple[base.Step, ...]:
    """Return the modem's check, the fleet check once per site and driver, and a message if there is a partner."""
    modem = modem_of(cell)
    if modem is None:
        return (_manual_step(cell),)
    return (_status(cell, modem), *_fleet(cell, modem), *_message(cell, modem))


def _status(cell: base.Cell, modem: AcousticModem) -> base.Step:
    endpoint = cell.endpoints.acoustic
    expected_address = endpoint.acoustic_address if endpoint else None
    evologics = modem.driver is AcousticDriver.EVOLOGICS
    kind = status.EvologicsStatus if evologics else status.SeatracStatus
    return base.Step(
        name="",
        title=msg(f"The acoustic modem of {arg(cell.name)} listens and has the settings of the inventory"),
        kind=report.ItemKind.AUTOMATIC,
        phase=report.Phase.BENCH,
        probe=kind(modem, cell.name, expected_address, question(cell, modem)),
    )


def _fleet(cell: base.Cell, modem: AcousticModem) -> Iterator[base.Step]:
    """Yield the fleet comparison of a driver's modems, for the first row that has one."""
    same = [(other, its) for other, its in modems(cell, Column.ACOUSTIC) if its.driver is modem.driver]
    if len({its for _, its in same}) < 2 or same[0][0].vehicle != cell.vehicle:  # noqa: PLR2004 - a comparison
        return
    # Two rows with one modem (the site's own) are one member: it would have its own address twice.
    members: dict[AcousticModem, ModemMember] = {}
    for other, its in same:
        members.setdefault(its, ModemMember(other.name, question(other, its), declared_address(other, its)))
    evologics = modem.driver is AcousticDriver.EVOLOGICS
    who = "EvoLogics modems" if evologics else "SeaTrac beacons"
    yield base.Step(
        name="fleet",
        title=msg(f"The {arg(who)} of {arg(cell.site_config.title)} agree with each other"),
        kind=report.ItemKind.AUTOMATIC,
        phase=report.Phase.BENCH,
        probe=(EvologicsFleet if evologics else SeatracFleet)(tuple(members.values())),
    )


def _message(cell: base.Cell, modem: AcousticModem) -> Iterator[base.Step]:
    endpoint = cell.endpoints.acoustic
    if endpoint is None or endpoint.partner is None:
        return
    if modem.driver is not AcousticDriver.EVOLOGICS:
        yield _sent_by_a_person(cell, endpoint.partner)
        return
    consent = message_consent(cell.name, endpoint.partner)
    yield base.Step(
        name="message",
        title=msg(
            f"A message from {arg(cell.name)} reaches the modem with the acoustic address {arg(endpoint.partner)}"
        ),
        kind=report.ItemKind.ACTIVE,
        phase=report.Phase.WATER,
        probe=EvologicsMessage(modem, cell.name, endpoint.acoustic_address, endpoint.partner, consent),
        consent=consent,
    )


def _sent_by_a_person(cell: base.Cell, partner: int) -> base.Step:
    """Return a step for a person: this tool sends no data with a SeaTrac beacon, which pings (column USBL)."""
    return base.Step(
        name="message",
        title=msg(f"A message from {arg(cell.name)} reaches the beacon {arg(partner)}"),
        kind=report.ItemKind.PERSON,
        phase=report.Phase.WATER,
        do=msg(
            f"With both in the water, make the software of {arg(cell.name)} send data to the beacon {arg(partner)}."
        ),
        look_for="The other vehicle shows the data; the sender shows the acknowledgement.",
    )


def _manual_step(cell: base.Cell) -> base.Step:
    is_declared = cell.endpoints.acoustic is not None
    why = "it has no address at this site" if is_declared else "it is not in the inventory"
    return base.Step(
        name="",
        title=msg(f"The acoustic modem of {arg(cell.name)} sends and receives"),
        kind=report.ItemKind.PERSON,
        phase=report.Phase.WATER,
        do=msg(
            f"The program cannot query the modem of {arg(cell.name)}: {arg(why)}. In the water, and never in air, make "
            "the vehicle's software send a message to another modem of the test, and one back."
        ),
        look_for="Both are acknowledged; the modem reports no alarm; no other vehicle has its acoustic address.",
    )
