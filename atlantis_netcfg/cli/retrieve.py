"""`provision robot retrieve`: copy recordings of a gateway or a robot to the control centre, over any link."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.cli.base import syntax
from atlantis_netcfg.cli.base.inventory_names import Values
from atlantis_netcfg.cli.base.output import json_text
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import alternatives, arg, msg

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.cli.base.session import CommandSession
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.operations import retrieve

RETRIEVE = syntax.CommandSpec(
    "robot retrieve",
    "copy recordings of a gateway or robot to the control centre",
    words=(
        syntax.Word("site", "the site", is_required=True, example="coastal"),
        syntax.Word(
            "from",
            "gateway or robot (optional if the site has only one)",
            example="coastal-gateway",
            values=Values.HOST,
        ),
        syntax.Word("files", "only files whose path matches this pattern", example="'bag-20261126-*'"),
        syntax.Word("link", "link to use (default: ask the router)", example="4g"),
        syntax.Word(
            "order", "`status`: show progress; `stop`: end the transfer", choices=("status", "stop"), bare=True
        ),
        syntax.VIA,
        syntax.INVENTORY,
    ),
    flags=(
        syntax.Flag("plan", "show duration and cost, send nothing", harmless=True),
        syntax.Flag("leave", "start, do not wait for the end"),
        syntax.Flag(
            "rehearse",
            "on this computer: emulated link, generated recordings",
            harmless=True,
        ),
        syntax.Flag("again", "also compare earlier files, and resend those that differ"),
        syntax.ACCEPT_COST,
        syntax.ASK_VAULT_PASS,
        syntax.JSON,
    ),
    details=(
        "The gateway sends on its own, within its share of the link. It continues after an outage, a restart or "
        "when you leave: Ctrl-C ends only the progress display. It first collects recordings from a robot over "
        "the LAN. No recording is removed, neither from the gateway's own folder nor from a robot.\nExit code 0: "
        "every file was read back at the control centre and has the same SHA-256, 6: files are missing or "
        "pending, 4: the transfer ended early, 7: no files found."
    ),
    changes=True,
    again="run the same command again: received files are not sent twice; `status` shows the progress",
)


def run_retrieve(arguments: syntax.Arguments) -> ExitCode:
    """Run `robot retrieve`: show files and cost, start and watch; or report the status, or stop the transfer."""
    from atlantis_netcfg.cli.base.session import session
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.operations import Mode
    from atlantis_netcfg.operations.common.request import refuse_examples
    from atlantis_netcfg.operations.retrieve import RetrievalSelection, program_by_ssh, source_at

    if arguments.flag("rehearse"):
        return _rehearse(arguments)
    site, order = arguments.word("site"), arguments.optional("order")
    _refuse_mixed(arguments, order)
    sources: list[retrieve.Source] = []

    def choose_hosts(inventory: Inventory) -> tuple[Host, ...]:
        source, host = source_at(inventory, site, arguments.optional("from"))
        sources.append(source)
        return (host,)

    with session(arguments, via=arguments.optional("via"), choose_hosts=choose_hosts) as site_session:
        refuse_examples(site_session.inventory, is_rehearsal=False)
        program = program_by_ssh(
            site_session.inventory, sources[0], site_session.confirm_cost(site_session.request(Mode.DRIFT))
        )
        if order is not None:
            return _end_or_print_status(site_session, program, order)
        selection = RetrievalSelection(arguments.optional("files") or "*", arguments.flag("again"))
        look = program.look(selection)
        if not look["files"]:
            return _nothing(site_session, program, look)
        plan = _make_plan(site_session, sources[0], look)
        if not site_session.as_json or arguments.flag("plan"):
            _print_answer(site_session, program, plan.lines(), plan.as_dict(), ExitCode.CHANGES)
        if arguments.flag("plan"):
            return ExitCode.CHANGES
        return _begin(site_session, program, plan, selection)


def _rehearse(arguments: syntax.Arguments) -> ExitCode:
    """Run both programs of a transfer on this computer. Raises UsageError, NoMatchError."""
    from atlantis_netcfg.cli.base.rehearsal import announce
    from atlantis_netcfg.cli.base.session import session
    from atlantis_netcfg.core.errors import ExitCode, UsageError
    from atlantis_netcfg.operations.common.site_links import link_named
    from atlantis_netcfg.operations.retrieve import RetrievalSelection, plan, source_at
    from atlantis_netcfg.operations.retrieve_rehearsal import (
        NOT_REHEARSED,
        ROBOT_NOT_REHEARSED,
        rehearsed_transfer,
        with_example,
    )
    from atlantis_netcfg.runs.report.summary import count_limits

    if more := _given_words(arguments, "files", "via", "order"):
        raise UsageError(
            f"`--rehearse` runs the whole transfer: it does not accept {arg(alternatives(more))}", hint="remove it"
        )
    site, candidates = arguments.word("site"), []

    def choose_hosts(inventory: Inventory) -> tuple[Host, ...]:
        example_inventory, example = with_example(inventory, site)
        source, host = source_at(example_inventory, site, arguments.optional("from"))
        candidates.append((example_inventory, source, example))
        return (host,)

    with session(arguments, choose_hosts=choose_hosts) as site_session:
        example_inventory, source, example = candidates[0]
        announce(site_session)
        link_name = arguments.optional("link")
        links = example_inventory.sites[site].bearers
        link = links[0] if link_name is None else link_named(example_inventory, site, link_name)
        with rehearsed_transfer(example_inventory, source, link) as transfer:
            program = transfer.program
            transfer_plan = plan(example_inventory, source, link.name, program.look(RetrievalSelection()))
            if not site_session.as_json:
                _print_answer(
                    site_session, program, [*([example] if example else []), *transfer_plan.lines()], {}, ExitCode.DONE
                )
            status = transfer.run(transfer_plan)
            same = transfer.same()
            lines = [*status.lines(site), *transfer.lines(same=same)]
            untold = [*NOT_REHEARSED, *([ROBOT_NOT_REHEARSED] if transfer_plan.robot is not None else [])]
            document = {**status.as_dict(), "rehearsed": True, "same": same, "not_rehearsed": untold}
            code = status.exit if same else max(status.exit, ExitCode.CHECKS_FAILED)
            limits = msg(f"  {arg(count_limits(len(untold)))}")
            return _print_answer(site_session, program, [*lines, limits], document, code)


def _refuse_mixed(arguments: syntax.Arguments, order: str | None) -> None:
    """Raise UsageError for arguments that exclude each other."""
    from atlantis_netcfg.core.errors import UsageError

    if order is None:
        return
    if more := _given_words(arguments, "files", "link"):
        raise UsageError(
            f"`{arg(order)}` refers to a running transfer: it does not accept {arg(alternatives(more))}",
            hint="remove it",
        )


def _given_words(arguments: syntax.Arguments, *words: str) -> list[str]:
    """Return those of the arguments, and of the flags for starting a transfer, that were given."""
    flags = [f"`--{name}`" for name in ("plan", "leave", "again") if arguments.flag(name)]
    return [*(f"`{name}=`" for name in words if arguments.optional(name) is not None), *flags]


def _nothing(session: CommandSession, program: retrieve.RetrievalProgram, look: dict[str, Any]) -> ExitCode:
    """Report that there is nothing to send: done if all matching files were retrieved before, otherwise no match."""
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.operations.retrieve import left_out

    is_done = look["kept"] and not look["writing"] and not look["unnamed"]
    lines = ["nothing to send" if is_done else "no file to send", *left_out(look)]
    document = {name: look[name] for name in ("files", "bytes", "kept", "writing", "unnamed")}
    return _print_answer(session, program, lines, document, ExitCode.DONE if is_done else ExitCode.NOTHING)


def _make_plan(session: CommandSession, source: retrieve.Source, look: dict[str, Any]) -> retrieve.RetrievalPlan:
    """Plan over the link given, or over the router's active link. Raises UsageError, DeviceError."""
    from atlantis_netcfg.operations.common.site_links import link_named
    from atlantis_netcfg.operations.retrieve import plan

    link_name = session.arguments.optional("link")
    links = session.inventory.sites[session.site].bearers
    if link_name is not None:
        link = link_named(session.inventory, session.site, link_name).name
    else:
        link = links[0].name if len(links) == 1 else _in_use(session)
    return plan(session.inventory, source, link, look)


def _in_use(session: CommandSession) -> str:
    """Read the active link from the router. Raises DeviceError unless there is exactly one."""
    from atlantis_netcfg.cli.links import read_links
    from atlantis_netcfg.core.errors import DeviceError
    from atlantis_netcfg.operations.use import router_of

    gateway, session.hosts = session.hosts, (router_of(session.inventory, session.site),)
    try:
        active = [status.name for status in read_links(session).links if status.active]
    finally:
        session.hosts = gateway
    if len(active) != 1:
        raise DeviceError(
            f"the active link of {arg(session.site)} is unknown; nothing was sent",
            hint=f"`provision links site={arg(session.site)}` shows details; or choose one: `link=NAME`",
        )
    return active[0]


def _begin(
    session: CommandSession,
    program: retrieve.RetrievalProgram,
    plan: retrieve.RetrievalPlan,
    selection: retrieve.RetrievalSelection,
) -> ExitCode:
    """Ask for consent to the cost, and start the transfer. Raises CostRefusal, NotBegun, BeginningUnknown."""
    from atlantis_netcfg.cli.base.consent import pay
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.operations.retrieve import new_number, shown_by

    if plan.cost.over_cap:
        raise plan.cost.refusal()
    words = [plan.cost.words] if plan.link.is_metered else []
    pay(words, is_accepted=session.arguments.has_flag(syntax.ACCEPT_COST), as_json=session.as_json)
    program.start(plan.job(selection, new_number()))
    if session.arguments.flag("leave"):
        status = program.status()
        lines = ["started: the gateway continues on its own", shown_by(program.host, program.source)]
        code = ExitCode.DONE if status.runs or status.whole else status.exit
        return _print_answer(session, program, lines, status.as_dict(), code)
    return _watch(session, program)


def _watch(session: CommandSession, program: retrieve.RetrievalProgram) -> ExitCode:
    """Report the progress until the end; to stop watching does not stop the transfer."""
    from atlantis_netcfg.cli.base.output import progress
    from atlantis_netcfg.core.errors import OutcomeUnknown
    from atlantis_netcfg.core.events import Event, Stage
    from atlantis_netcfg.operations.retrieve import shown_by

    name, period_s = program.host.name, _SLOWLY_S if program.slow else _OFTEN_S
    try:
        with progress(quiet=session.as_json) as notify:
            while (status := _patient(program)) is None or status.runs:
                if status is not None:
                    notify(Event(name, Stage.APPLYING, status.progress()))
                _pause(period_s)
    except KeyboardInterrupt:
        raise OutcomeUnknown(
            f"progress display ended; {arg(name)} continues to send",
            hint=shown_by(program.host, program.source),
        ) from None
    return _print_status(session, program, status)


_OFTEN_S, _SLOWLY_S = 2.0, 30.0
_pause = time.sleep


def _patient(program: retrieve.RetrievalProgram) -> retrieve.RetrievalStatus | None:
    """Return the status; None while the gateway is not reachable: the transfer continues."""
    from atlantis_netcfg.operations.retrieve import GatewayAway

    try:
        return program.status()
    except GatewayAway:
        return None


def _end_or_print_status(session: CommandSession, program: retrieve.RetrievalProgram, order: str) -> ExitCode:
    from atlantis_netcfg.core.errors import ExitCode

    if order == "status":
        return _print_status(session, program, program.status())
    before = program.status()
    if not before.runs:
        lines = ["no transfer is running, so there is nothing to stop"]
        return _print_answer(session, program, lines, before.as_dict(), ExitCode.NOTHING)
    after = program.stop()
    code = ExitCode.DONE if not after.runs else ExitCode.FAILED
    return _print_answer(session, program, after.lines(session.site), after.as_dict(), code)


def _print_status(
    session: CommandSession, program: retrieve.RetrievalProgram, status: retrieve.RetrievalStatus
) -> ExitCode:
    return _print_answer(session, program, status.lines(session.site), status.as_dict(), status.exit)


def _print_answer(
    session: CommandSession,
    program: retrieve.RetrievalProgram,
    lines: Sequence[str],
    data: dict[str, object],
    code: ExitCode,
) -> ExitCode:
    from atlantis_netcfg.core import printable

    if session.as_json:
        head = {"site": session.site, "from": program.source.name}
        print(json_text({**head, **data, "exit": int(code), "errors": []}))
        return code
    for line in lines:
        print(printable.line(translate(line)), flush=True)
    return code
