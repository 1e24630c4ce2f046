"""Which requests a rehearsed gateway's real machine is asked, and what the simulation answers in its place."""

import asyncio
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime

import pytest

from atlantis_netcfg.checklist import plan, probes
from atlantis_netcfg.checklist.rehearsal import CheckOutcome
from atlantis_netcfg.checklist.report import Item, ItemKind, Phase
from atlantis_netcfg.checklist.runner import OnAnswer, Questions
from atlantis_netcfg.checklist.runner.machine_requests import REQUESTS, limit_of
from atlantis_netcfg.checklist.runner.simulated import _world
from atlantis_netcfg.checklist.runner.simulated.environment import RehearsedTransport
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.emulator.linux import Computer
from atlantis_netcfg.inventory import Inventory

PLACE = probes.Place.GATEWAY
REFLECT = probes.ReflectRequest("data", PLACE, "10.80.0.21", "10.80.0.2", 6862)


def run(command: str) -> probes.RunProgram:
    return probes.RunProgram(command, PLACE, tuple(command.split()))


BY_MACHINE = {
    "ip -j addr show",
    "ip -j route show",
    "ip -j route get 10.80.0.2",
    "ping -n -c 5 -i 1 -W 10 -I tun0 10.80.0.1",
    "openssl storeutl -noout -text -certs /etc/openvpn/client/atlantis.identity",
    "ReflectRequest",
    "RouterSolicitRequest",
}
"""What the checklist of the coastal testbed asks of its gateway, and the machine answers."""


def test_the_machine_is_asked_what_concerns_its_network(declaration: Inventory) -> None:
    vpn = declaration.pilot.vpn.network
    requests = {
        question
        for entry in plan(declaration, "coastal").entries
        if entry.step.probe is not None
        for question in entry.step.probe.asks()
        if question.place is PLACE
    }
    limits = {
        " ".join(one.argv) if isinstance(one, probes.RunProgram) else type(one).__name__: limit_of(one, vpn)
        for one in requests
    }
    assert {text for text, limit in limits.items() if not limit} == BY_MACHINE
    assert set(limits.values()) == {limit for _, limit in REQUESTS}


@pytest.mark.parametrize(
    ("request_", "word"),
    [
        (run("ip -j route get 10.64.1.23"), "vehicles"),
        (run("ping -n -c 20 -i 0.2 -W 2 10.64.1.23"), "vehicles"),
        (probes.Listen("gps", PLACE, "tcp", "10.64.1.23", 2947), "vehicles"),
        (run("ip -j addr show dev wlan0"), "radios"),
        (run("timedatectl show"), "clock"),
        (run("ip -j neigh show to 10.64.1.1"), "neighbours"),
        (run("cat /etc/network/interfaces"), "addresses after a restart"),
    ],
)
def test_what_a_machine_lacks_is_simulated_with_the_reason(
    declaration: Inventory, request_: probes.Question, word: str
) -> None:
    assert limit_of(request_, declaration.pilot.vpn.network).startswith(f"{word}:")


@dataclass
class Recorder:
    """Stands for the real transport: notes what it is asked, and answers like a machine that hears nothing."""

    asked: list[str] = field(default_factory=list)

    async def ask(
        self, place: probes.Place, host: str | None, questions: Questions, result: OnAnswer
    ) -> Mapping[str, probes.Answer]:
        assert (place, host) == (PLACE, None)
        answers: dict[str, probes.Answer] = {}
        for key, question in questions:
            self.asked.append(key)
            real = isinstance(question, probes.ReflectRequest)
            answers[key] = probes.ReflectResult(None) if real else probes.CommandResult(None, out="[]")
            result(key, answers[key])
        return answers


@pytest.mark.parametrize("has_machine", [True, False])
def test_emulated_replies_are_marked_and_those_of_the_machine_are_not(
    declaration: Inventory,
    has_machine: bool,  # noqa: FBT001 - a case
) -> None:
    world, devices = _world.healthy(declaration, "coastal"), Recorder()
    assert world.computer is not None
    vpn = declaration.pilot.vpn.network if has_machine else None
    ears = RehearsedTransport(devices, Computer(world.computer), (), "coastal", {}, world.robots, vpn)
    questions = [(one.name, one) for one in (REFLECT, run("ip -j addr show"), run("timedatectl show"))]
    told: dict[str, probes.Answer] = {}
    answers = asyncio.run(ears.ask(PLACE, None, questions, told.__setitem__))
    assert answers == told
    assert set(answers) == {"data", "ip -j addr show", "timedatectl show"}
    assert devices.asked == (["data", "ip -j addr show"] if has_machine else [])
    replies = answers["data"]
    assert isinstance(replies, probes.ReflectResult)
    assert [json.loads(one.data)["emulated"] for one in replies.answers] == ([] if has_machine else [True] * 3)


def test_this_computer_is_never_taken_for_the_machine(declaration: Inventory) -> None:
    world, devices = _world.healthy(declaration, "coastal"), Recorder()
    assert world.computer is not None
    vpn = declaration.pilot.vpn.network
    ears = RehearsedTransport(devices, Computer(world.computer), (), "coastal", {}, world.robots, vpn)
    question = probes.RunProgram("addr", probes.Place.LAPTOP, ("ip", "-j", "addr", "show"))
    answers = asyncio.run(ears.ask(probes.Place.LAPTOP, None, [("addr", question)], lambda *_: None))
    assert devices.asked == []
    assert "10.64.1.10" in str(answers["addr"])


def item(name: str, verdict: Verdict) -> Item:
    return Item(
        id=name,
        title=name,
        vehicle=None,
        location="coastal",
        endpoint="site",
        table3=False,
        kind=ItemKind.AUTOMATIC,
        phase=Phase.BENCH,
        open=False,
        verdict=verdict,
        message=f"{name} is {verdict}",
        at=datetime(2026, 1, 1, tzinfo=UTC),
    )


def test_an_outcome_counts_what_passes_and_lists_what_does_not() -> None:
    verdicts = {"a": "PASS", "b": "WARN", "c": "SKIP", "d": "FAIL", "e": "INCONCLUSIVE", "f": "ERROR"}
    outcome = CheckOutcome("coastal", tuple(item(name, Verdict(word)) for name, word in verdicts.items()), 7)
    assert str(outcome.words) == "checklist: 2 of 5 automatic items pass; 7 items need a person"
    assert [one.id for one in outcome.problems] == ["d", "e", "f"]
    row = json.loads(json.dumps(outcome.as_dict()))
    assert row["counts"] == dict.fromkeys(verdicts.values(), 1)
    assert row["problems"][0] == {"id": "d", "verdict": "FAIL", "message": "d is FAIL", "hint": None}
