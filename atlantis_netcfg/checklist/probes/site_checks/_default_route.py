"""What leaves the site leaves by the bearer that is meant, and never by a paid one by mistake (BlueOS 1539, 4387)."""

from __future__ import annotations

from dataclasses import dataclass
from ipaddress import IPv4Network
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.bearers import Finding, LinkState
from atlantis_netcfg.bearers.policy import ROUTE_PROPERTIES, Route, active_bearer, active_bearers
from atlantis_netcfg.checklist.probes.site_checks._site import OwnSite, ask, look, run, step
from atlantis_netcfg.checklist.probes.site_checks.findings import fail, good, listed, read, unknown, warn
from atlantis_netcfg.checklist.probes.site_checks.parse import look as looked
from atlantis_netcfg.checklist.probes.site_checks.parse import parsed, rows
from atlantis_netcfg.checklist.probes.step import Judged

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from atlantis_netcfg.checklist.probes.requests import Question
    from atlantis_netcfg.checklist.probes.results import Answer
    from atlantis_netcfg.checklist.probes.step import Step

__all__ = ["of"]

_DEFAULT = "0.0.0.0/0"
_DEAD = frozenset({"dead", "linkdown"})
_BROAD = 8
"""Shorter prefixes are no network of anybody's."""


def of(site: OwnSite) -> Step:
    """The router's routes beside the state of the bearers, and the gateway computer's own default route."""
    return step("default-route", "Traffic leaves by the bearer that is meant", _DefaultRoute(site), site.hosts)


@dataclass(frozen=True, slots=True)
class _DefaultRoute:
    """Traffic leaves by the bearer that is meant."""

    site: OwnSite

    def asks(self) -> tuple[Question, ...]:
        return (
            *ask("routes", self.site, "/ip/route", *ROUTE_PROPERTIES),
            *look(self.site),
            *run("gateway", self.site, "ip -j route show"),
        )

    def judge(self, results: Mapping[str, Answer]) -> Judged:
        assert self.site.router is not None  # noqa: S101 - the check is made for sites with a router
        name = self.site.router.name
        result = rows(results["routes"], name, "its routes", "dst-address")
        local = self._of_gateway(results)
        if isinstance(result, Finding):
            return Judged((result, *local))
        routes = [row for row in result if row.get("dst-address") == _DEFAULT]
        found = tuple(_broad(result)) or tuple(self._of_router(routes, results))
        evidence = tuple(read(f"default route of {name}", _worded(row)) for row in routes if _in_force(row))
        return Judged((*found, *local), evidence)

    @property
    def _ways(self) -> tuple[Route, ...]:
        assert self.site.view is not None  # noqa: S101 - the check is made for sites with a router
        return tuple(
            Route(up.name, up.gateway, up.address, up.canaries, up.port, up.kind) for up in self.site.view.uplinks
        )

    def _of_router(self, routes: Sequence[Mapping[str, str]], results: Mapping[str, Answer]) -> Iterator[Finding]:
        active = active_bearers(routes, self._ways)
        if not active:
            yield _nowhere(self.site.name, foreign=[row for row in routes if _in_force(row)])
        elif len(active) > 1:
            hint = "look at `/ip/route print` of the router for a default route that `provision` did not write"
            yield fail("two-ways", f"the site's traffic is split between {listed(active)}", hint)
        elif active_bearer(routes, self._ways) is None:
            yield _nowhere(self.site.name, foreign=[row for row in routes if _in_force(row)])
        else:
            yield self._judged(active[0], results)

    def _judged(self, active: str, results: Mapping[str, Answer]) -> Finding:
        bearers = self.site.declared.bearers
        place = next(place for place, bearer in enumerate(bearers) if bearer.name == active)
        better = {item.name: looked(results[f"look {item.name}"], item.name) for item in bearers[:place]}
        up = [
            name for name, found in better.items() if not isinstance(found, Finding) and _state(found) is LinkState.UP
        ]
        unseen = [name for name, found in better.items() if isinstance(found, Finding) or _state(found) is None]
        paid = ", which costs by the byte" if bearers[place].metered else ""
        if up:
            return self._passed_by(active, paid, up)
        if unseen:
            message = (
                f"traffic leaves by {active}{paid}; whether {listed(unseen)}, which is better, works, is not known"
            )
            return unknown(
                "better-unknown",
                message,
                f"look at `provision links site={self.site.name}` when the boxes answer again",
            )
        why = f", because {listed(better)} is not up" if better else ""
        return good("by-the-bearer-that-is-meant", f"traffic leaves by {active}{why}")

    def _passed_by(self, active: str, paid: str, up: list[str]) -> Finding:
        message = f"traffic leaves by {active}{paid}, though {up[0]} is up and better"
        wait = self.site.declared.failover.fail_back_s
        hint = f"a better link is taken back after {wait} s without a break: wait so long, then run the site"
        return fail("metered-by-mistake", message, hint) if paid else warn("not-the-best", message, hint)

    def _of_gateway(self, results: Mapping[str, Answer]) -> tuple[Finding, ...]:
        gateway = self.site.gateway
        if gateway is None:
            return ()
        result = parsed(results["gateway"], gateway.name, "its default route")
        if isinstance(result, Finding):
            return (result,)
        return tuple(_of_computer(gateway.name, str(self.site.declared.lan.gateway), result))


def _nowhere(site: str, foreign: Sequence[Mapping[str, str]]) -> Finding:
    if foreign:
        message = (
            f"the default route of the router leads to {foreign[0].get('gateway', '?')}, which is no bearer of {site}"
        )
        return fail(
            "foreign-route", message, "remove that route on the router, or run the site, which puts its own back"
        )
    hint = f"look at `provision links site={site}`: is any bearer up? then run the site, which puts its routes back"
    return fail("no-default-route", "the router has no default route in force: nothing leaves the site", hint)


def _is_broad(text: str) -> bool:
    """Whether it is half of a default route, as VPN clients set two to go before it (openvpn(8), redirect-gateway)."""
    try:
        return 0 < IPv4Network(text).prefixlen < _BROAD
    except ValueError:
        return False


def _broad(rows: Sequence[Mapping[str, str]]) -> Iterator[Finding]:
    there = next((row for row in rows if _in_force(row) and _is_broad(row.get("dst-address", ""))), None)
    if there is not None:
        message = f"the router sends {there['dst-address']} to {there.get('gateway', '?')}, before its default route"
        yield fail("broader-route", message, "remove that route on the router, then run the site")


def _in_force(row: Mapping[str, str]) -> bool:
    """Of the main table: those of the bearers' own tables are there at all times."""
    return row.get("active") in {"true", "yes"} and row.get("routing-table", "main") == "main"


def _worded(row: Mapping[str, str]) -> str:
    return f"{row.get('gateway', '?')}, distance {row.get('distance', '?')}"


def _state(found: Mapping[str, Any]) -> LinkState | None:
    """None: nobody can tell."""
    state = found.get("state")
    return None if state in {None, LinkState.UNKNOWN.value} else LinkState(state) if state in set(LinkState) else None


def _metric(row: Mapping[str, Any]) -> int:
    value = row.get("metric", 0)
    return value if isinstance(value, int) else 0


def _is_dead(row: Mapping[str, Any]) -> bool:
    """Words of the kernel for a route whose interface has no link."""
    flags = row.get("flags")
    return isinstance(flags, list) and not _DEAD.isdisjoint(map(str, flags))


def _of_computer(name: str, router: str, routes: Sequence[Mapping[str, Any]]) -> Iterator[Finding]:
    hint = f"set the default route of {name} to {router} alone: `provision` writes it where `network:` is declared"
    ways = sorted((row for row in routes if row.get("dst") == "default" and not _is_dead(row)), key=_metric)
    broad = next((route for route in routes if _is_broad(str(route.get("dst", "")))), None)
    if broad is not None:
        message = (
            f"{name} sends {broad['dst']} to {broad.get('gateway', broad.get('dev', '?'))}, before its default route"
        )
        yield fail("gateway-broader-route", message, hint)
        return
    if not ways:
        yield fail("gateway-no-route", f"{name} has no default route", hint)
        return
    via, first = ways[0].get("gateway", "nobody"), _metric(ways[0])
    others = [item.get("gateway", "nobody") for item in ways[1:] if item.get("gateway") != router]
    if via != router:
        yield fail(
            "gateway-wrong-route", f"the default route of {name} leads to {via}, not to the router {router}", hint
        )
    elif others and any(_metric(way) == first for way in ways[1:]):
        yield fail("gateway-two-routes", f"{name} has two default routes, to {router} and to {others[0]}", hint)
    elif others:
        yield warn(
            "gateway-spare-route", f"{name} has a second default route, to {others[0]}, behind the right one", hint
        )
    else:
        yield good("gateway-by-the-router", f"the default route of {name} leads to the router {router}")
