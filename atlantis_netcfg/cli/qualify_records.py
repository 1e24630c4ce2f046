"""Commands for stored measurements: `measure show`, `measure compare` and `measure history`.

Nothing is measured, and no device is contacted: they read the results of `provision measure link` in the state folder.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from atlantis_netcfg.cli.base import syntax
from atlantis_netcfg.cli.base.output import json_text
from atlantis_netcfg.core.messages import arg, join, msg

if TYPE_CHECKING:
    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.links.qualify.record import QualifyRecord
    from atlantis_netcfg.runs import Store

_SITE = syntax.Word("site", "the site", is_required=True, example="coastal")
_REHEARSAL_FLAG = syntax.Flag("rehearse", "use rehearsed measurements instead of real ones")
_THRESHOLDS = syntax.Flag("thresholds", "evaluate against other thresholds", takes="NAME")
_RUN = "satellite-20261120T093000Z"

QUALIFY_SHOW = syntax.CommandSpec(
    "measure show",
    "show a measurement of a link",
    words=(
        _SITE,
        syntax.Word("run", "which checklist (default: the newest)", example=_RUN),
        syntax.Word("link", "the newest measurement of this link", example="satellite"),
    ),
    flags=(_REHEARSAL_FLAG, _THRESHOLDS, syntax.JSON),
    details=(
        "Exit code 0: every criterion passed, and the traffic used the intended link; 6: a criterion failed or is "
        "not proved; 7: no such measurement."
    ),
)
QUALIFY_COMPARE = syntax.CommandSpec(
    "measure compare",
    "compare two measurements of links",
    words=(
        _SITE,
        syntax.Word(
            "run", "two measurements, the earlier one first", is_required=True, many=True, example=f"{_RUN},{_RUN}"
        ),
    ),
    flags=(_REHEARSAL_FLAG, syntax.JSON),
    details="Differences of up to 5 % are ignored. Exit code 7: no such measurement.",
)
QUALIFY_HISTORY = syntax.CommandSpec(
    "measure history",
    "list the measurements of a site's links",
    words=(_SITE, syntax.Word("link", "only this link", example="satellite")),
    flags=(_REHEARSAL_FLAG, syntax.JSON),
    details="Exit code 7: no measurement found.",
)


def run_qualify_show(arguments: syntax.Arguments) -> ExitCode:
    """Print the figures of one run."""
    import sys

    from atlantis_netcfg.core.errors import ExitCode, UsageError
    from atlantis_netcfg.core.events import Verdict
    from atlantis_netcfg.core.printable import show
    from atlantis_netcfg.links.qualify.archive import find_run, record_of, stored_runs
    from atlantis_netcfg.links.qualify.judgement import profile
    from atlantis_netcfg.records.qualify.pages import rows

    site, run, link = arguments.word("site"), arguments.optional("run"), arguments.optional("link")
    if run is not None and link is not None:
        raise UsageError("`run=` and `link=` cannot be used together", hint="remove one of them")
    name = arguments.value("thresholds")
    thresholds = None if name is None else (name, profile(name))
    store = _store(arguments)
    saved_run = find_run(store, site, run) if run is not None else next(reversed(stored_runs(store, site, link)), None)
    if saved_run is None:
        raise _nothing(arguments)
    record = record_of(saved_run, thresholds)
    code = ExitCode.DONE if record.verdict is Verdict.PASS else ExitCode.CHECKS_FAILED
    if arguments.flag("json"):
        values = {
            "exit": int(code),
            "errors": [],
            "folder": str(saved_run.folder),
            "record": record.model_dump(mode="json"),
        }
        print(json_text(values))
    else:
        show(rows(record, str(saved_run.folder)), sys.stdout)
    return code


def run_qualify_compare(arguments: syntax.Arguments) -> ExitCode:
    """Print two runs beside each other."""
    import sys
    from dataclasses import asdict

    from atlantis_netcfg.core.errors import ExitCode, UsageError
    from atlantis_netcfg.core.printable import show
    from atlantis_netcfg.links.qualify.archive import find_run, record_of
    from atlantis_netcfg.links.qualify.compare import compare_runs
    from atlantis_netcfg.records.qualify.several import comparison_rows

    site, runs, store = arguments.word("site"), arguments.many("run"), _store(arguments)
    if len(runs) != 2:  # noqa: PLR2004 - A and B
        more = " --rehearse" if store.is_rehearsal else ""
        hint = msg(
            f"give two measurements from `provision measure history site={arg(site)}{arg(more)}`, for example `run=A,B`"
        )
        raise UsageError(f"exactly two measurements are needed, not {arg(len(runs))}", hint=hint)
    first, second = (record_of(find_run(store, site, run)) for run in runs)
    comparison = compare_runs(first, second)
    if arguments.flag("json"):
        values = {"exit": int(ExitCode.DONE), "errors": [], "site": site, "runs": list(runs), **asdict(comparison)}
        print(json_text(values))
    else:
        show(comparison_rows(first, second, comparison), sys.stdout)
    return ExitCode.DONE


def run_qualify_history(arguments: syntax.Arguments) -> ExitCode:
    """Print the main results of every run."""
    import sys

    from atlantis_netcfg.core.errors import ExitCode
    from atlantis_netcfg.core.printable import show
    from atlantis_netcfg.links.qualify.archive import record_of, stored_runs
    from atlantis_netcfg.records.qualify.several import history_rows

    site = arguments.word("site")
    saved_runs = stored_runs(_store(arguments), site, arguments.optional("link"))
    if not saved_runs:
        raise _nothing(arguments)
    records = [record_of(item) for item in saved_runs]
    if arguments.flag("json"):
        runs = [
            {**_headlines(record), "folder": str(item.folder)} for record, item in zip(records, saved_runs, strict=True)
        ]
        print(json_text({"exit": int(ExitCode.DONE), "errors": [], "site": site, "runs": runs}))
    else:
        show(history_rows(records), sys.stdout)
    return ExitCode.DONE


def _headlines(record: QualifyRecord) -> dict[str, Any]:
    from atlantis_netcfg.links.qualify.compare import HEADLINES

    run = record.run
    return {
        "run": run.id,
        "link": run.link,
        "begun": run.begun.isoformat(),
        "emulated": run.emulated,
        "over_vpn": run.far_end.over_vpn,
        "reason": run.reason,
        "verdict": record.verdict.value,
        "thresholds": record.thresholds_name,
        "wire_bytes": record.wire_bytes,
        "figures": {item.key: item.value(record) for item in HEADLINES},
    }


def _store(arguments: syntax.Arguments) -> Store:
    from atlantis_netcfg.core import paths
    from atlantis_netcfg.runs import Store

    return Store(paths.state_dir(), is_rehearsal=arguments.flag("rehearse"))


def _nothing(arguments: syntax.Arguments) -> Exception:
    """There is no measurement; those of the other kind are named where there are any."""
    from atlantis_netcfg.core import paths
    from atlantis_netcfg.core.errors import NoMatchError
    from atlantis_netcfg.links.qualify.archive import stored_runs
    from atlantis_netcfg.runs import Store

    site, link, is_rehearsal = arguments.word("site"), arguments.optional("link"), arguments.flag("rehearse")
    links = sorted({item.run.link for item in stored_runs(Store(paths.state_dir(), is_rehearsal=is_rehearsal), site)})
    others = stored_runs(Store(paths.state_dir(), is_rehearsal=not is_rehearsal), site, link)
    if links:
        hint = msg(f"links with measurements: {arg(join(', ', links))}")
    elif others:
        hint = (
            "real measurements exist: remove `--rehearse`"
            if is_rehearsal
            else "`--rehearse` shows rehearsed measurements"
        )
    else:
        hint = msg(f"`provision measure link site={arg(site)}` makes one")
    over = msg("" if link is None else f" of link `{arg(link)}`")
    return NoMatchError(
        f"`{arg(site)}` has no {'rehearsed' if is_rehearsal else 'real'} measurement{arg(over)}", hint=hint
    )
