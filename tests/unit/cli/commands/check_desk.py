"""A checklist of a few items, answered at a desk whose person is a script."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cache
from pathlib import Path

from atlantis_netcfg.checklist import BookHead, Checklist, ChecklistSession, PlanEntry, Scope
from atlantis_netcfg.checklist.probes import (
    Answer,
    Cell,
    Consent,
    Listen,
    Place,
    Probe,
    ProbeResult,
    Question,
    Step,
    Transcript,
)
from atlantis_netcfg.checklist.report import Drawing, Item, ItemKind, Phase, Row
from atlantis_netcfg.checklist.runner import OnAnswer
from atlantis_netcfg.cli.checklist.workflow import CheckWorkflow, Listening, Price, Prompt, render_item
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.paths import checkout
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.links import LinkFinding

NOON = datetime(2026, 5, 4, 12, tzinfo=UTC)


@cache
def pilot() -> Inventory:
    return load(checkout() / "inventory")


@dataclass(frozen=True)
class Heartbeat(Probe):
    """What is heard is the verdict."""

    port: int

    def asks(self) -> tuple[Question, ...]:
        return (Listen("words", Place.LAPTOP, "tcp", "10.64.1.22", self.port),)

    def judge(self, heard: Mapping[str, Answer]) -> ProbeResult:
        answer = heard["words"]
        assert isinstance(answer, Transcript)
        verdict, _, message = answer.data.decode().partition(" ")
        return ProbeResult((LinkFinding(Verdict(verdict), "heard", message, f"hint of {message}"),))


@dataclass
class ScriptedEars:
    """Gives each item the next of its words; `asked` is what was asked, turn by turn."""

    words: Mapping[str, list[str]]
    asked: list[list[str]] = field(default_factory=list)
    then: Callable[[], None] = lambda: None

    async def ask(
        self,
        place: Place,  # noqa: ARG002 - of the protocol
        host: str | None,  # noqa: ARG002 - of the protocol
        questions: Sequence[tuple[str, Question]],
        heard: OnAnswer,
    ) -> Mapping[str, Answer]:
        self.asked.append([key.partition("#")[0] for key, _ in questions])
        answers: dict[str, Answer] = {}
        for key, _ in questions:
            words = self.words[key.partition("#")[0]].pop(0)
            answers[key] = Transcript(None, chunks=((0.0, words.encode()),), began=NOON.timestamp())
            heard(key, answers[key])
        self.then()
        return answers


def entry(name: str, kind: ItemKind, phase: Phase, *, consent: Consent | None = None) -> PlanEntry:
    row, endpoint, *_ = name.split("/")
    step = Step(
        name="",
        title=f"title of {name}",
        kind=kind,
        phase=phase,
        probe=None if kind is ItemKind.PERSON else Heartbeat(9000 + len(name)),
        do="look at the lamp" if kind is ItemKind.PERSON else "",
        look_for="it is green" if kind is ItemKind.PERSON else "",
        consent=consent,
    )
    item = Item(
        id=name,
        title=step.title,
        vehicle=row,
        location="coastal",
        endpoint=endpoint,
        table3=True,
        kind=kind,
        phase=phase,
        open=True,
        verdict=Verdict.INCONCLUSIVE,
        message="open",
    )
    return PlanEntry(item, step, Cell(pilot(), "coastal", row, endpoint))


def checklist(*entries: PlanEntry) -> Checklist:
    row = Row(key="sparus", name="Sparus", kind="auv", table3=("wifi", "usbl", "gps"))
    return Checklist("coastal", "Coastal testbed", ("wifi", "usbl", "gps"), (row,), entries, (), Scope())


LAMP = entry("sparus/gps", ItemKind.PERSON, Phase.QUAY)
RADIO = entry("sparus/wifi", ItemKind.AUTOMATIC, Phase.BENCH)
PING = entry(
    "sparus/usbl/ping",
    ItemKind.ACTIVE,
    Phase.WATER,
    consent=Consent("Sparus is in the water, and nobody dives near it", prompt="hold the boat still"),
)


class Hung(Exception):
    """A question that the script has no answer to: a test fails with the question."""


@dataclass
class Sitting:
    folder: Path
    typed: Sequence[str]
    entries: tuple[PlanEntry, ...] = (RADIO, LAMP, PING)
    words: Mapping[str, list[str]] = field(default_factory=dict)
    price: Callable[[PlanEntry], Price | None] = lambda _entry: None
    said: list[str] = field(default_factory=list)
    at_once: bool = False

    def __post_init__(self) -> None:
        self.ears = ScriptedEars(self.words)
        self._typing = list(self.typed)
        self.desk = Prompt(self._ask, self.said.append)

    def _ask(self, question: str) -> str:
        if not self._typing:
            raise Hung(question)
        answer = self._typing.pop(0)
        self.said.append(f"{question}{answer}")
        return answer

    def book(self) -> ChecklistSession:
        head = BookHead(
            is_rehearsal=self.folder.parent.name != "real",
            tool="0",
            inventory="0" * 64,
            drawing=Drawing(nodes=(), links=()),
        )
        return ChecklistSession.open(self.folder / "checks", checklist(*self.entries), head, now=lambda: NOON)

    def turn(self, book: ChecklistSession) -> CheckWorkflow:
        ears = Listening(self.ears, self.ears)
        return CheckWorkflow(
            book, self.entries, ears, lambda item: self.desk.say(render_item(item)), self.price, self.at_once
        )

    def sit(self) -> tuple[Item, ...]:
        """Go through it; give the items as they are then."""
        with self.book() as book:
            self.turn(book).with_a_person(self.desk)
            assert self._typing == [], "the script goes on"
            return book.items

    @property
    def text(self) -> str:
        return "\n".join(self.said)

    @property
    def words_said(self) -> str:
        return " ".join(self.text.split())
