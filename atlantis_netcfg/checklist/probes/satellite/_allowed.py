"""The proof of the satellite's allow-list, as `provision prove` has carried it out, in the words of the checklist."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.checklist.probes.evidence import measured
from atlantis_netcfg.checklist.probes.not_run import unasked
from atlantis_netcfg.checklist.probes.requests import Prove
from atlantis_netcfg.checklist.probes.results import Proved
from atlantis_netcfg.checklist.probes.step import Judged
from atlantis_netcfg.core.verdicts import Verdict

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from atlantis_netcfg.checklist.probes.results import Answer
    from atlantis_netcfg.checklist.report import Evidence

__all__ = ["AllowListProbe"]

_NOT_TRIED = "not-tried"
_SEEN = (Verdict.PASS, Verdict.WARN)
_AIMED = frozenset(
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
"""Codes of `bearers.satellite.proof` that speak of a target; any other is of the terminal or of names."""


@dataclass(frozen=True, slots=True)
class AllowListProbe:
    """The satellite lets through what is declared, and refuses targets of ours that are not.

    Targets are those of the declaration and no others; silence counts after 90 s; at most 20 kB go over the air.
    """

    bearer: str
    site: str

    def asks(self) -> tuple[Prove, ...]:
        """One proof."""
        return (Prove("prove", self.bearer),)

    def judge(self, results: Mapping[str, Answer]) -> Judged:
        """Take over what was found; what could not be tried only warns where something else was proved."""
        answer = results.get("prove")
        if not isinstance(answer, Proved) or answer.trouble is not None:
            return Judged((unasked("the satellite's router", answer),))
        return Judged(tuple(self._findings(answer)), tuple(self._evidence(answer)))

    def _findings(self, proved: Proved) -> Iterator[Finding]:
        aimed = [entry for entry in proved.findings if entry.code in _AIMED]
        seen = [item for item in aimed if item.verdict in _SEEN]
        if not aimed:
            message = f"nothing was tried over {self.bearer}"
            hint = "declare `refused_probes` of the link: addresses of ours that must not be reached"
            yield Finding(Verdict.INCONCLUSIVE, "nothing-tried", message, hint)
        elif not seen:
            message = f"none of {len(aimed)} targets could be proved over {self.bearer}"
            hint = "try again while the satellite carries the traffic: unplug the other links"
            yield Finding(Verdict.INCONCLUSIVE, "nothing-proved", message, hint)
        else:
            yield self._proved(len(seen), len(aimed), sum(finding.code == _NOT_TRIED for finding in aimed))
        for one in proved.findings:
            weaker = Verdict.WARN if seen and one.code == _NOT_TRIED else one.verdict
            yield replace(one, verdict=weaker, hint=one.hint or self._hints.get(one.code))

    def _proved(self, seen: int, aimed: int, untried: int) -> Finding:
        message = f"{seen} of {aimed} targets were proved over {self.bearer}"
        if not untried:
            return Finding(Verdict.PASS, "proved", message)
        message = f"{message}, {untried} could not be tried"
        return Finding(Verdict.WARN, "proved-in-part", message, self._hints[_NOT_TRIED])

    @property
    def _hints(self) -> Mapping[str, str]:
        """Where a proof gives none of its own."""
        try_all = f"`provision prove site={self.site} --try-all`"
        return {_NOT_TRIED: f"try it while the satellite carries the traffic, or {try_all}"}

    def _evidence(self, proved: Proved) -> Iterator[Evidence]:
        yield measured(f"proof over {self.bearer} took", round(proved.seconds, 1), "s")
        if proved.bill:
            yield measured(f"cost over {self.bearer}", proved.bill)
