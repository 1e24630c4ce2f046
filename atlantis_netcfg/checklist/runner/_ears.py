"""Who carries questions to their places and brings the answers back."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from atlantis_netcfg.checklist.probes import Answer, Place, Question

Questions = Sequence["tuple[str, Question]"]
"""Questions under keys that are unlike each other: `<item id>#<question name>`."""
OnAnswer = Callable[[str, "Answer"], None]
"""Told of each answer by its key, when it comes."""


class Ears(Protocol):
    """The seam between the checklist and the site: real devices behind one side, twins behind the other."""

    async def ask(self, place: Place, host: str | None, questions: Questions, result: OnAnswer) -> Mapping[str, Answer]:
        """Ask all questions of one place in one turn, and give one answer for each key.

        `host`: the RouterOS device of questions `RouterOsQuery`; None for all others. `result` is called as the answers
        come; whoever gets them all at once need not call it, for what is returned counts. What cannot be asked is an
        answer with a trouble, never an exception.
        """
        ...
