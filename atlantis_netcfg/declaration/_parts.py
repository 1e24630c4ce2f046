"""From blocks of values to models, each part of the declaration by itself: one bad part does not hide the others."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeVar

from pydantic import BaseModel

from atlantis_netcfg.core.suggest import nearest
from atlantis_netcfg.declaration import _schema
from atlantis_netcfg.declaration._build import build
from atlantis_netcfg.declaration._draft import Draft, Part
from atlantis_netcfg.declaration._names import why_no_name
from atlantis_netcfg.declaration._near import choices, meant
from atlantis_netcfg.declaration._node import Node
from atlantis_netcfg.declaration.findings import Finding
from atlantis_netcfg.declaration.model import Partner, Pilot, Site, Vehicle

if TYPE_CHECKING:
    from atlantis_netcfg.declaration._hosts import Layout
    from atlantis_netcfg.declaration._variables import Variables

__all__ = ["draft"]

_M = TypeVar("_M", bound=BaseModel)


def draft(layout: Layout, variables: Variables) -> tuple[Draft, list[Finding]]:
    """Check every part against the model."""
    builder = _Builder(Draft(layout))
    builder.pilot(variables.all.get("pilot"))
    builder.named("partner", "partners", variables.all.get("partners"), Partner, builder.draft.partners)
    builder.named("vehicle", "vehicles", variables.all.get("vehicles"), Vehicle, builder.draft.vehicles)
    for site in layout.sites:
        builder.site(site, variables.sites.get(site))
    for host in layout.hosts:
        builder.device(host, variables.devices.get(host))
    return builder.draft, builder.findings


class _Builder:
    def __init__(self, draft: Draft) -> None:
        self.draft = draft
        self.findings: list[Finding] = []

    def pilot(self, node: Node | None) -> None:
        if node is not None:
            self.draft.pilot = self._build(Part("pilot"), node, Pilot, "pilot")

    def named(self, sort: str, variable: str, node: Node | None, model: type[_M], into: dict[str, _M]) -> None:
        """A block of parts by name."""
        if node is None:
            return
        self.draft.nodes[Part(variable)] = node
        if node.value is not None and not isinstance(node.value, dict):
            hint = f"write `name:` and below it, indented, {_schema.wanted(model)}"
            self.findings.append(Finding.at(node.place, f"`{variable}` wants a block of keys", hint))
            return
        for name, below in node.keys.items():
            if why := why_no_name(name):
                self.findings.append(Finding.at(below.place, *why))
            part = self._build(Part(sort, name), below, model, name)
            if part is not None:
                into[name] = part

    def site(self, name: str, node: Node | None) -> None:
        if node is not None and (site := self._build(Part("site", name), node, Site, "site")) is not None:
            self.draft.sites[name] = site

    def device(self, host: str, node: Node | None) -> None:
        """A device has the model of its kind."""
        if node is None:
            return
        part = Part("device", host)
        self.draft.nodes[part] = node
        if not isinstance(node.value, dict):
            hint = "write `kind:` and the device's other keys below it, indented"
            self.findings.append(Finding.at(node.place, "`device` wants a block of keys", hint))
            return
        node, kind = self._kind(host, node)
        if kind is not None:
            device: Any = self._build(part, node, _schema.DEVICES[kind], "device")
            if device is not None:
                self.draft.devices[host] = device

    def _kind(self, host: str, node: Node) -> tuple[Node, str | None]:
        """The device's kind; if it is missing or misspelt, that is told and its group decides."""
        grouped = self.draft.layout.kinds.get(host)
        keys = dict(node.keys)
        if "kind" not in keys and (near := nearest("kind", keys)) is not None:
            value = keys.pop(near)
            self.findings.append(Finding.at(value.place, f"`device` has no key `{near}`", "did you mean `kind`?"))
            keys["kind"] = value
        if "kind" not in keys:
            hint = f"add `kind: {grouped}`" if grouped else f"add `kind:` with one of {choices(_schema.DEVICES)}"
            self.findings.append(Finding.at(node.place, "`device` has no `kind`", hint))
            keys["kind"] = Node(node.mark, grouped)
        kind = keys["kind"].value
        if isinstance(kind, str) and kind in _schema.DEVICES:
            return replace(node, value=keys), kind
        if kind is not None:
            message, hint = (
                f"`{keys['kind'].text}` is no kind of device",
                meant(keys["kind"].text, _schema.DEVICES, none=""),
            )
            self.findings.append(Finding.at(keys["kind"].mark, message, hint))
        keys["kind"] = replace(keys["kind"], value=grouped)
        return replace(node, value=keys), grouped

    def _build(self, part: Part, node: Node, model: type[_M], name: str) -> _M | None:
        built, self.draft.nodes[part], findings = build(node, model, name)
        self.findings += findings
        return built
