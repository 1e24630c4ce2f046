"""The route of the router's replies to the technician (Manual, IP Routing; Policy Routing)."""

from __future__ import annotations

from dataclasses import dataclass
from ipaddress import IPv4Address, IPv4Network, ip_network
from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, conjunction, msg
from atlantis_netcfg.routeros.guard import _state
from atlantis_netcfg.routeros.menus import MENUS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.routeros._types import Row

_DEEP_ENOUGH = 4
_NO_LIMIT = -1
_CHAINS = "user,main"
"""Before 7.22 there are no chains. The other default chains (`mangle`, `local`, …) have no rules of ours."""

_UNKNOWN_SELECTORS = ("realm", "vrf")
"""Selectors from 7.22 on; whether they match depends on rows that are not read here."""


@dataclass(frozen=True, slots=True)
class RouteDecision:
    """The routing decision for one destination."""

    words: str
    """Readable name of the route."""
    to: frozenset[str] = frozenset()
    """Gateways, or ports of the connected interface; empty: no route."""
    interface: str | None = None
    """Interface by which packets leave; None: unknown."""

    is_connected: bool = False
    """The destination is directly connected to that interface."""

    @property
    def has_route(self) -> bool:
        """False for a blackhole or a missing route."""
        return bool(self.to)


def objections(before: _state.State, after: _state.State) -> Iterator[str]:
    """Yield problems with the return route after the change that did not exist before."""
    then, now = decisions(before), decisions(after)
    if then.doubts != now.doubts:
        changed_doubts = [
            doubt for doubt in (*now.doubts, *then.doubts) if (doubt in then.doubts) != (doubt in now.doubts)
        ]
        rule, selectors = (changed_doubts or now.doubts)[0]
        yield msg(
            f"cannot tell whether routing rule `{arg(rule)}` with {arg(selectors)} applies to responses to you at "
            f"{arg(before.path.technician)}: leave such rules unchanged, or change them by hand"
        )
        return
    for old, new in zip(then.ways, now.ways, strict=True):
        reason = _objection(old, new, before.path.technician)
        if reason is not None:
            yield reason
            return


def _objection(old: RouteDecision, new: RouteDecision, technician: str) -> str | None:
    if not old.has_route or old.to == new.to or (old.is_connected and new.is_connected and old.to < new.to):
        return None
    if not new.has_route:
        return msg(
            f"responses to you at {arg(technician)} take {arg(old.words)}; after this change {arg(new.words)}: keep "
            "that route or address"
        )
    return msg(
        f"responses to you at {arg(technician)} take {arg(old.words)}, and would take {arg(new.words)}: keep the old "
        "path until you connect over the new one"
    )


@dataclass(frozen=True, slots=True)
class _Decisions:
    """Possible return routes: one per rule that cannot be evaluated, and the one if none of those matches."""

    ways: tuple[RouteDecision, ...]
    doubts: tuple[tuple[str, str], ...]
    """Name and selectors of the rules that cannot be evaluated, in order of evaluation."""


def return_route(state: _state.State) -> RouteDecision:
    """Return the route of the router's replies: rules by chain, and table main at the turn of `main`.

    Rules that cannot be evaluated are assumed not to match.
    """
    return decisions(state).ways[-1]


def decisions(state: _state.State) -> _Decisions:
    """Return all possible routes of the replies, whichever of the unclear rules match."""
    ways: list[RouteDecision] = []
    doubts: list[tuple[str, str]] = []
    for rule in _rules(state):
        if rule is None:
            way = _lookup(state, "main", state.technician)
        else:
            way = _by_rule(rule, state) if _matches(rule, state) else None
        if way is None:
            continue
        selectors = _beyond_judgement(rule or {})
        ways.append(way)
        if not selectors:
            return _Decisions(tuple(ways), tuple(doubts))
        doubts.append((MENUS["/routing/rule"].name_of(rule or {}), selectors))
    return _Decisions((*ways, RouteDecision("no route leads there")), tuple(doubts))


def _beyond_judgement(rule: Row) -> str:
    """Return the selectors of a rule that we cannot evaluate for our replies; empty if none."""
    return conjunction(f"`{name}={rule[name]}`" for name in _UNKNOWN_SELECTORS if rule.get(name))


def _rules(state: _state.State) -> Iterator[Row | None]:
    """Yield the rules in order of evaluation; None stands for table main.

    From 7.22 on a rule is in a chain, and `policy-rules` gives the order of the chains; a chain that it omits is never
    evaluated. Assumption: routing-rule-chains
    """
    settings = next(iter(state.all("/routing/settings")), {})
    for chain in settings.get("policy-rules", _CHAINS).split(","):
        yield from (rule for rule in state.enabled_rows("/routing/rule") if rule.get("chain", "user") == chain)
        if chain == "main":
            yield None


def _matches(rule: Row, state: _state.State) -> bool:
    """Match a rule with the router's own replies: no incoming interface and, without mangle, no mark."""
    ends = (("src-address", state.local), ("dst-address", state.technician))
    return not (rule.get("interface") or rule.get("routing-mark")) and all(
        address in network for name, address in ends if (network := _network(rule.get(name, ""))) is not None
    )


def _by_rule(rule: Row, state: _state.State) -> RouteDecision | None:
    """Return the decision of a rule; None if it passes to the next rules."""
    action = rule.get("action", "lookup")
    name = MENUS["/routing/rule"].name_of(rule)
    if action in ("drop", "unreachable"):
        return RouteDecision(msg(f"the routing rule `{arg(name)}` blocks them"))
    limit = rule.get("min-prefix", "")
    way = _lookup(state, rule.get("table", "main"), state.technician, int(limit) if limit.isdecimal() else _NO_LIMIT)
    if way is None and action == "lookup-only-in-table":
        return RouteDecision(msg(f"the routing rule `{arg(name)}` finds no route for them"))
    return way


def _lookup(
    state: _state.State, table: str, address: IPv4Address, limit: int = _NO_LIMIT, depth: int = 0
) -> RouteDecision | None:
    """Return the routes with the longest prefix, of those the ones with the smallest distance."""
    routes = [each for each in _routes(state, table) if address in each.network and each.network.prefixlen > limit]
    if not routes:
        return None
    best = min(each.rank for each in routes)
    best_routes = [each for each in routes if each.rank == best]
    if best_routes[0].interface is not None:
        network, interface = best_routes[0].network, best_routes[0].interface
        ports = state.ports(interface) or frozenset({interface})
        return RouteDecision(msg(f"{arg(network)} on {arg(interface)}"), ports, interface, is_connected=True)
    name = MENUS["/ip/route"].name_of(best_routes[0].row)
    if any(each.row.get("blackhole", "no") not in ("no", "false") for each in best_routes):
        return RouteDecision(msg(f"the route {arg(name)} drops them"))
    gateways = frozenset(
        gateway for each in best_routes for gateway in each.row.get("gateway", "").split(",") if gateway
    )
    return RouteDecision(
        msg(f"the route {arg(name)}"),
        frozenset(_gateway(state, each) for each in gateways),
        _leaving(state, gateways, depth),
    )


@dataclass(frozen=True, slots=True)
class _GuardRoute:
    network: IPv4Network
    distance: int
    row: Row
    interface: str | None = None

    @property
    def rank(self) -> tuple[int, int]:
        return -self.network.prefixlen, self.distance


def _routes(state: _state.State, table: str) -> Iterator[_GuardRoute]:
    if table == "main":
        for network, interface in state.connected_networks():
            yield _GuardRoute(network, 0, {}, interface)
    for row in state.enabled_rows("/ip/route"):
        target = _network(row.get("dst-address", "0.0.0.0/0"))
        if target is not None and row.get("routing-table", "main") == table and not _state.is_set(row, "connect"):
            yield _GuardRoute(target, int(row.get("distance", "1")), row)


def _network(text: str) -> IPv4Network | None:
    try:
        network = ip_network(text, strict=False)
    except ValueError:
        return None
    return network if isinstance(network, IPv4Network) else None


def _gateway(state: _state.State, text: str) -> str:
    """Return a gateway with an interface identity that does not change on renaming."""
    address, sign, name = text.rpartition("%")
    interface = state.interface(name)
    return f"{address}{sign}{_state.identity(*interface) if interface else name}"


def _leaving(state: _state.State, gateways: frozenset[str], depth: int) -> str | None:
    """Return the outgoing interface of a single gateway; None for several, which share the packets."""
    if len(gateways) != 1 or depth >= _DEEP_ENOUGH:
        return None
    (text,) = gateways
    target, _, table = text.partition("@")
    address, _, name = target.rpartition("%")
    network = _network(name)
    if network is None or address:
        return name
    way = _lookup(state, table or "main", network.network_address, depth=depth + 1)
    return way.interface if way is not None else None
