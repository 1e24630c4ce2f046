"""`provision resume`: go on with a run that was killed, or that lost the link before its outcome was known."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.cli._arguments import ACCEPT_COST, INVENTORY, JSON, UNPROTECTED, VERBOSE, Command, Word
from atlantis_netcfg.errors import ExitCode, NothingMatched, UsageError

if TYPE_CHECKING:
    from atlantis_netcfg.cli._arguments import Arguments
    from atlantis_netcfg.cli._session import Session
    from atlantis_netcfg.journal import Run

__all__ = ["COMMAND", "run"]

COMMAND = Command(
    "resume",
    "go on with a run that was interrupted, from what the devices have kept",
    words=(
        Word("site", "the site of the run", required=True, example="coastal"),
        Word("run", "the run, as `provision runs` lists it; the latest unfinished one if left out"),
        INVENTORY,
    ),
    flags=(ACCEPT_COST, UNPROTECTED, JSON, VERBOSE),
    changes=True,
)


def run(arguments: Arguments) -> ExitCode:
    """Wait until the devices have taken back what the broken run left open, then bring them to the declared state."""
    from atlantis_netcfg.cli._session import session
    from atlantis_netcfg.operations import Mode

    with session(arguments) as opened:
        broken = _broken(opened, arguments.optional("run"))
        _engine_only(broken)
        _tell(opened, broken)
        opened.narrow(broken.unsettled)
        if broken.started is not None:
            opened.back_to, opened.restore = broken.started.back_to, broken.started.restore
        report = opened.perform(Mode.RESUME, run=broken.id)
    return opened.close(report)


def _broken(opened: Session, name: str | None) -> Run:
    store = opened.store
    if name is not None:
        return store.run(opened.site, name)
    unfinished = store.unfinished(opened.site)
    if not unfinished:
        raise NothingMatched(f"no run of {opened.site} is unfinished", hint="`provision runs` lists all of them")
    return unfinished[-1]


_REPEATED = {"provision adopt ": "a first contact", "provision upgrade ": "an upgrade"}


def _engine_only(broken: Run) -> None:
    """First contact and upgrades are no runs of the engine: they are repeated, and go on by what the device says."""
    command = broken.started.command if broken.started else ""
    what = next((words for beginning, words in _REPEATED.items() if command.startswith(beginning)), None)
    if what is not None:
        raise UsageError(f"run {broken.id} was {what}", hint=f"repeat it: `{command}`")


def _tell(opened: Session, broken: Run) -> None:
    if opened.as_json:
        return
    print(f"run {broken.id}: {broken.started.command if broken.started else 'killed before it had begun'}")
    for host in broken.unsettled:
        told = f"{len(broken.confirmed(host))} actions were confirmed, {len(broken.acknowledged(host))} acknowledged"
        print(f"  {host:<18} {told}")
    started = broken.started
    if started is not None and (started.back_to or started.restore):
        print(f"  it goes on towards the saved state of run {started.back_to or started.restore}")
    elif started is not None and started.revision != opened.declaration.revision:
        print("  the inventory has changed since then: the devices are brought to what it declares now")
