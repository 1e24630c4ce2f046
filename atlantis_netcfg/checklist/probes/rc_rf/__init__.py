"""RC RF: whether a pilot's remote control reaches the vehicle.

Where the autopilot speaks MAVLink, its stream is listened to and nothing is ever sent: the heartbeat of the expected
system, channels that come and, when the pilot is asked to move the sticks, change; an armed vehicle ends it at once.
What no stream can tell (the link fails safe, it reaches far enough) a person tries, for every vehicle.
How it could be fooled, and what stops it, stands in docs/probes.md.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes.rc_rf.probe import RcHeard, SticksMoved
from atlantis_netcfg.checklist.probes.rc_rf.wanted import Wanted
from atlantis_netcfg.checklist.probes.requests import Place
from atlantis_netcfg.checklist.probes.step import Consent, Step
from atlantis_netcfg.checklist.report import Kind, Phase

if TYPE_CHECKING:
    from atlantis_netcfg.checklist.probes.cell import Cell
    from atlantis_netcfg.declaration.model import RcRfEndpoint

__all__ = ["RcHeard", "SticksMoved", "Wanted", "steps"]


def steps(cell: Cell) -> tuple[Step, ...]:
    """Give the steps of a cell: listening and sticks (by a person where nothing is declared), failsafe, range."""
    endpoint = cell.endpoints.rc_rf
    first = (_by_a_person(cell),) if endpoint is None else _by_the_stream(cell, endpoint)
    return (*first, _failsafe(cell), _range(cell))


def _by_the_stream(cell: Cell, endpoint: RcRfEndpoint) -> tuple[Step, ...]:
    place = cell.place(endpoint.seen_from)
    gateway = cell.gateway.name if place is Place.GATEWAY and cell.gateway is not None else ""
    place_name, address = gateway or "this computer", cell.address(endpoint.address)
    expected = Wanted(cell.name, place_name, endpoint.port, endpoint.system_id, endpoint.rssi_low, address)
    concerns = (gateway,) if gateway else ()
    return (
        Step(
            name="",
            title=f"{cell.name} hears its remote control, and is disarmed",
            kind=Kind.AUTOMATIC,
            phase=Phase.BENCH,
            probe=RcHeard(expected, place),
            concerns=concerns,
        ),
        Step(
            name="sticks",
            title=f"The channels of {cell.name} follow the sticks",
            kind=Kind.ACTIVE,
            phase=Phase.BENCH,
            probe=SticksMoved(expected, place),
            consent=Consent(
                question=f"the propellers are off {cell.name}, or it is disarmed and secured, and nobody is near it",
                # Held in a corner, a stick arms or disarms.
                prompt=f"ask the pilot of {cell.name} to move both sticks in circles, and to hold them in no corner",
            ),
            concerns=concerns,
        ),
    )


def _by_a_person(cell: Cell) -> Step:
    return Step(
        name="",
        title=f"{cell.name} hears its remote control",
        kind=Kind.PERSON,
        phase=Phase.BENCH,
        do=(
            f"Take the propellers off {cell.name}, or leave it disarmed and secured. Switch the transmitter on, and "
            "move both sticks and every switch, one after the other."
        ),
        look_for=(
            "The channels in its operator's program follow each stick and switch over the whole way; its link is shown "
            "as good; the vehicle stays disarmed."
        ),
    )


def _failsafe(cell: Cell) -> Step:
    return Step(
        name="failsafe",
        title=f"{cell.name} fails safe when its remote control falls silent",
        kind=Kind.PERSON,
        phase=Phase.BENCH,
        do=(
            f"Take the propellers off {cell.name} and secure it. Switch the transmitter off, wait ten seconds, and "
            "switch it on again."
        ),
        look_for=(
            "Within a few seconds its program reports the loss and the failsafe that was agreed for this test; nothing "
            "moves; with the transmitter on, the link comes back by itself."
        ),
    )


def _range(cell: Cell) -> Step:
    return Step(
        name="range",
        title=f"The remote control of {cell.name} reaches far enough",
        kind=Kind.PERSON,
        phase=Phase.QUAY,
        do=(
            f"Leave {cell.name} disarmed and secured. Set the transmitter to its reduced power for range tests, walk "
            "30 m away in line of sight, turn round once, and move the sticks."
        ),
        look_for=(
            "The channels follow without gaps in every direction, and no failsafe is reported; set the transmitter "
            "back to full power afterwards."
        ),
    )
