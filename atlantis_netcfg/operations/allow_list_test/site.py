"""The satellite link of a site: selection, price of the test, and the session to its router."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.links import cost
from atlantis_netcfg.links.satellite import judge_names
from atlantis_netcfg.operations.allow_list_test import plan, prove
from atlantis_netcfg.operations.common.costs import ports_of, ways_of
from atlantis_netcfg.operations.common.jobs import device_job
from atlantis_netcfg.operations.common.session_link import site_link_of
from atlantis_netcfg.operations.common.site_links import links_of
from atlantis_netcfg.routeros.api import Session, Traffic
from atlantis_netcfg.routeros.estimate import on_the_wire
from atlantis_netcfg.runs import NoJournal

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.inventory.model import Link
    from atlantis_netcfg.links import LinkFinding
    from atlantis_netcfg.operations.common.request import Request


@dataclass(frozen=True, slots=True)
class Satellite:
    """A satellite link with its terminal and its router."""

    site: str
    link: Link
    router: Host
    port: str
    terminal: Host

    def proving(
        self,
        inventory: Inventory,
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
            pilot=inventory.pilot,
            site=self.site,
            link=self.link,
            router=self.router.name,
            port=self.port,
            ways=ways_of(inventory, self.router),
            terminal=self.terminal.name,
            carrier=site_link_of(inventory, self.router, via).name,
            open_filter=open_filter,
            try_all=try_all,
            pace=prove.ProofPace(sleep=_no_wait) if is_rehearsal else prove.ProofPace(),
        )


def satellite_of(inventory: Inventory, site: str, name: str | None) -> Satellite:
    """Return the named satellite link of a site, or the only one; raise NothingToProve."""
    site_link = _link(inventory, site, name)
    router = inventory.router_of(site)
    port = None
    if router is not None:
        port = next((port for port, link in ports_of(router).items() if link == site_link.name), None)
    if router is None or port is None:
        raise plan.NothingToProve(f"no router of `{arg(site)}` has a port for `{arg(site_link.name)}`")
    # A valid inventory gives every satellite link its terminal.
    return Satellite(site, site_link, router, port, inventory.hosts[str(site_link.device)])


def _link(inventory: Inventory, site: str, name: str | None) -> Link:
    if site not in inventory.sites:
        raise plan.NothingToProve("test one site at a time", hint=f"sites: {arg(join(', ', inventory.sites))}")
    links = inventory.sites[site].bearers
    satellites = [link for link in links if link.kind.traits.allow_list]
    choices = join(", ", (f"bearer={link.name}" for link in satellites)) or "there are none"
    if not satellites:
        raise plan.NothingToProve(f"`{arg(site)}` has no satellite link: nothing to test")
    matches = [link for link in satellites if name in {None, link.name}]
    if len(matches) != 1:
        why = msg(
            f"`{arg(site)}` has several satellite links"
            if name is None
            else f"`{arg(site)}` has no satellite link `{arg(name)}`"
        )
        raise plan.NothingToProve(why, hint=f"type one of: {arg(choices)}")
    return matches[0]


def names_of(inventory: Inventory, site: str, name: str | None) -> tuple[LinkFinding, ...]:
    """Resolve every name of the allow-list on this computer; return findings for changed addresses."""
    targets = plan.named_targets(inventory, site, _link(inventory, site, name))
    addresses = asyncio.run(plan.resolve(target.dns_name for target in targets))
    return judge_names(targets, addresses, "this computer")


def try_out(inventory: Inventory, router: Host, request: Request, proving: prove.Proving) -> prove.Proof:
    """Open a session to the router and run the test; raise DeviceError or OutcomeUnknown."""
    return asyncio.run(_run_proof(inventory, router, request, proving))


async def _run_proof(inventory: Inventory, router: Host, request: Request, proving: prove.Proving) -> prove.Proof:
    job = device_job(inventory, router, request, NoJournal(), proving.notify)
    traffic: list[Traffic] = []
    async with await Session.open(replace(job.endpoint, opening=traffic.append)) as session:
        proof = await proving.run(session)
    return replace(proof, sessions=Traffic.total(traffic).connections)


def previews(inventory: Inventory, proving: prove.Proving) -> tuple[cost.Preview, ...]:
    """Return the maximum cost of a test: of the session's link if it is another one, then of the satellite."""
    links = links_of(inventory, proving.site)
    satellite = cost.preview(proving.expected_bytes, proving.seconds, links[proving.link.name], at_most=True)
    if proving.carrier == proving.link.name:
        return (satellite,)
    return cost.preview(proving.session_bytes, proving.seconds, links[proving.carrier], at_most=True), satellite


def bills(inventory: Inventory, proof: prove.Proof, seconds: float) -> Mapping[str, cost.Bill]:
    """Return the cost of a test by link: the satellite's, and that of the session's link if it is another one.

    The router's count starts within the session: the bytes that opened it are added.
    """
    links = links_of(inventory, proof.site)
    if proof.carrier == proof.link:
        opening = on_the_wire(proof.opening_bytes, proof.sessions)
        return {proof.link: cost.preview(proof.bytes_counted + opening, seconds, links[proof.link]).bill}
    wire_bytes = on_the_wire(proof.session_bytes, proof.sessions)
    bytes_by_link = {proof.link: proof.bytes_counted, proof.carrier: wire_bytes}
    return {name: cost.preview(nbytes, seconds, links[name]).bill for name, nbytes in bytes_by_link.items()}


async def _no_wait(_seconds: float) -> None:
    """Return at once, in place of a wait."""
