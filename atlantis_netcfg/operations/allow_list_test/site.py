"""The satellite link of a site: selection, price of the test, and the session to its router."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from atlantis_netcfg.links import cost
from atlantis_netcfg.links.satellite import judge_names
from atlantis_netcfg.operations.allow_list_test import plan, prove
from atlantis_netcfg.operations.common.costs import ports_of, ways_of
from atlantis_netcfg.operations.common.jobs import device_job
from atlantis_netcfg.operations.common.session_link import bearer_of
from atlantis_netcfg.operations.common.site_links import links_of
from atlantis_netcfg.routeros.api import Session, Traffic
from atlantis_netcfg.routeros.estimate import on_the_wire
from atlantis_netcfg.runs import NoJournal

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.inventory import Declaration, Host
    from atlantis_netcfg.inventory.model import Bearer
    from atlantis_netcfg.links import BearerFinding
    from atlantis_netcfg.operations.common.request import Request


@dataclass(frozen=True, slots=True)
class Satellite:
    """A satellite link with its terminal and its router."""

    site: str
    bearer: Bearer
    router: Host
    port: str
    terminal: Host

    def proving(
        self,
        declaration: Declaration,
        *,
        open_filter: bool = False,
        is_rehearsal: bool,
        try_all: bool = False,
        via: str | None = None,
    ) -> prove.Proving:
        """Return the test to run; in a rehearsal waits are skipped and only counted.

        `via`: the link to the router, if not the one in the inventory. Raises UsageError if there is no such link.
        """
        return prove.Proving(
            pilot=declaration.pilot,
            site=self.site,
            bearer=self.bearer,
            router=self.router.name,
            port=self.port,
            ways=ways_of(declaration, self.router),
            terminal=self.terminal.name,
            carrier=bearer_of(declaration, self.router, via).name,
            open_filter=open_filter,
            try_all=try_all,
            pace=prove.ProofPace(sleep=_no_wait) if is_rehearsal else prove.ProofPace(),
        )


def satellite_of(declaration: Declaration, site: str, name: str | None) -> Satellite:
    """Return the named satellite link of a site, or the only one; raise NothingToProve."""
    bearer = _bearer(declaration, site, name)
    router = declaration.router_of(site)
    port = None
    if router is not None:
        port = next((port for port, link in ports_of(router).items() if link == bearer.name), None)
    if router is None or port is None:
        raise plan.NothingToProve(f"no router of `{site}` has a port for `{bearer.name}`")
    # A valid declaration gives every satellite link its terminal.
    return Satellite(site, bearer, router, port, declaration.hosts[str(bearer.device)])


def _bearer(declaration: Declaration, site: str, name: str | None) -> Bearer:
    if site not in declaration.sites:
        raise plan.NothingToProve("prove one site at a time", hint=f"the sites are: {', '.join(declaration.sites)}")
    bearers = declaration.sites[site].bearers
    satellites = [bearer for bearer in bearers if bearer.kind.traits.allow_list]
    choices = ", ".join(f"bearer={bearer.name}" for bearer in satellites) or "it has none"
    if not satellites:
        raise plan.NothingToProve(f"`{site}` has no satellite link, so there is nothing to prove")
    matches = [bearer for bearer in satellites if name in {None, bearer.name}]
    if len(matches) != 1:
        why = f"`{site}` has several satellite links" if name is None else f"`{site}` has no satellite link `{name}`"
        raise plan.NothingToProve(why, hint=f"type one of: {choices}")
    return matches[0]


def names_of(declaration: Declaration, site: str, name: str | None) -> tuple[BearerFinding, ...]:
    """Resolve every name of the allow-list on this computer; return findings for changed addresses."""
    targets = plan.named_targets(declaration, site, _bearer(declaration, site, name))
    addresses = asyncio.run(plan.resolve(target.dns_name for target in targets))
    return judge_names(targets, addresses, "this computer")


def try_out(declaration: Declaration, router: Host, request: Request, proving: prove.Proving) -> prove.Proof:
    """Open a session to the router and run the test; raise DeviceError or OutcomeUnknown."""
    return asyncio.run(_try_out(declaration, router, request, proving))


async def _try_out(declaration: Declaration, router: Host, request: Request, proving: prove.Proving) -> prove.Proof:
    job = device_job(declaration, router, request, NoJournal(), proving.notify)
    traffic: list[Traffic] = []
    async with await Session.open(replace(job.endpoint, opening=traffic.append)) as session:
        proof = await proving.run(session)
    return replace(proof, sessions=Traffic.total(traffic).connections)


def previews(declaration: Declaration, proving: prove.Proving) -> tuple[cost.Preview, ...]:
    """Return the maximum cost of a test: of the session's link if it is another one, then of the satellite."""
    links = links_of(declaration, proving.site)
    satellite = cost.preview(proving.expected_bytes, proving.seconds, links[proving.bearer.name], at_most=True)
    if proving.carrier == proving.bearer.name:
        return (satellite,)
    return cost.preview(proving.session_bytes, proving.seconds, links[proving.carrier], at_most=True), satellite


def bills(declaration: Declaration, proof: prove.Proof, seconds: float) -> Mapping[str, cost.Bill]:
    """Return the cost of a test by link: the satellite's, and that of the session's link if it is another one.

    The router's count starts within the session: the bytes that opened it are added.
    """
    links = links_of(declaration, proof.site)
    if proof.carrier == proof.bearer:
        opening = on_the_wire(proof.opening_bytes, proof.sessions)
        return {proof.bearer: cost.preview(proof.bytes_counted + opening, seconds, links[proof.bearer]).bill}
    wire_bytes = on_the_wire(proof.session_bytes, proof.sessions)
    bytes_by_link = {proof.bearer: proof.bytes_counted, proof.carrier: wire_bytes}
    return {name: cost.preview(nbytes, seconds, links[name]).bill for name, nbytes in bytes_by_link.items()}


async def _no_wait(_seconds: float) -> None:
    """Return at once, in place of a wait."""
