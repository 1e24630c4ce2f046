"""The link that carries a site's traffic, and probes of each link that do not move traffic.

Pure: rows as a router's `/ip/route/print` returns them (text values, API names) go in, names of links come out;
commands are returned as data, and the holder of the session sends them.

A default route belongs to a link if its gateway is one of the link's probe targets (a recursive route), the link's
next hop, or the link's port. A route with any other gateway belongs to no link.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core.packets import ECHO_BYTES

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

ROUTE_PROPERTIES = (
    "dst-address",
    "gateway",
    "immediate-gw",
    "routing-table",
    "distance",
    "active",
    "disabled",
    "dynamic",
    "blackhole",
)
"""Properties that `active_link` reads, as a `.proplist`; a row without `active` is not active."""

DEFAULT = "0.0.0.0/0"
MAIN = "main"
_TRUE = frozenset({"true", "yes"})


@dataclass(frozen=True, slots=True)
class LinkRoute:
    """A link as the router's routing table shows it."""

    name: str
    gateway: str
    address: str
    """The router's own address on the link; packets from it use this link only."""
    probe_targets: tuple[str, ...] = ()
    port: str | None = None
    kind: str = ""
    """Link kind in the inventory: wifi_ptp, lte, satellite, ethernet."""
    is_metered: bool = False


@dataclass(frozen=True, slots=True)
class PolicyProbe:
    """A ping that tests one link: `path` with `arguments`, as the API takes them."""

    link: str
    target: str
    path: str
    arguments: tuple[tuple[str, str], ...]
    wire_bytes: int
    """Bytes sent and received on the link if every ping is answered."""


def active_links(route_rows: Iterable[Mapping[str, str]], links: Sequence[LinkRoute]) -> tuple[str, ...]:
    """Return the links used by the main table's default routes now, in the order of `links`.

    Several mean ECMP over different links; none means that the site has no default route, or none over a known link.
    """
    owners = {_owner(row, links) for row in _defaults(route_rows)}
    return tuple(link.name for link in links if link.name in owners)


def active_link(route_rows: Iterable[Mapping[str, str]], links: Sequence[LinkRoute]) -> str | None:
    """Return the only link that carries the traffic; None if there is none or more than one.

    Two probe targets of one link are two equal routes and still one link. A default route of no link beside a link's
    makes the result None, because part of the traffic goes elsewhere.
    """
    owners = {_owner(row, links) for row in _defaults(route_rows)}
    return owners.pop() if len(owners) == 1 else None


def _defaults(route_rows: Iterable[Mapping[str, str]]) -> list[Mapping[str, str]]:
    """Return the default routes in force: main table, active, enabled; of different distances, the nearest."""
    used = [
        row
        for row in route_rows
        if row.get("dst-address", DEFAULT) == DEFAULT
        and row.get("routing-table", MAIN) == MAIN
        and row.get("active") in _TRUE
        and row.get("disabled") not in _TRUE
    ]
    nearest = min((_distance(row) for row in used), default=0)
    return [row for row in used if _distance(row) == nearest]


def _distance(row: Mapping[str, str]) -> int:
    """Return a route's distance; a row without one has the default, 1 (Manual, IP Routing)."""
    text = row.get("distance", "")
    return int(text) if text.isdecimal() else 1


def _owner(row: Mapping[str, str], links: Sequence[LinkRoute]) -> str | None:
    """Return the link that a route belongs to; None for a blackhole route (`blackhole=` or `blackhole=true`)."""
    if row.get("blackhole", "no") not in ("no", "false"):
        return None
    gateway_name = row.get("gateway", "").partition("@")[0]
    for gateway in (gateway_name, *row.get("immediate-gw", "").split(",")):
        hop, _, port = gateway.partition("%")
        for link in links:
            if hop and (hop == link.gateway or hop in link.probe_targets):
                return link.name
            if link.port is not None and link.port in (hop, port):
                return link.name
    return None


def probe_commands(links: Sequence[LinkRoute], *, count: int = 3) -> tuple[PolicyProbe, ...]:
    """Return pings that test every probed link through its own routing table, without moving traffic.

    A routing rule sends a ping from a link's own address to the link's table, so it uses this link whether or not the
    link is active; its probe target has a host route over this link alone. Satellites are never included: their airtime
    is for traffic. `/tool/ping` exists in the command trees of all known versions; `/ping` was removed in 7.23.
    """
    return tuple(
        PolicyProbe(
            link.name,
            probe_target,
            "/tool/ping",
            (("address", probe_target), ("src-address", link.address), ("count", str(count))),
            2 * count * ECHO_BYTES,
        )
        for link in links
        if link.kind != "satellite"
        for probe_target in link.probe_targets
    )
