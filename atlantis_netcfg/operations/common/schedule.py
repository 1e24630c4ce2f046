"""The units of one run: single devices, bridges with their two ends, and their order."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import NetcfgError, UsageError
from atlantis_netcfg.core.messages import alternatives, arg, msg
from atlantis_netcfg.inventory.model import Cpe, Router
from atlantis_netcfg.operations.common.session_link import LAN, as_link
from atlantis_netcfg.routeros.pair import Pair, Signal
from atlantis_netcfg.runs import Store

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.operations.common.request import Request
    from atlantis_netcfg.routeros.apply import DeviceJob
    from atlantis_netcfg.routeros.estimate import LinkMetrics


@dataclass(frozen=True, slots=True)
class Bridge:
    """A bridge: two CPEs that name each other as peer."""

    near: Host
    far: Host

    @property
    def ends(self) -> tuple[Host, Host]:
        """Both ends, the near one first."""
        return self.near, self.far


def with_other_ends(inventory: Inventory, hosts: Sequence[Host]) -> tuple[Host, ...]:
    """Return the hosts, and the other ends of their bridges at any site."""
    names = [host.name for host in hosts]
    ends = [end for pair in _ends(inventory, names) for end in pair]
    return tuple({host.name: host for host in (*hosts, *ends)}.values())


def pair_of(bridge: Bridge, near: DeviceJob, far: DeviceJob) -> Pair:
    """Combine two jobs into one unit of a run; each end's signal must be within the bounds of both."""
    ptps = [end.device.ptp for end in bridge.ends if isinstance(end.device, Cpe)]
    signal = Signal(
        weakest_dbm=max(ptp.signal.weakest_dbm for ptp in ptps),
        strongest_dbm=min(ptp.signal.strongest_dbm for ptp in ptps),
    )
    return Pair(near, far, link_timeout_s=max(ptp.link_timeout_s for ptp in ptps), signal=signal)


def far_link(inventory: Inventory, bridge: Bridge, near: DeviceJob) -> LinkMetrics | None:
    """Return the link that limits a session to the far end: the near end's, or the bridge if the near end is on LAN."""
    if near.link is not None and near.link.name != LAN.name:
        return near.link
    names = {end.name for end in bridge.ends}
    links = (link for site in inventory.sites.values() for link in site.bearers)
    return next((as_link(item) for item in links if item.kind.traits.bridge and item.device in names), None)


def bridges(
    inventory: Inventory, names: Sequence[str], via: Mapping[str, str] | None = None, near_site: str | None = None
) -> tuple[Bridge, ...]:
    """Return the bridges with an end among the hosts `names`; both ends, at whichever site the other one is.

    `via`: link in use by host name, if it differs from the inventory. `near_site`: the site of the technician, which
    decides if the inventory has both ends reached by cable. Raises UsageError if the near end is undecidable.
    """
    bridge_list = []
    for first, second in _ends(inventory, names):
        near = _choose_near_end(inventory, (first, second), via or {}, near_site)
        bridge_list.append(Bridge(near, second if near is first else first))
    return tuple(bridge_list)


def _ends(inventory: Inventory, names: Sequence[str]) -> Iterator[tuple[Host, Host]]:
    """Yield each bridge once, in the order of the inventory."""
    seen_names: set[str] = set()
    for host in inventory.hosts.values():
        peer = inventory.hosts.get(host.device.ptp.peer) if isinstance(host.device, Cpe) else None
        if peer is None or host.name in seen_names or not {host.name, peer.name} & set(names):
            continue
        seen_names |= {host.name, peer.name}
        yield host, peer


def _choose_near_end(
    inventory: Inventory, ends: tuple[Host, Host], via: Mapping[str, str], near_site: str | None
) -> Host:
    direct = [end for end in ends if not _is_over_bridge(inventory, end, via)]
    if len(direct) == 1:
        return direct[0]
    here = [end for end in direct if end.site == near_site]
    if len(here) == 1:
        return here[0]
    first, second = (end.name for end in ends)
    if not direct:
        raise UsageError(
            f"{arg(first)} and {arg(second)} are both reached over the bridge between them", hint=_hint(ends)
        )
    raise UsageError(
        f"{arg(first)} and {arg(second)} are ends of one bridge, and the near one is not known", hint=_hint(ends)
    )


def _hint(ends: tuple[Host, Host]) -> str:
    return msg(
        f"give the site where you are ({arg(alternatives(dict.fromkeys(end.site for end in ends)))}), or use via="
    )


def _is_over_bridge(inventory: Inventory, end: Host, via: Mapping[str, str]) -> bool:
    assert isinstance(end.device, Cpe)  # noqa: S101 - `_ends` gives no others
    name = via.get(end.name, end.device.access.via)
    links = [link for site in inventory.sites.values() for link in site.bearers if link.name == name]
    return name != LAN.name and any(link.kind.traits.bridge for link in links)


@dataclass(frozen=True, slots=True)
class RunUnit:
    """A device, or the two ends of a bridge (near end first)."""

    hosts: tuple[Host, ...]
    bridge: Bridge | None = None
    after: tuple[str, ...] = ()
    """Routers of the run on the route to the device: they are changed first."""


def members_of(inventory: Inventory, names: Sequence[str], request: Request) -> tuple[RunUnit, ...]:
    """Return the run units of the hosts `names`; the other end of a bridge is added, at any site.

    Raises UsageError if it is undecidable which end of a bridge is the near one.
    """
    pairs = bridges(
        inventory, _without_single_ends(inventory, names, request), request.via, _near_site(inventory, names)
    )
    ends = {end.name: pair for pair in pairs for end in pair.ends}
    members: dict[str, RunUnit] = {}
    for name in names:
        pair = ends.get(name)
        hosts = (inventory.hosts[name],) if pair is None else pair.ends
        members.setdefault(hosts[0].name, RunUnit(hosts, pair, _after(inventory, hosts, names, request)))
    return tuple(members.values())


def _near_site(inventory: Inventory, names: Sequence[str]) -> str:
    """Return the technician's assumed site: the only one requested, else the control centre's."""
    sites = {inventory.hosts[name].site for name in names}
    return sites.pop() if len(sites) == 1 else inventory.hosts[inventory.pilot.vpn.server].site


def _without_single_ends(inventory: Inventory, names: Sequence[str], request: Request) -> list[str]:
    """Return the names without bridge ends that are handled alone.

    A replacement device is restored while there is no bridge, and a run that saved one end only changed only that one.
    """
    if request.restore is not None:
        return []
    if request.back_to is None:
        return list(names)
    store = Store(request.state, is_rehearsal=request.rehearsed)
    return [
        name
        for name in names
        if all(
            _has_saved_state(store, end, request.back_to)
            for pair in bridges(inventory, [name], request.via, inventory.hosts[name].site)
            for end in pair.ends
        )
    ]


def _has_saved_state(store: Store, host: Host, run: str) -> bool:
    try:
        return store.run(host.site, run).before(host.name) is not None
    except NetcfgError:
        return False


def _after(inventory: Inventory, hosts: Sequence[Host], names: Sequence[str], request: Request) -> tuple[str, ...]:
    """Return the routers that must finish first: devices behind a site's router wait for it if anything is changed."""
    if request.mode.reads_only or any(isinstance(host.device, Router) for host in hosts):
        return ()
    sites = {host.site for host in hosts}
    selected_hosts = (inventory.hosts[name] for name in names)
    return tuple(host.name for host in selected_hosts if host.site in sites and isinstance(host.device, Router))
