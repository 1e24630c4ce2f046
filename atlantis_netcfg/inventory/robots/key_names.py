"""Key names in the partners' files: `robots/keys.yml` of the inventory maps this project's keys to theirs.

    keys:
      mission_executor: executor                # at the same place in the file
      telemetry.booleans: interfaces.bool       # at another place in the file
      label: name                               # wherever a `label` may occur
    ignored: [robot_colour]                     # keys of the partner that are not read
    configuration_topic: /atlantis/configuration    # on which robots publish their files

This project's own key names are accepted as well.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory._schema import item_of, model_of
from atlantis_netcfg.inventory.findings import Finding, shown_key, suggest
from atlantis_netcfg.inventory.model.robot import RobotFile
from atlantis_netcfg.inventory.robots.ros_names import why_no_name

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from pydantic import BaseModel

    from atlantis_netcfg.inventory._yaml import Node

KEY = r"[A-Za-z_][\w-]*(\.[A-Za-z_][\w-]*)*"
"""Pattern for a key of a file, or for a path of keys."""

CONFIGURATION_TOPIC = "/atlantis/configuration"
_OURS = ("keys", "ignored", "configuration_topic")


@dataclass(frozen=True, slots=True)
class KeyNames:
    """The partners' key names from the inventory, and the partners' keys that are ignored."""

    names: Mapping[str, str] = field(default_factory=dict)
    """Our key, alone or with its parents (`telemetry.booleans`; list entries have no number), to the partners' key."""
    ignored_keys: frozenset[str] = frozenset()
    configuration_topic: str = CONFIGURATION_TOPIC
    """Topic on which robots publish their files; a proposal, as its real name is not known."""

    def key_of(self, path: tuple[str | int, ...]) -> str:
        """Return the name that the partner's file uses for the key at one of our paths."""
        dotted_path = ".".join(step for step in path if isinstance(step, str))
        return self.names.get(dotted_path) or self.names.get(str(path[-1])) or str(path[-1])

    def translate(self, root: Node) -> tuple[Node, list[Finding]]:
        """Return the file with its keys renamed to ours, and findings for keys present under both names.

        Values at another place of the partner's file are moved to our place first.
        """
        clashes: list[Finding] = []
        for ours, theirs in self.names.items():
            if "." in theirs:
                root = _move(root, tuple(theirs.split(".")), tuple(ours.split(".")))
        return self._rename(root, RobotFile, (), clashes), clashes

    def _rename(self, node: Node, model: type[BaseModel], path: tuple[str, ...], clashes: list[Finding]) -> Node:
        if isinstance(node.value, list):
            return replace(node, value=[self._rename(item, model, path, clashes) for item in node.value])
        if not isinstance(node.value, dict):
            return node
        keys = {key: value for key, value in node.value.items() if key not in self.ignored_keys}
        ours: dict[str, Node] = {}
        for name, info in model.model_fields.items():
            theirs = self.key_of((*path, name))
            if (key := theirs if theirs in keys else name) in keys:
                below = keys.pop(key)
                inner = model_of(item_of(info.annotation) or info.annotation)
                if name in keys:
                    hint = msg(f"keep `{arg(key)}`: robots/keys.yml uses this name")
                    clashes.append(
                        Finding.at(keys.pop(name).place, msg(f"`{arg(key)}` and `{arg(name)}` are both here"), hint)
                    )
                ours[name] = below if inner is None else self._rename(below, inner, (*path, name), clashes)
        return replace(node, value={**ours, **keys})  # what is left is unknown to the model, which says so


def read_key_names(node: Node) -> tuple[KeyNames, list[Finding]]:
    """Parse `robots/keys.yml`; return the key names and the findings."""
    findings = [
        Finding.at(below.place, msg(f"unknown key `{arg(shown_key(key))}`"), suggest(key, _OURS, none=""))
        for key, below in node.keys.items()
        if key not in _OURS
    ]
    known_keys, names = set(key_paths(RobotFile)), dict[str, str]()
    keys, ignored_node = node.keys.get("keys"), node.keys.get("ignored")
    if keys is not None and keys.value is not None and not isinstance(keys.value, dict):
        findings.append(Finding.at(keys.place, "`keys` needs a block of keys", "write `our_key: their_key` below it"))
    for ours, theirs in (keys.keys if keys is not None else {}).items():
        if ours not in known_keys:
            message = msg(f"a robot's file has no key `{arg(shown_key(ours))}`: our keys are on the left")
            findings.append(Finding.at(theirs.place, message, suggest(ours, sorted(known_keys), none="")))
        elif not (isinstance(theirs.value, str) and re.fullmatch(KEY, theirs.value)):
            findings.append(
                Finding.at(
                    theirs.mark,
                    msg(f"`{arg(theirs.text)}` is not a key of a file"),
                    "write it as in this example: executor",
                )
            )
        else:
            names[ours] = theirs.value
    ignored_keys: list[str] = []
    if ignored_node is not None:
        entries = ignored_node.value if isinstance(ignored_node.value, list) else []
        ignored_keys = [entry.value for entry in entries if isinstance(entry.value, str)]
        if not isinstance(ignored_node.value, list) or len(ignored_keys) < len(entries):
            hint = "write it as in this example: [colour, owner]"
            findings.append(Finding.at(ignored_node.place, "`ignored` needs a list of keys", hint))
    topic = node.keys.get("configuration_topic")
    name = str(topic.value) if topic is not None else CONFIGURATION_TOPIC
    if topic is not None and (why := why_no_name(name) or _explain_relative_name(name)):
        findings.append(Finding.at(topic.mark, *why))
    return KeyNames(names, frozenset(ignored_keys), name), findings


def _explain_relative_name(name: str) -> tuple[str, str] | None:
    return None if name.startswith("/") else (msg(f"`{arg(name)}` is in no namespace: all robots share it"), f"/{name}")


def key_paths(model: type[BaseModel], above: tuple[str, ...] = ()) -> Iterator[str]:
    """Yield every key of a robot's file, once alone and once with its parent keys (dotted)."""
    for name, info in model.model_fields.items():
        yield name
        yield ".".join((*above, name))
        if (inner := model_of(item_of(info.annotation) or info.annotation)) is not None:
            yield from key_paths(inner, (*above, name))


def _move(root: Node, source: tuple[str, ...], target: tuple[str, ...]) -> Node:
    """Move a value to another path and drop blocks that become empty; return the file unchanged if there is none."""
    value = root
    for step in source:
        if step not in value.keys:
            return root
        value = value.keys[step]
    return _put(_remove(root, source) or replace(root, value={}), target, value)


def _remove(node: Node, path: tuple[str, ...]) -> Node | None:
    keys = dict(node.keys)
    below = _remove(keys[path[0]], path[1:]) if len(path) > 1 else None
    if below is None:
        del keys[path[0]]
    else:
        keys[path[0]] = below
    return replace(node, value=keys) if keys else None


def _put(node: Node, path: tuple[str, ...], value: Node) -> Node:
    if not path:
        return value
    below = node.keys.get(path[0]) or replace(value, value={})
    return replace(node, value={**node.keys, path[0]: _put(below, path[1:], value)})
