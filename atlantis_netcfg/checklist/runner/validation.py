"""Looked at before the wire: what a probe asks must be on a closed list, and go where the declaration leads."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from atlantis_netcfg.checklist.probes import DdsDiscoverRequest, DhcpDiscoverRequest, Listen, RouterOsQuery, Run
from atlantis_netcfg.checklist.probes.allowed import allowed, refused
from atlantis_netcfg.checklist.report import Kind

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from atlantis_netcfg.bearers.query import Query
    from atlantis_netcfg.checklist import Entry
    from atlantis_netcfg.checklist.probes import Cell, Question

READING: Final = frozenset({"print", "monitor", "info", "show-capabilities"})
"""Commands of RouterOS' API that change nothing; `monitor` is asked once."""
PINGS: Final = frozenset({"/tool/ping"})
"""This as well, if it says how often; the `/ping` of the root left RouterOS' command tree at 7.23."""
_LONGEST_S: Final = 900.0


def unfit(entry: Entry, questions: Sequence[Question]) -> str | None:
    """Why these questions must not be asked; None: they may."""
    names = [question.name for question in questions]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        return f"two questions are called `{twice}`"
    return next((reason for request in questions if (reason := _unfit(entry, request)) is not None), None)


def _unfit(entry: Entry, question: Question) -> str | None:
    if isinstance(question, Run) and not allowed(question.argv):
        return f"`{' '.join(question.argv)}` is not on the list of reading programs"
    if isinstance(question, RouterOsQuery) and not _reads(question.query):
        return f"`{question.query.path}` is no reading command"
    if isinstance(question, Listen):
        return _elsewhere(entry.cell, question) or refused(question, active=entry.item.kind is Kind.ACTIVE)
    if isinstance(question, DhcpDiscoverRequest | DdsDiscoverRequest) and question.within_s > _LONGEST_S:
        return "it would take too long"
    return _foreign(entry.cell, question) if isinstance(question, DdsDiscoverRequest) else None


def _reads(query: Query) -> bool:
    given = dict(query.arguments)
    if query.path in PINGS:
        return given.get("count", "").isdecimal()
    return query.command in READING and (query.command != "monitor" or "once" in given)


def _elsewhere(cell: Cell, listen: Listen) -> str | None:
    """Nobody's port is opened that the declaration does not name."""
    if listen.transport == "tcp" and listen.address not in {str(address) for address in _addresses(cell)}:
        return f"the address {listen.address or 'that it asks'} is not declared at {cell.site}"
    if listen.transport == "serial" and listen.device not in {
        str(of_endpoint) for of_endpoint in _of_endpoints(cell, "device")
    }:
        return f"the serial port {listen.device} is not declared"
    if listen.transport == "udp" and listen.port not in set(_of_endpoints(cell, "port")):
        return f"the UDP port {listen.port} is not declared"
    return None


def _foreign(cell: Cell, question: DdsDiscoverRequest) -> str | None:
    """Participants are looked for at an address of the asking computer itself, in the declared domain."""
    local = cell.gateway.device if cell.gateway is not None else None
    if question.address not in {str(getattr(local, name, None)) for name in ("address", "vpn_address")}:
        return f"the address {question.address} is not that of the gateway computer of {cell.site}"
    dds = cell.declaration.pilot.dds
    return None if dds is not None and dds.domain == question.domain else "it is not the declared domain of DDS"


def _addresses(cell: Cell) -> Iterator[object]:
    yield from (reservation.address for reservation in cell.declared.lan.reservations)
    yield from _of_endpoints(cell, "address")
    for vehicle in cell.declaration.vehicles:
        place = type(cell)(cell.declaration, cell.site, vehicle, cell.endpoint)
        yield from filter(None, (place.address(None),))
    for host in cell.declaration.site_hosts(cell.site):
        yield getattr(host.device, "address", None)


def _of_endpoints(cell: Cell, field: str) -> Iterator[object]:
    """This field of all endpoints of the row's own site, and of its vehicles."""
    rows = (*(vehicle.endpoints for vehicle in cell.declaration.vehicles.values()), cell.declared.location.endpoints)
    for row in rows:
        for column in type(row).model_fields:
            found = getattr(getattr(row, column), field, None)
            if found is not None:
                yield found
