"""`provision links use`: the person's request, whether the link is fit for it, and the possible cost.

The result of `provision links` decides whether a link is good enough. A satellite is not probed, and a link without
probe targets cannot be: there the VPN server must have responded over it (`provision measure satellite`), or a person
must confirm that it works (`--unproved`).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.core import errors
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.links import LinkState
from atlantis_netcfg.links.cost import preview
from atlantis_netcfg.operations.common.request import LinkOrder
from atlantis_netcfg.routeros.link_use import SETTLED_S

if TYPE_CHECKING:
    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.inventory.model import Link
    from atlantis_netcfg.links.cost import MeteredLink, Preview
    from atlantis_netcfg.operations.links.collect import LinksStatus

SHORTEST_S: Final = 60
LONGEST_S: Final = 86_400
_SPAN = re.compile(r"(?:(\d+)h)?(?:(\d+)m)?")
_BITS = 8
PROOF_S: Final = 3600
"""Validity of a proof in seconds, by our own judgement: no source says how long a satellite link stays the same."""
_UNPROVED_HINT = "add `--unproved` to use the link without proof that it works"


class LinkNotFit(errors.DeviceError):
    """The link is down or not known to work; the site's traffic is not moved."""


class NothingInUse(errors.NoMatchError):
    """`end` was typed, and no link is temporarily in use."""


def span_s(text: str) -> int:
    """Parse `for=` to seconds; raise UsageError."""
    match = _SPAN.fullmatch(text)
    hint = "give minutes or hours, from 1 minute to 24 hours: `for=30m`, `for=2h`, `for=1h30m`"
    if not text or match is None:
        raise errors.UsageError(f"`for={arg(text)}` is not a duration", hint=hint)
    hours, minutes = (int(part or 0) for part in match.groups())
    seconds = 3600 * hours + 60 * minutes
    if not SHORTEST_S <= seconds <= LONGEST_S:
        raise errors.UsageError(
            f"`for={arg(text)}` is {'less than 1 minute' if not seconds else 'more than 24 hours'}", hint=hint
        )
    return seconds


def router_of(inventory: Inventory, site: str) -> Host:
    """Return the router that selects among a site's links; raise UsageError if there is nothing to select."""
    if site not in inventory.sites:
        near = errors.nearest(site, inventory.sites)
        choices = msg(f"sites: {arg(join(', ', inventory.sites))}")
        raise errors.UsageError(
            f"`site={arg(site)}`: this command changes the link of one site",
            hint=f"did you mean `site={arg(near)}`? {arg(choices)}" if near else choices,
        )
    router = inventory.router_of(site)
    links = inventory.sites[site].bearers
    if router is None or len(links) < 2:  # noqa: PLR2004 - to choose among
        only = msg(f"`{arg(links[0].name)}` is its only link" if links else "it has no links")
        raise errors.UsageError(
            f"`{arg(site)}` has no choice of links: {arg(only)}",
            hint=f"add a second link in group_vars/{arg(site)}.yml, in order of preference",
        )
    return router


@dataclass(frozen=True, slots=True)
class UseRequest:
    """A request to use a link for a time."""

    site: str
    link: Link
    for_s: int
    allow_unproved: bool = False
    """A person has accepted the use of the link without proof that it works."""

    def order(self, status: LinksStatus, now: datetime | None = None, *, proof: datetime | None = None) -> LinkOrder:
        """Return the order for the router; raise LinkNotFit with the observed state of the link.

        `proof`: when the VPN server last responded over it.
        """
        now = now or datetime.now(UTC)
        uptime_s = self._uptime(status)
        self._refuse_unfit(status, is_proved=proof is not None and 0 <= (now - proof).total_seconds() <= PROOF_S)
        until = now + timedelta(seconds=self.for_s)
        return LinkOrder(
            link=self.link.name,
            since_uptime_s=uptime_s,
            until_uptime_s=uptime_s + self.for_s,
            until=until.replace(second=0, microsecond=0),
            proved=not self.allow_unproved,
        )

    def cost(self, link: MeteredLink) -> Preview:
        """Return the maximum cost of the site's traffic: the link's full rate in the inventory, both ways."""
        rate = self.link.rate
        most = round((rate.up_kbps + rate.down_kbps) * 1000 / _BITS * self.for_s)
        return preview(most, self.for_s, link, at_most=True)

    def _uptime(self, status: LinksStatus) -> int:
        if status.uptime_s is None:
            silent = join("; ", (item.message for item in status.unreachable)) or "it does not report its uptime"
            raise LinkNotFit(
                f"the router of {arg(self.site)} could not be read, so nothing was changed: {arg(silent)}",
                hint=_unread_hint(self.site, status),
            )
        if status.uptime_s < SETTLED_S:
            raise LinkNotFit(
                f"the router of {arg(self.site)} started {arg(status.uptime_s):.0f} s ago and is still checking its "
                "links",
                hint=f"run the same command again in {arg(SETTLED_S - status.uptime_s):.0f} s",
            )
        return int(status.uptime_s)

    def _refuse_unfit(self, status: LinksStatus, *, is_proved: bool) -> None:
        link_status = next(link for link in status.links if link.name == self.link.name)
        if self.allow_unproved or link_status.state is LinkState.UP:
            return
        why = join("; ", (finding.message for finding in link_status.findings))
        if link_status.state in {LinkState.DOWN, LinkState.SEARCHING}:
            raise LinkNotFit(
                f"{arg(self.link.name)} is down, so nothing was changed: {arg(why or 'no response')}",
                hint=_UNPROVED_HINT,
            )
        if is_proved:
            return
        hint = msg(
            f"set two `canaries:` (probe targets) for it in group_vars/{arg(self.site)}.yml; or {arg(_UNPROVED_HINT)}"
        )
        if self.link.kind.traits.allow_list:
            hint = msg(
                f"`provision measure satellite site={arg(self.site)} link={arg(self.link.name)} --try-all` tests the "
                f"VPN over it (valid for one hour); or {arg(_UNPROVED_HINT)}"
            )
        raise LinkNotFit(
            f"there is no proof that {arg(self.link.name)} works, so nothing was changed: no probe runs over it",
            hint=hint,
        )


def _unread_hint(site: str, status: LinksStatus) -> str:
    """Return a hint on the router's missing response, the known cause if there is one."""
    hint = next((item.hint for item in status.unreachable if item.hint), None)
    return (
        errors.fill_hint(hint, site=site)
        if hint
        else msg(f"`provision links site={arg(site)}` shows which link carries the traffic")
    )


def ended_order(site: str, status: LinksStatus) -> LinkOrder:
    """Return the order that restores the inventory's link order; raise NothingInUse or LinkNotFit."""
    if status.uptime_s is None:
        raise LinkNotFit(
            f"the router of {arg(site)} could not be read, so nothing was changed",
            hint=_unread_hint(site, status),
        )
    if status.use is None:
        raise NothingInUse(
            f"no link of {arg(site)} overrides the order of the inventory, so there is nothing to end",
            hint=f"`provision links site={arg(site)}` shows which link carries the traffic",
        )
    return LinkOrder()
