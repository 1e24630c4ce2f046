"""One turn of a checklist: everything that is open is asked at once, and judged as it is answered."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING

from atlantis_netcfg.paths import state_dir

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from atlantis_netcfg.checklist import Entry
    from atlantis_netcfg.operations.checking._ears import Ears
    from atlantis_netcfg.report.checklist import Item

__all__ = ["examine", "utc_now"]


def utc_now() -> datetime:
    """The time of an item."""
    return datetime.now(UTC)


async def examine(
    entries: Sequence[Entry],
    ears: Ears,
    settled: Callable[[Item], None],
    *,
    now: Callable[[], datetime] = utc_now,
    state: Callable[[], Path] = state_dir,
) -> tuple[Item, ...]:
    """Ask everything of all entries at once, judge each as soon as its own answers are there, and give the items.

    Entries without a probe come back as they are. To hand over an active entry is to say that a person has consented.
    `settled` is called once an item, in the order in which they are judged; `state` is the folder of the log file in
    which the traceback of a probe that crashes is kept: such an item is ERROR. Nothing is raised.
    """
    raise NotImplementedError
