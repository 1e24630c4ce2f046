"""Assigns a module to each column, with a step for a person if no program can check a cell.

Also the allow-lists of what a probe may run or send, checked once more before a request leaves.

Programs on a gateway or a laptop are read-only (`core/reading_programs.py`). Messages into a stream come from the list
of each device's protocol.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes import (
    acoustic,
    base,
    ethernet,
    gps,
    integration,
    items,
    link_probe,
    rc_rf,
    robot,
    satellite,
    site_checks,
    usbl,
    wifi,
)
from atlantis_netcfg.checklist.probes.acoustic.modem import refused_reason
from atlantis_netcfg.checklist.report import ItemKind, Phase
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory.model import ETHERNET, Column

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping


TITLES: Mapping[str, str] = {
    Column.WIFI: "Wi-Fi",
    Column.ACOUSTIC: "Acoustic",
    Column.SATELLITE: "Satellite",
    Column.USBL: "USBL",
    Column.RC_RF: "RC RF",
    Column.LTE: "4G",
    Column.GPS: "GPS",
    ETHERNET: "Ethernet",
    base.SITE: "Site",
    base.ROBOT: "Robot",
    base.INTEGRATION: "Integration",
    base.ITEMS: "Items",
}
"""Endpoint -> title as in Table 3, and our own title for endpoints outside it."""

_STEPS: Mapping[str, Callable[[base.Cell], tuple[base.Step, ...]]] = {
    Column.WIFI: wifi.steps,
    Column.ACOUSTIC: acoustic.steps,
    Column.SATELLITE: satellite.steps,
    Column.USBL: usbl.steps,
    Column.RC_RF: rc_rf.steps,
    Column.LTE: link_probe.steps,
    Column.GPS: gps.steps,
    ETHERNET: ethernet.steps,
    base.SITE: site_checks.steps,
    base.ROBOT: robot.steps,
    base.INTEGRATION: integration.steps,
    base.ITEMS: items.steps,
}


def steps_of(cell: base.Cell) -> tuple[base.Step, ...]:
    """Return the steps of a cell; empty if its column has nothing to check."""
    return _STEPS[cell.endpoint](cell)


def by_a_person(cell: base.Cell) -> base.Step:
    """Return the step for a cell that no program can check, so that no cell of the table is omitted."""
    title = TITLES[cell.endpoint]
    return base.Step(
        name="",
        title=msg(f"{arg(title)} of {arg(cell.name)} works"),
        kind=ItemKind.PERSON,
        phase=_PHASES.get(cell.endpoint, Phase.BENCH),
        do=msg(f"Use {arg(title)} of {arg(cell.name)} as in the planned test; the inventory has no probe for it."),
        look_for="What is sent arrives, in both directions if it has two.",
    )


_PHASES: Mapping[str, Phase] = {
    Column.GPS: Phase.QUAY,
    Column.ACOUSTIC: Phase.WATER,
    Column.USBL: Phase.WATER,
    base.INTEGRATION: Phase.INTEGRATION,
}
"""Endpoint -> phase in which a person looks: under an open sky, in water; all others on the bench."""


PLAIN: tuple[bytes, ...] = (rb'\?WATCH=\{"enable":true,"json":true\};?\r?\n', rb"\?(VERSION|DEVICES|POLL);?\r?\n")
"""Full matches of messages that only read, for a device whose language needs no table: gpsd."""
_PLAIN = tuple(re.compile(saying) for saying in PLAIN)


def find_refusal(listen: base.Listen, *, active: bool) -> str | None:
    """Return what a script must not send, and why; None if all of it is allowed.

    `active`: the script belongs to an active step, and a person has consented. Nothing is sent to a UDP port.
    """
    if listen.say and listen.transport == "udp":
        return "nothing is ever sent to a stream received by UDP"
    for say in listen.say:
        if any(plain.fullmatch(say.data) for plain in _PLAIN):
            continue
        if reason := refused_reason(say.data, active=active):
            return reason
    return None
