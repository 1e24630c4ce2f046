"""The router's ports: one for management, some for the LAN, one for each link."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.declaration._draft import Draft, Part, Rule
from atlantis_netcfg.declaration._near import meant
from atlantis_netcfg.declaration.model import PortUse, Router

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.declaration.findings import Finding
    from atlantis_netcfg.declaration.model import Site

__all__ = ["RULES", "links_of"]


def links_of(site: Site) -> list[str]:
    """The names of a site's links, as a port may name them."""
    return [*(bearer.name for bearer in site.bearers), *(link.name for link in site.served_links)]


def names(draft: Draft) -> Iterator[Finding]:
    """A port stands once in the list."""
    for host, _, router in draft.boxes(Router):
        part, seen = Part("device", host), dict[str, int]()
        for index, port in enumerate(router.ports):
            first = seen.setdefault(port.name, index)
            if first != index:
                line = draft.mark(part, "ports", first, "name").line
                message = f"port {port.name} stands twice, first in line {line}"
                yield draft.wrong(part, ("ports", index, "name"), message, "remove one, or name the other port")


def one_for_management(draft: Draft) -> Iterator[Finding]:
    """Exactly one port belongs to the technician: it is how a router is reached when all else fails."""
    for host, _, router in draft.boxes(Router):
        part = Part("device", host)
        used = [index for index, port in enumerate(router.ports) if port.use is PortUse.MANAGEMENT]
        if not used:
            message = f"`{host}` has no management port: nobody could reach it when its links fail"
            yield draft.wrong(part, ("ports",), message, "give one port `use: management`")
        for index in used[1:]:
            message = f"`{host}` has a second management port, the first is {router.ports[used[0]].name}"
            hint = "keep one: the management network is on one port"
            yield draft.wrong(part, ("ports", index, "use"), message, hint)


def some_for_the_lan(draft: Draft) -> Iterator[Finding]:
    """A LAN needs a port."""
    for host, _, router in draft.boxes(Router):
        if not any(port.use is PortUse.LAN for port in router.ports):
            message = f"`{host}` has no LAN port: robots and gateway could not be plugged in"
            yield draft.wrong(Part("device", host), ("ports",), message, "give one port `use: lan`")


def link_and_use(draft: Draft) -> Iterator[Finding]:
    """`link` names the link of a `use: link` port, and of no other."""
    for host, _, router in draft.boxes(Router):
        for index, port in enumerate(router.ports):
            if port.use is PortUse.LINK and port.link is None:
                message = f"port {port.name} is for a link, but which is not said"
                yield draft.wrong(Part("device", host), ("ports", index), message, "add `link: <name of the link>`")
            elif port.use is not PortUse.LINK and port.link is not None:
                message = f"port {port.name} names link `{port.link}`, but its use is {port.use}"
                hint = "write `use: link`, or remove `link:`"
                yield draft.wrong(Part("device", host), ("ports", index, "link"), message, hint)


def known_links(draft: Draft) -> Iterator[Finding]:
    """A port names a link of its own site."""
    for host, name, router in draft.boxes(Router):
        site = draft.sites.get(name)
        if site is None:
            continue
        for index, port in enumerate(router.ports):
            if port.link is None or port.use is not PortUse.LINK or port.link in links_of(site):
                continue
            elsewhere = [other for other, item in draft.sites.items() if port.link in links_of(item)]
            message = f"`{name}` has no link `{port.link}`" + (
                f": that is one of `{elsewhere[0]}`" if elsewhere else ""
            )
            hint = meant(port.link, links_of(site), none="")
            yield draft.wrong(Part("device", host), ("ports", index, "link"), message, hint)


def one_port_a_link(draft: Draft) -> Iterator[Finding]:
    """Every link of the site has exactly one port of its router."""
    for name, site in draft.sites.items():
        found = draft.router_of(name)
        if found is None:
            continue
        host, router = found
        part = Part("device", host)
        unclear = any(_unclear(port.use, port.link, site) for port in router.ports)
        links = links_of(site)
        for link in (item for item in links if links.count(item) == 1):
            used = [index for index, port in enumerate(router.ports) if port.use is PortUse.LINK and port.link == link]
            if not used and not unclear:
                message = f"no port of `{host}` leads to link `{link}` of `{name}`"
                yield draft.wrong(part, ("ports",), message, f"give one port `use: link, link: {link}`")
            for index in used[1:]:
                message = f"link `{link}` is already on port {router.ports[used[0]].name}"
                yield draft.wrong(part, ("ports", index, "link"), message, "a link has one port")


def _unclear(use: PortUse, link: str | None, site: Site) -> bool:
    """A port that is told elsewhere: it may be the one that is missing here."""
    if use is PortUse.LINK:
        return link not in links_of(site)
    return link is not None


RULES: tuple[Rule, ...] = (names, one_for_management, some_for_the_lan, link_and_use, known_links, one_port_a_link)
