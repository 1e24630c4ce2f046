"""Satellite: read from the router without sending; send only with consent; the rest is checked by a person.

A Thales VesseLINK has no documented interface, so the check does not contact it. It reads the router: the port's link,
whether the terminal has answered ARP, what the filter has dropped, what the inventory has on the terminal; nothing is
sent over airtime. `provision measure satellite` tests the allow-list, costs money and asks for consent first; its
result is included as checklist findings. A person reads the terminal's own pages.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.checklist import report
from atlantis_netcfg.checklist.probes import base
from atlantis_netcfg.checklist.probes.link_probe import LinkProbe, column_links
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory import model
from atlantis_netcfg.inventory.satellite_allow_list import allowed_targets
from atlantis_netcfg.links import LinkFinding

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping


_NOT_TRIED = "not-tried"
_GOOD_VERDICTS = (Verdict.PASS, Verdict.WARN)
_TARGET_CODES = frozenset(
    {
        "reached",
        "refused",
        "refused-beyond",
        "only-the-router-enforces",
        "leak",
        "not-reached",
        "silent",
        "link-not-seen",
        "refused-by-the-router",
        _NOT_TRIED,
    }
)
"""Codes of findings of `links.satellite` on a target; any other code concerns the terminal or names."""


@dataclass(frozen=True, slots=True)
class AllowListProbe:
    """Check that the satellite allows the traffic in the inventory, and blocks other targets of ours.

    All targets are from the inventory; silence counts after 90 s; at most 20 kB are sent over the air.
    """

    link: str
    site: str

    def asks(self) -> tuple[base.AllowListTestRequest, ...]:
        """Request one test of the allow-list."""
        return (base.AllowListTestRequest("prove", self.link),)

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        """Take over the findings; targets that could not be tried only warn if others were tested."""
        answer = results.get("prove")
        if not isinstance(answer, base.AllowListTestResult) or answer.trouble is not None:
            return base.ProbeResult((base.no_answer_finding("the satellite's router", answer),))
        return base.ProbeResult(tuple(self._findings(answer)), tuple(self._evidence(answer)))

    def _findings(self, result: base.AllowListTestResult) -> Iterator[LinkFinding]:
        target_findings = [entry for entry in result.findings if entry.code in _TARGET_CODES]
        proved_findings = [item for item in target_findings if item.verdict in _GOOD_VERDICTS]
        if not target_findings:
            message = msg(f"nothing was tested over {arg(self.link)}")
            hint = "set `refused_probes` of the link: our own addresses that must not be reachable"
            yield LinkFinding(Verdict.INCONCLUSIVE, "nothing-tried", message, hint)
        elif not proved_findings:
            message = msg(f"none of {arg(len(target_findings))} targets could be verified over {arg(self.link)}")
            hint = "test again while the satellite carries the traffic: unplug the other links"
            yield LinkFinding(Verdict.INCONCLUSIVE, "nothing-proved", message, hint)
        else:
            yield self._summarize(
                len(proved_findings),
                len(target_findings),
                sum(finding.code == _NOT_TRIED for finding in target_findings),
            )
        for finding in result.findings:
            weaker = Verdict.WARN if proved_findings and finding.code == _NOT_TRIED else finding.verdict
            yield replace(finding, verdict=weaker, hint=finding.hint or self._hints.get(finding.code))

    def _summarize(self, proved_count: int, target_count: int, untried_count: int) -> LinkFinding:
        message = msg(f"{arg(proved_count)} of {arg(target_count)} targets were verified over {arg(self.link)}")
        if not untried_count:
            return LinkFinding(Verdict.PASS, "proved", message)
        message = msg(f"{arg(message)}, {arg(untried_count)} could not be tested")
        return LinkFinding(Verdict.WARN, "proved-in-part", message, self._hints[_NOT_TRIED])

    @property
    def _hints(self) -> Mapping[str, str]:
        """Hints for results that have none."""
        try_all = f"`provision measure satellite site={self.site} --try-all`"
        return {_NOT_TRIED: msg(f"test while the satellite carries the traffic, or {arg(try_all)}")}

    def _evidence(self, result: base.AllowListTestResult) -> Iterator[report.Evidence]:
        yield base.measured_evidence(msg(f"duration of the test over {arg(self.link)}"), round(result.seconds, 1), "s")
        if result.bill:
            yield base.measured_evidence(msg(f"cost over {arg(self.link)}"), result.bill)


def steps(cell: base.Cell) -> tuple[base.Step, ...]:
    """Return four items per satellite link of a location, otherwise a step for a person."""
    links = column_links(cell, model.Column.SATELLITE)
    satellite_steps = (step for number, link in enumerate(links) for step in _of_link(cell, link, number))
    return tuple(satellite_steps) or (_manual_step(cell),)


def _of_link(cell: base.Cell, link: model.Link, number: int) -> Iterator[base.Step]:
    """Yield the items of a link; those of a second link have its name as prefix."""
    before = f"{link.name}-" if number else ""
    concerns = tuple(item for item in (link.device,) if item is not None)
    yield base.Step(
        name=link.name if number else "",
        title=msg(f"The router sees the satellite terminal of {arg(cell.name)}; nothing is sent"),
        kind=report.ItemKind.AUTOMATIC,
        phase=report.Phase.BENCH,
        probe=LinkProbe(link.name, _there),
        concerns=concerns,
    )
    yield base.Step(
        name=f"{before}allow-list",
        title=msg(f"The satellite of {arg(cell.name)} passes what the inventory allows, and nothing else"),
        kind=report.ItemKind.ACTIVE,
        phase=report.Phase.QUAY,
        probe=AllowListProbe(link.name, cell.site),
        consent=base.Consent(
            question=msg(f"the terminal of {arg(cell.name)} has a view of the sky; up to 20 kB of airtime may be used"),
            prompt=(
                "please wait: unresponsive targets are retried for 90 s, because gaps of 70 s are normal on this link"
            ),
            cost=True,
        ),
        concerns=concerns,
    )
    yield _firewall(cell, link, before, concerns)
    yield _terminal(cell, link, before, concerns)


def _firewall(cell: base.Cell, link: model.Link, before: str, concerns: tuple[str, ...]) -> base.Step:
    targets = join(", ", (_target(allowed_target) for allowed_target in allowed_targets(cell.inventory.pilot, link)))
    return base.Step(
        name=f"{before}firewall",
        title=msg(f"The terminal's own firewall passes only addresses of ATLANTIS ({arg(link.device)})"),
        kind=report.ItemKind.PERSON,
        phase=report.Phase.BENCH,
        do=msg(f"Open the pages of {arg(link.device)} and check its firewall; attach a screenshot."),
        look_for=msg(
            f"The firewall is on and allows only these: {arg(targets)}. The password is not the factory default."
        ),
        concerns=concerns,
    )


def _terminal(cell: base.Cell, link: model.Link, before: str, concerns: tuple[str, ...]) -> base.Step:
    box = cell.inventory.hosts.get(link.device or "")
    evidence = getattr(box.device, "evidence", None) if box is not None else None
    firmware = msg(
        f"the firmware is {arg(evidence.firmware)}, as in the inventory"
        if evidence is not None
        else "note the firmware"
    )
    return base.Step(
        name=f"{before}terminal",
        title=msg(f"The terminal's own pages show signal, position and a data session ({arg(link.device)})"),
        kind=report.ItemKind.PERSON,
        phase=report.Phase.QUAY,
        do=msg(f"Open the pages of {arg(link.device)} under a clear sky; attach a screenshot of its status."),
        look_for=msg(f"It shows a signal, its position and a data session, and no alarm; {arg(firmware)}."),
        concerns=concerns,
    )


def _target(target: model.AllowedTarget) -> str:
    port = "" if target.port is None else f" {target.transport} {target.port}"
    return msg(f"{arg(target.name)} ({arg(target.address)}{arg(port)})")


def _there(values: Mapping[str, Any]) -> LinkFinding | None:
    """Return what the router shows of the terminal; an aged ARP entry proves nothing."""
    quality = values.get("quality") or {}
    if quality.get("port_link") != "up":
        return None
    port = quality.get("port") or "its port"
    if quality.get("next_hop_seen") == "yes":
        message = msg(f"port {arg(port)} has a link, and the terminal responded on it; nothing was sent over the air")
        return LinkFinding(Verdict.PASS, "terminal-there", message)
    message = msg(f"port {arg(port)} has a link, but the terminal has not responded on it recently")
    hint = "this is no proof: the router only looks for it when it sends; the allow-list item shows more"
    return LinkFinding(Verdict.INCONCLUSIVE, "terminal-not-seen", message, hint)


def _manual_step(cell: base.Cell) -> base.Step:
    return base.Step(
        name="",
        title=msg(f"Satellite of {arg(cell.name)} works"),
        kind=report.ItemKind.PERSON,
        phase=report.Phase.QUAY,
        do=msg(
            f"Open the pages of the satellite terminal of {arg(cell.name)} under a clear sky, then send one small "
            "message. Each byte may cost."
        ),
        look_for="It shows a signal and a data session, and the message arrives within 90 s: gaps of 70 s occur.",
    )
