"""Check of the assumptions about RouterOS or RutOS on one device of a site: session, cost, report."""

from __future__ import annotations

import asyncio
import json
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core import events, paths, printable
from atlantis_netcfg.core.atomic_files import write_atomically
from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory.model import LteDriver, LteRouter
from atlantis_netcfg.links.cost import Preview, preview
from atlantis_netcfg.links.lte import rutos_read
from atlantis_netcfg.operations.common.jobs import endpoint_of
from atlantis_netcfg.operations.common.kinds import get_managed_device
from atlantis_netcfg.operations.common.session_link import site_link_of
from atlantis_netcfg.operations.common.site_links import link_of
from atlantis_netcfg.operations.lte import assumptions as rutos
from atlantis_netcfg.operations.lte.units import LteUnit
from atlantis_netcfg.routeros import verify
from atlantis_netcfg.routeros.api import READING_WINDOW, Traffic
from atlantis_netcfg.routeros.assumptions import ASSUMPTIONS
from atlantis_netcfg.routeros.estimate import HANDSHAKE_BYTES, on_the_wire
from atlantis_netcfg.runs import Store

if TYPE_CHECKING:
    from pathlib import Path

    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.operations.common.request import Request

_FLIGHT_BYTES = 160
"""Bytes of one small request and its response, both with their TLS records."""
_READ_BYTES = 45_000
"""Bytes of all reads: mostly the history of a hundred entries, then a list that is requested ten times."""
_TRY_BYTES = 40_000 + 2 * verify.ON_EVENT
"""Bytes of scratch rows, a long job both ways, ids of history and names, and one request a second for some seconds."""
_READ_SESSIONS, _TRY_SESSIONS = 2, 7
_SECONDS = 20.0
_WORDS = {
    events.Verdict.PASS: "holds",
    events.Verdict.FAIL: "DOES NOT HOLD",
    events.Verdict.INCONCLUSIVE: "unknown",
    events.Verdict.SKIP: "not shown",
}
_ASSUMPTIONS = {assumption.id: assumption for assumption in (*ASSUMPTIONS, *rutos.ASSUMPTIONS)}
_COUNTS = {verdict: words.lower() for verdict, words in _WORDS.items()}


@dataclass(frozen=True, slots=True)
class VerifiedDevice:
    """The result of verifying one device."""

    device: str
    answers: verify.SeenAnswers
    was_tried: bool
    is_rehearsal: bool
    at: datetime
    round_trips: int
    bytes: int
    file: Path | None = None
    """File with the same result, to be sent back."""

    def number(self, verdict: events.Verdict) -> int:
        """Return the number of assumptions with this verdict."""
        return sum(finding.verdict is verdict for finding in self.answers.findings)

    @property
    def exit(self) -> ExitCode:
        """The exit code: 6 if one fails or has no usable response, 7 if none was testable, else 0."""
        if self.number(events.Verdict.FAIL) or self.number(events.Verdict.INCONCLUSIVE):
            return ExitCode.CHECKS_FAILED
        return ExitCode.DONE if self.number(events.Verdict.PASS) else ExitCode.NOTHING

    def as_json(self) -> dict[str, Any]:
        """Return JSON-able data."""
        return {
            "device": self.device,
            "rehearsed": self.is_rehearsal,
            "tried": self.was_tried,
            "version": self.answers.version,
            "board": self.answers.board,
            "architecture": self.answers.architecture,
            "at": self.at.isoformat(timespec="seconds"),
            "round_trips": self.round_trips,
            "bytes": self.bytes,
            "exit": int(self.exit),
            "assumptions": [
                {
                    "id": finding.id,
                    "sentence": _ASSUMPTIONS[finding.id].sentence,
                    "rests": _ASSUMPTIONS[finding.id].rests,
                    "shown": _ASSUMPTIONS[finding.id].proof,
                    "verdict": finding.verdict.value,
                    "evidence": printable.line(finding.evidence),
                }
                for finding in self.answers.findings
            ],
            "file": None if self.file is None else str(self.file),
        }

    def as_text(self) -> str:
        """Return the report as text, failed assumptions first."""
        answers, where = self.answers, "emulated " if self.is_rehearsal else ""
        counts = join(", ", (msg(f"{arg(words)}: {arg(self.number(verdict))}") for verdict, words in _COUNTS.items()))
        version = printable.line(f"{answers.system} {answers.version}").rstrip()
        lines = [
            msg(f"{arg(self.device)}: {arg(where)}{arg(printable.line(answers.board))}, {arg(version)}"),
            msg(f"  {arg(len(answers.findings))} assumptions; {arg(counts)}"),
        ]
        for verdict in (events.Verdict.FAIL, events.Verdict.INCONCLUSIVE, events.Verdict.PASS, events.Verdict.SKIP):
            for finding in (item for item in answers.findings if item.verdict is verdict):
                lines.append(
                    msg(f"  {arg(_WORDS[verdict]):<14} {arg(finding.id)}: {arg(printable.line(finding.evidence))}")
                )
                if verdict in {events.Verdict.FAIL, events.Verdict.INCONCLUSIVE}:
                    lines += [
                        msg(f"  {'':<14} {arg(_ASSUMPTIONS[finding.id].sentence)}"),
                        msg(f"  {'':<14} {arg(_ASSUMPTIONS[finding.id].rests)}"),
                    ]
        lines.append(msg(f"  {arg(self.round_trips)} round trips, {arg(self.bytes / 1000):.1f} kB"))
        if self.file is not None:
            lines.append(msg(f"  file to send back: {arg(self.file)}"))
        return join("\n", lines)


@dataclass(slots=True)
class Verifying:
    """The verification of one device."""

    inventory: Inventory
    host: Host
    request: Request
    notify: events.Subscriber
    tries: bool = False
    """Also test with scratch rows under safe mode."""
    silence: bool = False
    """Also test a session that is silent for ten minutes."""
    _traffic: list[Traffic] = field(default_factory=list)

    @property
    def cost(self) -> Preview:
        """The maximum cost over the link in use; raises UsageError for a link that the site does not have."""
        link = site_link_of(self.inventory, self.host, self.request.via.get(self.host.name))
        payload = READING_WINDOW * _FLIGHT_BYTES + _READ_BYTES + _TRY_BYTES * (self.tries + self.silence)
        sessions = _READ_SESSIONS + _TRY_SESSIONS * (self.tries + self.silence)
        total = on_the_wire(payload + sessions * HANDSHAKE_BYTES, sessions)
        seconds = _SECONDS * (1 + self.tries) + verify.UNDO_S * self.silence + link.rtt_s * 4 * sessions
        return preview(total, seconds, link_of(self.inventory, self.host.site, link.name), at_most=True)

    def run(self) -> VerifiedDevice:
        """Query the device; raise DeviceError, or OutcomeUnknown if scratch rows may remain."""
        return asyncio.run(self._run())

    async def _run(self) -> VerifiedDevice:
        if isinstance(device := self.host.device, LteRouter) and device.driver is LteDriver.RUTOS:
            store = Store(self.request.state, is_rehearsal=self.request.rehearsed)
            unit = LteUnit(self.host, device, store, self.notify, target=self.request.targets.get(self.host.name))
            look = await asyncio.to_thread(rutos_read.read, unit.endpoint)
            self._traffic.append(Traffic(look.requests, look.sent_bytes, look.received_bytes))
            return self._result(rutos.judge(look))
        plain_endpoint = endpoint_of(self.host, get_managed_device(self.inventory, self.host).access, self.request)
        endpoint = replace(plain_endpoint, opening=self._traffic.append)
        self._say(events.Stage.CONNECTING, "read-only")
        answers = await verify.read(endpoint)
        if self.tries:
            self._say(events.Stage.VERIFYING, "testing with scratch rows in safe mode")
            answers = answers.with_findings(await verify.try_out(endpoint))
        if self.silence:
            self._say(events.Stage.WAITING, "testing a silent session: the device should notice within twelve minutes")
            answers = answers.with_findings([await verify.fall_silent(endpoint)])
        return self._result(answers)

    def _result(self, answers: verify.SeenAnswers) -> VerifiedDevice:
        self._say(events.Stage.DONE, "verified")
        total = Traffic.total(self._traffic)
        now, was_tried, is_rehearsal = datetime.now(UTC), self.tries or self.silence, self.request.rehearsed
        return VerifiedDevice(self.host.name, answers, was_tried, is_rehearsal, now, total.round_trips, total.bytes)

    def _say(self, stage: events.Stage, message: str) -> None:
        self.notify(events.Event(self.host.name, stage, message))


def write_report(device: VerifiedDevice, state: Path) -> VerifiedDevice:
    """Save the report in the state directory: no address, no secret, and no name but the device's."""
    folder = paths.private_directory(state / "verify")
    file = folder / f"{device.device}-{device.at:%Y%m%dT%H%M%SZ}.json"
    result = replace(device, file=file)
    write_atomically(file, f"{json.dumps(device.as_json(), ensure_ascii=False, indent=1)}\n".encode())
    return result
