"""What a reader wants to be asked of a RouterOS device, as data: whoever has the session sends it.

Readers are pure, so what they may cause to be sent is this data and nothing else; a test holds every query against
RouterOS' own command trees.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Query"]


@dataclass(frozen=True, slots=True)
class Query:
    """One command of the API that only reads."""

    menu: str
    """In the form of the API: `/interface/wireless`."""
    command: str
    """`print`, `monitor`, `show-capabilities`."""
    arguments: tuple[tuple[str, str], ...] = ()
    proplist: tuple[str, ...] = ()
    """Properties to ask for; empty: all. What must not leave the device (IMEI, IMSI, ICCID) is left out here."""

    @property
    def path(self) -> str:
        """The command word: `/interface/lte/monitor`."""
        return f"{self.menu}/{self.command}"

    @property
    def words(self) -> tuple[tuple[str, str], ...]:
        """The arguments of the sentence, the list of properties among them."""
        wanted = ((".proplist", ",".join(self.proplist)),) if self.proplist else ()
        return (*self.arguments, *wanted)
