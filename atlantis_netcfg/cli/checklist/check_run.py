"""One run of `provision check`: open the checklist of a site or a rehearsal, probe, ask, sign, report."""

from __future__ import annotations

import shlex
import sys
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from atlantis_netcfg import __version__, runs
from atlantis_netcfg.checklist import (
    Answers,
    BookHead,
    Checklist,
    ChecklistSession,
    PlanEntry,
    SavedChecklist,
    Scope,
    SigningError,
    books,
    plan,
    report,
)
from atlantis_netcfg.checklist.confirmations import clean_name, refused_person
from atlantis_netcfg.checklist.plan import drawing
from atlantis_netcfg.checklist.probes import Place
from atlantis_netcfg.checklist.runner import RealTransport
from atlantis_netcfg.cli.base import output
from atlantis_netcfg.cli.base.consent import shown_word
from atlantis_netcfg.cli.base.session import CommandSession, session
from atlantis_netcfg.cli.checklist import workflow
from atlantis_netcfg.core import events, paths, printable
from atlantis_netcfg.core.errors import DeviceError, ExitCode, NetcfgError, NoMatchError, UsageError, nearest
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.core.printable import show
from atlantis_netcfg.operations import Mode
from atlantis_netcfg.operations.common.request import refuse_examples
from atlantis_netcfg.operations.computers._access import is_computer

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence

    from atlantis_netcfg.cli.base.syntax import Arguments
    from atlantis_netcfg.inventory import Host, Inventory


def refuse_faults(faults: Sequence[str], *, is_rehearsal: bool) -> None:
    """Raise UsageError for invalid faults; faults are allowed only in a rehearsal."""
    if not faults:
        return
    if not is_rehearsal:
        raise UsageError("`break=` is for rehearsals only: no fault is caused on real devices", hint="add --rehearse")
    from atlantis_netcfg.checklist.runner.simulated import FAULTS

    for fault in faults:
        if fault not in FAULTS:
            near = nearest(fault, FAULTS)
            fault_list = "\n".join(["possible values:", *(f"{name:<20} {item.words}" for name, item in FAULTS.items())])
            raise UsageError(
                f"`break={arg(fault)}`: unknown fault",
                hint=f"did you mean `break={arg(near)}`?" if near else fault_list,
            )


def refuse_absent(faults: Sequence[str], every: Checklist, scope: Scope) -> None:
    """Raise UsageError for a fault that this site does not have; `every`: its complete list.

    For an integration record, also for a fault of another robot, which would not affect the record.
    """
    if not faults:
        return
    from atlantis_netcfg.checklist.runner.simulated import FAULTS

    here = {entry.item.id for entry in every.entries}
    for fault in faults:
        if not any(turn.replace("SITE", every.site) in here for turn in FAULTS[fault].turns):
            what = msg(f"`break={arg(fault)}`: does not apply to {arg(every.site)} ({arg(FAULTS[fault].words)})")
            raise UsageError(
                what, hint="faults are defined for the coastal testbed of the shipped inventory: try site=coastal"
            )
        rows = {turn.partition("/")[0] for turn in FAULTS[fault].turns}
        if report.Phase.INTEGRATION in scope.phases and not rows.intersection(scope.vehicles):
            others = rows - {"SITE"}
            hint = msg(
                f"it belongs to the record of `vehicle={arg(min(others))}`"
                if others
                else "it belongs to the site's checklist"
            )
            raise UsageError(
                f"`break={arg(fault)}` does not affect {arg(scope.vehicles[0])} ({arg(FAULTS[fault].words)})", hint=hint
            )


def broken(faults: Sequence[str]) -> tuple[str, ...]:
    """Describe the faults."""
    if not faults:
        return ()
    from atlantis_netcfg.checklist.runner.simulated import FAULTS

    return tuple(msg(f"{arg(fault)}: {arg(FAULTS[fault].words)}") for fault in faults)


def breaks_a_site(faults: Sequence[str]) -> bool:
    """Return whether a fault affects anything other than vehicles, such as a router."""
    if not faults:
        return False
    from atlantis_netcfg.checklist.runner.simulated import FAULTS

    return any(turn.startswith("SITE/") for fault in faults for turn in FAULTS[fault].turns)


def asks_a_router(entries: Sequence[PlanEntry]) -> bool:
    """Return whether routers are needed: a rehearsal starts and configures them only in that case."""
    probes = [entry.step.probe for entry in entries if entry.step.probe is not None]
    return any(question.place is Place.ROUTER for probe in probes for question in probe.asks())


def not_rehearsed(site_session: CommandSession, entries: Sequence[PlanEntry]) -> tuple[str, ...]:
    """Return the limits of the emulators for these entries."""
    if site_session.rehearsal is None:
        return ()
    from atlantis_netcfg.checklist.rehearsal import limits

    return tuple(dict.fromkeys([*limits(entries), *site_session.rehearsal.not_rehearsed]))


@contextmanager
def listening(
    site_session: CommandSession, faults: Sequence[str], notify: events.Subscriber, ssh_config: str | None = None
) -> Iterator[workflow.Listening]:
    """Yield the access to a site's devices, after consent to the cost. Raises CostRefusal.

    `ssh_config`: OpenSSH configuration file for the gateway, instead of the address in the inventory.
    """
    if site_session.rehearsal is None:
        request = site_session.confirm_cost(site_session.request(Mode.DRIFT))
        paid_request = request.model_copy(update={"accept_cost": True})
        both = [
            RealTransport(site_session.inventory, site_session.site, each, notify, ssh_config)
            for each in (request, paid_request)
        ]
        yield workflow.Listening(*both)
        return
    from atlantis_netcfg.checklist.runner.simulated import rehearsed_ears

    if site_session.rehearsal.targets:
        site_session.configure_emulators()
    with rehearsed_ears(site_session.inventory, site_session.site, site_session.rehearsal, faults) as ears:
        yield workflow.Listening(ears, ears)


def folder_of(store: runs.Store, site: str) -> Path:
    """Return the folder of a site's checklists."""
    return store.root / site / "checks"


def opened_book(
    site_session: CommandSession, checklist: Checklist, faults: Sequence[str], *, anew: bool
) -> ChecklistSession:
    """Continue the open checklist, or start one. Raises SiteBusy."""
    folder = folder_of(site_session.store, site_session.site)
    head = BookHead(
        is_rehearsal=site_session.is_rehearsal,
        tool=__version__,
        inventory=site_session.inventory.revision,
        drawing=drawing(site_session.inventory, checklist),
        not_rehearsed=not_rehearsed(site_session, checklist.entries),
        broken=broken(faults),
        time_zone=site_session.inventory.pilot.time_zone,
    )
    command = shlex.join(["provision", *sys.argv[1:]])
    return ChecklistSession.open(folder, checklist, head, anew=anew, command=command)


def store(*, is_rehearsal: bool) -> runs.Store:
    """Return the store of the checklists."""
    return runs.Store(paths.state_dir(), is_rehearsal=is_rehearsal)


def sites_with(where: runs.Store) -> tuple[str, ...]:
    """Return the sites that have a checklist in a store."""
    if not where.root.is_dir():
        return ()
    return tuple(sorted(path.name for path in where.root.iterdir() if books(folder_of(where, path.name))))


def kept_of(where: runs.Store, site: str, *, is_rehearsal: bool) -> tuple[SavedChecklist, ...]:
    """Return the checklists of a site, newest last. Raises NoMatchError if there are none."""
    sites = sites_with(where)
    if site in sites:
        return books(folder_of(where, site))
    near = nearest(site, sites)
    begins = msg(
        "" if near else f"; `provision check site={arg(site)}{' --rehearse' if is_rehearsal else ''}` starts one"
    )
    other = (
        ""
        if is_rehearsal or site not in sites_with(store(is_rehearsal=True))
        else "; add --rehearse to see rehearsed ones"
    )
    raise NoMatchError(
        f"`{arg(site)}` has no {'rehearsed ' if is_rehearsal else ''}checklist",
        hint=_suggest(site, sites, "checklists exist for") + (other or begins),
    )


def run_of(entries: Sequence[SavedChecklist], run: str | None) -> SavedChecklist:
    """Return a checklist by its name, otherwise the newest. Raises NoMatchError."""
    if run is None:
        return entries[-1]
    for entry in entries:
        if entry.run == run:
            return entry
    raise NoMatchError(
        f"no such checklist: {arg(run)}", hint=_suggest(run, [item.run for item in entries[-5:]], "the latest")
    )


def _suggest(word: str, names: Iterable[str], what: str) -> str:
    every = list(names)
    near = nearest(word, every)
    return msg(f"did you mean `{arg(near)}`?" if near else f"{arg(what)}: {arg(join(', ', every) or 'none')}")


def as_json(document: report.Document) -> dict[str, Any]:
    """Return the document as JSON data, with the exit code."""
    return {**document.model_dump(mode="json"), "exit": int(document.exit)}


def pages_in(folder: Path) -> Iterator[str]:
    """Yield where the pages of a checklist are stored."""
    if (folder / "report.html").exists():
        yield translate(f"report: {arg(paths.shorten_home(folder / 'report.html'))}")


def again(arguments: Arguments, without: Collection[str] = ("anew",)) -> str:
    """Return the command that continues the same checklist."""
    words = [f"{name}={','.join(values)}" for name, values in arguments.words.items()]
    kept_flags = {name: value for name, value in arguments.flags.items() if name not in without}
    flags = [part for name, value in kept_flags.items() for part in (f"--{name}", value) if part is not None]
    return shlex.join(["provision", arguments.command.name, *words, *flags])


def greet(prompt: workflow.Prompt, book: ChecklistSession) -> None:
    """Print how many items are settled and open, and how to interrupt."""
    items = book.items
    waiting = sum(item.open and item.override is None for item in items)
    if book.words:
        prompt.say(translate(book.words))
    later, back = shown_word(workflow.LATER), shown_word(workflow.BACK)
    for words in (
        msg(f"{arg(len(items) - waiting)} of {arg(len(items))} items are complete, {arg(waiting)} are open."),
        msg(f"Every answer is saved at once. `{arg(later)}` leaves the rest for another time,"),
        msg(f"as Ctrl+C does. `{arg(back)}` returns to the previous question, to correct an answer."),
    ):
        prompt.say(translate(words))


def note(words: str) -> None:
    """Print a note on stderr, in addition to the result."""
    print(translate(f"note: {arg(words)}"), file=sys.stderr)


def signer(answers: Answers | None, sign_as: str | None) -> str | None:
    """Return who signs without a prompt; None if nobody does."""
    return sign_as if sign_as is not None or answers is None else answers.sign_by


def signer_at(
    prompt: workflow.Prompt, turn: workflow.CheckWorkflow, book: ChecklistSession, signers: Sequence[str]
) -> str | None:
    """Return who signs after a review; None if nobody, or an item is open. `signers`: those allowed to sign."""
    while not any(item.open and item.override is None for item in book.items):
        prompt.say(f"\n{report.lines(book.document())}\n")
        try:
            return prompt.name_of(signers) if prompt.agrees("No item is open. Sign the checklist as it is?") else None
        except workflow.PromptAbort:
            return None
        except workflow.PromptBack:
            turn.go_back(prompt)
    return None


def close(
    arguments: Arguments, book: ChecklistSession, by: str | None, leave: Mapping[str, str], *, read: bool = False
) -> ExitCode:
    """Sign if there is a signer, write the pages, report. Open items prevent it, unless left open on purpose.

    `read`: the user has just read the lines, so that only the last ones are printed.
    """
    document, errors = _sign(book, by, leave)
    if document.signed is None:
        _draft(book, document)
    if arguments.flag("json"):
        result = [{"message": str(error), "hint": error.hint} for error in errors]
        print(output.json_text({**as_json(document), "errors": result}))
    else:
        last = [*_next(arguments, document), *pages_in(book.folder)]
        above = [*(report.seal(document) if read else report.body(document))]
        if document.signed is not None:  # it stands above the last lines, which have to be few
            above.append(translate(report.signature_line(document)))
        room = _LAST - sum(-(-max(len(line), 1) // printable.NARROW) for line in last)
        show([*above, "", *report.ending(document, room, with_signature=not document.items), *last], sys.stdout)
        output.tell(errors)
    return document.exit


def _sign(
    book: ChecklistSession, by: str | None, leave: Mapping[str, str]
) -> tuple[report.Document, list[NetcfgError]]:
    if by is None:
        return book.document(), []
    try:
        return book.sign(by, lambda document: _pages(document, book), leave=leave), []
    except SigningError as error:
        return book.document(), [error]


def _draft(book: ChecklistSession, document: report.Document) -> None:
    """Write the pages as a draft, for a review before signing."""
    with runs.os_errors_as("the report", book.folder):
        for name, data in _pages(document, book).items():
            runs.write_atomically(book.folder / name, data)


_NOT_AT_A_TERMINAL = frozenset({"anew", "answers", "json", "sign-as"})
_LAST = 8
"""Lines at the end that are enough to see what has happened and what to do."""


def _next(arguments: Arguments, document: report.Document) -> Iterator[str]:
    """Yield the next command, and its purpose."""
    if not document.items or (document.signed is not None and document.exit is ExitCode.DONE):
        return
    waiting = sum(item.open and item.override is None for item in document.items)
    if document.signed is not None:
        words = _begin_anew(report.to_look_at(document)[1])
    elif waiting == 1:
        words = "NOT SIGNED: 1 item is open. To continue and sign, run on a terminal:"
    elif waiting:
        words = msg(f"NOT SIGNED: {arg(waiting)} items are open. To continue and sign, run on a terminal:")
    else:
        words = "NOT SIGNED: no item is open. To sign, run on a terminal:"
    yield translate(words)
    yield f"  {again(arguments, _NOT_AT_A_TERMINAL)}"


def _begin_anew(bad: Sequence[report.Item]) -> str:
    """Return the suggestion after signing a checklist that has not passed; it repeats the worst item."""
    if not bad:
        return "Nothing was checked. Start a new checklist; run:"
    worst, others = bad[0].id, len(bad) - 1
    if others == 0:
        return msg(f"Fix {arg(worst)}, then start a new checklist; run:")
    if others == 1:
        return msg(f"Fix {arg(worst)} and 1 other, then start a new checklist; run:")
    return msg(f"Fix {arg(worst)} and {arg(others)} others, then start a new checklist; run:")


def _pages(document: report.Document, book: ChecklistSession) -> Mapping[str, bytes]:
    from atlantis_netcfg.checklist.report import pages

    return pages(document, book.files)


class CheckInterrupt(DeviceError):
    """The user pressed Ctrl+C: all results and answers so far are stored."""


@dataclass(slots=True)
class PreparedCheck:
    """A check prepared from the arguments and the inventory only, before anything is started or contacted."""

    arguments: Arguments
    _checklist: Checklist | None = None
    answers: Answers | None = None

    @property
    def checklist(self) -> Checklist:
        """The checklist; available once `hosts` has read the inventory."""
        assert self._checklist is not None, "the session calls `hosts` first"  # noqa: S101 - ours to hold
        return self._checklist

    def hosts(self, inventory: Inventory) -> tuple[Host, ...]:
        """Validate the arguments, compute the list, and return the hosts that take part."""
        rehearse = self.arguments.flag("rehearse")
        self._checklist = plan(inventory, self.arguments.word("site"), _scope(self.arguments))
        if (name := self.arguments.value("sign-as")) is not None:
            refuse_signer(name, self._checklist)
        faults = self.arguments.many("break")
        hosts = taking_part(inventory, self._checklist, rehearse=rehearse, faults=faults)
        refuse_absent(faults, plan(inventory, self._checklist.site), self._checklist.scope)
        file = self.arguments.value("answers")
        self.answers = Answers.read(Path(file), self._checklist) if file is not None else None
        return hosts


def refuse_signer(name: str, checklist: Checklist) -> None:
    """Raise UsageError if this person may not sign the list, before anything is checked."""
    if (wrong := refused_person(name, checklist.signers, "sign this checklist")) is not None:
        raise UsageError(f"`--sign-as {arg(name)}`: {arg(wrong[0])}", hint=wrong[1])


def taking_part(
    inventory: Inventory, checklist: Checklist, *, rehearse: bool, faults: Sequence[str] = ()
) -> tuple[Host, ...]:
    """Return the hosts that a checklist needs. Raises UsageError if example values would be contacted.

    In a rehearsal the gateway is emulated only as far as the checklist needs it, so no machine is started for it; and
    no router is started if none is needed or has a fault.
    """
    refuse_examples(inventory, is_rehearsal=rehearse)
    hosts = tuple(inventory.site_hosts(checklist.site))
    if not rehearse:
        return hosts
    routers = asks_a_router(checklist.entries) or breaks_a_site(faults)
    return tuple(host for host in hosts if routers and not is_computer(host))


def run_check(arguments: Arguments, prompt: workflow.Prompt | None = None) -> ExitCode:
    """Run one session of the checklist, and report its result. `prompt` replaces the terminal."""
    refuse_faults(arguments.many("break"), is_rehearsal=arguments.flag("rehearse"))
    if (name := arguments.value("sign-as")) is not None and workflow.doubt_of_name(clean_name(name)):
        raise UsageError(
            f"`--sign-as {arg(name)}`: this does not look like a person's name",
            hint="write the name as it should appear in the report",
        )
    check = PreparedCheck(arguments)
    if prompt is None and _is_interactive(arguments):
        prompt = workflow.Prompt()
    try:
        with session(
            arguments,
            rehearse=arguments.flag("rehearse"),
            via=arguments.optional("via"),
            choose_hosts=check.hosts,
        ) as site_session:
            return _run_checklist(site_session, check, prompt)
    except KeyboardInterrupt:
        hint = msg(f"continue with `{arg(again(arguments))}`")
        raise CheckInterrupt("interrupted by Ctrl-C; results and answers so far are saved", hint=hint) from None


def _is_interactive(arguments: Arguments) -> bool:
    return sys.stdin.isatty() and not arguments.flag("json") and arguments.value("answers") is None


def _scope(arguments: Arguments) -> Scope:
    phases = tuple(report.Phase(item.replace("-", " ")) for item in arguments.many("phase"))
    return Scope(arguments.many("vehicle"), arguments.many("endpoint"), phases, arguments.optional("mission") or "")


def _run_checklist(site_session: CommandSession, check: PreparedCheck, prompt: workflow.Prompt | None) -> ExitCode:
    faults = site_session.arguments.many("break")
    with opened_book(site_session, check.checklist, faults, anew=_anew(site_session, prompt)) as book:
        by = _look(site_session, check, book, prompt)
        leave = check.answers.leave if check.answers is not None else {}
        read = prompt is not None and by is not None and not site_session.arguments.value("sign-as")
        return close(site_session.arguments, book, by, leave, read=read)


def _look(
    site_session: CommandSession, check: PreparedCheck, book: ChecklistSession, prompt: workflow.Prompt | None
) -> str | None:
    """Run the probes and ask the user; return who signs."""
    entries, faults = check.checklist.entries, site_session.arguments.many("break")
    with (
        # A person reads and types where progress would be drawn.
        output.progress(quiet=site_session.as_json) if prompt is None else nullcontext(events.ignore) as notify,
        listening(site_session, faults, notify) as ears,
    ):
        turn = workflow.CheckWorkflow(
            book,
            entries,
            ears,
            _item_printer(notify, prompt),
            lambda entry: workflow.price_of(site_session, entry),
            site_session.is_rehearsal,
        )
        if prompt is None:
            for words in turn.alone(check.answers):
                note(words)
            return signer(check.answers, site_session.arguments.value("sign-as"))
        return _with(prompt, turn, book, site_session.arguments.value("sign-as"), check.checklist.signers)


def _item_printer(notify: events.Subscriber, prompt: workflow.Prompt | None) -> Callable[[report.Item], None]:
    def tell(item: report.Item) -> None:
        if prompt is not None:
            prompt.say(workflow.render_item(item))
        else:
            notify(events.Event(item.id, events.Stage.DONE, msg(f"{arg(item.verdict)}: {arg(item.message)}")))

    return tell


def _anew(site_session: CommandSession, prompt: workflow.Prompt | None) -> bool:
    """Return whether to start a new checklist; a rehearsal without a person always does."""
    return site_session.arguments.flag("anew") or (site_session.is_rehearsal and prompt is None)


def _with(
    prompt: workflow.Prompt,
    turn: workflow.CheckWorkflow,
    book: ChecklistSession,
    sign_as: str | None,
    signers: Sequence[str],
) -> str | None:
    """Go through the checklist with a person; return who signs (`sign_as`: value of `--sign-as`)."""
    greet(prompt, book)
    try:
        turn.with_a_person(prompt)
    except workflow.PromptAbort:
        prompt.say(translate("left for later"))
    return sign_as if sign_as is not None else signer_at(prompt, turn, book, signers)
