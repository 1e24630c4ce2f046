"""Probes of a site's link: its status as in `provision links`, and what it is usable for.

The same result serves the Wi-Fi bridge, the 4G unit, the satellite's port and a plain cable; each column has its own
message for a link without problems.

4G: the site's unit is registered, has an address, and Internet targets respond over it.

The requests to the unit and the messages are in `links.lte` and `operations.links`: registration, address and probe
targets decide, radio levels only warn, roaming has its own message. A check never sends a PIN: three wrong ones lock a
SIM. No vehicle of the report has 4G; one that a partner adds is confirmed by a person.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.checklist import report
from atlantis_netcfg.checklist.probes import base
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory.model import Column, Link
from atlantis_netcfg.links import LinkFinding, LinkState

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping


_UNITS = {"_dbm": "dBm", "_db": "dB", "_ms": "ms", "_percent": "%", "_mbps": "Mbit/s", "_s": "s", "_bytes": "bytes"}
"""End of a reading's name -> unit; longest first where one ends like another."""
_ALL = 100
"""Percent of loss at which nothing arrives."""
_HINT = "check the device of this link, then check again"
"""Used if a finding has no hint of its own."""


def column_links(cell: base.Cell, column: str) -> tuple[Link, ...]:
    """Return the links of a column for a row: a location has those of its site, a vehicle none."""
    if cell.vehicle is not None:
        return ()
    return tuple(link for link in cell.site_config.bearers if link.kind.traits.column == column)


def boxes(cell: base.Cell, link: Link) -> tuple[str, ...]:
    """Return the devices of a link: the local one and, for a bridge, the remote one."""
    box = cell.inventory.hosts.get(link.device or "")
    peer = getattr(getattr(box.device, "ptp", None), "peer", None) if box is not None else None
    return tuple(name for name in (link.device, peer) if name is not None)


def passing_finding(values: Mapping[str, Any]) -> LinkFinding | None:
    """Return a finding for a link that carries traffic; its device reporting "connected" is not enough."""
    if values.get("state") != LinkState.UP:
        return None
    quality = values.get("quality") or {}
    loss = quality.get("loss_percent")
    if not isinstance(loss, int | float) or loss >= _ALL:
        hint = "set `canaries` of the link, and check whether its router may send pings; then check again"
        return LinkFinding(
            Verdict.INCONCLUSIVE, "not-tried", "its device reports it as up, but no traffic was seen", hint
        )
    after = msg("" if quality.get("rtt_ms") is None else f", round trip {arg(quality['rtt_ms']):g} ms")
    level = msg("" if quality.get("signal_dbm") is None else f", signal {arg(quality['signal_dbm']):g} dBm")
    return LinkFinding(Verdict.PASS, "up", msg(f"the link is up{arg(after)}{arg(level)}"))


@dataclass(frozen=True, slots=True)
class LinkProbe:
    """Check that the link carries traffic, and that its devices report no problem."""

    link: str
    good: Callable[[Mapping[str, Any]], LinkFinding | None] = passing_finding
    """Finding on a link without any problem; None: nothing was observed of it."""

    def asks(self) -> tuple[base.LinkStatusRequest, ...]:
        """Request the status of the site's links, read once for all items."""
        return (base.LinkStatusRequest("look", self.link),)

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        """Take over the findings of the link."""
        answer = results.get("look")
        if not isinstance(answer, base.LinkStatusResult) or answer.trouble is not None or answer.link is None:
            return base.ProbeResult((base.no_answer_finding(msg(f"the devices of {arg(self.link)}"), answer),))
        values = answer.link
        findings = tuple(_findings(values))
        finding = self.good(values)
        return base.ProbeResult(
            (*((finding,) if finding is not None else ()), *findings) or (_unknown_state_finding(self.link),),
            _evidence(values),
        )


def link_steps(
    cell: base.Cell,
    column: str,
    title: Callable[[Link], str],
    good: Callable[[Mapping[str, Any]], LinkFinding | None] = passing_finding,
) -> tuple[base.Step, ...]:
    """Return one item per link of a column; the first is the column's main item, the others are named by link."""
    return tuple(
        base.Step(
            name=link.name if number else "",
            title=title(link),
            kind=report.ItemKind.AUTOMATIC,
            phase=report.Phase.BENCH,
            probe=LinkProbe(link.name, good),
            concerns=boxes(cell, link),
        )
        for number, link in enumerate(column_links(cell, column))
    )


def _unknown_state_finding(link: str) -> LinkFinding:
    hint = "check its own device, then check again"
    return LinkFinding(Verdict.INCONCLUSIVE, "state-unknown", msg(f"the state of {arg(link)} is unknown"), hint)


def _findings(values: Mapping[str, Any]) -> Iterator[LinkFinding]:
    for item in values.get("findings") or ():
        verdict = Verdict(item["verdict"])
        hint = item.get("hint") or (_HINT if verdict is not Verdict.PASS else None)
        yield LinkFinding(verdict, item["code"], item["message"], hint)


def _evidence(values: Mapping[str, Any]) -> tuple[report.Evidence, ...]:
    quality = (values.get("quality") or {}).items()
    of = msg(f"of {arg(values['box'])}" if values.get("box") else "of the link")
    readings = [
        base.read(join(" ", (name, of)), value, unit)
        for key, value in quality
        if value is not None
        for name, unit in [_split_name(key)]
    ]
    return (base.read(msg(f"state {arg(of)}"), values.get("state", "unknown")), *readings)


def _split_name(key: str) -> tuple[str, str]:
    """Split a reading's name: `tx_rate_mbps` becomes `tx rate` in Mbit/s."""
    end = next((end for end in _UNITS if key.endswith(end)), "")
    return msg(key.removesuffix(end).replace("_", " ")), _UNITS.get(end, "")


def reserved_mac(cell: base.Cell, mac: object) -> str | None:
    """Return the MAC address in the inventory, else of the row's DHCP reservation, in upper case; None if unknown."""
    if mac is not None:
        return str(mac).upper()
    reservations = (item for item in cell.site_config.lan.reservations if item.name == cell.vehicle)
    return next((str(reservation.mac).upper() for reservation in reservations), None)


def steps(cell: base.Cell) -> tuple[base.Step, ...]:
    """Return a step per 4G unit of a location, otherwise a step for a person."""
    links = link_steps(
        cell,
        Column.LTE,
        lambda _: msg(f"4G of {arg(cell.name)} is registered, has an address, and carries traffic"),
        _check_registration,
    )
    return links or (_lte_manual_step(cell),)


def _check_registration(values: Mapping[str, Any]) -> LinkFinding | None:
    """Return the finding for a unit that carries traffic, with its network."""
    up = passing_finding(values)
    quality = values.get("quality") or {}
    if up is None or up.verdict is not Verdict.PASS or not quality.get("registration"):
        return up
    words = msg(str(quality["registration"]).replace("_", " "))
    network = msg(f" in {arg(quality['operator'])}" if quality.get("operator") else "")
    return LinkFinding(up.verdict, up.code, msg(f"{arg(up.message)}; the unit reports: {arg(words)}{arg(network)}"))


def _lte_manual_step(cell: base.Cell) -> base.Step:
    return base.Step(
        name="",
        title=msg(f"4G of {arg(cell.name)} works"),
        kind=report.ItemKind.PERSON,
        phase=report.Phase.BENCH,
        do=msg(
            f"Open the page of the 4G unit of {arg(cell.name)}. Unplug every other link, then load a page over it. "
            "Enter no PIN: three wrong ones lock the SIM."
        ),
        look_for="The unit is registered, at home or roaming as the SIM's contract allows, and the page loads.",
    )
