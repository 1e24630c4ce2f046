"""Acoustic modems of the vehicles, read without disturbing them, and never made to sound in air.

Two drivers (EvoLogics S2C, Blueprint SeaTrac) read from closed lists of commands; whatever transmits is a step of its
own that a person has to agree to, in the water. A modem that its vehicle holds is left to it: that is no failure. What
the columns acoustic and USBL and the comparison of the fleet want to know of one modem is one question, asked once.

How it could be fooled, and what stops it, stands in docs/probes.md.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes.acoustic._fleet import EvologicsFleet, Member, SeatracFleet
from atlantis_netcfg.checklist.probes.acoustic._message import EvologicsMessage, message_consent
from atlantis_netcfg.checklist.probes.acoustic.beacon import SeatracStatus
from atlantis_netcfg.checklist.probes.acoustic.modem import declared_address, modem_of, modems, question
from atlantis_netcfg.checklist.probes.acoustic.status import EvologicsStatus
from atlantis_netcfg.checklist.probes.step import Step
from atlantis_netcfg.checklist.report import Kind, Phase
from atlantis_netcfg.declaration.model import AcousticDriver, Column

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.checklist.probes.acoustic.modem import Modem
    from atlantis_netcfg.checklist.probes.cell import Cell

__all__ = ["steps"]


def steps(cell: Cell) -> tuple[Step, ...]:
    """The modem itself, once a site and driver the fleet, and a message where a partner is declared."""
    modem = modem_of(cell)
    if modem is None:
        return (_by_a_person(cell),)
    return (_status(cell, modem), *_fleet(cell, modem), *_message(cell, modem))


def _status(cell: Cell, modem: Modem) -> Step:
    endpoint = cell.endpoints.acoustic
    declared = endpoint.acoustic_address if endpoint else None
    evologics = modem.driver is AcousticDriver.EVOLOGICS
    kind = EvologicsStatus if evologics else SeatracStatus
    return Step(
        name="",
        title=f"The acoustic modem of {cell.name} listens and has its declared settings",
        kind=Kind.AUTOMATIC,
        phase=Phase.BENCH,
        probe=kind(modem, cell.name, declared, question(cell, modem)),
    )


def _fleet(cell: Cell, modem: Modem) -> Iterator[Step]:
    """Give the comparison of all modems of a driver to the first row that has one."""
    same = [(other, its) for other, its in modems(cell, Column.ACOUSTIC) if its.driver is modem.driver]
    if len({its for _, its in same}) < 2 or same[0][0].vehicle != cell.vehicle:  # noqa: PLR2004 - a comparison
        return
    # Two rows with one modem (the site's own) are one member: it would have its own address twice.
    members: dict[Modem, Member] = {}
    for other, its in same:
        members.setdefault(its, Member(other.name, question(other, its), declared_address(other, its)))
    evologics = modem.driver is AcousticDriver.EVOLOGICS
    who = "EvoLogics modems" if evologics else "SeaTrac beacons"
    yield Step(
        name="fleet",
        title=f"The {who} of {cell.declared.title} agree with each other",
        kind=Kind.AUTOMATIC,
        phase=Phase.BENCH,
        probe=(EvologicsFleet if evologics else SeatracFleet)(tuple(members.values())),
    )


def _message(cell: Cell, modem: Modem) -> Iterator[Step]:
    endpoint = cell.endpoints.acoustic
    if endpoint is None or endpoint.partner is None:
        return
    if modem.driver is not AcousticDriver.EVOLOGICS:
        yield _sent_by_a_person(cell, endpoint.partner)
        return
    consent = message_consent(cell.name, endpoint.partner)
    yield Step(
        name="message",
        title=f"A message of {cell.name} reaches the modem with the acoustic address {endpoint.partner}",
        kind=Kind.ACTIVE,
        phase=Phase.WATER,
        probe=EvologicsMessage(modem, cell.name, endpoint.acoustic_address, endpoint.partner, consent),
        consent=consent,
    )


def _sent_by_a_person(cell: Cell, partner: int) -> Step:
    """A SeaTrac beacon pings (column USBL); this tool sends no data by it."""
    return Step(
        name="message",
        title=f"A message of {cell.name} reaches the beacon {partner}",
        kind=Kind.PERSON,
        phase=Phase.WATER,
        do=f"With both in the water, let the software of {cell.name} send data to the beacon {partner}.",
        look_for="The other vehicle shows what was sent, and the sender the acknowledgement.",
    )


def _by_a_person(cell: Cell) -> Step:
    declared = cell.endpoints.acoustic is not None
    why = "has no address at this site" if declared else "is not declared"
    return Step(
        name="",
        title=f"The acoustic modem of {cell.name} sends and hears",
        kind=Kind.PERSON,
        phase=Phase.WATER,
        do=f"The modem of {cell.name} {why}, so nobody can ask it. In the water, and never in air, let the vehicle's "
        "software send a message to another modem of the test, and one back.",
        look_for="Both are acknowledged; the modem tells no alarm; its acoustic address is its own, and none of the "
        "other vehicles has it.",
    )
