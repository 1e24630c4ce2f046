"""Address of a modem, the messages that may be sent to it, and the reasons why it may not respond.

A modem serves one client, and a vehicle's acoustic and USBL columns often refer to the same modem. So everything that
they and the fleet comparison need is one script with one listening period, identical for all of them and sent once.

What may be sent: two tables, and the only functions that build a message from them. Sources: the makers' commands as
used by public drivers (devices.md 5.1 and 5.2). Everything that is not in a table is rejected, and so is whatever a
table marks as never to be sent. `refused_reason` checks the finished bytes, so that no message built elsewhere passes
either. An EvoLogics modem in data mode transmits what does not begin with `+++AT`: every command is sent with it.

A modem in use by its vehicle is not broken, and is never taken away from it.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes import base
from atlantis_netcfg.checklist.probes.acoustic import evologics, seatrac
from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, conjunction, msg
from atlantis_netcfg.inventory import model
from atlantis_netcfg.links import LinkFinding

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping


_IN_WATER = "in the water"


class ModemUse(StrEnum):
    """Effect of sending a command."""

    READ = "read"
    NEVER = "never"
    """It changes a setting, takes control or ends a session."""
    ACTIVE = "active"
    """It transmits: one step each, and only with a person's consent."""


@dataclass(frozen=True, slots=True)
class ModemCommand:
    """A command in a table of allowed and forbidden commands."""

    use: ModemUse
    what: str


class NeverSaid(NetcfgError, ValueError):
    """The command is not in the allow-list; it was not sent."""


EVOLOGICS: Mapping[bytes, ModemCommand] = {
    rb"AT\?(S|E|I|T|V|P|BL|BR|BV|CLOCK|CA|AL|AR|L|ZU)": ModemCommand(ModemUse.READ, "a query"),
    rb"ATI[0-9]": ModemCommand(ModemUse.READ, "modem identification"),
    rb"AT&V": ModemCommand(ModemUse.READ, "all settings"),
    rb"AT\*SENDIM,[0-9]{1,2},[0-9]{1,3},ack,[!-~]{1,64}": ModemCommand(ModemUse.ACTIVE, "transmits an instant message"),
    rb"AT!.*": ModemCommand(ModemUse.NEVER, "changes a setting"),
    rb"AT@.*": ModemCommand(ModemUse.NEVER, "takes control, or changes a setting"),
    rb"AT&W.*": ModemCommand(ModemUse.NEVER, "stores settings"),
    rb"AT&F.*": ModemCommand(ModemUse.NEVER, "restores the factory settings"),
    rb"ATZ.*": ModemCommand(ModemUse.NEVER, "drops data, connections or settings"),
    rb"AT[ANDHCO].*": ModemCommand(ModemUse.NEVER, "opens or closes a connection, or changes the mode"),
    rb"AT\*SEND.*": ModemCommand(ModemUse.NEVER, "transmits"),
    rb"": ModemCommand(ModemUse.NEVER, "switches to command mode"),
}
"""Pattern -> command; a pattern matches all between `+++` and the end of the line."""

SEATRAC: Mapping[int, ModemCommand] = {
    0x01: ModemCommand(ModemUse.READ, "alive"),
    0x02: ModemCommand(ModemUse.READ, "part number, serial number, firmware"),
    0x10: ModemCommand(ModemUse.READ, "status: supply, depth, sound speed, attitude"),
    0x11: ModemCommand(ModemUse.READ, "status output"),
    0x15: ModemCommand(ModemUse.READ, "settings"),
    0x21: ModemCommand(ModemUse.READ, "calibration"),
    0x3A: ModemCommand(ModemUse.READ, "transceiver"),
    0x03: ModemCommand(ModemUse.NEVER, "restarts the beacon"),
    0x0D: ModemCommand(ModemUse.NEVER, "writes firmware"),
    0x0E: ModemCommand(ModemUse.NEVER, "writes firmware"),
    0x0F: ModemCommand(ModemUse.NEVER, "writes firmware"),
    0x12: ModemCommand(ModemUse.NEVER, "changes the status output"),
    0x16: ModemCommand(ModemUse.NEVER, "changes settings"),
    0x17: ModemCommand(ModemUse.NEVER, "changes settings"),
    0x18: ModemCommand(ModemUse.NEVER, "stores settings"),
    0x19: ModemCommand(ModemUse.NEVER, "resets settings"),
    0x20: ModemCommand(ModemUse.NEVER, "calibrates"),
    0x22: ModemCommand(ModemUse.NEVER, "calibrates"),
    0x40: ModemCommand(ModemUse.ACTIVE, "transmits a ping"),
    0x48: ModemCommand(ModemUse.ACTIVE, "transmits"),
    0x50: ModemCommand(ModemUse.ACTIVE, "transmits"),
    0x5B: ModemCommand(ModemUse.ACTIVE, "transmits"),
    0x60: ModemCommand(ModemUse.ACTIVE, "transmits"),
}
"""Command number of a beacon -> command."""

_PING = 0x40
_WITH_USBL = 0x04
"""MSG_REQU: requests a response and measures its direction."""
_BEACONS = range(1, 16)
_ADDRESSES = range(1, 255)
_LONGEST = 64
_READ_S = 3.0


def refused_reason(data: bytes, *, active: bool) -> str | None:
    """Return why bytes must not be sent to a modem; None if they may. `active`: a person consented to transmit."""
    if data.startswith(b"#"):
        return _seatrac_refusal(data, active=active)
    if data.startswith(b"+++"):
        return _evologics_refusal(data, active=active)
    return msg(f"{arg(data)!r} is not an allowed command")


def _evologics_refusal(data: bytes, *, active: bool) -> str | None:
    body = data.removeprefix(b"+++").removesuffix(b"\n")
    modem_command = next((command for pattern, command in EVOLOGICS.items() if re.fullmatch(pattern, body)), None)
    if modem_command is None or data != b"+++" + body + b"\n":
        return msg(f"{arg(data)!r} is not an allowed command for an EvoLogics modem")
    if modem_command.use is ModemUse.ACTIVE and not _is_whole_message(body):
        return msg(f"{arg(data)!r} is not one complete message to one modem")
    return _use_refusal(modem_command, data, active=active)


def _is_whole_message(body: bytes) -> bool:
    _, length, to, _, text = body.split(b",", 4)
    return int(length) == len(text) <= _LONGEST and int(to) in _ADDRESSES


def _seatrac_refusal(data: bytes, *, active: bool) -> str | None:
    payload = seatrac.payload_of(data)
    modem_command = SEATRAC.get(payload[0]) if payload else None
    if payload is None or modem_command is None:
        return msg(f"{arg(data)!r} is not an allowed command for a SeaTrac beacon")
    if modem_command.use is ModemUse.READ and len(payload) > 1:
        return msg(f"{arg(data)!r} is a query with a parameter; queries take none")
    if modem_command.use is ModemUse.ACTIVE and not _is_single_ping(payload):
        return msg(f"{arg(data)!r} transmits, and is not a ping to one beacon")
    return _use_refusal(modem_command, data, active=active)


def _is_single_ping(payload: bytes) -> bool:
    return payload[0] == _PING and len(payload) == 3 and payload[1] in _BEACONS and payload[2] == _WITH_USBL  # noqa: PLR2004 - number, beacon, kind


def _use_refusal(modem_command: ModemCommand, data: bytes, *, active: bool) -> str | None:
    if modem_command.use is ModemUse.READ or (modem_command.use is ModemUse.ACTIVE and active):
        return None
    if modem_command.use is ModemUse.ACTIVE:
        return msg(f"{arg(data)!r} {arg(modem_command.what)}, and nobody has consented to it")
    return msg(f"{arg(data)!r} {arg(modem_command.what)}: it is never sent")


def _say(data: bytes, until: bytes, within_s: float, *, active: bool) -> base.Say:
    """Build a message for a modem; all messages are built here. Raises NeverSaid if it is not allowed."""
    if reason := refused_reason(data, active=active):
        raise NeverSaid(reason, hint="a probe sends only what `checklist/probes/acoustic/modem.py` lists")
    return base.Say(data, until, within_s)


def ask_at(query: str, until: bytes, *, within_s: float = _READ_S) -> base.Say:
    """Build a read-only query for an EvoLogics modem, such as `AT?S`. Raises NeverSaid."""
    return _say(b"+++" + query.encode() + b"\n", until, within_s, active=False)


def ask_seatrac(number: int, until: bytes, *, within_s: float = _READ_S) -> base.Say:
    """Build a read-only command for a SeaTrac beacon. Raises NeverSaid."""
    return _say(seatrac.command(bytes([number])), until, within_s, active=False)


def message(text: str, to: int, consent: base.Consent | None, until: bytes, *, within_s: float) -> base.Say:
    """Build a message for an EvoLogics modem to transmit; needs a step with consent. Raises NeverSaid."""
    data = f"+++AT*SENDIM,{len(text)},{to},ack,{text}\n".encode()
    return _say(data, until, within_s, active=_asks(consent))


def ping(beacon: int, consent: base.Consent | None, until: bytes, *, within_s: float) -> base.Say:
    """Build a ping from a SeaTrac beacon to another; needs a step with consent. Raises NeverSaid."""
    return _say(seatrac.command(bytes([_PING, beacon, _WITH_USBL])), until, within_s, active=_asks(consent))


def _asks(consent: base.Consent | None) -> bool:
    """Return whether a person is prompted, and whether the prompt mentions that the modem is in the water."""
    return consent is not None and _IN_WATER in consent.question


WATER = "water"
"""`turn` of requests that transmit: one at a time, or they drown each other."""
_FIXES = 3
"""Fixes of each expected address after which listening ends."""
_BAUD = {model.AcousticDriver.EVOLOGICS: 19200, model.AcousticDriver.SEATRAC: 115200}
_QUERIES = ("AT?S", "AT&V", "AT?AL", "AT?L", "AT?ZU", "AT?E", "AT?I", "AT?T", "ATI0", "ATI1", "AT?BV")
"""Most important query first: after one without a response, no other is sent."""
_NUMBERS = (seatrac.ALIVE, seatrac.INFO, seatrac.SETTINGS, seatrac.STATUS, seatrac.TRANSCEIVER)


@dataclass(frozen=True, slots=True)
class AcousticModem:
    """Connection endpoint of a modem."""

    driver: model.AcousticDriver
    place: base.Place
    address: str
    port: int
    device: str
    baud: int

    @property
    def where(self) -> str:
        """Description of the endpoint: `10.64.1.21:9200`, `/dev/ttyUSB0 of the gateway`."""
        computer = "this laptop" if self.place is base.Place.LAPTOP else "the gateway"
        return msg(f"{arg(self.device)} on {arg(computer)}" if self.device else f"{arg(self.address)}:{arg(self.port)}")

    def listen(
        self, name: str, say: tuple[base.Say, ...], *, listen_s: float, enough: bytes = b"", turn: str = ""
    ) -> base.Listen:
        """Build a listening script for this modem."""
        return base.Listen(
            name=name,
            place=self.place,
            transport="serial" if self.device else "tcp",
            address=self.address,
            port=self.port,
            device=self.device,
            baud=self.baud,
            say=say,
            listen_s=listen_s,
            enough=enough,
            turn=turn,
        )


def modem_of(cell: base.Cell) -> AcousticModem | None:
    """Return the modem of a cell in the columns acoustic and USBL; None if the inventory has none, or no address."""
    endpoint = _endpoint(cell)
    if endpoint is None:
        return None
    place = cell.place(endpoint.seen_from)
    if endpoint.device is not None:
        return AcousticModem(endpoint.driver, place, "", 0, endpoint.device, endpoint.baud or _BAUD[endpoint.driver])
    address = cell.address(endpoint.address)
    return AcousticModem(endpoint.driver, place, address, endpoint.port, "", 0) if address else None


def _endpoint(cell: base.Cell) -> model.AcousticEndpoint | model.UsblEndpoint | None:
    return cell.endpoints.usbl if cell.endpoint == model.Column.USBL else cell.endpoints.acoustic


def modems(cell: base.Cell, column: model.Column) -> Iterator[tuple[base.Cell, AcousticModem]]:
    """Yield the modems of all rows that are tested at the site, with their cells; the site's own comes last."""
    here = cell.site_config.checklist.vehicles
    for row in (*(key for key in cell.inventory.vehicles if here is None or key in here), None):
        other = base.Cell(cell.inventory, cell.site, row, column)
        if modem := modem_of(other):
            yield other, modem


def declared_address(cell: base.Cell, modem: AcousticModem) -> int | None:
    """Return the acoustic address of a modem from the acoustic column of any row; None if the inventory has none."""
    same = (other.endpoints.acoustic for other, its in modems(cell, model.Column.ACOUSTIC) if its == modem)
    return next(
        (
            endpoint.acoustic_address
            for endpoint in same
            if endpoint is not None and endpoint.acoustic_address is not None
        ),
        None,
    )


def question(cell: base.Cell, modem: AcousticModem) -> base.Listen:
    """Build the shared request for a modem: read-only queries, then the longest listening period needed."""
    usbl = [item.endpoints.usbl for item, other in modems(cell, model.Column.USBL) if other == modem]
    endpoints = [endpoint for endpoint in usbl if endpoint is not None]
    return modem.listen(
        msg(f"modem at {arg(modem.where)}"),
        _script(modem.driver),
        listen_s=max((endpoint.listen_s for endpoint in endpoints), default=0.0),
        enough=_enough(modem.driver, endpoints),
    )


def _script(driver: model.AcousticDriver) -> tuple[base.Say, ...]:
    if driver is model.AcousticDriver.SEATRAC:
        return tuple(ask_seatrac(number, rb"(?i)\$%02X[0-9A-F]+[\r\n]" % number) for number in _NUMBERS)
    return tuple(ask_at(query, evologics.reply_pattern(query)) for query in _QUERIES)


def _enough(driver: model.AcousticDriver, endpoints: list[model.UsblEndpoint]) -> bytes:
    """Return the pattern that ends listening: several fixes of each expected address; empty if none is expected."""
    addresses = sorted({address for endpoint in endpoints for address in endpoint.hears})
    remotes: list[int | None] = list(addresses)
    if any(not endpoint.hears for endpoint in endpoints):
        remotes.append(None)
    pattern = b"".join(b"(?=(?:.*?%b){%d})" % (_fix_pattern(driver, remote), _FIXES) for remote in remotes)
    if not pattern or driver is model.AcousticDriver.SEATRAC:
        return rb"(?s)\A" + pattern if pattern else b""
    # Whose output of fixes is switched off need not be listened to.
    return rb"(?s)\A(?:%b|.*?\+\+\+AT\?ZU:1:0\r\n)" % pattern


def _fix_pattern(driver: model.AcousticDriver, remote: int | None) -> bytes:
    if driver is model.AcousticDriver.SEATRAC:
        return rb"\$(?:42|52)[0-9A-Fa-f]{2}%b[0-9A-Fa-f]+[\r\n]" % (
            rb"[0-9A-Fa-f]{2}" if remote is None else rb"(?i:%02X)" % remote
        )
    return rb"USBL(?:LONG|ANGLES),[^,\r\n]*,[^,\r\n]*,%b,[^\r\n]*\r?\n" % (
        rb"\d+" if remote is None else b"%d" % remote
    )


LANGUAGE = {model.AcousticDriver.EVOLOGICS: "an EvoLogics modem", model.AcousticDriver.SEATRAC: "a SeaTrac beacon"}
_IN_USE = (
    "check the modem's topic in the vehicle's own software; stop that software only if the vehicle's crew "
    "agrees, then check again"
)


_WORDS: Mapping[base.Trouble | None, tuple[Verdict, str, str, str]] = {
    base.Trouble.REFUSED: (
        Verdict.INCONCLUSIVE,
        "in-use",
        "the modem of {name} refuses the connection at {where}: the vehicle is probably using it",
        _IN_USE,
    ),
    base.Trouble.BUSY: (
        Verdict.INCONCLUSIVE,
        "in-use",
        "the modem of {name} is in use: another program has {where} open",
        _IN_USE,
    ),
    base.Trouble.SILENT: (
        Verdict.INCONCLUSIVE,
        "silent",
        "the modem of {name} does not respond at {where}",
        msg(
            "switch the modem on, and compare its address with the inventory; if the vehicle is using it: "
            + str(arg(_IN_USE))
        ),
    ),
    base.Trouble.UNREACHABLE: (
        Verdict.INCONCLUSIVE,
        "unreachable",
        "the modem of {name} is not reachable at {where}",
        "check the vehicle's link to the site first: its Wi-Fi or its cable",
    ),
    base.Trouble.MISSING: (
        Verdict.FAIL,
        "no-port",
        "the serial port {where} for the modem of {name} does not exist",
        "connect the modem's cable, or correct `device` in the inventory",
    ),
    base.Trouble.DENIED: (
        Verdict.INCONCLUSIVE,
        "denied",
        "no permission to open {where} for the modem of {name}",
        "add the account that runs the check to the group `dialout` of that computer",
    ),
    base.Trouble.NO_PLACE: (
        Verdict.INCONCLUSIVE,
        "no-place",
        "the modem of {name} was not queried: {words}",
        "restore access to the computer that sends the query first; the state of the modem is unknown",
    ),
    None: (
        Verdict.INCONCLUSIVE,
        "in-use",
        "the modem of {name} accepts the connection at {where} and sends nothing: the vehicle is probably using it",
        _IN_USE,
    ),
}
"""Verdict, code, sentence and hint for a modem that sent nothing."""


def trouble(modem: AcousticModem, name: str, transcript: base.Transcript) -> LinkFinding | None:
    """Return why a modem could not be read; None if it sent any data."""
    if transcript.data:
        return None
    # Who serves one client only hangs up on the second, or refuses it: both mean the same here.
    cause = base.Trouble.REFUSED if transcript.trouble is base.Trouble.CLOSED else transcript.trouble
    verdict, code, message, hint = _WORDS[cause]
    words = transcript.words or "reason unknown"
    text = msg(message.format(name=arg(name), where=arg(modem.where), words=arg(words)))
    return LinkFinding(verdict, code, text, hint)


def transcript_or_judgement(modem: AcousticModem, name: str, answer: base.Answer) -> base.Transcript | base.ProbeResult:
    """Return the transcript of a modem, or a result if the modem could not be read."""
    if not isinstance(answer, base.Transcript):
        raise TypeError(answer)
    finding = trouble(modem, name, answer)
    return answer if finding is None else base.ProbeResult((finding,))


def not_understood(modem: AcousticModem, name: str) -> LinkFinding:
    """Return the finding for data that are not the modem's protocol, or noise."""
    message = msg(
        f"what responds for {arg(name)} at {arg(modem.where)} does not respond like {arg(LANGUAGE[modem.driver])}"
    )
    hint = "compare `driver`, `port` and `baud` in the inventory with the modem; a wrong baud rate gives noise"
    return LinkFinding(Verdict.INCONCLUSIVE, "not-understood", message, hint)


def whose_unknown(modem: AcousticModem, name: str) -> LinkFinding:
    """Return the finding for a modem that cannot be identified, as the inventory has no acoustic address."""
    message = msg(f"cannot tell whether the device at {arg(modem.where)} is the modem of {arg(name)}")
    return LinkFinding(Verdict.WARN, "whose-unknown", message, "set its `acoustic_address` under `endpoints.acoustic`")


def two_modems(modem: AcousticModem, name: str, addresses: Collection[int]) -> LinkFinding:
    """Return the finding for contradicting addresses, which mean more than one modem."""
    message = msg(
        f"the device that responds for {arg(name)} at {arg(modem.where)} reports the acoustic addresses "
        f"{arg(conjunction(sorted(addresses)))}: it is more than one modem"
    )
    hint = "check what is connected there: one line serves one modem, and no program may mix two"
    return LinkFinding(Verdict.FAIL, "two-modems", message, hint)
