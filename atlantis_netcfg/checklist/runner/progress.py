"""Progress: each item, when it is settled, as an event."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.core.events import Event, Stage

if TYPE_CHECKING:
    from collections.abc import Callable

    from atlantis_netcfg.checklist.report import Item
    from atlantis_netcfg.core.events import Subscriber


def telling(notify: Subscriber, total: int, settled: Callable[[Item], None]) -> Callable[[Item], None]:
    """Give a `settled` for `examine` that also tells of each item: `done` of `total`, its verdict and its words."""
    done = 0

    def tell(item: Item) -> None:
        nonlocal done
        settled(item)
        done += 1
        data = {"verdict": item.verdict.value, "seconds": item.seconds}
        notify(Event(item.id, Stage.DONE, f"{item.verdict.value}: {item.message}", done, total, data))

    return tell
