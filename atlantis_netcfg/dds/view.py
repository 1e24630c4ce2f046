"""What the templates see of a participant: words and numbers, a pure function of the declaration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.dds.tuning import ANNOUNCEMENT_BYTES, TUNING, Tuning
from atlantis_netcfg.dds.versions import RELEASES, Release
from atlantis_netcfg.declaration.model import ControlCentre, Dds, DdsPath, Gateway

if TYPE_CHECKING:
    from atlantis_netcfg.declaration import Declaration, Host
    from atlantis_netcfg.declaration.model import BearerKind

__all__ = ["ProfileView", "profile_views"]

_DAY_S = 24 * 3600
_SPEAKERS = (Gateway, ControlCentre)


@dataclass(frozen=True, slots=True)
class ProfileView:
    """One computer on one link."""

    host: str
    bearer: str
    """The link's name."""
    release: Release
    middleware: str
    domain: int
    address: str
    """Of the interface, by which every version finds it: tun0 has another name on another computer."""
    peers: tuple[tuple[str, str], ...]
    """Name and address; the computer itself is one, so that its own processes find each other."""
    participants: int
    lease_s: int
    tuning: Tuning

    @property
    def announced_mb_a_day(self) -> float:
        """What one ROS process sends to stay known, in 10^6 bytes a day: reckoned, not measured on this link."""
        others = len(self.peers) - 1
        return others * self.participants * ANNOUNCEMENT_BYTES * _DAY_S / self.tuning.announce_s / 1e6


@dataclass(frozen=True, slots=True)
class _Participant:
    """A computer of the pilot that talks DDS."""

    name: str
    address: str
    site: str | None
    """None: anywhere."""
    everywhere: bool
    """A control centre, whom everybody has to find."""


def profile_views(declaration: Declaration, host: Host, release: str | None = None) -> tuple[ProfileView, ...]:
    """One view for each link of the host's site, in order of preference.

    `release` overrides the declared distribution. Raises UsageError where nothing is declared or the host talks no DDS.
    """
    dds = _declared(declaration)
    if not isinstance(host.device, Gateway | ControlCentre):
        there = ", ".join(item.name for item in declaration.hosts.values() if isinstance(item.device, _SPEAKERS))
        raise UsageError(f"`{host.name}` is a {host.device.kind}: it talks no DDS", hint=f"those that do: {there}")
    chosen = _release(release or dds.distribution)
    all_of_them = _participants(declaration, dds)
    local = next(entry for entry in all_of_them if entry.name == host.name)
    peers = [one for one in all_of_them if local.everywhere or one.everywhere or one.site in {None, host.site}]
    return tuple(
        ProfileView(
            host=host.name,
            bearer=bearer.name,
            release=chosen,
            middleware=dds.middleware,
            domain=dds.domain,
            address=local.address,
            peers=tuple((participant.name, participant.address) for participant in peers),
            participants=dds.participants,
            lease_s=dds.lease_s,
            tuning=_tuning(declaration, bearer.kind, {peer.site for peer in peers} - {host.site}),
        )
        for bearer in declaration.sites[host.site].bearers
    )


def _tuning(declaration: Declaration, kind: BearerKind, sites: set[str | None]) -> Tuning:
    """Of the slowest link on the way: what a control centre announces, a vessel receives over its satellite."""
    far = {bearer.kind for name, site in declaration.sites.items() if name in sites for bearer in site.bearers}
    return max((TUNING[bearer_kind] for bearer_kind in {kind, *far}), key=lambda tuning: tuning.announce_s)


def _declared(declaration: Declaration) -> Dds:
    if declaration.pilot.dds is None:
        raise UsageError("the pilot declares no DDS", hint="write `dds: {distribution: foxy}` below `pilot:`")
    return declaration.pilot.dds


def _release(name: str) -> Release:
    if name not in RELEASES:
        raise UsageError(f"`{name}` is no release that is known here", hint=f"there are: {', '.join(RELEASES)}")
    return RELEASES[name]


def _participants(declaration: Declaration, dds: Dds) -> list[_Participant]:
    """Hosts, then the peers that are declared; in LANs also the vehicles that have a reservation there."""
    found = [
        _Participant(name, dds.address_of(host.device), host.site, isinstance(host.device, ControlCentre))
        for name, host in declaration.hosts.items()
        if isinstance(host.device, _SPEAKERS)
    ]
    found += [_Participant(peer.name, str(peer.address), peer.site, everywhere=False) for peer in dds.peers]
    if dds.over is DdsPath.LAN:
        known = {participant.address for participant in found}
        found += [
            _Participant(reservation.name, str(reservation.address), name, everywhere=False)
            for name, site in declaration.sites.items()
            for reservation in site.lan.reservations
            if reservation.name in declaration.vehicles and str(reservation.address) not in known
        ]
    return found
