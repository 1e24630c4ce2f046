"""The twins of a site in a process, like `python -m atlantis_netcfg.emulator.routeros`, but hours can pass in a moment.

One command more: `{"twin": ..., "do": "skip", "seconds": 600}` lets so much time pass for all twins of the site: what a
device does by itself after minutes (safe mode of a dead session, a job of its scheduler, a reboot) is done then.
"""

import asyncio
import sys
from pathlib import Path

from atlantis_netcfg.emulator.routeros import EmulatedRouter, SiteSpec
from atlantis_netcfg.emulator.routeros.__main__ import _serve
from atlantis_netcfg.emulator.routeros.control import COMMANDS

_STEP_S = 10.0
"""So much passes at least between two looks at what is due."""


class SkippingLoop(asyncio.SelectorEventLoop):
    """A clock that can be put forward; nothing that is due is left out."""

    skipped_s = 0.0

    @property
    def timers(self) -> list[asyncio.TimerHandle]:
        """What is due one day."""
        return list(self._scheduled)  # type: ignore[attr-defined]  # asyncio keeps it to itself

    def time(self) -> float:
        return super().time() + self.skipped_s


async def _skip(_router: EmulatedRouter, seconds: float) -> None:
    """Go from one thing that is due to the next, so that what follows from each other happens in its order."""
    loop = asyncio.get_running_loop()
    assert isinstance(loop, SkippingLoop)
    until = loop.time() + seconds
    while (now := loop.time()) < until:
        due = min((timer.when() for timer in loop.timers if not timer.cancelled()), default=until)
        loop.skipped_s += min(max(due - now, _STEP_S), until - now)
        for _ in range(3):
            await asyncio.sleep(0)


def main() -> int:
    """Serve the site of the file that is named, with its flash beside it."""
    file = Path(sys.argv[1])
    spec = SiteSpec.model_validate_json(file.read_bytes())
    COMMANDS["skip"] = _skip
    with asyncio.Runner(loop_factory=SkippingLoop) as runner:
        return runner.run(_serve(spec, file.parent, None))


if __name__ == "__main__":
    sys.exit(main())
