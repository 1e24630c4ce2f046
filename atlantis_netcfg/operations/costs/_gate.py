"""Before the first byte: what a request will send over links that are paid by the byte, and whether anybody agreed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from atlantis_netcfg.bearers.cost import ACCEPT, CostRefused, preview
from atlantis_netcfg.declaration.model import Gateway, LteDriver, LteRouter, Router, VpnServer
from atlantis_netcfg.operations import request as requests
from atlantis_netcfg.operations.bearers import bearer_of
from atlantis_netcfg.operations.costs._links import link_of
from atlantis_netcfg.operations.kinds import handled
from atlantis_netcfg.operations.request import Mode
from atlantis_netcfg.routeros.estimate import Estimate
from atlantis_netcfg.routeros.estimate import beforehand as before_reading

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.bearers.cost import Link, Preview
    from atlantis_netcfg.declaration import Declaration, Host
    from atlantis_netcfg.operations.request import Request
    from atlantis_netcfg.routeros.estimate import Bearer

__all__ = ["accepting", "beforehand", "gate", "unpaid"]

_TOOL: Final = 60_000
"""Bytes of the program that runs our modules on a gateway, packed; a test holds that it is no more."""
_LOOK: Final = (28_000, 10_000)
"""Bytes up and down of all roles where nothing is to be done."""
_WORK: Final = (94_000, 46_000)
"""The same on a gateway that has nothing yet, the program among them."""


def beforehand(
    declaration: Declaration, hosts: Sequence[Host], request: Request, *, at_most: bool = True
) -> tuple[Preview, ...]:
    """One preview for each metered link that sessions of this request go over, devices on one link added up.

    `at_most`: a run that may write is told as if all of its text had to be written, since nobody has read the device
    yet, and a plan as if the device's parser had to see all of it; otherwise the reading alone.

    Raises UsageError for a link that a site does not have.
    """
    sums: dict[Link, list[Estimate]] = {}
    bounds: set[Link] = set()
    for host in hosts:
        bearer = _carrier(declaration, host, request)
        if bearer is not None and bearer.metered:
            link = link_of(declaration, host.site, bearer.name)
            sums.setdefault(link, []).append(_host(host, bearer, request, at_most=at_most))
            if at_most and (_writes(request) or (request.mode is Mode.PLAN and handled(host))):
                bounds.add(link)
    return tuple(
        preview(
            sum(each.wire_bytes for each in found),
            sum(each.seconds for each in found),
            link,
            at_most=link in bounds,
        )
        for link, found in sums.items()
    )


def gate(declaration: Declaration, hosts: Sequence[Host], request: Request) -> None:
    """Let a request through, or raise CostRefused before its first byte; a rehearsal costs nothing.

    Beyond the cap nothing helps. What a run would write is judged against the cap once its plan is known.
    Raises UsageError for a link that a site does not have.
    """
    readings = beforehand(declaration, hosts, request, at_most=False)
    if request.rehearsed:
        return
    for reading in readings:
        if reading.over_cap:
            raise reading.refusal()
    if not request.accept_cost:
        dear = beforehand(declaration, hosts, request)
        if dear:
            raise unpaid([each.words for each in dear], request.command)


def unpaid(words: Sequence[str], command: str = "provision") -> CostRefused:
    """The error for what nobody has agreed to pay; `command` tells by which door it was asked for."""
    return CostRefused(
        f"nobody has agreed to pay for this, so nothing was sent: {'; '.join(words)}",
        hint=f"type the same with {accepting(command)} (`--yes` does not say that), or go over another link: `via=lan`",
    )


def accepting(command: str) -> str:
    """What a person types to pay, by the door that they came in by."""
    return f"`-e {requests.ACCEPT_COST}=true`" if command == requests.PLAIN_ANSIBLE else f"`{ACCEPT}`"


def _carrier(declaration: Declaration, host: Host, request: Request) -> Bearer | None:
    """What a session to a host goes over; None: none is opened, or it is a modem of this computer.

    A RutOS unit says nothing of a way of its own: it stands behind the router of its site, and is reached as that is.
    Of a computer nothing is backed up.
    """
    if handled(host) or (isinstance(host.device, Gateway | VpnServer) and request.mode is not Mode.BACKUP):
        return bearer_of(declaration, host, request.via.get(host.name))
    if not isinstance(host.device, LteRouter) or host.device.driver is not LteDriver.RUTOS:
        return None
    here = (one for one in declaration.hosts.values() if one.site == host.site and isinstance(one.device, Router))
    router = next(here, None)
    if router is None:
        return None
    return bearer_of(declaration, router, request.via.get(host.name) or request.via.get(router.name))


def _host(host: Host, bearer: Bearer, request: Request, *, at_most: bool) -> Estimate:
    if handled(host):
        return _estimate(bearer, request, at_most=at_most)
    if isinstance(host.device, Gateway | VpnServer):
        return _computer(bearer, writes=at_most and _writes(request))
    return _unit(bearer)


def _computer(bearer: Bearer, *, writes: bool) -> Estimate:
    """All roles of a computer over SSH; measured on an emulated gateway behind 700 ms and 352/704 kbit/s.

    Nothing to do: 26.5 kB up, 9.5 kB down and 44 s in 49 round trips, with a new connection and the role of a bundle.
    All to do: 81 kB up with a program of 53 kB, 45 kB down, 21 s of work on the spot; its round trips are inferred.
    Whether the computer has the program that runs our modules in the version of today nobody knows beforehand, so it is
    always counted. What it fetches by itself, packages and sources, comes on top: the modules that fetch it keep to the
    cap.
    """
    up, down = _WORK if writes else (_LOOK[0] + _TOOL, _LOOK[1])
    trips, work_s = (60, 25.0) if writes else (50, 3.0)
    seconds = trips * bearer.rtt_s + 8 * up / bearer.rate_up_bps + 8 * down / bearer.rate_down_bps + work_s
    return Estimate(bearer.name, trips, up, down, seconds)


def _unit(bearer: Bearer) -> Estimate:
    """A look at a RutOS unit: two HTTPS sessions with a few kB of JSON (inferred, not measured on a unit)."""
    return Estimate(bearer.name, 8, 4_000, 12_000, 12 * bearer.rtt_s, sessions=2)


def _estimate(bearer: Bearer, request: Request, *, at_most: bool) -> Estimate:
    if request.mode is Mode.BACKUP:
        return before_reading(bearer, exports=True)
    plans = at_most and request.mode is Mode.PLAN
    return before_reading(bearer, writes=at_most and _writes(request), plans=plans)


def _writes(request: Request) -> bool:
    return not request.mode.reads_only and request.mode is not Mode.BACKUP
