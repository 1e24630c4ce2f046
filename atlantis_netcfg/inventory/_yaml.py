"""YAML parser that keeps the place of every value and refuses what an inventory must not contain.

PyYAML's C parser returns nodes with marks; this module converts them to `Node`s, and reports duplicate keys, Jinja,
tags, aliases and keys that are not text. PyYAML itself silently keeps the last of two equal keys, and so does Ansible.

A value is an example if its line ends with a comment `# EXAMPLE`, or if it is below such a key.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from datetime import date
from typing import TYPE_CHECKING, Any, NoReturn

import yaml

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.inventory import findings

if TYPE_CHECKING:
    from yaml.nodes import MappingNode, SequenceNode


Scalar = str | int | float | bool | date | Secret | None


@dataclass(frozen=True, slots=True)
class Node:
    """A value of the inventory and its place."""

    mark: findings.Mark
    value: dict[str, Node] | list[Node] | Scalar
    text: str = ""
    """Text of a scalar as written in the file."""
    plain: bool = False
    """Whether the scalar is unquoted, so that YAML may not read it as text."""
    key: findings.Mark | None = None
    """Place of the value's own key; None: it has none."""
    is_reported: bool = False
    """An error of this value is already reported; its intended value is unknown."""
    example: bool = False
    """Whether it is marked `# EXAMPLE`, so that the real value is still missing."""

    @property
    def keys(self) -> dict[str, Node]:
        """Values of a block by key; empty for other values."""
        return self.value if isinstance(self.value, dict) else {}

    @property
    def place(self) -> findings.Mark:
        """Place to show to a person: the key, else the value."""
        return self.key or self.mark

    def at(self, *path: str | int) -> Node:
        """Return the node at a path, or its nearest written parent (the rest are defaults)."""
        node = self
        for step in path:
            below: dict[Any, Node] = {}
            if isinstance(node.value, dict):
                below = node.value
            elif isinstance(node.value, list):
                below = dict(enumerate(node.value))
            if step not in below:
                break
            node = below[step]
        return node

    def data(self) -> Any:  # noqa: ANN401 - what YAML holds
        """Return the value without places."""
        if isinstance(self.value, dict):
            return {key: node.data() for key, node in self.value.items()}
        if isinstance(self.value, list):
            return [node.data() for node in self.value]
        return self.value


TAG = "!vault"
OLD_TAG = "!vault-encrypted"
"""Older name of the tag; Ansible supports both (ansible-core, `parsing/yaml/constructor`)."""
CANNOT_DECRYPT = "this secret cannot be decrypted"
Decrypt = Callable[[str], str]
"""Decrypts vault text; any exception means that it could not be decrypted."""


class VaultError(UsageError):
    """A vaulted value is damaged or cannot be decrypted."""


class SealedSecret(Secret):
    """A secret that is still encrypted: equal only to the same vault text, and not revealable.

    Sealed values are enough to validate an inventory without a password.
    """

    __slots__ = ()

    def reveal(self) -> NoReturn:
        """Raise UsageError: the value is still encrypted."""
        raise UsageError(
            "a secret of the inventory is still encrypted",
            hint="give the vault password: ANSIBLE_VAULT_PASSWORD_FILE=FILE provision …, or `--ask-vault-pass`",
        )

    def decrypt_with(self, decrypt: Decrypt) -> Secret:
        """Return the decrypted secret. Raises UsageError."""
        return unseal(self._value, decrypt)


def unseal(text: str, decrypt: Decrypt | None, *, strict: bool = True) -> Secret:
    """Decrypt a vault text; without `decrypt` the secret stays sealed.

    Raises VaultError, or the UsageError of a `decrypt` without password.
    """
    if strict and not text.startswith("$ANSIBLE_VAULT;"):
        raise VaultError("this is not a vaulted value", hint="create one: ansible-vault encrypt_string")
    if decrypt is None or not strict:
        return SealedSecret(text)
    try:
        value = decrypt(text)
    except UsageError:
        raise
    except Exception as error:
        raise VaultError(CANNOT_DECRYPT, hint="check the vault password: it does not fit this value") from error
    return Secret(value.rstrip("\r\n"))


_WORDS: tuple[tuple[str, str, str], ...] = (
    ("found a tab character", "there is a tab here", "indent with spaces"),
    (
        "mapping values are not allowed",
        "there is a `:` too many, or the line is indented too far",
        'quote a text that contains ": "',
    ),
    ("could not find expected ':'", "a key without `:`", "write `key: value`"),
    ("did not find expected key", "the line does not fit into its block", "indent it like the lines around it"),
    ("expected <document start>", "the line does not fit into its block", "indent it like the lines around it"),
    ("did not find expected '-' indicator", "the line does not fit into its list", "start it with `- `"),
    (
        "did not find expected ',' or '}'",
        "a `{` is not closed, or a comma is missing",
        "write {key: value, key: value}",
    ),
    ("did not find expected ',' or ']'", "a `[` is not closed, or a comma is missing", "write [value, value]"),
    ("did not find expected node content", "a value is missing here", "write the value"),
    ("unexpected end of stream", "a quote is not closed", "close the text with the quote it began with"),
    (
        "block sequence entries are not allowed",
        "there is a `-` where no list is expected",
        "put the list below its key",
    ),
    ("but found another document", "a second `---` starts another document", "keep one `---` per file"),
    (
        "found undefined alias",
        "aliases (`*name`) are not supported in an inventory",
        "write it out, or put it in quotes",
    ),
    ("cannot start any token", "a text cannot start with this character", "put the text in quotes"),
    ("while scanning an alias", "a text cannot start with `*`", "put the text in quotes"),
    ("while scanning an anchor", "a text cannot start with `&`", "put the text in quotes"),
    ("while scanning a tag", "a `!` starts a tag, and only `!vault` is supported", "put a text with `!` in quotes"),
    ("undefined tag handle", "a `!` starts a tag, and only `!vault` is supported", "put a text with `!` in quotes"),
    (
        "unknown escape character",
        "a backslash in double quotes starts an escape sequence",
        "put the text in single quotes",
    ),
)
_UNCLOSED_ERRORS = ("did not find expected ',' or", "unexpected end of stream")


def explain(error: yaml.YAMLError, file_name: str, text: str) -> findings.Finding:
    """Convert a YAML syntax error to a finding."""
    if isinstance(error, yaml.reader.ReaderError):
        before = text[: error.position]
        mark = findings.Mark(file_name, before.count("\n") + 1, error.position - before.rfind("\n"))
        return findings.Finding.at(mark, "there is a control character here", "delete it")
    words = str(error)
    place = _place(error, words)
    mark = findings.Mark(file_name, *_inside(text, place)) if place is not None else findings.Mark(file_name, 1, 1)
    if place is not None and _character(text, place) == "\t":
        return findings.Finding.at(mark, "there is a tab here", "indent with spaces")
    for part, message, hint in _WORDS:
        if part in words:
            return findings.Finding.at(mark, message, hint)
    return findings.Finding.at(
        mark, "this is not valid YAML from here on", "compare the line and the one above with a file that works"
    )


def _character(text: str, mark: yaml.Mark) -> str:
    line = "".join(text.splitlines()[mark.line : mark.line + 1])
    return line[mark.column : mark.column + 1]


def _place(error: yaml.YAMLError, text: str) -> yaml.Mark | None:
    """Return the place to show: for unclosed constructs their beginning."""
    context_mark: yaml.Mark | None = getattr(error, "context_mark", None)
    problem_mark: yaml.Mark | None = getattr(error, "problem_mark", None)
    return context_mark if any(part in text for part in _UNCLOSED_ERRORS) else problem_mark or context_mark


def _inside(text: str, mark: yaml.Mark) -> tuple[int, int]:
    """Limit a place to the end of the file, since PyYAML may point after it."""
    lines = text.splitlines() or [""]
    return (mark.line + 1, mark.column + 1) if mark.line < len(lines) else (len(lines), len(lines[-1]) + 1)


_STANDARD = "tag:yaml.org,2002:"
_SCALARS = frozenset({"str", "int", "float", "bool", "null", "timestamp"})
_IS_JINJA = "this is a Jinja expression; an inventory holds final values"
_JINJA = ("{{", "{%", "{#")
_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


_COMMENT = re.compile(r"(?:^|(?<=\s))#")
_EXAMPLE = re.compile(r"\bEXAMPLE\b(?!-)")


def _marked_lines(text: str, root: yaml.Node) -> frozenset[int]:
    """Return the lines (from 0) with a comment EXAMPLE; a `#` inside a text begins no comment."""
    candidates = {number: line for number, line in enumerate(text.split("\n")) if "#" in line and _EXAMPLE.search(line)}
    if not candidates:
        return frozenset()
    texts = [(node.start_mark, node.end_mark, getattr(node, "style", None) in {"|", ">"}) for node in _scalars(root)]
    marked_lines = set()
    for number, line in candidates.items():
        inside = [_inside_line(number, *place) for place in texts if place[0].line <= number <= place[1].line]
        begins = [match.start() for match in _COMMENT.finditer(line)]
        comment = next((at for at in begins if not any(low <= at < high for low, high in inside)), None)
        if comment is not None and _EXAMPLE.search(line, comment):
            marked_lines.add(number)
    return frozenset(marked_lines)


def _scalars(root: yaml.Node) -> Iterator[yaml.ScalarNode]:
    """Yield every scalar key and value once."""
    waiting, seen_ids = [root], set[int]()
    while waiting:
        node = waiting.pop()
        if id(node) in seen_ids:
            continue
        seen_ids.add(id(node))
        if isinstance(node, yaml.ScalarNode):
            yield node
        elif isinstance(node, yaml.MappingNode):
            waiting += [part for pair in node.value for part in pair]
        else:
            waiting += node.value


def _inside_line(number: int, start: yaml.Mark, end: yaml.Mark, is_block: bool) -> tuple[float, float]:  # noqa: FBT001
    """Return the columns that a text occupies in a line; the first line of a block (`|`) is only its sign."""
    if is_block and number == start.line:
        return start.column, start.column + 1
    low = start.column if number == start.line else 0
    return low, end.column if number == end.line else float("inf")


def parse(data: bytes, file_name: str, decrypt: Decrypt | None) -> tuple[Node | None, list[findings.Finding]]:
    """Parse one file; `file_name` is used in errors. None if it is empty or invalid."""
    start = findings.Mark(file_name, 1, 1)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        where = findings.Mark(file_name, data.count(b"\n", 0, error.start) + 1, 1)
        return None, [findings.Finding.at(where, "this line is not UTF-8 text", "save the file as UTF-8")]
    if text.startswith("$ANSIBLE_VAULT;"):
        hint = msg(f"ansible-vault decrypt {arg(file_name)}, then ansible-vault encrypt_string for each secret")
        return None, [findings.Finding.at(start, "the whole file is encrypted; only single values can be", hint)]
    try:
        if (deep := _too_deep(text)) is not None:
            mark = findings.Mark(file_name, deep.line + 1, deep.column + 1)
            return None, [
                findings.Finding.at(
                    mark, msg(f"the file is nested more than {arg(_DEEPEST)} levels deep"), "use fewer levels"
                )
            ]
        root = _compose(text)
    except yaml.YAMLError as error:
        return None, [explain(error, file_name, text)]
    if root is None:
        return None, []
    return _Converter(file_name, text, decrypt).convert(root)


_DEEPEST = 100


def _too_deep(text: str) -> Any:  # noqa: ANN401 - a mark of PyYAML or of its C parser, or None
    """Return the place of too deep nesting: the C parser is recursive and would overflow its stack."""
    indents = (len(line) - len(line.lstrip(" -?")) for line in text.splitlines())
    if text.count("[") + text.count("{") + max(indents, default=0) <= _DEEPEST:
        return None
    depth = 0
    for event in yaml.parse(text, Loader=_Loader):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > _DEEPEST:
            return event.start_mark
    return None


def _compose(text: str) -> yaml.Node | None:
    loader = _Loader(text)
    try:
        root: yaml.Node | None = loader.get_single_node()
        return root
    finally:
        loader.dispose()


class _Converter:
    """Converts PyYAML's nodes to `Node`s and collects errors."""

    def __init__(self, file_name: str, text: str, decrypt: Decrypt | None) -> None:
        self.file_name = file_name
        self.text = text
        self.decrypt = decrypt
        self.findings: list[findings.Finding] = []
        self.seen: set[int] = set()
        self.marked: frozenset[int] = frozenset()
        self.marked_blocks = 0
        self.constructor: Any = yaml.constructor.SafeConstructor()

    def convert(self, root: yaml.Node) -> tuple[Node | None, list[findings.Finding]]:
        """Return the tree and its errors."""
        self.marked = _marked_lines(self.text, root)
        try:
            return self._node(root), self.findings
        except RecursionError:
            mark = self._mark(root)
            return None, [findings.Finding.at(mark, "the file is nested too deeply", "use fewer levels")]

    def _mark(self, node: Any) -> findings.Mark:  # noqa: ANN401 - a node or an event
        return findings.Mark(self.file_name, node.start_mark.line + 1, node.start_mark.column + 1)

    def _add_finding(self, node: yaml.Node, message: str, hint: str) -> None:
        self.findings.append(findings.Finding.at(self._mark(node), message, hint))

    def _node(self, node: yaml.Node, key: findings.Mark | None = None) -> Node:
        if id(node) in self.seen:
            self._alias(node)
            return Node(self._mark(node), None, key=key, is_reported=True)
        self.seen.add(id(node))
        if isinstance(node, yaml.MappingNode):
            self._expect_tag(node, "map")
            jinja = any(isinstance(key, yaml.MappingNode) for key, _ in node.value)
            return Node(self._mark(node), self._mapping(node), key=key, is_reported=jinja)
        if isinstance(node, yaml.SequenceNode):
            self._expect_tag(node, "seq")
            return Node(self._mark(node), [self._node(item) for item in node.value], key=key)
        return self._scalar(node, key)

    def _expect_tag(self, node: MappingNode | SequenceNode, tag: str) -> None:
        if node.tag != _STANDARD + tag:
            self._add_finding(node, "a `!` starts a tag, and only `!vault` is supported", "remove it")

    def _alias(self, node: yaml.Node) -> None:
        """Report aliases at their own places, which only the event stream has."""
        events = yaml.parse(self.text, Loader=_Loader)
        aliases: list[Any] = [event for event in events if isinstance(event, yaml.AliasEvent)]
        for item in aliases or [node]:
            finding = findings.Finding.at(
                self._mark(item), "aliases (`*name`) are not supported in an inventory", "write it out"
            )
            if finding not in self.findings:
                self.findings.append(finding)

    def _mapping(self, node: MappingNode) -> dict[str, Node]:
        result: dict[str, Node] = {}
        for key, value in node.value:
            name = self._key(key)
            if name is None:
                continue
            name, colon, _ = name.partition(":")
            if colon:
                self._add_finding(
                    key,
                    msg(f"a space is missing after `{arg(findings.shown_key(name))}:`"),
                    msg(f"write `{arg(findings.shown_key(name))}: …`"),
                )
            if name in result:
                first = result[name].place.line
                self._add_finding(
                    key,
                    msg(f"`{arg(findings.shown_key(name))}` is here twice (first in line {arg(first)})"),
                    "keep one of them",
                )
                continue
            is_block = key.start_mark.line in self.marked and value.start_mark.line > key.start_mark.line
            self.marked_blocks += is_block
            result[name] = self._node(value, self._mark(key))
            self.marked_blocks -= is_block
            if colon:
                result[name] = replace(result[name], is_reported=True)
        return result

    def _key(self, key: yaml.Node) -> str | None:
        if isinstance(key, yaml.MappingNode):
            self._add_finding(key, _IS_JINJA, "write the value itself")
            return None
        if not isinstance(key, yaml.ScalarNode) or key.tag != _STANDARD + "str":
            text = f"`{key.value}`" if isinstance(key, yaml.ScalarNode) else "a list"
            hint = msg(
                f'write it in quotes: "{arg(key.value)}"' if isinstance(key, yaml.ScalarNode) else "use a word as key"
            )
            if key.tag == _STANDARD + "merge":
                hint = "write the keys out"
            self._add_finding(key, msg(f"YAML does not read {arg(text)} as text, so it cannot be a key"), hint)
            return None
        if any(mark in key.value for mark in _JINJA):
            self._add_finding(
                key, "a key contains a Jinja expression; an inventory holds final values", "write the name itself"
            )
            return None
        return str(key.value)

    def _scalar(self, node: yaml.Node, key: findings.Mark | None) -> Node:
        mark, text, errors = self._mark(node), str(node.value), len(self.findings)
        example = self.marked_blocks > 0 or node.start_mark.line in self.marked
        if node.tag in {TAG, OLD_TAG}:
            return Node(mark, self._secret(node, text), key=key, example=example)
        value, plain = self._value(node, text), not getattr(node, "style", None)
        return Node(mark, value, text, plain, key, is_reported=len(self.findings) > errors, example=example)

    def _value(self, node: yaml.Node, text: str) -> Scalar:
        """Return the value of a plain or quoted scalar; its text if invalid."""
        kind = node.tag.removeprefix(_STANDARD)
        if kind not in _SCALARS:
            self._add_finding(
                node, "a `!` starts a tag, and only `!vault` is supported", "put a text with `!` in quotes"
            )
        elif any(part in text for part in _JINJA):
            self._add_finding(node, _IS_JINJA, "write the value itself")
        elif kind != "str":
            try:
                value: Scalar = self.constructor.construct_object(node)
            except (ValueError, yaml.YAMLError):
                self._add_finding(node, "this looks like a number or a date but is neither", "write it in quotes")
            else:
                return value
        return text

    def _secret(self, node: yaml.Node, text: str) -> Secret:
        try:
            return unseal(text, self.decrypt)
        except VaultError as error:
            self._add_finding(node, str(error), error.hint or "")
            return unseal(text, None, strict=False)
