"""The line from the engine to whoever asked: JSON lines on a file descriptor, silent when nobody listens."""

from __future__ import annotations

import json
import os
from contextlib import suppress
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.core.errors import NetcfgError
    from atlantis_netcfg.core.events import Event

__all__ = ["Channel"]


class Channel:
    """Writes whole lines; a listener that has gone away does not stop a run, since the journal holds everything."""

    def __init__(self, descriptor: int | None) -> None:
        self._descriptor = descriptor

    def event(self, event: Event) -> None:
        """Tell what happened to a device."""
        self._send({"event": asdict(event)})

    def outcome(self, devices: Mapping[str, Mapping[str, Any]], runs: Mapping[str, Mapping[str, str]]) -> None:
        """Tell how devices ended; `runs`: site to kind of device (each has runs of its own) to run id."""
        self._send({"devices": devices, "runs": runs})

    def error(self, error: NetcfgError) -> None:
        """Tell why the request as a whole was refused."""
        self._send({"error": {"message": str(error), "hint": error.hint, "exit": int(error.exit)}})

    def _send(self, data: Mapping[str, Any]) -> None:
        if self._descriptor is None:
            return
        line = json.dumps(data, ensure_ascii=False) + "\n"  # bytes that are no text arrive as `?`
        rest = memoryview(line.encode(errors="replace"))
        with suppress(BrokenPipeError):
            while rest:
                rest = rest[os.write(self._descriptor, rest) :]
