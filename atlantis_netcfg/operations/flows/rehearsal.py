"""The flows of a rehearsal: packets through the rows that the emulated routers have after the run."""

from __future__ import annotations

import itertools
from collections import defaultdict
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

from pydantic import TypeAdapter

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.emulator import lab
from atlantis_netcfg.emulator.lab import hosts as machines
from atlantis_netcfg.emulator.routeros.dataplane.namespace import RouterNamespace
from atlantis_netcfg.emulator.routeros.dataplane.rows import NetworkState
from atlantis_netcfg.inventory import model
from atlantis_netcfg.operations.flows import matrix

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from atlantis_netcfg.emulator.routeros import SpawnedSite
    from atlantis_netcfg.inventory import Host, Inventory

_STATES = TypeAdapter(NetworkState)
_AT_ONCE = 4
"""Links whose flows are tried at the same time: most of it is waiting for packets that must not come."""
_MOST = 20
"""Differences in the result of a router; more have the same cause."""


def routers_of(hosts: Iterable[Host]) -> list[Host]:
    """Return the hosts that are routers of sites."""
    return [host for host in hosts if isinstance(host.device, model.Router)]


def try_flows(inventory: Inventory, routers: Sequence[Host], emulators: SpawnedSite) -> dict[str, dict[str, Any]]:
    """Return by router what became of its flows, as fields of its result. Raises MachineError."""
    states = {host.name: _STATES.validate_python(emulators.do(host.name, "network")) for host in routers}
    tries: dict[str, list[Future[matrix.MatrixResult]]] = defaultdict(list)
    numbers = itertools.count()
    with lab.reserve_name() as name, ThreadPoolExecutor(_AT_ONCE) as pool:
        for host in routers:
            for link in inventory.sites[host.site].bearers:
                place = f"{name}-{next(numbers)}"
                tries[host.name].append(pool.submit(_try_link, inventory, host, link, place, states[host.name]))
    return {
        host.name: _fields([each.result() for each in tries[host.name]], states[host.name].limits) for host in routers
    }


def limits(results: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return the rows of each router that its packets did not meet, because Linux cannot stand for them."""
    return [
        msg(f"packets: {arg(name)} without {arg(row)}")
        for name, result in results.items()
        for row in result["flows"]["not_rehearsed"]
    ]


def _try_link(
    inventory: Inventory, host: Host, link: model.Link, namespace: str, state: NetworkState
) -> matrix.MatrixResult:
    """Try the flows while a link is in use, in a namespace of its own: it remembers no connection of another one."""
    machines.add_namespace(namespace)
    try:
        return matrix.try_flows(inventory, host, link, RouterNamespace(namespace), state)
    finally:
        machines.delete_namespace(namespace)


def _fields(results: Sequence[matrix.MatrixResult], rows: Sequence[str]) -> dict[str, Any]:
    differences = [(result.link, difference) for result in results for difference in result.differences]
    total = sum(result.flows for result in results)
    flows: dict[str, Any] = {
        "tried": total,
        "arrived": sum(result.arrivals for result in results),
        "links": [result.link for result in results],
        "differences": [msg(f"{arg(link)}: {arg(describe(difference))}") for link, difference in differences[:_MOST]],
        "not_rehearsed": list(rows),
    }
    if not differences:
        return {"flows": {**flows, "words": _success_words(results)}}
    link, first = differences[0]
    words = msg(
        f"{arg(len(differences))} of {arg(total)} flows do not do what the inventory intends; over {arg(link)}: "
        f"{arg(describe(first))}"
    )
    hint = "the device was configured, but its rows let through something else: report this before you use them"
    return {"flows": flows, "exit": ExitCode.FAILED, "status": "unknown", "message": words, "hint": hint}


def _success_words(results: Sequence[matrix.MatrixResult]) -> str:
    total, count = sum(result.flows for result in results), sum(result.arrivals for result in results)
    return msg(
        f"{arg(total)} flows over {arg(len(results))} link{'s' if len(results) != 1 else ''} tried with packets: "
        f"{arg(count)} pass, all others are dropped, as the inventory intends"
    )


def describe(difference: matrix.FlowDifference) -> str:
    """Return what a flow did, and what it should have done."""
    flow = msg(f"the reply to {arg(difference.flow)}" if difference.is_reply else f"{arg(difference.flow)}")
    actual = join(", ", difference.actual)
    if difference.intention is None:
        return msg(f"{arg(flow)}: arrives at {arg(actual)}, but has to be dropped")
    if not difference.actual:
        return msg(f"{arg(flow)}: dropped, but has to arrive at {arg(difference.intention)}")
    return msg(f"{arg(flow)}: arrives at {arg(actual)} instead of {arg(difference.intention)}")
