"""Results of probes while they run: progress events, and the result of a request that was not sent.

Progress: each item, when it is settled, as an event.

The answer of a question that was not asked, or of which nothing came back.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes import (
    AllowListTestRequest,
    AllowListTestResult,
    Answer,
    CommandResult,
    DdsDiscoverRequest,
    DdsDiscoverResult,
    DhcpDiscoverRequest,
    DhcpOffers,
    LinkRecordRequest,
    LinkRecordResult,
    LinkStatusRequest,
    LinkStatusResult,
    Listen,
    Question,
    ReflectRequest,
    ReflectResult,
    RobotsHeardRequest,
    RobotsHeardResult,
    RouterAdvertisements,
    RouterOsQuery,
    RouterSolicitRequest,
    Rows,
    RunProgram,
    Transcript,
    Trouble,
    VpnMembersRequest,
    VpnMembersResult,
)
from atlantis_netcfg.core.events import Event, Stage, Subscriber

if TYPE_CHECKING:
    from atlantis_netcfg.checklist.report import Item
    from atlantis_netcfg.core.errors import NetcfgError
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING


def telling(notify: Subscriber, total: int, on_settle: Callable[[Item], None]) -> Callable[[Item], None]:
    """Return an `on_settle` for `examine` that also reports each item: `done_count` of `total`, verdict, message."""
    done_count = 0

    def tell(item: Item) -> None:
        nonlocal done_count
        on_settle(item)
        done_count += 1
        data = {"verdict": item.verdict.value, "seconds": item.seconds}
        notify(Event(item.id, Stage.DONE, f"{item.verdict.value}: {item.message}", done_count, total, data))

    return tell


_ANSWERS: Mapping[type, type[Answer]] = {
    Listen: Transcript,
    RunProgram: CommandResult,
    DhcpDiscoverRequest: DhcpOffers,
    RouterSolicitRequest: RouterAdvertisements,
    DdsDiscoverRequest: DdsDiscoverResult,
    ReflectRequest: ReflectResult,
    RouterOsQuery: Rows,
    LinkRecordRequest: LinkRecordResult,
    LinkStatusRequest: LinkStatusResult,
    AllowListTestRequest: AllowListTestResult,
    RobotsHeardRequest: RobotsHeardResult,
    VpnMembersRequest: VpnMembersResult,
}


def trouble_answer(question: Question, words: str, trouble: Trouble = Trouble.NO_PLACE) -> Answer:
    """The answer of this kind of question that says nothing but its trouble, and why in words."""
    return _ANSWERS[type(question)](trouble, words)


def in_words(why: NetcfgError) -> str:
    """What is so, and what to do."""
    return f"{why}; {why.hint}" if why.hint else str(why)


def all_unanswered(questions: Questions, words: str) -> dict[str, Answer]:
    """The same of many, by their keys, where their place was not reached."""
    return {key: trouble_answer(question, words) for key, question in questions}


Questions = Sequence["tuple[str, Question]"]
"""Questions under keys that are unlike each other: `<item id>#<question name>`."""


OnAnswer = Callable[[str, "Answer"], None]
"""Told of each answer by its key, when it comes."""
