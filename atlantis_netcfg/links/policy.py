"""Which bearer carries a site's traffic, and how each is tried out without moving any.

Pure: rows as a router's `/ip/route/print` gives them (text values, API names) go in, names of bearers come out;
commands come out as data, and whoever holds the session sends them.

How a default route is told to belong to a bearer: its gateway is one of the bearer's canaries (a recursive route), the
bearer's next hop, or the port that the bearer is on. A route whose gateway is anything else belongs to nobody.
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
"""What `active_bearer` looks at, as a `.proplist`; a row without `active` is not active."""

DEFAULT = "0.0.0.0/0"
MAIN = "main"
_TRUE = frozenset({"true", "yes"})


@dataclass(frozen=True, slots=True)
class BearerRoute:
    """A bearer as the router's routing knows it."""

    name: str
    gateway: str
    address: str
    """The router's own address on the link; a packet from it takes this link and no other."""
    canaries: tuple[str, ...] = ()
    port: str | None = None
    kind: str = ""
    """Of the declaration: wifi_ptp, lte, satellite, ethernet."""
    is_metered: bool = False


@dataclass(frozen=True, slots=True)
class PolicyProbe:
    """A ping that tries one bearer: `path` with `arguments`, as the API takes them."""

    bearer: str
    target: str
    path: str
    arguments: tuple[tuple[str, str], ...]
    wire_bytes: int
    """What it sends and receives over the bearer if everything is answered."""


def active_bearers(route_rows: Iterable[Mapping[str, str]], bearers: Sequence[BearerRoute]) -> tuple[str, ...]:
    """Return the bearers by which the main table's default leads now, in the order of `bearers`.

    Several are ECMP over different links; none means that the site has no way out, or one that is not a bearer's.
    """
    owners = {_owner(row, bearers) for row in _defaults(route_rows)}
    return tuple(bearer.name for bearer in bearers if bearer.name in owners)


def active_bearer(route_rows: Iterable[Mapping[str, str]], bearers: Sequence[BearerRoute]) -> str | None:
    """Return the one bearer that carries the traffic; None if there is none, or not one alone.

    Two canaries of one link are two equal routes and still one bearer. A default route that is nobody's beside a
    bearer's makes the answer None, because part of the traffic goes elsewhere.
    """
    owners = {_owner(row, bearers) for row in _defaults(route_rows)}
    return owners.pop() if len(owners) == 1 else None


def _defaults(route_rows: Iterable[Mapping[str, str]]) -> list[Mapping[str, str]]:
    """Return the default routes that are in force: of main, active, not disabled, the nearest if they disagree."""
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
    """A row without a distance has the default, 1 (Manual, IP Routing)."""
    text = row.get("distance", "")
    return int(text) if text.isdecimal() else 1


def _owner(row: Mapping[str, str], bearers: Sequence[BearerRoute]) -> str | None:
    """A flag that is there says `blackhole=` or `blackhole=true`; such a route leads nowhere, so to no bearer."""
    if row.get("blackhole", "no") not in ("no", "false"):
        return None
    gateway_name = row.get("gateway", "").partition("@")[0]
    for gateway in (gateway_name, *row.get("immediate-gw", "").split(",")):
        hop, _, port = gateway.partition("%")
        for bearer in bearers:
            if hop and (hop == bearer.gateway or hop in bearer.canaries):
                return bearer.name
            if bearer.port is not None and bearer.port in (hop, port):
                return bearer.name
    return None


def probe_commands(bearers: Sequence[BearerRoute], *, count: int = 3) -> tuple[PolicyProbe, ...]:
    """Return pings that test every probed bearer by its own routing table; nobody's traffic moves.

    A ping from a link's own address is led into the link's own table by a routing rule, so it takes this link whether
    or not the link is in use; its canary has a host route over this link alone. A satellite is never among them: its
    airtime is for traffic. `/tool/ping` is in the command trees of every version that we know; `/ping` left with 7.23.
    """
    return tuple(
        PolicyProbe(
            bearer.name,
            canary,
            "/tool/ping",
            (("address", canary), ("src-address", bearer.address), ("count", str(count))),
            2 * count * ECHO_BYTES,
        )
        for bearer in bearers
        if bearer.kind != "satellite"
        for canary in bearer.canaries
    )
