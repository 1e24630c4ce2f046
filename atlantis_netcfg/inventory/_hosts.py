"""`hosts.yml`: every host once under its site and once under its kind."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import nearest
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory.findings import Finding, Mark, suggest, why_no_name

if TYPE_CHECKING:
    from atlantis_netcfg.inventory._yaml import Node

KIND_GROUPS = {
    "routers": "router",
    "switches": "switch",
    "cpes": "cpe",
    "lte_routers": "lte_router",
    "satellite_terminals": "satellite_terminal",
    "gateways": "gateway",
    "vpn_servers": "vpn_server",
    "control_centres": "control_centre",
    "operator_stations": "operator_station",
}
"""Group in the inventory to the `kind` of its devices."""
_RESERVED_NAMES = ("all", "ungrouped", "sites", *KIND_GROUPS)


@dataclass(slots=True)
class HostLayout:
    """Sites and kinds of all hosts, in file order."""

    start: Mark
    sites: dict[str, Mark] = field(default_factory=dict)
    hosts: dict[str, str] = field(default_factory=dict)
    """Host to its site."""
    marks: dict[str, Mark] = field(default_factory=dict)
    """Host to its place below its site, or below its kind if it has no site."""
    kinds: dict[str, str] = field(default_factory=dict)
    """Host to its kind, from its group."""
    kind_marks: dict[str, Mark] = field(default_factory=dict)
    misspelt: dict[str, str] = field(default_factory=dict)
    """Correct host name to its kind, where the group has a misspelt name: that error is reported only once."""
    findings: list[Finding] = field(default_factory=list)

    def add_finding(self, mark: Mark, message: str, hint: str) -> None:
        """Record an error."""
        self.findings.append(Finding.at(mark, message, hint))


def parse_layout(root: Node) -> HostLayout:
    """Parse the groups of hosts.yml."""
    layout = HostLayout(root.mark)
    children = _block(layout, _block(layout, root, "hosts.yml", ("all",)).get("all"), "all", ("children", "vars"))
    groups = _block(layout, children.get("children"), "all.children", ("sites", *KIND_GROUPS))
    _check_vars(layout, children.get("vars"))
    sites = _block(layout, groups.get("sites"), "sites", ("children", "vars"))
    _check_vars(layout, sites.get("vars"))
    for name, node in _block(layout, sites.get("children"), "sites.children").items():
        _add_site(layout, name, node)
    for group, kind in KIND_GROUPS.items():
        _add_kind(layout, group, kind, groups.get(group))
    _check_names(layout)
    return layout


def _block(
    layout: HostLayout, node: Node | None, name: str, allowed_keys: tuple[str, ...] | None = None
) -> dict[str, Node]:
    """Return the keys of a block; a misspelt key is reported and corrected."""
    if node is None or node.value is None:
        return {}
    if isinstance(node.value, list):
        layout.add_finding(
            node.mark, msg(f"`{arg(name)}` needs a block of keys"), "write one `name:` per line, without `- `"
        )
        return {item.text: item for item in node.value if item.text} if allowed_keys is None else {}
    if not isinstance(node.value, dict):
        layout.add_finding(node.mark, msg(f"`{arg(name)}` needs a block of keys"), "write `name:` below it, indented")
        return {}
    if allowed_keys is None:
        return node.value
    block = {key: value for key, value in node.value.items() if key in allowed_keys}
    for key, value in node.value.items():
        if key not in allowed_keys:
            layout.add_finding(
                value.place, msg(f"unknown key `{arg(key)}` in `{arg(name)}`"), suggest(key, allowed_keys, none="")
            )
            block.setdefault(nearest(key, allowed_keys) or key, value)
    return block


def _add_site(layout: HostLayout, site: str, node: Node) -> None:
    layout.sites[site] = node.place
    block = _block(layout, node, site, ("hosts", "vars"))
    _check_vars(layout, block.get("vars"))
    for host, value in _block(layout, block.get("hosts"), f"{site}.hosts").items():
        if host in layout.hosts:
            message = msg(f"`{arg(host)}` is below two sites, `{arg(layout.hosts[host])}` and `{arg(site)}`")
            layout.add_finding(value.place, message, "a device is at one site: remove one of the two lines")
            continue
        layout.hosts[host] = site
        layout.marks[host] = value.place
        _check_host(layout, host, value)


def _add_kind(layout: HostLayout, group: str, kind: str, node: Node | None) -> None:
    block = _block(layout, node, group, ("hosts", "vars"))
    _check_vars(layout, block.get("vars"))
    for host, value in _block(layout, block.get("hosts"), f"{group}.hosts").items():
        _check_host(layout, host, value)
        if host not in layout.hosts:
            message = msg(f"`{arg(host)}` is in group `{arg(group)}` but at no site")
            layout.add_finding(value.place, message, suggest(host, layout.hosts, none="add it below its site"))
            layout.misspelt[nearest(host, layout.hosts) or host] = kind
        elif host in layout.kinds:
            layout.add_finding(
                value.place, msg(f"`{arg(host)}` has two kinds of device"), "remove one of the two lines"
            )
        else:
            layout.kinds[host] = kind
            layout.kind_marks[host] = value.place


def _check_vars(layout: HostLayout, node: Node | None, name: str = "vars") -> None:
    """Report variables in hosts.yml other than Ansible's own."""
    for key, value in _block(layout, node, name).items():
        if not key.startswith("ansible_"):
            hint = "move it to group_vars/ or host_vars/"
            layout.add_finding(value.place, msg(f"`{arg(key)}` does not belong in hosts.yml"), hint)


def _check_host(layout: HostLayout, host: str, node: Node) -> None:
    if node.text != host:  # an entry of a list, which is told, is its own value
        _check_vars(layout, node, host)


def _check_names(layout: HostLayout) -> None:
    for name, mark in [*layout.sites.items(), *layout.marks.items()]:
        if why := why_no_name(name):
            layout.add_finding(mark, *why)
    for site, mark in layout.sites.items():
        if site in _RESERVED_NAMES:
            layout.add_finding(
                mark, msg(f"a site cannot be named `{arg(site)}`: this is a group of its own"), "choose another name"
            )
    for host, mark in layout.marks.items():
        if host in layout.sites or host in _RESERVED_NAMES:
            message = msg(f"`{arg(host)}` is the name of both a host and a group")
            layout.add_finding(mark, message, msg(f"rename the host, for example `{arg(host)}-router`"))
