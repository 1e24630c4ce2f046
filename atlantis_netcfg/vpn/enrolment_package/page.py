"""The page of instructions: as text, and as a page for a browser that loads nothing from elsewhere.

The templates print blocks with an empty line between them: a heading is underlined, a list begins with hyphens, what is
to be typed is indented by four spaces, all else is a paragraph.
"""

from __future__ import annotations

import html
import re
import textwrap
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.render import environment
from atlantis_netcfg.vpn import routeros
from atlantis_netcfg.vpn.enrolment_package.profile import day, is_declared
from atlantis_netcfg.vpn.enrolment_package.reachability import reach, reached_by, tunnel_of_server
from atlantis_netcfg.vpn.identity import Kind, Link, Wrap

if TYPE_CHECKING:
    from collections.abc import Sequence
    from ipaddress import IPv4Address

    from atlantis_netcfg.declaration import Declaration
    from atlantis_netcfg.vpn.enrolment_package.reachability import Reach
    from atlantis_netcfg.vpn.identity import Identity, Member

_WHAT = {Kind.ROBOT: "the robot", Kind.LAPTOP: "the laptop", Kind.ROUTER: "the router", Kind.HOST: "the computer"}
_RESTART_S = {Link.FIBRE: 10, Link.LTE: 30, Link.SATELLITE: 300}
"""Pause after the server has sent a robot away; on a satellite each attempt is paid."""
_MESSAGE_BYTES = 1200
"""Of a DDS message: whole in one packet of every link (facts 9)."""
_WIDTH = 100
_UNDERLINE = re.compile(r"(=+|-+)")


@dataclass(frozen=True, slots=True)
class Dds:
    """What a participant of ROS 2 needs to know."""

    domain: int
    middleware: str
    message_bytes: int
    peers: tuple[IPv4Address, ...]


@dataclass(frozen=True, slots=True)
class PageView:
    """What the templates print."""

    pilot: str
    name: str
    kind: str
    what: str
    address: IPv4Address
    until: str
    contact: str
    key_file: str
    sealed_file: str
    old_client: bool
    on_satellite: bool
    restart_s: int
    tested: bool
    """Whether the hand-out has a self-test."""
    reach: tuple[Reach, ...]
    reached_by: tuple[str, ...]
    dds: Dds | None
    files: tuple[tuple[str, str], ...]
    routeros: str
    """First that can be a member."""
    interface: str
    """Of the tunnel, on a router."""
    server: IPv4Address
    """In the VPN."""
    server_name: str
    """As a router finds it."""


def page_view(
    declaration: Declaration,
    identity: Identity,
    *,
    contact: str,
    sealed_file: str,
    files: Sequence[tuple[str, str]],
) -> PageView:
    """Everything that the page says of one member; `contact` is whom the partner calls, in the operator's words."""
    member = identity.member
    found = reach(declaration, member)
    return PageView(
        pilot=declaration.pilot.name,
        name=member.name,
        kind="host" if is_declared(member) else str(member.kind),
        what=_what(declaration, member),
        address=member.address,
        until=day(identity),
        contact=contact,
        key_file=files[0][0],
        sealed_file=sealed_file,
        old_client=identity.certificate.wrap is Wrap.TLS_CRYPT,
        on_satellite=member.link is Link.SATELLITE,
        restart_s=_RESTART_S[member.link],
        tested=any(name == "self-test.py" for name, _ in files),
        reach=found,
        reached_by=reached_by(declaration, member),
        dds=_dds(declaration, member, found),
        files=tuple(files),
        routeros=str(routeros.SINCE),
        interface=routeros.INTERFACE,
        server=tunnel_of_server(declaration),
        server_name=declaration.pilot.vpn.endpoint_name,
    )


def page(view: PageView) -> tuple[str, ...]:
    """The blocks of the page."""
    text = environment().get_template("handout/README.txt.j2").render(page=view)
    return tuple(block.strip("\n") for block in re.split(r"\n{2,}", text.strip("\n")))


def restart(view: PageView) -> str:
    """The drop-in with which systemd starts a robot's tunnel again."""
    return environment().get_template("handout/restart.conf.j2").render(page=view)


def as_text(blocks: Sequence[str]) -> str:
    """The page for every editor, in lines of 100 characters."""
    return "\n\n".join(_wrapped(block) for block in blocks) + "\n"


def as_html(blocks: Sequence[str]) -> str:
    """The same page for a browser; nothing in it is loaded from elsewhere."""
    title = html.escape(blocks[0].partition("\n")[0])
    body = "\n".join(_marked_up(html.escape(block, quote=False)) for block in blocks)
    return environment().get_template("handout/README.html.j2").render(title=title, body=body)


def _wrapped(block: str) -> str:
    lines = block.split("\n")
    if _is_typed(lines) or _is_heading(lines):
        return block
    if _is_list(lines):
        return "\n".join(textwrap.fill(line, _WIDTH, subsequent_indent="  ") for line in lines)
    return textwrap.fill(" ".join(lines), _WIDTH, break_on_hyphens=False)


def _marked_up(block: str) -> str:
    lines = block.split("\n")
    if _is_heading(lines):
        level = "h1" if lines[1][0] == "=" else "h2"
        return f"<{level}>{lines[0]}</{level}>"
    if _is_typed(lines):
        return "<pre>" + "\n".join(line[4:] for line in lines) + "</pre>"
    if _is_list(lines):
        return "<ul>\n" + "\n".join(f"<li>{line[2:]}</li>" for line in lines) + "\n</ul>"
    return "<p>" + "\n".join(lines) + "</p>"


def _is_heading(lines: Sequence[str]) -> bool:
    return len(lines) == 2 and _UNDERLINE.fullmatch(lines[1]) is not None  # noqa: PLR2004 - a line and its underline


def _is_typed(lines: Sequence[str]) -> bool:
    return all(line.startswith("    ") for line in lines)


def _is_list(lines: Sequence[str]) -> bool:
    return all(line.startswith("- ") for line in lines)


def _what(declaration: Declaration, member: Member) -> str:
    whose = f" of {declaration.partners[member.partner].full_name}" if member.partner else ""
    return f"{_WHAT[member.kind]} `{member.device}`{whose}"


def _dds(declaration: Declaration, member: Member, found: Sequence[Reach]) -> Dds | None:
    """Only for who speaks DDS to computers of ours, and is not configured by this toolkit itself."""
    dds = declaration.pilot.dds
    if dds is None or member.kind not in {Kind.ROBOT, Kind.LAPTOP}:
        return None
    spoken = [entry for entry in found if any(words.startswith("DDS") for words in entry.traffic)]
    peers = tuple(address for item in spoken for _, address in item.hosts)
    return Dds(dds.domain, dds.middleware, _MESSAGE_BYTES, peers) if peers else None
