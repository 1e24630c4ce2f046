"""The answer of a question that was not asked, or of which nothing came back."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes import (
    AllowListTestRequest,
    AllowListTestResult,
    CommandResult,
    DdsDiscoverRequest,
    DdsDiscoverResult,
    DhcpDiscoverRequest,
    DhcpOffers,
    LinkStatusRequest,
    LinkStatusResult,
    Listen,
    RouterOsQuery,
    Rows,
    Run,
    Transcript,
    Trouble,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.checklist.probes import Answer, Question
    from atlantis_netcfg.checklist.runner._ears import Questions

_ANSWERS: Mapping[type, type[Answer]] = {
    Listen: Transcript,
    Run: CommandResult,
    DhcpDiscoverRequest: DhcpOffers,
    DdsDiscoverRequest: DdsDiscoverResult,
    RouterOsQuery: Rows,
    LinkStatusRequest: LinkStatusResult,
    AllowListTestRequest: AllowListTestResult,
}


def unanswered(question: Question, words: str, trouble: Trouble = Trouble.NO_PLACE) -> Answer:
    """The answer of this kind of question that says nothing but its trouble, and why in words."""
    return _ANSWERS[type(question)](trouble, words)


def all_unanswered(questions: Questions, words: str) -> dict[str, Answer]:
    """The same of many, by their keys, where their place was not reached."""
    return {key: unanswered(question, words) for key, question in questions}
