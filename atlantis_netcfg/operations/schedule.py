"""What one run consists of: single devices, bridges of two ends, and what has to be done before what."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.declaration.model import Router
from atlantis_netcfg.journal import Store
from atlantis_netcfg.operations.pairs import bridges

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.declaration import Declaration, Host
    from atlantis_netcfg.operations.pairs import Bridge
    from atlantis_netcfg.operations.request import Request

__all__ = ["Member", "members_of"]


@dataclass(frozen=True, slots=True)
class Member:
    """A device, or the two ends of a bridge (near end first)."""

    hosts: tuple[Host, ...]
    bridge: Bridge | None = None
    after: tuple[str, ...] = ()
    """Routers of the run through which the way to it leads: they are changed before."""


def members_of(declaration: Declaration, names: Sequence[str], request: Request) -> tuple[Member, ...]:
    """Return what the hosts `names` are in a run; the other end of a bridge comes along, wherever it stands.

    Raises UsageError if nothing tells which end of a bridge is the near one.
    """
    pairs = bridges(declaration, _bridged(declaration, names, request), request.via, _standing(declaration, names))
    ends = {end.name: pair for pair in pairs for end in pair.ends}
    members: dict[str, Member] = {}
    for name in names:
        pair = ends.get(name)
        hosts = (declaration.hosts[name],) if pair is None else pair.ends
        members.setdefault(hosts[0].name, Member(hosts, pair, _after(declaration, hosts, names, request)))
    return tuple(members.values())


def _standing(declaration: Declaration, names: Sequence[str]) -> str:
    """The site that was asked for is where the technician stands; who asks for more stands at the control centre."""
    sites = {declaration.hosts[name].site for name in names}
    return sites.pop() if len(sites) == 1 else declaration.hosts[declaration.pilot.vpn.server].site


def _bridged(declaration: Declaration, names: Sequence[str], request: Request) -> list[str]:
    """Leave out ends that go alone.

    A replacement gets its state while no bridge is there, and a run that has saved one end only has changed that one.
    """
    if request.restore is not None:
        return []
    if request.back_to is None:
        return list(names)
    store = Store(request.state, rehearsed=request.rehearsed)
    return [
        name
        for name in names
        if all(
            _saved(store, end, request.back_to)
            for pair in bridges(declaration, [name], request.via, declaration.hosts[name].site)
            for end in pair.ends
        )
    ]


def _saved(store: Store, host: Host, run: str) -> bool:
    try:
        return store.run(host.site, run).before(host.name) is not None
    except NetcfgError:
        return False


def _after(declaration: Declaration, hosts: Sequence[Host], names: Sequence[str], request: Request) -> tuple[str, ...]:
    """Whatever hangs on a site's router waits for it, where anything is changed."""
    if request.mode.reads_only or any(isinstance(host.device, Router) for host in hosts):
        return ()
    sites = {host.site for host in hosts}
    asked = (declaration.hosts[name] for name in names)
    return tuple(host.name for host in asked if host.site in sites and isinstance(host.device, Router))
