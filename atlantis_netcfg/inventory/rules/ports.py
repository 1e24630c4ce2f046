"""Rules for ports: a router has one for management, some for the LAN, one per link; a switch has one uplink.

Also Power over Ethernet: which port powers which device.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory import _draft, model
from atlantis_netcfg.inventory.findings import Finding, suggest

if TYPE_CHECKING:
    from collections.abc import Iterator


def links_of(site: model.Site) -> list[str]:
    """Return the names of a site's links and served links, as a port may name them."""
    return [*(site_link.name for site_link in site.bearers), *(link.name for link in site.served_links)]


def names(draft: _draft.Draft) -> Iterator[Finding]:
    """Report a port that is listed twice."""
    for host, device in draft.devices.items():
        part, index_by_name = _draft.Part("device", host), dict[str, int]()
        ports: tuple[model.Port | model.SwitchPort, ...] = (
            device.ports if isinstance(device, model.Router | model.Switch) else ()
        )
        for index, port in enumerate(ports):
            first = index_by_name.setdefault(port.name, index)
            if first != index:
                line = draft.mark(part, "ports", first, "name").line
                message = msg(f"port {arg(port.name)} is here twice, first in line {arg(line)}")
                yield draft.finding_at(part, ("ports", index, "name"), message, "remove one, or name the other port")


def require_one_management_port(draft: _draft.Draft) -> Iterator[Finding]:
    """Require exactly one management port: the way into a router when everything else fails."""
    for host, _, router in draft.valid_devices(model.Router):
        part = _draft.Part("device", host)
        used = [index for index, port in enumerate(router.ports) if port.use is model.PortUse.MANAGEMENT]
        if not used:
            message = msg(f"`{arg(host)}` has no management port: nobody could reach it when its links fail")
            yield draft.finding_at(part, ("ports",), message, "give one port `use: management`")
        for index in used[1:]:
            message = msg(f"`{arg(host)}` has a second management port, the first is {arg(router.ports[used[0]].name)}")
            hint = "keep one: the management network is on a single port"
            yield draft.finding_at(part, ("ports", index, "use"), message, hint)


def require_lan_port(draft: _draft.Draft) -> Iterator[Finding]:
    """Require a LAN port on every router."""
    for host, _, router in draft.valid_devices(model.Router):
        if not any(port.use is model.PortUse.LAN for port in router.ports):
            message = msg(f"`{arg(host)}` has no LAN port: robots and gateway could not be connected")
            yield draft.finding_at(_draft.Part("device", host), ("ports",), message, "give one port `use: lan`")


def link_and_use(draft: _draft.Draft) -> Iterator[Finding]:
    """Require `link` on a port with `use: link`, and on no other."""
    for host, _, router in draft.valid_devices(model.Router):
        for index, port in enumerate(router.ports):
            if port.use is model.PortUse.LINK and port.link is None:
                message = msg(f"port {arg(port.name)} is for a link, but does not say which")
                yield draft.finding_at(
                    _draft.Part("device", host), ("ports", index), message, "add `link: <name of the link>`"
                )
            elif port.use is not model.PortUse.LINK and port.link is not None:
                message = msg(f"port {arg(port.name)} names link `{arg(port.link)}`, but its use is {arg(port.use)}")
                hint = "write `use: link`, or remove `link:`"
                yield draft.finding_at(_draft.Part("device", host), ("ports", index, "link"), message, hint)


def known_links(draft: _draft.Draft) -> Iterator[Finding]:
    """Require that a port's link exists at its site."""
    for host, name, router in draft.valid_devices(model.Router):
        site = draft.sites.get(name)
        if site is None:
            continue
        for index, port in enumerate(router.ports):
            if port.link is None or port.use is not model.PortUse.LINK or port.link in links_of(site):
                continue
            elsewhere = [other for other, item in draft.sites.items() if port.link in links_of(item)]
            message = msg(
                f"`{arg(name)}` has no link `{arg(port.link)}`"
                + (f": that link belongs to `{arg(elsewhere[0])}`" if elsewhere else "")
            )
            hint = suggest(port.link, links_of(site), none="")
            yield draft.finding_at(_draft.Part("device", host), ("ports", index, "link"), message, hint)


def one_port_a_link(draft: _draft.Draft) -> Iterator[Finding]:
    """Require exactly one router port for every link of the site."""
    for name, site in draft.sites.items():
        site_router = draft.router_of(name)
        if site_router is None:
            continue
        host, router = site_router
        part = _draft.Part("device", host)
        unclear = any(_unclear(port.use, port.link, site) for port in router.ports)
        links = links_of(site)
        for link in (item for item in links if links.count(item) == 1):
            used = [
                index for index, port in enumerate(router.ports) if port.use is model.PortUse.LINK and port.link == link
            ]
            if not used and not unclear:
                message = msg(f"no port of `{arg(host)}` leads to link `{arg(link)}` of `{arg(name)}`")
                yield draft.finding_at(part, ("ports",), message, msg(f"give one port `use: link, link: {arg(link)}`"))
            for index in used[1:]:
                message = msg(f"link `{arg(link)}` is already on port {arg(router.ports[used[0]].name)}")
                yield draft.finding_at(part, ("ports", index, "link"), message, "a link has one port")


def one_uplink(draft: _draft.Draft) -> Iterator[Finding]:
    """Require exactly one uplink port on a switch: it is managed through it."""
    for host, _, switch in draft.valid_devices(model.Switch):
        part = _draft.Part("device", host)
        used = [index for index, port in enumerate(switch.ports) if port.use is model.SwitchPortUse.UPLINK]
        if not used:
            message = msg(f"`{arg(host)}` has no port towards the router: nobody could reach it")
            yield draft.finding_at(part, ("ports",), message, "give one port `use: uplink`")
        for index in used[1:]:
            message = msg(f"`{arg(host)}` has a second uplink, the first is {arg(switch.ports[used[0]].name)}")
            yield draft.finding_at(
                part, ("ports", index, "use"), message, "keep one: two cables to one LAN make a loop"
            )


def isolated_in_the_lan(draft: _draft.Draft) -> Iterator[Finding]:
    """Require that an isolated switch port is a LAN port."""
    for host, _, switch in draft.valid_devices(model.Switch):
        for index, port in enumerate(switch.ports):
            if port.isolated and port.use is not model.SwitchPortUse.LAN:
                message = msg(f"port {arg(port.name)} is isolated, but its use is {arg(port.use)}")
                yield draft.finding_at(
                    _draft.Part("device", host), ("ports", index, "isolated"), message, "write `use: lan`, or remove it"
                )


def _unclear(use: model.PortUse, link: str | None, site: model.Site) -> bool:
    """Return whether a port has an error reported elsewhere; it may be the port that is missing here."""
    if use is model.PortUse.LINK:
        return link not in links_of(site)
    return link is not None


RULES: tuple[_draft.Rule, ...] = (
    names,
    require_one_management_port,
    require_lan_port,
    link_and_use,
    known_links,
    one_port_a_link,
    one_uplink,
    isolated_in_the_lan,
)


def _powered_devices(draft: _draft.Draft) -> Iterator[tuple[str, model.PowerSource]]:
    """Yield every device with `powered_by`."""
    for host, device in draft.devices.items():
        if device.powered_by is not None:
            yield host, device.powered_by


def _devices_with_valid_source(draft: _draft.Draft) -> Iterator[tuple[str, model.PowerSource]]:
    """Yield the devices whose power source is the router or a switch of their own site."""
    for host, source in _powered_devices(draft):
        if _wrong_source(draft, host, source.device, []) is None:
            yield host, source


def source_known(draft: _draft.Draft) -> Iterator[Finding]:
    """Require that the power source is the router or a switch of the same site."""
    for host, source in _powered_devices(draft):
        if _wrong_source(draft, host, source.device, []) is None:
            continue
        site = draft.layout.hosts[host]
        able = [
            name
            for name, place in draft.layout.hosts.items()
            if place == site and name != host and _can_feed(draft, name)
        ]
        if problem := _wrong_source(draft, host, source.device, able):
            yield draft.finding_at(_draft.Part("device", host), ("powered_by", "device"), *problem)


def _can_feed(draft: _draft.Draft, host: str) -> bool:
    return draft.kind_of(host) in {"router", "switch"}


def _wrong_source(draft: _draft.Draft, host: str, source: str, able: list[str]) -> tuple[str, str] | None:
    hint = msg(f"name the router of the site: {arg(join(', ', able))}" if able else "remove `powered_by:`")
    if source not in draft.layout.hosts:
        return msg(f"host `{arg(source)}` does not exist"), suggest(source, able, none=hint)
    if source == host:
        return msg(f"`{arg(host)}` cannot power itself"), hint
    if draft.layout.hosts[source] != draft.layout.hosts[host]:
        return msg(f"`{arg(source)}` is at site `{arg(draft.layout.hosts[source])}`, but `{arg(host)}` is not"), hint
    if draft.kind_of(source) is not None and not _can_feed(draft, source):
        return msg(
            f"`{arg(source)}` is a {arg(draft.kind_of(source))}: only a router or a switch powers other devices"
        ), hint
    return None


def port_feeds(draft: _draft.Draft) -> Iterator[Finding]:
    """Require that the source port exists, supplies power, is enabled, and is the port of the device's link."""
    fed = Counter((source.device, source.port) for _, source in _powered_devices(draft))
    for host, source in _devices_with_valid_source(draft):
        router = draft.devices.get(source.device)
        is_shared = fed[source.device, source.port] > 1
        if isinstance(router, model.Router | model.Switch) and (
            problem := _wrong_port(draft, host, source, router, is_shared=is_shared)
        ):
            yield draft.finding_at(_draft.Part("device", host), ("powered_by", "port"), *problem)


def _wrong_port(
    draft: _draft.Draft, host: str, source: model.PowerSource, router: model.Router | model.Switch, *, is_shared: bool
) -> tuple[str, str] | None:
    ports: tuple[model.Port | model.SwitchPort, ...] = router.ports
    port = next((port for port in ports if port.name == source.port), None)
    feeding = join(
        ", ", (item.name for item in ports if item.poe is not None and item.poe.out is not model.PoeMode.OFF)
    )
    hint = msg(f"ports of `{arg(source.device)}` that supply power: {arg(feeding or 'none')}")
    if port is None:
        return msg(f"`{arg(source.device)}` has no port {arg(source.port)}"), hint
    if port.poe is None:
        return msg(f"port {arg(port.name)} of `{arg(source.device)}` cannot supply power: it has no `poe`"), hint
    if port.poe.out is model.PoeMode.OFF:
        return msg(f"port {arg(port.name)} of `{arg(source.device)}` has its power turned off"), hint
    if is_shared:
        return None  # two devices on one port: that is told, and which of them is right is not known
    return _other_cable(draft, host, source, router)


def _other_cable(
    draft: _draft.Draft, host: str, source: model.PowerSource, router: model.Router | model.Switch
) -> tuple[str, str] | None:
    """Report a power source on another port than the device's link: power and data share one cable."""
    link = _link_of(draft, host)
    if link is None:
        return None
    if isinstance(router, model.Switch):
        message = msg(
            f"`{arg(host)}` carries link `{arg(link)}`, but port {arg(source.port)} of `{arg(source.device)}` is in "
            "the LAN"
        )
        return message, "power and data share one cable, and that of a link leads to the router"
    port = next(port for port in router.ports if port.name == source.port)
    if port.use is model.PortUse.LINK and port.link in _links_at(draft, host) - {link}:
        message = msg(
            f"`{arg(host)}` carries link `{arg(link)}`, but port {arg(port.name)} leads to link `{arg(port.link)}`"
        )
        return message, msg("power and data use one cable: " + str(arg(_port_hint(router.ports, link))))
    return None


def _port_hint(ports: tuple[model.Port, ...], link: str) -> str:
    right = next((port.name for port in ports if port.link == link), None)
    return msg(f"port: {arg(right)}" if right is not None else "name the port of its link")


def _links(draft: _draft.Draft, host: str) -> tuple[model.Link | model.ServedLink, ...]:
    site = draft.sites.get(draft.layout.hosts[host])
    return (*site.bearers, *site.served_links) if site is not None else ()


def _links_at(draft: _draft.Draft, host: str) -> set[str | None]:
    return {link.name for link in _links(draft, host)}


def _link_of(draft: _draft.Draft, host: str) -> str | None:
    return next((link.name for link in _links(draft, host) if link.device == host), None)


def one_device_a_port(draft: _draft.Draft) -> Iterator[Finding]:
    """Report a port that powers two devices."""
    first_hosts: dict[tuple[str, str], str] = {}
    for host, source in _devices_with_valid_source(draft):
        first = first_hosts.setdefault((source.device, source.port), host)
        if first != host:
            where = draft.where(_draft.Part("device", first), "powered_by", "port")
            message = msg(
                f"port {arg(source.port)} of `{arg(source.device)}` already powers `{arg(first)}` ({arg(where)})"
            )
            yield draft.finding_at(
                _draft.Part("device", host), ("powered_by", "port"), message, "a port powers one device"
            )


POWER_RULES: tuple[_draft.Rule, ...] = (source_known, port_feeds, one_device_a_port)
