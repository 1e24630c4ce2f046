"""YAML with the place of every value, and without what an inventory of final values must not hold.

The C parser of PyYAML gives nodes with their marks; this turns them into `Node`s and tells duplicate keys, Jinja, tags,
aliases and keys that are not text. PyYAML itself silently keeps the last of two equal keys, and so does Ansible.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import yaml

from atlantis_netcfg.declaration._near import shown_key
from atlantis_netcfg.declaration._node import Node, Scalar
from atlantis_netcfg.declaration._vault import TAG, UNTAGGED, Decrypt, VaultError, unseal
from atlantis_netcfg.declaration._yaml_errors import explain
from atlantis_netcfg.declaration.findings import Finding, Mark

if TYPE_CHECKING:
    from yaml.nodes import MappingNode, SequenceNode

    from atlantis_netcfg.core.secret import Secret

__all__ = ["parse"]

_STANDARD = "tag:yaml.org,2002:"
_SCALARS = frozenset({"str", "int", "float", "bool", "null", "timestamp"})
_IS_JINJA = "this is a Jinja expression; an inventory holds final values"
_JINJA = ("{{", "{%", "{#")
_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def parse(data: bytes, shown: str, decrypt: Decrypt | None) -> tuple[Node | None, list[Finding]]:
    """Read one file's bytes; `shown` is its name in errors. None if it is empty or cannot be parsed."""
    start = Mark(shown, 1, 1)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        where = Mark(shown, data.count(b"\n", 0, error.start) + 1, 1)
        return None, [Finding.at(where, "this line is not UTF-8 text", "save the file as UTF-8")]
    if text.startswith("$ANSIBLE_VAULT;"):
        hint = f"ansible-vault decrypt {shown}, then ansible-vault encrypt_string for each secret"
        return None, [Finding.at(start, "the whole file is encrypted; only single values may be", hint)]
    try:
        root = _compose(text)
    except yaml.YAMLError as error:
        return None, [explain(error, shown, text)]
    if root is None:
        return None, []
    return _Converter(shown, text, decrypt).convert(root)


def _compose(text: str) -> yaml.Node | None:
    loader = _Loader(text)
    try:
        root: yaml.Node | None = loader.get_single_node()
        return root
    finally:
        loader.dispose()


class _Converter:
    """Turns PyYAML's nodes into ours and collects what is wrong on the way."""

    def __init__(self, shown: str, text: str, decrypt: Decrypt | None) -> None:
        self.shown = shown
        self.text = text
        self.decrypt = decrypt
        self.findings: list[Finding] = []
        self.seen: set[int] = set()
        self.constructor: Any = yaml.constructor.SafeConstructor()

    def convert(self, root: yaml.Node) -> tuple[Node | None, list[Finding]]:
        """The tree and all errors of it."""
        try:
            return self._node(root), self.findings
        except RecursionError:
            mark = self._mark(root)
            return None, [Finding.at(mark, "the file is nested too deeply", "write it flatter")]

    def _mark(self, node: Any) -> Mark:  # noqa: ANN401 - a node or an event
        return Mark(self.shown, node.start_mark.line + 1, node.start_mark.column + 1)

    def _wrong(self, node: yaml.Node, message: str, hint: str) -> None:
        self.findings.append(Finding.at(self._mark(node), message, hint))

    def _node(self, node: yaml.Node) -> Node:
        if id(node) in self.seen:
            self._alias(node)
            return Node(self._mark(node), None, told=True)
        self.seen.add(id(node))
        if isinstance(node, yaml.MappingNode):
            self._expect_tag(node, "map")
            jinja = any(isinstance(key, yaml.MappingNode) for key, _ in node.value)
            return Node(self._mark(node), self._mapping(node), told=jinja)
        if isinstance(node, yaml.SequenceNode):
            self._expect_tag(node, "seq")
            return Node(self._mark(node), [self._node(item) for item in node.value])
        return self._scalar(node)

    def _expect_tag(self, node: MappingNode | SequenceNode, expected: str) -> None:
        if node.tag != _STANDARD + expected:
            self._wrong(node, "a `!` begins a tag, and only `!vault` is used here", "remove it")

    def _alias(self, node: yaml.Node) -> None:
        """An alias has lost its own place in the node tree; the event stream still has it."""
        events = yaml.parse(self.text, Loader=_Loader)
        aliases: list[Any] = [event for event in events if isinstance(event, yaml.AliasEvent)]
        for item in aliases or [node]:
            finding = Finding.at(self._mark(item), "an alias (`*name`) is not used in an inventory", "write it out")
            if finding not in self.findings:
                self.findings.append(finding)

    def _mapping(self, node: MappingNode) -> dict[str, Node]:
        result: dict[str, Node] = {}
        for key, value in node.value:
            name = self._key(key)
            if name is None:
                continue
            name, joined, _ = name.partition(":")
            if joined:
                self._wrong(key, f"a space is missing after `{shown_key(name)}:`", f"write `{shown_key(name)}: …`")
            if name in result:
                first = result[name].place.line
                self._wrong(key, f"`{shown_key(name)}` stands here twice (first in line {first})", "keep one of them")
                continue
            result[name] = replace(self._node(value), key=self._mark(key))
            if joined:
                result[name] = replace(result[name], told=True)
        return result

    def _key(self, key: yaml.Node) -> str | None:
        if isinstance(key, yaml.MappingNode):
            self._wrong(key, _IS_JINJA, "write the value itself")
            return None
        if not isinstance(key, yaml.ScalarNode) or key.tag != _STANDARD + "str":
            shown = f"`{key.value}`" if isinstance(key, yaml.ScalarNode) else "a list"
            hint = f'write it in quotes: "{key.value}"' if isinstance(key, yaml.ScalarNode) else "write a word as key"
            if key.tag == _STANDARD + "merge":
                hint = "write the keys out"
            self._wrong(key, f"{shown} is not read as text, so it cannot be a key", hint)
            return None
        if any(mark in key.value for mark in _JINJA):
            self._wrong(key, "a key holds a Jinja expression; an inventory holds final values", "write the name itself")
            return None
        return str(key.value)

    def _scalar(self, node: yaml.Node) -> Node:
        mark, text = self._mark(node), str(node.value)
        plain = not getattr(node, "style", None)
        if node.tag in {TAG, UNTAGGED}:
            return Node(mark, self._secret(node, text))
        kind = node.tag.removeprefix(_STANDARD)
        if kind not in _SCALARS:
            self._wrong(node, "a `!` begins a tag, and only `!vault` is used here", "put a text with `!` in quotes")
            return Node(mark, text, text, plain, told=True)
        if any(part in text for part in _JINJA):
            self._wrong(node, _IS_JINJA, "write the value itself")
            return Node(mark, text, text, plain, told=True)
        try:
            value: Scalar = self.constructor.construct_object(node)
        except (ValueError, yaml.YAMLError):
            self._wrong(node, "this looks like a number or a date but is none", "write it in quotes")
            return Node(mark, text, text, plain, told=True)
        return Node(mark, value, text, plain)

    def _secret(self, node: yaml.Node, text: str) -> Secret:
        try:
            return unseal(text, self.decrypt)
        except VaultError as error:
            self._wrong(node, str(error), error.hint or "")
            return unseal(text, None, strict=False)
