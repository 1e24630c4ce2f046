"""Workflow of a checklist: phase by phase with a person, all at once without one.

Also: the display and prompts for a person, item by item; the prompts on a terminal, with a word that stops and leaves
the rest for later; the cost of an active step over a metered link.
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
from atlantis_netcfg.checklist.runner import ProbeTransport, examine
from atlantis_netcfg.cli.base.consent import NO, PAY, YES, plain, shown_word, taken_words, whole_word, yes_or_no
from atlantis_netcfg.cli.base.syntax import ACCEPT_COST
from atlantis_netcfg.core import printable
from atlantis_netcfg.core.errors import nearest
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, join, msg
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
    Verdict.WARN: "Confirmed, but:",
    Verdict.FAIL: "What was seen instead:",
    Verdict.INCONCLUSIVE: "Why it cannot be determined:",
    Verdict.SKIP: "Why it does not apply here:",
}
"""Prompt after a verdict that needs a note."""


def render_item(item: report.Item) -> str:
    """Format a result, and what to do about it."""
    hint = item.hint if item.hint and item.verdict not in {Verdict.PASS, Verdict.SKIP} else None
    return f"  {item.verdict:<12} {item.id}: {translate(item.message)}" + (
        f"\n  {'':<12} {translate(hint)}" if hint is not None else ""
    )


def ready(prompt: Prompt, phase: report.Phase) -> bool:
    """Ask whether the next phase can start; otherwise it is left open. Raises PromptAbort."""
    return prompt.choose(_READY[phase], {YES: True, "skip": False})


_READY: Mapping[report.Phase, str] = {
    report.Phase.BENCH: "Is everything on the bench and switched on?",
    report.Phase.QUAY: "Is everything at the quay and switched on?",
    report.Phase.WATER: "Is everything in the water and switched on?",
    report.Phase.RECOVERY: "Has everything been recovered?",
    report.Phase.INTEGRATION: "Is the robot switched on, and its interface running?",
}


def confirm(book: checklist.ChecklistSession, prompt: Prompt, entry: checklist.PlanEntry) -> None:
    """Show what to do and what to look for, and record the answer. Raises PromptAbort."""
    _title(prompt, entry)
    step = entry.step
    if step.do:
        prompt.say(translate(f"  do        {arg(step.do)}"))
    prompt.say(translate(f"  look for  {arg(step.look_for)}"))
    if step.evidence.words:
        prompt.say(translate(f"  give      {arg(step.evidence.words)}"))
    if step.by:
        prompt.say(translate(f"  answers   {arg(join(', ', step.by))} only"))
    _confirm(book, prompt, entry)


def _title(prompt: Prompt, entry: checklist.PlanEntry) -> None:
    prompt.say(msg(f"\n{arg(entry.item.id)}: {arg(report.item_title(entry.item))}"))


def _confirm(book: checklist.ChecklistSession, prompt: Prompt, entry: checklist.PlanEntry) -> None:
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
    value = prompt.number(msg(f"The number, in {arg(request.unit)}:")) if number else None
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
    """Ask for a verdict; a failure must be confirmed, because it may be a typing error."""
    while True:
        verdict = prompt.choose("Is it so?", _WORDS)
        if verdict is not Verdict.FAIL or prompt.is_so(
            msg(f"You answered {arg(shown_word(NO))}: FAIL will be recorded. Is that right?")
        ):
            return verdict


def consent(prompt: Prompt, entry: checklist.PlanEntry, price: Price | None) -> str | None:
    """Ask for consent to an active step and to its cost; None if it is not given. Raises PromptAbort."""
    condition = entry.step.consent
    assert condition is not None, "only active steps are asked for"  # noqa: S101 - Step holds it
    _title(prompt, entry)
    prompt.say(translate(f"  This step needs your consent: {arg(condition.question)}."))
    if not prompt.agrees("Is that so, and do you want to start it now?"):
        return None
    if price is not None:
        words = msg(
            f"  Traffic: {arg(price.words)}" if price.due else f"  a real run asks first; traffic: {arg(price.words)}"
        )
        prompt.say(translate(words))
        if price.due and not prompt.agrees("Accept the cost?", PAY):
            return None
    return prompt.name


def otherwise(book: checklist.ChecklistSession, prompt: Prompt, entry: checklist.PlanEntry) -> None:
    """Ask what to do with an active step that is not run. Raises PromptAbort."""
    if not book.item(entry.item.id).open:
        return
    leave_word, seen_word, override = map(shown_word, _ELSE)
    question = msg(
        f"Leave it open (`{arg(leave_word)}`), record another observation (`{arg(seen_word)}`), or override it "
        f"(`{arg(override)}`)?"
    )
    match prompt.choose(question, _ELSE):
        case "seen":
            _confirm(book, prompt, entry)
        case "override":
            _override(book, prompt, entry)


def resolve_item(
    book: checklist.ChecklistSession,
    prompt: Prompt,
    entry: checklist.PlanEntry,
    probe: Callable[[checklist.PlanEntry], None],
    *,
    read: bool,
) -> None:
    """While an item is not green, ask: check again, override, or leave it. Raises PromptAbort.

    `read`: its result has just been shown.
    """
    if not read and book.item(entry.item.id).counts not in GREEN:
        prompt.say(render_item(book.item(entry.item.id)))
    while book.item(entry.item.id).counts not in GREEN and _ask_correction(book, prompt, entry, probe):
        pass


def correct(
    book: checklist.ChecklistSession,
    prompt: Prompt,
    entry: checklist.PlanEntry,
    probe: Callable[[checklist.PlanEntry], None],
) -> None:
    """Show an item and let it be checked or answered again, whatever its verdict. Raises PromptAbort."""
    prompt.say(render_item(book.item(entry.item.id)))
    if _ask_correction(book, prompt, entry, probe):
        resolve_item(book, prompt, entry, probe, read=True)


def _ask_correction(
    book: checklist.ChecklistSession,
    prompt: Prompt,
    entry: checklist.PlanEntry,
    probe: Callable[[checklist.PlanEntry], None],
) -> bool:
    """Ask what to do with an item; return False if it stays as it is."""
    item = book.item(entry.item.id)
    again, override, on = map(shown_word, _AFTER)
    if item.verdict in confirmations.OVERRIDABLE:
        choice = prompt.choose(
            msg(f"Check again (`{arg(again)}`), override it (`{arg(override)}`), or continue (`{arg(on)}`)?"), _AFTER
        )
    else:
        choice = prompt.choose(msg(f"Check again (`{arg(again)}`), or continue (`{arg(on)}`)?"), _AGAIN)
    if choice == "override":
        _override(book, prompt, entry)
    elif choice == "again" and item.kind is report.ItemKind.PERSON:
        confirm(book, prompt, entry)
    elif choice == "again":
        probe(entry)
    return choice != "on"


def _override(book: checklist.ChecklistSession, prompt: Prompt, entry: checklist.PlanEntry) -> None:
    try:
        reason = prompt.needs("Reason (appears in the report):")
        book.override(entry.item.id, reason, prompt.name_of(entry.step.by))
    except checklist.ChecklistUsageError as refused:
        prompt.refuses(refused)


_AFTER = {word: word for word in ("again", "override", "on")}
_AGAIN = {word: word for word in ("again", "on")}
_ELSE = {word: word for word in ("open", "seen", "override")}


@dataclass(slots=True)
class CheckWorkflow:
    """One session on a checklist."""

    book: checklist.ChecklistSession
    entries: Sequence[checklist.PlanEntry]
    ears: Listening
    show: Callable[[report.Item], None]
    """Called with each result as soon as it is recorded."""
    price: Callable[[checklist.PlanEntry], Price | None]
    """Returns the cost of an active step on a metered link. Raises CostRefusal."""
    at_once: bool = False
    """Rehearsal: nobody carries anything to the quay or into the water between the phases."""
    _visited_entries: list[checklist.PlanEntry] = field(default_factory=list)
    """Items that a person was asked about in this session, for `back`."""

    def alone(self, answers: checklist.Answers | None) -> tuple[str, ...]:
        """Run all that needs no person, and what the answers consent to; then record the answers.

        Items that were green in an earlier session are checked again: without a person it is not known whether they
        still are. Returns descriptions of the answers that were not needed.
        """
        consents = self._collect_consents(answers) if answers is not None else {}
        self._examine(
            [entry for entry in self.entries if self._is_automatic(entry) or entry.item.id in consents], consents
        )
        return answers.write_down(self.book, self.show) if answers is not None else ()

    def with_a_person(self, prompt: Prompt) -> None:
        """Go through everything that is not green, phase by phase. Raises PromptAbort."""
        if self.at_once:
            self._examine(self._unchecked_entries(self.entries), {})
        before = None
        for phase in report.Phase:
            entries = [entry for entry in self.entries if entry.item.phase is phase and not self._is_green(entry)]
            if not entries:
                continue
            prompt.say(f"\n{translate(_PHASES[phase])}")
            if before is None or not self._unchecked_entries(entries) or self._ask_ready(prompt, phase):
                self._run_phase(prompt, entries)
            before = phase

    def _run_phase(self, prompt: Prompt, entries: Sequence[checklist.PlanEntry]) -> None:
        self._examine(self._unchecked_entries(entries), {})
        for entry in entries:
            self._visit(prompt, entry, partial(self._settle, prompt, entry))

    def _settle(self, prompt: Prompt, entry: checklist.PlanEntry) -> None:
        """Ask what one item needs."""
        is_requested = self._is_open(entry)
        if entry.item.kind is report.ItemKind.PERSON and is_requested:
            confirm(self.book, prompt, entry)
        elif entry.item.kind is report.ItemKind.ACTIVE and is_requested:
            self._act(prompt, entry)
        if not self._is_open(entry):
            resolve_item(self.book, prompt, entry, partial(self._repeat_check, prompt), read=is_requested)

    def _visit(self, prompt: Prompt, entry: checklist.PlanEntry, ask: Callable[[], None]) -> None:
        """Ask about one item; `back` restarts it, or at its first question goes one item back. Raises PromptAbort."""
        while True:
            prompt.begin(self._place(entry))
            try:
                ask()
            except PromptBack:
                if not prompt.answers:
                    self.go_back(prompt)
                elif not self._is_open(entry):
                    ask = partial(correct, self.book, prompt, entry, partial(self._repeat_check, prompt))
            else:
                break
        if prompt.answers:
            self._visited_entries.append(entry)
        prompt.begin("")

    def go_back(self, prompt: Prompt) -> None:
        """Ask about the last item again; the earlier answer stays in the log. Raises PromptAbort."""
        if not self._visited_entries:
            prompt.say(translate("  this is the first question"))
            return
        entry = self._visited_entries.pop()
        _title(prompt, entry)
        if self._is_open(entry):
            self._visit(prompt, entry, partial(self._settle, prompt, entry))
        else:
            self._visit(prompt, entry, partial(correct, self.book, prompt, entry, partial(self._repeat_check, prompt)))

    def _place(self, entry: checklist.PlanEntry) -> str:
        """Format the item's number and the total, in the order of the phases."""
        order = sorted(self.entries, key=lambda each: tuple(report.Phase).index(each.item.phase))
        return translate(f"item {arg(order.index(entry) + 1)} of {arg(len(order))}")

    def _ask_ready(self, prompt: Prompt, phase: report.Phase) -> bool:
        while True:
            try:
                return ready(prompt, phase)
            except PromptBack:
                self.go_back(prompt)

    def _unchecked_entries(self, entries: Sequence[checklist.PlanEntry]) -> list[checklist.PlanEntry]:
        return [entry for entry in entries if entry.item.kind is report.ItemKind.AUTOMATIC and self._is_open(entry)]

    def _repeat_check(self, prompt: Prompt, entry: checklist.PlanEntry) -> None:
        if entry.item.kind is report.ItemKind.ACTIVE:
            self._act(prompt, entry)
        else:
            self._examine([entry], {})

    def _act(self, prompt: Prompt, entry: checklist.PlanEntry) -> None:
        """Ask for consent, show what the person has to do, and probe; not if the device itself has failed."""
        sick = self._sick(entry)
        if sick is not None:
            _title(prompt, entry)
            prompt.say(f"{translate(f'  not now: {arg(sick.message)}')} ({sick.id})")
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
            prompt.say(translate(f"  Now: {arg(entry.step.consent.prompt)}."))
        self._examine([entry], {entry.item.id: by}, is_paid=True)

    def _sick(self, entry: checklist.PlanEntry) -> report.Item | None:
        """Return a failed automatic item of the same cell: nobody may move the sticks of an armed vehicle."""
        cell = [
            other for other in self.entries if other.cell == entry.cell and other.item.kind is report.ItemKind.AUTOMATIC
        ]
        items = (self.book.item(other.item.id) for other in cell)
        return next((item for item in items if item.counts is Verdict.FAIL), None)

    def _examine(
        self, entries: Sequence[checklist.PlanEntry], consents: Mapping[str, str], *, is_paid: bool = False
    ) -> None:
        """Run entries. `consents`: who has consented to each active item; `is_paid`: also to its cost."""

        def settle(item: report.Item) -> None:
            by = consents.get(item.id)
            self.show(self.book.settle(_with_consent(item, steps[item.id], by) if by is not None else item))

        steps = {entry.item.id: entry for entry in entries}
        if entries:
            asyncio.run(examine(entries, self.ears.paid_ears if is_paid else self.ears.free, settle))

    def _collect_consents(self, answers: checklist.Answers) -> dict[str, str]:
        """Return active items with consent in the answers that cost nothing, or whose cost is accepted."""
        active_entries = [
            item for item in self.entries if item.item.kind is report.ItemKind.ACTIVE and not self._is_green(item)
        ]
        values = {entry.item.id: answers.consents(entry.item.id) for entry in active_entries if not self._due(entry)}
        return {item_id: by for item_id, by in values.items() if by is not None}

    def _due(self, entry: checklist.PlanEntry) -> bool:
        """Return whether a step costs money without consent: an answer file never consents to costs."""
        try:
            price = self.price(entry)
        except CostRefusal:
            return True
        return price is not None and price.due

    def _is_automatic(self, entry: checklist.PlanEntry) -> bool:
        item = self.book.item(entry.item.id)
        return item.kind is report.ItemKind.AUTOMATIC and item.override is None and not entry.step.unless

    def _is_green(self, entry: checklist.PlanEntry) -> bool:
        return not self._is_open(entry) and self.book.item(entry.item.id).counts in GREEN

    def _is_open(self, entry: checklist.PlanEntry) -> bool:
        item = self.book.item(entry.item.id)
        return item.open and item.override is None


def _with_consent(item: report.Item, entry: checklist.PlanEntry, by: str) -> report.Item:
    """Add a person's consent to the evidence of an active item; `by`: the name, and words after a colon."""
    assert entry.step.consent is not None, "only active steps need consent"  # noqa: S101 - Step holds it
    name, _, words = by.partition(": ")
    text = f"{entry.step.consent.question}{f' ({words})' if words else ''}"
    word = report.Evidence(type=report.EvidenceType.CONFIRMED, what="consent", value=text, at=item.at, by=name)
    return item.model_copy(update={"evidence": (*item.evidence, word)})


_PHASES = {
    report.Phase.BENCH: "BENCH",
    report.Phase.QUAY: "QUAY",
    report.Phase.WATER: "IN WATER",
    report.Phase.RECOVERY: "RECOVERY",
    report.Phase.INTEGRATION: "INTEGRATION",
}
T = TypeVar("T")
LATER, BACK = "later", "back"
"""Typed at any prompt: keep the answers and leave the rest open; return to the previous question."""
_WIDTH = 80
_ANSWER = 9
"""Columns reserved for an answer after its choices."""


class PromptAbort(Exception):
    """The person goes on another time."""


class PromptBack(Exception):
    """The person goes back to the previous question."""


class Prompt:
    """Prompts for a person; `ask` and `say` use the terminal, tests replace them."""

    def __init__(self, ask: Callable[[str], str] = input, say: Callable[[str], None] = print) -> None:
        self._ask = ask
        self._say = say
        self._name = ""
        self._place = ""
        self.answers = 0
        """Number of answers since `begin`."""

    def begin(self, place: str) -> None:
        """Start the questions about another item; `place`, such as `item 3 of 9`, is shown before each one."""
        self._place, self.answers = place, 0

    def say(self, text: str = "") -> None:
        """Print translated lines; control characters from a device or file are escaped."""
        self._say(_fit(printable.lines(text)))

    def refuses(self, refusal: checklist.ChecklistUsageError) -> None:
        """Print why an answer is not accepted, and what to do."""
        self.say(f"  {translate(str(refusal))}: {translate(refusal.hint or '')}")

    def ask(self, question: str) -> str:
        """Ask for an answer, which may be empty. Raises PromptAbort, PromptBack."""
        return self._read(translate(question))

    def _read(self, question: str) -> str:
        """Ask a question that is already translated."""
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
        """Ask for one of these words; `default` is used for an empty answer, an unambiguous prefix is enough."""
        every = (*words, BACK, LATER)
        choices = join(", ", map(shown_word, every))
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
            self.say(translate(f"  type one of: {arg(choices)}") + (f" (`{near}`?)" if near else ""))

    def _with_choices(self, question: str, choices: str) -> str:
        """Add the choices to a question: beside it if the terminal is wide enough, otherwise below it."""
        room = len(f"({self._place}) {question} [{choices}]") + _ANSWER <= _WIDTH
        return f"{question}{' ' if room else chr(10) + '  '}[{choices}]"

    def agrees(self, question: str, word: str = YES) -> bool:
        """Ask for the whole word, so that a typing error is no consent."""
        return whole_word(question, self._read, self.say, word=word)

    def is_so(self, question: str) -> bool:
        """Ask yes or no, if the answer alone has no effect."""
        return yes_or_no(question, self._read, self.say)

    def needs(self, question: str) -> str:
        """Ask for an answer that is not empty."""
        while not (answer := self.ask(question)):
            self.say(translate(f"  an entry is required; `{arg(shown_word(LATER))}` leaves the item open"))
        return answer

    @property
    def name(self) -> str:
        """Name of the person, asked once."""
        while not self._name:
            try:
                name = confirmations.clean_name(self.needs("Your name, as it should appear in the report:"))
            except checklist.ChecklistUsageError as refused:
                self.refuses(refused)
                continue
            if (doubt := doubt_of_name(name)) is None or self.is_so(doubt):
                self._name = name
        return self._name

    def name_of(self, people: Sequence[str]) -> str:
        """Return who answers: the person at the terminal, or one of `people`. Raises PromptAbort, PromptBack."""
        if not people or confirmations.refused_person(self.name, people, "answer") is None:
            return self.name
        while True:
            name = self.needs(msg(f"Which person is it: {arg(join(', ', people))}?"))
            if (wrong := confirmations.refused_person(name, people, "answer")) is None:
                return name
            self.say(translate(f"  {arg(wrong[0])}"))

    def number(self, question: str) -> float:
        """Ask for a number, with a point or a comma. Raises PromptAbort, PromptBack."""
        while True:
            text = self.needs(question)
            try:
                value = float(text.replace(",", "."))
            except ValueError:
                value = math.nan
            if math.isfinite(value):
                return value
            self.say(translate(f"  `{arg(text)}` is not a number: write it without its unit, like 16.1"))

    def files(self, *, photo: bool = False) -> tuple[Path, ...]:
        """Ask for evidence files; may be empty unless a photo is needed. Raises PromptAbort, PromptBack."""
        files: list[Path] = []
        if photo:
            while not confirmations.is_photo(
                file := self._path(self.ask("Photo as evidence (path of a JPEG or PNG):"))
            ):
                words = msg(
                    f"  a photo is required: give the path of a JPEG or PNG; `{arg(shown_word(LATER))}` leaves the "
                    "item open"
                )
                self.say(translate(words))
            files.append(file)
        more = "no more" if photo else "none or no more"
        while path_text := self.ask(msg(f"Photo or file as evidence (a path; empty: {arg(more)}):")):
            if (file := self._path(path_text)).is_file():
                files.append(file)
            else:
                self.say(translate(f"  no such file: {arg(path_text)}"))
        return tuple(files)

    @staticmethod
    def _path(path_text: str) -> Path:
        return Path(path_text).expanduser()


_LABEL = re.compile(r" *\S+( \S+)? {2,}| *")
"""Start of a line before its text: the label of a column, or blanks."""


def _fit(text: str) -> str:
    """Wrap lines that are wider than a terminal, with aligned continuation lines."""
    return "\n".join(_wrap_line(line) if len(line) > _WIDTH else line for line in text.split("\n"))


def _wrap_line(line: str) -> str:
    label = _LABEL.match(line)
    below = " " * max(label.end() if label is not None else 0, 2)
    start = line[: len(below)] if label is not None and label.end() else ""
    parts = wrap(line[len(start) :], _WIDTH - len(below), break_long_words=False, break_on_hyphens=False)
    return start + f"\n{below}".join(parts)


def _match_word(text: str, words: Sequence[str]) -> str | None:
    """Return the word that is typed in full, or by an unambiguous prefix."""
    prefix_matches = [
        word for word in words if text and any(alternative.startswith(text) for alternative in taken_words(word))
    ]
    return next(
        (word for word in words if text in taken_words(word)), prefix_matches[0] if len(prefix_matches) == 1 else None
    )


_FILE_NAME = re.compile(r"[/\\~]|\.(jpe?g|png|heic|gif|webp|tiff?|pdf|txt|log|ya?ml|json|html|cfg|zip)$", re.IGNORECASE)


def doubt_of_name(name: str) -> str | None:
    """Return a question if a name looks like a flag, an argument or a file name; otherwise None."""
    if name.startswith("-"):
        return msg(f"`{arg(name)}` looks like an option. Is it your name?")
    if re.match(r"[\w-]+=", name):
        return msg(f"`{arg(name)}` looks like an argument. Is it your name?")
    if _FILE_NAME.search(name):
        return msg(f"`{arg(name)}` looks like a file. Is it your name?")
    answers = {alternative for word in (*_WORDS, *_AFTER, *_ELSE, PAY) for alternative in taken_words(word)}
    return (
        msg(f"`{arg(name)}` looks like an answer to another question. Is it your name?")
        if plain(name) in answers
        else None
    )


@dataclass(frozen=True, slots=True)
class Price:
    """Cost estimate as text."""

    words: str
    due: bool
    """Whether consent to the cost is needed; not in a rehearsal, and not with `--accept-cost`."""


def price_of(session: CommandSession, entry: checklist.PlanEntry) -> Price | None:
    """Return the price of an active step; None if it costs nothing. Raises CostRefusal above the inventory's cap."""
    if entry.step.probe is None or entry.step.consent is None or not entry.step.consent.cost:
        return None
    proofs = [ask for ask in entry.step.probe.asks() if isinstance(ask, AllowListTestRequest)]
    metered_previews = [each for proof in proofs for each in _previews(session, proof.link) if each.link.is_metered]
    for item in metered_previews:
        if item.over_cap and not session.is_rehearsal:
            raise item.refusal()
    if not metered_previews:
        return None
    due = not session.is_rehearsal and not session.arguments.flag(ACCEPT_COST.name)
    return Price(join("; ", (preview.words for preview in metered_previews)), due)


def _previews(session: CommandSession, link: str) -> tuple[Preview, ...]:
    satellite = satellite_of(session.inventory, session.site, link)
    via = session.arguments.optional("via")
    return previews(session.inventory, satellite.proving(session.inventory, is_rehearsal=session.is_rehearsal, via=via))


@dataclass(frozen=True, slots=True)
class Listening:
    """Access to a site's devices, without and with consent to cost."""

    free: ProbeTransport
    paid_ears: ProbeTransport
    """Transport for requests whose cost somebody has agreed to."""
