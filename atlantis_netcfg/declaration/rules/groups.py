"""hosts.yml and the devices agree on what every host is."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.declaration._draft import Draft, Part, Rule
from atlantis_netcfg.declaration._hosts import KIND_GROUPS
from atlantis_netcfg.declaration.findings import Finding

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["RULES"]

_GROUP_OF = {kind: group for group, kind in KIND_GROUPS.items()}


def grouped(draft: Draft) -> Iterator[Finding]:
    """A host stands in the group of its kind: playbooks go by the group."""
    for host, mark in draft.layout.marks.items():
        kind, result = draft.layout.kinds.get(host), draft.kind_of(host)
        if kind is None and host not in draft.layout.misspelt:
            hint = (
                f"add `{host}:` below `{_GROUP_OF[result]}:`"
                if result is not None
                else "add it below its kind of device"
            )
            yield Finding.at(mark, f"`{host}` is in no group of devices", hint)
        elif kind is not None and result is not None and kind != result:
            group = draft.layout.kind_marks[host]
            message = f"`{host}` is a {result}, but stands in group `{_GROUP_OF[kind]}` ({group.file}:{group.line})"
            hint = f"move it to `{_GROUP_OF[result]}`, or write `kind: {kind}`"
            yield draft.wrong(Part("device", host), ("kind",), message, hint)


def one_router(draft: Draft) -> Iterator[Finding]:
    """A site has one router: it holds the LAN, every link and the management network."""
    for site, mark in draft.layout.sites.items():
        here = [host for host, place in draft.layout.hosts.items() if place == site]
        routers = [host for host in here if draft.kind_of(host) == "router"]
        unclear = any(draft.kind_of(host) is None for host in here)
        if not routers and not unclear:
            message = f"site `{site}` has no router" if here else f"site `{site}` has no hosts"
            yield Finding.at(mark, message, "add its router, below the site and below `routers:`")
        for second in routers[1:]:
            message = f"site `{site}` has a second router, the first is `{routers[0]}`"
            yield Finding.at(draft.layout.marks[second], message, "a site has one router: make it a site of its own")


RULES: tuple[Rule, ...] = (grouped, one_router)
