"""Which module speaks for which column, and the step of a cell that no program can see."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes import (
    acoustic,
    ethernet,
    gps,
    lte,
    rc_rf,
    satellite,
    site_checks,
    usbl,
    wifi,
)
from atlantis_netcfg.checklist.probes.step import SITE, Step
from atlantis_netcfg.checklist.report import Kind, Phase
from atlantis_netcfg.declaration.model import ETHERNET, Column

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from atlantis_netcfg.checklist.probes.step import Cell

TITLES: Mapping[str, str] = {
    Column.WIFI: "Wi-Fi",
    Column.ACOUSTIC: "Acoustic",
    Column.SATELLITE: "Satellite",
    Column.USBL: "USBL",
    Column.RC_RF: "RC RF",
    Column.LTE: "4G",
    Column.GPS: "GPS",
    ETHERNET: "Ethernet",
    SITE: "Site",
}
"""Endpoint to the words of Table 3, and ours for what is beside it."""

_STEPS: Mapping[str, Callable[[Cell], tuple[Step, ...]]] = {
    Column.WIFI: wifi.steps,
    Column.ACOUSTIC: acoustic.steps,
    Column.SATELLITE: satellite.steps,
    Column.USBL: usbl.steps,
    Column.RC_RF: rc_rf.steps,
    Column.LTE: lte.steps,
    Column.GPS: gps.steps,
    ETHERNET: ethernet.steps,
    SITE: site_checks.steps,
}


def steps_of(cell: Cell) -> tuple[Step, ...]:
    """What a program or a person looks at in a cell; empty where the column has nothing that sees it."""
    return _STEPS[cell.endpoint](cell)


def by_a_person(cell: Cell) -> Step:
    """What is left where no program sees a cell: nothing of the table silently drops out."""
    title = TITLES[cell.endpoint]
    return Step(
        name="",
        title=f"{title} of {cell.name} works",
        kind=Kind.PERSON,
        phase=_PHASES.get(cell.endpoint, Phase.BENCH),
        do=f"Use {title} of {cell.name} as in the test that is planned; no probe of it is declared.",
        look_for="What is sent arrives, in both directions where it has two.",
    )


_PHASES: Mapping[str, Phase] = {Column.GPS: Phase.QUAY, Column.ACOUSTIC: Phase.WATER, Column.USBL: Phase.WATER}
"""Where a person would look: under an open sky, in water; all else on the bench."""
