"""Data volume of a gateway's requests over a metered link, and the check for consent."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.checklist.probes import (
    AllowListTestRequest,
    DdsDiscoverRequest,
    LinkStatusRequest,
    Listen,
    Place,
    Question,
    ReflectRequest,
    RobotsHeardRequest,
    RouterOsQuery,
    RunProgram,
)
from atlantis_netcfg.checklist.probes.agent import batch, program
from atlantis_netcfg.checklist.runner.robots import listening_preview
from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.links.cost import Preview, preview
from atlantis_netcfg.operations.allow_list_test.site import previews as proof_previews
from atlantis_netcfg.operations.allow_list_test.site import satellite_of
from atlantis_netcfg.operations.common.costs import preview_costs, unpaid
from atlantis_netcfg.operations.common.request import Mode, Request
from atlantis_netcfg.operations.common.session_link import site_link_of
from atlantis_netcfg.operations.common.site_links import link_of
from atlantis_netcfg.operations.computers._access import is_computer

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from atlantis_netcfg.checklist import PlanEntry
    from atlantis_netcfg.checklist.runner.results import Questions
    from atlantis_netcfg.inventory import Inventory
    from atlantis_netcfg.routeros.estimate import LinkMetrics

_SSH: Final = 8_000
"""Bytes of a connection in both directions: handshake, keys, login, TCP framing; measured with OpenSSH 9.2."""
_RATE: Final = {"tcp": 1_500, "udp": 3_000}
"""Bytes per second of a received stream: NMEA at 9600 baud or gpsd; a telemetry link of MAVLink."""
_LEAST: Final = 4_096
"""Bytes of a device's response to a request."""
_REPORT_RATE: Final = 100
"""Bytes per second that a device reports by itself while a script waits for its response: about one USBL fix."""
_RAN: Final = 1_500
"""Bytes that a read-only program prints."""
_PARTICIPANTS: Final = 3_000
"""Bytes of the responses of three DDS participants."""
_MESSAGE: Final = 650
"""Bytes of a message that a computer returns: both directions with IP, UDP and VPN headers, then as JSON."""
_ROUND_TRIPS: Final = 8
_JSON_OVERHEAD: Final = 1.4
"""JSON around received data; the compression of SSH is not counted on."""


def within_budget(questions: Questions) -> Questions:
    """Limit the streams in requests to the announced volume; further data are not transferred."""
    return [
        (key, replace(request, max_bytes=_max_bytes(request)) if isinstance(request, Listen) else request)
        for key, request in questions
    ]


def previews(inventory: Inventory, site: str, entries: Sequence[PlanEntry], request: Request) -> tuple[Preview, ...]:
    """Estimate the cost of these entries on metered links, one preview per link and kind of request.

    It is shown before consent. Raises UsageError for a link that the site does not have.
    """
    probes = [entry.step.probe for entry in entries if entry.step.probe is not None]
    questions = [question for probe in probes for question in probe.asks()]
    all_previews = (
        *_gateway_costs(inventory, site, questions, request),
        *_router_costs(inventory, site, questions, request),
        *_proof_costs(inventory, site, questions, request),
        *_robot_costs(inventory, site, questions),
    )
    return tuple(item for item in all_previews if item.link.is_metered)


def _gateway_costs(
    inventory: Inventory, site: str, questions: Sequence[Question], request: Request
) -> Iterator[Preview]:
    host = inventory.computer_of(site)
    alike = dict.fromkeys(replace(question, name="") for question in questions if question.place is Place.GATEWAY)
    numbered_questions = [(str(number), each) for number, each in enumerate(alike)]  # identical ones are asked once
    if host is not None and numbered_questions:
        carrier = site_link_of(inventory, host, request.via.get(host.name))
        yield estimate(inventory, site, carrier, within_budget(numbered_questions))


def _router_costs(
    inventory: Inventory, site: str, questions: Sequence[Question], request: Request
) -> Iterator[Preview]:
    names = {each.host for each in questions if isinstance(each, RouterOsQuery)}
    hosts = [inventory.hosts[name] for name in sorted(names) if name in inventory.hosts]
    if any(isinstance(question, LinkStatusRequest) for question in questions):
        hosts += [host for host in inventory.site_hosts(site) if host not in hosts]
    reading = request.model_copy(update={"mode": Mode.DRIFT})
    computers = [host for host in hosts if not is_computer(host)]
    yield from preview_costs(inventory, computers, reading, at_most=False)


def _proof_costs(inventory: Inventory, site: str, questions: Sequence[Question], request: Request) -> Iterator[Preview]:
    for name in dict.fromkeys(question.link for question in questions if isinstance(question, AllowListTestRequest)):
        satellite = satellite_of(inventory, site, name)
        via = request.via.get(satellite.router.name)
        yield from proof_previews(inventory, satellite.proving(inventory, is_rehearsal=False, via=via))


def _robot_costs(inventory: Inventory, site: str, questions: Sequence[Question]) -> Iterator[Preview]:
    for question in dict.fromkeys(replace(each, name="") for each in questions if isinstance(each, RobotsHeardRequest)):
        with suppress(NetcfgError):  # who cannot listen pays nothing, and the item says why
            if (cost := listening_preview(inventory, site, question)) is not None:
                yield cost


def estimate(inventory: Inventory, site: str, carrier: LinkMetrics, questions: Questions) -> Preview:
    """Estimate the maximum cost of one turn of requests over a gateway's link."""
    request_batch = batch(questions)
    nbytes = (
        _SSH
        + len(program(request_batch.request))
        + round(_JSON_OVERHEAD * sum(_answer_bytes(request) for _, request in questions))
    )
    seconds = request_batch.within_s + _ROUND_TRIPS * carrier.rtt_s
    return preview(nbytes, seconds, link_of(inventory, site, carrier.name), at_most=True)


def refuse_unpaid(
    inventory: Inventory, site: str, carrier: LinkMetrics, questions: Questions, request: Request
) -> None:
    """Raise CostRefusal without consent, or if the cost exceeds the inventory's limit."""
    cost_preview = estimate(inventory, site, carrier, questions)
    if cost_preview.over_cap:
        raise cost_preview.refusal()
    if not request.accept_cost:
        raise unpaid([cost_preview.words], request.command)


def _max_bytes(listen: Listen) -> int:
    rate = listen.baud / 10 if listen.transport == "serial" else _RATE[listen.transport]
    waits_s = sum(message.within_s for message in listen.say)
    return min(listen.max_bytes, _LEAST + round(rate * listen.listen_s + _REPORT_RATE * waits_s))


def _answer_bytes(question: object) -> int:
    if isinstance(question, Listen):
        return _max_bytes(question)
    if isinstance(question, ReflectRequest):
        return question.count * _MESSAGE
    return (
        _RAN if isinstance(question, RunProgram) else _PARTICIPANTS if isinstance(question, DdsDiscoverRequest) else 500
    )
