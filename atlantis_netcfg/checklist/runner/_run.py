"""One turn of a checklist: all open items are requested at once, and judged as results arrive.

Checked before sending: a probe's requests must be in the allow-lists, and go only to targets in the inventory.
"""

from __future__ import annotations

import asyncio
import time
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.checklist import probes, report
from atlantis_netcfg.checklist.probes.registry import find_refusal
from atlantis_netcfg.checklist.runner.results import trouble_answer
from atlantis_netcfg.core.crash_report import InternalError, report_crash
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.core.paths import state_dir
from atlantis_netcfg.core.reading_programs import is_allowed
from atlantis_netcfg.inventory.model import REFLECTOR_PORT, ServerComputer

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from atlantis_netcfg.checklist import PlanEntry
    from atlantis_netcfg.checklist.runner._real import ProbeTransport
    from atlantis_netcfg.links.status import Query


READING: Final = frozenset({"print", "monitor", "info", "show-capabilities"})
"""Commands of RouterOS' API that change nothing; `monitor` is run once."""
PINGS: Final = frozenset({"/tool/ping"})
"""Also allowed if the count is given; RouterOS' command tree has no `/ping` in its root since 7.23."""
_LONGEST_S: Final = 900.0
_MOST_MESSAGES: Final = 5


def unfit(entry: PlanEntry, questions: Sequence[probes.Question]) -> str | None:
    """Return why requests must not be sent; None if they may."""
    names = [question.name for question in questions]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        return msg(f"two requests have the name `{arg(twice)}`")
    return next((reason for request in questions if (reason := _refusal_reason(entry, request)) is not None), None)


def _refusal_reason(entry: PlanEntry, question: probes.Question) -> str | None:
    if isinstance(question, probes.RunProgram) and not is_allowed(question.argv):
        return msg(f"`{arg(' '.join(question.argv))}` is not on the list of read-only programs")
    if isinstance(question, probes.RouterOsQuery) and not _is_reading_query(question.query):
        return msg(f"`{arg(question.query.path)}` is not a read-only command")
    if isinstance(question, probes.Listen):
        return _elsewhere(entry.cell, question) or find_refusal(
            question, active=entry.item.kind is report.ItemKind.ACTIVE
        )
    timed_types = (
        probes.DhcpDiscoverRequest | probes.RouterSolicitRequest | probes.DdsDiscoverRequest | probes.ReflectRequest
    )
    if isinstance(question, timed_types) and question.within_s > _LONGEST_S:
        return "it would take too long"
    if isinstance(question, probes.ReflectRequest):
        return _not_ours(entry.cell, question)
    return _foreign(entry.cell, question) if isinstance(question, probes.DdsDiscoverRequest) else None


def _is_reading_query(query: Query) -> bool:
    arguments = dict(query.arguments)
    if query.path in PINGS:
        return arguments.get("count", "").isdecimal()
    return query.command in READING and (query.command != "monitor" or "once" in arguments)


def _elsewhere(cell: probes.Cell, listen: probes.Listen) -> str | None:
    """Return a refusal if a port or device to listen to is not in the inventory."""
    if listen.transport == "tcp" and listen.address not in {str(address) for address in _known_addresses(cell)}:
        return msg(
            f"the address {arg(listen.address or 'that it requests')} is not in the inventory of {arg(cell.site)}"
        )
    if listen.transport == "serial" and listen.device not in {
        str(of_endpoint) for of_endpoint in _of_endpoints(cell, "device")
    }:
        return msg(f"the serial port {arg(listen.device)} is not in the inventory")
    if listen.transport == "udp" and listen.port not in set(_of_endpoints(cell, "port")):
        return msg(f"the UDP port {arg(listen.port)} is not in the inventory")
    return None


def _foreign(cell: probes.Cell, question: probes.DdsDiscoverRequest) -> str | None:
    """Return a refusal unless participants are sought at the computer's own address, in the inventory's domain."""
    local = cell.gateway.device if cell.gateway is not None else None
    if question.address not in {str(getattr(local, name, None)) for name in ("address", "vpn_address")}:
        return msg(f"the address {arg(question.address)} is not that of the gateway computer of {arg(cell.site)}")
    dds = cell.inventory.pilot.dds
    return None if dds is not None and dds.domain == question.domain else "it is not the DDS domain of the inventory"


def _not_ours(cell: probes.Cell, question: probes.ReflectRequest) -> str | None:
    """Return a refusal unless messages go to the reflector port of a gateway or control centre."""
    if question.count > _MOST_MESSAGES:
        return "it would send too much"
    computers = [host.device for host in cell.inventory.hosts.values() if isinstance(host.device, ServerComputer)]
    if question.address in {str(computer.vpn_address) for computer in computers} and question.port == REFLECTOR_PORT:
        return None
    return msg(f"{arg(question.address)}, UDP port {arg(question.port)}, is not a gateway or control centre in the VPN")


def _known_addresses(cell: probes.Cell) -> Iterator[object]:
    yield from (reservation.address for reservation in cell.site_config.lan.reservations)
    yield from _of_endpoints(cell, "address")
    for vehicle in cell.inventory.vehicles:
        place = type(cell)(cell.inventory, cell.site, vehicle, cell.endpoint)
        yield from filter(None, (place.address(None),))
    for host in cell.inventory.site_hosts(cell.site):
        yield getattr(host.device, "address", None)


def _of_endpoints(cell: probes.Cell, field: str) -> Iterator[object]:
    """Yield a field of all endpoints of the site and its vehicles."""
    rows = (*(vehicle.endpoints for vehicle in cell.inventory.vehicles.values()), cell.site_config.location.endpoints)
    for row in rows:
        for column in type(row).model_fields:
            value = getattr(getattr(row, column), field, None)
            if value is not None:
                yield value


LIMIT_S: Final = 1800.0
"""Limit for a place that does not return by itself; its transport has limits of its own, far below this one."""
_OURS: Final = "this is a bug in this program, not a mistake of yours: please report it"


def utc_now() -> datetime:
    """Return the current time, for items."""
    return datetime.now(UTC)


@dataclass(slots=True, eq=False)
class _Open:
    """An open item, its requests, and the results so far."""

    entry: PlanEntry
    questions: tuple[probes.Question, ...] = ()
    answers: dict[str, probes.Answer] = field(default_factory=dict)
    fault: BaseException | None = None
    unfit: str | None = None

    @property
    def waits(self) -> bool:
        return self.fault is None and self.unfit is None and len(self.answers) < len(self.questions)


@dataclass(slots=True)
class _PlaceBatch:
    """The requests of one place in one turn; identical ones of several items are sent once."""

    place: probes.Place
    host: str | None
    key_by_question: dict[probes.Question, str] = field(default_factory=dict)
    """Request without its name -> its key."""
    wait: dict[str, list[tuple[_Open, str]]] = field(default_factory=dict)
    """Key -> items that wait for the response, each with its own name for it."""

    def add(self, item: _Open, question: probes.Question) -> None:
        """Add a request, unless an identical one exists."""
        plain = replace(question, name="")
        key = self.key_by_question.setdefault(plain, f"{item.entry.item.id}#{question.name}")
        self.wait.setdefault(key, []).append((item, question.name))

    @property
    def questions(self) -> list[tuple[str, probes.Question]]:
        """Requests with their keys, in the order of the items; each named as in the first item that needs it."""
        return [(key, replace(question, name=key.rpartition("#")[2])) for question, key in self.key_by_question.items()]


async def examine(
    entries: Sequence[PlanEntry],
    ears: ProbeTransport,
    on_settle: Callable[[report.Item], None],
    *,
    now: Callable[[], datetime] = utc_now,
    state: Callable[[], Path] = state_dir,
) -> tuple[report.Item, ...]:
    """Run all requests of all entries at once, judge each item when its results are complete, and return the items.

    Entries without a probe, and those that do not apply, are returned unchanged; a settled one is checked again.
    Passing an active entry means that a person has consented. `on_settle` is called once per item, in the order of
    judgement; `state` is the folder of the log file for the traceback of a probe that crashes: such an item is ERROR.
    Only exceptions of `on_settle` are raised; they cancel the rest.
    """
    turn = _Turn(ears, now, state)
    todo = [turn.open_item(entry) for entry in entries if entry.step.probe is not None and not entry.step.unless]
    items = {}
    work = [asyncio.create_task(turn.ask(batch)) for batch in _batches(todo)]
    try:
        for _ in todo:
            item = turn.judge_item(await turn.ready.get())
            items[item.id] = item
            on_settle(item)
    finally:
        for task in work:
            task.cancel()
        await asyncio.gather(*work, return_exceptions=True)
    return tuple(items.get(entry.item.id, entry.item) for entry in entries)


def _batches(todo: Iterable[_Open]) -> list[_PlaceBatch]:
    """Group requests by place: the gateway, this computer, each router, and all routers together for the links."""
    batches: dict[tuple[probes.Place, str | None], _PlaceBatch] = {}
    for item in todo:
        for question in item.questions if item.waits else ():
            host = question.host if isinstance(question, probes.RouterOsQuery) else None
            batches.setdefault((question.place, host), _PlaceBatch(question.place, host)).add(item, question)
    return list(batches.values())


@dataclass(slots=True)
class _Turn:
    ears: ProbeTransport
    now: Callable[[], datetime]
    state: Callable[[], Path]
    ready: asyncio.Queue[_Open] = field(default_factory=asyncio.Queue)
    """Items whose last response has arrived, or that have failed."""
    began: float = field(default_factory=time.monotonic)
    faults: dict[BaseException, InternalError] = field(default_factory=dict)

    def open_item(self, entry: PlanEntry) -> _Open:
        """Get a probe's requests, and check them before they are sent."""
        item = _Open(entry)
        assert entry.step.probe is not None  # noqa: S101 - `examine` has looked
        try:
            item.questions = tuple(entry.step.probe.asks())
            hash(item.questions)  # identical ones are found by it
            item.unfit = unfit(entry, item.questions)
        except Exception as fault:  # noqa: BLE001 - the other items go on
            item.fault = fault
        if not item.waits:
            self.ready.put_nowait(item)
        return item

    async def ask(self, batch: _PlaceBatch) -> None:
        """Run the requests of a place; afterwards each request has a result, or its item a fault."""
        questions = batch.questions
        try:
            async with asyncio.timeout(LIMIT_S) as limit:
                answers = await self.ears.ask(
                    batch.place, batch.host, questions, lambda key, answer: self._deliver_answers(batch, {key: answer})
                )
        except Exception as fault:  # noqa: BLE001 - the other places go on
            if limit.expired():
                late = msg(f"no response within {arg(LIMIT_S):g} s")
                self._deliver_answers(batch, {key: trouble_answer(question, late) for key, question in questions})
            for item, _ in (waiter for waiters in batch.wait.values() for waiter in waiters):
                self._fail(item, fault)
            return
        rest = {key: trouble_answer(question, "no response") for key, question in questions if key not in answers}
        self._deliver_answers(batch, {**rest, **answers})

    def judge_item(self, item: _Open) -> report.Item:
        """Judge an item whose results are complete."""
        try:
            if item.fault is not None:
                raise item.fault  # noqa: TRY301 - it is told as any fault is
            if item.unfit is not None:
                return self._error_item(
                    item, "not-allowed", msg(f"this probe requests what is not allowed: {arg(item.unfit)}"), _OURS
                )
            assert item.entry.step.probe is not None  # noqa: S101 - `examine` has looked
            result = item.entry.step.probe.judge(item.answers)
        except Exception as fault:  # noqa: BLE001 - the other items go on
            crash = self._record_crash(fault, item.entry.item.id)
            return self._error_item(item, "crashed", str(crash), crash.hint)
        if not result.findings:
            return self._error_item(item, "no-verdict", "this probe gave no verdict", _OURS)
        return self._settle(item, result)

    def _record_crash(self, fault: BaseException, name: str) -> InternalError:
        """Write one log file per fault, however many items it affects."""
        if fault not in self.faults:
            self.faults[fault] = report_crash(fault, msg(f"checking {arg(name)}"), self.state)
        return self.faults[fault]

    def _deliver_answers(self, batch: _PlaceBatch, answers: Mapping[str, probes.Answer]) -> None:
        for key, answer in answers.items():
            for item, name in batch.wait.get(key, ()):
                if item.waits and name not in item.answers:
                    item.answers[name] = answer
                    if not item.waits:
                        self.ready.put_nowait(item)

    def _fail(self, item: _Open, fault: BaseException) -> None:
        if item.waits:
            item.fault = fault
            self.ready.put_nowait(item)

    def _error_item(self, item: _Open, code: str, message: str, hint: str | None) -> report.Item:
        finding = report.ItemFinding(verdict=Verdict.ERROR, code=code, message=message, hint=hint)
        return self._item(item, Verdict.ERROR, (finding,))

    def _settle(self, item: _Open, result: probes.ProbeResult) -> report.Item:
        findings = tuple(report.ItemFinding(**each.as_dict()) for each in result.findings)
        return self._item(item, result.verdict, findings).model_copy(update={"evidence": tuple(result.evidence)})

    def _item(self, item: _Open, verdict: Verdict, findings: tuple[report.ItemFinding, ...]) -> report.Item:
        """Return the item with its verdict; message and hint come from the first of the worst findings."""
        worst = next(finding for finding in findings if finding.verdict is verdict)
        return item.entry.item.model_copy(
            update={
                "open": False,
                "verdict": verdict,
                "message": worst.message,
                "hint": worst.hint,
                "findings": findings,
                "at": self.now(),
                "seconds": round(time.monotonic() - self.began, 1),
            }
        )
