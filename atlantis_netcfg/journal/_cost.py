"""The record of what a run has cost; the other kinds of records stand in `records`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

__all__ = ["CostCounted"]


@dataclass(frozen=True, slots=True, kw_only=True)
class CostCounted:
    """What the run on a device has sent over a link that is paid by the byte."""

    kind: Literal["cost-counted"] = "cost-counted"
    device: str
    bearer: str
    """The link that carried it, as far as it is known; `declared` is the one that was to."""
    declared: str
    accepted: bool
    """Whether a person had agreed to pay."""
    expected_bytes: int | None
    sent_bytes: int
    """Counted by us, in both directions, with what TLS and TCP add."""
    router_bytes: int | None
    """What the router's own counter rose by meanwhile, others' traffic included; None: not read."""
    billed_bytes: int
    price: str | None
    """In `currency`; None: no tariff is declared."""
    currency: str | None
