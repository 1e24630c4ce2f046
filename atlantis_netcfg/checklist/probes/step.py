"""A step of the checklist, and the two functions that a probe is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from atlantis_netcfg.checklist.report import Evidence, Kind, Phase
from atlantis_netcfg.core.verdicts import Verdict, worst

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.bearers import Finding
    from atlantis_netcfg.checklist.probes.requests import Question
    from atlantis_netcfg.checklist.probes.results import Answer

__all__ = ["Consent", "Judged", "Probe", "Step"]


@dataclass(frozen=True, slots=True)
class Judged:
    """What follows from the answers. Without a finding nothing was seen, and that never passes."""

    findings: tuple[Finding, ...]
    """The worst comes to the item's verdict; its message is the first of those."""
    evidence: tuple[Evidence, ...] = ()

    @property
    def verdict(self) -> Verdict:
        """The worst finding; of none, ERROR: a probe that says nothing is broken."""
        return worst(finding.verdict for finding in self.findings) if self.findings else Verdict.ERROR


class Probe(Protocol):
    """The first line of its docstring is what the technician reads."""

    def asks(self) -> tuple[Question, ...]:
        """Every question, with names that are unlike each other."""
        ...

    def judge(self, results: Mapping[str, Answer]) -> Judged:
        """Judge the answers, one for each question by its name."""
        ...


@dataclass(frozen=True, slots=True)
class Consent:
    """What a person has to agree to before an active step; it is asked word by word."""

    question: str
    """`Sparus is in the water, and its modem may transmit`."""
    prompt: str = ""
    """What the person does while the tool listens: `ask the pilot to move the right stick in circles`."""
    cost: bool = False
    """It costs on a metered link: `--accept-cost` or a yes is asked as well."""


@dataclass(frozen=True, slots=True)
class Step:
    """One item to be: what a program looks at, or a person."""

    name: str
    """Third part of the item's id; empty for the column's own, main item."""
    title: str
    kind: Kind
    phase: Phase
    probe: Probe | None = None
    """None: a person looks."""
    do: str = ""
    """For a person: what to do."""
    look_for: str = ""
    """For a person: what tells that it is well."""
    consent: Consent | None = None
    """Of an active step."""
    unless: str = ""
    """Why it does not apply: the item is a SKIP with this reason."""
    concerns: tuple[str, ...] = ()
    """Names of hosts that it speaks of, for the drawing."""

    def __post_init__(self) -> None:
        """Hold the three kinds apart."""
        if not self.unless and (self.kind is Kind.PERSON) != (self.probe is None):
            raise ValueError(f"step `{self.title}`: a person's step has no probe, every other one has")
        if (self.kind is Kind.ACTIVE) != (self.consent is not None):
            raise ValueError(f"step `{self.title}`: consent is asked for active steps, and for all of them")
