"""What can only be asked with rows of ours on the router for a moment: TCP by netwatch, the time by a routing rule.

Netwatch's `tcp-conn` opens one connection from the link's own address every ten seconds (Manual, Netwatch; its
`src-address` is there from 7.11). The time client has no source address, so a rule leads its questions into the link's
own table; it is switched off and on so that it asks now. That it does ask then is inferred, and looked at: without a
question in the filter's counter nothing is concluded.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.bearers.satellite import Expected, Outcome, Probe
from atlantis_netcfg.operations.allow_list_test._opening import MARK
from atlantis_netcfg.routeros.api import Command

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Sequence

    from atlantis_netcfg.declaration.model import Bearer
    from atlantis_netcfg.operations.allow_list_test._plan import Task
    from atlantis_netcfg.operations.allow_list_test._reading import Reading
    from atlantis_netcfg.routeros.api import Reply, Session

__all__ = ["RULES", "STATUS", "ask_now", "connected", "outcome", "rows"]

RULES = Command("/routing/rule/print", ((".proplist", ".id"),))
"""The first of them is where ours goes."""
STATUS = Command("/tool/netwatch/print", ((".proplist", "host,port,status"),), (f"?comment={MARK}",))
_INTERVAL, _PATIENCE = "10s", "8s"


def rows(todo: Sequence[Task], bearer: Bearer, rules: Reply, *, active: bool) -> tuple[Command, ...]:
    """What has to be on the router to ask these targets; nothing that it has already moves but the time."""
    return (*_connections(todo, bearer), *(() if active else _ways(todo, bearer, rules)))


def _connections(todo: Sequence[Task], bearer: Bearer) -> Iterator[Command]:
    for task in todo:
        if task.probe is Probe.TCP:
            where = (("host", task.address), ("port", str(task.port)), ("src-address", str(bearer.address)))
            pace = (("interval", _INTERVAL), ("timeout", _PATIENCE), ("thr-tcp-conn-time", _PATIENCE))
            yield Command("/tool/netwatch/add", (("type", "tcp-conn"), ("comment", MARK), *where, *pace))


def _ways(todo: Sequence[Task], bearer: Bearer, rules: Reply) -> Iterator[Command]:
    first = next((("place-before", row[".id"]) for row in rules.checked().rows if ".id" in row), None)
    for task in todo:
        if task.probe is Probe.TIME:
            where = (("dst-address", f"{task.address}/32"), ("table", f"via-{bearer.name}"))
            words = (("action", "lookup-only-in-table"), ("comment", MARK), *where)
            yield Command("/routing/rule/add", (*words, first) if first is not None else words)


async def ask_now(session: Session) -> None:
    """Switch the time client off and on. Raises Refused; safe mode takes back what was half done."""
    for enabled in ("no", "yes"):
        (await session.command(Command("/system/ntp/client/set", (("enabled", enabled),)))).checked()


def connected(todo: Sequence[Task], status: Reply) -> set[Task]:
    """The TCP targets to which a connection came up."""
    up = {(row.get("host"), row.get("port")) for row in status.checked().rows if row.get("status") == "up"}
    return {task for task in todo if task.probe is Probe.TCP and (task.address, str(task.port)) in up}


def outcome(task: Task, answered: Collection[Task], before: Reading, now: Reading, out: str) -> tuple[Outcome, str]:
    """What was seen of one of these targets; `out` is the chain of what goes out."""
    if task in answered:
        return Outcome.ANSWERED, ""
    if task.probe is Probe.TIME and now.questions(out, task) <= before.questions(out, task):
        return Outcome.NOT_TRIED, "the time client did not ask it, although it was switched off and on"
    if task.expected is Expected.REFUSED and now.dropped(out) > before.dropped(out):
        return Outcome.REFUSED_HERE, ""
    return Outcome.SILENT, ""
