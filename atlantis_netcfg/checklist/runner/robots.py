"""Robots at the real site: those detected by this computer or another one, and those in the VPN."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist import probes
from atlantis_netcfg.checklist.runner import results
from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.operations.common.costs import unpaid

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.inventory import Inventory
    from atlantis_netcfg.links.cost import Preview
    from atlantis_netcfg.operations.common.request import Request


async def ask_robots(
    inventory: Inventory, site: str, request: Request, questions: results.Questions, result: results.OnAnswer
) -> Mapping[str, probes.Answer]:
    """Run all requests at once; one that cannot be run gets NO_PLACE, with the reason."""

    async def ask(key: str, question: probes.Question) -> tuple[str, probes.Answer]:
        try:
            answer = await _answer(inventory, site, request, question)
        except NetcfgError as why:
            answer = results.trouble_answer(question, results.in_words(why))
        result(key, answer)
        return key, answer

    return dict(await asyncio.gather(*(ask(key, question) for key, question in questions)))


async def _answer(inventory: Inventory, site: str, request: Request, question: probes.Question) -> probes.Answer:
    if not isinstance(question, probes.RobotsHeardRequest):
        return await asyncio.to_thread(vpn_members, inventory, request)
    from atlantis_netcfg.operations.robots import hear  # noqa: PLC0415 - few checklists ask for it
    from atlantis_netcfg.operations.robots.remote import listen_there  # noqa: PLC0415 - as above

    cost = await asyncio.to_thread(listening_preview, inventory, site, question)
    if cost is not None and cost.over_cap:
        raise cost.refusal()
    if cost is not None and not request.accept_cost:
        raise unpaid([cost.words], request.command)
    if not question.host:
        return probes.RobotsHeardResult(None, "", await hear(inventory, site, question.seconds))
    host, seconds = inventory.hosts[question.host], question.seconds
    listening = asyncio.to_thread(listen_there, inventory, host, seconds, sites=[site], request=request)
    return probes.RobotsHeardResult(None, "", await listening)


def listening_preview(inventory: Inventory, site: str, question: probes.RobotsHeardRequest) -> Preview | None:
    """Estimate the cost of listening if all links of the site are metered; None if it costs nothing.

    Raises NetcfgError if the listening address is unknown.
    """
    from atlantis_netcfg.operations.robots import dds_of, listening_address  # noqa: PLC0415 - as above
    from atlantis_netcfg.operations.robots.listening_cost import listening_cost  # noqa: PLC0415 - as above
    from atlantis_netcfg.operations.robots.remote import listening_computer  # noqa: PLC0415 - as above

    def address() -> str:
        if not question.host:
            return listening_address(inventory, site, None)
        return dds_of(inventory).address_of(listening_computer(inventory, inventory.hosts[question.host]))

    return listening_cost(inventory, site, question.seconds, address)


def vpn_members(inventory: Inventory, request: Request) -> probes.VpnMembersResult:
    """Return the robots in the VPN's record, and whether the server has a session of each now.

    Raises NetcfgError if this computer has no record, or if the server is not reached.
    """
    from atlantis_netcfg.operations.vpn.server import over_ssh  # noqa: PLC0415 - as above
    from atlantis_netcfg.operations.vpn.server_state import observe  # noqa: PLC0415 - as above
    from atlantis_netcfg.vpn.authority.authority import Authority  # noqa: PLC0415 - as above

    opener = over_ssh(inventory, request)
    members = Authority.open(request.vpn).membership().members.values()
    link = opener()
    try:
        state = observe(link)
    finally:
        link.close()
    if not state.is_live:
        return probes.VpnMembersResult(probes.Trouble.SILENT, state.why)
    up = {session.common_name: session.real for session in state.sessions if session.is_up}
    return probes.VpnMembersResult(
        None,
        "",
        tuple(
            probes.VpnMember(
                member.name,
                member.vehicle,
                bool(member.good),
                next((up[each.common_name] for each in member.good if each.common_name in up), ""),
            )
            for member in members
            if member.vehicle is not None
        ),
    )
