"""This computer as a place: the program that listens, in a process of its own."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes.agent import BOOT
from atlantis_netcfg.checklist.runner._listener import Listener

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from atlantis_netcfg.checklist.probes import Answer
    from atlantis_netcfg.checklist.runner._ears import OnAnswer, Questions
    from atlantis_netcfg.checklist.runner.remote_process import Carrier

_GRACE_S = 15.0


async def ask_here(questions: Questions, result: OnAnswer, before: Sequence[str] = ()) -> Mapping[str, Answer]:
    """Ask this computer by the program that listens; `before`: words of a program that starts it.

    What cannot be asked answers NO_PLACE.
    """
    return await Listener(questions, result, _GRACE_S).hear(lambda carrier: _here(carrier, before))


def _here(carrier: Carrier, before: Sequence[str]) -> str:
    try:
        ended = carrier.run([*before, sys.executable, "-I", "-c", BOOT])
    except OSError as error:
        return f"the program that listens does not start on this computer: {error}"
    return f"the program that listens has ended on this computer: {last_line(ended.err) or f'exit {ended.rc}'}"


def last_line(data: bytes) -> str:
    """What a program said last."""
    return next((line.strip() for line in reversed(data.decode(errors="replace").splitlines()) if line.strip()), "")
