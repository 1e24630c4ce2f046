"""The way through a checklist: phase by phase with a person, all at once without one.

What a person at a desk is shown and asked, item by item.

A person at a terminal: questions, answers, and the word with which all of it is left for another time.

What an active step costs where it goes over a link that is paid by the byte.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from atlantis_netcfg.bearers.cost import CostRefused, Preview
from atlantis_netcfg.checklist import Answers, Book, Confirmation, PlanEntry, SigningRefused
from atlantis_netcfg.checklist.confirmations import named
from atlantis_netcfg.checklist.probes import AllowListTestRequest
from atlantis_netcfg.checklist.report import Evidence, EvidenceType, Item, ItemKind, Phase
from atlantis_netcfg.checklist.runner import Ears, examine
from atlantis_netcfg.cli._arguments import ACCEPT_COST
from atlantis_netcfg.core import printable
from atlantis_netcfg.core.errors import nearest
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.operations.allow_list_test.site import previews, satellite_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from atlantis_netcfg.cli._session import CommandSession
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from atlantis_netcfg.cli._session import CommandSession


GREEN = frozenset({Verdict.PASS, Verdict.WARN, Verdict.SKIP})
_PAY = "pay"
_WORDS: Mapping[str, Verdict] = {
    "yes": Verdict.PASS,
    "but": Verdict.WARN,
    "no": Verdict.FAIL,
    "unclear": Verdict.INCONCLUSIVE,
    "skip": Verdict.SKIP,
}
_NOTES: Mapping[Verdict, str] = {
    Verdict.WARN: "It holds, but:",
    Verdict.FAIL: "What was seen instead:",
    Verdict.INCONCLUSIVE: "Why nobody can tell:",
    Verdict.SKIP: "Why it does not apply here:",
}
"""What is asked after a verdict that needs words."""


def shown(item: Item) -> str:
    """Tell a result, and what to do about it."""
    hint = f"\n  {'':<12} {item.hint}" if item.hint and item.verdict not in {Verdict.PASS, Verdict.SKIP} else ""
    return f"  {item.verdict:<12} {item.id}: {item.message}{hint}"


def ready(prompt: Prompt, phase: Phase) -> bool:
    """Whether things are where the next phase looks at them; otherwise it is left open. Raises Later."""
    return prompt.choose(f"Is everything {_WHERE[phase]} and switched on?", {"yes": True, "skip": False})


_WHERE: Mapping[Phase, str] = {
    Phase.BENCH: "on the bench",
    Phase.QUAY: "at the quay",
    Phase.WATER: "in the water",
}


def confirm(book: Book, prompt: Prompt, entry: PlanEntry) -> None:
    """Show what to do and what to look for, and write down the answer. Raises Later."""
    prompt.say(f"\n{entry.item.id}: {entry.item.title}")
    prompt.say(f"  do        {entry.step.do}\n  look for  {entry.step.look_for}")
    _confirm(book, prompt, entry)


def _confirm(book: Book, prompt: Prompt, entry: PlanEntry) -> None:
    while True:
        try:
            prompt.say(shown(book.confirm(entry.item.id, _answer(prompt))))
        except SigningRefused as refused:
            prompt.say(f"  {refused}: {refused.hint}")
        else:
            return


def _answer(prompt: Prompt) -> Confirmation:
    verdict = prompt.choose("Does it hold?", _WORDS)
    note = prompt.needs(_NOTES[verdict]) if verdict in _NOTES else prompt.ask("Note (may be empty):")
    return Confirmation(verdict=verdict, by=prompt.name, note=note, files=prompt.files())


def consent(prompt: Prompt, entry: PlanEntry, price: Price | None) -> str | None:
    """Ask for the word that an active step needs, and for the money. None: it is not given. Raises Later."""
    needed = entry.step.consent
    assert needed is not None, "only active steps are asked for"  # noqa: S101 - Step holds it
    prompt.say(f"\n{entry.item.id}: {entry.item.title}\n  It is done only on your word: {needed.question}.")
    if not prompt.agrees("Is that so, and shall it be done now?"):
        return None
    if price is not None:
        prompt.say(f"  This goes {price.words}" if price.due else f"  a real one asks first: it goes {price.words}")
        if price.due and prompt.ask(f"Pay for it? Type {_PAY} to go on:").lower() != _PAY:
            return None
    return prompt.name


def otherwise(book: Book, prompt: Prompt, entry: PlanEntry) -> None:
    """What becomes of an active step that is not done. Raises Later."""
    if not book.item(entry.item.id).open:
        return
    match prompt.choose("Leave it `open`, answer it as `seen` otherwise, or `override` it on your word?", _ELSE):
        case "seen":
            _confirm(book, prompt, entry)
        case "override":
            _override(book, prompt, book.item(entry.item.id))


def mend(book: Book, prompt: Prompt, entry: PlanEntry, probe: Callable[[PlanEntry], None], *, read: bool) -> None:
    """As long as an item is not green: look again, or take the responsibility, or leave it as it is. Raises Later.

    `read`: its result is the line above.
    """
    if not read and book.item(entry.item.id).counts not in GREEN:
        prompt.say(shown(book.item(entry.item.id)))
    while (item := book.item(entry.item.id)).counts not in GREEN:
        match prompt.choose("Look `again`, `override` it on your word, or go `on`?", _AFTER):
            case "on":
                return
            case "override":
                _override(book, prompt, item)
            case _ if entry.item.kind is ItemKind.PERSON:
                confirm(book, prompt, entry)
            case _:
                probe(entry)


def _override(book: Book, prompt: Prompt, item: Item) -> None:
    try:
        book.override(item.id, prompt.needs("The reason, which stands in the report:"), prompt.name)
    except SigningRefused as refused:
        prompt.say(f"  {refused}: {refused.hint}")


_AFTER = {word: word for word in ("again", "override", "on")}
_ELSE = {word: word for word in ("open", "seen", "override")}


@dataclass(slots=True)
class CheckWorkflow:
    """One sitting over a book."""

    book: Book
    entries: Sequence[PlanEntry]
    ears: Listening
    show: Callable[[Item], None]
    """Called with each result as soon as it is in the book."""
    price: Callable[[PlanEntry], Price | None]
    """What an active step costs on a metered link. Raises CostRefused."""
    at_once: bool = False
    """Nobody carries anything to the quay or into the water between the phases: it is a rehearsal."""

    def alone(self, answers: Answers | None) -> tuple[str, ...]:
        """Look at all that needs no person, and at what the answers consent to; then write the answers down.

        What was green at an earlier sitting is looked at again: without a person nobody can say that it still is.
        Gives what of the answers was not needed, in words.
        """
        agreed = self._consented(answers) if answers is not None else {}
        self._examine([entry for entry in self.entries if self._by_itself(entry) or entry.item.id in agreed], agreed)
        return answers.write_down(self.book, self.show) if answers is not None else ()

    def with_a_person(self, prompt: Prompt) -> None:
        """Go through what is not green, phase by phase. Raises Later."""
        if self.at_once:
            self._examine(self._unseen(self.entries), {})
        before = None
        for phase in Phase:
            entries = [entry for entry in self.entries if entry.item.phase is phase and not self._green(entry)]
            if not entries:
                continue
            prompt.say(f"\n{str(phase).upper()}")
            if before is None or not self._unseen(entries) or ready(prompt, phase):
                self._phase(prompt, entries)
            before = phase

    def _phase(self, prompt: Prompt, entries: Sequence[PlanEntry]) -> None:
        self._examine(self._unseen(entries), {})
        for entry in entries:
            is_requested = self._open(entry)
            if entry.item.kind is ItemKind.PERSON and self._open(entry):
                confirm(self.book, prompt, entry)
            elif entry.item.kind is ItemKind.ACTIVE and self._open(entry):
                self._act(prompt, entry)
            if not self._open(entry):
                mend(self.book, prompt, entry, lambda item: self._again(prompt, item), read=is_requested)

    def _unseen(self, entries: Sequence[PlanEntry]) -> list[PlanEntry]:
        return [entry for entry in entries if entry.item.kind is ItemKind.AUTOMATIC and self._open(entry)]

    def _again(self, prompt: Prompt, entry: PlanEntry) -> None:
        if entry.item.kind is ItemKind.ACTIVE:
            self._act(prompt, entry)
        else:
            self._examine([entry], {})

    def _act(self, prompt: Prompt, entry: PlanEntry) -> None:
        """Ask for the word, say what the person does meanwhile, and look; not where the thing itself has failed."""
        sick = self._sick(entry)
        if sick is not None:
            prompt.say(f"\n{entry.item.id}: {entry.item.title}\n  not now: {sick.message} ({sick.id})")
            otherwise(self.book, prompt, entry)
            return
        try:
            by = consent(prompt, entry, self.price(entry))
        except CostRefused as refused:
            prompt.say(f"\n{entry.item.id}: {entry.item.title}\n  {refused}\n  {refused.hint or ''}".rstrip())
            by = None
        if by is None:
            otherwise(self.book, prompt, entry)
            return
        if entry.step.consent is not None and entry.step.consent.prompt:
            prompt.say(f"  Now: {entry.step.consent.prompt}.")
        self._examine([entry], {entry.item.id: by}, paid=True)

    def _sick(self, entry: PlanEntry) -> Item | None:
        """What the tool has seen fail in the same cell: nobody is asked to move a stick of an armed vehicle."""
        cell = [other for other in self.entries if other.cell == entry.cell and other.item.kind is ItemKind.AUTOMATIC]
        items = (self.book.item(other.item.id) for other in cell)
        return next((item for item in items if item.counts is Verdict.FAIL), None)

    def _examine(self, entries: Sequence[PlanEntry], agreed: Mapping[str, str], *, paid: bool = False) -> None:
        """`agreed`: who has consented to which active item; `paid`: to its cost as well."""

        def settled(item: Item) -> None:
            by = agreed.get(item.id)
            self.show(self.book.settle(_with_consent(item, steps[item.id], by) if by is not None else item))

        steps = {entry.item.id: entry for entry in entries}
        if entries:
            asyncio.run(examine(entries, self.ears.paid if paid else self.ears.free, settled))

    def _consented(self, answers: Answers) -> dict[str, str]:
        """The active items that the answers consent to, and that are paid for or cost nothing."""
        desired = [item for item in self.entries if item.item.kind is ItemKind.ACTIVE and not self._green(item)]
        values = {entry.item.id: answers.consents(entry.item.id) for entry in desired if not self._due(entry)}
        return {item_id: by for item_id, by in values.items() if by is not None}

    def _due(self, entry: PlanEntry) -> bool:
        """Whether it costs what nobody has agreed to pay: a file of answers pays for nothing."""
        try:
            price = self.price(entry)
        except CostRefused:
            return True
        return price is not None and price.due

    def _by_itself(self, entry: PlanEntry) -> bool:
        item = self.book.item(entry.item.id)
        return item.kind is ItemKind.AUTOMATIC and item.override is None and not entry.step.unless

    def _green(self, entry: PlanEntry) -> bool:
        return not self._open(entry) and self.book.item(entry.item.id).counts in GREEN

    def _open(self, entry: PlanEntry) -> bool:
        item = self.book.item(entry.item.id)
        return item.open and item.override is None


def _with_consent(item: Item, entry: PlanEntry, by: str) -> Item:
    """Put the person's word among the evidence of an active item; `by`: who, and behind a colon in which words."""
    assert entry.step.consent is not None, "only active steps are consented to"  # noqa: S101 - Step holds it
    name, _, words = by.partition(": ")
    text = f"{entry.step.consent.question}{f' ({words})' if words else ''}"
    word = Evidence(type=EvidenceType.CONFIRMED, what="consent", value=text, at=item.at, by=name)
    return item.model_copy(update={"evidence": (*item.evidence, word)})


T = TypeVar("T")
LATER = "later"
"""Typed in answer to any question: what is answered stays, the rest is open."""


class PromptAborted(Exception):
    """The person goes on another time."""


class Prompt:
    """Where somebody is asked; `ask` and `say` are those of a terminal, unless a test brings its own."""

    def __init__(self, ask: Callable[[str], str] = input, say: Callable[[str], None] = print) -> None:
        self._ask = ask
        self._say = say
        self._name = ""

    def say(self, text: str = "") -> None:
        """Print lines; what came from a device or a file cannot move the cursor."""
        self._say(printable.lines(text))

    def ask(self, question: str) -> str:
        """One answer, which may be empty. Raises Later."""
        try:
            answer = self._ask(f"{printable.lines(question)} ").strip()
        except EOFError:
            raise PromptAborted from None
        if answer.lower() == LATER:
            raise PromptAborted
        return answer

    def choose(self, question: str, words: Mapping[str, T], default: str = "") -> T:
        """One of these words, or what `default` means for an empty answer; a first letter is enough if it is alone."""
        while True:
            typed = self.ask(f"{question} [{', '.join(words)}, {LATER}]").lower() or default
            known = [word for word in words if typed and word.startswith(typed)]
            if typed in words or len(known) == 1:
                return words[typed if typed in words else known[0]]
            near = nearest(typed, words)
            self.say(f"  type one of: {', '.join(words)}, {LATER}{f' (`{near}`?)' if near else ''}")

    def agrees(self, question: str) -> bool:
        """Whether the whole word is given: a slip of the finger is no consent."""
        return self.ask(f"{question} Type yes, or anything else for no:").lower() == "yes"

    def needs(self, question: str) -> str:
        """An answer that is not empty."""
        while not (answer := self.ask(question)):
            self.say(f"  something has to stand here; `{LATER}` leaves it open")
        return answer

    @property
    def name(self) -> str:
        """Who answers: asked once."""
        while not self._name:
            try:
                self._name = named(self.needs("Your name, as it shall stand in the report:"))
            except SigningRefused as refused:
                self.say(f"  {refused}: {refused.hint}")
        return self._name

    def files(self) -> tuple[Path, ...]:
        """Photos or files that show it; none with an empty answer."""
        found: list[Path] = []
        while typed := self.ask("Photo or file that shows it (a path; empty: none or no more):"):
            path = Path(typed).expanduser()
            if path.is_file():
                found.append(path)
            else:
                self.say(f"  there is no file {typed}")
        return tuple(found)


@dataclass(frozen=True, slots=True)
class Price:
    """An estimate in words."""

    words: str
    due: bool
    """Whether somebody has to agree to pay; in a rehearsal nobody has, nor where `--accept-cost` was typed."""


def price_of(opened: CommandSession, entry: PlanEntry) -> Price | None:
    """The price of an active step; None: it costs nothing. Raises CostRefused above the declared cap."""
    if entry.step.probe is None or entry.step.consent is None or not entry.step.consent.cost:
        return None
    proofs = [ask for ask in entry.step.probe.asks() if isinstance(ask, AllowListTestRequest)]
    metered = [each for proof in proofs for each in _previews(opened, proof.bearer) if each.link.metered]
    for item in metered:
        if item.over_cap and not opened.rehearsed:
            raise item.refusal()
    if not metered:
        return None
    due = not opened.rehearsed and not opened.arguments.flag(ACCEPT_COST.name)
    return Price("; ".join(preview.words for preview in metered), due)


def _previews(opened: CommandSession, bearer: str) -> tuple[Preview, ...]:
    found = satellite_of(opened.declaration, opened.site, bearer)
    via = opened.arguments.optional("via")
    return previews(opened.declaration, found.proving(opened.declaration, rehearsed=opened.rehearsed, via=via))


@dataclass(frozen=True, slots=True)
class Listening:
    """The ears of a site."""

    free: Ears
    paid: Ears
    """The same when somebody has agreed to pay for what is asked."""
