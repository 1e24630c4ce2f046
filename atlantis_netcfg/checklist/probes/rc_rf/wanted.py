"""What is expected of a stream, and how it is called in sentences."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Wanted"]


@dataclass(frozen=True, slots=True)
class Wanted:
    """Of one vehicle."""

    name: str
    """`Stork`."""
    place: str
    """Who listens: `coastal-gateway`, `this computer`."""
    port: int
    system_id: int = 1
    rssi_low: int | None = None
    address: str | None = None
    """Where its stream comes from; None: nobody has declared it."""

    @property
    def end(self) -> str:
        """Where the stream arrives."""
        return f"UDP port {self.port} of {self.place}"
