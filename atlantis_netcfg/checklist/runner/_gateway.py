"""The gateway computer as a place: one SSH command carries the program that listens, and all questions with it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes.agent import BOOT
from atlantis_netcfg.checklist.runner._laptop import last_line
from atlantis_netcfg.checklist.runner._listener import Listener
from atlantis_netcfg.checklist.runner._way_in import NotReached, way_in
from atlantis_netcfg.checklist.runner.cost import refuse_unpaid, within_budget
from atlantis_netcfg.checklist.runner.no_result import all_unanswered
from atlantis_netcfg.operations.bearers import bearer_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.checklist.probes import Answer
    from atlantis_netcfg.checklist.runner._ears import OnAnswer, Questions
    from atlantis_netcfg.checklist.runner._way_in import WayIn
    from atlantis_netcfg.checklist.runner.remote_process import Carrier
    from atlantis_netcfg.core.errors import NetcfgError
    from atlantis_netcfg.declaration import Declaration, Host
    from atlantis_netcfg.operations.request import Request

_NO_SUCH = 127


async def ask_gateway(  # noqa: PLR0913, PLR0917 - the seam's three, and what the real site adds
    declaration: Declaration,
    host: Host,
    request: Request,
    questions: Questions,
    result: OnAnswer,
    ssh_config: str | None = None,
) -> Mapping[str, Answer]:
    """Ask a gateway by the program that listens; what cannot be asked answers NO_PLACE. Raises CostRefused."""
    try:
        way = way_in(declaration, host, request, ssh_config)
    except NotReached as why:
        return all_unanswered(questions, in_words(why))
    carrier = bearer_of(declaration, host, request.via.get(host.name))
    if carrier.metered and not request.rehearsed:
        questions = within_budget(questions)
        refuse_unpaid(declaration, host.site, carrier, questions, request)
    return await Listener(questions, result, way.connect_s + way.grace_s).hear(lambda item: _there(way, item))


def _there(way: WayIn, carrier: Carrier) -> str:
    try:
        ended = way.run("python3 -I -c %s", BOOT, carrier=carrier)
    except NotReached as why:
        return in_words(why)
    if ended.overdue:
        return f"{way.name} did not answer in time"
    if ended.rc == _NO_SUCH:
        return f"{way.name} has no python3; on it: `apt-get install python3`"
    if way.sudo and b"sudo" in ended.err:
        rule = "`echo '%sudo ALL=(ALL) NOPASSWD: ALL' > /etc/sudoers.d/atlantis`"
        return f"whoever logs in on {way.name} does not become root without a password; on it, as root: {rule}"
    return f"the program that listens has ended on {way.name}: {last_line(ended.err) or f'exit {ended.rc}'}"


def in_words(why: NetcfgError) -> str:
    """What is so, and what to do."""
    return f"{why}; {why.hint}" if why.hint else str(why)
