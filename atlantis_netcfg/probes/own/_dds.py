"""A participant of the declared DDS domain runs on the gateway computer; nothing is sent to find out.

Peers are announced to by unicast, so that nobody else hears them: what tells is which ports are bound. A participant
listens on 7400 + 250 d (multicast) and on 7410 + 250 d + 2 i (unicast), i below the declared number
(DDSI-RTPS 9.6.2.3).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers import Finding
from atlantis_netcfg.probes.own._reading import printed
from atlantis_netcfg.probes.own._site import OwnSite, run, step
from atlantis_netcfg.probes.own._words import declared, fail, good, listed, read, unknown, unreadable, warn
from atlantis_netcfg.probes.step import Judged

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from atlantis_netcfg.probes.answers import Answer
    from atlantis_netcfg.probes.questions import Question
    from atlantis_netcfg.probes.step import Step
    from atlantis_netcfg.site.model import Dds

__all__ = ["TABLE", "of"]

TABLE = "/proc/net/udp"
_BASE, _DOMAIN, _UNICAST, _EACH = 7400, 250, 10, 2
_LAST_DOMAIN = 101
"""Above it the ports meet those that Linux hands out."""
_ROW = re.compile(r"^\s*\d+: ([0-9A-F]{8}):([0-9A-F]{4}) .* (\d+)\s*$")


@dataclass(frozen=True, slots=True)
class _Socket:
    port: int
    drops: int
    """Datagrams that nobody took in time."""

    @property
    def domain(self) -> int:
        return (self.port - _BASE) // _DOMAIN

    @property
    def participant(self) -> int | None:
        """Its number, if this is the port on which it hears announcements."""
        offset = (self.port - _BASE) % _DOMAIN - _UNICAST
        return offset // _EACH if offset >= 0 and offset % _EACH == 0 else None


def of(site: OwnSite) -> Step:
    """The gateway computer's table of UDP sockets."""
    unless = "no DDS is declared for the pilot" if site.declaration.pilot.dds is None else ""
    if site.gateway is None:
        unless = "the site has no gateway computer on which DDS would run"
    return step("dds", "DDS is seen on the gateway computer", _Seen(site), site.hosts[1:], unless)


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
        sockets = tuple(_sockets(told))
        evidence = (
            declared("domain of DDS", str(wanted.domain)),
            read(f"UDP ports of DDS on {gateway.name}", ", ".join(str(one.port) for one in sockets) or "none"),
        )
        return Judged(tuple(_judged(gateway.name, wanted, sockets)), evidence)


def _sockets(text: str) -> Iterator[_Socket]:
    last = _BASE + _DOMAIN * (_LAST_DOMAIN + 1)
    found = {}
    for line in text.splitlines():
        row = _ROW.match(line)
        if row is not None and _BASE <= int(row[2], 16) < last:
            found[int(row[2], 16)] = int(row[3])
    return (_Socket(port, drops) for port, drops in sorted(found.items()) if _is_participant(_Socket(port, drops)))


def _is_participant(one: _Socket) -> bool:
    """Other programs have ports in that range, too; past the 120th participant the formula has no ports."""
    return one.participant is not None


def _judged(name: str, wanted: Dds, sockets: Sequence[_Socket]) -> Iterator[Finding]:
    ours = [one for one in sockets if one.domain == wanted.domain]
    near = [one for one in sockets if one.domain != wanted.domain and one.participant == 0]
    if not ours and near:
        message = (
            f"DDS on {name} runs in domain {listed(str(one.domain) for one in near)}, and {wanted.domain} is declared"
        )
        yield fail("other-domain", message, "set ROS_DOMAIN_ID as declared: source the site's ros.env before starting")
        return
    if not ours:
        hint = f"start the data gateway or any ROS 2 node on {name}, then repeat the check"
        message = f"nobody speaks DDS on {name} in domain {wanted.domain}, so nothing is announced"
        yield unknown("nobody-announces", message, hint)
        return
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
    if not late and not dropped:
        many = "1 participant listens" if len(ours) == 1 else f"{len(ours)} participants listen"
        yield good("listens", f"{many} on {name} in DDS domain {wanted.domain}, from port {ours[0].port}")
