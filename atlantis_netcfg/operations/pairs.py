"""Which declared CPEs are the two ends of one radio bridge, and which of them is near to where the technician stands.

The near end is reached without the bridge: over the technician's cable (`lan`), or over a bearer that is not the
bridge itself. The far end is reached through the near one's radio. Both are changed as one (`routeros.pair`), also
where only one of them was asked for.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.declaration.model import BearerKind, Cpe
from atlantis_netcfg.operations.bearers import LAN, as_bearer
from atlantis_netcfg.routeros.pair import Pair, Signal

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from atlantis_netcfg.declaration import Declaration, Host
    from atlantis_netcfg.routeros.apply import DeviceJob
    from atlantis_netcfg.routeros.estimate import Bearer

__all__ = ["Bridge", "bridges", "far_bearer", "pair_of", "with_other_ends"]


@dataclass(frozen=True, slots=True)
class Bridge:
    """Two CPEs that name each other."""

    near: Host
    far: Host

    @property
    def ends(self) -> tuple[Host, Host]:
        """Near end first."""
        return self.near, self.far


def with_other_ends(declaration: Declaration, hosts: Sequence[Host]) -> tuple[Host, ...]:
    """Return the hosts, and the other ends of all bridges that one of them is an end of, wherever they stand."""
    names = [host.name for host in hosts]
    ends = [end for pair in _ends(declaration, names) for end in pair]
    return tuple({host.name: host for host in (*hosts, *ends)}.values())


def pair_of(bridge: Bridge, near: DeviceJob, far: DeviceJob) -> Pair:
    """Make one member of a run of two jobs; each end has to be heard within the bounds that both declare."""
    ptps = [end.device.ptp for end in bridge.ends if isinstance(end.device, Cpe)]
    signal = Signal(
        weakest_dbm=max(ptp.signal.weakest_dbm for ptp in ptps),
        strongest_dbm=min(ptp.signal.strongest_dbm for ptp in ptps),
    )
    return Pair(near, far, link_timeout_s=max(ptp.link_timeout_s for ptp in ptps), signal=signal)


def far_bearer(declaration: Declaration, bridge: Bridge, near: DeviceJob) -> Bearer | None:
    """What a session to the far end runs over: the near end's bearer and the bridge, of which the slower one counts."""
    if near.bearer is not None and near.bearer.name != LAN.name:
        return near.bearer
    names = {end.name for end in bridge.ends}
    bearers = (bearer for site in declaration.sites.values() for bearer in site.bearers)
    return next((as_bearer(one) for one in bearers if one.kind == BearerKind.WIFI_PTP and one.device in names), None)


def bridges(
    declaration: Declaration, names: Sequence[str], via: Mapping[str, str] | None = None, standing: str | None = None
) -> tuple[Bridge, ...]:
    """Return the bridges of which an end is among the hosts `names`; both ends, wherever the other one is declared.

    `via`: host name to the bearer in use, where it differs from the declared one. `standing`: the site at which the
    technician is, which decides where both ends are declared to be reached by cable. Raises UsageError if nothing does.
    """
    found = []
    for one, other in _ends(declaration, names):
        near = _near(declaration, (one, other), via or {}, standing)
        found.append(Bridge(near, other if near is one else one))
    return tuple(found)


def _ends(declaration: Declaration, names: Sequence[str]) -> Iterator[tuple[Host, Host]]:
    """Yield each bridge once, in the order of the declaration."""
    done: set[str] = set()
    for host in declaration.hosts.values():
        peer = declaration.hosts.get(host.device.ptp.peer) if isinstance(host.device, Cpe) else None
        if peer is None or host.name in done or not {host.name, peer.name} & set(names):
            continue
        done |= {host.name, peer.name}
        yield host, peer


def _near(declaration: Declaration, ends: tuple[Host, Host], via: Mapping[str, str], standing: str | None) -> Host:
    direct = [end for end in ends if not _over_a_bridge(declaration, end, via)]
    if len(direct) == 1:
        return direct[0]
    here = [end for end in direct if end.site == standing]
    if len(here) == 1:
        return here[0]
    one, other = (end.name for end in ends)
    if not direct:
        raise UsageError(f"{one} and {other} are both to be reached over the bridge that they make", hint=_hint(ends))
    raise UsageError(f"{one} and {other} are ends of one bridge, and either may be the near one", hint=_hint(ends))


def _hint(ends: tuple[Host, Host]) -> str:
    return f"name the site where you stand ({' or '.join(dict.fromkeys(end.site for end in ends))}), or say via="


def _over_a_bridge(declaration: Declaration, end: Host, via: Mapping[str, str]) -> bool:
    assert isinstance(end.device, Cpe)  # noqa: S101 - `_ends` gives no others
    name = via.get(end.name, end.device.access.via)
    bearers = [bearer for site in declaration.sites.values() for bearer in site.bearers if bearer.name == name]
    return name != LAN.name and any(bearer.kind == BearerKind.WIFI_PTP for bearer in bearers)
