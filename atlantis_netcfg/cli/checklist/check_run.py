"""One run of `provision check`: open the book of a real site or of a rehearsal, probe, ask, sign, report."""

from __future__ import annotations

import shlex
import sys
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from atlantis_netcfg import __version__
from atlantis_netcfg.checklist import Answers, Book, BookHead, Checklist, Kept, NotSigned, PlanEntry, Scope, books, plan
from atlantis_netcfg.checklist.confirmations import named, refused_person
from atlantis_netcfg.checklist.plan import drawing
from atlantis_netcfg.checklist.probes import Place
from atlantis_netcfg.checklist.report import Document, Item, Phase, body, ending, lines, seal, signed, to_look_at
from atlantis_netcfg.checklist.runner import RealEars
from atlantis_netcfg.cli.base.consent import shown_word
from atlantis_netcfg.cli.base.output import json_text, progress, tell
from atlantis_netcfg.cli.base.session import CommandSession, session
from atlantis_netcfg.cli.checklist.workflow import (
    BACK,
    LATER,
    CheckWorkflow,
    Listening,
    Prompt,
    PromptAborted,
    PromptBack,
    doubt_of_name,
    price_of,
    shown,
)
from atlantis_netcfg.core import paths, printable
from atlantis_netcfg.core.errors import DeviceFailed, ExitCode, NetcfgError, NothingMatched, UsageError, nearest
from atlantis_netcfg.core.events import Event, Stage, Subscriber, ignore
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.printable import show
from atlantis_netcfg.operations import Mode
from atlantis_netcfg.operations.common.request import refuse_examples
from atlantis_netcfg.operations.computers._access import is_computer
from atlantis_netcfg.runs import Store, os_errors_as, write_atomically

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence

    from atlantis_netcfg.cli.base.arguments import Arguments
    from atlantis_netcfg.inventory import Declaration, Host


def refuse_faults(faults: Sequence[str], *, rehearsed: bool) -> None:
    """Raise UsageError for what cannot be broken: nothing is, unless it is emulated."""
    if not faults:
        return
    if not rehearsed:
        raise UsageError("`break=` is for rehearsals: nothing real is broken on purpose", hint="add --rehearse")
    from atlantis_netcfg.checklist.runner.simulated import FAULTS

    for fault in faults:
        if fault not in FAULTS:
            near = nearest(fault, FAULTS)
            known = "\n".join(["it takes:", *(f"{name:<20} {item.words}" for name, item in FAULTS.items())])
            raise UsageError(f"`break={fault}`: no such fault", hint=f"did you mean `break={near}`?" if near else known)


def refuse_absent(faults: Sequence[str], every: Checklist, scope: Scope) -> None:
    """Raise UsageError for a fault of something that this site does not have; `every`: its list, not narrowed.

    Of an integration record also for a fault that is not of its robot: it would break nothing of the record.
    """
    if not faults:
        return
    from atlantis_netcfg.checklist.runner.simulated import FAULTS

    here = {entry.item.id for entry in every.entries}
    for fault in faults:
        if not any(turn.replace("SITE", every.site) in here for turn in FAULTS[fault].turns):
            what = f"`break={fault}`: {every.site} has nothing to break there ({FAULTS[fault].words})"
            raise UsageError(
                what, hint="faults are told for the coastal testbed of the shipped inventory: try site=coastal"
            )
        rows = {turn.partition("/")[0] for turn in FAULTS[fault].turns}
        if Phase.INTEGRATION in scope.phases and not rows.intersection(scope.vehicles):
            others = rows - {"SITE"}
            hint = f"it is for the record of `vehicle={min(others)}`" if others else "it is for the site's checklist"
            raise UsageError(
                f"`break={fault}` breaks nothing of {scope.vehicles[0]} ({FAULTS[fault].words})", hint=hint
            )


def broken(faults: Sequence[str]) -> tuple[str, ...]:
    """What is broken, in words."""
    if not faults:
        return ()
    from atlantis_netcfg.checklist.runner.simulated import FAULTS

    return tuple(f"{fault}: {FAULTS[fault].words}" for fault in faults)


def breaks_a_site(faults: Sequence[str]) -> bool:
    """Whether something beside vehicles is broken, which may be a router."""
    if not faults:
        return False
    from atlantis_netcfg.checklist.runner.simulated import FAULTS

    return any(turn.startswith("SITE/") for fault in faults for turn in FAULTS[fault].turns)


def asks_a_router(entries: Sequence[PlanEntry]) -> bool:
    """Whether routers have to be there: a rehearsal starts and configures them for that alone."""
    probes = [entry.step.probe for entry in entries if entry.step.probe is not None]
    return any(question.place is Place.ROUTER for probe in probes for question in probe.asks())


def not_rehearsed(opened: CommandSession, entries: Sequence[PlanEntry]) -> tuple[str, ...]:
    """What the twins of these entries cannot stand for."""
    if opened.rehearsal is None:
        return ()
    from atlantis_netcfg.checklist.runner.simulated import robots
    from atlantis_netcfg.emulator import acoustic, gnss, linux, mavlink

    requested = {entry.item.endpoint for entry in entries if entry.step.probe is not None}
    values = {"gps": gnss, "rc_rf": mavlink, "acoustic": acoustic, "usbl": acoustic}
    values |= {"robot": robots, "integration": robots}
    beside = [line for endpoint, twin in values.items() if endpoint in requested for line in twin.NOT_REHEARSED]
    return tuple(dict.fromkeys([*beside, *linux.NOT_REHEARSED, *opened.rehearsal.not_rehearsed]))


@contextmanager
def listening(
    opened: CommandSession, faults: Sequence[str], notify: Subscriber, ssh_config: str | None = None
) -> Iterator[Listening]:
    """Give the ears of a site, once somebody has agreed to what the looking may cost. Raises CostRefused.

    `ssh_config`: file of OpenSSH that says how the gateway is reached, in place of the declared address.
    """
    if opened.rehearsal is None:
        request = opened.paid(opened.request(Mode.DRIFT))
        paid = request.model_copy(update={"accept_cost": True})
        both = [RealEars(opened.declaration, opened.site, each, notify, ssh_config) for each in (request, paid)]
        yield Listening(*both)
        return
    from atlantis_netcfg.checklist.runner.simulated import rehearsed_ears

    if opened.rehearsal.targets:
        opened.configure_twins()
    with rehearsed_ears(opened.declaration, opened.site, opened.rehearsal, faults) as ears:
        yield Listening(ears, ears)


def folder_of(store: Store, site: str) -> Path:
    """Where the checklists of a site are kept."""
    return store.root / site / "checks"


def opened_book(opened: CommandSession, checklist: Checklist, faults: Sequence[str], *, anew: bool) -> Book:
    """Go on with the open book, or begin one. Raises SiteBusy."""
    folder = folder_of(opened.store, opened.site)
    head = BookHead(
        rehearsed=opened.rehearsed,
        tool=__version__,
        inventory=opened.declaration.revision,
        drawing=drawing(opened.declaration, checklist),
        not_rehearsed=not_rehearsed(opened, checklist.entries),
        broken=broken(faults),
        time_zone=opened.declaration.pilot.time_zone,
    )
    command = shlex.join(["provision", *sys.argv[1:]])
    return Book.open(folder, checklist, head, anew=anew, command=command)


def store(*, rehearsed: bool) -> Store:
    """Where they are kept."""
    return Store(paths.state_dir(), rehearsed=rehearsed)


def sites_with(where: Store) -> tuple[str, ...]:
    """The sites that have a checklist there."""
    if not where.root.is_dir():
        return ()
    return tuple(sorted(path.name for path in where.root.iterdir() if books(folder_of(where, path.name))))


def kept_of(where: Store, site: str, *, rehearsed: bool) -> tuple[Kept, ...]:
    """The checklists of a site, newest last. Raises NothingMatched where there are none."""
    known = sites_with(where)
    if site in known:
        return books(folder_of(where, site))
    near = nearest(site, known)
    begins = "" if near else f"; `provision check site={site}{' --rehearse' if rehearsed else ''}` begins one"
    other = "" if rehearsed or site not in sites_with(store(rehearsed=True)) else "; add --rehearsed for rehearsed ones"
    raise NothingMatched(
        f"there is no {'rehearsed ' if rehearsed else ''}checklist of `{site}`",
        hint=_meant(site, known, "there are checklists of") + (other or begins),
    )


def run_of(kept: Sequence[Kept], run: str | None) -> Kept:
    """One by its name, else the newest. Raises NothingMatched."""
    if run is None:
        return kept[-1]
    for entry in kept:
        if entry.run == run:
            return entry
    raise NothingMatched(
        f"there is no checklist {run}", hint=_meant(run, [item.run for item in kept[-5:]], "the latest")
    )


def _meant(word: str, known: Iterable[str], what: str) -> str:
    every = list(known)
    near = nearest(word, every)
    return f"did you mean `{near}`?" if near else f"{what}: {', '.join(every) or 'none'}"


def as_json(document: Document) -> dict[str, Any]:
    """The document, and how the command ends."""
    return {**document.model_dump(mode="json"), "exit": int(document.exit)}


def pages_in(folder: Path) -> Iterator[str]:
    """Where the pages of a checklist are, for people."""
    if (folder / "report.html").exists():
        yield translate(f"report: {paths.from_home(folder / 'report.html')}")


def again(arguments: Arguments, without: Collection[str] = ("anew",)) -> str:
    """What a person types to go on with the same checklist."""
    words = [f"{name}={','.join(values)}" for name, values in arguments.words.items()]
    kept = {name: value for name, value in arguments.flags.items() if name not in without}
    flags = [part for name, value in kept.items() for part in (f"--{name}", value) if part is not None]
    return shlex.join(["provision", arguments.command.name, *words, *flags])


def greet(prompt: Prompt, book: Book) -> None:
    """Say what is settled already, and what is open; and how it is left for another time."""
    items = book.items
    waiting = sum(item.open and item.override is None for item in items)
    if book.words:
        prompt.say(translate(book.words))
    later, back = shown_word(LATER), shown_word(BACK)
    for words in (
        f"{len(items) - waiting} of {len(items)} items are settled, {waiting} are open.",
        f"Every answer is kept at once. `{later}` leaves the rest for another time,",
        f"as Ctrl+C does. `{back}` goes to the question before, to correct an answer.",
    ):
        prompt.say(translate(words))


def note(words: str) -> None:
    """Tell something beside the result."""
    print(translate(f"note: {words}"), file=sys.stderr)


def signer(answers: Answers | None, typed: str | None) -> str | None:
    """Who signs where nobody is asked; None: nobody."""
    return typed if typed is not None or answers is None else answers.sign_by


def signer_at(prompt: Prompt, turn: CheckWorkflow, book: Book, signers: Sequence[str]) -> str | None:
    """Who signs, after a look at all of it; None: nobody, or something is open. `signers`: who alone may."""
    while not any(item.open and item.override is None for item in book.items):
        prompt.say(f"\n{lines(book.document())}\n")
        try:
            return prompt.name_of(signers) if prompt.agrees("Nothing is open. Sign it as it stands?") else None
        except PromptAborted:
            return None
        except PromptBack:
            turn.go_back(prompt)
    return None


def close(
    arguments: Arguments, book: Book, by: str | None, leave: Mapping[str, str], *, read: bool = False
) -> ExitCode:
    """Sign if somebody does, write the pages, tell. An open item keeps the signature away, unless it is to be left.

    `read`: whoever is here has just read the lines, so that their end is enough.
    """
    document, errors = _signed(book, by, leave)
    if document.signed is None:
        _draft(book, document)
    if arguments.flag("json"):
        result = [{"message": str(error), "hint": error.hint} for error in errors]
        print(json_text({**as_json(document), "errors": result}))
    else:
        last = [*_next(arguments, document), *pages_in(book.folder)]
        above = [*(seal(document) if read else body(document))]
        if document.signed is not None:  # it stands above the last lines, which have to be few
            above.append(translate(signed(document)))
        room = _LAST - sum(-(-max(len(line), 1) // printable.NARROW) for line in last)
        show([*above, "", *ending(document, room, vouched=not document.items), *last], sys.stdout)
        tell(errors)
    return document.exit


def _signed(book: Book, by: str | None, leave: Mapping[str, str]) -> tuple[Document, list[NetcfgError]]:
    if by is None:
        return book.document(), []
    try:
        return book.sign(by, lambda document: _pages(document, book), leave=leave), []
    except NotSigned as error:
        return book.document(), [error]


def _draft(book: Book, document: Document) -> None:
    """The pages as they would be, for who wants to look before anybody signs."""
    with os_errors_as("the report", book.folder):
        for name, data in _pages(document, book).items():
            write_atomically(book.folder / name, data)


_NOT_AT_A_TERMINAL = frozenset({"anew", "answers", "json", "sign-as"})
_LAST = 8
"""Lines at the end that alone tell what has happened and what to do."""


def _next(arguments: Arguments, document: Document) -> Iterator[str]:
    """What to type next, and for what."""
    if not document.items or (document.signed is not None and document.exit is ExitCode.DONE):
        return
    waiting = sum(item.open and item.override is None for item in document.items)
    if document.signed is not None:
        words = _begin_anew(to_look_at(document)[1])
    elif waiting == 1:
        words = "NOT SIGNED: 1 item is open. To go on and to sign, type on a terminal:"
    elif waiting:
        words = f"NOT SIGNED: {waiting} items are open. To go on and to sign, type on a terminal:"
    else:
        words = "NOT SIGNED: nothing is open. To sign, type on a terminal:"
    yield translate(words)
    yield f"  {again(arguments, _NOT_AT_A_TERMINAL)}"


def _begin_anew(bad: Sequence[Item]) -> str:
    """After the signature of what has not passed. The worst is named: its own lines may have scrolled away."""
    if not bad:
        return "Nothing was checked. Begin a new checklist; type:"
    worst, others = bad[0].id, len(bad) - 1
    if others == 0:
        return f"Mend {worst}, then begin a new checklist; type:"
    if others == 1:
        return f"Mend {worst} and 1 other, then begin a new checklist; type:"
    return f"Mend {worst} and {others} others, then begin a new checklist; type:"


def _pages(document: Document, book: Book) -> Mapping[str, bytes]:
    from atlantis_netcfg.checklist.report import pages

    return pages(document, book.files)


class CheckStopped(DeviceFailed):
    """Somebody pressed Ctrl+C: the book has all that was found and answered until then."""


@dataclass(slots=True)
class PreparedCheck:
    """What follows from the words and the declaration alone, before anything is started or contacted."""

    arguments: Arguments
    _checklist: Checklist | None = None
    answers: Answers | None = None

    @property
    def checklist(self) -> Checklist:
        """The list, once the declaration was looked at."""
        assert self._checklist is not None, "the session calls `hosts` first"  # noqa: S101 - ours to hold
        return self._checklist

    def hosts(self, declaration: Declaration) -> tuple[Host, ...]:
        """Refuse what cannot be, work out the list, and say which hosts take part."""
        rehearse = self.arguments.flag("rehearse")
        self._checklist = plan(declaration, self.arguments.word("site"), _scope(self.arguments))
        if (name := self.arguments.value("sign-as")) is not None:
            refuse_signer(name, self._checklist)
        faults = self.arguments.many("break")
        hosts = taking_part(declaration, self._checklist, rehearse=rehearse, faults=faults)
        refuse_absent(faults, plan(declaration, self._checklist.site), self._checklist.scope)
        file = self.arguments.value("answers")
        self.answers = Answers.read(Path(file), self._checklist) if file is not None else None
        return hosts


def refuse_signer(name: str, checklist: Checklist) -> None:
    """Raise UsageError for the name of somebody who may not sign the list, before anything is looked at."""
    if (wrong := refused_person(name, checklist.signers, "sign this checklist")) is not None:
        raise UsageError(f"`--sign-as {name}`: {wrong[0]}", hint=wrong[1])


def taking_part(
    declaration: Declaration, checklist: Checklist, *, rehearse: bool, faults: Sequence[str] = ()
) -> tuple[Host, ...]:
    """The hosts that a checklist asks. Raises UsageError where example values would be contacted.

    The gateway of a rehearsal is emulated as far as the checklist asks it, so no machine is started for it; and no
    router where none is asked or broken.
    """
    refuse_examples(declaration, rehearsed=rehearse)
    hosts = tuple(declaration.site_hosts(checklist.site))
    if not rehearse:
        return hosts
    routers = asks_a_router(checklist.entries) or breaks_a_site(faults)
    return tuple(host for host in hosts if routers and not is_computer(host))


def run_check(arguments: Arguments, prompt: Prompt | None = None) -> ExitCode:
    """Hold one sitting, and tell how it ended. `desk`: in place of the terminal."""
    refuse_faults(arguments.many("break"), rehearsed=arguments.flag("rehearse"))
    if (name := arguments.value("sign-as")) is not None and doubt_of_name(named(name)):
        raise UsageError(
            f"`--sign-as {name}`: this is hardly the name of a person", hint="write the name as it shall stand there"
        )
    prepared = PreparedCheck(arguments)
    if prompt is None and _somebody_is_here(arguments):
        prompt = Prompt()
    try:
        with session(
            arguments,
            rehearse=arguments.flag("rehearse"),
            via=arguments.optional("via"),
            chosen=prepared.hosts,
        ) as opened:
            return _sit(opened, prepared, prompt)
    except KeyboardInterrupt:
        hint = f"go on with `{again(arguments)}`"
        raise CheckStopped("stopped by Ctrl-C; what was found and answered until then is kept", hint=hint) from None


def _somebody_is_here(arguments: Arguments) -> bool:
    return sys.stdin.isatty() and not arguments.flag("json") and arguments.value("answers") is None


def _scope(arguments: Arguments) -> Scope:
    phases = tuple(Phase(item.replace("-", " ")) for item in arguments.many("phase"))
    return Scope(arguments.many("vehicle"), arguments.many("endpoint"), phases, arguments.optional("mission") or "")


def _sit(opened: CommandSession, prepared: PreparedCheck, prompt: Prompt | None) -> ExitCode:
    faults = opened.arguments.many("break")
    with opened_book(opened, prepared.checklist, faults, anew=_anew(opened, prompt)) as book:
        by = _look(opened, prepared, book, prompt)
        leave = prepared.answers.leave if prepared.answers is not None else {}
        read = prompt is not None and by is not None and not opened.arguments.value("sign-as")
        return close(opened.arguments, book, by, leave, read=read)


def _look(opened: CommandSession, prepared: PreparedCheck, book: Book, prompt: Prompt | None) -> str | None:
    """Look and ask; who signs."""
    entries, faults = prepared.checklist.entries, opened.arguments.many("break")
    with (
        # A person reads and types where progress would be drawn.
        progress(quiet=opened.as_json) if prompt is None else nullcontext(ignore) as notify,
        listening(opened, faults, notify) as ears,
    ):
        turn = CheckWorkflow(
            book, entries, ears, _message(notify, prompt), lambda entry: price_of(opened, entry), opened.rehearsed
        )
        if prompt is None:
            for words in turn.alone(prepared.answers):
                note(words)
            return signer(prepared.answers, opened.arguments.value("sign-as"))
        return _with(prompt, turn, book, opened.arguments.value("sign-as"), prepared.checklist.signers)


def _message(notify: Subscriber, prompt: Prompt | None) -> Callable[[Item], None]:
    def tell(item: Item) -> None:
        if prompt is not None:
            prompt.say(shown(item))
        else:
            notify(Event(item.id, Stage.DONE, f"{item.verdict}: {item.message}"))

    return tell


def _anew(opened: CommandSession, prompt: Prompt | None) -> bool:
    """A rehearsal that nobody sits at has its things as they are declared, or broken, this time: nothing is kept."""
    return opened.arguments.flag("anew") or (opened.rehearsed and prompt is None)


def _with(prompt: Prompt, turn: CheckWorkflow, book: Book, typed: str | None, signers: Sequence[str]) -> str | None:
    """Go through it with a person; who signs (`typed`: whom `--sign-as` names)."""
    greet(prompt, book)
    try:
        turn.with_a_person(prompt)
    except PromptAborted:
        prompt.say(translate("left for later"))
    return typed if typed is not None else signer_at(prompt, turn, book, signers)
