"""Run the test of the allow-list, from the first reading of the counters to the result."""

from __future__ import annotations

import asyncio
from contextlib import asynccontextmanager
from dataclasses import dataclass, field, replace
from math import ceil
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core.errors import DeviceError, ExitCode, NetcfgError, OutcomeUnknown, complete
from atlantis_netcfg.core.events import Event, Stage, Subscriber, Verdict
from atlantis_netcfg.inventory.satellite_allow_list import far_end
from atlantis_netcfg.links import BearerFinding
from atlantis_netcfg.links.policy import BearerRoute, active_bearer
from atlantis_netcfg.links.satellite import (
    FACTORY_ADDRESSES,
    WINDOW_S,
    Attempt,
    ExpectedOutcome,
    ProbeOutcome,
    SatelliteProbe,
    judge_attempt,
    judge_factory_address,
)
from atlantis_netcfg.operations.allow_list_test.plan import (
    BUDGET_BYTES,
    MARK,
    TEMPORARY_ROWS,
    VPN_BYTES,
    NameReading,
    Task,
    expected_bytes,
    factory_ping,
    has_answer,
    ping,
    read,
    reading_bytes,
    reads,
    session_bytes,
    tasks,
)
from atlantis_netcfg.routeros.api import Command, Reply, Session
from atlantis_netcfg.routeros.estimate import HANDSHAKE_BYTES, HEADERS, on_the_wire
from atlantis_netcfg.routeros.safe_mode import RELEASE, UNROLL, ApiSafeMode, SafeModeUnavailable

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Awaitable, Callable, Collection, Iterable, Iterator, Mapping, Sequence

    from atlantis_netcfg.inventory.model import Bearer, Pilot
    from atlantis_netcfg.operations.allow_list_test.vpn import VpnQuestion


_FILTER = "/ip/firewall/filter"


@asynccontextmanager
async def temporarily(session: Session, rows: Sequence[Command]) -> AsyncIterator[None]:
    """Have these rows (`…/add` commands, marked by `MARK`) on the router while the context lasts.

    Raises DeviceFailed with the router as it was, or OutcomeUnknown if it does not say that the rows are gone.
    """
    await _take(session)
    replies: list[Reply] = []
    try:
        replies = await session.flight(rows)
        for reply in replies:
            reply.check()
        yield
    finally:
        await _close(session, rows, replies)


def filter_rows(reading: NameReading, chains: tuple[str, str], address: str) -> tuple[Command, ...]:
    """Rows that let ICMP to and from one host pass both chains, ahead of all others. Raises DeviceFailed."""
    words = (("action", "return"), ("comment", MARK), ("protocol", "icmp"))
    out = (("chain", chains[0]), ("dst-address", address), ("place-before", _first(reading, chains[0])))
    back = (("chain", chains[1]), ("src-address", address), ("place-before", _first(reading, chains[1])))
    return (
        Command(f"{_FILTER}/add", (*out, *words)),
        Command(f"{_FILTER}/add", (*back, *words, ("connection-state", "established"))),
    )


async def _take(session: Session) -> None:
    try:
        await ApiSafeMode().take(session)
    except SafeModeUnavailable as unavailable:
        raise DeviceError(
            f"safe mode could not be taken, so nothing was changed for the proof: {unavailable.reason}",
            hint="it needs RouterOS 7.18 or later, and nobody else may hold it",
        ) from unavailable


def _first(reading: NameReading, chain: str) -> str:
    rows = reading.chain(chain)
    if not rows or ".id" not in rows[0]:
        raise DeviceError(f"the router has no chain {chain}: provision the site first")
    return rows[0][".id"]


def _menu(command: Command) -> str:
    return command.path.removesuffix("/add")


async def _close(session: Session, rows: Sequence[Command], replies: Sequence[Reply]) -> None:
    """Remove the rows, see that none is left, and only then let safe mode go; otherwise everything is unrolled."""
    there = zip(rows, replies, strict=False)
    removals = [Command(f"{_menu(row)}/remove", ((".id", reply.ret),)) for row, reply in there if reply.ret is not None]
    await session.flight(removals)
    if await _is_clean(session, rows):
        await session.flight([RELEASE])
        return
    await session.flight([UNROLL])
    if not await _is_clean(session, rows):
        raise OutcomeUnknown(
            "the router does not say that the rows of the proof are gone",
            hint=f"remove the rows that say `{MARK}`; or run the site, which removes them, too: `provision site=…`",
        )


async def _is_clean(session: Session, rows: Sequence[Command]) -> bool:
    menus = dict.fromkeys(_menu(row) for row in rows)
    commands = [Command(f"{menu}/print", ((".proplist", ".id"),), (f"?comment={MARK}",)) for menu in menus]
    return all(reply.trap is None and not reply.rows for reply in await session.flight(commands))


RULES = Command("/routing/rule/print", ((".proplist", ".id"),))
"""The first of them is where ours goes."""
STATUS = Command("/tool/netwatch/print", ((".proplist", "host,port,status"),), (f"?comment={MARK}",))
_INTERVAL, _PATIENCE = "10s", "8s"


def rows(todo: Sequence[Task], bearer: Bearer, rules: Reply, *, active: bool, source: str = "") -> tuple[Command, ...]:
    """What has to be on the router to ask these targets; nothing that it has already moves but the time.

    `source`: the address of this computer, where it asks.
    """
    return (*_connections(todo, bearer), *(() if active else _ways(todo, bearer, rules, source)))


def _connections(todo: Sequence[Task], bearer: Bearer) -> Iterator[Command]:
    for task in todo:
        if task.probe is SatelliteProbe.TCP:
            where = (("host", task.address), ("port", str(task.port)), ("src-address", str(bearer.address)))
            pace = (("interval", _INTERVAL), ("timeout", _PATIENCE), ("thr-tcp-conn-time", _PATIENCE))
            yield Command("/tool/netwatch/add", (("type", "tcp-conn"), ("comment", MARK), *where, *pace))


def _ways(todo: Sequence[Task], bearer: Bearer, rules: Reply, source: str) -> Iterator[Command]:
    first = next((("place-before", row[".id"]) for row in rules.check().rows if ".id" in row), None)
    for task in todo:
        if task.probe in TEMPORARY_ROWS:
            where: tuple[tuple[str, str], ...] = (
                ("dst-address", f"{task.address}/32"),
                ("table", f"via-{bearer.name}"),
            )
            # Only what netwatch sends from the link's own address, or this computer from its own.
            if sender := {SatelliteProbe.TCP: str(bearer.address), SatelliteProbe.VPN: source}.get(task.probe):
                where = (("src-address", f"{sender}/32"), *where)
            words = (("action", "lookup-only-in-table"), ("comment", MARK), *where)
            yield Command("/routing/rule/add", (*words, first) if first is not None else words)


async def ask_now(session: Session) -> None:
    """Switch the time client off and on. Raises Refused; safe mode takes back what was half done."""
    for state in ("no", "yes"):
        (await session.command(Command("/system/ntp/client/set", (("enabled", state),)))).check()


def find_connected_tasks(todo: Sequence[Task], status: Reply) -> set[Task]:
    """The TCP targets to which a connection came up."""
    up = {(row.get("host"), row.get("port")) for row in status.check().rows if row.get("status") == "up"}
    return {task for task in todo if task.probe is SatelliteProbe.TCP and (task.address, str(task.port)) in up}


def outcome(
    task: Task, answering_tasks: Collection[Task], before: NameReading, now: NameReading, chains: tuple[str, str]
) -> tuple[ProbeOutcome, str]:
    """What was seen of one of these targets; `chains`: of what goes out, and of what comes back.

    An answer proves something of the satellite only where the question went out over it.
    """
    out, back = chains
    was_sent = now.went_out(out, task, before)
    is_counted = task not in answering_tasks or now.answers(back, task) > before.answers(back, task)
    elsewhere = task.probe is SatelliteProbe.TCP and was_sent is False
    if elsewhere or (task.probe is SatelliteProbe.VPN and not (was_sent and is_counted)):
        how = "it answered" if task in answering_tasks else "it was asked"
        return ProbeOutcome.NOT_TRIED, f"{how}, but the router has counted nothing to it over the satellite"
    if task in answering_tasks:
        return ProbeOutcome.ANSWERED, ""
    if task.probe is SatelliteProbe.TIME and now.questions(out, task) <= before.questions(out, task):
        return ProbeOutcome.NOT_TRIED, "the time client did not ask it, although it was switched off and on"
    if task.expectation is ExpectedOutcome.REFUSED and now.drop_count(out) > before.drop_count(out):
        return ProbeOutcome.REFUSED_HERE, ""
    return ProbeOutcome.SILENT, ""


_BAD = (Verdict.FAIL, Verdict.ERROR)
_GOOD = (Verdict.PASS, Verdict.WARN)


@dataclass(frozen=True, slots=True)
class Proof:
    """Everything that was tried, judged, and counted."""

    site: str
    bearer: str
    active: bool
    """Whether the satellite carried the site's traffic meanwhile."""
    results: tuple[tuple[Attempt, BearerFinding], ...]
    findings: tuple[BearerFinding, ...]
    """Of the terminal and of names, which no probe has shown."""
    bytes_counted: int
    """By the router, on the satellite's port, both directions, whoever caused them."""
    budget_bytes: int
    kept_off: int
    """Packets that the filter has kept off the satellite since its rules were made."""
    turned_away: int
    """Packets that came in by the satellite and were dropped, since then."""
    carrier: str
    """The link that the session to the router goes over."""
    opening_bytes: int = 0
    """What was carried before the first count, TLS and an attempt that learnt the certificate included."""
    session_bytes: int = 0
    """All that was carried, as above."""
    sessions: int = 1
    """Connections to the router."""
    left_out: str = ""
    """What the satellite lets through and is not tried here, with the command that does."""

    @property
    def exit(self) -> ExitCode:
        """0 if everything was proved; 6 if anything failed or stays open; 7 if nothing was tried and nothing failed."""
        verdicts = [item.verdict for item in (*(finding for _, finding in self.results), *self.findings)]
        if any(verdict in _BAD for verdict in verdicts):
            return ExitCode.CHECKS_FAILED
        if all(attempt.outcome is ProbeOutcome.NOT_TRIED for attempt, _ in self.results):
            return ExitCode.NOTHING
        is_success = all(verdict in _GOOD for verdict in verdicts)
        return ExitCode.DONE if is_success else ExitCode.CHECKS_FAILED

    @property
    def vpn_answered(self) -> bool:
        """Whether the VPN server itself has answered over this link, which carried nothing else."""
        answer = SatelliteProbe.VPN, ProbeOutcome.ANSWERED
        return any((attempt.probe, attempt.outcome) == answer for attempt, _ in self.results)

    def as_json(self) -> dict[str, Any]:
        """The object that `--json` prints."""
        return {
            "site": self.site,
            "bearer": self.bearer,
            "exit": int(self.exit),
            "active": self.active,
            "targets": [_result(attempt, finding) for attempt, finding in self.results],
            "findings": [finding.as_dict() for finding in self.findings],
            "bytes_counted": self.bytes_counted,
            "budget_bytes": self.budget_bytes,
            "kept_off_packets": self.kept_off,
            "turned_away_packets": self.turned_away,
            "left_out": self.left_out,
        }

    def as_text(self) -> str:
        """The lines that a person reads."""
        return "\n".join(self._lines())

    def _lines(self) -> Iterable[str]:
        carries = "carries the traffic now" if self.active else "does not carry the traffic now"
        yield f"{self.site}, {self.bearer}: {carries}"
        for finding in (*(finding for _, finding in self.results), *self.findings):
            yield f"  {finding.verdict.value:<12} {finding.message}"
            if finding.hint:
                yield f"  {'':<12} {finding.hint}"
        if self.left_out:
            yield f"  {Verdict.SKIP.value:<12} {self.left_out}"
        tried_verdicts = [
            finding.verdict for attempt, finding in self.results if attempt.outcome is not ProbeOutcome.NOT_TRIED
        ]
        good_count = sum(verdict in _GOOD for verdict in tried_verdicts)
        yield (
            f"  {good_count} of {len(self.results)} targets proved, "
            f"{len(self.results) - len(tried_verdicts)} could not be tried"
        )
        traffic = f"{self.bytes_counted} bytes on the satellite's port meanwhile (asking stops at {self.budget_bytes})"
        yield f"  the router counted {traffic}; kept off {self.kept_off} packets, turned away {self.turned_away}"


def _result(attempt: Attempt, finding: BearerFinding) -> dict[str, Any]:
    return {
        "name": attempt.name,
        "target": attempt.target,
        "expected": attempt.expected_outcome.value,
        "probe": attempt.probe.value,
        "outcome": attempt.outcome.value,
        "after_s": attempt.after_s,
        "window_s": attempt.window_s,
        "filter_open": attempt.filter_open,
        **finding.as_dict(),
    }


_COUNTER_PROBES = (SatelliteProbe.UDP_COUNTER, SatelliteProbe.TUNNEL)
_END_TURNS = 2
"""What follows the last turn costs no more than so many: rows are removed, and the counters are read once more."""
_REFUSALS = 3
"""Echo requests to a target that the router's own filter should stop: each has to show in its drop counter."""


@dataclass(frozen=True, slots=True)
class ProofPace:
    """How often and how long silence is asked again, in seconds; a window below 90 s proves nothing about silence."""

    window_s: float = WINDOW_S
    every_s: float = 5.0
    sleep: Callable[[float], Awaitable[None]] = asyncio.sleep

    @property
    def rounds(self) -> int:
        """Turns of asking in a window; each asks once, and is over after `every_s`."""
        return max(1, round(self.window_s / self.every_s))


@dataclass(slots=True)
class Proving:
    """The satellite link of a site, and the session to its router."""

    pilot: Pilot
    site: str
    bearer: Bearer
    router: str
    """Name of the router, for progress."""
    port: str
    ways: Sequence[BearerRoute]
    terminal: str
    """Name of the terminal, for findings."""
    carrier: str
    """The link that the session to the router goes over."""
    open_filter: bool = False
    try_all: bool = False
    vpn: VpnQuestion | NetcfgError = field(default_factory=lambda: NetcfgError("nothing here can ask it"))
    """Who asks the VPN server over an idle link, or why nobody can."""
    pace: ProofPace = ProofPace()
    notify: Subscriber = lambda _event: None
    _attempts: list[Attempt] = field(default_factory=list)
    _start_bytes: int = 0
    _opening_bytes: int = 0

    @property
    def expected_bytes(self) -> int:
        """What the targets cost over the satellite at most, and the session to the router if it goes there too."""
        all_tasks = tasks(self.pilot, self.bearer, active=True, try_all=self.try_all)
        probes = expected_bytes(all_tasks, self.pace.rounds) + (VPN_BYTES if self.try_all else 0)
        if self.carrier != self.bearer.name:
            return min(BUDGET_BYTES, probes)
        always, by_turns = self._session()
        return min(BUDGET_BYTES, probes + ceil((1 + HEADERS) * by_turns)) + on_the_wire(always + HANDSHAKE_BYTES, 1)

    @property
    def session_bytes(self) -> int:
        """What the session to the router carries at most where it goes over another link."""
        return on_the_wire(sum(self._session()) + HANDSHAKE_BYTES, 1)

    def _session(self) -> tuple[int, int]:
        all_tasks = tasks(self.pilot, self.bearer, active=True, try_all=self.try_all)
        return session_bytes(all_tasks, self.pace.rounds, len(self.ways), open_filter=self.open_filter)

    @property
    def seconds(self) -> float:
        """How long it lasts at most, about."""
        all_tasks = tasks(self.pilot, self.bearer, active=True, try_all=self.try_all)
        opened_for = sum(
            1 for task in all_tasks if task.expectation is ExpectedOutcome.REFUSED and task.probe is SatelliteProbe.ICMP
        )
        temporary = any(task.probe in TEMPORARY_ROWS for task in all_tasks)
        return self.pace.window_s * (1 + (opened_for if self.open_filter else 0) + 2 * temporary)

    async def run(self, session: Session) -> Proof:
        """Try everything, and judge it. Raises DeviceFailed, OutcomeUnknown if the filter may still be open."""
        before = await self._read(session)
        self._start_bytes = before.port_bytes
        self._opening_bytes = session.traffic.bytes
        active = active_bearer(before.routes, self.ways) == self.bearer.name
        terminal = await self._terminal(session, before.port_name)
        all_tasks = [
            self._resolve_task(task) for task in tasks(self.pilot, self.bearer, active=active, try_all=self.try_all)
        ]
        for task in all_tasks:
            if task.probe is SatelliteProbe.NONE:
                attempt = _attempt(task, ProbeOutcome.NOT_TRIED, note=task.why_not)
                self._attempts.append(replace(attempt, hint=task.hint))
        alone = [task for task in all_tasks if task.probe not in (SatelliteProbe.NONE, *TEMPORARY_ROWS)]
        allowed_tasks = [task for task in alone if task.expectation is ExpectedOutcome.REACHED]
        self._attempts += await self._reach(session, allowed_tasks, before)
        for task in all_tasks:
            if task.expectation is ExpectedOutcome.REFUSED and task.probe is SatelliteProbe.ICMP:
                self._attempts.append(await self._refuse(session, task))
                if self.open_filter:
                    self._attempts.append(await self._beyond(session, task))
        temporary = [task for task in all_tasks if task.probe in TEMPORARY_ROWS]
        if temporary:
            self._attempts += await self._ask(session, temporary, active=active)
        after = await self._read(session)
        proof = self._proof(before, after, terminal, active=active)
        return replace(proof, session_bytes=session.traffic.bytes)

    def _resolve_task(self, task: Task) -> Task:
        """The task, or why this computer cannot ask the VPN server."""
        if task.probe is not SatelliteProbe.VPN or not isinstance(self.vpn, NetcfgError):
            return task
        return replace(task, probe=SatelliteProbe.NONE, why_not=str(self.vpn), hint=self.vpn.hint or "")

    def _proof(
        self, before: NameReading, after: NameReading, terminal: Sequence[BearerFinding], *, active: bool
    ) -> Proof:
        is_link_up = any(
            attempt.expected_outcome is ExpectedOutcome.REACHED and attempt.outcome is ProbeOutcome.ANSWERED
            for attempt in self._attempts
        )
        return Proof(
            site=self.site,
            bearer=self.bearer.name,
            active=active,
            results=tuple((item, self._judge(item, link_seen=is_link_up)) for item in self._attempts),
            findings=tuple(terminal),
            bytes_counted=after.port_bytes - before.port_bytes,
            budget_bytes=BUDGET_BYTES,
            kept_off=after.drop_count(self._chains[0]),
            turned_away=after.drop_count(self._chains[1]),
            carrier=self.carrier,
            opening_bytes=self._opening_bytes,
            left_out=self._left_out,
        )

    @property
    def _left_out(self) -> str:
        target = far_end(self.pilot)
        if target is None:
            return ""
        command = f"provision qualify site={self.site} link={self.bearer.name}"
        return f"{target.name} ({target.address} udp {target.port}): `{command}` tries it"

    def _judge(self, attempt: Attempt, *, link_seen: bool) -> BearerFinding:
        finding = judge_attempt(attempt, link_seen=link_seen)
        return replace(finding, hint=finding.hint and complete(finding.hint, site=self.site))

    @property
    def _chains(self) -> tuple[str, str]:
        return f"to-{self.bearer.name}", f"from-{self.bearer.name}"

    async def _read(self, session: Session) -> NameReading:
        return read(self.port, await session.flight(reads(self.port, self._chains)))

    async def _terminal(self, session: Session, port: str) -> tuple[BearerFinding, ...]:
        """Who answers on the port, on this side of the satellite: no airtime."""
        self._say("who answers on the terminal's port")
        there = ping(str(self.bearer.gateway), str(self.bearer.address), count=2)
        commands = [there, *(factory_ping(address, port) for address in FACTORY_ADDRESSES)]
        gateway, *factory = await session.flight(commands)
        if trap := next((reply.trap for reply in factory if reply.trap is not None), None):
            message = f"the router would not ask who is on {port}: {trap.message}"
            return (BearerFinding(Verdict.INCONCLUSIVE, "box-not-asked", message),)
        strangers = [address for address, reply in zip(FACTORY_ADDRESSES, factory, strict=True) if has_answer(reply)]
        return judge_factory_address(
            self.terminal,
            self.port,
            str(self.bearer.gateway),
            answers=has_answer(gateway),
            answers_at_factory=strangers[0] if strangers else None,
        )

    async def _reach(self, session: Session, todo: Sequence[Task], before: NameReading) -> list[Attempt]:
        """Ask all of them in each round until each has answered, the window is over, or the budget is used up."""
        answers: dict[Task, float] = {}
        waited_s, now = 0.0, before
        for turn in range(self.pace.rounds):
            remaining_tasks = [task for task in todo if task not in answers]
            if not remaining_tasks or (
                turn and self._is_spent(now if now is not before else await self._read(session))
            ):
                break
            self._say(f"{len(remaining_tasks)} allowed targets have not answered yet", turn, self.pace.rounds)
            pings = [task for task in remaining_tasks if task.probe is SatelliteProbe.ICMP]
            replies = await session.flight([ping(task.address, str(self.bearer.address)) for task in pings])
            answers.update({task: waited_s for task, reply in zip(pings, replies, strict=True) if has_answer(reply)})
            now = await self._read(session) if len(pings) < len(remaining_tasks) else now
            answers.update({task: waited_s for task in remaining_tasks if self._more(before, now, task)})
            if len(answers) < len(todo):
                await self.pace.sleep(self.pace.every_s)
                waited_s += self.pace.every_s
        return [self._allowed_attempt(task, answers.get(task), waited_s, before, now) for task in todo]

    def _more(self, before: NameReading, now: NameReading, task: Task) -> bool:
        chain = self._chains[1]
        return task.probe in (*_COUNTER_PROBES, SatelliteProbe.TIME) and now.answers(chain, task) > before.answers(
            chain, task
        )

    def _allowed_attempt(
        self, task: Task, after_s: float | None, waited_s: float, before: NameReading, now: NameReading
    ) -> Attempt:
        if after_s is not None:
            return replace(_attempt(task, ProbeOutcome.ANSWERED, window_s=waited_s), after_s=after_s)
        if task.probe not in _COUNTER_PROBES:
            return _attempt(task, ProbeOutcome.SILENT, window_s=waited_s)
        earlier = before.answers(self._chains[1], task)
        note = f"no answer of it was counted in {waited_s:.0f} s, {earlier} before that"
        if task.probe is SatelliteProbe.TUNNEL and now.tunnel_up is not False:
            # A tunnel that is up, or that hangs on another box, need not say anything for so long.
            return replace(
                _attempt(task, ProbeOutcome.SILENT, window_s=waited_s, note=note), probe=SatelliteProbe.UDP_COUNTER
            )
        return _attempt(task, ProbeOutcome.SILENT, window_s=waited_s, note=note)

    async def _refuse(self, session: Session, task: Task) -> Attempt:
        """Ask with the filter closed: the router's own drop counter says that nothing was sent."""
        self._say(f"{task.name}, which is to be refused")
        before = await self._read(session)
        reply = await session.command(ping(task.address, str(self.bearer.address), count=_REFUSALS))
        after = await self._read(session)
        if has_answer(reply):
            return _attempt(task, ProbeOutcome.ANSWERED)
        chain = self._chains[0]
        if after.drop_count(chain) - before.drop_count(chain) >= _REFUSALS:
            return _attempt(task, ProbeOutcome.REFUSED_HERE)
        return _attempt(task, ProbeOutcome.SILENT, note="the router's drop counter did not count it")

    async def _beyond(self, session: Session, task: Task) -> Attempt:
        """Ask with the filter open for this one host: does the terminal, or the network behind it, enforce anything."""
        self._say(f"{task.name}, with the router's filter open for it")
        reading = await self._read(session)
        waited_s, is_answered = 0.0, False
        async with temporarily(session, filter_rows(reading, self._chains, task.address)):
            for turn in range(self.pace.rounds):
                if turn and self._is_spent(await self._read(session)):
                    break
                is_answered = has_answer(await session.command(ping(task.address, str(self.bearer.address))))
                if is_answered:
                    break
                await self.pace.sleep(self.pace.every_s)
                waited_s += self.pace.every_s
        outcome = ProbeOutcome.ANSWERED if is_answered else ProbeOutcome.SILENT
        attempt = _attempt(task, outcome, window_s=waited_s)
        return replace(attempt, filter_open=True, after_s=waited_s if is_answered else None)

    async def _ask(self, session: Session, todo: Sequence[Task], *, active: bool) -> list[Attempt]:
        """Ask what needs rows on the router, all in one window; who is to be refused is asked to its end."""
        before = now = await self._read(session)
        answers: dict[Task, float] = {}
        waited_s, rounds = 0.0, self._affordable(before)
        pause_s = self.pace.rounds / rounds * self.pace.every_s
        server = next((task for task in todo if task.probe is SatelliteProbe.VPN), None)
        vpn = None if server is None or isinstance(self.vpn, NetcfgError) else self.vpn
        source = "" if vpn is None else vpn.source
        rule_rows = rows(todo, self.bearer, await session.command(RULES), active=active, source=source)
        async with temporarily(session, rule_rows):
            if any(task.probe is SatelliteProbe.TIME for task in todo):
                await ask_now(session)
            if server is not None and vpn is not None and (after_s := await vpn.answered_after_s()) is not None:
                answers[server] = after_s
            for turn in range(rounds):
                self._say(f"{len(todo) - len(answers)} targets by rows of a moment", turn, rounds)
                await self.pace.sleep(pause_s)
                waited_s += pause_s
                now = await self._read(session)
                answering_tasks = find_connected_tasks(todo, await session.command(STATUS))
                answering_tasks |= {task for task in todo if self._more(before, now, task)}
                answers = dict.fromkeys(answering_tasks, waited_s) | answers
                if len(answers) == len(todo) or self._is_spent(now):
                    break
        return [self._temporary_attempt(task, answers, waited_s, before, now) for task in todo]

    def _temporary_attempt(
        self, task: Task, answers: Mapping[Task, float], waited_s: float, before: NameReading, now: NameReading
    ) -> Attempt:
        result, note = outcome(task, answers, before, now, self._chains)
        return replace(_attempt(task, result, window_s=waited_s, note=note), after_s=answers.get(task))

    def _is_spent(self, now: NameReading) -> bool:
        """Whether the budget has no room for another turn and the end, whoever has used the satellite."""
        return now.port_bytes - self._start_bytes + (1 + _END_TURNS) * self._turn_bytes >= BUDGET_BYTES

    def _affordable(self, now: NameReading) -> int:
        """How many turns the budget has room for, with rows to be added and removed: at least one."""
        if not self._turn_bytes:
            return self.pace.rounds
        remaining_bytes = BUDGET_BYTES - VPN_BYTES - (now.port_bytes - self._start_bytes)
        return max(1, min(self.pace.rounds, remaining_bytes // self._turn_bytes - _END_TURNS))

    @property
    def _turn_bytes(self) -> int:
        """What a turn of asking carries over the satellite where the session to the router goes there as well."""
        if self.carrier != self.bearer.name:
            return 0
        all_tasks = tasks(self.pilot, self.bearer, active=True, try_all=self.try_all)
        return ceil((1 + HEADERS) * reading_bytes(all_tasks, len(self.ways)))

    def _say(self, message: str, step: int = 0, total: int = 0) -> None:
        self.notify(Event(self.router, Stage.VERIFYING, message, step, total))


def _attempt(task: Task, outcome: ProbeOutcome, *, window_s: float = 0.0, note: str = "") -> Attempt:
    return Attempt(task.name, task.target, task.expectation, task.probe, outcome, window_s=window_s, note=note)
