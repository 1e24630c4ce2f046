"""What is declared of the cost of a link: a tariff and a cap have to mean something, and leave something to be done."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.declaration._draft import Draft, Part, Rule

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.declaration.findings import Finding
    from atlantis_netcfg.declaration.model import Bearer

__all__ = ["RULES"]

_LEAST_MB = 0.1
"""Reading one configured router comes to about 80 kB on the wire, before anything is changed."""


def of_metered_links_only(draft: Draft) -> Iterator[Finding]:
    """`billing` and `cap_mb` of a link that costs nothing are a mistake: perhaps it does cost."""
    for name, index, bearer in _bearers(draft):
        for key in ("billing", "cap_mb"):
            if not bearer.metered and key in bearer.model_fields_set and getattr(bearer, key) is not None:
                message = f"link `{bearer.name}` is declared as free (`metered: false`), so `{key}` means nothing"
                hint = f"remove `{key}:`, or write `metered: true` if every byte costs"
                yield draft.wrong(Part("site", name), ("bearers", index, key), message, hint)


def leaves_room_to_read(draft: Draft) -> Iterator[Finding]:
    """Below what it takes to look at a router a cap forbids everything, which no cap is meant to do."""
    for name, index, bearer in _bearers(draft):
        if bearer.metered and bearer.cap_mb < _LEAST_MB:
            message = f"link `{bearer.name}` admits {bearer.cap_mb:g} MB to an action, not enough to read one router"
            hint = f"write {_LEAST_MB:g} or more; what nobody has agreed to pay is not sent in any case"
            yield draft.wrong(Part("site", name), ("bearers", index, "cap_mb"), message, hint)


def a_floor_has_a_rate(draft: Draft) -> Iterator[Finding]:
    """`floor_after_s` says from when on the floor holds: without a floor nothing holds."""
    for name, index, bearer in _bearers(draft):
        billing = bearer.billing
        if billing is not None and billing.floor_after_s and not billing.floor_bytes_per_s:
            message = f"the tariff of link `{bearer.name}` has a floor from {billing.floor_after_s} s on, and no floor"
            hint = "add `floor_bytes_per_s` from the contract, or remove `floor_after_s`"
            yield draft.wrong(Part("site", name), ("bearers", index, "billing", "floor_after_s"), message, hint)


def _bearers(draft: Draft) -> Iterator[tuple[str, int, Bearer]]:
    for name, site in draft.sites.items():
        for index, bearer in enumerate(site.bearers):
            yield name, index, bearer


RULES: tuple[Rule, ...] = (of_metered_links_only, leaves_room_to_read, a_floor_has_a_rate)
