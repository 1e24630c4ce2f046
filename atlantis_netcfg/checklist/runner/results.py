"""Results of probes while they run: progress events, and the result of a request that was not sent.

Progress: an event for each item when it is settled.

Also the result of a request that was not sent, or got no response.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist import probes
from atlantis_netcfg.core.messages import arg, msg

if TYPE_CHECKING:
    from atlantis_netcfg.core.errors import NetcfgError


_ANSWERS: Mapping[type, type[probes.Answer]] = {
    probes.Listen: probes.Transcript,
    probes.RunProgram: probes.CommandResult,
    probes.DhcpDiscoverRequest: probes.DhcpOffers,
    probes.RouterSolicitRequest: probes.RouterAdvertisements,
    probes.DdsDiscoverRequest: probes.DdsDiscoverResult,
    probes.ReflectRequest: probes.ReflectResult,
    probes.RouterOsQuery: probes.Rows,
    probes.LinkRecordRequest: probes.LinkRecordResult,
    probes.LinkStatusRequest: probes.LinkStatusResult,
    probes.AllowListTestRequest: probes.AllowListTestResult,
    probes.RobotsHeardRequest: probes.RobotsHeardResult,
    probes.VpnMembersRequest: probes.VpnMembersResult,
}


def trouble_answer(
    question: probes.Question, words: str, trouble: probes.Trouble = probes.Trouble.NO_PLACE
) -> probes.Answer:
    """Return a result of the request's type that contains only its trouble and the reason."""
    return _ANSWERS[type(question)](trouble, words)


def in_words(why: NetcfgError) -> str:
    """Format an error and its hint."""
    return msg(f"{arg(why)}; {arg(why.hint)}") if why.hint else str(why)


def all_unanswered(questions: Questions, words: str) -> dict[str, probes.Answer]:
    """Return the same result for all requests, by key, when their place was not reached."""
    return {key: trouble_answer(question, words) for key, question in questions}


Questions = Sequence["tuple[str, probes.Question]"]
"""Requests with unique keys: `<item id>#<question name>`."""


OnAnswer = Callable[[str, "probes.Answer"], None]
"""Called with the key and the response, for each response that arrives."""
