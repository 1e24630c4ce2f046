"""A task in a forked child settles when it is told to, however often the kernel says that its parent is dead."""

import asyncio
import multiprocessing
import os
import signal
from collections.abc import Callable
from pathlib import Path

import pytest
from waiting import HANG_S

from atlantis_netcfg.core.processes.worker import run_until_settled

_FORK = multiprocessing.get_context("fork")


def settle_slowly(ready: Callable[[], None], settled: Callable[[], None]) -> None:
    """Wait for a stop, and then take a while, like a device that is asked to take back a change."""

    async def work() -> None:
        try:
            ready()
            await asyncio.sleep(60)
        except asyncio.CancelledError:
            await asyncio.sleep(0.3)
            settled()

    run_until_settled(work())


@pytest.mark.parametrize(
    ("numbers", "settles"),
    [
        ((signal.SIGTERM,), True),
        ((signal.SIGTERM, signal.SIGTERM), True),
        ((signal.SIGINT, signal.SIGTERM), True),
        ((signal.SIGTERM, signal.SIGINT), False),
        ((signal.SIGINT, signal.SIGINT), False),
    ],
    ids=lambda value: "-".join(number.name for number in value) if isinstance(value, tuple) else "",
)
def test_cleanup_survives_sigterm_but_not_a_later_sigint(
    tmp_path: Path,
    numbers: tuple[signal.Signals, ...],
    settles: bool,  # noqa: FBT001 - a column of the table above
) -> None:
    ready, settled = tmp_path / "ready", tmp_path / "settled"
    task = _FORK.Process(target=settle_slowly, args=(ready.touch, settled.touch))
    task.start()
    assert task.pid is not None
    while not ready.exists():
        task.join(0.01)
    for number in numbers:
        os.kill(task.pid, number)
        task.join(0.1)  # two signals at once are one
    task.join(HANG_S)
    assert settled.exists() is settles
    assert (task.exitcode == 0) is settles
