"""Traffic leaves the site by the desired link, and over the satellite only allowed traffic.

The default route never uses a metered link by mistake (BlueOS 1539, 4387). The router's own allow-list for the
satellite is complete: targets in the inventory are allowed, and the rest is dropped. Sending tests whether it works
(`satellite/allow-list`), which costs; this check only reads the rules.
"""

from __future__ import annotations

from dataclasses import dataclass
from ipaddress import IPv4Network
from typing import TYPE_CHECKING, Any

from atlantis_netcfg.checklist.probes import base
from atlantis_netcfg.checklist.probes.site_checks import parse
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.links import LinkFinding, LinkState, policy
from atlantis_netcfg.operations.links.status import IN_USE
from atlantis_netcfg.routeros.menus import MENUS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from atlantis_netcfg.routeros.render.view import Uplink


_DEFAULT = "0.0.0.0/0"
_DEAD = frozenset({"dead", "linkdown"})
_BROAD = 8
"""Shorter prefixes do not describe a network of anybody."""


def default_route_check(site: parse.OwnSite) -> base.Step:
    """Return the step comparing the router's routes, the state of its links, and the gateway's default route."""
    return parse.step("default-route", "Traffic leaves by the intended link", _DefaultRoute(site), site.hosts)


@dataclass(frozen=True, slots=True)
class _DefaultRoute:
    """Check that traffic leaves by the desired link."""

    site: parse.OwnSite

    def asks(self) -> tuple[base.Question, ...]:
        return (
            *parse.ask("routes", self.site, "/ip/route", *policy.ROUTE_PROPERTIES),
            *parse.link_requests(self.site),
            *parse.run("gateway", self.site, "ip -j route show"),
        )

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        assert self.site.router is not None  # noqa: S101 - the check is made for sites with a router
        name = self.site.router.name
        result = parse.rows(results["routes"], name, "its routes", "dst-address")
        local = self._judge_gateway(results)
        if isinstance(result, LinkFinding):
            return base.ProbeResult((result, *local))
        routes = [row for row in result if row.get("dst-address") == _DEFAULT]
        findings = tuple(_find_broad_route(result)) or tuple(self._judge_router(routes, results))
        evidence = tuple(
            parse.read(msg(f"default route of {arg(name)}"), _route_text(row)) for row in routes if _in_force(row)
        )
        return base.ProbeResult((*findings, *local), evidence)

    @property
    def _link_routes(self) -> tuple[policy.LinkRoute, ...]:
        assert self.site.view is not None  # noqa: S101 - the check is made for sites with a router
        return tuple(
            policy.LinkRoute(up.name, up.gateway, up.address, up.probe_targets, up.port, up.kind)
            for up in self.site.view.uplinks
        )

    def _judge_router(
        self, routes: Sequence[Mapping[str, str]], results: Mapping[str, base.Answer]
    ) -> Iterator[LinkFinding]:
        active = policy.active_links(routes, self._link_routes)
        if not active:
            yield _no_route_finding(self.site.name, foreign=[row for row in routes if _in_force(row)])
        elif len(active) > 1:
            hint = "check `/ip/route print` of the router for a default route that `provision` did not write"
            yield parse.fail(
                "two-ways", msg(f"the site's traffic is split between {arg(parse.join_words(active))}"), hint
            )
        elif policy.active_link(routes, self._link_routes) is None:
            yield _no_route_finding(self.site.name, foreign=[row for row in routes if _in_force(row)])
        else:
            yield self._judge_active(active[0], results)

    def _judge_active(self, active: str, results: Mapping[str, base.Answer]) -> LinkFinding:
        links = self.site.site_config.bearers
        place = next(place for place, link in enumerate(links) if link.name == active)
        better = {item.name: parse.link_status(results[f"look {item.name}"], item.name) for item in links[:place]}
        up = [
            name
            for name, status in better.items()
            if not isinstance(status, LinkFinding) and _state(status) is LinkState.UP
        ]
        unseen = [name for name, status in better.items() if isinstance(status, LinkFinding) or _state(status) is None]
        cost_note = ", which is metered" if links[place].metered else ""
        if (use := _temporary_use_finding(results[f"look {active}"], active)) is not None:
            return parse.warn(
                "in-use-for-a-time",
                msg(f"traffic leaves by {arg(active)}{arg(cost_note)}: {arg(use['message'])}"),
                use["hint"],
            )
        if up:
            return self._not_best_finding(active, cost_note, up)
        if unseen:
            message = msg(
                f"traffic leaves by {arg(active)}{arg(cost_note)}; the state of {arg(parse.join_words(unseen))}, which "
                "is better, is unknown"
            )
            return parse.unknown(
                "better-unknown",
                message,
                msg(f"check `provision links site={arg(self.site.name)}` when the devices respond again"),
            )
        why = msg(f", because {arg(parse.join_words(better))} is not up" if better else "")
        return parse.good("by-the-bearer-that-is-meant", msg(f"traffic leaves by {arg(active)}{arg(why)}"))

    def _not_best_finding(self, active: str, cost_note: str, up: list[str]) -> LinkFinding:
        message = msg(f"traffic leaves by {arg(active)}{arg(cost_note)}, although {arg(up[0])} is up and better")
        wait = self.site.site_config.failover.fail_back_s
        hint = msg(
            f"a better link is used again after {arg(wait)} s without interruption: wait that long, then apply the "
            "site's configuration"
        )
        return (
            parse.fail("metered-by-mistake", message, hint) if cost_note else parse.warn("not-the-best", message, hint)
        )

    def _judge_gateway(self, results: Mapping[str, base.Answer]) -> tuple[LinkFinding, ...]:
        gateway = self.site.gateway
        if gateway is None:
            return ()
        result = parse.parse_json_list(results["gateway"], gateway.name, "its default route")
        if isinstance(result, LinkFinding):
            return (result,)
        return tuple(_judge_computer_routes(gateway.name, str(self.site.site_config.lan.gateway), result))


def _temporary_use_finding(look: base.Answer, active: str) -> Mapping[str, str] | None:
    """Return the finding about a link that is temporarily used instead of the inventory's order."""
    status = parse.link_status(look, active)
    findings = () if isinstance(status, LinkFinding) else status.get("findings") or ()
    return next((finding for finding in findings if finding.get("code") == IN_USE), None)


def _no_route_finding(site: str, foreign: Sequence[Mapping[str, str]]) -> LinkFinding:
    if foreign:
        message = msg(
            f"the default route of the router leads to {arg(foreign[0].get('gateway', '?'))}, which is not a link of "
            f"{arg(site)}"
        )
        return parse.fail(
            "foreign-route",
            message,
            "remove that route on the router, or apply the site's configuration, which restores its own route",
        )
    hint = msg(
        f"check with `provision links site={arg(site)}` that a link is up; then apply the site's configuration, which "
        "restores its routes"
    )
    return parse.fail("no-default-route", "the router has no active default route: nothing leaves the site", hint)


def _is_broad(text: str) -> bool:
    """Return whether a network is half a default route: VPN clients set two (openvpn(8), redirect-gateway)."""
    try:
        return 0 < IPv4Network(text).prefixlen < _BROAD
    except ValueError:
        return False


def _find_broad_route(rows: Sequence[Mapping[str, str]]) -> Iterator[LinkFinding]:
    there = next((row for row in rows if _in_force(row) and _is_broad(row.get("dst-address", ""))), None)
    if there is not None:
        message = msg(
            f"the router sends {arg(there['dst-address'])} to {arg(there.get('gateway', '?'))}, before its default "
            "route"
        )
        yield parse.fail(
            "broader-route", message, "remove that route on the router, then apply the site's configuration"
        )


def _in_force(row: Mapping[str, str]) -> bool:
    """Return whether a route is active in the main table; routes in the links' own tables are always active."""
    return row.get("active") in {"true", "yes"} and row.get("routing-table", "main") == "main"


def _route_text(row: Mapping[str, str]) -> str:
    return msg(f"{arg(row.get('gateway', '?'))}, distance {arg(row.get('distance', '?'))}")


def _state(status: Mapping[str, Any]) -> LinkState | None:
    """Return the link's state; None if unknown."""
    state = status.get("state")
    return None if state in {None, LinkState.UNKNOWN.value} else LinkState(state) if state in set(LinkState) else None


def _metric(row: Mapping[str, Any]) -> int:
    value = row.get("metric", 0)
    return value if isinstance(value, int) else 0


def _is_dead(row: Mapping[str, Any]) -> bool:
    """Return whether the kernel flags a route's interface as having no link."""
    flags = row.get("flags")
    return isinstance(flags, list) and not _DEAD.isdisjoint(map(str, flags))


def _judge_computer_routes(name: str, router: str, routes: Sequence[Mapping[str, Any]]) -> Iterator[LinkFinding]:
    hint = msg(
        f"set the default route of {arg(name)} only to {arg(router)}: `provision` writes it if `network:` is set"
    )
    ways = sorted((row for row in routes if row.get("dst") == "default" and not _is_dead(row)), key=_metric)
    broad = next((route for route in routes if _is_broad(str(route.get("dst", "")))), None)
    if broad is not None:
        message = msg(
            f"{arg(name)} sends {arg(broad['dst'])} to {arg(broad.get('gateway', broad.get('dev', '?')))}, before its "
            "default route"
        )
        yield parse.fail("gateway-broader-route", message, hint)
        return
    if not ways:
        yield parse.fail("gateway-no-route", msg(f"{arg(name)} has no default route"), hint)
        return
    via, first = ways[0].get("gateway", "nobody"), _metric(ways[0])
    others = [item.get("gateway", "nobody") for item in ways[1:] if item.get("gateway") != router]
    if via != router:
        yield parse.fail(
            "gateway-wrong-route",
            msg(f"the default route of {arg(name)} leads to {arg(via)}, not to the router {arg(router)}"),
            hint,
        )
    elif others and any(_metric(way) == first for way in ways[1:]):
        yield parse.fail(
            "gateway-two-routes",
            msg(f"{arg(name)} has two default routes, to {arg(router)} and to {arg(others[0])}"),
            hint,
        )
    elif others:
        yield parse.warn(
            "gateway-spare-route",
            msg(f"{arg(name)} has a second default route, to {arg(others[0])}, with lower priority than the right one"),
            hint,
        )
    else:
        yield parse.good(
            "gateway-by-the-router", msg(f"the default route of {arg(name)} leads to the router {arg(router)}")
        )


_TARGET = ("dst-address", "dst-port", "protocol", "dst-address-list")
"""Properties with which a declared rule says which destinations it permits."""
_NO_MATCHERS = frozenset(
    {"chain", "action", "comment", "disabled", "jump-target", "log", "log-prefix", "reject-with", "hw-offload"}
    | {"address-list", "address-list-timeout"}
)
_MATCHERS = tuple(field.name for field in MENUS["/ip/firewall/filter"].fields if field.name not in _NO_MATCHERS)
"""Every property by which a rule matches only some packets: one that is not read may be a hole."""
_RULE = ("chain", "action", "disabled", "invalid", "jump-target", *_MATCHERS)
_RUN = "apply the site's configuration before anything else: every byte that passes costs money"


def satellite_filter_check(site: parse.OwnSite) -> base.Step:
    """Return the step on the router's filter rules, and their counts of dropped packets."""
    satellites = site.view.satellites if site.view is not None else ()
    unless = "" if satellites else "the site has no satellite"
    boxes = tuple(
        link.device for link in site.site_config.bearers if link.device and link.name in {up.name for up in satellites}
    )
    return parse.step(
        "satellite-filter",
        "The router has the satellite allow-list",
        _Filter(site),
        (*site.hosts[:1], *boxes),
        unless,
    )


@dataclass(frozen=True, slots=True)
class _Filter:
    """Check that the satellite's allow-list is in the router."""

    site: parse.OwnSite

    @property
    def _satellites(self) -> tuple[Uplink, ...]:
        assert self.site.view is not None  # noqa: S101 - the check is made for sites with a router
        return self.site.view.satellites

    def asks(self) -> tuple[base.Question, ...]:
        names = {satellite.name for satellite in self._satellites}
        looks = (question for question in parse.link_requests(self.site) if question.link in names)
        return (*parse.ask("rules", self.site, "/ip/firewall/filter", *_RULE), *looks)

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        assert self.site.router is not None  # noqa: S101 - the check is made for sites with a router
        result = parse.rows(results["rules"], self.site.router.name, "its firewall", "chain")
        if isinstance(result, LinkFinding):
            return base.ProbeResult((result,))
        rules = [row for row in result if not parse.yes(row, "disabled") and not parse.yes(row, "invalid")]
        wrong = [finding for entry in self._satellites for finding in _judge_rules(entry, rules)]
        fine = [self._success_finding(item, results) for item in self._satellites]
        evidence = [
            parse.declared_evidence(
                msg(f"allowed over {arg(uplink.name)}"),
                parse.join_words(
                    msg(f"{arg(target.name)} ({arg(_format_endpoint(target))})") for target in uplink.targets
                ),
            )
            for uplink in self._satellites
        ]
        evidence += [
            parse.read(
                msg(f"rules of chain {arg(satellite.chain)}"),
                str(sum(row.get("chain") == satellite.chain for row in rules)),
            )
            for satellite in self._satellites
        ]
        return base.ProbeResult(tuple(wrong or fine), tuple(evidence))

    def _success_finding(self, satellite: Uplink, results: Mapping[str, base.Answer]) -> LinkFinding:
        """Return the passing finding; it does not need the counters, because the rules were read."""
        values = parse.link_status(results[f"look {satellite.name}"], satellite.name)
        quality = {} if isinstance(values, LinkFinding) else values.get("quality") or {}
        count = quality.get("kept_off_packets")
        count_note = msg(f", and has blocked {arg(count)} packets so far" if isinstance(count, int) else "")
        target_names = parse.join_words(dict.fromkeys(target.name for target in satellite.targets)) or "nobody"
        return parse.good(
            "stands",
            msg(
                f"the allow-list of {arg(satellite.name)} passes {arg(target_names)} and nothing else{arg(count_note)}"
            ),
        )


def _format_endpoint(target: Any) -> str:  # noqa: ANN401 - a Target of the view
    return target.address if target.port is None else f"{target.address}:{target.port}/{target.transport}"


def _judge_rules(satellite: Uplink, rules: Sequence[Mapping[str, str]]) -> Iterator[LinkFinding]:
    for chain in ("forward", "output"):
        yield from _jump_findings(satellite, [row for row in rules if row.get("chain") == chain], chain)
    local = [row for row in rules if row.get("chain") == satellite.chain]
    if not local or local[-1].get("action") != "drop" or _narrow(local[-1]):
        yield parse.fail(
            "not-dropped",
            msg(f"chain {arg(satellite.chain)} does not end with a rule that drops everything else"),
            _RUN,
        )
    expected_targets = {(item.address, str(item.port or ""), item.transport or "") for item in satellite.targets}
    letting = [row for row in local if row.get("action") not in _HOLDS]
    there = {_target(row) for row in letting}
    whole = {_target(row) for row in letting if not _narrow(row, _TARGET)}
    for target in sorted(there - expected_targets):
        message = msg(f"the allow-list of {arg(satellite.name)} also passes {arg(_target_text(target))}")
        hint = "add it under `allow:` if it is intended; otherwise apply the site's configuration, which removes it"
        yield parse.fail("too-wide", message, hint)
    for target in sorted(expected_targets - whole):
        message = msg(f"the allow-list of {arg(satellite.name)} does not pass {arg(_target_text(target))}")
        yield parse.fail("too-narrow", message, "apply the site's configuration, which restores the rule")


def _jump_findings(satellite: Uplink, rules: Sequence[Mapping[str, str]], chain: str) -> Iterator[LinkFinding]:
    """Yield findings unless all outgoing traffic reaches the allow-list before another rule accepts it."""
    place = next((place for place, row in enumerate(rules) if _is_jump_to(row, satellite)), None)
    if place is None:
        message = msg(
            f"traffic over {arg(satellite.name)} is not checked: chain {arg(chain)} has no rule that leads to"
        )
        yield parse.fail("not-asked", f"{message} {satellite.chain}", _RUN)
    elif any(_accepts(row, satellite) for row in rules[:place]):
        message = msg(
            f"a rule of chain {arg(chain)} accepts packets for {arg(satellite.name)} before its allow-list is checked"
        )
        yield parse.fail("bypassed", message, _RUN)


def _accepts(row: Mapping[str, str], satellite: Uplink) -> bool:
    """Return whether a rule lets traffic bypass the list; traffic to the terminal itself costs no airtime."""
    elsewhere = row.get("out-interface", satellite.port) != satellite.port
    terminal = _is_inside(row.get("dst-address", ""), satellite.network)
    return row.get("action") in {"accept", "fasttrack-connection"} and not elsewhere and not terminal


def _is_inside(text: str, network: str) -> bool:
    try:
        return IPv4Network(text).subnet_of(IPv4Network(network))
    except ValueError:
        return False


def _target(row: Mapping[str, str]) -> tuple[str, str, str]:
    leads = row.get("action") == "jump"
    anywhere = msg(f"what chain {arg(row.get('jump-target', '?'))} passes" if leads else "any address")
    return row.get("dst-address", anywhere), row.get("dst-port", ""), row.get("protocol", "")


def _target_text(target: tuple[str, str, str]) -> str:
    address, port, protocol = target
    return address + msg(f" port {arg(port)}" if port else "") + msg(f" ({arg(protocol)})" if protocol else "")


_HOLDS = frozenset(
    {"drop", "reject", "tarpit", "log", "passthrough", "add-src-to-address-list", "add-dst-to-address-list"}
)
"""Actions that let nothing through by themselves."""


def _is_jump_to(row: Mapping[str, str], satellite: Uplink) -> bool:
    leads = row.get("action") == "jump" and row.get("jump-target") == satellite.chain
    return leads and row.get("out-interface") == satellite.port and not _narrow(row, ("out-interface",))


def _narrow(row: Mapping[str, str], but: tuple[str, ...] = ()) -> bool:
    """Return whether a rule matches only part of the traffic, by a matcher other than `but`."""
    return any(row.get(name) for name in _MATCHERS if name not in but)
