"""Standing traffic of each link of a site, from inventory and rendered configuration, and its budget.

`links.standing_traffic` has the arithmetic. This file lists who communicates with whom:

- the router pings the probe targets of its links; it and each gateway query the time servers;
- the router and each gateway have a tunnel, and so has each computer of `dds.peers` at this site;
- each computer that uses DDS announces itself to its peers, and they to it, unless DDS is kept off the link. Traffic
  between two computers of one site through the VPN crosses the link twice. A peer that is no host of the inventory is
  assumed to announce itself as the computers here do;
- the vehicles tested at the site publish the `telemetry` of the inventory to every control centre. Over a link that
  DDS is kept off, only if a computer of `dds.peers` works here: its own tunnel is unknown to the router's firewall;
- the site of the VPN server carries the traffic of all other sites, as if all of it used each of its links.

Not included: partners' tunnels that only the VPN's ledger knows, and traffic caused by people.
"""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.computers.dds import profile_in_use
from atlantis_netcfg.computers.dds_link import links_without_dds
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, conjunction, msg
from atlantis_netcfg.inventory import Finding, model
from atlantis_netcfg.inventory.rules.satellite import BUDGET_HINT
from atlantis_netcfg.links import LinkFinding
from atlantis_netcfg.links.cost import size
from atlantis_netcfg.links.standing_traffic import (
    MONTH_DAYS,
    LinkPace,
    StandingFlow,
    StandingTraffic,
    SteadyTopic,
    TrafficSource,
    keep_alive,
    ntp_traffic,
    probe_targets,
    sum_by_source,
    topic_flow,
)
from atlantis_netcfg.operations.common.site_links import links_of
from atlantis_netcfg.routeros.render import router_view
from atlantis_netcfg.vpn import identity
from atlantis_netcfg.vpn.client import site_link

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from atlantis_netcfg.computers.dds import ProfileView
    from atlantis_netcfg.inventory import Inventory
    from atlantis_netcfg.routeros.render.view import Uplink

_CHECK_GATEWAY_S: Final = 10.0
"""Interval of `check-gateway=ping` in seconds, on links without cost (MikroTik manual, IP Routing)."""
_LONGEST_POLL_S: Final = 1024.0
"""Longest interval of NTP requests with a steady clock: `max-poll` 10 of RouterOS and of chrony."""


def standing_traffic(inventory: Inventory, site: str) -> tuple[StandingTraffic, ...]:
    """Return the standing traffic of each link of a site, in order of preference."""
    links = links_of(inventory, site)
    uplinks = _uplinks(inventory, site)
    probe_flows, budgets = _of_probe_targets(uplinks), dict(_budgets(inventory, site, uplinks))
    return tuple(
        StandingTraffic(
            links[link.name],
            sum_by_source((*probe_flows.get(link.name, ()), *_shared_flows(inventory, site, link))),
            budgets.get(link.name, ""),
        )
        for link in inventory.sites[site].bearers
    )


def _uplinks(inventory: Inventory, site: str) -> tuple[Uplink, ...]:
    router = inventory.router_of(site)
    return router_view(inventory, router).uplinks if router is not None else ()


def _budgets(inventory: Inventory, site: str, uplinks: Iterable[Uplink]) -> Iterator[tuple[str, str]]:
    """Yield each link with a probe budget, and a text on how its probes keep to it."""
    budgets = {link.name: link.probe_target_budget_bytes for link in inventory.sites[site].bearers}
    for uplink in uplinks:
        probe_plan, budget = uplink.probing, budgets[uplink.name]
        if probe_plan is not None and probe_plan.unsteady_bytes is not None and budget is not None:
            month = size(MONTH_DAYS * probe_plan.daily_bytes)
            words = msg(
                f"each probe target is pinged every {arg(probe_plan.watch_s):.0f} s: {arg(month)} of its "
                f"{arg(size(round(budget)))} a month in the inventory; on a day when the link is unstable, up to "
                f"{arg(size(probe_plan.unsteady_bytes))}"
            )
            yield uplink.name, words


def _of_probe_targets(uplinks: Iterable[Uplink]) -> dict[str, tuple[StandingFlow, ...]]:
    """Return the probe traffic of each link."""
    result: dict[str, tuple[StandingFlow, ...]] = {}
    for uplink in uplinks:
        if uplink.probing is not None:
            asking = [probe_targets(len(uplink.probe_targets), uplink.probing.watch_s)]
            if uplink.probing.has_gateway_check:
                asking.append(probe_targets(len(uplink.probe_targets), _CHECK_GATEWAY_S))
            result[uplink.name] = tuple(asking)
    return result


def _shared_flows(inventory: Inventory, site: str, link: model.Link) -> Iterator[StandingFlow]:
    """Yield the traffic that uses the active link; `link`: reliable topics depend on its speed."""
    clients = [
        host
        for host in inventory.site_hosts(site)
        if isinstance(host.device, model.Router | model.Switch | model.Gateway)
    ]
    yield from (ntp_traffic(len(inventory.pilot.time_servers), _LONGEST_POLL_S) for _ in clients)
    if inventory.hosts[inventory.pilot.vpn.server].site != site:
        yield from _through_the_vpn(inventory, site, link)
        return
    for name, other in inventory.sites.items():
        if name != site:
            without = links_without_dds(inventory, name)
            slowest = max(other.bearers, key=lambda each: (each.name not in without, each.rate.rtt_ms))
            yield from (flow.mirror() for flow in _through_the_vpn(inventory, name, slowest))


def _through_the_vpn(inventory: Inventory, site: str, link: model.Link) -> Iterator[StandingFlow]:
    """Yield the traffic of a site's tunnels, and the traffic through them over a link."""
    crosses = link.name not in links_without_dds(inventory, site)
    computers, foreign = _computers(inventory, site), _foreign(inventory, site)
    senders = [computer for computer in computers if crosses or computer[0] in foreign]
    announcements = tuple(_announcements(inventory, computers, senders))
    yield from announcements
    if senders:
        yield _telemetry(inventory, site, computers[0][1], declared_pace(link))
    ping_s = identity.TIMERS[site_link(inventory, site)][0]
    over_lan = inventory.pilot.dds is not None and inventory.pilot.dds.over is model.DdsPath.LAN
    router = inventory.router_of(site)
    every_s = computers[0][1].tuning.announce_s if announcements else None
    idle = keep_alive(ping_s, identity.RENEGOTIATION_S, None, None)
    busy = keep_alive(ping_s, identity.RENEGOTIATION_S, every_s, every_s)
    if router is not None and isinstance(router.device, model.Router) and router.device.vpn_client is not None:
        own_s = every_s if over_lan else None
        yield keep_alive(ping_s, identity.ROUTEROS_RENEGOTIATION_S, own_s, own_s)
    gateways = [host for host in inventory.site_hosts(site) if getattr(host.device, "vpn_address", None) is not None]
    yield from (busy if crosses and not over_lan else idle for _ in gateways)
    yield from (busy for _ in foreign if not over_lan)


def _computers(inventory: Inventory, site: str) -> list[tuple[str, ProfileView]]:
    """Return address and profile of each computer of a site that uses DDS through the VPN."""
    if inventory.pilot.dds is None:
        return []
    hosts = [
        host for host in inventory.site_hosts(site) if isinstance(host.device, model.Gateway | model.ControlCentre)
    ]
    computers = [(view.address, view) for view in (profile_in_use(inventory, host) for host in hosts)]
    return computers + [(address, computers[0][1]) for address in _foreign(inventory, site) if computers]


def _foreign(inventory: Inventory, site: str) -> list[str]:
    """Return the addresses of a site's computers that are not in the inventory."""
    dds = inventory.pilot.dds
    return [str(peer.address) for peer in dds.peers if peer.site == site] if dds is not None else []


def _announcements(
    inventory: Inventory, computers: list[tuple[str, ProfileView]], senders: list[tuple[str, ProfileView]]
) -> Iterator[StandingFlow]:
    """Yield the announcements, both ways, between each sender and its peers."""
    here = {address for address, _ in computers}
    for address, view in senders:
        for name, peer in view.peers:
            outgoing, refusal_bytes = _pair(view, peer)
            if peer in here and peer != address and view.over is model.DdsPath.VPN:
                yield StandingFlow(TrafficSource.DDS, outgoing + refusal_bytes, outgoing + refusal_bytes)
            elif peer not in here and not (view.over is model.DdsPath.LAN and name in inventory.vehicles):
                host = inventory.hosts.get(name)
                incoming, refused_here = _pair(view, peer)
                if host is not None:
                    incoming, refused_here = _pair(profile_in_use(inventory, host), address)
                yield StandingFlow(TrafficSource.DDS, outgoing + refused_here, incoming + refusal_bytes)


def _pair(view: ProfileView, peer: str) -> tuple[float, float]:
    """Return a computer's bytes a day to another one, and the bytes of errors returned for closed ports.

    To a computer that is not its peer it only sends the traffic to discovered participants, whose ports are open.
    """
    announcing = view.announcing
    if all(address != peer for _, address in view.peers):
        announcing = replace(announcing, ports=0)
    return announcing.announcement_bytes(1, view.vpn), announcing.refusal_bytes(1, view.vpn)


def _telemetry(inventory: Inventory, site: str, view: ProfileView, pace: LinkPace) -> StandingFlow:
    """Return the traffic of vehicles tested at a site, published to each control centre."""
    vehicle_names = inventory.sites[site].checklist.vehicles
    topics = [
        steady(item)
        for key, vehicle in inventory.vehicles.items()
        if vehicle_names is None or key in vehicle_names
        for item in vehicle.telemetry
    ]
    costs = ((topic.rate_hz, view.messages.cost(topic, pace)) for topic in topics)
    return topic_flow(costs, control_centres(inventory))


def publishing_profile(inventory: Inventory, site: str) -> ProfileView | None:
    """Return the profile used to count a site's telemetry: its first DDS computer's; None if it has none."""
    computers = _computers(inventory, site)
    return computers[0][1] if computers else None


def control_centres(inventory: Inventory) -> int:
    """Return the number of control centres, each of which subscribes to every topic."""
    return sum(isinstance(host.device, model.ControlCentre) for host in inventory.hosts.values())


def steady(item: model.TelemetryTopic) -> SteadyTopic:
    """Convert a topic of the inventory to a steady topic."""
    return SteadyTopic(item.rate_hz, item.size_bytes, item.reliable)


def declared_pace(link: model.Link) -> LinkPace:
    """Return a link's speed as given in the inventory."""
    return LinkPace(link.rate.rtt_ms / 1000, link.rate.up_kbps * 1000)


def over_budget(link: model.Link, traffic: StandingTraffic) -> LinkFinding | None:
    """Return a finding if a link's standing traffic exceeds its budget; None if it does not, or is free."""
    if link.metered and not link.has_standing_budget and traffic.month_bytes:
        return _missing_budget_finding(link, traffic)
    budgets = []
    if link.standing_budget_mb is not None and traffic.month_bytes > link.standing_budget_mb * 1_000_000:
        budgets.append(msg(f"{arg(link.standing_budget_mb):g} MB (`standing_budget_mb`)"))
    price, most = traffic.bill.price, link.standing_budget_eur
    if most is not None and price is not None and price > Decimal(str(most)):
        budgets.append(msg(f"{arg(most):g} EUR (`standing_budget_eur`)"))
    if not budgets:
        return None
    message = msg(
        f"{arg(size(traffic.month_bytes))} of background traffic a month over {arg(link.name)} "
        f"({arg(traffic.bill.money)}) exceeds its budget of {arg(conjunction(budgets))}"
    )
    hint = "set fewer `processes`, `participants` or `peers` under `dds:`, slower `telemetry:`, or a larger budget"
    return LinkFinding(Verdict.WARN, "standing-over-budget", message, hint)


def _missing_budget_finding(link: model.Link, traffic: StandingTraffic) -> LinkFinding:
    amount = msg(f"{arg(size(traffic.month_bytes))} a month ({arg(traffic.bill.money)})")
    message = msg(f"no budget in the inventory for background traffic over {arg(link.name)}: {arg(amount)}")
    return LinkFinding(Verdict.WARN, "no-standing-budget", message, BUDGET_HINT)


def inventory_warnings(inventory: Inventory) -> tuple[Finding, ...]:
    """Return the inventory's warnings and every link over its budget, sorted by position."""
    findings = list(inventory.warnings)
    for name, site in inventory.sites.items():
        for link, traffic in zip(site.bearers, standing_traffic(inventory, name), strict=True):
            over = over_budget(link, traffic) if link.has_standing_budget else None
            if over is not None:
                findings.append(Finding.at(inventory.places[name, link.name], over.message, over.hint or ""))
    return tuple(sorted(findings))
