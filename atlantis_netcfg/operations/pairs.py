"""Which declared CPEs are the two ends of one radio bridge, and which of them is near to where the technician stands.

The near end is reached without the bridge: over the technician's cable (`lan`), or over a bearer that is not the
bridge itself. The far end is reached through the near one's radio. CPEs have no templates yet; whoever renders their
texts makes two jobs of a `Bridge` and hands them to the engine as `routeros.pair.Pair`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.errors import UsageError
from atlantis_netcfg.operations.bearers import LAN
from atlantis_netcfg.site.model import BearerKind, Cpe

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from atlantis_netcfg.site import Declaration, Host

__all__ = ["Bridge", "bridges"]


@dataclass(frozen=True, slots=True)
class Bridge:
    """Two CPEs that name each other."""

    near: Host
    far: Host


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
