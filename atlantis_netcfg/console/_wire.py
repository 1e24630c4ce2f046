"""What carries the characters: an SSH channel or a serial line."""

from __future__ import annotations

from typing import Protocol

__all__ = ["Wire", "WireLost"]


class WireLost(Exception):
    """The other end is gone."""


class Wire(Protocol):
    """Characters both ways."""

    def read(self, timeout_s: float) -> bytes:
        """Whatever came, at least one byte; empty when nothing came in time. Raises WireLost."""

    def write(self, data: bytes) -> None:
        """Send all of it. Raises WireLost."""

    def close(self) -> None:
        """Hang up; never raises."""
