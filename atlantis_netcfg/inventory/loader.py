"""Load an inventory directory to a `Inventory`, or report all errors in one pass.

Each part is validated separately, so that an invalid part does not hide errors of others.
"""

from __future__ import annotations

import errno
import hashlib
import os
import stat
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from pydantic import BaseModel, ValidationError

from atlantis_netcfg.core.errors import NoMatchError, nearest
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.inventory import _hosts, _schema, _yaml
from atlantis_netcfg.inventory._draft import Draft, Part
from atlantis_netcfg.inventory._schema import explain, label_of
from atlantis_netcfg.inventory.examples import examples_in
from atlantis_netcfg.inventory.findings import (
    MOST_SHOWN,
    Finding,
    InventoryInvalid,
    Mark,
    choices,
    shown_key,
    suggest,
    why_no_name,
)
from atlantis_netcfg.inventory.inventory import Host, Inventory
from atlantis_netcfg.inventory.model import Guest, Partner, Pilot, Site, Vehicle
from atlantis_netcfg.inventory.rules import RULES, WARNINGS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping


_HOMES = {
    "pilot": "group_vars/all/pilot.yml",
    "partners": "group_vars/all/partners.yml",
    "vehicles": "group_vars/all/vehicles.yml",
    "guests": "group_vars/all/guests.yml",
    "site": "group_vars/<site>.yml",
    "device": "host_vars/<host>.yml",
}
_OF_ALL = ("pilot", "partners", "vehicles")
_IF_ANY = ("guests",)
"""Variables of all hosts that are optional."""


@dataclass(slots=True)
class Variables:
    """Blocks of the inventory before validation."""

    all: dict[str, _yaml.Node] = field(default_factory=dict)
    """Variables `pilot`, `partners`, `vehicles`, and optionally `guests`."""
    sites: dict[str, _yaml.Node] = field(default_factory=dict)
    devices: dict[str, _yaml.Node] = field(default_factory=dict)
    findings: list[Finding] = field(default_factory=list)


def gather(sources: InventorySources, layout: _hosts.HostLayout, decrypt: _yaml.Decrypt | None) -> Variables:
    """Read every file of group_vars and host_vars."""
    return _Gatherer(sources, layout, decrypt).gather()


class _Gatherer:
    def __init__(self, sources: InventorySources, layout: _hosts.HostLayout, decrypt: _yaml.Decrypt | None) -> None:
        self.sources = sources
        self.layout = layout
        self.decrypt = decrypt
        self.result = Variables()

    def gather(self) -> Variables:
        """Read all files, in an order independent of the file system."""
        groups, hosts = self.sources.group_vars, self.sources.host_vars
        self._gather_common(groups.get("all", []))
        for name in sorted(groups.keys() - {"all"}):
            self._gather_group(name, groups[name])
        for name in sorted(hosts):
            self._gather_host(name, hosts[name])
        for site, mark in self.layout.sites.items():
            self._require_file(site, mark, groups, "site", "group_vars")
        for host, mark in self.layout.marks.items():
            self._require_file(host, mark, hosts, "device", "host_vars")
        return self.result

    def _add_finding(self, mark: Mark, message: str, hint: str) -> None:
        self.result.findings.append(Finding.at(mark, message, hint))

    def _gather_common(self, paths: list[Path]) -> None:
        variables, complete = self._variables(paths, (*_OF_ALL, *_IF_ANY))
        self.result.all = variables
        for name in _OF_ALL:
            if name not in variables and complete:
                hint = msg(f"write `{arg(name)}:` in {arg(self.sources.display_name)}/{arg(_HOMES[name])}")
                self._add_finding(self.layout.start, msg(f"`{arg(name)}` is missing"), hint)

    def _gather_group(self, name: str, paths: list[Path]) -> None:
        if name in self.layout.sites:
            variables, complete = self._variables(paths, ("site",))
            self._keep(name, paths, variables.get("site"), self.result.sites, "site", complete=complete)
        elif name in _hosts.KIND_GROUPS or name == "sites":
            self._variables(paths, ())
        else:
            names = ["all", *self.layout.sites]
            self._report_orphans(paths, msg(f"no site or group is named `{arg(name)}`"), name, names, "group_vars")

    def _gather_host(self, name: str, paths: list[Path]) -> None:
        if name in self.layout.hosts:
            variables, complete = self._variables(paths, ("device",))
            self._keep(name, paths, variables.get("device"), self.result.devices, "device", complete=complete)
        else:
            self._report_orphans(paths, msg(f"no host is named `{arg(name)}`"), name, self.layout.hosts, "host_vars")

    def _keep(  # noqa: PLR0913 - one step of two callers
        self,
        name: str,
        paths: list[Path],
        node: _yaml.Node | None,
        into: dict[str, _yaml.Node],
        variable: str,
        *,
        complete: bool,
    ) -> None:
        if node is not None:
            into[name] = node
        elif complete and paths:
            self._add_finding(
                Mark(self.sources.name(paths[0]), 1, 1), msg(f"`{arg(variable)}:` is missing here"), "add it"
            )

    def _report_orphans(
        self, paths: list[Path], message: str, name: str, names: Mapping[str, object] | list[str], folder: str
    ) -> None:
        near = nearest(name, names)
        for path in paths:
            file_name = self.sources.name(path)
            target = file_name.replace(f"/{folder}/{name}", f"/{folder}/{near}", 1)
            hint = msg(
                f"did you mean `{arg(near)}`? mv {arg(file_name)} {arg(target)}"
                if near
                else f"add it to {arg(self.sources.display_name)}/hosts.yml"
            )
            self._add_finding(Mark(file_name, 1, 1), message, hint)

    def _require_file(self, name: str, mark: Mark, files: Mapping[str, list[Path]], variable: str, folder: str) -> None:
        if files.get(name) or name in self.sources.strays:
            return
        names = self.layout.sites if folder == "group_vars" else self.layout.hosts
        orphans = [other for other in files if other not in names and nearest(other, names) == name]
        if not orphans:
            hint = msg(f"write `{arg(variable)}:` in {arg(self.sources.display_name)}/{arg(folder)}/{arg(name)}.yml")
            self._add_finding(mark, msg(f"`{arg(name)}` has no file in {arg(folder)}/"), hint)

    def _variables(self, paths: list[Path], allowed_names: tuple[str, ...]) -> tuple[dict[str, _yaml.Node], bool]:
        """Return the allowed variables of the files, and whether all files were readable."""
        variables: dict[str, _yaml.Node] = {}
        complete = True
        for path in paths:
            node, findings = self.sources.read(path, self.decrypt)
            self.result.findings.extend(findings)
            complete = complete and (node is not None or not findings)
            if node is None or node.value is None:
                continue
            if not isinstance(node.value, dict):
                complete = False
                self._add_finding(
                    node.mark, "a file contains `name:` and, indented below it, the values", "write it like this"
                )
                continue
            for name, value in node.value.items():
                self._gather_variable(name, value, allowed_names, variables)
        return variables, complete

    def _gather_variable(
        self, name: str, value: _yaml.Node, allowed_names: tuple[str, ...], variables: dict[str, _yaml.Node]
    ) -> None:
        if name.startswith("ansible_"):
            return
        near = name if name in allowed_names else nearest(name, allowed_names)
        if name in allowed_names and name in variables:
            first = variables[name].place
            self._add_finding(
                value.place,
                msg(f"`{arg(name)}` is set twice, first in {arg(first.file)}:{arg(first.line)}"),
                "keep one",
            )
        elif name in allowed_names:
            variables[name] = value
        elif name in _HOMES:
            self._add_finding(
                value.place, msg(f"`{arg(name)}` does not belong here"), msg(f"move it to {arg(_HOMES[name])}")
            )
        else:
            none = "only variables of Ansible itself (`ansible_…`) are allowed here"
            self._add_finding(
                value.place, msg(f"unknown key `{arg(shown_key(name))}`"), suggest(name, allowed_names, none=none)
            )
            if near is not None:
                variables.setdefault(near, value)


HOSTS = "hosts.yml"
_OTHERS = ("evidence", "keys", "robots")
"""Folders with terminals' exported files, public keys of archives, and robots' files; ansible.cfg excludes them."""
_FOLDERS = ("group_vars", "host_vars")
_DOCUMENTS = frozenset({".md", ".rst", ".txt"})
_BACKUPS = ("~", ".bak", ".orig", ".swp", ".old", ".save", ".rej")


@dataclass(slots=True)
class InventorySources:
    """Files of an inventory by purpose.

    Ansible accepts `group_vars/<name>.yml`, a folder of that name, and other spellings. If a file and a folder have the
    same name, it reads only the folder (ansible-core, `DataLoader.find_vars_files`). Only one spelling is allowed here,
    and every other file is reported, so that no setting is silently ignored.
    """

    root: Path
    display_name: str
    """Name of the root folder in error messages."""
    group_vars: dict[str, list[Path]] = field(default_factory=dict)
    host_vars: dict[str, list[Path]] = field(default_factory=dict)
    findings: list[Finding] = field(default_factory=list)
    strays: set[str] = field(default_factory=set)
    """Stems of ignored files: their host or site is not reported as lacking a file, since the file is misplaced."""
    contents: dict[str, bytes] = field(default_factory=dict)
    """Contents of the files, by their names in error messages."""

    def name(self, path: Path) -> str:
        """Return a file's name for errors."""
        return f"{self.display_name}/{path.relative_to(self.root).as_posix()}"

    def read(self, path: Path, decrypt: _yaml.Decrypt | None) -> tuple[_yaml.Node | None, list[Finding]]:
        """Read and parse one file."""
        file_name = self.name(path)
        try:
            data = content(path)
        except OSError as error:
            reason = (error.strerror or "no reason given").lower()
            return None, [
                Finding.at(
                    Mark(file_name, 1, 1),
                    msg(f"the file cannot be read: {arg(reason)}"),
                    msg(f"check it: ls -ld {arg(file_name)}"),
                )
            ]
        if len(data) > LARGEST:
            return None, [
                Finding.at(Mark(file_name, 1, 1), "the file is larger than 1 MB", "split it into several files")
            ]
        self.contents[file_name] = data
        return _yaml.parse(data, file_name, decrypt)


LARGEST = 1_000_000
"""Maximum size of a file in bytes."""


def content(path: Path) -> bytes:
    """Read at most one byte more than the size limit. Raises OSError, also for a pipe or other special file."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    with os.fdopen(descriptor, "rb") as file:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise OSError(errno.EINVAL, "it is not a regular file")
        return file.read(LARGEST + 1)


def scan(root: Path, display_name: str) -> InventorySources:
    """List the files of an existing inventory directory."""
    sources = InventorySources(root, display_name)
    for entry in _entries(root):
        if entry.name in _FOLDERS and entry.is_dir():
            _scan_folder(sources, entry, sources.group_vars if entry.name == "group_vars" else sources.host_vars)
        elif entry.name != HOSTS and not (entry.name in _OTHERS and entry.is_dir()):
            _stray(sources, entry, (HOSTS, *_FOLDERS))
    return sources


def _entries(folder: Path) -> list[Path]:
    return sorted(entry for entry in folder.iterdir() if not entry.name.startswith("."))


def _scan_folder(sources: InventorySources, folder: Path, files: dict[str, list[Path]]) -> None:
    for entry in _entries(folder):
        if _is_folder_for_file(sources, entry):
            continue
        if entry.is_dir():
            files.setdefault(entry.name, []).extend(_scan_inner(sources, entry))
        elif entry.suffix == ".yml":
            if entry.stem in files:
                hint = msg(f"move it into {arg(sources.name(entry.with_suffix('')))}/")
                message = msg(f"Ansible does not read this file next to the folder `{arg(entry.stem)}`")
                sources.findings.append(Finding.at(Mark(sources.name(entry), 1, 1), message, hint))
            files.setdefault(entry.stem, []).append(entry)
        else:
            _stray(sources, entry)


def _scan_inner(sources: InventorySources, folder: Path) -> Iterator[Path]:
    for entry in _entries(folder):
        if _is_folder_for_file(sources, entry):
            continue
        if entry.suffix == ".yml" and not entry.is_dir():
            yield entry
        else:
            _stray(sources, entry)


def _is_folder_for_file(sources: InventorySources, entry: Path) -> bool:
    if not (entry.suffix == ".yml" and entry.is_dir()):
        return False
    file_name = sources.name(entry)
    sources.strays.add(entry.stem)
    _add_source_finding(
        sources,
        entry,
        "a folder is in place of a file",
        msg(f"rename it: mv {arg(file_name)} {arg(file_name.removesuffix('.yml'))}"),
    )
    return True


def _stray(sources: InventorySources, entry: Path, expected_names: tuple[str, ...] = ()) -> None:
    """Report a file or folder that is not read; documents are ignored, as Ansible does."""
    file_name = sources.name(entry)
    sources.strays.update(path.stem for path in (entry, *entry.rglob("*")))
    if entry.is_dir():
        inside = next((path for path in sorted(entry.rglob("*")) if path.is_file()), None)
        if inside is None:
            return
        near = nearest(entry.name, expected_names)
        hint = msg(
            f"did you mean `{arg(near)}`?"
            if near
            else f"move its files to where they are read, or remove it: rm -r {arg(file_name)}"
        )
        _add_source_finding(sources, inside, msg(f"the folder `{arg(entry.name)}` is not read"), hint)
    elif entry.name.endswith(_BACKUPS):
        _add_source_finding(
            sources, entry, "this copy is not read, but may contain secrets", msg(f"remove it: rm {arg(file_name)}")
        )
    elif entry.suffix not in _DOCUMENTS:
        stem = entry.name.removesuffix(entry.suffix) if entry.suffix in {".yaml", ".json", ".ini", ""} else entry.stem
        name = nearest(f"{stem}.yml", expected_names) or f"{stem}.yml"
        _add_source_finding(
            sources,
            entry,
            msg(f"the file `{arg(entry.name)}` is not read"),
            msg(f"rename it: mv {arg(file_name)} {arg(_sibling_name(file_name, name))}"),
        )


def _add_source_finding(sources: InventorySources, path: Path, message: str, hint: str) -> None:
    sources.findings.append(Finding.at(Mark(sources.name(path), 1, 1), message, hint))


def _sibling_name(file_name: str, name: str) -> str:
    return f"{file_name.rpartition('/')[0]}/{name}"


_Path = tuple[str | int, ...]


def build(
    node: _yaml.Node, model: type[_M], name: str, key_of: Callable[[_Path], str] = _schema.model_key
) -> tuple[_M | None, _yaml.Node, list[Finding]]:
    """Validate block `name`; return the model or None, the block with corrected keys, and all errors.

    `key_of` returns the key at a path as the file names it, if that differs from the model.
    """
    findings: list[Finding] = []
    while True:
        try:
            return model.model_validate(node.data()), node, findings
        except ValidationError as error:
            errors = error.errors(include_url=False, include_input=False)
        unknown = [entry["loc"] for entry in errors if entry["type"] == "extra_forbidden"]
        if not unknown:
            break
        # Each round leaves fewer unknown keys, or deeper ones.
        node = _fix_keys(unknown[:MOST_SHOWN], node, model, (name, key_of), findings)
        if more := len(unknown[MOST_SHOWN:]):
            place = node.at(*unknown[MOST_SHOWN]).place
            findings.append(
                Finding.at(place, msg(f"from here on, {arg(more)} more keys are unknown"), "correct the others first")
            )
            return None, node, findings
    findings.extend(
        explain(item, node, model, name, key_of) for item in errors if not node.at(*item["loc"]).is_reported
    )
    return None, node, findings


def _fix_keys(
    unknown: Iterable[_Path],
    node: _yaml.Node,
    model: type[BaseModel],
    words: tuple[str, Callable[[_Path], str]],
    findings: list[Finding],
) -> _yaml.Node:
    """Report unknown keys; return the node with them renamed to the probable key, or removed."""
    for path in unknown:
        parent, key = path[:-1], str(path[-1])
        inner = _schema.model_of(_schema.at(model, parent))
        field_names = list(inner.model_fields) if inner is not None else []
        field_by_key = {words[1]((*parent, field)): field for field in field_names}
        block = node.at(*parent).keys
        target, message, hint = _unknown(key, block, field_by_key, label_of(parent, *words))
        findings.append(Finding.at(block[key].place, message, hint))
        secret = [field for field in field_names if _schema.unwrap(_schema.at(model, (*parent, field))) is Secret]
        unsure = any(field not in block and field != target for field in secret)
        node = _rename_key(node, parent, key, target, is_reported=unsure)
    return node


def _unknown(
    key: str, block: Mapping[str, _yaml.Node], field_by_key: Mapping[str, str], where: str
) -> tuple[str | None, str, str]:
    """Return the probable key and a hint; `field_by_key` maps keys of the file to fields."""
    free = {word: field for word, field in field_by_key.items() if field not in block}
    word = key.partition(" ")[0]
    if word != key and word in free and block[key].value is None:
        return free[word], msg(f"a `:` is missing after `{arg(word)}`"), msg(f"write `{arg(word)}: …`")
    near = nearest(key, free)
    instead = msg(f"remove `{arg(shown_key(key))}`; the keys here are: {arg(join(', ', field_by_key))}")
    message = msg(f"{arg(where)} has no key `{arg(shown_key(key))}`")
    return near and free[near], message, msg(f"did you mean `{arg(near)}`?") if near is not None else instead


def _rename_key(node: _yaml.Node, path: _Path, old: str, new: str | None, *, is_reported: bool) -> _yaml.Node:
    """Return the node with a key renamed or removed. `is_reported`: do not report it again, it may be a secret."""
    if not path:
        keys = dict(node.keys)
        value = keys.pop(old)
        is_reported = is_reported or value.is_reported or (" " in old and value.value is None)
        return replace(node, value=keys if new is None else {**keys, new: replace(value, is_reported=is_reported)})
    step, rest = path[0], path[1:]
    if isinstance(node.value, list) and isinstance(step, int):
        items = list(node.value)
        items[step] = _rename_key(items[step], rest, old, new, is_reported=is_reported)
        return replace(node, value=items)
    keys = dict(node.keys)
    keys[str(step)] = _rename_key(keys[str(step)], rest, old, new, is_reported=is_reported)
    return replace(node, value=keys)


_M = TypeVar("_M", bound=BaseModel)


def draft(layout: _hosts.HostLayout, variables: Variables) -> tuple[Draft, list[Finding]]:
    """Validate every part against its model."""
    builder = _Builder(Draft(layout))
    builder.pilot(variables.all.get("pilot"))
    builder.build_parts("partner", "partners", variables.all.get("partners"), Partner, builder.draft.partners)
    builder.build_parts("vehicle", "vehicles", variables.all.get("vehicles"), Vehicle, builder.draft.vehicles)
    builder.build_parts("vehicle", "guests", variables.all.get("guests"), Guest, builder.draft.vehicles)
    for site in layout.sites:
        builder.site(site, variables.sites.get(site))
    builder.test_guests()
    for host in layout.hosts:
        builder.device(host, variables.devices.get(host))
    return builder.draft, builder.findings


class _Builder:
    def __init__(self, draft: Draft) -> None:
        self.draft = draft
        self.findings: list[Finding] = []

    def pilot(self, node: _yaml.Node | None) -> None:
        if node is not None:
            self.draft.pilot = self._build(Part("pilot"), node, Pilot, "pilot")

    def build_parts(
        self, sort: str, variable: str, node: _yaml.Node | None, model: type[BaseModel], into: dict[str, _M]
    ) -> None:
        """Validate a block of named parts."""
        if node is None:
            return
        self.draft.nodes[Part(variable)] = node
        if node.value is not None and not isinstance(node.value, dict):
            hint = msg(f"write `name:` and, indented below it, {arg(_schema.expected_type(model))}")
            self.findings.append(Finding.at(node.place, msg(f"`{arg(variable)}` needs a block of keys"), hint))
            return
        for name, below in node.keys.items():
            if why := why_no_name(name):
                self.findings.append(Finding.at(below.place, *why))
            if (there := self.draft.nodes.get(Part(sort, name))) is not None:
                where = f"{there.place.file}:{there.place.line}"
                self.findings.append(
                    Finding.at(below.place, msg(f"`{arg(name)}` is already set ({arg(where)})"), "remove one")
                )
                continue
            part: Any = self._build(Part(sort, name), below, model, name)
            if part is not None:
                into[name] = part

    def site(self, name: str, node: _yaml.Node | None) -> None:
        if node is not None and (site := self._build(Part("site", name), node, Site, "site")) is not None:
            self.draft.sites[name] = site

    def test_guests(self) -> None:
        """Add guests to the sites where they are tested; the user's own list of vehicles is not edited."""
        guests = [(key, vehicle) for key, vehicle in self.draft.vehicles.items() if isinstance(vehicle, Guest)]
        for name, site in self.draft.sites.items():
            site_vehicles = site.checklist.vehicles
            more = tuple(key for key, guest in guests if name in guest.tested_at and key not in (site_vehicles or ()))
            if site_vehicles is not None and more:
                settings = site.checklist.model_copy(update={"vehicles": (*site_vehicles, *more)})
                self.draft.sites[name] = site.model_copy(update={"checklist": settings})

    def device(self, host: str, node: _yaml.Node | None) -> None:
        """Validate a device against the model of its kind."""
        if node is None:
            return
        part = Part("device", host)
        self.draft.nodes[part] = node
        if not isinstance(node.value, dict):
            hint = "write `kind:` and the other keys of the device below it, indented"
            self.findings.append(Finding.at(node.place, "`device` needs a block of keys", hint))
            return
        node, kind = self._kind(host, node)
        if kind is not None:
            device: Any = self._build(part, node, _schema.DEVICES[kind], "device")
            if device is not None:
                self.draft.devices[host] = device

    def _kind(self, host: str, node: _yaml.Node) -> tuple[_yaml.Node, str | None]:
        """Return the device's kind; a missing or misspelt one is reported and taken from its group."""
        group_kind = self.draft.layout.kinds.get(host)
        keys = dict(node.keys)
        if "kind" not in keys and (near := nearest("kind", keys)) is not None:
            value = keys.pop(near)
            self.findings.append(
                Finding.at(value.place, msg(f"`device` has no key `{arg(near)}`"), "did you mean `kind`?")
            )
            keys["kind"] = value
        if "kind" not in keys:
            hint = msg(
                f"add `kind: {arg(group_kind)}`"
                if group_kind
                else f"add `kind:` with one of {arg(choices(_schema.DEVICES))}"
            )
            self.findings.append(Finding.at(node.place, "`device` has no `kind`", hint))
            keys["kind"] = _yaml.Node(node.mark, group_kind)
        kind = keys["kind"].value
        if isinstance(kind, str) and kind in _schema.DEVICES:
            return replace(node, value=keys), kind
        if kind is not None:
            message, hint = (
                msg(f"`{arg(keys['kind'].text)}` is not a kind of device"),
                suggest(keys["kind"].text, _schema.DEVICES, none=""),
            )
            self.findings.append(Finding.at(keys["kind"].mark, message, hint))
        keys["kind"] = replace(keys["kind"], value=group_kind)
        return replace(node, value=keys), group_kind

    def _build(self, part: Part, node: _yaml.Node, model: type[_M], name: str) -> _M | None:
        instance, self.draft.nodes[part], findings = build(node, model, name)
        self.findings += findings
        return instance


def load(inventory: Path, *, decrypt: _yaml.Decrypt | None = None) -> Inventory:
    """Read and validate the whole inventory.

    Raises InventoryInvalid with every error, NoMatchError if there is no inventory, no site or no host. Without
    `decrypt` vaulted secrets stay sealed: they can be compared, but not revealed.
    """
    sources, inventory_draft, findings = _examine(inventory, decrypt)
    pilot = inventory_draft.pilot if inventory_draft is not None else None
    if findings or inventory_draft is None or pilot is None:
        raise InventoryInvalid(findings)
    hosts = {
        name: Host(name, site, inventory_draft.devices[name]) for name, site in inventory_draft.layout.hosts.items()
    }
    digest = hashlib.sha256()
    for name, data in sorted(sources.contents.items()):
        digest.update(f"{name.removeprefix(sources.display_name)}\0{len(data)}\0".encode() + data)
    return Inventory(
        inventory,
        pilot,
        inventory_draft.partners,
        inventory_draft.vehicles,
        inventory_draft.sites,
        hosts,
        revision=digest.hexdigest(),
        examples=examples_in(inventory_draft.nodes.values()),
        warnings=tuple(sorted(finding for rule in WARNINGS for finding in rule(inventory_draft))),
        places={
            (name, link.name): inventory_draft.mark(Part("site", name), "bearers", index)
            for name, site in inventory_draft.sites.items()
            for index, link in enumerate(site.bearers)
        },
        decrypt=decrypt,
    )


def validate(inventory: Path, *, decrypt: _yaml.Decrypt | None = None) -> list[Finding]:
    """Return every error of the inventory, sorted by place. Raises NoMatchError as `load` does."""
    return _examine(inventory, decrypt)[2]


def _examine(inventory: Path, decrypt: _yaml.Decrypt | None) -> tuple[InventorySources, Draft | None, list[Finding]]:
    sources = scan(_check_inventory_folder(inventory), shown_path(inventory))
    root, findings = sources.read(inventory / HOSTS, decrypt)
    if root is None and findings:
        return sources, None, sorted({*findings, *sources.findings})
    layout = _require_layout(root, findings, sources.display_name)
    variables = gather(sources, layout, decrypt)
    inventory_draft, wrong = draft(layout, variables)
    findings += [*sources.findings, *layout.findings, *variables.findings, *wrong]
    for rule in RULES:
        findings.extend(rule(inventory_draft))
    return sources, inventory_draft, _one_closed(sorted(set(findings)))


def _one_closed(findings: list[Finding]) -> list[Finding]:
    """Merge the errors of a wrong vault password: the first one, and the number of others."""
    secret_findings = [finding for finding in findings if finding.message == _yaml.CANNOT_DECRYPT]
    if len(secret_findings) < 2:  # noqa: PLR2004 - one is told as it is
        return findings
    first = replace(
        secret_findings[0],
        message=msg(f"{arg(_yaml.CANNOT_DECRYPT)}, nor {arg(len(secret_findings) - 1)} more of the inventory"),
    )
    return [
        first if finding is secret_findings[0] else finding
        for finding in findings
        if finding not in secret_findings[1:]
    ]


def _require_layout(root: _yaml.Node | None, findings: list[Finding], display_name: str) -> _hosts.HostLayout:
    """Return the layout of hosts.yml. Raises NoMatchError if it has no site or host and no other error."""
    layout = _hosts.parse_layout(root) if root is not None else None
    if layout is None or not (layout.sites or layout.findings or findings):
        raise NoMatchError(
            f"{arg(display_name)}/{arg(HOSTS)} contains no site",
            hint="write all: children: sites: children: <site>: hosts: <host>:",
        )
    if not (layout.hosts or layout.findings or findings):
        raise NoMatchError(
            f"{arg(display_name)}/{arg(HOSTS)} contains no host",
            hint=f"add hosts below a site; the sites are: {arg(choices(layout.sites))}",
        )
    return layout


def shown_path(path: Path) -> str:
    """Return a path as typed from the current directory."""
    full, here = path.absolute(), Path.cwd()
    return full.relative_to(here).as_posix() if full.is_relative_to(here) and full != here else path.as_posix()


_READABLE = "use another account, or a copy that this account can read"


def _inventories_beside(inventory: Path) -> list[str]:
    """Return the names of readable inventories in the same folder."""
    result = []
    with suppress(OSError):
        for path in sorted(inventory.absolute().parent.iterdir()):
            with suppress(OSError):
                result += [path.name] if (path / HOSTS).is_file() else []
    return result


def _check_inventory_folder(inventory: Path) -> Path:
    try:
        return _require_inventory(inventory)
    except OSError as error:
        name, why = inventory, error.strerror
        raise NoMatchError(f"the inventory directory {arg(name)} cannot be read: {arg(why)}", hint=_READABLE) from None


def _require_inventory(inventory: Path) -> Path:
    if not inventory.is_dir():
        near = _inventories_beside(inventory)
        hint = msg(
            f"inventories here: {arg(choices(near))}"
            if near
            else f"an inventory is a directory that contains {arg(HOSTS)}"
        )
        what = "is a file" if inventory.exists() else "does not exist"
        raise NoMatchError(f"the inventory directory {arg(inventory)} {arg(what)}", hint=hint)
    if not (inventory / HOSTS).exists():
        there = [path.name for path in _entries(inventory)]
        hint = msg(f"it contains: {arg(choices(there))}" if there else "it is empty")
        raise NoMatchError(f"{arg(HOSTS)} is missing in {arg(inventory)}", hint=hint)
    return inventory
