"""The way through a checklist: phase by phase with a person, all at once without one.

What a person at a desk is shown and asked, item by item.

A person at a terminal: questions, answers, and the word with which all of it is left for another time.

What an active step costs where it goes over a link that is paid by the byte.
"""

from __future__ import annotations

import asyncio
import math
import re
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, TypeVar

from atlantis_netcfg import checklist
from atlantis_netcfg.checklist import confirmations, report
from atlantis_netcfg.checklist.probes import AllowListTestRequest
from atlantis_netcfg.checklist.runner import Ears, examine
from atlantis_netcfg.cli.base.consent import NO, PAY, YES, plain, shown_word, taken_words, whole_word, yes_or_no
from atlantis_netcfg.cli.base.syntax import ACCEPT_COST
from atlantis_netcfg.core import printable
from atlantis_netcfg.core.errors import nearest
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.inventory.model import EvidenceKind
from atlantis_netcfg.links.cost import CostRefusal, Preview
from atlantis_netcfg.operations.allow_list_test.site import previews, satellite_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from atlantis_netcfg.checklist.probes import Step
    from atlantis_netcfg.cli.base.session import CommandSession


GREEN = frozenset({Verdict.PASS, Verdict.WARN, Verdict.SKIP})
_WORDS: Mapping[str, Verdict] = {
    YES: Verdict.PASS,
    "but": Verdict.WARN,
    NO: Verdict.FAIL,
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


def render_item(item: report.Item) -> str:
    """Tell a result, and what to do about it."""
    hint = item.hint if item.hint and item.verdict not in {Verdict.PASS, Verdict.SKIP} else None
    return f"  {item.verdict:<12} {item.id}: {translate(item.message)}" + (
        f"\n  {'':<12} {translate(hint)}" if hint is not None else ""
    )


def ready(prompt: Prompt, phase: report.Phase) -> bool:
    """Whether things are where the next phase looks at them; otherwise it is left open. Raises Later."""
    return prompt.choose(_READY[phase], {YES: True, "skip": False})


_READY: Mapping[report.Phase, str] = {
    report.Phase.BENCH: "Is everything on the bench and switched on?",
    report.Phase.QUAY: "Is everything at the quay and switched on?",
    report.Phase.WATER: "Is everything in the water and switched on?",
    report.Phase.RECOVERY: "Is everything back?",
    report.Phase.INTEGRATION: "Is the robot switched on, and its interface started?",
}


def confirm(book: checklist.Book, prompt: Prompt, entry: checklist.PlanEntry) -> None:
    """Show what to do and what to look for, and write down the answer. Raises Later."""
    _title(prompt, entry)
    step = entry.step
    if step.do:
        prompt.say(translate(f"  do        {step.do}"))
    prompt.say(translate(f"  look for  {step.look_for}"))
    if step.evidence.words:
        prompt.say(translate(f"  give      {step.evidence.words}"))
    if step.by:
        prompt.say(translate(f"  answers   {', '.join(step.by)}, and nobody else"))
    _confirm(book, prompt, entry)


def _title(prompt: Prompt, entry: checklist.PlanEntry) -> None:
    prompt.say(f"\n{entry.item.id}: {report.item_title(entry.item)}")


def _confirm(book: checklist.Book, prompt: Prompt, entry: checklist.PlanEntry) -> None:
    while True:
        try:
            prompt.say(render_item(book.confirm(entry.item.id, _answer(prompt, entry.step))))
        except checklist.ChecklistUsageError as refused:
            prompt.refuses(refused)
        else:
            return


def _answer(prompt: Prompt, step: Step) -> checklist.Confirmation:
    verdict = _verdict(prompt)
    request, holds = step.evidence, verdict in {Verdict.PASS, Verdict.WARN}
    number, photo = (holds and request.kind is kind for kind in (EvidenceKind.NUMBER, EvidenceKind.PHOTO))
    value = prompt.number(f"The number, in {request.unit}:") if number else None
    if verdict in _NOTES:
        note = prompt.needs(_NOTES[verdict])
    elif request.kind is EvidenceKind.TEXT:
        note = prompt.needs("What was seen:")
    else:
        note = prompt.ask("Note (may be empty):")
    return checklist.Confirmation(
        verdict=verdict, by=prompt.name_of(step.by), note=note, files=prompt.files(photo=photo), value=value
    )


def _verdict(prompt: Prompt) -> Verdict:
    """What was seen; that it failed is asked once more, since a slip of the finger says so too."""
    while True:
        verdict = prompt.choose("Does it hold?", _WORDS)
        if verdict is not Verdict.FAIL or prompt.is_so(f"You answered {shown_word(NO)}: FAIL is kept. Is that right?"):
            return verdict


def consent(prompt: Prompt, entry: checklist.PlanEntry, price: Price | None) -> str | None:
    """Ask for the word that an active step needs, and for the money. None: it is not given. Raises Later."""
    condition = entry.step.consent
    assert condition is not None, "only active steps are asked for"  # noqa: S101 - Step holds it
    _title(prompt, entry)
    prompt.say(translate(f"  It is done only on your word: {condition.question}."))
    if not prompt.agrees("Is that so, and shall it be done now?"):
        return None
    if price is not None:
        words = f"  This goes {price.words}" if price.due else f"  a real one asks first: it goes {price.words}"
        prompt.say(translate(words))
        if price.due and not prompt.agrees("Pay for it?", PAY):
            return None
    return prompt.name


def otherwise(book: checklist.Book, prompt: Prompt, entry: checklist.PlanEntry) -> None:
    """What becomes of an active step that is not done. Raises Later."""
    if not book.item(entry.item.id).open:
        return
    leave_word, seen_word, override = map(shown_word, _ELSE)
    question = f"Leave it `{leave_word}`, answer it as `{seen_word}` otherwise, or `{override}` it on your word?"
    match prompt.choose(question, _ELSE):
        case "seen":
            _confirm(book, prompt, entry)
        case "override":
            _override(book, prompt, entry)


def mend(
    book: checklist.Book,
    prompt: Prompt,
    entry: checklist.PlanEntry,
    probe: Callable[[checklist.PlanEntry], None],
    *,
    read: bool,
) -> None:
    """As long as an item is not green: look again, or take the responsibility, or leave it as it is. Raises Later.

    `read`: its result is the line above.
    """
    if not read and book.item(entry.item.id).counts not in GREEN:
        prompt.say(render_item(book.item(entry.item.id)))
    while book.item(entry.item.id).counts not in GREEN and _ask_correction(book, prompt, entry, probe):
        pass


def correct(
    book: checklist.Book, prompt: Prompt, entry: checklist.PlanEntry, probe: Callable[[checklist.PlanEntry], None]
) -> None:
    """Show how an item stands, and let it be looked at or answered again, whatever it is. Raises Later."""
    prompt.say(render_item(book.item(entry.item.id)))
    if _ask_correction(book, prompt, entry, probe):
        mend(book, prompt, entry, probe, read=True)


def _ask_correction(
    book: checklist.Book, prompt: Prompt, entry: checklist.PlanEntry, probe: Callable[[checklist.PlanEntry], None]
) -> bool:
    """Ask what becomes of an item; False: it stays as it is."""
    item = book.item(entry.item.id)
    again, override, on = map(shown_word, _AFTER)
    if item.verdict in confirmations.OVERRIDABLE:
        choice = prompt.choose(f"Look `{again}`, `{override}` it on your word, or go `{on}`?", _AFTER)
    else:
        choice = prompt.choose(f"Look `{again}`, or go `{on}`?", _AGAIN)
    if choice == "override":
        _override(book, prompt, entry)
    elif choice == "again" and item.kind is report.ItemKind.PERSON:
        confirm(book, prompt, entry)
    elif choice == "again":
        probe(entry)
    return choice != "on"


def _override(book: checklist.Book, prompt: Prompt, entry: checklist.PlanEntry) -> None:
    try:
        reason = prompt.needs("The reason, which stands in the report:")
        book.override(entry.item.id, reason, prompt.name_of(entry.step.by))
    except checklist.ChecklistUsageError as refused:
        prompt.refuses(refused)


_AFTER = {word: word for word in ("again", "override", "on")}
_AGAIN = {word: word for word in ("again", "on")}
_ELSE = {word: word for word in ("open", "seen", "override")}


@dataclass(slots=True)
class CheckWorkflow:
    """One sitting over a book."""

    book: checklist.Book
    entries: Sequence[checklist.PlanEntry]
    ears: Listening
    show: Callable[[report.Item], None]
    """Called with each result as soon as it is in the book."""
    price: Callable[[checklist.PlanEntry], Price | None]
    """What an active step costs on a metered link. Raises CostRefused."""
    at_once: bool = False
    """Nobody carries anything to the quay or into the water between the phases: it is a rehearsal."""
    _visited_entries: list[checklist.PlanEntry] = field(default_factory=list)
    """What a person was asked about in this sitting, for `back`."""

    def alone(self, answers: checklist.Answers | None) -> tuple[str, ...]:
        """Look at all that needs no person, and at what the answers consent to; then write the answers down.

        What was green at an earlier sitting is looked at again: without a person nobody can say that it still is.
        Gives what of the answers was not needed, in words.
        """
        consents = self._collect_consents(answers) if answers is not None else {}
        self._examine(
            [entry for entry in self.entries if self._by_itself(entry) or entry.item.id in consents], consents
        )
        return answers.write_down(self.book, self.show) if answers is not None else ()

    def with_a_person(self, prompt: Prompt) -> None:
        """Go through what is not green, phase by phase. Raises Later."""
        if self.at_once:
            self._examine(self._unseen(self.entries), {})
        before = None
        for phase in report.Phase:
            entries = [entry for entry in self.entries if entry.item.phase is phase and not self._green(entry)]
            if not entries:
                continue
            prompt.say(f"\n{translate(_PHASES[phase])}")
            if before is None or not self._unseen(entries) or self._ready(prompt, phase):
                self._phase(prompt, entries)
            before = phase

    def _phase(self, prompt: Prompt, entries: Sequence[checklist.PlanEntry]) -> None:
        self._examine(self._unseen(entries), {})
        for entry in entries:
            self._visit(prompt, entry, partial(self._settle, prompt, entry))

    def _settle(self, prompt: Prompt, entry: checklist.PlanEntry) -> None:
        """Ask what one item needs."""
        is_requested = self._open(entry)
        if entry.item.kind is report.ItemKind.PERSON and is_requested:
            confirm(self.book, prompt, entry)
        elif entry.item.kind is report.ItemKind.ACTIVE and is_requested:
            self._act(prompt, entry)
        if not self._open(entry):
            mend(self.book, prompt, entry, partial(self._again, prompt), read=is_requested)

    def _visit(self, prompt: Prompt, entry: checklist.PlanEntry, ask: Callable[[], None]) -> None:
        """Ask about one item; `back` begins it anew, at its first question it leads to the one before. Raises Later."""
        while True:
            prompt.begin(self._place(entry))
            try:
                ask()
            except PromptBack:
                if not prompt.answers:
                    self.go_back(prompt)
                elif not self._open(entry):
                    ask = partial(correct, self.book, prompt, entry, partial(self._again, prompt))
            else:
                break
        if prompt.answers:
            self._visited_entries.append(entry)
        prompt.begin("")

    def go_back(self, prompt: Prompt) -> None:
        """Ask about the last item again; what was answered before stays in the log. Raises Later."""
        if not self._visited_entries:
            prompt.say(translate("  this is the first question"))
            return
        entry = self._visited_entries.pop()
        _title(prompt, entry)
        if self._open(entry):
            self._visit(prompt, entry, partial(self._settle, prompt, entry))
        else:
            self._visit(prompt, entry, partial(correct, self.book, prompt, entry, partial(self._again, prompt)))

    def _place(self, entry: checklist.PlanEntry) -> str:
        """Which item of how many, in the order of the phases."""
        order = sorted(self.entries, key=lambda each: tuple(report.Phase).index(each.item.phase))
        return translate(f"item {order.index(entry) + 1} of {len(order)}")

    def _ready(self, prompt: Prompt, phase: report.Phase) -> bool:
        while True:
            try:
                return ready(prompt, phase)
            except PromptBack:
                self.go_back(prompt)

    def _unseen(self, entries: Sequence[checklist.PlanEntry]) -> list[checklist.PlanEntry]:
        return [entry for entry in entries if entry.item.kind is report.ItemKind.AUTOMATIC and self._open(entry)]

    def _again(self, prompt: Prompt, entry: checklist.PlanEntry) -> None:
        if entry.item.kind is report.ItemKind.ACTIVE:
            self._act(prompt, entry)
        else:
            self._examine([entry], {})

    def _act(self, prompt: Prompt, entry: checklist.PlanEntry) -> None:
        """Ask for the word, say what the person does meanwhile, and look; not where the thing itself has failed."""
        sick = self._sick(entry)
        if sick is not None:
            _title(prompt, entry)
            prompt.say(f"{translate(f'  not now: {sick.message}')} ({sick.id})")
            otherwise(self.book, prompt, entry)
            return
        try:
            by = consent(prompt, entry, self.price(entry))
        except CostRefusal as refused:
            _title(prompt, entry)
            for words in filter(None, (str(refused), refused.hint)):
                prompt.say(f"  {translate(words)}")
            by = None
        if by is None:
            otherwise(self.book, prompt, entry)
            return
        if entry.step.consent is not None and entry.step.consent.prompt:
            prompt.say(translate(f"  Now: {entry.step.consent.prompt}."))
        self._examine([entry], {entry.item.id: by}, is_paid=True)

    def _sick(self, entry: checklist.PlanEntry) -> report.Item | None:
        """What the tool has seen fail in the same cell: nobody is asked to move a stick of an armed vehicle."""
        cell = [
            other for other in self.entries if other.cell == entry.cell and other.item.kind is report.ItemKind.AUTOMATIC
        ]
        items = (self.book.item(other.item.id) for other in cell)
        return next((item for item in items if item.counts is Verdict.FAIL), None)

    def _examine(
        self, entries: Sequence[checklist.PlanEntry], consents: Mapping[str, str], *, is_paid: bool = False
    ) -> None:
        """`consents`: who has consented to which active item; `is_paid`: to its cost as well."""

        def settle(item: report.Item) -> None:
            by = consents.get(item.id)
            self.show(self.book.settle(_with_consent(item, steps[item.id], by) if by is not None else item))

        steps = {entry.item.id: entry for entry in entries}
        if entries:
            asyncio.run(examine(entries, self.ears.paid_ears if is_paid else self.ears.free, settle))

    def _collect_consents(self, answers: checklist.Answers) -> dict[str, str]:
        """The active items that the answers consent to, and that are paid for or cost nothing."""
        active_entries = [
            item for item in self.entries if item.item.kind is report.ItemKind.ACTIVE and not self._green(item)
        ]
        values = {entry.item.id: answers.consents(entry.item.id) for entry in active_entries if not self._due(entry)}
        return {item_id: by for item_id, by in values.items() if by is not None}

    def _due(self, entry: checklist.PlanEntry) -> bool:
        """Whether it costs what nobody has agreed to pay: a file of answers pays for nothing."""
        try:
            price = self.price(entry)
        except CostRefusal:
            return True
        return price is not None and price.due

    def _by_itself(self, entry: checklist.PlanEntry) -> bool:
        item = self.book.item(entry.item.id)
        return item.kind is report.ItemKind.AUTOMATIC and item.override is None and not entry.step.unless

    def _green(self, entry: checklist.PlanEntry) -> bool:
        return not self._open(entry) and self.book.item(entry.item.id).counts in GREEN

    def _open(self, entry: checklist.PlanEntry) -> bool:
        item = self.book.item(entry.item.id)
        return item.open and item.override is None


def _with_consent(item: report.Item, entry: checklist.PlanEntry, by: str) -> report.Item:
    """Put the person's word among the evidence of an active item; `by`: who, and behind a colon in which words."""
    assert entry.step.consent is not None, "only active steps are consented to"  # noqa: S101 - Step holds it
    name, _, words = by.partition(": ")
    text = f"{entry.step.consent.question}{f' ({words})' if words else ''}"
    word = report.Evidence(type=report.EvidenceType.CONFIRMED, what="consent", value=text, at=item.at, by=name)
    return item.model_copy(update={"evidence": (*item.evidence, word)})


_PHASES: Mapping[report.Phase, str] = {
    report.Phase.BENCH: "BENCH",
    report.Phase.QUAY: "QUAY",
    report.Phase.WATER: "IN WATER",
    report.Phase.RECOVERY: "RECOVERY",
    report.Phase.INTEGRATION: "INTEGRATION",
}
T = TypeVar("T")
LATER, BACK = "later", "back"
"""Typed in answer to any question: what is answered stays, the rest is open; and: to the question before."""
_WIDTH = 80
_ANSWER = 9
"""Columns that stay for an answer behind its choices."""


class PromptAbort(Exception):
    """The person goes on another time."""


class PromptBack(Exception):
    """The person goes to the question before."""


class Prompt:
    """Where somebody is asked; `ask` and `say` are those of a terminal, unless a test brings its own."""

    def __init__(self, ask: Callable[[str], str] = input, say: Callable[[str], None] = print) -> None:
        self._ask = ask
        self._say = say
        self._name = ""
        self._place = ""
        self.answers = 0
        """Given since `begin`."""

    def begin(self, place: str) -> None:
        """Ask about another item from here on; `place`: `item 3 of 9`, which stands before each question."""
        self._place, self.answers = place, 0

    def say(self, text: str = "") -> None:
        """Print lines, in the person's language already; what came from a device or a file cannot move the cursor."""
        self._say(_fit(printable.lines(text)))

    def refuses(self, refusal: checklist.ChecklistUsageError) -> None:
        """Say why an answer is not taken, and what to do."""
        self.say(f"  {translate(str(refusal))}: {translate(refusal.hint or '')}")

    def ask(self, question: str) -> str:
        """One answer, which may be empty. Raises Later, Back."""
        return self._read(translate(question))

    def _read(self, question: str) -> str:
        """The answer to a question that is in the person's language already."""
        place = f"({self._place}) " if self._place else ""
        try:
            answer = self._ask(f"{_fit(place + printable.lines(question).rstrip())} ").strip()
        except EOFError:
            raise PromptAbort from None
        if plain(answer) in taken_words(LATER):
            raise PromptAbort
        if plain(answer) in taken_words(BACK):
            raise PromptBack
        self.answers += 1
        return answer

    def choose(self, question: str, words: Mapping[str, T], default: str = "") -> T:
        """One of these words, or what `default` means for an empty answer; a first letter is enough if it is alone."""
        every = (*words, BACK, LATER)
        choices = ", ".join(map(shown_word, every))
        while True:
            answer = plain(self._read(self._with_choices(translate(question), choices))) or default
            word = _match_word(answer, every)
            if word == LATER:
                raise PromptAbort
            if word == BACK:
                self.answers -= 1
                raise PromptBack
            if word is not None:
                return words[word]
            near = nearest(answer, map(shown_word, words))
            self.say(translate(f"  type one of: {choices}") + (f" (`{near}`?)" if near else ""))

    def _with_choices(self, question: str, choices: str) -> str:
        """Beside the question where a terminal has room for both, else below it."""
        room = len(f"({self._place}) {question} [{choices}]") + _ANSWER <= _WIDTH
        return f"{question}{' ' if room else chr(10) + '  '}[{choices}]"

    def agrees(self, question: str, word: str = YES) -> bool:
        """Whether the whole word is given: a slip of the finger is no consent."""
        return whole_word(question, self._read, self.say, word=word)

    def is_so(self, question: str) -> bool:
        """Yes or no, where nothing happens by the answer."""
        return yes_or_no(question, self._read, self.say)

    def needs(self, question: str) -> str:
        """An answer that is not empty."""
        while not (answer := self.ask(question)):
            self.say(translate(f"  something has to stand here; `{shown_word(LATER)}` leaves it open"))
        return answer

    @property
    def name(self) -> str:
        """Who answers: asked once."""
        while not self._name:
            try:
                name = confirmations.clean_name(self.needs("Your name, as it shall stand in the report:"))
            except checklist.ChecklistUsageError as refused:
                self.refuses(refused)
                continue
            if (doubt := doubt_of_name(name)) is None or self.is_so(doubt):
                self._name = name
        return self._name

    def name_of(self, people: Sequence[str]) -> str:
        """Who answers: the person at the terminal, or, where others alone may, one of these. Raises Later, Back."""
        if not people or confirmations.refused_person(self.name, people, "answer") is None:
            return self.name
        while True:
            name = self.needs(f"Who of them is it: {', '.join(people)}?")
            if (wrong := confirmations.refused_person(name, people, "answer")) is None:
                return name
            self.say(translate(f"  {wrong[0]}"))

    def number(self, question: str) -> float:
        """A number, with a point or a comma. Raises Later, Back."""
        while True:
            text = self.needs(question)
            try:
                value = float(text.replace(",", "."))
            except ValueError:
                value = math.nan
            if math.isfinite(value):
                return value
            self.say(translate(f"  `{text}` is no number: write it without its unit, like 16.1"))

    def files(self, *, photo: bool = False) -> tuple[Path, ...]:
        """Photos or files that show it; none with an empty answer, unless a photo is needed. Raises Later, Back."""
        files: list[Path] = []
        if photo:
            while not confirmations.is_photo(
                file := self._path(self.ask("Photo that shows it (a path of a JPEG or PNG):"))
            ):
                words = f"  a photo is asked for: give the path of a JPEG or PNG; `{shown_word(LATER)}` leaves it open"
                self.say(translate(words))
            files.append(file)
        more = "no more" if photo else "none or no more"
        while path_text := self.ask(f"Photo or file that shows it (a path; empty: {more}):"):
            if (file := self._path(path_text)).is_file():
                files.append(file)
            else:
                self.say(translate(f"  there is no file {path_text}"))
        return tuple(files)

    @staticmethod
    def _path(path_text: str) -> Path:
        return Path(path_text).expanduser()


_LABEL = re.compile(r" *\S+ {2,}| *")
"""What the words of a line stand behind: the label of a column, or blanks."""


def _fit(text: str) -> str:
    """Lines that are wider than a terminal are broken between words; the rest stands below the first words."""
    return "\n".join(_broken(line) if len(line) > _WIDTH else line for line in text.split("\n"))


def _broken(line: str) -> str:
    label = _LABEL.match(line)
    below = " " * max(label.end() if label is not None else 0, 2)
    start = line[: len(below)] if label is not None and label.end() else ""
    parts = wrap(line[len(start) :], _WIDTH - len(below), break_long_words=False, break_on_hyphens=False)
    return start + f"\n{below}".join(parts)


def _match_word(text: str, words: Sequence[str]) -> str | None:
    """The word that is typed whole, or that alone begins so."""
    prefix_matches = [
        word for word in words if text and any(alternative.startswith(text) for alternative in taken_words(word))
    ]
    return next(
        (word for word in words if text in taken_words(word)), prefix_matches[0] if len(prefix_matches) == 1 else None
    )


_FILE_NAME = re.compile(r"[/\\~]|\.(jpe?g|png|heic|gif|webp|tiff?|pdf|txt|log|ya?ml|json|html|cfg|zip)$", re.IGNORECASE)


def doubt_of_name(name: str) -> str | None:
    """What to ask where a name is hardly one: the answer to another question, or a piece of the command; else None."""
    if name.startswith("-"):
        return f"`{name}` looks like a flag. Is it your name?"
    if re.match(r"[\w-]+=", name):
        return f"`{name}` looks like a word of the command. Is it your name?"
    if _FILE_NAME.search(name):
        return f"`{name}` looks like a file. Is it your name?"
    answers = {alternative for word in (*_WORDS, *_AFTER, *_ELSE, PAY) for alternative in taken_words(word)}
    return f"`{name}` looks like an answer to another question. Is it your name?" if plain(name) in answers else None


@dataclass(frozen=True, slots=True)
class Price:
    """An estimate in words."""

    words: str
    due: bool
    """Whether somebody has to agree to pay; in a rehearsal nobody has, nor where `--accept-cost` was typed."""


def price_of(session: CommandSession, entry: checklist.PlanEntry) -> Price | None:
    """The price of an active step; None: it costs nothing. Raises CostRefused above the declared cap."""
    if entry.step.probe is None or entry.step.consent is None or not entry.step.consent.cost:
        return None
    proofs = [ask for ask in entry.step.probe.asks() if isinstance(ask, AllowListTestRequest)]
    metered_previews = [each for proof in proofs for each in _previews(session, proof.bearer) if each.link.is_metered]
    for item in metered_previews:
        if item.over_cap and not session.is_rehearsal:
            raise item.refusal()
    if not metered_previews:
        return None
    due = not session.is_rehearsal and not session.arguments.flag(ACCEPT_COST.name)
    return Price("; ".join(preview.words for preview in metered_previews), due)


def _previews(session: CommandSession, bearer: str) -> tuple[Preview, ...]:
    satellite = satellite_of(session.declaration, session.site, bearer)
    via = session.arguments.optional("via")
    return previews(
        session.declaration, satellite.proving(session.declaration, is_rehearsal=session.is_rehearsal, via=via)
    )


@dataclass(frozen=True, slots=True)
class Listening:
    """The ears of a site."""

    free: Ears
    paid_ears: Ears
    """The same when somebody has agreed to pay for what is asked."""
