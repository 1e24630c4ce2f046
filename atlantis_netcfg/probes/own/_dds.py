"""A participant of the declared DDS domain runs on the gateway computer; nothing is sent to find out.

Peers are announced to by unicast, so that nobody else hears them: what tells is which ports are bound. A participant
hears announcements at 7410 + 250 d + 2 i, i below the declared number, and data one port above (DDSI-RTPS 9.6.2.3).
With the site's profile it does not listen at the ports for multicast, 7400 + 250 d and one above. Without it Fast DDS
listens at the first of them besides, is found by who has the profile, and by nobody else; Cyclone DDS listens at both,
at no port that peers know, and is found by nobody (seen of 2.9.1 and 11.0.1, between two networks).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.probes.own._reading import printed
from atlantis_netcfg.probes.own._site import OwnSite, by_hand, run, step
from atlantis_netcfg.probes.own._words import declared, fail, good, listed, read, unknown, unreadable, warn
from atlantis_netcfg.probes.step import Judged
from atlantis_netcfg.site.model import ControlCentre

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from atlantis_netcfg.probes.answers import Answer
    from atlantis_netcfg.probes.questions import Question
    from atlantis_netcfg.probes.step import Step
    from atlantis_netcfg.site.model import Dds

__all__ = ["TABLE", "of"]

TABLE = "/proc/net/udp"
_BASE, _DOMAIN, _UNICAST, _EACH = 7400, 250, 10, 2
_HANDED_OUT = 32768
"""From here on Linux gives ports to programs that ask for none (ip-sysctl, ip_local_port_range)."""
_MULTICAST = 0
_ROW = re.compile(r"^\s*\d+: ([0-9A-F]{8}):([0-9A-F]{4}) .* (\d+)\s*$")


@dataclass(frozen=True, slots=True)
class _Socket:
    port: int
    drops: int
    """Datagrams that nobody took in time."""

    @property
    def offset(self) -> int:
        return (self.port - _BASE) % _DOMAIN

    @property
    def participant(self) -> int | None:
        """Its number, if this is the port on which it hears announcements."""
        offset = self.offset - _UNICAST
        return offset // _EACH if offset >= 0 and offset % _EACH == 0 else None


@dataclass(frozen=True, slots=True)
class _Heard:
    """What is bound of the ports of one domain. Other programs have ports in that range, too."""

    domain: int
    sockets: tuple[_Socket, ...]
    """Those at one port can be many: everybody's ports for multicast are the same."""

    @property
    def participants(self) -> tuple[_Socket, ...]:
        """Where announcements are heard."""
        return tuple({one.port: one for one in self.sockets if one.participant is not None}.values())

    @property
    def strangers(self) -> int:
        """How many participants run without the profile."""
        return self._bound(_MULTICAST)

    @property
    def is_dds(self) -> bool:
        """Whether two ports are bound that belong to each other; one alone may be anybody's."""
        return any(self._bound(one) and self._bound(one + 1) for one in (_MULTICAST, _UNICAST))

    @property
    def ports(self) -> str:
        """Where it listens for announcements."""
        known = {one.port for one in self.sockets if one.participant is not None or one.offset == _MULTICAST}
        return ", ".join(map(str, sorted(known)))

    def _bound(self, offset: int) -> int:
        return sum(one.offset == offset for one in self.sockets)


def of(site: OwnSite) -> Step:
    """The gateway computer's table of UDP sockets."""
    title = "DDS is seen on the gateway computer"
    dds = site.declaration.pilot.dds
    if dds is None:
        return step("dds", title, None, site.hosts[1:], "no DDS is declared for the pilot")
    if site.gateway is not None:
        return step("dds", title, _Seen(site), site.hosts[1:])
    hosts = site.declaration.site_hosts(site.name)
    centres = tuple(host.name for host in hosts if isinstance(host.device, ControlCentre))
    if not centres:
        return step("dds", title, None, site.hosts, "the site has no computer on which DDS would run")
    return by_hand(
        "dds",
        "DDS of another site is seen",
        f"On {' and '.join(centres)}, list what DDS domain {dds.domain} carries, as with `ros2 topic list`: the site"
        " has no gateway computer that a program could ask.",
        "Topics of a robot or a gateway at another site are there.",
        centres,
    )


@dataclass(frozen=True, slots=True)
class _Seen:
    """DDS is seen on the gateway computer."""

    site: OwnSite

    def asks(self) -> tuple[Question, ...]:
        return run("sockets", self.site, f"cat {TABLE}")

    def judge(self, heard: Mapping[str, Answer]) -> Judged:
        gateway, wanted = self.site.gateway, self.site.declaration.pilot.dds
        assert gateway is not None  # noqa: S101 - the step is skipped without one
        assert wanted is not None  # noqa: S101 - the same
        told = printed(heard["sockets"], gateway.name)
        if isinstance(told, Finding):
            return Judged((told,))
        if "local_address" not in told:
            return Judged((unreadable(gateway.name, "its UDP sockets"),))
        found = tuple(_heard(told))
        ours = next((one for one in found if one.domain == wanted.domain), _Heard(wanted.domain, ()))
        near = [one for one in found if one is not ours and one.is_dds]
        shown = [one.ports for one in (ours, *near) if one.ports]
        evidence = (
            declared("domain of DDS", str(wanted.domain)),
            read(f"UDP ports of DDS on {gateway.name}", ", ".join(shown) or "none"),
        )
        if not ours.participants and not ours.is_dds:
            return Judged((_nobody(gateway.name, wanted, near),), evidence)
        return Judged(tuple(_judged(gateway.name, wanted, ours)), evidence)


def _heard(text: str) -> Iterator[_Heard]:
    rows = filter(None, map(_ROW.match, text.splitlines()))
    sockets = sorted((int(row[2], 16), int(row[3])) for row in rows)
    known = [_Socket(port, drops) for port, drops in sockets if _BASE <= port < _HANDED_OUT]
    for domain, those in groupby(known, lambda one: (one.port - _BASE) // _DOMAIN):
        yield _Heard(domain, tuple(those))


def _nobody(name: str, wanted: Dds, near: Sequence[_Heard]) -> Finding:
    if near:
        message = (
            f"DDS on {name} runs in domain {listed(str(one.domain) for one in near)}, and {wanted.domain} is declared"
        )
        return fail("other-domain", message, "set ROS_DOMAIN_ID as declared: source the site's ros.env before starting")
    hint = f"start the data gateway or any ROS 2 node on {name}, then repeat the check"
    message = f"nobody speaks DDS on {name} in domain {wanted.domain}, so nothing is announced"
    return unknown("nobody-announces", message, hint)


def _judged(name: str, wanted: Dds, heard: _Heard) -> Iterator[Finding]:
    ours = heard.participants
    yield from _profile(name, heard)
    late = [one for one in ours if one.participant is not None and one.participant >= wanted.participants]
    if late:
        message = (
            f"{len(late)} of the {len(ours)} DDS participants on {name} are beyond the declared {wanted.participants}"
        )
        yield warn("too-many-participants", message, "no peer finds those: stop some, or declare more `participants`")
    dropped = sum(one.drops for one in ours)
    if dropped:
        message = f"{name} has dropped {dropped} announcements of DDS that no program took in time"
        yield warn("announcements-dropped", message, f"look at the load of {name}; a robot may be found late")
    if not late and not dropped and not heard.strangers:
        many = "1 participant listens" if len(ours) == 1 else f"{len(ours)} participants listen"
        yield good("listens", f"{many} on {name} in DDS domain {wanted.domain}, from port {ours[0].port}")


def _profile(name: str, heard: _Heard) -> Iterator[Finding]:
    hint = "end what runs, source the site's ros.env of the link in use, and start it again"
    if heard.strangers and not heard.participants:
        message = f"DDS on {name} runs in domain {heard.domain} without the site's profile: no other site finds it"
        yield fail("without-profile", message, hint)
    elif heard.strangers:
        many, runs, it = f"{heard.strangers} DDS participants", "run", "them"
        if heard.strangers == 1:
            many, runs, it = "1 DDS participant", "runs", "it"
        message = f"{many} on {name} {runs} without the site's profile: other sites may not find {it}, or lose {it}"
        yield warn("without-profile", message, hint)
