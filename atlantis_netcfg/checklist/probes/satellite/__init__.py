"""Satellite: what can be seen without sending, what may be sent with consent, and what only a person can see.

A Thales VesseLINK has no documented interface, so none is spoken to. By itself the check reads the router: the port's
link, whether the terminal has answered ARP, what the filter has kept off, what is declared of the terminal; nothing
goes over airtime. The allow-list is proved by `provision prove`, which costs and is asked first; the terminal's own
pages are for a person.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.checklist.probes.bearer_probe import BearerProbe, bearers
from atlantis_netcfg.checklist.probes.satellite._allowed import AllowListProbe
from atlantis_netcfg.checklist.probes.step import Consent, Step
from atlantis_netcfg.checklist.report import Kind, Phase
from atlantis_netcfg.core.verdicts import Verdict
from atlantis_netcfg.declaration.model import BearerKind
from atlantis_netcfg.declaration.satellite_allow_list import allowed

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from atlantis_netcfg.checklist.probes.cell import Cell
    from atlantis_netcfg.declaration.model import AllowedTarget, Bearer

__all__ = ["AllowListProbe", "steps"]


def steps(cell: Cell) -> tuple[Step, ...]:
    """Give the four items of each satellite link of a location, else something for a person."""
    links = bearers(cell, BearerKind.SATELLITE)
    found = (step for number, bearer in enumerate(links) for step in _of_link(cell, bearer, number))
    return tuple(found) or (_by_a_person(cell),)


def _of_link(cell: Cell, bearer: Bearer, number: int) -> Iterator[Step]:
    """Name the items of a second link after it."""
    before = f"{bearer.name}-" if number else ""
    concerns = tuple(item for item in (bearer.device,) if item is not None)
    yield Step(
        name=bearer.name if number else "",
        title=f"Satellite terminal of {cell.name} is there, by what the router sees; nothing is sent",
        kind=Kind.AUTOMATIC,
        phase=Phase.BENCH,
        probe=BearerProbe(bearer.name, _there),
        concerns=concerns,
    )
    yield Step(
        name=f"{before}allow-list",
        title=f"Satellite of {cell.name} lets through what is declared, and nothing else",
        kind=Kind.ACTIVE,
        phase=Phase.QUAY,
        probe=AllowListProbe(bearer.name, cell.site),
        consent=Consent(
            question=f"the terminal of {cell.name} sees the sky, and up to 20 kB may go over its airtime",
            prompt="wait: what is silent is asked for 90 s, because gaps of 70 s are ordinary on this link",
            cost=True,
        ),
        concerns=concerns,
    )
    yield _firewall(cell, bearer, before, concerns)
    yield _terminal(cell, bearer, before, concerns)


def _firewall(cell: Cell, bearer: Bearer, before: str, concerns: tuple[str, ...]) -> Step:
    listed = ", ".join(_target(allowed_target) for allowed_target in allowed(cell.declaration.pilot, bearer))
    return Step(
        name=f"{before}firewall",
        title=f"The terminal's own firewall lets through addresses of ATLANTIS only ({bearer.device})",
        kind=Kind.PERSON,
        phase=Phase.BENCH,
        do=f"Open the pages of {bearer.device} and look at its firewall; attach a screenshot of it.",
        look_for=f"It is on, admits these and nothing else: {listed}. Its password is not the factory's.",
        concerns=concerns,
    )


def _terminal(cell: Cell, bearer: Bearer, before: str, concerns: tuple[str, ...]) -> Step:
    box = cell.declaration.hosts.get(bearer.device or "")
    evidence = getattr(box.device, "evidence", None) if box is not None else None
    firmware = f"the firmware is {evidence.firmware}, as declared" if evidence is not None else "note its firmware"
    return Step(
        name=f"{before}terminal",
        title=f"The terminal's own pages show signal, position and a data session ({bearer.device})",
        kind=Kind.PERSON,
        phase=Phase.QUAY,
        do=f"Open the pages of {bearer.device} under a clear sky; attach a screenshot of its status.",
        look_for=f"It shows a signal, its position and a data session, and no alarm; {firmware}.",
        concerns=concerns,
    )


def _target(target: AllowedTarget) -> str:
    port = "" if target.port is None else f" {target.transport} {target.port}"
    return f"{target.name} ({target.address}{port})"


def _there(values: Mapping[str, Any]) -> Finding | None:
    """Say what of the terminal can be seen from the router; that its ARP entry has aged proves nothing."""
    quality = values.get("quality") or {}
    if quality.get("port_link") != "up":
        return None
    port = quality.get("port") or "its port"
    if quality.get("next_hop_seen") == "yes":
        message = f"port {port} has a link, and the terminal has answered on it; over the air nothing was sent"
        return Finding(Verdict.PASS, "terminal-there", message)
    message = f"port {port} has a link, but the terminal has not answered on it of late"
    hint = "that alone proves nothing: the router asks for it when it sends; the allow-list's item shows more"
    return Finding(Verdict.INCONCLUSIVE, "terminal-not-seen", message, hint)


def _by_a_person(cell: Cell) -> Step:
    return Step(
        name="",
        title=f"Satellite of {cell.name} works",
        kind=Kind.PERSON,
        phase=Phase.QUAY,
        do=f"Open the pages of the satellite terminal of {cell.name} under a clear sky, then send one small message."
        " Each byte may cost.",
        look_for="It shows a signal and a data session, and the message arrives within 90 s: gaps of 70 s happen.",
    )
