"""What an active step costs where it goes over a link that is paid by the byte."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.probes import AllowListTestRequest
from atlantis_netcfg.cli._arguments import ACCEPT_COST
from atlantis_netcfg.operations.allow_list_test.site import previews, satellite_of

if TYPE_CHECKING:
    from atlantis_netcfg.bearers.cost import Preview
    from atlantis_netcfg.checklist import Entry
    from atlantis_netcfg.cli._session import Session


@dataclass(frozen=True, slots=True)
class Price:
    """An estimate in words."""

    words: str
    due: bool
    """Whether somebody has to agree to pay; in a rehearsal nobody has, nor where `--accept-cost` was typed."""


def price_of(opened: Session, entry: Entry) -> Price | None:
    """The price of an active step; None: it costs nothing. Raises CostRefused above the declared cap."""
    if entry.step.probe is None or entry.step.consent is None or not entry.step.consent.cost:
        return None
    proofs = [ask for ask in entry.step.probe.asks() if isinstance(ask, AllowListTestRequest)]
    metered = [each for proof in proofs for each in _previews(opened, proof.bearer) if each.link.metered]
    for item in metered:
        if item.over_cap and not opened.rehearsed:
            raise item.refusal()
    if not metered:
        return None
    due = not opened.rehearsed and not opened.arguments.flag(ACCEPT_COST.name)
    return Price("; ".join(preview.words for preview in metered), due)


def _previews(opened: Session, bearer: str) -> tuple[Preview, ...]:
    found = satellite_of(opened.declaration, opened.site, bearer)
    via = opened.arguments.optional("via")
    return previews(opened.declaration, found.proving(opened.declaration, rehearsed=opened.rehearsed, via=via))
