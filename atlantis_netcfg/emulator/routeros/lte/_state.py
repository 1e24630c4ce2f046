"""What the card remembers, and what the modem has made of it since it was switched on."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["SimState"]


@dataclass(slots=True)
class SimState:
    """The card keeps `tries_left` without power; everything else begins anew with the modem."""

    tries_left: int
    pins_entered: int = 0
    """How often a PIN has reached the card since the twin was made: what a test counts."""
    unlocked: bool = False
    refused: bool = False
    """The latest PIN was wrong."""
    tried: str | None = None
    """The PIN that the modem has entered since it was started, or since another one was set."""
    connected_since: float | None = None
    told: str = ""
    """The last line of the log about the card, so that each is written once."""

    def enter(self, given: str, right: str) -> None:
        """Let the modem enter a PIN: the card counts wrong ones, and a right one resets the count."""
        self.tried = given
        if self.unlocked or self.tries_left == 0:
            return
        self.pins_entered += 1
        self.unlocked = given == right
        self.refused = not self.unlocked
        self.tries_left = 3 if self.unlocked else self.tries_left - 1

    def swap(self, tries_left: int) -> None:
        """Another card is put in, or the same one with its count as it is."""
        self.tries_left = tries_left
        self.told = ""
        self.restart()

    def restart(self) -> None:
        """The modem starts anew: the card is locked again if it has a PIN."""
        self.unlocked = self.refused = False
        self.tried = None
        self.connected_since = None
