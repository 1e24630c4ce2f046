"""Rules for links and served links: addresses, names, and the box at this end.

A Wi-Fi bridge has two ends: a link at the site that uses it, a served link at the other site.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory import _draft, model
from atlantis_netcfg.inventory.findings import Finding, suggest
from atlantis_netcfg.inventory.rules.networks import example_in, why_unusable

if TYPE_CHECKING:
    from collections.abc import Iterator
    from ipaddress import IPv4Address


_RESERVED_NAME = "lan"
_MOST_SILENT_S = 1800


@dataclass(frozen=True, slots=True)
class BridgeEnd:
    """One end of a link, as its site's file defines it."""

    site: str
    path: tuple[str, int]
    link: model.Link | model.ServedLink
    kind: model.LinkKind

    @property
    def part(self) -> _draft.Part:
        """The site's part of the draft."""
        return _draft.Part("site", self.site)


def ends(draft: _draft.Draft) -> Iterator[BridgeEnd]:
    """Yield every link and served link of every site."""
    for name, site in draft.sites.items():
        for index, site_link in enumerate(site.bearers):
            yield BridgeEnd(name, ("bearers", index), site_link, site_link.kind)
        for index, link in enumerate(site.served_links):
            yield BridgeEnd(name, ("served_links", index), link, model.LinkKind.WIFI_PTP)


def addresses(draft: _draft.Draft) -> Iterator[Finding]:
    """Require that the router's address and the gateway are usable addresses of the link's network."""
    for end in ends(draft):
        link = end.link
        yield from _check_in_network(draft, end, "address", link.address)
        gateway = getattr(link, "gateway", None)
        if gateway is not None:
            yield from _check_in_network(draft, end, "gateway", gateway)


def gaps_leave_time(draft: _draft.Draft) -> Iterator[Finding]:
    """Report a link whose gaps take more than half of the time: no rehearsal can run over it."""
    for name, site in draft.sites.items():
        for index, link in enumerate(site.bearers):
            silent_s = sum(gap.length_s * gap.per_hour for gap in link.rate.gaps)
            if silent_s > _MOST_SILENT_S:
                message = msg(f"the gaps of link `{arg(link.name)}` take {arg(silent_s):g} s of each hour")
                hint = msg(f"set at most {arg(_MOST_SILENT_S)} s: shorter gaps (`length_s`), or fewer (`per_hour`)")
                yield draft.finding_at(_draft.Part("site", name), ("bearers", index, "rate", "gaps"), message, hint)


def _check_in_network(draft: _draft.Draft, end: BridgeEnd, key: str, address: IPv4Address) -> Iterator[Finding]:
    if why := why_unusable(address, end.link.network):
        message = msg(f"the {arg(key)} {arg(address)} of link `{arg(end.link.name)}` {arg(why)}")
        yield draft.finding_at(end.part, (*end.path, key), message, example_in(end.link.network))


def names(draft: _draft.Draft) -> Iterator[Finding]:
    """Require unique link names per site, different from the reserved word for the management port."""
    first_ends: dict[tuple[str, str], BridgeEnd] = {}
    for end in ends(draft):
        first = first_ends.setdefault((end.site, end.link.name), end)
        path = (*end.path, "name")
        if end.link.name == _RESERVED_NAME:
            message = "a link cannot be named `lan`: `via: lan` means the management port"
            yield draft.finding_at(end.part, path, message, "choose another name")
        elif first is not end:
            line = draft.mark(first.part, *first.path, "name").line
            message = msg(
                f"`{arg(end.link.name)}` is the name of two links of `{arg(end.site)}`, first in line {arg(line)}"
            )
            yield draft.finding_at(end.part, path, message, "give each link its own name")


def devices(draft: _draft.Draft) -> Iterator[Finding]:
    """Require that a link has the device that its kind needs, at the same site."""
    for end in ends(draft):
        kind = end.kind.traits.box
        if end.link.device is None:
            if kind is not None:
                message = msg(f"link `{arg(end.link.name)}` is {arg(end.kind)} and has no device")
                hint = msg(f"add `device:` with {arg(_candidates(draft, end.site, kind))}")
                yield draft.finding_at(end.part, end.path, message, hint)
        elif problem := _wrong_device(draft, end, end.link.device, kind):
            yield draft.finding_at(end.part, (*end.path, "device"), *problem)


def _candidates(draft: _draft.Draft, site: str, kind: str) -> str:
    here = [host for host, place in draft.layout.hosts.items() if place == site and draft.kind_of(host) == kind]
    return msg(f"`{arg(here[0])}`" if here else f"a {arg(kind)} at the site")


def _wrong_device(draft: _draft.Draft, end: BridgeEnd, host: str, kind: str | None) -> tuple[str, str] | None:
    if host not in draft.layout.hosts:
        here = [name for name, site in draft.layout.hosts.items() if site == end.site]
        return msg(f"host `{arg(host)}` does not exist"), suggest(host, here, none="add it to hosts.yml")
    if draft.layout.hosts[host] != end.site:
        message = msg(f"`{arg(host)}` is at site `{arg(draft.layout.hosts[host])}`, not at `{arg(end.site)}`")
        return message, msg(
            f"name {arg(_candidates(draft, end.site, kind))}" if kind is not None else "remove `device:`"
        )
    is_a = draft.kind_of(host)
    if kind is None:
        return msg(f"link `{arg(end.link.name)}` is a plain cable (ethernet) and has no device"), "remove `device:`"
    if is_a is not None and is_a != kind:
        message = msg(f"link `{arg(end.link.name)}` is {arg(end.kind)}, but `{arg(host)}` is a {arg(is_a)}")
        return message, msg(f"name {arg(_candidates(draft, end.site, kind))}")
    return None


def each_box_once(draft: _draft.Draft) -> Iterator[Finding]:
    """Report a device that is used by two links."""
    for end, first in _shared_devices(draft):
        where = draft.where(first.part, *first.path, "device")
        message = msg(f"`{arg(end.link.device)}` already carries link `{arg(first.link.name)}` ({arg(where)})")
        yield draft.finding_at(end.part, (*end.path, "device"), message, "a device carries one link")


def _shared_devices(draft: _draft.Draft) -> Iterator[tuple[BridgeEnd, BridgeEnd]]:
    first_ends: dict[str, BridgeEnd] = {}
    for end in ends(draft):
        if end.link.device is None or _wrong_device(draft, end, end.link.device, end.kind.traits.box) is not None:
            continue
        first = first_ends.setdefault(end.link.device, end)
        if first is not end:
            yield end, first


def no_box_idle(draft: _draft.Draft) -> Iterator[Finding]:
    """Report a radio without a link, unless a link of its kind lacks one: that is reported there."""
    waiting = {(end.site, end.kind.traits.box) for end, _ in _shared_devices(draft)}
    used = set()
    for end in ends(draft):
        kind = end.kind.traits.box
        if end.link.device is None or _wrong_device(draft, end, end.link.device, kind) is not None:
            waiting.add((end.site, kind))
        used.add(end.link.device)
    boxes = {traits.box for traits in model.LINK_TRAITS.values()}
    for host, device in draft.devices.items():
        site = draft.layout.hosts[host]
        if device.kind not in boxes or host in used or site not in draft.sites:
            continue
        if (site, device.kind) not in waiting:
            message = msg(f"`{arg(host)}` carries no link of `{arg(site)}`")
            hint = msg(f"set it as `device:` of a link in group_vars/{arg(site)}.yml, or remove the host")
            yield draft.finding_at(_draft.Part("device", host), (), message, hint)


def boxes_in_network(draft: _draft.Draft) -> Iterator[Finding]:
    """Require that the box at this end has an address in the link's network."""
    second = [end for end, _ in _shared_devices(draft)]
    for end in ends(draft):
        host = end.link.device
        if host is None or end in second or _wrong_device(draft, end, host, end.kind.traits.box) is not None:
            continue
        device = draft.devices.get(host)
        path = ("access", "address") if isinstance(device, model.Cpe) else ("address",)
        address = device.access.address if isinstance(device, model.Cpe) else getattr(device, "address", None)
        if address is not None and (why := why_unusable(address, end.link.network)):
            message = msg(
                f"the address {arg(address)} of `{arg(host)}` {arg(why)}, the network of link `{arg(end.link.name)}`"
            )
            yield draft.finding_at(_draft.Part("device", host), path, message, example_in(end.link.network))


RULES: tuple[_draft.Rule, ...] = (
    addresses,
    names,
    devices,
    each_box_once,
    no_box_idle,
    boxes_in_network,
    gaps_leave_time,
)


def bridges(draft: _draft.Draft) -> Iterator[Finding]:
    """Require both ends of a Wi-Fi bridge, in one network with the served end as gateway."""
    every = list(ends(draft))
    if len(draft.sites) != len(draft.layout.sites):
        return  # an invalid site may hold the other end
    links = [end for end in every if end.path[0] == "bearers" and end.kind.traits.bridge]
    served_ends = [end for end in every if end.path[0] == "served_links"]
    findings = [finding for end in served_ends for finding in _check_carried_site(draft, end, links)]
    yield from findings
    for end in links:
        far = [other for other in served_ends if _carried_site(other) == end.site]
        if not far and not findings:  # a served link that carries a wrong site may be the one
            message = msg(f"no site serves the other end of link `{arg(end.link.name)}` of `{arg(end.site)}`")
            hint = msg(f"add it to `served_links` of the other site, with `carries: {arg(end.site)}`")
            yield draft.finding_at(end.part, end.path, message, hint)
        for other in far[1:]:
            where = draft.where(far[0].part, *far[0].path)
            message = msg(f"`{arg(end.site)}` is carried twice, first by `{arg(far[0].link.name)}` ({arg(where)})")
            yield draft.finding_at(other.part, (*other.path, "carries"), message, "keep one")
        if far:
            yield from _check_ends_agree(draft, end, far[0])


def _carried_site(end: BridgeEnd) -> str:
    return str(getattr(end.link, "carries", ""))


def _check_carried_site(draft: _draft.Draft, end: BridgeEnd, links: list[BridgeEnd]) -> Iterator[Finding]:
    carried_site, path = _carried_site(end), (*end.path, "carries")
    others = [site for site in draft.sites if site != end.site]
    if carried_site == end.site:
        message = msg(f"link `{arg(end.link.name)}` carries its own site")
        yield draft.finding_at(
            end.part, path, message, msg(f"name the site at the other end: {arg(join(', ', others))}")
        )
    elif carried_site not in draft.sites:
        yield draft.finding_at(
            end.part,
            path,
            msg(f"site `{arg(carried_site)}` does not exist"),
            suggest(carried_site, others, none="add the site"),
        )
    elif not any(link.site == carried_site for link in links):
        message = msg(f"`{arg(carried_site)}` has no wifi_ptp link that link `{arg(end.link.name)}` could serve")
        yield draft.finding_at(
            end.part, path, message, msg(f"add the link to `{arg(carried_site)}`, or remove this link")
        )


def _check_ends_agree(draft: _draft.Draft, near: BridgeEnd, far: BridgeEnd) -> Iterator[Finding]:
    if near.link.network != far.link.network:
        where = draft.where(far.part, *far.path, "network")
        message = msg(
            f"the two ends of link `{arg(near.link.name)}` are in different networks: {arg(near.link.network)} here, "
            f"`{arg(far.site)}` has {arg(far.link.network)} ({arg(where)})"
        )
        yield draft.finding_at(near.part, (*near.path, "network"), message, "make both equal")
        return
    gateway = getattr(near.link, "gateway", None)
    if gateway != far.link.address:
        where = draft.where(far.part, *far.path, "address")
        message = msg(f"the gateway {arg(gateway)} of link `{arg(near.link.name)}` is not the router that serves it")
        yield draft.finding_at(
            near.part, (*near.path, "gateway"), message, msg(f"{arg(far.link.address)}, as in {arg(where)}")
        )


BRIDGES_RULES: tuple[_draft.Rule, ...] = (bridges,)
