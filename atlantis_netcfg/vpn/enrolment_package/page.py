"""Pages for a member: the instructions, and the cover note of the sealed file.

Both as text, the instructions also as HTML without external resources. The templates print blocks separated by an empty
line: a heading is underlined, a list begins with hyphens, text to be typed is indented by four spaces, all else is a
paragraph. Each block is translated separately; text to be typed is the same in every language.

Also here: whom a member may reach, and by whom it is reached, as text, from the policy used for the firewall.
"""

from __future__ import annotations

import html
import re
import textwrap
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache
from ipaddress import IPv4Address, IPv4Network
from typing import TYPE_CHECKING

from markupsafe import Markup

from atlantis_netcfg.computers.dds import MemberDds, ProfileView, member_files, member_view
from atlantis_netcfg.computers.services import PROFILES
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import Message, arg, join, msg
from atlantis_netcfg.inventory.model import Pace
from atlantis_netcfg.routeros.render import environment
from atlantis_netcfg.runs.report import page_frame
from atlantis_netcfg.vpn import routeros, systems
from atlantis_netcfg.vpn.enrolment_package.profile import day, is_declared
from atlantis_netcfg.vpn.identity import ClientSystem, Identity, Member, MemberKind, MemberLink, MembershipList, Wrap
from atlantis_netcfg.vpn.policy import ANYTHING, PING, Permission, Policy, PolicyTraffic, Protocol, Zone, policy
from atlantis_netcfg.vpn.server import tunnel_address

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from jinja2 import Environment

    from atlantis_netcfg.inventory import Inventory


_OURS = "p_site_hosts"
_NAMES = {
    "p_control_centres": "the control centre",
    "p_site_gateways": "the gateways of the sites",
    _OURS: "the pilot's own computers and its technicians",
    "p_site_lans": "everything in the LANs of the sites",
    "p_guest_devices": "the devices of partners, and everything in the LANs of the sites",
    "p_all_robots": "the robots, in the VPN and in the LANs of the sites",
}
"""Descriptions of other groups by their set in the firewall; a group not listed here provides services."""


@dataclass(frozen=True, slots=True)
class ReachableGroup:
    """One group of hosts that a member may reach."""

    who: str
    hosts: tuple[tuple[str, IPv4Address], ...]
    """Declared hosts of the group, with their addresses in the VPN."""
    traffic: tuple[str, ...]
    """Description of the permitted traffic."""
    ping: bool


def reach(inventory: Inventory, member: Member) -> tuple[ReachableGroup, ...]:
    """Return whom the member may open connections to; other members change, so only their kind is given."""
    permissions_by_host: dict[str, list[Permission]] = {}
    for permission in _policy(inventory, member).permissions:
        if permission.source is not None and permission.source.holds(member.address):
            name = permission.destination.name if permission.destination else ""
            permissions_by_host.setdefault(name, []).append(permission)
    entries = (_reach(inventory, member, permissions) for permissions in permissions_by_host.values())
    return tuple(item for item in entries if item is not None)


def reached_by(inventory: Inventory, member: Member) -> tuple[str, ...]:
    """Return the full names of partners that see the member's robot."""
    others = (partner for name, partner in inventory.partners.items() if name != member.partner)
    return tuple(other.full_name for other in others if member.vehicle is not None and member.vehicle in other.sees)


def tunnel_of_server(inventory: Inventory) -> IPv4Address:
    """Return the server's VPN address, which every member may ping."""
    return tunnel_address(inventory, inventory.hosts[inventory.pilot.vpn.server])


def dds_port(inventory: Inventory, member: Member) -> int | None:
    """Return the first DDS port that the member may send to; None without DDS, or if it may reach nobody."""
    ports = [
        permission.traffic.ports.start
        for permission in _policy(inventory, member).permissions
        if permission.source is not None
        and permission.source.holds(member.address)
        and permission.traffic.protocol is Protocol.UDP
        and permission.traffic.ports
        and len(permission.traffic.ports) > 1
    ]
    return ports[0] if ports else None


def _policy(inventory: Inventory, member: Member) -> Policy:
    return policy(inventory, _roll(member))


def _roll(*members: Member) -> MembershipList:
    """Return a membership list of only these members."""
    return MembershipList({member.name: member for member in members}, 0, "", datetime.fromtimestamp(0, UTC), ())


def _reach(inventory: Inventory, member: Member, permissions: list[Permission]) -> ReachableGroup | None:
    zone = permissions[0].destination
    traffic = tuple(dict.fromkeys(_words(permission.traffic, permission.why) for permission in permissions))
    ping = any(item.traffic in (PING, ANYTHING) for item in permissions)
    if zone is None:
        server = _policy(inventory, member).server
        return ReachableGroup("the VPN server", ((server.name, server.address),), traffic, ping=ping)
    hosts = () if zone.name == _OURS else tuple(_hosts(inventory, zone))
    who = _who(inventory, member, zone)
    return ReachableGroup(who, hosts, traffic, ping=ping) if who else None


def _who(inventory: Inventory, member: Member, zone: Zone) -> str:
    """Name the members of a zone for the page; empty if there are none."""
    whose = inventory.partners.get(member.partner or "")
    if whose is not None and zone.name == f"p_{member.partner}_sees":
        return msg("the robots " + str(arg(join(", ", (inventory.vehicles[name].name for name in whose.sees)))))
    if whose is not None and zone.name == f"p_{member.partner}_lan":
        return msg(f"the robots of {arg(whose.full_name)} in the LANs of the sites")
    if whose is not None and zone.name == f"p_{member.partner}":
        return msg(f"all other devices of {arg(whose.full_name)}")
    return _NAMES.get(zone.name, "services") if zone.networks else ""


def _hosts(inventory: Inventory, zone: Zone) -> Iterator[tuple[str, IPv4Address]]:
    for host in inventory.hosts.values():
        address = getattr(host.device, "vpn_address", None)
        if address is not None and IPv4Network(address) in zone.networks:
            yield host.name, address


def _words(traffic: PolicyTraffic, why: str) -> str:
    """Describe permitted traffic for the page; `why` names a service."""
    if traffic == ANYTHING:
        return "everything"
    if traffic == PING:
        return "ping"
    ports = traffic.ports or range(0)
    name = str(traffic.protocol).upper()
    return msg(
        f"DDS ({arg(name)} {arg(ports[0])} to {arg(ports[-1])})"
        if len(ports) > 1
        else f"{arg(why)} ({arg(name)} {arg(ports[0])})"
    )


_WHAT = {
    MemberKind.ROBOT: "the robot",
    MemberKind.LAPTOP: "the laptop",
    MemberKind.ROUTER: "the router",
    MemberKind.HOST: "the computer",
}
_RESTART_S = {MemberLink.FIBRE: 10, MemberLink.LTE: 30, MemberLink.SATELLITE: 300}
"""Pause after the server has disconnected a robot; on a satellite link each attempt costs money."""
WAIT_S = {MemberLink.FIBRE: 20, MemberLink.LTE: 40, MemberLink.SATELLITE: 120}
"""Seconds that the tunnel may take; by satellite it was seen up in 4 to 35 s (facts 9)."""
_WIDTH = 80
_UNDERLINE = re.compile(r"(=+|-+)")


_PACE = {MemberLink.FIBRE: Pace.FAST, MemberLink.LTE: Pace.MOBILE, MemberLink.SATELLITE: Pace.SATELLITE}
DDS_FILES = ("cyclonedds.xml", "fastdds.xml", "ros.env", "setup.bash", "setup.ps1")
"""DDS files that an enrolment package may contain."""
_STEPS = {
    ClientSystem.LINUX: "linux",
    ClientSystem.UBUNTU_DESKTOP: "ubuntu-desktop",
    ClientSystem.WINDOWS: "windows",
    ClientSystem.MACOS: "macos",
    ClientSystem.ANDROID: "phone",
    ClientSystem.IOS: "phone",
}
"""Template with the installation steps of each system of a laptop."""


@dataclass(frozen=True, slots=True)
class DdsSettings:
    """DDS settings of a ROS 2 participant, and the files that contain them."""

    view: ProfileView
    files: tuple[str, ...]
    """DDS files in the enrolment package."""


@dataclass(frozen=True, slots=True)
class PageView:
    """Data of the page templates."""

    pilot: str
    name: str
    kind: str
    what: str
    address: IPv4Address
    until: str
    contact: str
    key_file: str
    sealed_file: str
    folder: str
    """Folder in the sealed file."""
    system: str
    """System of the device; empty: unknown."""
    steps: tuple[str, ...]
    """Templates with the steps of a laptop's systems."""
    old_client: bool
    on_satellite: bool
    restart_s: int
    wait_s: int
    """Seconds that the tunnel may take to come up."""
    tests: tuple[str, ...]
    """Self-test programs in the enrolment package."""
    reach: tuple[ReachableGroup, ...]
    reached_by: tuple[str, ...]
    dds: DdsSettings | None
    files: tuple[tuple[str, str], ...]
    routeros: str
    """First RouterOS version that can be a member."""
    interface: str
    """Name of the tunnel interface, on a router."""
    server: IPv4Address
    """The server's address in the VPN."""
    server_name: str
    """Name by which a router finds the server."""


def page_view(
    inventory: Inventory,
    identity: Identity,
    *,
    contact: str,
    sealed_file: str,
    files: Sequence[tuple[str, str]],
) -> PageView:
    """Return the page data of one member; `contact` is whom the partner calls, in the operator's words."""
    member, system = identity.member, systems.system_of(identity.member)
    targets = reach(inventory, member)
    return PageView(
        pilot=inventory.pilot.name,
        name=member.name,
        kind="host" if is_declared(member) else str(member.kind),
        what=_describe_device(inventory, member),
        address=member.address,
        until=day(identity),
        contact=contact,
        key_file=files[0][0],
        sealed_file=sealed_file,
        folder=identity.certificate.common_name,
        system=system or "",
        steps=tuple(dict.fromkeys(_STEPS.values())) if system is None else tuple(filter(None, [_STEPS.get(system)])),
        old_client=identity.certificate.wrap is Wrap.TLS_CRYPT,
        on_satellite=member.link is MemberLink.SATELLITE,
        restart_s=_RESTART_S[member.link],
        wait_s=WAIT_S[member.link],
        tests=tuple(name for name, _ in files if name in {"self-test.py", "self-test.ps1"}),
        reach=targets,
        reached_by=reached_by(inventory, member),
        dds=_dds(inventory, member, {name for name, _ in files}),
        files=tuple(files),
        routeros=str(routeros.SINCE),
        interface=routeros.INTERFACE,
        server=tunnel_of_server(inventory),
        server_name=inventory.pilot.vpn.endpoint_name,
    )


def page(view: PageView) -> tuple[str, ...]:
    """Return the blocks of the page, in the current language."""
    return _blocks("README.txt.j2", page=view)


@dataclass(frozen=True, slots=True)
class CoverNote:
    """Data of the cover note on the sealed file."""

    sha256: str
    passphrase: bool
    """Whether the file is opened by a passphrase; otherwise by the owner's key."""

    @property
    def key_words(self) -> str:
        """The key option for `age`; empty if the file has a passphrase."""
        return "" if self.passphrase else " --identity YOUR_KEY"


def cover_note(view: PageView, note: CoverNote) -> str:
    """Return the text sent together with the sealed file; it contains no secret."""
    return as_text(_blocks("cover-note.txt.j2", page=view, note=note))


def _blocks(template: str, **data: object) -> tuple[str, ...]:
    text = _environment().get_template(f"handout/{template}").render(**data)
    return tuple(_translate_block(block.strip("\n")) for block in re.split(r"\n{2,}", text.strip("\n")))


@cache
def _environment() -> Environment:
    """Return an environment in which every value is marked, as `arg` does it in an f-string."""
    return environment().overlay(finalize=lambda value: Message(f"{arg(value)}").source, bytecode_cache=None)


def _translate_block(block: str) -> str:
    """Translate a block of marked text: a list line by line, others as a whole; typed text stays as it is."""
    lines = block.split("\n")
    plain = [str.__str__(Message(line)) for line in lines]
    if _is_typed(plain):
        return "\n".join(plain)
    if _is_heading(plain):
        title = translate(Message(lines[0]))
        return f"{title}\n{plain[1][0] * len(title)}"
    if _is_list(plain):
        items = " ".join(line.strip() if line.startswith(" ") else f"\n{line}" for line in lines).split("\n")
        return "\n".join(f"- {translate(Message(item.strip()[2:]))}" for item in items if item.strip())
    return translate(Message(" ".join(lines)))


BESIDE = ("install.sh", "restart.conf")
"""Additional files for a robot's computer, rendered from templates of these names."""


def beside(view: PageView, name: str) -> str:
    """Render a file of a robot's enrolment package."""
    return environment().get_template(f"handout/{name}.j2").render(page=view)


def dds_files(dds: DdsSettings) -> dict[str, str]:
    """Return the DDS files of an enrolment package: profiles and environment as on gateways, and shell scripts."""
    files = member_files(dds.view)
    for name in ("setup.bash", "setup.ps1"):
        files[name] = environment().get_template(f"handout/{name}.j2").render(dds=dds.view, folder=PROFILES)
    return {name: files[name] for name in dds.files}


def as_text(blocks: Sequence[str]) -> str:
    """Return the page as text, in lines of 80 characters; text to be typed is never wrapped."""
    return "\n\n".join(_wrap_block(block) for block in blocks) + "\n"


def as_html(blocks: Sequence[str]) -> str:
    """Return the page as HTML; it loads no external resources."""
    body = "\n".join(_to_html(html.escape(block, quote=False)) for block in blocks[1:])
    header = page_frame.PageHeader(blocks[0].partition("\n")[0])
    # Escaped above, block by block.
    words = {"body": Markup(body), "unread": ""}  # noqa: S704 - see above
    return page_frame.page(page_frame.environment(), "frame.html.j2", header, **words).decode()


def _wrap_block(block: str) -> str:
    lines = block.split("\n")
    if _is_typed(lines) or _is_heading(lines):
        return block
    if _is_list(lines):
        return "\n".join(_fill(line, indent="  ") for line in lines)
    return _fill(" ".join(lines))


def _fill(text: str, indent: str = "") -> str:
    """Wrap text to the page width; text between back-ticks stays on one line."""
    whole = re.sub(r"`[^`]*`", lambda match: match[0].replace(" ", "\0"), text)
    wrapped_text = textwrap.fill(
        whole, _WIDTH, subsequent_indent=indent, break_on_hyphens=False, break_long_words=False
    )
    return wrapped_text.replace("\0", " ")


def _to_html(block: str) -> str:
    lines = block.split("\n")
    if _is_heading(lines):
        return f"<h2>{lines[0]}</h2>"
    if _is_typed(lines):
        return "<pre>" + "\n".join(line[4:] for line in lines) + "</pre>"
    if _is_list(lines):
        return "<ul>\n" + "\n".join(f"<li>{_code(line[2:])}</li>" for line in lines) + "\n</ul>"
    return "<p>" + _code("\n".join(lines)) + "</p>"


def _code(text: str) -> str:
    """Mark text between back-ticks as code."""
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", text)


def _is_heading(lines: Sequence[str]) -> bool:
    return len(lines) == 2 and _UNDERLINE.fullmatch(lines[1]) is not None  # noqa: PLR2004 - a line and its underline


def _is_typed(lines: Sequence[str]) -> bool:
    return all(line.startswith("    ") for line in lines)


def _is_list(lines: Sequence[str]) -> bool:
    return lines[0].startswith("- ") and all(line.startswith(("- ", "  ")) for line in lines)


def _describe_device(inventory: Inventory, member: Member) -> str:
    whose = msg(f" of {arg(inventory.partners[member.partner].full_name)}" if member.partner else "")
    return f"{_WHAT[member.kind]} `{member.device}`{whose}"


def dds_view(inventory: Inventory, member: Member) -> ProfileView | None:
    """Return a member's DDS profile; None if it does not use DDS with us, or this toolkit configures it."""
    if inventory.pilot.dds is None or member.kind not in {MemberKind.ROBOT, MemberKind.LAPTOP}:
        return None
    release = systems.distribution(inventory, member.vehicle, member.distribution)
    targets = reach(inventory, member)
    dds_targets = [entry for entry in targets if any(words.startswith("DDS") for words in entry.traffic)]
    peers = tuple((name, str(address)) for item in dds_targets for name, address in item.hosts)
    if not peers or release is None:
        return None
    return member_view(inventory, MemberDds(member.name, str(member.address), _PACE[member.link], peers, release))


def _dds(inventory: Inventory, member: Member, names: set[str]) -> DdsSettings | None:
    view = dds_view(inventory, member)
    if view is None:
        return None
    files = tuple(name for name in DDS_FILES if name in names)
    return DdsSettings(view, files)
