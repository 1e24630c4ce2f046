"""Power over Ethernet: who feeds whom."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from atlantis_netcfg.declaration._draft import Draft, Part, Rule
from atlantis_netcfg.declaration._near import meant
from atlantis_netcfg.declaration.model import PoeMode, Port, PortUse, Router

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.declaration.findings import Finding
    from atlantis_netcfg.declaration.model import Bearer, PowerSource, ServedLink

__all__ = ["RULES"]


def _fed(draft: Draft) -> Iterator[tuple[str, PowerSource]]:
    """Every device that says who feeds it."""
    for host, device in draft.devices.items():
        if device.powered_by is not None:
            yield host, device.powered_by


def _rightly_fed(draft: Draft) -> Iterator[tuple[str, PowerSource]]:
    """Those that name the router of their own site."""
    for host, source in _fed(draft):
        if _wrong_source(draft, host, source.device, []) is None:
            yield host, source


def source_known(draft: Draft) -> Iterator[Finding]:
    """The source is the router of the same site."""
    for host, source in _fed(draft):
        if _wrong_source(draft, host, source.device, []) is None:
            continue
        site = draft.layout.hosts[host]
        routers = [name for name, place in draft.layout.hosts.items() if place == site and _is_router(draft, name)]
        if problem := _wrong_source(draft, host, source.device, routers):
            yield draft.wrong(Part("device", host), ("powered_by", "device"), *problem)


def _is_router(draft: Draft, host: str) -> bool:
    return draft.kind_of(host) == "router"


def _wrong_source(draft: Draft, host: str, source: str, routers: list[str]) -> tuple[str, str] | None:
    named = f"name the router of the site: {', '.join(routers)}" if routers else "remove `powered_by:`"
    if source not in draft.layout.hosts:
        return f"there is no host `{source}`", meant(source, routers, none=named)
    if source == host:
        return f"`{host}` cannot feed itself", named
    if draft.layout.hosts[source] != draft.layout.hosts[host]:
        return f"`{source}` is at site `{draft.layout.hosts[source]}`, `{host}` is not", named
    if draft.kind_of(source) is not None and not _is_router(draft, source):
        return f"`{source}` is a {draft.kind_of(source)}: only a router feeds others", named
    return None


def port_feeds(draft: Draft) -> Iterator[Finding]:
    """The port exists, can feed, is switched on, and is the port that the device's link is on."""
    fed = Counter((source.device, source.port) for _, source in _fed(draft))
    for host, source in _rightly_fed(draft):
        router = draft.devices.get(source.device)
        shared = fed[source.device, source.port] > 1
        if isinstance(router, Router) and (problem := _wrong_port(draft, host, source, router, shared=shared)):
            yield draft.wrong(Part("device", host), ("powered_by", "port"), *problem)


def _wrong_port(
    draft: Draft, host: str, source: PowerSource, router: Router, *, shared: bool
) -> tuple[str, str] | None:
    port = next((port for port in router.ports if port.name == source.port), None)
    feeding = ", ".join(item.name for item in router.ports if item.poe is not None and item.poe.out is not PoeMode.OFF)
    hint = f"ports of `{source.device}` that feed: {feeding or 'none'}"
    if port is None:
        return f"`{source.device}` has no port {source.port}", hint
    if port.poe is None:
        return f"port {port.name} of `{source.device}` cannot feed power: it has no `poe`", hint
    if port.poe.out is PoeMode.OFF:
        return f"port {port.name} of `{source.device}` has its power switched off", hint
    if shared:
        return None  # two devices on one port: that is told, and which of them is right is not known
    link = _link_of(draft, host)
    if link is not None and port.use is PortUse.LINK and port.link in _links_at(draft, host) - {link}:
        message = f"`{host}` carries link `{link}`, but port {port.name} leads to link `{port.link}`"
        return message, "power and data use one cable: " + _cable(router.ports, link)
    return None


def _cable(ports: tuple[Port, ...], link: str) -> str:
    right = next((port.name for port in ports if port.link == link), None)
    return f"port: {right}" if right is not None else "name the port of its link"


def _links(draft: Draft, host: str) -> tuple[Bearer | ServedLink, ...]:
    site = draft.sites.get(draft.layout.hosts[host])
    return (*site.bearers, *site.served_links) if site is not None else ()


def _links_at(draft: Draft, host: str) -> set[str | None]:
    return {link.name for link in _links(draft, host)}


def _link_of(draft: Draft, host: str) -> str | None:
    return next((link.name for link in _links(draft, host) if link.device == host), None)


def one_device_a_port(draft: Draft) -> Iterator[Finding]:
    """A port feeds one device."""
    seen: dict[tuple[str, str], str] = {}
    for host, source in _rightly_fed(draft):
        first = seen.setdefault((source.device, source.port), host)
        if first != host:
            where = draft.where(Part("device", first), "powered_by", "port")
            message = f"port {source.port} of `{source.device}` already feeds `{first}` ({where})"
            yield draft.wrong(Part("device", host), ("powered_by", "port"), message, "a port feeds one device")


RULES: tuple[Rule, ...] = (source_known, port_feeds, one_device_a_port)
