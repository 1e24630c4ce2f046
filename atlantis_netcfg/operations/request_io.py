"""How a play is asked and answered: its request, the line back to whoever typed, and errors in their own words."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.core.crash_report import crashed
from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.declaration import load
from atlantis_netcfg.operations.event_stream import Channel
from atlantis_netcfg.operations.request import Mode, Request

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

    from atlantis_netcfg.declaration import Declaration

__all__ = ["asked_for", "declaration_of", "shared"]

_shared: dict[Path, Declaration] = {}


@contextmanager
def shared(declaration: Declaration) -> Iterator[None]:
    """Let the tasks of this process, and those that it forks, take this declaration instead of reading it again."""
    folder = declaration.root.absolute()
    _shared[folder] = declaration
    try:
        yield
    finally:
        del _shared[folder]


def declaration_of(inventory: Path, decrypt: Callable[[str], str] | None = None) -> Declaration:
    """The declaration in a folder: the shared one, or as it is read now. Raises what `site.load` raises."""
    return _shared.get(inventory.absolute()) or load(inventory, decrypt=decrypt)


@contextmanager
def asked_for(request: Mapping[str, Any] | None, *, plan_only: bool) -> Iterator[tuple[Request, Channel]]:
    """Give the request and its channel; what is raised within is told there, a fault of ours after it is in a log."""
    asked = Request.model_validate(request or {})
    if plan_only and not asked.mode.reads_only:
        asked = asked.model_copy(update={"mode": Mode.PLAN})
    channel = Channel(asked.events_fd)
    try:
        yield asked, channel
    except NetcfgError as error:
        channel.error(error)
        raise
    except Exception as fault:
        problem = crashed(fault, asked.command, lambda: asked.state)
        channel.error(problem)
        raise problem from fault
