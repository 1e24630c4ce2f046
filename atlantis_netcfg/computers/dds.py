"""Part `gateway_dds`: DDS profiles from the inventory, and the environment of the processes that read them.

Profiles have unicast peers, a lease that outlives gaps of a satellite link, and datagram sizes for each kind of link.
Each DDS implementation has its own profile. Pure: a view is computed from the inventory, and a file from a view; the
templates see the view. `provision robot dds` prints the files.

`RELEASES` lists the middleware of each ROS 2 release, and how the versions differ. A new release is a row.
Sources: `ros2.repos` on each branch of ros2/ros2 for the versions; the schemas `etc/cyclonedds.xsd` and
`fastRTPS_profiles.xsd` of each version for the elements.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache
from typing import TYPE_CHECKING, Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined, select_autoescape

from atlantis_netcfg.computers import services
from atlantis_netcfg.computers.dds_link import links_without_dds
from atlantis_netcfg.computers.interop import SERVICE
from atlantis_netcfg.computers.recording import SERVICE as RECORDING
from atlantis_netcfg.computers.ros1_bridge import SERVICE as BRIDGE_OF_PACKAGES
from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.messages import arg, join
from atlantis_netcfg.inventory import model
from atlantis_netcfg.links import standing_traffic
from atlantis_netcfg.routeros import render

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from atlantis_netcfg.inventory import Host, Inventory


"""Where the files stand on the computer; each link has a folder of its own below."""


def profiles(view: ProfileView, templates: Path | None = None) -> dict[str, str]:
    """Render the profiles of one link: file name below `PROFILES` to text; `templates` overrides the folder."""
    folder = f"{services.PROFILES}/{view.link}"
    return {f"{view.link}/{name}": text for name, text in _files(view, folder, templates).items()}


def _files(view: ProfileView, folder: str, templates: Path | None = None) -> dict[str, str]:
    """Render the profiles: file name in `folder` to text."""
    files = {"cyclonedds.xml": "cyclonedds.xml.j2"}
    if view.release.fast_dds is not None:
        files["fastdds.xml"] = "fastdds.xml.j2"
    files["ros.env"] = "ros.env.j2"
    environment = _environment(templates or render.template_folder())
    return {
        name: environment.get_template(f"dds/{template}").render(profile=view, folder=folder)
        for name, template in files.items()
    }


@cache
def _environment(templates: Path) -> Environment:
    """Return the template environment: undefined names are errors, and XML values are escaped."""
    return Environment(
        loader=FileSystemLoader(templates),
        bytecode_cache=render.get_template_cache(__file__),
        undefined=StrictUndefined,
        autoescape=select_autoescape(enabled_extensions=("xml.j2",)),
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )


@dataclass(frozen=True, slots=True)
class Cyclone:
    """A version line of Cyclone DDS: it refuses to start on unknown elements, so each line has its own file."""

    version: str
    interfaces: bool
    """Whether `General/Interfaces` names the interface; earlier, `General/NetworkInterfaceAddress` did."""
    lease_in_discovery: bool
    """Whether `LeaseDuration` is under `Discovery`; earlier, it was under `Internal`."""
    prunes: bool
    """Whether it drops a peer's address after silence for its lease and 30 s, unless configured otherwise."""


@dataclass(frozen=True, slots=True)
class DdsRelease:
    """Middleware of one ROS 2 release; `pypi` is a laptop without ROS (`pip install cyclonedds`)."""

    name: str
    cyclone: Cyclone
    fast_dds: str | None
    """Version of Fast DDS; None: there is none."""
    environment: Mapping[str, str]
    """Variables that are set so that nothing narrows the profile."""


_CYCLONE_0_7 = Cyclone("0.7", interfaces=False, lease_in_discovery=False, prunes=False)
_CYCLONE_0_10 = Cyclone("0.10", interfaces=True, lease_in_discovery=True, prunes=False)
_CYCLONE_11 = Cyclone("11", interfaces=True, lease_in_discovery=True, prunes=True)
_BEFORE_IRON = {"ROS_LOCALHOST_ONLY": "0"}
"""1 would leave 127.0.0.1 only, without a warning."""
_SINCE_IRON = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT"}
"""The other ranges override the profile (ROS 2 manual, Improved Dynamic Discovery)."""

RELEASES: Mapping[str, DdsRelease] = {
    release.name: release
    for release in (
        DdsRelease("foxy", _CYCLONE_0_7, "2.1", _BEFORE_IRON),
        DdsRelease("humble", _CYCLONE_0_10, "2.6", _BEFORE_IRON),
        DdsRelease("jazzy", _CYCLONE_0_10, "2.14", _SINCE_IRON),
        DdsRelease("pypi", _CYCLONE_11, None, {}),
    )
}

GAP_S = 70
"""The longest silence observed on the satellite service (FFI, 352 kbit/s, Arctic, 2019)."""


SIZES: Mapping[model.RosMiddleware, standing_traffic.DdsSizes] = {
    model.RosMiddleware.CYCLONE_DDS: standing_traffic.DdsSizes(
        380, has_repeat=False, sample_head=84, reliability=standing_traffic.CycloneHeartbeats()
    ),
    model.RosMiddleware.FAST_DDS: standing_traffic.DdsSizes(
        484, has_repeat=True, sample_head=160, reliability=standing_traffic.PeriodicHeartbeats()
    ),
}
"""Counted for 380 s with the satellite's profile: Cyclone DDS 11 (0.10: 372 bytes), Fast DDS 2.9; no ROS node.

60 bytes of each datagram of Fast DDS are a submessage of its statistics module, which Debian's 2.9 is built with.
Foxy's 2.1 has no such module. Humble's and Jazzy's builds were not checked: the bytes are an upper bound there.
"""


@dataclass(frozen=True, slots=True)
class Tuning:
    """DDS settings for one kind of link."""

    announce_s: int
    """Interval; two announcements and the longest gap fit into every lease that can be declared."""
    message_bytes: int
    """The largest UDP payload, so that no datagram is fragmented by IP: links drop fragments."""
    fragment_bytes: int
    """Fragment of a sample that is larger than a message; 100 bytes are left for the headers of RTPS."""


_FAST = Tuning(announce_s=5, message_bytes=1372, fragment_bytes=1272)
"""1372 is a tunnel's MTU of 1400 without the headers of IP and UDP."""
_MOBILE = Tuning(announce_s=10, message_bytes=1200, fragment_bytes=1100)
_SATELLITE = Tuning(announce_s=20, message_bytes=1200, fragment_bytes=1100)

TUNING: Mapping[model.Pace, Tuning] = {
    model.Pace.FAST: _FAST,
    model.Pace.MOBILE: _MOBILE,
    model.Pace.SATELLITE: _SATELLITE,
}
"""1200 bytes were measured over a path that drops fragments; the limit of a satellite is to be measured on site."""


@dataclass(frozen=True, slots=True)
class ProfileView:
    """Values for the profile templates of one computer on one link."""

    host: str
    link: str
    release: DdsRelease
    middleware: model.RosMiddleware
    domain: int
    address: str
    """Address of the interface, by which every version finds it: tun0 has another name on another computer."""
    peers: tuple[tuple[str, str], ...]
    """Name and address; the computer itself is a peer, so that its own processes find each other."""
    participants: int
    processes: int
    lease_s: int
    tuning: Tuning
    over: model.DdsPath
    vpn: standing_traffic.VpnHeaders
    """Between two sites all traffic uses the VPN: the computers' own tunnels, or those of the routers."""

    @property
    def announcing(self) -> standing_traffic.DdsAnnouncements:
        """Discovery traffic of the computer's processes.

        Cyclone DDS assigns indexes below `MaxAutoParticipantIndex`, and also announces itself to the port of that
        index.
        """
        ports = self.participants + (self.middleware is model.RosMiddleware.CYCLONE_DDS)
        return standing_traffic.DdsAnnouncements(self.processes, ports, self.tuning.announce_s, self.sizes)

    @property
    def messages(self) -> standing_traffic.DdsMessages:
        """How messages of the computer's topics are split on the link."""
        return standing_traffic.DdsMessages(self.tuning.message_bytes, self.tuning.fragment_bytes, self.sizes, self.vpn)

    @property
    def sizes(self) -> standing_traffic.DdsSizes:
        """Message sizes of the DDS implementation in use."""
        return SIZES[model.RosMiddleware.CYCLONE_DDS if self.release.fast_dds is None else self.middleware]

    @property
    def announced_mb_a_day(self) -> float:
        """Discovery traffic of one ROS process in 10^6 bytes a day: computed, not measured."""
        return replace(self.announcing, processes=1).announcement_bytes(len(self.peers) - 1, self.vpn) / 1e6


@dataclass(frozen=True, slots=True)
class _DdsHost:
    """A computer of the pilot that uses DDS."""

    name: str
    address: str
    site: str | None
    """None: anywhere."""
    everywhere: bool
    """Whether it is a control centre, which every computer has to find."""
    gateway: bool = False
    """If DDS may not use a link of its site, a control centre does not list it, but finds it while DDS may pass."""


def profile_views(inventory: Inventory, host: Host, release: str | None = None) -> tuple[ProfileView, ...]:
    """Build one view for each link of the host's site, in order of preference.

    `release` overrides the ROS 2 release of the inventory. Raises UsageError if the inventory has no DDS, or the host
    uses no DDS.
    """
    dds = _require_dds(inventory)
    if not isinstance(host.device, model.ServerComputer):
        there = join(
            ", ", (item.name for item in inventory.hosts.values() if isinstance(item.device, model.ServerComputer))
        )
        raise UsageError(
            f"`{arg(host.name)}` is a {arg(host.device.kind)}: it does not use DDS", hint=f"hosts that do: {arg(there)}"
        )
    dds_release = _release(release or dds.distribution)
    all_of_them = _participants(inventory, dds)
    local = next(entry for entry in all_of_them if entry.name == host.name)
    reachable = [peer for peer in all_of_them if local.everywhere or peer.everywhere or peer.site in {None, host.site}]
    quiet = {name for name in inventory.sites if name != host.site and links_without_dds(inventory, name)}
    peers = [peer for peer in reachable if not (peer.gateway and peer.site in quiet)]
    return tuple(
        ProfileView(
            host=host.name,
            link=link.name,
            release=dds_release,
            middleware=dds.middleware,
            domain=dds.domain,
            address=local.address,
            peers=tuple((participant.name, participant.address) for participant in peers),
            participants=dds.participants,
            processes=dds.processes,
            lease_s=dds.lease_s,
            tuning=_tuning(inventory, link.kind, {peer.site for peer in reachable} - {host.site}),
            over=dds.over,
            vpn=standing_traffic.VpnHeaders.of(inventory.pilot.vpn.transport),
        )
        for link in inventory.sites[host.site].bearers
    )


@dataclass(frozen=True, slots=True)
class MemberDds:
    """A VPN member that is no host of the inventory: a partner's robot or laptop."""

    name: str
    address: str
    """Address in the VPN."""
    pace: model.Pace
    """Pace of the link that carries its tunnel."""
    peers: tuple[tuple[str, str], ...]
    """Name and address of the peers that it may find."""
    distribution: model.RosDistribution


def member_view(inventory: Inventory, member: MemberDds) -> ProfileView:
    """Build the view of a partner's computer in the VPN. Raises UsageError if the inventory has no DDS.

    On a fast link the settings are those of a mobile link: the link at the tunnel's other end is not known.
    """
    dds = _require_dds(inventory)
    return ProfileView(
        host=member.name,
        link="the VPN",
        release=_release(member.distribution),
        middleware=dds.middleware,
        domain=dds.domain,
        address=member.address,
        peers=((member.name, member.address), *member.peers),
        participants=dds.participants,
        processes=dds.processes,
        lease_s=dds.lease_s,
        over=dds.over,
        vpn=standing_traffic.VpnHeaders.of(inventory.pilot.vpn.transport),
        tuning=TUNING[max(member.pace, model.Pace.MOBILE)],
    )


def member_files(view: ProfileView) -> dict[str, str]:
    """Render the files for a member's `PROFILES` folder: file name to text."""
    return _files(view, services.PROFILES)


def _tuning(inventory: Inventory, kind: model.LinkKind, sites: set[str | None]) -> Tuning:
    """Return the settings for the slowest link between the sites: a vessel receives announcements over satellite."""
    far = {link.kind for name, site in inventory.sites.items() if name in sites for link in site.bearers}
    return TUNING[max(each.traits.pace for each in {kind, *far})]


def _require_dds(inventory: Inventory) -> model.Dds:
    if inventory.pilot.dds is None:
        raise UsageError("the pilot has no DDS settings", hint="write `dds: {distribution: foxy}` below `pilot:`")
    return inventory.pilot.dds


def _release(name: str) -> DdsRelease:
    if name not in RELEASES:
        raise UsageError(f"`{arg(name)}` is not a known release", hint=f"known releases: {arg(join(', ', RELEASES))}")
    return RELEASES[name]


_KINDS = (model.ControlCentre, model.Gateway)


def _participants(inventory: Inventory, dds: model.Dds) -> list[_DdsHost]:
    """List hosts, then the inventory's DDS peers; on LANs also vehicles with a reservation."""
    result = [
        _DdsHost(name, dds.address_of(host.device), host.site, *(isinstance(host.device, kind) for kind in _KINDS))
        for name, host in inventory.hosts.items()
        if isinstance(host.device, model.ServerComputer)
    ]
    result += [_DdsHost(peer.name, str(peer.address), peer.site, everywhere=False) for peer in dds.peers]
    if dds.over is model.DdsPath.LAN:
        known_addresses = {participant.address for participant in result}
        result += [
            _DdsHost(reservation.name, str(reservation.address), name, everywhere=False)
            for name, site in inventory.sites.items()
            for reservation in site.lan.reservations
            if reservation.name in inventory.vehicles and str(reservation.address) not in known_addresses
        ]
    return result


LOGIN = "/etc/profile.d/atlantis-rosenv.sh"
"""The same for login shells; `~/.bashrc` is left to the user.

Its name sorts after that of ROS 2's own set-up, `atlantis-ros2.sh`, which may narrow discovery since Iron.
"""
_READERS = (SERVICE, RECORDING, services.BRIDGE, BRIDGE_OF_PACKAGES)
"""Units that read a profile when they start, and keep it.

A unit that does not run is left alone; nothing waits for a unit that itself waits for the VPN.
"""
_NARROWS = {"ROS_LOCALHOST_ONLY": "0"}
"""Releases since Iron still obey it if it is set."""


@dataclass(frozen=True, slots=True)
class GatewayDds:
    """DDS files of a computer; without DDS in the inventory, the role removes them."""

    in_use: str | None = None
    """Link whose profile the environment names: the slowest of the site, because a process keeps what it read."""
    files: Mapping[str, str] = field(default_factory=dict)
    """Path -> content."""
    alone: Mapping[str, str] = field(default_factory=dict)
    """Variables that nothing else on the computer may set differently: that would silently exclude the VPN."""

    def as_dict(self) -> dict[str, Any]:
        """Return the parameters of the role's tasks."""
        read = [
            path
            for path in self.files
            if path.startswith(f"{services.PROFILES}/{self.in_use}/") or path == services.ENVIRONMENT
        ]
        return {
            "in_use": self.in_use,
            "configure": {
                "files": [{"path": path, "content": content} for path, content in self.files.items()],
                "absent": [path for path in (services.ENVIRONMENT, LOGIN) if path not in self.files],
                "only": [services.PROFILES],
                "units": [{"name": name, "after": read or [services.ENVIRONMENT], "wait": False} for name in _READERS],
            },
            "elsewhere": {"variables": dict(self.alone), "ours": [services.ENVIRONMENT, LOGIN]},
        }


def gateway_dds(inventory: Inventory, host: Host) -> GatewayDds:
    """Build the DDS files of a host (pure); a valid inventory gives each VPN gateway an address."""
    if inventory.pilot.dds is None:
        return GatewayDds()
    views = profile_views(inventory, host)
    slowest = _slowest(views)
    files = {f"{services.PROFILES}/{name}": text for view in views for name, text in profiles(view).items()}
    files[services.ENVIRONMENT] = files[f"{services.PROFILES}/{slowest.link}/ros.env"]
    files[LOGIN] = (
        render.environment().get_template("gateway/ros-profile.sh.j2").render(environment=services.ENVIRONMENT)
    )
    return GatewayDds(slowest.link, files, {**_NARROWS, **slowest.release.environment})


def profile_in_use(inventory: Inventory, host: Host) -> ProfileView:
    """Return the profile that processes use on every link of a computer: that of the slowest link.

    Raises UsageError as `profile_views` does.
    """
    return _slowest(profile_views(inventory, host))


def _slowest(views: tuple[ProfileView, ...]) -> ProfileView:
    """Return the profile with the rarest announcements; of two alike, the less preferred link."""
    return max(reversed(views), key=lambda view: view.tuning.announce_s)
