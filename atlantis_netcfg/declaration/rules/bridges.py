"""The two ends of a Wi-Fi bridge: a bearer at the site that it carries, a served link at the other."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.declaration._near import meant
from atlantis_netcfg.declaration.model import BearerKind
from atlantis_netcfg.declaration.rules.links import End, ends

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.declaration._draft import Draft, Rule
    from atlantis_netcfg.declaration.findings import Finding

__all__ = ["RULES"]


def bridges(draft: Draft) -> Iterator[Finding]:
    """Both ends of a Wi-Fi bridge are declared, and they are one network with the served end as its gateway."""
    every = list(ends(draft))
    if len(draft.sites) != len(draft.layout.sites):
        return  # an invalid site may hold the other end
    bearers = [end for end in every if end.path[0] == "bearers" and end.kind is BearerKind.WIFI_PTP]
    served = [end for end in every if end.path[0] == "served_links"]
    lost = [finding for end in served for finding in _carried(draft, end, bearers)]
    yield from lost
    for end in bearers:
        far = [other for other in served if _carries(other) == end.site]
        if not far and not lost:  # a served link that carries a wrong site may be the one
            message = f"no site serves the other end of link `{end.link.name}` of `{end.site}`"
            hint = f"add it to `served_links` of the other site, with `carries: {end.site}`"
            yield draft.wrong(end.part, end.path, message, hint)
        for other in far[1:]:
            where = draft.where(far[0].part, *far[0].path)
            message = f"`{end.site}` is carried twice, first by `{far[0].link.name}` ({where})"
            yield draft.wrong(other.part, (*other.path, "carries"), message, "keep one")
        if far:
            yield from _agree(draft, end, far[0])


def _carries(end: End) -> str:
    return str(getattr(end.link, "carries", ""))


def _carried(draft: Draft, end: End, bearers: list[End]) -> Iterator[Finding]:
    carried, path = _carries(end), (*end.path, "carries")
    others = [site for site in draft.sites if site != end.site]
    if carried == end.site:
        message = f"link `{end.link.name}` carries its own site"
        yield draft.wrong(end.part, path, message, f"name the site at the other end: {', '.join(others)}")
    elif carried not in draft.sites:
        yield draft.wrong(end.part, path, f"there is no site `{carried}`", meant(carried, others, none="add the site"))
    elif not any(bearer.site == carried for bearer in bearers):
        message = f"`{carried}` has no wifi_ptp bearer that link `{end.link.name}` could serve"
        yield draft.wrong(end.part, path, message, f"add the bearer to `{carried}`, or remove this link")


def _agree(draft: Draft, near: End, far: End) -> Iterator[Finding]:
    where = f"`{far.site}` says {far.link.network} ({draft.where(far.part, *far.path, 'network')})"
    if near.link.network != far.link.network:
        message = f"the two ends of link `{near.link.name}` are in different networks: {near.link.network} here,"
        yield draft.wrong(near.part, (*near.path, "network"), f"{message} {where}", "make both the same")
        return
    gateway = getattr(near.link, "gateway", None)
    if gateway != far.link.address:
        where = draft.where(far.part, *far.path, "address")
        message = f"the gateway {gateway} of link `{near.link.name}` is not the router that serves it"
        yield draft.wrong(near.part, (*near.path, "gateway"), message, f"{far.link.address}, as {where} has it")


RULES: tuple[Rule, ...] = (bridges,)
