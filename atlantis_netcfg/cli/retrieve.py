"""`provision retrieve`: recordings of a gateway or a robot to the control centre, over whatever link the site has."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.cli.base.arguments import (
    ACCEPT_COST,
    ASK_VAULT_PASS,
    INVENTORY,
    JSON,
    VIA,
    Arguments,
    CommandSpec,
    Flag,
    Group,
    Word,
)
from atlantis_netcfg.cli.base.inventory_names import Values
from atlantis_netcfg.cli.base.output import json_text
from atlantis_netcfg.core.language import translate

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.cli.base.session import CommandSession
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.inventory import Declaration, Host
    from atlantis_netcfg.operations.retrieve import (
        RetrievalPlan,
        RetrievalProgram,
        RetrievalSelection,
        RetrievalStatus,
        Source,
    )

RETRIEVE = CommandSpec(
    "retrieve",
    "bring recordings of a gateway or a robot to the control centre, over whatever link the site has",
    group=Group.LINKS,
    words=(
        Word("site", "the site", required=True, example="coastal"),
        Word(
            "from",
            "the gateway or robot; may be left out where the site has one",
            example="coastal-gateway",
            values=Values.HOST,
        ),
        Word("files", "only those whose path below the folder is like this", example="'bag-20261126-*'"),
        Word("link", "the link that carries it; the router is asked if left out", example="4g"),
        Word("order", "`status`: how it stands; `stop`: end it", choices=("status", "stop"), bare=True),
        VIA,
        INVENTORY,
    ),
    flags=(
        Flag("plan", "say what it takes and costs, send nothing", harmless=True),
        Flag("leave", "begin, and do not wait for its end"),
        Flag(
            "rehearse",
            "the same on this computer: both programs, an emulated link that is cut, and made recordings",
            harmless=True,
        ),
        Flag("again", "also compare what was retrieved before, and send again what differs"),
        ACCEPT_COST,
        ASK_VAULT_PASS,
        JSON,
    ),
    details=(
        "The gateway sends by itself, at the declared share of the link, and goes on where it was after a gap, a "
        "restart, or when you leave: Ctrl-C ends the watching alone. What is on a robot it collects first, over the "
        "LAN. No recording is removed, neither from the gateway's own folder nor from a robot.\n"
        "Exit code 0: every file was read again at the control centre and has the same SHA-256, 6: not yet, or not "
        "all, 4: it has ended before, 7: there is nothing."
    ),
    changes=True,
    again="type the same again: what has arrived is not sent twice; with `status` it shows whether it goes on",
)


def run_retrieve(arguments: Arguments) -> ExitCode:
    """Look, say what it costs, begin and watch; or tell how it stands, or end it."""
    from atlantis_netcfg.cli.base.session import session
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.operations import Mode
    from atlantis_netcfg.operations.common.request import refuse_examples
    from atlantis_netcfg.operations.retrieve import RetrievalSelection, program_by_ssh, source_at

    if arguments.flag("rehearse"):
        return _rehearse(arguments)
    site, order = arguments.word("site"), arguments.optional("order")
    _refuse_mixed(arguments, order)
    found: list[Source] = []

    def chosen(declaration: Declaration) -> tuple[Host, ...]:
        source, host = source_at(declaration, site, arguments.optional("from"))
        found.append(source)
        return (host,)

    with session(arguments, via=arguments.optional("via"), chosen=chosen) as opened:
        refuse_examples(opened.declaration, rehearsed=False)
        program = program_by_ssh(opened.declaration, found[0], opened.paid(opened.request(Mode.DRIFT)))
        if order is not None:
            return _ended_or_told(opened, program, order)
        selection = RetrievalSelection(arguments.optional("files") or "*", arguments.flag("again"))
        look = program.look(selection)
        if not look["files"]:
            return _nothing(opened, program, look)
        plan = _planned(opened, found[0], look)
        if not opened.as_json or arguments.flag("plan"):
            _say(opened, program, plan.lines(), plan.as_dict(), ExitCode.CHANGES)
        if arguments.flag("plan"):
            return ExitCode.CHANGES
        return _begin(opened, program, plan, selection)


def _rehearse(arguments: Arguments) -> ExitCode:
    """Let both programs of a transfer run on this computer. Raises UsageError, NothingMatched."""
    from atlantis_netcfg.cli.base.rehearsal import announce
    from atlantis_netcfg.cli.base.session import session
    from atlantis_netcfg.core.errors import ExitCode, UsageError
    from atlantis_netcfg.operations.common.site_links import bearer_named
    from atlantis_netcfg.operations.retrieve import RetrievalSelection, plan, source_at
    from atlantis_netcfg.operations.retrieve_rehearsal import (
        NOT_REHEARSED,
        ROBOT_NOT_REHEARSED,
        rehearsed_transfer,
        with_example,
    )

    if more := _typed(arguments, "files", "via", "order"):
        raise UsageError(
            f"`--rehearse` goes the whole way by itself: it takes no {' and no '.join(more)}", hint="leave that out"
        )
    site, found = arguments.word("site"), []

    def chosen(declaration: Declaration) -> tuple[Host, ...]:
        declared, example = with_example(declaration, site)
        source, host = source_at(declared, site, arguments.optional("from"))
        found.append((declared, source, example))
        return (host,)

    with session(arguments, chosen=chosen) as opened:
        declared, source, example = found[0]
        announce(opened)
        named = arguments.optional("link")
        bearers = declared.sites[site].bearers
        bearer = bearers[0] if named is None else bearer_named(declared, site, named)
        with rehearsed_transfer(declared, source, bearer) as transfer:
            program = transfer.program
            made = plan(declared, source, bearer.name, program.look(RetrievalSelection()))
            if not opened.as_json:
                _say(opened, program, [*([example] if example else []), *made.lines()], {}, ExitCode.DONE)
            status = transfer.run(made)
            same = transfer.same()
            lines = [*status.lines(site), *transfer.lines(same=same)]
            untold = [*NOT_REHEARSED, *([ROBOT_NOT_REHEARSED] if made.robot is not None else [])]
            document = {**status.as_dict(), "rehearsed": True, "same": same, "not_rehearsed": untold}
            code = status.exit if same else max(status.exit, ExitCode.CHECKS_FAILED)
            return _say(opened, program, [*lines, *(f"  not rehearsed: {each}" for each in untold)], document, code)


def _refuse_mixed(arguments: Arguments, order: str | None) -> None:
    """Raises UsageError where the words do not go together."""
    from atlantis_netcfg.core.errors import UsageError

    if order is None:
        return
    if more := _typed(arguments, "files", "link"):
        raise UsageError(
            f"`{order}` is about a transfer that was begun: it takes no {' and no '.join(more)}", hint="leave that out"
        )


def _typed(arguments: Arguments, *words: str) -> list[str]:
    """Which of these words, and of the flags about how a transfer is begun, a person has typed."""
    flags = [f"`--{name}`" for name in ("plan", "leave", "again") if arguments.flag(name)]
    return [*(f"`{name}=`" for name in words if arguments.optional(name) is not None), *flags]


def _nothing(opened: CommandSession, program: RetrievalProgram, look: dict[str, Any]) -> ExitCode:
    """Done where all that matches was retrieved before; else nothing has matched."""
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.operations.retrieve import left_out

    done = look["kept"] and not look["writing"] and not look["unnamed"]
    lines = ["nothing to send" if done else "no file to send", *left_out(look)]
    document = {name: look[name] for name in ("files", "bytes", "kept", "writing", "unnamed")}
    return _say(opened, program, lines, document, ExitCode.DONE if done else ExitCode.NOTHING)


def _planned(opened: CommandSession, source: Source, look: dict[str, Any]) -> RetrievalPlan:
    """Over the link that a person names, or that the router says is in use. Raises UsageError, DeviceFailed."""
    from atlantis_netcfg.operations.common.site_links import bearer_named
    from atlantis_netcfg.operations.retrieve import plan

    named = opened.arguments.optional("link")
    bearers = opened.declaration.sites[opened.site].bearers
    if named is not None:
        link = bearer_named(opened.declaration, opened.site, named).name
    else:
        link = bearers[0].name if len(bearers) == 1 else _in_use(opened)
    return plan(opened.declaration, source, link, look)


def _in_use(opened: CommandSession) -> str:
    """Ask the router which link carries the traffic. Raises DeviceFailed where it does not say so of one alone."""
    from atlantis_netcfg.cli.links import seen
    from atlantis_netcfg.core.errors import DeviceFailed
    from atlantis_netcfg.operations.use import router_of

    gateway, opened.hosts = opened.hosts, (router_of(opened.declaration, opened.site),)
    try:
        active = [status.name for status in seen(opened).bearers if status.active]
    finally:
        opened.hosts = gateway
    if len(active) != 1:
        raise DeviceFailed(
            f"which link carries the traffic of {opened.site} is not known, so nothing was sent",
            hint=f"`provision links site={opened.site}` shows more; or name it: `link=NAME`",
        )
    return active[0]


def _begin(
    opened: CommandSession, program: RetrievalProgram, plan: RetrievalPlan, selection: RetrievalSelection
) -> ExitCode:
    """Raises CostRefused, NotBegun, BeginningUnknown."""
    from atlantis_netcfg.cli.base.consent import pay
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.operations.retrieve import new_number, shown_by

    if plan.cost.over_cap:
        raise plan.cost.refusal()
    words = [plan.cost.words] if plan.link.metered else []
    pay(words, accepted=opened.arguments.given(ACCEPT_COST), as_json=opened.as_json)
    program.start(plan.job(selection, new_number()))
    if opened.arguments.flag("leave"):
        status = program.status()
        lines = ["begun: the gateway sends by itself", shown_by(program.host, program.source)]
        code = ExitCode.DONE if status.runs or status.whole else status.exit
        return _say(opened, program, lines, status.as_dict(), code)
    return _watched(opened, program)


def _watched(opened: CommandSession, program: RetrievalProgram) -> ExitCode:
    """Tell how it stands until it has ended; whoever stops watching does not stop the transfer."""
    from atlantis_netcfg.cli.base.output import progress
    from atlantis_netcfg.core.errors import OutcomeUnknown
    from atlantis_netcfg.core.events import Event, Stage
    from atlantis_netcfg.operations.retrieve import shown_by

    name, period_s = program.host.name, _SLOWLY_S if program.slow else _OFTEN_S
    try:
        with progress(quiet=opened.as_json) as notify:
            while (status := _patient(program)) is None or status.runs:
                if status is not None:
                    notify(Event(name, Stage.APPLYING, status.progress()))
                _pause(period_s)
    except KeyboardInterrupt:
        raise OutcomeUnknown(
            f"nobody watches any more; {name} goes on sending by itself",
            hint=shown_by(program.host, program.source),
        ) from None
    return _tell(opened, program, status)


_OFTEN_S, _SLOWLY_S = 2.0, 30.0
_pause = time.sleep


def _patient(program: RetrievalProgram) -> RetrievalStatus | None:
    """How it stands; None while the gateway is not reached: it goes on without us."""
    from atlantis_netcfg.operations.retrieve import GatewayAway

    try:
        return program.status()
    except GatewayAway:
        return None


def _ended_or_told(opened: CommandSession, program: RetrievalProgram, order: str) -> ExitCode:
    from atlantis_netcfg.core.errors import ExitCode

    if order == "status":
        return _tell(opened, program, program.status())
    before = program.status()
    if not before.runs:
        lines = ["nothing goes on, so there is nothing to stop"]
        return _say(opened, program, lines, before.as_dict(), ExitCode.NOTHING)
    after = program.stop()
    code = ExitCode.DONE if not after.runs else ExitCode.FAILED
    return _say(opened, program, after.lines(opened.site), after.as_dict(), code)


def _tell(opened: CommandSession, program: RetrievalProgram, status: RetrievalStatus) -> ExitCode:
    return _say(opened, program, status.lines(opened.site), status.as_dict(), status.exit)


def _say(
    opened: CommandSession,
    program: RetrievalProgram,
    lines: Sequence[str],
    data: dict[str, object],
    code: ExitCode,
) -> ExitCode:
    from atlantis_netcfg.core import printable

    if opened.as_json:
        named = {"site": opened.site, "from": program.source.name}
        print(json_text({**named, **data, "exit": int(code), "errors": []}))
        return code
    for line in lines:
        print(printable.line(translate(line)), flush=True)
    return code
