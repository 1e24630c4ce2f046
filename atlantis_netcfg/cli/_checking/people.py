"""What a person at a desk is shown and asked, item by item."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.checklist import Confirmation, Refused
from atlantis_netcfg.checklist.report import Kind, Phase
from atlantis_netcfg.core.verdicts import Verdict

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from atlantis_netcfg.checklist import Book, Entry
    from atlantis_netcfg.checklist.report import Item
    from atlantis_netcfg.cli._checking.desk import Desk
    from atlantis_netcfg.cli._checking.price import Price

__all__ = ["GREEN", "confirm", "consent", "mend", "otherwise", "ready", "shown"]

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


def ready(prompt: Desk, phase: Phase) -> bool:
    """Whether things are where the next phase looks at them; otherwise it is left open. Raises Later."""
    return prompt.choose(f"Is everything {_WHERE[phase]} and switched on?", {"yes": True, "skip": False})


_WHERE: Mapping[Phase, str] = {
    Phase.BENCH: "on the bench",
    Phase.QUAY: "at the quay",
    Phase.WATER: "in the water",
}


def confirm(book: Book, prompt: Desk, entry: Entry) -> None:
    """Show what to do and what to look for, and write down the answer. Raises Later."""
    prompt.say(f"\n{entry.item.id}: {entry.item.title}")
    prompt.say(f"  do        {entry.step.do}\n  look for  {entry.step.look_for}")
    _confirm(book, prompt, entry)


def _confirm(book: Book, prompt: Desk, entry: Entry) -> None:
    while True:
        try:
            prompt.say(shown(book.confirm(entry.item.id, _answer(prompt))))
        except Refused as refused:
            prompt.say(f"  {refused}: {refused.hint}")
        else:
            return


def _answer(prompt: Desk) -> Confirmation:
    verdict = prompt.choose("Does it hold?", _WORDS)
    note = prompt.needs(_NOTES[verdict]) if verdict in _NOTES else prompt.ask("Note (may be empty):")
    return Confirmation(verdict=verdict, by=prompt.name, note=note, files=prompt.files())


def consent(prompt: Desk, entry: Entry, price: Price | None) -> str | None:
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


def otherwise(book: Book, prompt: Desk, entry: Entry) -> None:
    """What becomes of an active step that is not done. Raises Later."""
    if not book.item(entry.item.id).open:
        return
    match prompt.choose("Leave it `open`, answer it as `seen` otherwise, or `override` it on your word?", _ELSE):
        case "seen":
            _confirm(book, prompt, entry)
        case "override":
            _override(book, prompt, book.item(entry.item.id))


def mend(book: Book, prompt: Desk, entry: Entry, probe: Callable[[Entry], None], *, read: bool) -> None:
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
            case _ if entry.item.kind is Kind.PERSON:
                confirm(book, prompt, entry)
            case _:
                probe(entry)


def _override(book: Book, prompt: Desk, item: Item) -> None:
    try:
        book.override(item.id, prompt.needs("The reason, which stands in the report:"), prompt.name)
    except Refused as refused:
        prompt.say(f"  {refused}: {refused.hint}")


_AFTER = {word: word for word in ("again", "override", "on")}
_ELSE = {word: word for word in ("open", "seen", "override")}
