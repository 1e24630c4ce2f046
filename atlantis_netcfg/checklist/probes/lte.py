"""4G: the site's unit is registered, has an address, and the world answers over it.

What is asked of the unit, and what is wrong in words, is `bearers.lte` and `operations.links`: registration, address
and canaries decide, radio levels only warn, roaming has its own words. No PIN is ever sent by a check: three wrong ones
lock a SIM. No vehicle of the report has 4G; one that a partner adds is confirmed by a person.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.checklist.probes.bearer_probe import link_steps, well
from atlantis_netcfg.checklist.probes.step import Step
from atlantis_netcfg.checklist.report import Kind, Phase
from atlantis_netcfg.core.verdicts import Verdict
from atlantis_netcfg.declaration.model import Column

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.checklist.probes.step import Cell


def steps(cell: Cell) -> tuple[Step, ...]:
    """Give the units of a location, else something for a person."""
    links = link_steps(
        cell,
        Column.LTE,
        lambda _: f"4G of {cell.name} is registered, has an address, and carries traffic",
        _registered,
    )
    return links or (_by_a_person(cell),)


def _registered(values: Mapping[str, Any]) -> Finding | None:
    """Say in which network a unit is that carries traffic."""
    up = well(values)
    quality = values.get("quality") or {}
    if up is None or up.verdict is not Verdict.PASS or not quality.get("registration"):
        return up
    words = f"{quality['registration']}".replace("_", " ")
    network = f" in {quality['operator']}" if quality.get("operator") else ""
    return Finding(up.verdict, up.code, f"{up.message}; the unit says: {words}{network}")


def _by_a_person(cell: Cell) -> Step:
    return Step(
        name="",
        title=f"4G of {cell.name} works",
        kind=Kind.PERSON,
        phase=Phase.BENCH,
        do=f"Open the page of the 4G unit of {cell.name}, then load a page over it with every other link unplugged."
        " Enter no PIN: three wrong ones lock the SIM.",
        look_for="The unit is registered, at home or roaming as the SIM's contract has it, and the page loads.",
    )
