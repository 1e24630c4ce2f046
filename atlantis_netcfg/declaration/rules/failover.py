"""Failover: times that fit each other, and something that they are about.

What the router can do with them: templates/routeros/parts/netwatch.rsc.j2.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.declaration._draft import Draft, Part, Rule
from atlantis_netcfg.declaration.model import BearerKind

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.declaration.findings import Finding

__all__ = ["RULES"]

_MOST = 9
"""Links are ten apart in distance, and a hundred more when they are given up: RouterOS has distances up to 255."""


def there_is_another_link(draft: Draft) -> Iterator[Finding]:
    """With one link there is nothing to fail over to."""
    for name, site in draft.sites.items():
        if "failover" in site.model_fields_set and len(site.bearers) == 1:
            message = f"`failover` is declared, and `{site.bearers[0].name}` is the only link of `{name}`"
            yield draft.wrong(
                Part("site", name), ("failover",), message, "remove `failover:`, or declare a second link"
            )


def returns_no_sooner_than_it_leaves(draft: Draft) -> Iterator[Finding]:
    """A link that is taken back sooner than it is left goes up and down with every short interruption."""
    for name, site in draft.sites.items():
        times = site.failover
        if times.fail_back_s < times.hold_down_s:
            message = (
                f"a link would be left after {times.hold_down_s} s of silence and taken back after"
                f" {times.fail_back_s} s of answers, so that one which comes and goes is never at rest"
            )
            key = "fail_back_s" if "fail_back_s" in times.model_fields_set else "hold_down_s"
            hint = "let `fail_back_s` be at least `hold_down_s`, better some minutes"
            yield draft.wrong(Part("site", name), ("failover", key), message, hint)


def metered_links_to_ask_over(draft: Draft) -> Iterator[Finding]:
    """`metered_probe_s` is about links that are paid by the byte and asked all the same."""
    for name, site in draft.sites.items():
        if "metered_probe_s" not in site.failover.model_fields_set or len(site.bearers) == 1:
            continue
        if not any(bearer.metered and bearer.canaries for bearer in site.bearers[:-1]):
            message = f"`metered_probe_s` is declared, and no link of `{name}` with canaries is metered"
            hint = "remove it: links that cost nothing are asked every 5 s, and the last link is not asked"
            yield draft.wrong(Part("site", name), ("failover", "metered_probe_s"), message, hint)


def satellites_are_not_asked(draft: Draft) -> Iterator[Finding]:
    """Airtime is for traffic: a satellite is what is left when every other link is silent."""
    for name, site in draft.sites.items():
        for index, bearer in enumerate(site.bearers):
            if bearer.kind is BearerKind.SATELLITE and bearer.canaries:
                message = (
                    f"link `{bearer.name}` is a satellite and has canaries: pinging them would be billed day and night"
                )
                hint = (
                    f"remove `canaries:`; `provision prove site={name}` tries the satellite when a person asks for it"
                )
                yield draft.wrong(Part("site", name), ("bearers", index, "canaries"), message, hint)


def not_too_many_links(draft: Draft) -> Iterator[Finding]:
    """More links than the router has distances for cannot be put in order."""
    for name, site in draft.sites.items():
        if len(site.bearers) > _MOST:
            message = f"`{name}` has {len(site.bearers)} links, and the order of preference has room for {_MOST}"
            yield draft.wrong(Part("site", name), ("bearers", _MOST), message, "remove the links that nobody will use")


RULES: tuple[Rule, ...] = (
    there_is_another_link,
    returns_no_sooner_than_it_leaves,
    metered_links_to_ask_over,
    satellites_are_not_asked,
    not_too_many_links,
)
