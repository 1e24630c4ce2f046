"""Execution of the allow-list test, from the first reading of the counters to the result."""

from __future__ import annotations

import asyncio
from contextlib import asynccontextmanager
from dataclasses import dataclass, field, replace
from math import ceil
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core import errors, events
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory.satellite_allow_list import far_end
from atlantis_netcfg.links import LinkFinding, satellite
from atlantis_netcfg.links.policy import LinkRoute, active_link
from atlantis_netcfg.operations.allow_list_test import plan
from atlantis_netcfg.routeros import api, estimate, safe_mode

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Awaitable, Callable, Collection, Iterable, Iterator, Mapping, Sequence

    from atlantis_netcfg.inventory.model import Link, Pilot
    from atlantis_netcfg.operations.allow_list_test.vpn import VpnQuestion


_FILTER = "/ip/firewall/filter"


@asynccontextmanager
async def temporary_rows(session: api.Session, rows: Sequence[api.Command]) -> AsyncIterator[None]:
    """Keep these rows (`…/add` commands, marked by `MARK`) on the router while the context lasts.

    Raises DeviceError with the router unchanged, or OutcomeUnknown if the removal of the rows is not confirmed.
    """
    await _take_safe_mode(session)
    replies: list[api.Reply] = []
    try:
        replies = await session.flight(rows)
        for reply in replies:
            reply.check()
        yield
    finally:
        await _close(session, rows, replies)


def filter_rows(reading: plan.CounterReading, chains: tuple[str, str], address: str) -> tuple[api.Command, ...]:
    """Return rows that admit ICMP to and from one host in both chains, before all other rules; raise DeviceError."""
    words = (("action", "return"), ("comment", plan.MARK), ("protocol", "icmp"))
    out = (("chain", chains[0]), ("dst-address", address), ("place-before", _first_rule_id(reading, chains[0])))
    back = (("chain", chains[1]), ("src-address", address), ("place-before", _first_rule_id(reading, chains[1])))
    return (
        api.Command(f"{_FILTER}/add", (*out, *words)),
        api.Command(f"{_FILTER}/add", (*back, *words, ("connection-state", "established"))),
    )


async def _take_safe_mode(session: api.Session) -> None:
    try:
        await safe_mode.ApiSafeMode().take(session)
    except safe_mode.SafeModeUnavailable as unavailable:
        raise errors.DeviceError(
            f"cannot enter safe mode, so nothing was changed for the test: {arg(unavailable.reason)}",
            hint="it needs RouterOS 7.18 or later, and no other session may hold it",
        ) from unavailable


def _first_rule_id(reading: plan.CounterReading, chain: str) -> str:
    rows = reading.chain(chain)
    if not rows or ".id" not in rows[0]:
        raise errors.DeviceError(f"the router has no chain {arg(chain)}: run provision for the site first")
    return rows[0][".id"]


def _menu(command: api.Command) -> str:
    return command.path.removesuffix("/add")


async def _close(session: api.Session, rows: Sequence[api.Command], replies: Sequence[api.Reply]) -> None:
    """Remove the rows, verify that none is left, then release safe mode; otherwise everything is rolled back."""
    there = zip(rows, replies, strict=False)
    removals = [
        api.Command(f"{_menu(row)}/remove", ((".id", reply.ret),)) for row, reply in there if reply.ret is not None
    ]
    await session.flight(removals)
    if await _is_clean(session, rows):
        await session.flight([safe_mode.RELEASE])
        return
    await session.flight([safe_mode.UNROLL])
    if not await _is_clean(session, rows):
        raise errors.OutcomeUnknown(
            "the router does not confirm that the test rows are removed",
            hint=(
                f"remove the rows with comment `{arg(plan.MARK)}`, or run the site, which also removes them: "
                "`provision site=…`"
            ),
        )


async def _is_clean(session: api.Session, rows: Sequence[api.Command]) -> bool:
    menus = dict.fromkeys(_menu(row) for row in rows)
    commands = [api.Command(f"{menu}/print", ((".proplist", ".id"),), (f"?comment={plan.MARK}",)) for menu in menus]
    return all(reply.trap is None and not reply.rows for reply in await session.flight(commands))


RULES = api.Command("/routing/rule/print", ((".proplist", ".id"),))
"""Reads the routing rules; temporary rules are placed before the first."""
STATUS = api.Command("/tool/netwatch/print", ((".proplist", "host,port,status"),), (f"?comment={plan.MARK}",))
_INTERVAL, _PATIENCE = "10s", "8s"


def rows(
    todo: Sequence[plan.Task], link: Link, rules: api.Reply, *, active: bool, source: str = ""
) -> tuple[api.Command, ...]:
    """Return the rows needed to probe these targets; existing traffic keeps its route, except time requests.

    `source`: the address of this computer, if it sends the request.
    """
    return (*_netwatch_commands(todo, link), *(() if active else _route_rule_commands(todo, link, rules, source)))


def _netwatch_commands(todo: Sequence[plan.Task], link: Link) -> Iterator[api.Command]:
    for task in todo:
        if task.probe is satellite.SatelliteProbe.TCP:
            where = (("host", task.address), ("port", str(task.port)), ("src-address", str(link.address)))
            pace = (("interval", _INTERVAL), ("timeout", _PATIENCE), ("thr-tcp-conn-time", _PATIENCE))
            yield api.Command("/tool/netwatch/add", (("type", "tcp-conn"), ("comment", plan.MARK), *where, *pace))


def _route_rule_commands(todo: Sequence[plan.Task], link: Link, rules: api.Reply, source: str) -> Iterator[api.Command]:
    first = next((("place-before", row[".id"]) for row in rules.check().rows if ".id" in row), None)
    for task in todo:
        if task.probe in plan.TEMPORARY_ROWS:
            where: tuple[tuple[str, str], ...] = (
                ("dst-address", f"{task.address}/32"),
                ("table", f"via-{link.name}"),
            )
            # Only what netwatch sends from the link's own address, or this computer from its own.
            if sender := {satellite.SatelliteProbe.TCP: str(link.address), satellite.SatelliteProbe.VPN: source}.get(
                task.probe
            ):
                where = (("src-address", f"{sender}/32"), *where)
            words = (("action", "lookup-only-in-table"), ("comment", plan.MARK), *where)
            yield api.Command("/routing/rule/add", (*words, first) if first is not None else words)


async def ask_now(session: api.Session) -> None:
    """Restart the time client so that it sends a request; raise CommandError, and safe mode undoes the change."""
    for state in ("no", "yes"):
        (await session.command(api.Command("/system/ntp/client/set", (("enabled", state),)))).check()


def find_connected_tasks(todo: Sequence[plan.Task], status: api.Reply) -> set[plan.Task]:
    """Return the TCP targets to which a connection was established."""
    up = {(row.get("host"), row.get("port")) for row in status.check().rows if row.get("status") == "up"}
    return {
        task for task in todo if task.probe is satellite.SatelliteProbe.TCP and (task.address, str(task.port)) in up
    }


def outcome(
    task: plan.Task,
    answering_tasks: Collection[plan.Task],
    before: plan.CounterReading,
    now: plan.CounterReading,
    chains: tuple[str, str],
) -> tuple[satellite.ProbeOutcome, str]:
    """Return a target's outcome; `chains` are those of outgoing packets and of responses.

    A response proves something about the satellite only if the request was sent over it.
    """
    out, back = chains
    was_sent = now.went_out(out, task, before)
    is_counted = task not in answering_tasks or now.answers(back, task) > before.answers(back, task)
    elsewhere = task.probe is satellite.SatelliteProbe.TCP and was_sent is False
    if elsewhere or (task.probe is satellite.SatelliteProbe.VPN and not (was_sent and is_counted)):
        how = "it responded" if task in answering_tasks else "it was contacted"
        return satellite.ProbeOutcome.NOT_TRIED, msg(
            f"{arg(how)}, but the router counted no traffic to it over the satellite"
        )
    if task in answering_tasks:
        return satellite.ProbeOutcome.ANSWERED, ""
    if task.probe is satellite.SatelliteProbe.TIME and now.questions(out, task) <= before.questions(out, task):
        return satellite.ProbeOutcome.NOT_TRIED, "the time client sent no request, although it was restarted"
    if task.expectation is satellite.ExpectedOutcome.REFUSED and now.drop_count(out) > before.drop_count(out):
        return satellite.ProbeOutcome.REFUSED_HERE, ""
    return satellite.ProbeOutcome.SILENT, ""


_BAD = (events.Verdict.FAIL, events.Verdict.ERROR)
_GOOD = (events.Verdict.PASS, events.Verdict.WARN)


@dataclass(frozen=True, slots=True)
class Proof:
    """The result of an allow-list test: attempts, verdicts, and counted bytes."""

    site: str
    link: str
    active: bool
    """Whether the satellite carried the site's traffic during the test."""
    results: tuple[tuple[satellite.Attempt, LinkFinding], ...]
    findings: tuple[LinkFinding, ...]
    """Findings about the terminal and DNS names, which no probe shows."""
    bytes_counted: int
    """Bytes on the satellite's port in both directions by the router's count, including other traffic."""
    budget_bytes: int
    kept_off: int
    """Packets that the filter blocked towards the satellite since its rules were created."""
    turned_away: int
    """Packets from the satellite that the filter dropped since its rules were created."""
    carrier: str
    """Link that carries the session to the router."""
    opening_bytes: int = 0
    """Bytes of the session before the first counter reading, with TLS and an attempt to learn the certificate."""
    session_bytes: int = 0
    """All bytes of the session, counted in the same way."""
    sessions: int = 1
    """Number of connections to the router."""
    left_out: str = ""
    """What the satellite lets through and this test does not cover, with the command that does."""

    @property
    def exit(self) -> errors.ExitCode:
        """The exit code: 0 if all is proved, 6 if anything failed or is open, 7 if nothing was tested or failed."""
        verdicts = [item.verdict for item in (*(finding for _, finding in self.results), *self.findings)]
        if any(verdict in _BAD for verdict in verdicts):
            return errors.ExitCode.CHECKS_FAILED
        if all(attempt.outcome is satellite.ProbeOutcome.NOT_TRIED for attempt, _ in self.results):
            return errors.ExitCode.NOTHING
        is_success = all(verdict in _GOOD for verdict in verdicts)
        return errors.ExitCode.DONE if is_success else errors.ExitCode.CHECKS_FAILED

    @property
    def vpn_answered(self) -> bool:
        """Whether the VPN server responded over this link while it carried no other traffic."""
        answer = satellite.SatelliteProbe.VPN, satellite.ProbeOutcome.ANSWERED
        return any((attempt.probe, attempt.outcome) == answer for attempt, _ in self.results)

    def as_json(self) -> dict[str, Any]:
        """Return the object that `--json` prints."""
        return {
            "site": self.site,
            "bearer": self.link,
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
        """Return the report as text."""
        return join("\n", self._lines())

    def _lines(self) -> Iterable[str]:
        carries = "is the active link" if self.active else "is not the active link"
        yield msg(f"{arg(self.site)}, {arg(self.link)}: {arg(carries)}")
        for finding in (*(finding for _, finding in self.results), *self.findings):
            yield msg(f"  {arg(finding.verdict.value):<12} {arg(finding.message)}")
            if finding.hint:
                yield msg(f"  {'':<12} {arg(finding.hint)}")
        if self.left_out:
            yield msg(f"  {arg(events.Verdict.SKIP.value):<12} {arg(self.left_out)}")
        tried_verdicts = [
            finding.verdict
            for attempt, finding in self.results
            if attempt.outcome is not satellite.ProbeOutcome.NOT_TRIED
        ]
        good_count = sum(verdict in _GOOD for verdict in tried_verdicts)
        yield msg(
            f"  {arg(good_count)} of {arg(len(self.results))} targets proved, "
            f"{arg(len(self.results) - len(tried_verdicts))} could not be tested"
        )
        traffic = msg(
            f"{arg(self.bytes_counted)} bytes on the satellite port during the test (limit {arg(self.budget_bytes)})"
        )
        yield msg(
            f"  the router counted {arg(traffic)}; blocked {arg(self.kept_off)} packets, dropped "
            f"{arg(self.turned_away)}"
        )


def _result(attempt: satellite.Attempt, finding: LinkFinding) -> dict[str, Any]:
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


_COUNTER_PROBES = (satellite.SatelliteProbe.UDP_COUNTER, satellite.SatelliteProbe.TUNNEL)
_END_TURNS = 2
"""Maximum cost after the last turn, in turns: rows are removed, and the counters are read once more."""
_REFUSALS = 3
"""Echo requests to a target that the router's own filter should block: its drop counter must count each of them."""


@dataclass(frozen=True, slots=True)
class ProofPace:
    """Interval and duration of repeated probes, in seconds; less than 90 s proves nothing about silence."""

    window_s: float = satellite.WINDOW_S
    every_s: float = 5.0
    sleep: Callable[[float], Awaitable[None]] = asyncio.sleep

    @property
    def rounds(self) -> int:
        """The number of probe rounds in a window; each lasts `every_s`."""
        return max(1, round(self.window_s / self.every_s))


@dataclass(slots=True)
class Proving:
    """The test of a site's satellite link over a session to its router."""

    pilot: Pilot
    site: str
    link: Link
    router: str
    """Name of the router, for progress messages."""
    port: str
    ways: Sequence[LinkRoute]
    terminal: str
    """Name of the terminal, for findings."""
    carrier: str
    """Link that carries the session to the router."""
    open_filter: bool = False
    try_all: bool = False
    vpn: VpnQuestion | errors.NetcfgError = field(
        default_factory=lambda: errors.NetcfgError("no test is available for it")
    )
    """Request to the VPN server over an idle link, or the error that says why it is not possible."""
    pace: ProofPace = ProofPace()
    notify: events.Subscriber = lambda _event: None
    _attempts: list[satellite.Attempt] = field(default_factory=list)
    _start_bytes: int = 0
    _opening_bytes: int = 0

    @property
    def expected_bytes(self) -> int:
        """Upper limit of bytes over the satellite, with the session to the router if that uses it too."""
        all_tasks = plan.tasks(self.pilot, self.link, active=True, try_all=self.try_all)
        probes = plan.expected_bytes(all_tasks, self.pace.rounds) + (plan.VPN_BYTES if self.try_all else 0)
        if self.carrier != self.link.name:
            return min(plan.BUDGET_BYTES, probes)
        always, by_turns = self._session_bytes()
        return min(plan.BUDGET_BYTES, probes + ceil((1 + estimate.HEADERS) * by_turns)) + estimate.on_the_wire(
            always + estimate.HANDSHAKE_BYTES, 1
        )

    @property
    def session_bytes(self) -> int:
        """Upper limit of bytes of the session to the router if it uses another link."""
        return estimate.on_the_wire(sum(self._session_bytes()) + estimate.HANDSHAKE_BYTES, 1)

    def _session_bytes(self) -> tuple[int, int]:
        all_tasks = plan.tasks(self.pilot, self.link, active=True, try_all=self.try_all)
        return plan.session_bytes(all_tasks, self.pace.rounds, len(self.ways), open_filter=self.open_filter)

    @property
    def seconds(self) -> float:
        """Approximate upper limit of the duration, in seconds."""
        all_tasks = plan.tasks(self.pilot, self.link, active=True, try_all=self.try_all)
        opened_for = sum(
            1
            for task in all_tasks
            if task.expectation is satellite.ExpectedOutcome.REFUSED and task.probe is satellite.SatelliteProbe.ICMP
        )
        temporary = any(task.probe in plan.TEMPORARY_ROWS for task in all_tasks)
        return self.pace.window_s * (1 + (opened_for if self.open_filter else 0) + 2 * temporary)

    async def run(self, session: api.Session) -> Proof:
        """Probe all targets and judge them; raise DeviceError, or OutcomeUnknown if the filter may still be open."""
        before = await self._read(session)
        self._start_bytes = before.port_bytes
        self._opening_bytes = session.traffic.bytes
        active = active_link(before.routes, self.ways) == self.link.name
        terminal = await self._terminal(session, before.port_name)
        all_tasks = [
            self._resolve_task(task) for task in plan.tasks(self.pilot, self.link, active=active, try_all=self.try_all)
        ]
        for task in all_tasks:
            if task.probe is satellite.SatelliteProbe.NONE:
                attempt = _attempt(task, satellite.ProbeOutcome.NOT_TRIED, note=task.why_not)
                self._attempts.append(replace(attempt, hint=task.hint))
        alone = [task for task in all_tasks if task.probe not in (satellite.SatelliteProbe.NONE, *plan.TEMPORARY_ROWS)]
        allowed_tasks = [task for task in alone if task.expectation is satellite.ExpectedOutcome.REACHED]
        self._attempts += await self._reach(session, allowed_tasks, before)
        for task in all_tasks:
            if task.expectation is satellite.ExpectedOutcome.REFUSED and task.probe is satellite.SatelliteProbe.ICMP:
                self._attempts.append(await self._refuse(session, task))
                if self.open_filter:
                    self._attempts.append(await self._beyond(session, task))
        temporary = [task for task in all_tasks if task.probe in plan.TEMPORARY_ROWS]
        if temporary:
            self._attempts += await self._ask(session, temporary, active=active)
        after = await self._read(session)
        proof = self._proof(before, after, terminal, active=active)
        return replace(proof, session_bytes=session.traffic.bytes)

    def _resolve_task(self, task: plan.Task) -> plan.Task:
        """Return the task, without a probe and with the reason if this computer cannot reach the VPN server."""
        if task.probe is not satellite.SatelliteProbe.VPN or not isinstance(self.vpn, errors.NetcfgError):
            return task
        return replace(task, probe=satellite.SatelliteProbe.NONE, why_not=str(self.vpn), hint=self.vpn.hint or "")

    def _proof(
        self, before: plan.CounterReading, after: plan.CounterReading, terminal: Sequence[LinkFinding], *, active: bool
    ) -> Proof:
        is_link_up = any(
            attempt.expected_outcome is satellite.ExpectedOutcome.REACHED
            and attempt.outcome is satellite.ProbeOutcome.ANSWERED
            for attempt in self._attempts
        )
        return Proof(
            site=self.site,
            link=self.link.name,
            active=active,
            results=tuple((item, self._judge(item, link_seen=is_link_up)) for item in self._attempts),
            findings=tuple(terminal),
            bytes_counted=after.port_bytes - before.port_bytes,
            budget_bytes=plan.BUDGET_BYTES,
            kept_off=after.drop_count(self._chains[0]),
            turned_away=after.drop_count(self._chains[1]),
            carrier=self.carrier,
            opening_bytes=self._opening_bytes,
            left_out=self._untested_target,
        )

    @property
    def _untested_target(self) -> str:
        target = far_end(self.pilot)
        if target is None:
            return ""
        command = f"provision measure link site={self.site} link={self.link.name}"
        return msg(f"{arg(target.name)} ({arg(target.address)} udp {arg(target.port)}): `{arg(command)}` tests it")

    def _judge(self, attempt: satellite.Attempt, *, link_seen: bool) -> LinkFinding:
        finding = satellite.judge_attempt(attempt, link_seen=link_seen)
        return replace(finding, hint=finding.hint and errors.fill_hint(finding.hint, site=self.site))

    @property
    def _chains(self) -> tuple[str, str]:
        return f"to-{self.link.name}", f"from-{self.link.name}"

    async def _read(self, session: api.Session) -> plan.CounterReading:
        return plan.read(self.port, await session.flight(plan.reads(self.port, self._chains)))

    async def _terminal(self, session: api.Session, port: str) -> tuple[LinkFinding, ...]:
        """Check which device responds on the terminal's port: local, without airtime."""
        self._say("device on the terminal's port")
        there = plan.ping(str(self.link.gateway), str(self.link.address), count=2)
        commands = [there, *(plan.factory_ping(address, port) for address in satellite.FACTORY_ADDRESSES)]
        gateway, *factory = await session.flight(commands)
        if trap := next((reply.trap for reply in factory if reply.trap is not None), None):
            message = msg(f"the router refused to look up the device on {arg(port)}: {arg(trap.message)}")
            return (LinkFinding(events.Verdict.INCONCLUSIVE, "box-not-asked", message),)
        strangers = [
            address
            for address, reply in zip(satellite.FACTORY_ADDRESSES, factory, strict=True)
            if plan.has_answer(reply)
        ]
        return satellite.judge_factory_address(
            self.terminal,
            self.port,
            str(self.link.gateway),
            answers=plan.has_answer(gateway),
            answers_at_factory=strangers[0] if strangers else None,
        )

    async def _reach(
        self, session: api.Session, todo: Sequence[plan.Task], before: plan.CounterReading
    ) -> list[satellite.Attempt]:
        """Probe all targets in each round until all have responded, the window ends, or the budget is used up."""
        answers: dict[plan.Task, float] = {}
        waited_s, now = 0.0, before
        for turn in range(self.pace.rounds):
            remaining_tasks = [task for task in todo if task not in answers]
            if not remaining_tasks or (
                turn and self._is_spent(now if now is not before else await self._read(session))
            ):
                break
            self._say(
                msg(f"{arg(len(remaining_tasks))} allowed targets have not responded yet"), turn, self.pace.rounds
            )
            pings = [task for task in remaining_tasks if task.probe is satellite.SatelliteProbe.ICMP]
            replies = await session.flight([plan.ping(task.address, str(self.link.address)) for task in pings])
            answers.update(
                {task: waited_s for task, reply in zip(pings, replies, strict=True) if plan.has_answer(reply)}
            )
            now = await self._read(session) if len(pings) < len(remaining_tasks) else now
            answers.update({task: waited_s for task in remaining_tasks if self._has_new_answers(before, now, task)})
            if len(answers) < len(todo):
                await self.pace.sleep(self.pace.every_s)
                waited_s += self.pace.every_s
        return [self._allowed_attempt(task, answers.get(task), waited_s, before, now) for task in todo]

    def _has_new_answers(self, before: plan.CounterReading, now: plan.CounterReading, task: plan.Task) -> bool:
        chain = self._chains[1]
        return task.probe in (*_COUNTER_PROBES, satellite.SatelliteProbe.TIME) and now.answers(
            chain, task
        ) > before.answers(chain, task)

    def _allowed_attempt(
        self,
        task: plan.Task,
        after_s: float | None,
        waited_s: float,
        before: plan.CounterReading,
        now: plan.CounterReading,
    ) -> satellite.Attempt:
        if after_s is not None:
            return replace(_attempt(task, satellite.ProbeOutcome.ANSWERED, window_s=waited_s), after_s=after_s)
        if task.probe not in _COUNTER_PROBES:
            return _attempt(task, satellite.ProbeOutcome.SILENT, window_s=waited_s)
        earlier = before.answers(self._chains[1], task)
        note = msg(f"no response from it was counted in {arg(waited_s):.0f} s, {arg(earlier)} before that")
        if task.probe is satellite.SatelliteProbe.TUNNEL and now.tunnel_up is not False:
            # A tunnel that is up, or that hangs on another box, need not say anything for so long.
            return replace(
                _attempt(task, satellite.ProbeOutcome.SILENT, window_s=waited_s, note=note),
                probe=satellite.SatelliteProbe.UDP_COUNTER,
            )
        return _attempt(task, satellite.ProbeOutcome.SILENT, window_s=waited_s, note=note)

    async def _refuse(self, session: api.Session, task: plan.Task) -> satellite.Attempt:
        """Probe with the filter closed: the router's drop counter shows that nothing was sent."""
        self._say(msg(f"{arg(task.name)}, which must be refused"))
        before = await self._read(session)
        reply = await session.command(plan.ping(task.address, str(self.link.address), count=_REFUSALS))
        after = await self._read(session)
        if plan.has_answer(reply):
            return _attempt(task, satellite.ProbeOutcome.ANSWERED)
        chain = self._chains[0]
        if after.drop_count(chain) - before.drop_count(chain) >= _REFUSALS:
            return _attempt(task, satellite.ProbeOutcome.REFUSED_HERE)
        return _attempt(task, satellite.ProbeOutcome.SILENT, note="the router's drop counter did not increase")

    async def _beyond(self, session: api.Session, task: plan.Task) -> satellite.Attempt:
        """Probe with the filter open for this host, to see whether the terminal or the network enforces anything."""
        self._say(msg(f"{arg(task.name)}, with the router's filter open for it"))
        reading = await self._read(session)
        waited_s, is_answered = 0.0, False
        async with temporary_rows(session, filter_rows(reading, self._chains, task.address)):
            for turn in range(self.pace.rounds):
                if turn and self._is_spent(await self._read(session)):
                    break
                is_answered = plan.has_answer(await session.command(plan.ping(task.address, str(self.link.address))))
                if is_answered:
                    break
                await self.pace.sleep(self.pace.every_s)
                waited_s += self.pace.every_s
        outcome = satellite.ProbeOutcome.ANSWERED if is_answered else satellite.ProbeOutcome.SILENT
        attempt = _attempt(task, outcome, window_s=waited_s)
        return replace(attempt, filter_open=True, after_s=waited_s if is_answered else None)

    async def _ask(self, session: api.Session, todo: Sequence[plan.Task], *, active: bool) -> list[satellite.Attempt]:
        """Probe targets that need rows on the router, in one window; those to be refused until its end."""
        before = now = await self._read(session)
        answers: dict[plan.Task, float] = {}
        waited_s, rounds = 0.0, self._affordable(before)
        pause_s = self.pace.rounds / rounds * self.pace.every_s
        server = next((task for task in todo if task.probe is satellite.SatelliteProbe.VPN), None)
        vpn = None if server is None or isinstance(self.vpn, errors.NetcfgError) else self.vpn
        source = "" if vpn is None else vpn.source
        rule_rows = rows(todo, self.link, await session.command(RULES), active=active, source=source)
        async with temporary_rows(session, rule_rows):
            if any(task.probe is satellite.SatelliteProbe.TIME for task in todo):
                await ask_now(session)
            if server is not None and vpn is not None and (after_s := await vpn.answered_after_s()) is not None:
                answers[server] = after_s
            for turn in range(rounds):
                self._say(msg(f"{arg(len(todo) - len(answers))} targets through temporary rows"), turn, rounds)
                await self.pace.sleep(pause_s)
                waited_s += pause_s
                now = await self._read(session)
                answering_tasks = find_connected_tasks(todo, await session.command(STATUS))
                answering_tasks |= {task for task in todo if self._has_new_answers(before, now, task)}
                answers = dict.fromkeys(answering_tasks, waited_s) | answers
                if len(answers) == len(todo) or self._is_spent(now):
                    break
        return [self._temporary_attempt(task, answers, waited_s, before, now) for task in todo]

    def _temporary_attempt(
        self,
        task: plan.Task,
        answers: Mapping[plan.Task, float],
        waited_s: float,
        before: plan.CounterReading,
        now: plan.CounterReading,
    ) -> satellite.Attempt:
        result, note = outcome(task, answers, before, now, self._chains)
        return replace(_attempt(task, result, window_s=waited_s, note=note), after_s=answers.get(task))

    def _is_spent(self, now: plan.CounterReading) -> bool:
        """Return whether the budget lacks room for another round and the end, counting all use of the satellite."""
        return now.port_bytes - self._start_bytes + (1 + _END_TURNS) * self._turn_bytes >= plan.BUDGET_BYTES

    def _affordable(self, now: plan.CounterReading) -> int:
        """Return the rounds that the budget allows, with adding and removing rows: at least one."""
        if not self._turn_bytes:
            return self.pace.rounds
        remaining_bytes = plan.BUDGET_BYTES - plan.VPN_BYTES - (now.port_bytes - self._start_bytes)
        return max(1, min(self.pace.rounds, remaining_bytes // self._turn_bytes - _END_TURNS))

    @property
    def _turn_bytes(self) -> int:
        """Bytes of one round over the satellite; 0 if the session to the router uses another link."""
        if self.carrier != self.link.name:
            return 0
        all_tasks = plan.tasks(self.pilot, self.link, active=True, try_all=self.try_all)
        return ceil((1 + estimate.HEADERS) * plan.reading_bytes(all_tasks, len(self.ways)))

    def _say(self, message: str, step: int = 0, total: int = 0) -> None:
        self.notify(events.Event(self.router, events.Stage.VERIFYING, message, step, total))


def _attempt(
    task: plan.Task, outcome: satellite.ProbeOutcome, *, window_s: float = 0.0, note: str = ""
) -> satellite.Attempt:
    return satellite.Attempt(
        task.name, task.target, task.expectation, task.probe, outcome, window_s=window_s, note=note
    )
