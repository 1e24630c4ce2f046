"""The top-level variables of all files: each has one place, and everything else is told."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from atlantis_netcfg.core.suggest import nearest
from atlantis_netcfg.declaration._hosts import KIND_GROUPS
from atlantis_netcfg.declaration._near import meant, shown_key
from atlantis_netcfg.declaration.findings import Finding, Mark

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from atlantis_netcfg.declaration._hosts import Layout
    from atlantis_netcfg.declaration._node import Node
    from atlantis_netcfg.declaration._vault import Decrypt
    from atlantis_netcfg.declaration.loading import Sources

_HOMES = {
    "pilot": "group_vars/all/pilot.yml",
    "partners": "group_vars/all/partners.yml",
    "vehicles": "group_vars/all/vehicles.yml",
    "site": "group_vars/<site>.yml",
    "device": "host_vars/<host>.yml",
}
_OF_ALL = ("pilot", "partners", "vehicles")


@dataclass(slots=True)
class Variables:
    """The blocks of the declaration, not yet checked."""

    all: dict[str, Node] = field(default_factory=dict)
    """`pilot`, `partners`, `vehicles`."""
    sites: dict[str, Node] = field(default_factory=dict)
    devices: dict[str, Node] = field(default_factory=dict)
    findings: list[Finding] = field(default_factory=list)


def gather(sources: Sources, layout: Layout, decrypt: Decrypt | None) -> Variables:
    """Read every file of group_vars and host_vars."""
    return _Gatherer(sources, layout, decrypt).gather()


class _Gatherer:
    def __init__(self, sources: Sources, layout: Layout, decrypt: Decrypt | None) -> None:
        self.sources = sources
        self.layout = layout
        self.decrypt = decrypt
        self.result = Variables()

    def gather(self) -> Variables:
        """Everything, in an order that does not depend on the file system."""
        groups, hosts = self.sources.group_vars, self.sources.host_vars
        self._of_all(groups.get("all", []))
        for name in sorted(groups.keys() - {"all"}):
            self._group(name, groups[name])
        for name in sorted(hosts):
            self._host(name, hosts[name])
        for site, mark in self.layout.sites.items():
            self._expect(site, mark, groups, "site", "group_vars")
        for host, mark in self.layout.marks.items():
            self._expect(host, mark, hosts, "device", "host_vars")
        return self.result

    def _wrong(self, mark: Mark, message: str, hint: str) -> None:
        self.result.findings.append(Finding.at(mark, message, hint))

    def _of_all(self, paths: list[Path]) -> None:
        found, complete = self._variables(paths, _OF_ALL)
        self.result.all = found
        for name in _OF_ALL:
            if name not in found and complete:
                hint = f"write `{name}:` in {self.sources.shown}/{_HOMES[name]}"
                self._wrong(self.layout.start, f"nothing declares `{name}`", hint)

    def _group(self, name: str, paths: list[Path]) -> None:
        if name in self.layout.sites:
            found, complete = self._variables(paths, ("site",))
            self._keep(name, paths, found.get("site"), self.result.sites, "site", complete=complete)
        elif name in KIND_GROUPS or name == "sites":
            self._variables(paths, ())
        else:
            known = ["all", *self.layout.sites]
            self._orphan(paths, f"no site or group is called `{name}`", name, known, "group_vars")

    def _host(self, name: str, paths: list[Path]) -> None:
        if name in self.layout.hosts:
            found, complete = self._variables(paths, ("device",))
            self._keep(name, paths, found.get("device"), self.result.devices, "device", complete=complete)
        else:
            self._orphan(paths, f"no host is called `{name}`", name, self.layout.hosts, "host_vars")

    def _keep(  # noqa: PLR0913 - one step of two callers
        self, name: str, paths: list[Path], node: Node | None, into: dict[str, Node], variable: str, *, complete: bool
    ) -> None:
        if node is not None:
            into[name] = node
        elif complete and paths:
            self._wrong(Mark(self.sources.name(paths[0]), 1, 1), f"there is no `{variable}:` here", "write it")

    def _orphan(
        self, paths: list[Path], message: str, name: str, known: Mapping[str, object] | list[str], folder: str
    ) -> None:
        near = nearest(name, known)
        for path in paths:
            shown = self.sources.name(path)
            target = shown.replace(f"/{folder}/{name}", f"/{folder}/{near}", 1)
            hint = (
                f"did you mean `{near}`? mv {shown} {target}" if near else f"add it to {self.sources.shown}/hosts.yml"
            )
            self._wrong(Mark(shown, 1, 1), message, hint)

    def _expect(self, name: str, mark: Mark, files: Mapping[str, list[Path]], variable: str, folder: str) -> None:
        if files.get(name) or name in self.sources.strays:
            return
        known = self.layout.sites if folder == "group_vars" else self.layout.hosts
        orphans = [other for other in files if other not in known and nearest(other, known) == name]
        if not orphans:
            hint = f"write `{variable}:` in {self.sources.shown}/{folder}/{name}.yml"
            self._wrong(mark, f"`{name}` has no file in {folder}/", hint)

    def _variables(self, paths: list[Path], allowed: tuple[str, ...]) -> tuple[dict[str, Node], bool]:
        """The allowed variables of the files, and whether every file could be read."""
        found: dict[str, Node] = {}
        complete = True
        for path in paths:
            node, findings = self.sources.read(path, self.decrypt)
            self.result.findings.extend(findings)
            complete = complete and (node is not None or not findings)
            if node is None or node.value is None:
                continue
            if not isinstance(node.value, dict):
                complete = False
                self._wrong(node.mark, "a file holds `name:` and below it, indented, the values", "write it so")
                continue
            for name, value in node.value.items():
                self._variable(name, value, allowed, found)
        return found, complete

    def _variable(self, name: str, value: Node, allowed: tuple[str, ...], found: dict[str, Node]) -> None:
        if name.startswith("ansible_"):
            return
        near = name if name in allowed else nearest(name, allowed)
        if name in allowed and name in found:
            first = found[name].place
            self._wrong(value.place, f"`{name}` is declared twice, first in {first.file}:{first.line}", "keep one")
        elif name in allowed:
            found[name] = value
        elif name in _HOMES:
            self._wrong(value.place, f"`{name}` does not belong here", f"move it to {_HOMES[name]}")
        else:
            none = "only variables of Ansible itself, `ansible_…`, may stand here"
            self._wrong(value.place, f"`{shown_key(name)}` is not known here", meant(name, allowed, none=none))
            if near is not None:
                found.setdefault(near, value)
