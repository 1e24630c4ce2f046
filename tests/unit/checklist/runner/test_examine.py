"""One turn of a checklist, with ears that a test scripts: what is asked, when it is judged, what goes wrong."""

import asyncio
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path

import pytest

from atlantis_netcfg.checklist import PlanEntry
from atlantis_netcfg.checklist.probes import (
    SITE,
    Answer,
    Cell,
    CommandResult,
    Consent,
    LinkStatusRequest,
    Listen,
    Place,
    Probe,
    ProbeResult,
    Question,
    ReflectRequest,
    RouterOsQuery,
    Rows,
    RunProgram,
    Say,
    Step,
    Transcript,
    Trouble,
)
from atlantis_netcfg.checklist.report import Evidence, EvidenceType, Item, ItemKind, Phase
from atlantis_netcfg.checklist.runner import OnAnswer, Questions, _run, examine
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.inventory import load
from atlantis_netcfg.inventory.model import REFLECTOR_PORT
from atlantis_netcfg.links import LinkFinding
from atlantis_netcfg.links.status import Query

DECLARATION = load(Path(__file__).parents[4] / "inventory")
NOW = datetime(2026, 5, 4, 10, 30, tzinfo=UTC)
GOOD = LinkFinding(Verdict.PASS, "good", "all is well")
ROUTES = Query("/ip/route", "print")
DISCOVER = RunProgram("run", Place.GATEWAY, ("ip", "-j", "addr"))
HERE = RunProgram("here", Place.LAPTOP, ("ip", "-j", "addr"))
OF_ROUTER = RouterOsQuery("rows", "coastal-router", ROUTES)
LOOKS = LinkStatusRequest("look", "satellite")


@dataclass
class Fake:
    questions: tuple[Question, ...] = (DISCOVER,)
    findings: tuple[LinkFinding, ...] = (GOOD,)
    fault: str = ""
    heard: dict[str, Answer] = field(default_factory=dict)

    def asks(self) -> tuple[Question, ...]:
        if self.fault == "asks":
            raise ZeroDivisionError
        return self.questions

    def judge(self, heard: Mapping[str, Answer]) -> ProbeResult:
        self.heard = dict(heard)
        if self.fault == "judge":
            raise KeyError("nothing of this")
        seen = Evidence(type=EvidenceType.MEASURED, what="it", value="1 m")
        return ProbeResult(self.findings, (seen,))


def entry(name: str, probe: Probe | None, kind: ItemKind = ItemKind.AUTOMATIC, *, is_open: bool = True) -> PlanEntry:
    consent = Consent("nobody dives") if kind is ItemKind.ACTIVE else None
    step = Step(name, "a title", ItemKind.PERSON if probe is None else kind, Phase.BENCH, probe, consent=consent)
    item = Item(
        id=f"coastal/site/{name}",
        title="a title",
        vehicle=None,
        location="coastal",
        endpoint=SITE,
        table3=False,
        kind=step.kind,
        phase=Phase.BENCH,
        open=is_open,
        verdict=Verdict.INCONCLUSIVE,
        message="not checked yet",
    )
    return PlanEntry(item, step, Cell(DECLARATION, "coastal", None, SITE))


def answer(question: Question) -> Answer:
    match question:
        case RunProgram():
            return CommandResult(None, out=f"{question.place} {' '.join(question.argv)}")
        case RouterOsQuery():
            return Rows(None, rows=({"of": question.host},))
        case Listen():
            return Transcript(None, chunks=((0.0, b"heard"),))
        case _:
            raise AssertionError(question)


@dataclass
class Ears:
    """Answers everything; `script` takes the place of a place's answers."""

    script: dict[Place, Callable[[Questions, OnAnswer], Mapping[str, Answer]]] = field(default_factory=dict)
    asked: list[tuple[Place, str | None, list[str]]] = field(default_factory=list)
    gate: asyncio.Event | None = None
    """The gateway's answers wait for it."""
    stopped: bool = False

    async def ask(self, place: Place, host: str | None, questions: Questions, heard: OnAnswer) -> Mapping[str, Answer]:
        self.asked.append((place, host, [key for key, _ in questions]))
        if place is Place.GATEWAY and self.gate is not None:
            try:
                await self.gate.wait()
            except asyncio.CancelledError:
                self.stopped = True
                raise
        if place in self.script:
            return self.script[place](questions, heard)
        return {key: answer(question) for key, question in questions}


def examined(
    entries: Sequence[PlanEntry], ears: Ears, tmp_path: Path, settled: Callable[[Item], None] = lambda _item: None
) -> tuple[Item, ...]:
    return asyncio.run(examine(entries, ears, settled, now=lambda: NOW, state=lambda: tmp_path))


def test_item_takes_the_message_of_its_worst_finding(tmp_path: Path) -> None:
    first = LinkFinding(Verdict.WARN, "near", "it is near", "move it")
    second = LinkFinding(Verdict.WARN, "slow", "it is slow", "speed it up")
    (item,) = examined([entry("a", Fake(findings=(GOOD, first, second)))], Ears(), tmp_path)
    assert (item.verdict, item.message, item.hint) == (Verdict.WARN, "it is near", "move it")
    assert [(one.verdict, one.code, one.message, one.hint) for one in item.findings] == [
        (Verdict.PASS, "good", "all is well", None),
        (Verdict.WARN, "near", "it is near", "move it"),
        (Verdict.WARN, "slow", "it is slow", "speed it up"),
    ]
    assert (item.open, item.at) == (False, NOW)
    assert item.seconds is not None
    assert [one.value for one in item.evidence] == ["1 m"]


def test_each_place_and_identical_request_is_asked_once(tmp_path: Path) -> None:
    other = replace(OF_ROUTER, host="coastal-cpe", name="cpe")
    probes = {
        "a": Fake((DISCOVER, OF_ROUTER)),
        "b": Fake((replace(DISCOVER, name="again"), replace(DISCOVER, name="other", argv=("ip", "-j", "route")))),
        "c": Fake((HERE, other)),
    }
    ears = Ears()
    examined([entry(name, probe) for name, probe in probes.items()], ears, tmp_path)
    of = "coastal/site/"
    assert sorted(ears.asked, key=str) == [
        (Place.GATEWAY, None, [f"{of}a#run", f"{of}b#other"]),
        (Place.LAPTOP, None, [f"{of}c#here"]),
        (Place.ROUTER, "coastal-cpe", [f"{of}c#cpe"]),
        (Place.ROUTER, "coastal-router", [f"{of}a#rows"]),
    ]
    assert probes["a"].heard == {"run": answer(DISCOVER), "rows": answer(OF_ROUTER)}
    assert probes["b"].heard["again"] == answer(DISCOVER)
    assert probes["c"].heard == {"here": answer(HERE), "cpe": answer(other)}


def test_link_status_of_several_items_is_one_request(tmp_path: Path) -> None:
    ears = Ears({Place.ROUTER: lambda questions, _: {key: Rows(None) for key, _ in questions}})
    examined([entry("a", Fake((LOOKS,))), entry("b", Fake((LOOKS,)))], ears, tmp_path)
    assert ears.asked == [(Place.ROUTER, None, ["coastal/site/a#look"])]


def test_places_run_in_parallel_and_items_settle_as_answered(tmp_path: Path) -> None:
    """The gateway waits for the router's item to be settled; of the gateway's own items one comes before the other."""
    order: list[str] = []

    async def run() -> tuple[Item, ...]:
        gate = asyncio.Event()

        def one_by_one(questions: Questions, heard: OnAnswer) -> Mapping[str, Answer]:
            for key, question in reversed(questions):
                heard(key, answer(question))
                heard(key, answer(question))  # who says it twice is believed once
            return {}

        def settled(item: Item) -> None:
            order.append(item.id.rpartition("/")[2])
            if order[-1] == "router":
                gate.set()

        entries = [
            entry("first", Fake((DISCOVER,))),
            entry("last", Fake((replace(DISCOVER, argv=("ip", "-j", "route")),))),
            entry("router", Fake((OF_ROUTER,))),
        ]
        ears = Ears({Place.GATEWAY: one_by_one}, gate=gate)
        return await examine(entries, ears, settled, state=lambda: tmp_path)

    items = asyncio.run(run())
    assert order == ["router", "last", "first"]
    assert [item.id.rpartition("/")[2] for item in items] == ["first", "last", "router"]
    assert {item.verdict for item in items} == {Verdict.PASS}


@pytest.mark.parametrize(("where", "name"), [("asks", "ZeroDivisionError"), ("judge", "KeyError")])
def test_crashed_probe_is_an_error_and_others_continue(tmp_path: Path, where: str, name: str) -> None:
    sick, well = examined([entry("sick", Fake(fault=where)), entry("well", Fake())], Ears(), tmp_path)
    assert (sick.verdict, sick.open) == (Verdict.ERROR, False)
    assert sick.message == (f"provision itself failed ({name}): this is a defect of the program, not your mistake")
    assert [one.code for one in sick.findings] == ["crashed"]
    (log,) = (tmp_path / "log").iterdir()
    assert sick.hint == f"please send us the log file {log}"
    assert "checking coastal/site/sick" in log.read_text()
    assert f"{name}" in log.read_text()
    assert well.verdict is Verdict.PASS


def test_crashed_transport_affects_only_its_place(tmp_path: Path) -> None:
    def crash(_questions: Questions, _heard: OnAnswer) -> Mapping[str, Answer]:
        raise ZeroDivisionError

    entries = [entry("a", Fake((DISCOVER,))), entry("b", Fake((DISCOVER, OF_ROUTER))), entry("c", Fake((OF_ROUTER,)))]
    items = examined(entries, Ears({Place.GATEWAY: crash}), tmp_path)
    assert [item.verdict for item in items] == [Verdict.ERROR, Verdict.ERROR, Verdict.PASS]
    assert len(list((tmp_path / "log").iterdir())) == 1


def test_missing_answer_counts_as_not_asked(tmp_path: Path) -> None:
    probe = Fake((DISCOVER, HERE))
    examined([entry("a", probe)], Ears({Place.GATEWAY: lambda *_: {}}), tmp_path)
    assert probe.heard["run"] == CommandResult(Trouble.NO_PLACE, "no response")
    assert probe.heard["here"] == answer(HERE)


def test_hanging_place_times_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_run, "LIMIT_S", 0.05)
    probe = Fake((DISCOVER,))

    async def run() -> None:
        await examine([entry("a", probe)], Ears(gate=asyncio.Event()), lambda _: None, state=lambda: tmp_path)

    asyncio.run(run())
    assert probe.heard == {"run": CommandResult(Trouble.NO_PLACE, "no response within 0.05 s")}


def test_probe_without_findings_does_not_pass(tmp_path: Path) -> None:
    (item,) = examined([entry("a", Fake(findings=()))], Ears(), tmp_path)
    assert (item.verdict, item.message) == (Verdict.ERROR, "this probe gave no verdict")


def test_probe_without_requests_is_judged_at_once(tmp_path: Path) -> None:
    ears = Ears()
    (item,) = examined([entry("a", Fake(questions=()))], ears, tmp_path)
    assert (item.verdict, ears.asked) == (Verdict.PASS, [])


def test_items_for_people_or_not_applicable_stay_unchanged(tmp_path: Path) -> None:
    apart = entry("apart", Fake(), is_open=False)
    entries = [entry("person", None), replace(apart, step=replace(apart.step, unless="nobody has one"))]
    told: list[Item] = []
    assert examined(entries, Ears(), tmp_path, told.append) == tuple(one.item for one in entries)
    assert told == []


def test_settled_item_is_checked_again(tmp_path: Path) -> None:
    (item,) = examined([entry("settled", Fake(), is_open=False)], Ears(), tmp_path)
    assert (item.verdict, item.message) == (Verdict.PASS, "all is well")


def test_unhashable_request_is_an_error_of_its_probe(tmp_path: Path) -> None:
    listed = replace(DISCOVER, argv=["ip", "-j", "addr"])  # type: ignore[arg-type]
    bad, good = examined([entry("bad", Fake((listed,))), entry("good", Fake())], Ears(), tmp_path)
    assert (bad.verdict, good.verdict) == (Verdict.ERROR, Verdict.PASS)
    assert "TypeError" in bad.message


def test_failure_to_store_an_item_stops_everything(tmp_path: Path) -> None:
    def full(_item: Item) -> None:
        raise OSError("no space left")

    async def run() -> None:
        entries = [entry("a", Fake((OF_ROUTER,))), entry("b", Fake((DISCOVER,)))]
        with pytest.raises(OSError, match="no space left"):
            await examine(entries, ears, full, state=lambda: tmp_path)

    ears = Ears(gate=asyncio.Event())
    asyncio.run(run())
    assert ears.stopped


def tcp(address: str = "10.64.1.22", *, say: tuple[Say, ...] = ()) -> Listen:
    return Listen("it", Place.GATEWAY, "tcp", address, 9200, say=say)


def message(address: str = "10.80.0.2", port: int = REFLECTOR_PORT, count: int = 3) -> ReflectRequest:
    return ReflectRequest("it", Place.GATEWAY, "10.80.0.21", address, port, count)


UNFIT: Mapping[str, tuple[tuple[Question, ...], str]] = {
    "a program": ((RunProgram("it", Place.GATEWAY, ("reboot",)),), "`reboot` is not on the list of read-only programs"),
    "a shell": (
        (RunProgram("it", Place.LAPTOP, ("ip", "-j", "addr;reboot")),),
        "`ip -j addr;reboot` is not on the list of read-only programs",
    ),
    "a setting": (
        (RouterOsQuery("it", "coastal-router", Query("/ip/route", "set", ((".id", "*1"),))),),
        "`/ip/route/set` is not a read-only command",
    ),
    "a monitor without an end": (
        (RouterOsQuery("it", "coastal-router", Query("/interface/lte", "monitor", (("numbers", "lte1"),))),),
        "`/interface/lte/monitor` is not a read-only command",
    ),
    "a ping without an end": (
        (RouterOsQuery("it", "coastal-router", Query("/tool", "ping", (("address", "10.64.1.1"),))),),
        "`/tool/ping` is not a read-only command",
    ),
    "an address of strangers": ((tcp("8.8.8.8"),), "the address 8.8.8.8 is not in the inventory of coastal"),
    "no address": ((tcp(""),), "the address that it requests is not in the inventory of coastal"),
    "a serial port": (
        (Listen("it", Place.GATEWAY, "serial", device="/dev/ttyS0", baud=9600),),
        "the serial port /dev/ttyS0 is not in the inventory",
    ),
    "a UDP port": ((Listen("it", Place.GATEWAY, "udp", port=53),), "the UDP port 53 is not in the inventory"),
    "a message to strangers": (
        (message("8.8.8.8"),),
        "8.8.8.8, UDP port 6862, is not a gateway or control centre in the VPN",
    ),
    "a message to another program": (
        (message(port=53),),
        "10.80.0.2, UDP port 53, is not a gateway or control centre in the VPN",
    ),
    "many messages": ((message(count=100),), "it would send too much"),
    "two of one name": ((DISCOVER, replace(HERE, name="run")), "two requests have the name `run`"),
}


@pytest.mark.parametrize("case", UNFIT)
def test_forbidden_request_is_refused_before_sending(tmp_path: Path, case: str) -> None:
    questions, why = UNFIT[case]
    ears = Ears()
    bad, good = examined([entry("bad", Fake((OF_ROUTER, *questions))), entry("good", Fake((HERE,)))], ears, tmp_path)
    assert (bad.verdict, bad.message) == (Verdict.ERROR, f"this probe requests what is not allowed: {why}")
    assert [one.code for one in bad.findings] == ["not-allowed"]
    assert ears.asked == [(Place.LAPTOP, None, ["coastal/site/good#here"])]
    assert good.verdict is Verdict.PASS


@pytest.mark.parametrize("kind", [ItemKind.AUTOMATIC, ItemKind.ACTIVE])
def test_only_active_steps_may_transmit(tmp_path: Path, kind: ItemKind) -> None:
    ears = Ears()
    say = (Say(b"+++AT*SENDIM,5,2,ack,hello\n", b"OK"),)
    (item,) = examined([entry("it", Fake((tcp(say=say),)), kind)], ears, tmp_path)
    assert item.verdict is (Verdict.PASS if kind is ItemKind.ACTIVE else Verdict.ERROR)
    assert len(ears.asked) == (kind is ItemKind.ACTIVE)


def test_declared_requests_are_allowed(tmp_path: Path) -> None:
    """The vehicles' addresses and ports, and pings that end."""
    ping = Query("/tool", "ping", (("address", "192.168.88.1"), ("count", "2")))
    questions = (tcp(), Listen("udp", Place.GATEWAY, "udp", port=14550), RouterOsQuery("ping", "coastal-router", ping))
    (item,) = examined([entry("it", Fake(questions))], Ears(), tmp_path)
    assert item.verdict is Verdict.PASS
