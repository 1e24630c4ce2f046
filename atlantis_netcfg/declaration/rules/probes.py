"""Canaries: addresses beyond a link that are pinged over it, to learn whether it carries traffic."""

from __future__ import annotations

from ipaddress import IPv4Network
from typing import TYPE_CHECKING

from atlantis_netcfg.declaration._draft import Draft, Part, Rule
from atlantis_netcfg.declaration.rules.networks import Index, claims

if TYPE_CHECKING:
    from collections.abc import Iterator
    from ipaddress import IPv4Address

    from atlantis_netcfg.declaration.findings import Finding

__all__ = ["RULES"]

_PAIR = 2


def two_or_none(draft: Draft) -> Iterator[Finding]:
    """One silent canary must not take a link down: two of them, or the link is not probed."""
    for name, site in draft.sites.items():
        for index, bearer in enumerate(site.bearers):
            path = ("bearers", index, "canaries")
            if 0 < len(set(bearer.canaries)) < _PAIR:
                message = f"link `{bearer.name}` has one canary: if that host fails, the link counts as down"
                yield draft.wrong(Part("site", name), path, message, "name two different hosts beyond the link")
            elif not bearer.canaries and index < len(site.bearers) - 1:
                message = f"link `{bearer.name}` has no canaries, so its failure would not be noticed"
                hint = "name two; only the last link in order of preference can go without"
                yield draft.wrong(Part("site", name), ("bearers", index), message, hint)


def own_to_each_link(draft: Draft) -> Iterator[Finding]:
    """A canary is routed over its own link only, so no other link of the site can use it."""
    for name, site in draft.sites.items():
        part = Part("site", name)
        seen: dict[IPv4Address, tuple[int, int]] = {}
        for index, bearer in enumerate(site.bearers):
            for place, canary in enumerate(bearer.canaries):
                first = seen.setdefault(canary, (index, place))
                lonely = first[0] == index and len(set(bearer.canaries)) < _PAIR
                if first != (index, place) and not lonely:
                    other = site.bearers[first[0]].name
                    line = draft.mark(part, "bearers", first[0], "canaries", first[1]).line
                    message = f"{canary} is already a canary of link `{other}` (line {line})"
                    hint = "a canary answers for one link: choose another host"
                    yield draft.wrong(part, ("bearers", index, "canaries", place), message, hint)


def used_for_nothing_else(draft: Draft) -> Iterator[Finding]:
    """A canary is unreachable while its link is down: nothing that is needed may stand at its address."""
    networks = Index(claims(draft))
    for name, site in draft.sites.items():
        for index, bearer in enumerate(site.bearers):
            for place, canary in enumerate(bearer.canaries):
                if use := _other_use(draft, networks, canary):
                    message = f"the canary {canary} of link `{bearer.name}` is {use}"
                    hint = "choose a host beyond the link that is used for nothing else"
                    yield draft.wrong(Part("site", name), ("bearers", index, "canaries", place), message, hint)


def _other_use(draft: Draft, networks: Index, address: IPv4Address) -> str | None:
    if draft.pilot is not None:
        if address == draft.pilot.vpn.endpoint:
            return "the VPN's endpoint"
        for server in draft.pilot.time_servers:
            if address == server.address:
                return f"the time server {server.name}"
    claim = next(iter(networks.over(IPv4Network(address))), None)
    return f"inside {claim.what}, {claim.network}" if claim is not None else None


RULES: tuple[Rule, ...] = (two_or_none, own_to_each_link, used_for_nothing_else)
