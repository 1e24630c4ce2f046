"""Robots as the real site has them: who is heard by this computer or another one, and who is in the VPN."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes import (
    Answer,
    Question,
    RobotsHeardRequest,
    RobotsHeardResult,
    Trouble,
    VpnMember,
    VpnMembersResult,
)
from atlantis_netcfg.checklist.runner.results import OnAnswer, Questions, in_words, unanswered
from atlantis_netcfg.core.errors import NetcfgError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.declaration import Declaration
    from atlantis_netcfg.operations.request import Request


async def ask_robots(
    declaration: Declaration, site: str, request: Request, questions: Questions, result: OnAnswer
) -> Mapping[str, Answer]:
    """Ask everything at once; what cannot be asked answers NO_PLACE, with the reason."""

    async def ask(key: str, question: Question) -> tuple[str, Answer]:
        try:
            answer = await _answer(declaration, site, request, question)
        except NetcfgError as why:
            answer = unanswered(question, in_words(why))
        result(key, answer)
        return key, answer

    return dict(await asyncio.gather(*(ask(key, question) for key, question in questions)))


async def _answer(declaration: Declaration, site: str, request: Request, question: Question) -> Answer:
    if not isinstance(question, RobotsHeardRequest):
        return await asyncio.to_thread(vpn_members, declaration, request)
    if question.host:
        return _heard_there(question)
    from atlantis_netcfg.operations.robots import hear  # noqa: PLC0415 - few checklists ask for it

    return RobotsHeardResult(None, "", await hear(declaration, site, question.seconds))


def _heard_there(question: RobotsHeardRequest) -> Answer:
    """What another computer of the pilot hears; nothing listens there yet."""
    return unanswered(question, f"this version cannot listen at {question.host}")


def vpn_members(declaration: Declaration, request: Request) -> VpnMembersResult:
    """The robots of the VPN's record, and which of them the server has a session of now.

    Raises NetcfgError where this computer has no record, and where the server is not reached.
    """
    from atlantis_netcfg.operations.vpn.server import over_ssh  # noqa: PLC0415 - as above
    from atlantis_netcfg.operations.vpn.server_state import observe  # noqa: PLC0415 - as above
    from atlantis_netcfg.vpn.authority.authority import Authority  # noqa: PLC0415 - as above

    opener = over_ssh(declaration, request)
    members = Authority.open(request.vpn).membership().members.values()
    link = opener()
    try:
        state = observe(link)
    finally:
        link.close()
    if not state.is_live:
        return VpnMembersResult(Trouble.SILENT, state.why)
    up = {session.common_name: session.real for session in state.sessions if session.is_up}
    return VpnMembersResult(
        None,
        "",
        tuple(
            VpnMember(
                member.name,
                member.vehicle,
                bool(member.good),
                next((up[each.common_name] for each in member.good if each.common_name in up), ""),
            )
            for member in members
            if member.vehicle is not None
        ),
    )
