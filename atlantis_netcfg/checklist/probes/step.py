"""A step of the checklist: the cell that it belongs to, the probe that it runs, and what a probe says.

A probe is two functions: `asks` gives its requests, `judge` gives findings and evidence. Here are also the findings for
a request without a complete result, from which nothing follows, and evidence in one line each.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.checklist.probes.requests import Place
from atlantis_netcfg.checklist.probes.results import CommandResult, Rows, Trouble
from atlantis_netcfg.checklist.report import Evidence, EvidenceType, Kind, Phase
from atlantis_netcfg.core.verdicts import Verdict, worst
from atlantis_netcfg.declaration.model import Endpoints, Gateway, Router, SeenFrom

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from atlantis_netcfg.checklist.probes.requests import Question
    from atlantis_netcfg.checklist.probes.results import Answer
    from atlantis_netcfg.declaration import Declaration, Host
    from atlantis_netcfg.declaration.model import Site


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
    """What a person has to agree to before an active step, shown word by word."""

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


SITE = "site"
"""The endpoint of the site's own checks."""


@dataclass(frozen=True, slots=True)
class Cell:
    """What the steps of a column are made from."""

    declaration: Declaration
    site: str
    vehicle: str | None
    """Key; None: the location."""
    endpoint: str
    """A column of Table 3, `ethernet`, or `site`."""

    @property
    def row(self) -> str:
        """The first part of an item's id."""
        return self.vehicle or self.site

    @property
    def name(self) -> str:
        """The row in words."""
        return self.declared.title if self.vehicle is None else self.declaration.vehicles[self.vehicle].name

    @property
    def declared(self) -> Site:
        """The site."""
        return self.declaration.sites[self.site]

    @property
    def endpoints(self) -> Endpoints:
        """How the row's endpoints are seen."""
        if self.vehicle is not None:
            return self.declaration.vehicles[self.vehicle].endpoints
        return self.declared.location.endpoints

    @property
    def gateway(self) -> Host | None:
        """The site's gateway computer."""
        return next((host for host in self.declaration.site_hosts(self.site) if isinstance(host.device, Gateway)), None)

    @property
    def router(self) -> Host | None:
        """The site's router."""
        return next((host for host in self.declaration.site_hosts(self.site) if isinstance(host.device, Router)), None)

    def place(self, seen_from: SeenFrom) -> Place:
        """Where a probe of this cell stands: a site without a gateway is looked at from the laptop."""
        if seen_from is SeenFrom.GATEWAY and self.gateway is not None:
            return Place.GATEWAY
        return Place.LAPTOP

    def address(self, declared: object) -> str | None:
        """The declared address, else that of the row's DHCP reservation at this site; None: nobody says."""
        if declared is not None:
            return str(declared)
        reservations = (item for item in self.declared.lan.reservations if item.name == self.vehicle)
        return next((str(reservation.address) for reservation in reservations), None)


def measured(what: str, value: object, unit: str = "") -> Evidence:
    """Give what this tool has measured."""
    return Evidence(type=EvidenceType.MEASURED, what=what, value=number(value, unit))


def read(what: str, value: object, unit: str = "") -> Evidence:
    """Give what a device has said."""
    return Evidence(type=EvidenceType.READ, what=what, value=number(value, unit))


def declared(what: str, value: object) -> Evidence:
    """Give what the inventory says."""
    return Evidence(type=EvidenceType.DECLARED, what=what, value=str(value))


def number(value: object, unit: str = "") -> str:
    """Write a value with its unit: `-52 dBm`; a number without needless zeros."""
    text = f"{value:g}" if isinstance(value, float) else str(value)
    return f"{text} {unit}" if unit else text


PLACES = {Place.GATEWAY: "the gateway", Place.LAPTOP: "this computer", Place.ROUTER: "the router"}
"""A place in words."""
_PACKAGES = {"ping": "iputils-ping", "ip": "iproute2"}
"""Where the package of Debian and Ubuntu is not called as its program is."""


def unasked(who: str, answer: Answer | None) -> Finding:
    """Say that `who` could not be asked; it never fails anything, for nothing is known."""
    words = getattr(answer, "words", "") or "it does not answer"
    hint = f"make {who} reachable first, then ask again"
    return Finding(Verdict.INCONCLUSIVE, "not-asked", f"{who} could not be asked: {words}", hint)


def not_run(place: Place, program: str, ran: Answer | None) -> Iterator[Finding]:
    """Say why a program has printed nothing that counts; nothing, if it was carried out."""
    where = PLACES[place]
    if not isinstance(ran, CommandResult):
        yield unasked(where, ran)
    elif ran.trouble is Trouble.MISSING:
        hint = f"on it: sudo apt install {_PACKAGES.get(program, program)}"
        yield Finding(Verdict.INCONCLUSIVE, "program-missing", f"{where} has no program `{program}`", hint)
    elif ran.trouble is Trouble.SILENT:
        hint = f"look whether {where} is overloaded, then ask again"
        message = f"`{program}` did not come to an end in time on {where}"
        yield Finding(Verdict.INCONCLUSIVE, "program-slow", message, hint)
    elif ran.trouble is not None:
        yield unasked(where, ran)


def rows_of(answer: Answer | None) -> tuple[dict[str, str], ...] | None:
    """Give the rows of a menu; None: it was not asked, or the device does not have it."""
    if not isinstance(answer, Rows) or answer.trouble is not None or answer.rows is None:
        return None
    return tuple(dict(row) for row in answer.rows)
