"""Commands of runs: `run` (the default, `provision site=…`), `plan` and `report runs`.

`provision report runs`: past runs, their results, and what is still open.

`provision site=coastal`: plan, ask, change, verify.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from atlantis_netcfg.cli.base import syntax
from atlantis_netcfg.core import errors
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, join, msg

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from atlantis_netcfg.runs import Run, Store


RUNS = syntax.CommandSpec(
    "report runs",
    "list past and unfinished runs",
    words=(syntax.Word("site", "only the runs of this site", example="coastal"),),
    flags=(
        syntax.Flag("rehearse", "list rehearsals instead of real runs"),
        syntax.Flag("all", "also list runs that later runs have settled"),
        syntax.JSON,
    ),
)


def run_runs(arguments: syntax.Arguments) -> errors.ExitCode:
    """List the runs, oldest first; exit code 7 if there are none."""
    import sys

    from atlantis_netcfg.cli.base.output import json_text
    from atlantis_netcfg.core import paths, printable
    from atlantis_netcfg.runs import Store

    store = Store(paths.state_dir(), is_rehearsal=arguments.flag("rehearse"))
    sites = sites_with_runs(store, arguments.optional("site"))
    aside = {site: store.archived_runs(site) for site in sites}
    everything = arguments.flag("all")
    rows = [row for site in sites for row in _rows(store, site, aside[site] if everything else ())]
    archived_count = sum(map(len, aside.values()))
    if not rows:
        raise errors.NoMatchError("no runs found", hint="`provision site=NAME` starts one")
    if arguments.flag("json"):
        print(json_text({"exit": int(errors.ExitCode.DONE), "errors": [], "runs": rows, "archived": archived_count}))
    else:
        width = printable.width_of(sys.stdout) or printable.NARROW
        lines = [line for key, group in _groups(rows).items() for line in _command_lines(store, key, group)]
        if archived_count and not everything:
            hint = msg(f"{arg(archived_count)} older runs are archived: `provision report runs --all` lists them too")
            lines.append(translate(hint))
        printable.show(
            (row for line in lines for row in printable.wrap_row(line, width, _DETAIL_INDENT + 2)), sys.stdout
        )
    return errors.ExitCode.DONE


def sites_with_runs(store: Store, site: str | None) -> tuple[str, ...]:
    """Return the site, or all that have runs. Raises NoMatchError if the site has none."""
    sites = store.sites()
    if site is None:
        return sites
    if site not in sites:
        raise errors.NoMatchError(
            f"no runs of `{arg(site)}`", hint=f"sites with runs: {arg(join(', ', sites) or 'no site')}"
        )
    return (site,)


def _rows(store: Store, site: str, archived_runs: Sequence[str]) -> Iterator[dict[str, Any]]:
    """Yield one row per run; each journal is read once."""
    from atlantis_netcfg.runs import find_unfinished

    runs = store.runs(site)
    open_runs = {run.id for run in find_unfinished(runs)}
    for item in sorted((*(store.run(site, name) for name in archived_runs), *runs), key=lambda run: run.id):
        yield _row(item, site, is_open=item.id in open_runs)


def _row(run: Run, site: str, *, is_open: bool) -> dict[str, Any]:
    start = run.start_record
    hosts = start.hosts if start else ()
    return {
        "run": run.id,
        "at": run.at.isoformat(timespec="seconds") if run.at is not None else None,
        "invocations": run.invocations,
        "site": site,
        "exit": run.exit,
        "unfinished": is_open,
        "command": start.command if start else "",
        "prepares": start is not None and start.prepares,
        "next": run.next_command if is_open else None,
        "damage": list(run.log.damage),
        "devices": {
            host: {
                "status": outcome.status if (outcome := run.outcomes.get(host)) else "not reached",
                "confirmed": len(run.confirmed_actions(host)),
                "saved_state": run.before(host) is not None,
                "confirmed_state": run.confirmed_state(host) is not None,
            }
            for host in hosts
        },
    }


_WORST_FIRST = (*errors.WORST_FIRST[:-2], errors.ExitCode.NOTHING, *errors.WORST_FIRST[-2:])
_DETAIL_INDENT = 4


def _groups(rows: Sequence[dict[str, Any]]) -> dict[str, list[dict[str, Any]]]:
    """Group the runs by the commands that started or resumed them, oldest first."""
    from atlantis_netcfg.runs import run_order

    groups: dict[str, list[dict[str, Any]]] = {}
    for row in sorted(rows, key=lambda row: run_order(row["run"])):
        for invocation in row["invocations"]:
            groups.setdefault(invocation, []).append(row)
    return groups


def _command_lines(store: Store, invocation: str, rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Yield the row of a command, then its runs; runs that changed nothing are counted if there are others."""
    from datetime import datetime

    at = next((datetime.fromisoformat(row["at"]) for row in rows if row["at"]), None)
    time = f"{at.astimezone():%Y-%m-%d %H:%M}" if at is not None else " " * 16
    yield msg(f"{arg(time)}  {arg(_verdict(store, invocation, rows))}  {arg(rows[0]['invocations'][invocation])}")
    notable_rows = [row for row in rows if not _is_quiet(row)] or rows[:1]
    for row in notable_rows:
        damage = f"  DAMAGED JOURNAL: {', '.join(row['damage'])}" if row["damage"] else ""
        purpose = f"{translate('emulated devices prepared:')} " if row["prepares"] else ""
        devices = join(", ", (_device(name, outcome) for name, outcome in row["devices"].items()))
        yield msg(
            f"{'':<{_DETAIL_INDENT}}{arg(row['run'])}  {arg(row['site'])}  {arg(purpose)}{arg(devices)}{arg(damage)}"
        )
        if row["unfinished"]:
            yield f"{'':<{_DETAIL_INDENT}}" + translate(f"continue: `{arg(row['next'])}`")
    if quiet_count := len(rows) - len(notable_rows):
        yield f"{'':<{_DETAIL_INDENT}}{translate(f'further runs without changes: {arg(quiet_count)}')}"


def _verdict(store: Store, invocation: str, rows: Sequence[dict[str, Any]]) -> str:
    """Return the worst of what the command and its runs ended with: never a code that one of them did not reach."""
    if any(row["unfinished"] for row in rows):
        return translate("UNFINISHED")
    codes = {row["exit"] for row in rows}
    if "/" not in invocation:
        codes.add(store.command_exit(invocation))
    if None in codes:
        return translate("no result recorded")
    code = min(codes, key=lambda code: _WORST_FIRST.index(code) if code in _WORST_FIRST else -1)
    return translate(f"exit code {arg(code)}")


def _is_quiet(row: dict[str, Any]) -> bool:
    """Return whether the run ended well, with every device as it was."""
    statuses = {outcome["status"] for outcome in row["devices"].values()}
    is_fine = row["exit"] == errors.ExitCode.DONE and not row["unfinished"] and not row["damage"]
    return is_fine and statuses <= {"unchanged"}


def _device(name: str, outcome: dict[str, Any]) -> str:
    """Format a device's status, its confirmed actions, and whether `provision device restore` can use its state."""
    state_note = translate(", state kept") if outcome["confirmed_state"] else ""
    status = translate(outcome["status"].replace("-", " "))
    return f"{name} {status} ({outcome['confirmed']}{state_note})"


_WORDS = (
    syntax.Word("site", "the site, or `all`", is_required=True, example="coastal"),
    syntax.DEVICES,
    syntax.VIA,
    syntax.INVENTORY,
)
_REHEARSE = syntax.Flag("rehearse", "run against emulated devices of the site", harmless=True)
_OFFLINE = syntax.Flag("offline", "gateways install only from this bundle", takes="BUNDLE")

SITE = syntax.CommandSpec(
    "run",
    "configure a site: plan, confirm, apply, verify",
    words=_WORDS,
    flags=(_REHEARSE, syntax.PROFILE, _OFFLINE, syntax.YES, *syntax.CHANGE, syntax.STREAM),
    changes=True,
    plays=True,
)


def run_site(arguments: syntax.Arguments) -> errors.ExitCode:
    """Run the default command: plan, ask, apply, verify."""
    from atlantis_netcfg.cli.base.session import session

    bundle = _bundle(arguments)
    with session(arguments, rehearse=arguments.flag("rehearse"), via=arguments.optional("via")) as site_session:
        site_session.offline = bundle
        if site_session.rehearsal is not None:
            from atlantis_netcfg.cli.base.rehearsal import announce, rehearse

            announce(site_session)
            report = rehearse(site_session, site_session.rehearsal)
        else:
            report = site_session.change(ask=not arguments.flag("yes"))
    return site_session.close(report)


PLAN = syntax.CommandSpec(
    "plan",
    "show changes and costs of a run; apply a saved plan",
    words=_WORDS,
    flags=(
        syntax.SUMMARY,
        syntax.Flag("save", "save the plan to a file, for `provision plan apply`", takes="FILE"),
        _REHEARSE,
        syntax.PROFILE,
        _OFFLINE,
        *(flag for flag in syntax.CHANGE if flag is not syntax.WITHOUT_PROTECTION),
        syntax.STREAM,
    ),
    plays=True,
)


def run_plan(arguments: syntax.Arguments) -> errors.ExitCode:
    """Run `plan`: show what a run would change; exit code 2 if there is anything."""
    from pathlib import Path

    from atlantis_netcfg.cli.base.session import session
    from atlantis_netcfg.cli.plans import refuse_place, save

    bundle, file = _bundle(arguments), arguments.value("save")
    if file is not None:
        refuse_place(Path(file))
    with session(arguments, rehearse=arguments.flag("rehearse"), via=arguments.optional("via")) as site_session:
        site_session.offline = bundle
        report = site_session.plan()
        next_command = save(site_session, report, Path(file)) if file is not None else ""
    return site_session.close(report, next_command)


def _bundle(arguments: syntax.Arguments) -> Path | None:
    """Return the bundle given by `--offline`. Raises UsageError if it cannot be used."""
    from pathlib import Path

    path_text = arguments.value("offline")
    if path_text is not None and arguments.flag("rehearse"):
        raise errors.UsageError(
            "`--offline` cannot be combined with `--rehearse`: emulated gateways are not the systems that a bundle "
            "is made for",
            hint="remove one of them; `provision plan` shows what the bundle would supply",
        )
    return Path(path_text).absolute() if path_text is not None else None
