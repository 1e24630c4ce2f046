"""Ansible's forked task process: it ends with its parent, and cleans up when it is cancelled.

An orphaned child would continue to change devices without supervision, and then block for ever on a queue without
reader (seen with ansible-core 2.19).
"""

from __future__ import annotations

import asyncio
import ctypes
import os
import signal
import threading
from multiprocessing import parent_process
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Coroutine

_PR_SET_PDEATHSIG = 1
"""prctl(2) option: signal for this process when the thread that started it ends.

It may arrive twice: the kernel passes the child of a dying process to each of its remaining threads.
"""
_SETTLE = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

Result = TypeVar("Result")


def end_with_parent() -> None:
    """Request SIGTERM when the parent process dies; does nothing outside a forked child."""
    parent = parent_process()
    if parent is None:
        return
    ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, int(signal.SIGTERM), 0, 0, 0)
    if os.getppid() != parent.pid:  # it has died before the call
        os.kill(os.getpid(), signal.SIGTERM)


def end_if_orphaned() -> None:
    """Exit now if the parent is dead; the journal has the outcome of the devices."""
    parent = parent_process()
    if parent is not None and os.getppid() != parent.pid:
        os._exit(1)


def run_until_settled(work: Coroutine[object, object, Result]) -> Result:
    """Run a coroutine like `asyncio.run`; each SIGINT, SIGTERM or SIGHUP cancels it once.

    At the first cancellation the engine undoes open changes on the devices. At the second it ends, and CancelledError
    is raised here. In a forked child SIGTERM never counts as the second: it means that the parent is dead, and may come
    twice.
    """
    if threading.current_thread() is not threading.main_thread():
        return asyncio.run(work)

    async def interruptible() -> Result:
        loop, task = asyncio.get_running_loop(), asyncio.current_task()
        stops: list[int] = []

        def stop(number: int) -> None:
            if task is not None and not (stops and number == signal.SIGTERM and parent_process() is not None):
                task.cancel()
            stops.append(number)

        for number in _SETTLE:
            if signal.getsignal(number) is not signal.SIG_IGN:
                loop.add_signal_handler(number, stop, number)
        return await work

    try:
        return asyncio.run(interruptible())
    finally:
        if parent_process() is not None:
            signal.signal(signal.SIGINT, signal.SIG_IGN)  # the result has yet to be handed over
