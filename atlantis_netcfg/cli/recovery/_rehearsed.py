"""Rehearsals that start from a given state instead of a factory-fresh device."""

from __future__ import annotations

from dataclasses import replace
from textwrap import wrap
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.operations import Mode

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from atlantis_netcfg.cli.base.session import CommandSession
    from atlantis_netcfg.operations.common.saved_states import StartState
    from atlantis_netcfg.runs.report.run import RunReport

_WIDTH = 80


def rehearse_from(
    session: CommandSession, start: Sequence[StartState], go_on: Callable[[], RunReport], what: str
) -> RunReport:
    """Bring the emulated devices to their start state, then continue; the report contains a failure to do so.

    The source of the start state is printed, and its gaps are in the report.
    """
    _print_start_states(session, start)
    gaps = tuple(state.gap for state in start)
    failure = _begin(session, start)
    if failure is not None:
        never = msg(f"{arg(what)}: cannot set the emulated devices to the initial state")
        return replace(failure, not_rehearsed=(never, *gaps, *failure.not_rehearsed))
    report = go_on()
    return replace(report, not_rehearsed=(*gaps, *report.not_rehearsed))


def _begin(session: CommandSession, start: Sequence[StartState]) -> RunReport | None:
    """Apply and verify the start state; return the report of a failure, otherwise None."""
    hosts, back_to, restore = session.hosts, session.back_to, session.restore
    ways = dict.fromkeys((state.back_to, state.restore) for state in start if not state.is_ready)
    try:
        for way in ways:
            names = {state.host for state in start if (state.back_to, state.restore) == way and not state.is_ready}
            session.hosts = tuple(host for host in hosts if host.name in names)
            session.back_to, session.restore = way
            report = session.perform(Mode.APPLY)
            if report.exit is not ExitCode.DONE:
                return report
    finally:
        session.hosts, session.back_to, session.restore = hosts, back_to, restore
    return None


def _print_start_states(session: CommandSession, start: Sequence[StartState]) -> None:
    if session.as_json:
        return
    for state in start:
        text = f"{state.host}: {translate(state.words)}"
        lines = wrap(text, _WIDTH, initial_indent="  ", subsequent_indent="    ", break_on_hyphens=False)
        print("\n".join(lines), flush=True)
