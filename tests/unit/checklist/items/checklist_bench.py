"""A small checklist of our own, so that these tests hold whatever the columns look at."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path

from atlantis_netcfg.checklist import BookHead, Checklist, ChecklistSession, Confirmation, PlanEntry, Scope
from atlantis_netcfg.checklist.probes import Answer, Cell, Consent, ProbeResult, Question, Step
from atlantis_netcfg.checklist.report import Document, Drawing, Item, ItemKind, Phase, Row
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.inventory import Inventory

NAME = "A. Technician"
WIFI, FAILSAFE, PING, USBL, DHCP, SKIPPED = EVERY = (
    *("sparus/wifi", "stork/rc_rf/failsafe", "sparus/usbl/ping", "eca-rov/usbl"),
    *("coastal/site/rogue-dhcp", "coastal/site/satellite-filter"),
)
_KINDS = {
    WIFI: (ItemKind.AUTOMATIC, Phase.QUAY),
    FAILSAFE: (ItemKind.PERSON, Phase.BENCH),
    PING: (ItemKind.ACTIVE, Phase.WATER),
    USBL: (ItemKind.PERSON, Phase.WATER),
    DHCP: (ItemKind.AUTOMATIC, Phase.BENCH),
    SKIPPED: (ItemKind.AUTOMATIC, Phase.BENCH),
}
HEAD = BookHead(is_rehearsal=False, tool="1.0", inventory="ab" * 32, drawing=Drawing(nodes=(), links=()))


class Deaf:
    def asks(self) -> tuple[Question, ...]:
        return ()

    def judge(self, heard: Mapping[str, Answer]) -> ProbeResult:
        assert not heard
        return ProbeResult(())


@dataclass
class Clock:
    at: datetime = datetime(2026, 11, 22, 10, 0, tzinfo=UTC)

    def __call__(self) -> datetime:
        self.at += timedelta(minutes=1)
        return self.at


def entry(name: str) -> PlanEntry:
    row, endpoint, step = (*name.split("/"), "")[:3]
    kind, phase = _KINDS.get(name, (ItemKind.PERSON, Phase.BENCH))
    unless = "no satellite here" if name == SKIPPED else ""
    vehicle = None if row == "coastal" else row
    cell = Cell(Inventory.__new__(Inventory), "coastal", vehicle, endpoint)
    made = Step(
        name=step,
        title=f"{name} is well",
        kind=kind,
        phase=phase,
        probe=None if kind is ItemKind.PERSON else Deaf(),
        consent=Consent("it is in the water") if kind is ItemKind.ACTIVE else None,
        unless=unless,
    )
    item = Item(
        id=name,
        title=made.title,
        vehicle=vehicle,
        location="coastal",
        endpoint=endpoint,
        table3=vehicle is not None,
        kind=kind,
        phase=phase,
        open=not unless,
        verdict=Verdict.SKIP if unless else Verdict.INCONCLUSIVE,
        message=unless or "waits",
    )
    return PlanEntry(item, made, cell)


def checklist(names: Sequence[str] = EVERY, scope: Scope | None = None) -> Checklist:
    row = Row(key="sparus", name="Sparus", kind="auv", table3=("wifi", "usbl"))
    entries = tuple(entry(name) for name in names)
    return Checklist("coastal", "Coastal testbed", ("wifi", "usbl"), (row,), entries, (), scope or Scope())


def found(name: str, verdict: Verdict = Verdict.PASS, message: str = "as it should be") -> Item:
    return entry(name).item.model_copy(update={"verdict": verdict, "message": message})


def pages(document: Document) -> Mapping[str, bytes]:
    return {"report.html": f"<p>{document.run}</p>".encode(), "junit.xml": b"<testsuites/>"}


@dataclass
class Desk:
    """Opens books of one site with one clock."""

    state: Path
    now: Clock = field(default_factory=Clock)

    @property
    def folder(self) -> Path:
        return self.state / "real" / "coastal" / "checks"

    @property
    def key(self) -> Path:
        return self.state / "checklist.key"

    def open(
        self, names: Sequence[str] = EVERY, head: BookHead = HEAD, *, scope: Scope | None = None, anew: bool = False
    ) -> ChecklistSession:
        return ChecklistSession.open(self.folder, checklist(names, scope), head, now=self.now, anew=anew)

    def signed(
        self, verdicts: Mapping[str, Verdict] | None = None, names: Sequence[str] = EVERY, *, scope: Scope | None = None
    ) -> Path:
        """A signed book's folder; everything passes but what `verdicts` says."""
        with self.open(names, scope=scope) as book:
            answer(book, verdicts or {})
            book.sign(NAME, pages)
            return book.folder


def open_items(book: ChecklistSession, phase: Phase | None = None) -> list[Item]:
    """What nobody has settled or overridden, of a phase or of all."""
    return [item for item in book.items if item.open and item.override is None and phase in {None, item.phase}]


def answer(book: ChecklistSession, verdicts: Mapping[str, Verdict] | None = None) -> None:
    for item in open_items(book):
        verdict = (verdicts or {}).get(item.id, Verdict.PASS)
        if item.kind is ItemKind.PERSON:
            note = "" if verdict is Verdict.PASS else "seen so"
            book.confirm(item.id, Confirmation(verdict, NAME, note))
        else:
            book.settle(found(item.id, verdict))
