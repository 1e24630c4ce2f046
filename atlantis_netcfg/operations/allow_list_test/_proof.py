"""What a proof came to: one object for programs, a few lines for a person."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.bearers.satellite import Outcome
from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.verdicts import Verdict

if TYPE_CHECKING:
    from collections.abc import Iterable

    from atlantis_netcfg.bearers import Finding
    from atlantis_netcfg.bearers.satellite import Attempt

__all__ = ["Proof"]

_BAD = (Verdict.FAIL, Verdict.ERROR)
_PROVED = (Verdict.PASS, Verdict.WARN)


@dataclass(frozen=True, slots=True)
class Proof:
    """Everything that was tried, judged, and counted."""

    site: str
    bearer: str
    active: bool
    """Whether the satellite carried the site's traffic meanwhile."""
    judged: tuple[tuple[Attempt, Finding], ...]
    findings: tuple[Finding, ...]
    """Of the terminal and of names, which no probe has shown."""
    bytes_counted: int
    """By the router, on the satellite's port, both directions, whoever caused them."""
    budget_bytes: int
    kept_off: int
    """Packets that the filter has kept off the satellite since its rules were made."""
    turned_away: int
    """Packets that came in by the satellite and were dropped, since then."""
    carrier: str
    """The link that the session to the router goes over."""
    opening_bytes: int = 0
    """What was carried before the first count, TLS and an attempt that learnt the certificate included."""
    session_bytes: int = 0
    """All that was carried, as above."""
    sessions: int = 1
    """Connections to the router."""

    @property
    def exit(self) -> ExitCode:
        """0 if everything was proved; 6 if anything failed or stays open; 7 if nothing was tried and nothing failed."""
        verdicts = [one.verdict for one in (*(finding for _, finding in self.judged), *self.findings)]
        if any(verdict in _BAD for verdict in verdicts):
            return ExitCode.CHECKS_FAILED
        if all(attempt.outcome is Outcome.NOT_TRIED for attempt, _ in self.judged):
            return ExitCode.NOTHING
        proved = all(verdict in _PROVED for verdict in verdicts)
        return ExitCode.DONE if proved else ExitCode.CHECKS_FAILED

    def as_json(self) -> dict[str, Any]:
        """The object that `--json` prints."""
        return {
            "site": self.site,
            "bearer": self.bearer,
            "exit": int(self.exit),
            "active": self.active,
            "targets": [_told(attempt, finding) for attempt, finding in self.judged],
            "findings": [finding.as_dict() for finding in self.findings],
            "bytes_counted": self.bytes_counted,
            "budget_bytes": self.budget_bytes,
            "kept_off_packets": self.kept_off,
            "turned_away_packets": self.turned_away,
        }

    def as_text(self) -> str:
        """The lines that a person reads."""
        return "\n".join(self._lines())

    def _lines(self) -> Iterable[str]:
        carries = "carries the traffic now" if self.active else "does not carry the traffic now"
        yield f"{self.site}, {self.bearer}: {carries}"
        for finding in (*(finding for _, finding in self.judged), *self.findings):
            yield f"  {finding.verdict.value:<12} {finding.message}"
            if finding.hint:
                yield f"  {'':<12} {finding.hint}"
        tried = [finding.verdict for attempt, finding in self.judged if attempt.outcome is not Outcome.NOT_TRIED]
        proved = sum(verdict in _PROVED for verdict in tried)
        yield f"  {proved} of {len(self.judged)} targets proved, {len(self.judged) - len(tried)} could not be tried"
        counted = f"{self.bytes_counted} bytes on the satellite's port meanwhile (asking stops at {self.budget_bytes})"
        yield f"  the router counted {counted}; kept off {self.kept_off} packets, turned away {self.turned_away}"


def _told(attempt: Attempt, finding: Finding) -> dict[str, Any]:
    return {
        "name": attempt.name,
        "target": attempt.target,
        "expected": attempt.expected.value,
        "probe": attempt.probe.value,
        "outcome": attempt.outcome.value,
        "after_s": attempt.after_s,
        "window_s": attempt.window_s,
        "filter_open": attempt.filter_open,
        **finding.as_dict(),
    }
