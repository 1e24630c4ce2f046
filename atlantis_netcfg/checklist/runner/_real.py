"""Run requests at the real site: each at the place where its device can be reached.

RouterOS devices are read in one session each. For the gateway and for this computer the agent program is packed with
its requests, run there (over one SSH command, or as a process), and its output parsed line by line.
"""

from __future__ import annotations

import asyncio
import json
import sys
import time
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Protocol

from atlantis_netcfg.checklist import probes
from atlantis_netcfg.checklist.probes import agent
from atlantis_netcfg.checklist.runner import _gateway_access, results
from atlantis_netcfg.checklist.runner.cost import refuse_unpaid, within_budget
from atlantis_netcfg.checklist.runner.robots import ask_robots
from atlantis_netcfg.core import events
from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.core.processes.remote_process import Carrier
from atlantis_netcfg.operations.allow_list_test.site import bills, previews, satellite_of, try_out
from atlantis_netcfg.operations.common.costs import require_consent, unpaid
from atlantis_netcfg.operations.common.request import Mode, Request, refuse_examples
from atlantis_netcfg.operations.common.session_link import site_link_of
from atlantis_netcfg.operations.computers._access import is_computer
from atlantis_netcfg.operations.links.collect import collect_links, session_to
from atlantis_netcfg.operations.links.session import command, rows
from atlantis_netcfg.runs import Store

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Mapping, Sequence

    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.operations.allow_list_test.prove import Proof, Proving
    from atlantis_netcfg.routeros.api import Reply

    RunProof = Callable[[Inventory, Host, Request, Proving], Proof]


@dataclass(slots=True)
class AgentProcess:
    """One run of the agent program at one place."""

    questions: results.Questions
    tell: results.OnAnswer
    """Called in the event loop in which `hear` runs."""
    grace_s: float
    """Time that the route may take beyond the requests."""
    answers: dict[str, probes.Answer] = field(default_factory=dict)
    _requests: float = 0.0
    _faults: list[RuntimeError] = field(default_factory=list)

    async def hear(self, carry: Callable[[Carrier], str]) -> dict[str, probes.Answer]:
        """Run the program; `carry` blocks until it ends, and returns the reason for missing results.

        Raises RuntimeError if the program itself failed in a request, after all other results are complete and
        reported.
        """
        request_batch, loop = agent.batch(self.questions), asyncio.get_running_loop()
        by_key, words = dict(self.questions), ["no response"]

        def line(text: bytes) -> None:
            loop.call_soon_threadsafe(self._line, text, time.time())

        carrier = Carrier(agent.program(request_batch.request), line, request_batch.within_s + self.grace_s)
        self._requests = time.time()
        await carrier.run_beside(lambda: words.append(carry(carrier)))
        if self._faults:
            raise self._faults[0]
        rest = {key: results.trouble_answer(by_key[key], words[-1]) for key in by_key if key not in self.answers}
        return {**self.answers, **rest}

    def _line(self, text: bytes, now: float) -> None:
        """Process an output line; an invalid one is ignored, so its request has no result."""
        by_key = dict(self.questions)
        try:
            result = json.loads(text)
            question = by_key[result["key"]]
            answer = agent.read_result(result, question, self._requests, now)
        except RuntimeError as fault:
            self._faults.append(fault)
            return
        except (ValueError, LookupError, TypeError, RecursionError):
            return
        self.answers[result["key"]] = answer
        self.tell(result["key"], answer)


_GRACE_S = 15.0


async def ask_here(
    questions: results.Questions, result: results.OnAnswer, before: Sequence[str] = ()
) -> Mapping[str, probes.Answer]:
    """Run requests on this computer with the agent program; `before`: command prefix that starts it.

    A request that cannot be run gets the result NO_PLACE.
    """
    return await AgentProcess(questions, result, _GRACE_S).hear(lambda carrier: _diagnose_local_agent(carrier, before))


def _diagnose_local_agent(carrier: Carrier, before: Sequence[str]) -> str:
    try:
        result = carrier.run([*before, sys.executable, "-I", "-c", agent.BOOT])
    except OSError as error:
        return msg(f"the listener program did not start on this computer: {arg(error)}")
    return msg(
        f"the listener program exited on this computer: {arg(last_line(result.err) or msg(f'exit {arg(result.rc)}'))}"
    )


def last_line(data: bytes) -> str:
    """Return the last non-empty line of a program's output."""
    return next((line.strip() for line in reversed(data.decode(errors="replace").splitlines()) if line.strip()), "")


_NO_SUCH = 127


async def ask_gateway(  # noqa: PLR0913, PLR0917 - the seam's three, and what the real site adds
    inventory: Inventory,
    host: Host,
    request: Request,
    questions: results.Questions,
    result: results.OnAnswer,
    ssh_config: str | None = None,
) -> Mapping[str, probes.Answer]:
    """Run requests on a gateway with the agent program; NO_PLACE if that is impossible. Raises CostRefusal."""
    try:
        way = _gateway_access.way_in(inventory, host, request, ssh_config)
    except _gateway_access.GatewayUnreachable as why:
        return results.all_unanswered(questions, results.in_words(why))
    carrier = site_link_of(inventory, host, request.via.get(host.name))
    if carrier.is_metered and not request.rehearsed:
        questions = within_budget(questions)
        refuse_unpaid(inventory, host.site, carrier, questions, request)
    return await AgentProcess(questions, result, way.connect_s + way.grace_s).hear(
        lambda item: _diagnose_gateway_agent(way, item)
    )


def _diagnose_gateway_agent(way: _gateway_access.GatewayAccess, carrier: Carrier) -> str:
    try:
        result = way.run("python3 -I -c %s", agent.BOOT, carrier=carrier)
    except _gateway_access.GatewayUnreachable as why:
        return results.in_words(why)
    if result.overdue:
        return msg(f"{arg(way.name)} did not respond in time")
    if result.rc == _NO_SUCH:
        return msg(f"{arg(way.name)} has no python3; there: `apt-get install python3`")
    if way.sudo and b"sudo" in result.err:
        rule = "`echo '%sudo ALL=(ALL) NOPASSWD: ALL' > /etc/sudoers.d/atlantis`"
        return msg(
            f"the login user on {arg(way.name)} cannot become root without a password; there, as root: {arg(rule)}"
        )
    return msg(
        f"the listener program exited on {arg(way.name)}: {arg(last_line(result.err) or msg(f'exit {arg(result.rc)}'))}"
    )


@dataclass(frozen=True, slots=True)
class Routers:
    """The routers of a site, read-only. A request that cannot be run gets NO_PLACE, with the reason."""

    inventory: Inventory
    site: str
    request: Request
    notify: events.Subscriber
    prove: RunProof = try_out

    async def ask(self, name: str, questions: results.Questions) -> Mapping[str, probes.Answer]:
        """Run all requests to one device in one session of two round trips."""
        try:
            return await self._ask_router(self.inventory.hosts[name], questions)
        except NetcfgError as error:
            self.notify(events.Event(name, events.Stage.FAILED, str(error)))
            return results.all_unanswered(questions, results.in_words(error))
        except KeyError:
            return results.all_unanswered(questions, msg(f"the inventory has no host `{arg(name)}`"))

    async def links(self, questions: results.Questions, result: results.OnAnswer) -> Mapping[str, probes.Answer]:
        """Read all links once for all items, and run allow-list tests at the same time."""
        looks = [(key, item) for key, item in questions if isinstance(item, probes.LinkStatusRequest)]
        proofs = [(key, request) for key, request in questions if isinstance(request, probes.AllowListTestRequest)]
        work = [
            self._report_answers(self._ask_links(looks), result),
            *(self._report_answers(self._prove(key, prove), result) for key, prove in proofs),
        ]
        answer_maps = await asyncio.gather(*work)
        return {key: answer for answers in answer_maps for key, answer in answers.items()}

    @staticmethod
    async def _report_answers(
        work: Awaitable[Mapping[str, probes.Answer]], result: results.OnAnswer
    ) -> Mapping[str, probes.Answer]:
        answers = await work
        for key, answer in answers.items():
            result(key, answer)
        return answers

    @property
    def _drift_request(self) -> Request:
        return self.request.model_copy(update={"mode": Mode.DRIFT})

    async def _ask_router(self, host: Host, questions: results.Questions) -> Mapping[str, probes.Answer]:
        require_consent(self.inventory, [host], self._drift_request)
        door = session_to(self.inventory, self.site, host, self.request)
        request_time = time.time()
        async with door.open_session() as session:
            replies = await session.flight(
                [command(request.query) for _, request in questions if isinstance(request, probes.RouterOsQuery)]
            )
        now = time.time()
        cost_text = msg(f"read in {arg(door.round_trips)} round trips, {arg(door.bytes / 1000):.1f} kB")
        self.notify(events.Event(host.name, events.Stage.DONE, cost_text))
        return {key: _rows(reply, request_time, now) for (key, _), reply in zip(questions, replies, strict=True)}

    async def _ask_links(
        self, questions: Sequence[tuple[str, probes.LinkStatusRequest]]
    ) -> Mapping[str, probes.Answer]:
        if not questions:
            return {}
        hosts = [host for host in self.inventory.site_hosts(self.site) if not is_computer(host)]
        try:
            require_consent(self.inventory, hosts, self._drift_request)
            link_states = await collect_links(self.inventory, self.site, hosts, self._drift_request, self.notify)
        except NetcfgError as error:
            return results.all_unanswered(questions, results.in_words(error))
        values = link_states.as_dict()
        return {key: _link_status(values, item) for key, item in questions}

    async def _prove(self, key: str, question: probes.AllowListTestRequest) -> Mapping[str, probes.Answer]:
        try:
            return {key: await self._prove_allow_list(question)}
        except NetcfgError as error:
            return {key: results.trouble_answer(question, results.in_words(error))}

    async def _prove_allow_list(self, question: probes.AllowListTestRequest) -> probes.Answer:
        satellite = satellite_of(self.inventory, self.site, question.link)
        via = self.request.via.get(satellite.router.name)
        proving = satellite.proving(self.inventory, is_rehearsal=self.request.rehearsed, via=via)
        proving.notify = self.notify
        self._pay(proving)
        began = time.monotonic()
        proof = await asyncio.to_thread(self.prove, self.inventory, satellite.router, self._drift_request, proving)
        seconds = time.monotonic() - began
        bill = bills(self.inventory, proof, seconds)[question.link]
        findings = (finding for _, finding in proof.results)
        return probes.AllowListTestResult(None, "", (*findings, *proof.findings), bill.words, seconds)

    def _pay(self, proving: Proving) -> None:
        """Raise CostRefusal if a test on a metered link has no consent; a rehearsal costs nothing."""
        if self.request.rehearsed:
            return
        dear = [item for item in previews(self.inventory, proving) if item.link.is_metered]
        for entry in dear:
            if entry.over_cap:
                raise entry.refusal()
        if dear and not self.request.accept_cost:
            raise unpaid([preview.words for preview in dear], self.request.command)


def _rows(reply: Reply, request_time: float, now: float) -> probes.Rows:
    words = "" if reply.trap is None else str(reply.trap.message)
    return probes.Rows(None, words, rows(reply), request_time, now)


def _link_status(values: Mapping[str, Mapping[str, object]], question: probes.LinkStatusRequest) -> probes.Answer:
    if question.link not in values:
        return results.trouble_answer(
            question, msg(f"the site has no link `{arg(question.link)}`"), probes.Trouble.MISSING
        )
    return probes.LinkStatusResult(None, "", values[question.link])


def link_record(inventory: Inventory, request: Request, question: probes.LinkRecordRequest) -> probes.LinkRecordResult:
    """Judge the newest measurement of a real link again, from its samples and the current inventory only.

    Stored figures are not used as proof.
    """
    from atlantis_netcfg.links.qualify.archive import recompute, stored_runs  # noqa: PLC0415 - as above
    from atlantis_netcfg.operations.qualify.plan import thresholds_of  # noqa: PLC0415 - few checklists ask for it

    now = datetime.now(UTC)
    try:
        saved_runs = stored_runs(Store(request.state), question.site, question.link)
        real = [item for item in saved_runs if not item.run.emulated]
        links = inventory.sites[question.site].bearers
        limits = next(thresholds_of(link) for link in links if link.name == question.link)
        return probes.LinkRecordResult(None, "", recompute(real[-1].folder, limits)[0] if real else None, now)
    except NetcfgError as error:
        return probes.LinkRecordResult(probes.Trouble.MISSING, results.in_words(error), None, now)


@dataclass(slots=True)
class RealTransport:
    """Runs requests at a real site. Metered links carry nothing without `request.accept_cost`."""

    inventory: Inventory
    site: str
    request: Request
    notify: events.Subscriber = events.ignore
    ssh_config: str | None = None
    """OpenSSH configuration file that says how to reach the gateway's name, instead of the declared address."""
    prove: RunProof = try_out
    """Runs the test of a satellite's allow-list."""

    async def ask(
        self, place: probes.Place, host: str | None, questions: results.Questions, result: results.OnAnswer
    ) -> Mapping[str, probes.Answer]:
        """Run all requests of one place in one turn; see `Ears.ask`."""
        name = self._name(place, host)
        self.notify(events.Event(name, events.Stage.CONNECTING, msg(f"{arg(len(questions))} read-only requests")))
        try:
            answers = await self._ask(place, host, questions, result)
        except NetcfgError as why:
            self.notify(events.Event(name, events.Stage.FAILED, str(why)))
            return results.all_unanswered(questions, results.in_words(why))
        if place is not probes.Place.ROUTER:  # whose sessions tell by themselves
            silent = sum(answer.trouble is probes.Trouble.NO_PLACE for answer in answers.values())
            stage = events.Stage.FAILED if silent else events.Stage.DONE
            self.notify(
                events.Event(
                    name, stage, msg(f"{arg(len(answers) - silent)} of {arg(len(answers))} requests were sent")
                )
            )
        return answers

    async def _ask(
        self, place: probes.Place, host: str | None, questions: results.Questions, result: results.OnAnswer
    ) -> Mapping[str, probes.Answer]:
        if place is probes.Place.LAPTOP:
            return await self._ask_here(questions, result)
        if place is probes.Place.GATEWAY:
            gateway = self.inventory.computer_of(self.site)
            if gateway is None:
                return results.all_unanswered(questions, msg(f"{arg(self.site)} has no gateway computer"))
            return await ask_gateway(self.inventory, gateway, self.request, questions, result, self.ssh_config)
        refuse_examples(self.inventory, is_rehearsal=self.request.rehearsed)
        routers = Routers(self.inventory, self.site, self.request, self.notify, self.prove)
        return await (routers.links(questions, result) if host is None else routers.ask(host, questions))

    async def _ask_here(self, questions: results.Questions, result: results.OnAnswer) -> Mapping[str, probes.Answer]:
        """Read stored records, listen for robots, and run the other requests with the agent program."""
        record_answers = {
            key: link_record(self.inventory, self.request, question)
            for key, question in questions
            if isinstance(question, probes.LinkRecordRequest)
        }
        for key, answer in record_answers.items():
            result(key, answer)
        of_robots = [
            pair for pair in questions if isinstance(pair[1], probes.RobotsHeardRequest | probes.VpnMembersRequest)
        ]
        rest = [pair for pair in questions if pair[0] not in record_answers and pair not in of_robots]
        work = [ask_robots(self.inventory, self.site, self.request, of_robots, result)] if of_robots else []
        answer_maps = await asyncio.gather(*work, *([ask_here(rest, result)] if rest else []))
        return record_answers | {key: answer for answers in answer_maps for key, answer in answers.items()}

    def _name(self, place: probes.Place, host: str | None) -> str:
        names = {
            probes.Place.LAPTOP: "this computer",
            probes.Place.GATEWAY: msg(f"{arg(self.site)}: gateway"),
            probes.Place.ROUTER: msg(f"{arg(self.site)}: links"),
        }
        return host or names[place]


class ProbeTransport(Protocol):
    """Interface between the checklist and the site; implemented for real and for emulated devices."""

    async def ask(
        self, place: probes.Place, host: str | None, questions: results.Questions, result: results.OnAnswer
    ) -> Mapping[str, probes.Answer]:
        """Run all requests of one place in one turn, and return one result per key.

        `host`: the RouterOS device of `RouterOsQuery` requests; None for all others. `result` is called as results
        arrive; an implementation that gets all at once need not call it, because the returned ones count. A request
        that cannot be run has a result with a trouble, never an exception.
        """
        ...
