#!/usr/bin/env python3
"""Writes every message that reaches a person into the catalogues (atlantis_netcfg/locale/*/LC_MESSAGES/provision.po).

    tools/messages.py            add what is new, keep translations, put aside what is gone
    tools/messages.py --missing  list what has no translation, change nothing

Messages stand in the source as plain English, and this program finds them there by what they are: text of two words
and more, or text in a place where only messages stand (`print`, `hint=`, a help text). `f"{count} changes"` becomes
`{count} changes`. OUT names the parts and the places whose text is no message, each with its reason. Translations of
what is gone stay at the end of the file (`#~`), and come back when the message does.
"""

from __future__ import annotations

import ast
import errno
import os
import re
import sys
from datetime import UTC, datetime
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

from babel.messages.catalog import Catalog, Message
from babel.messages.pofile import read_po, write_po

from atlantis_netcfg.core.translation import number_values

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = "atlantis_netcfg"
PORTUGUESE = ROOT / PACKAGE / "locale" / "pt_PT" / "LC_MESSAGES" / "provision.po"


def _set(words: str) -> frozenset[str]:
    return frozenset(words.split())


IN = (
    "ansible_collections/atlantis/netcfg/plugins/action",
    "ansible_collections/atlantis/netcfg/plugins/module_utils",
    "ansible_collections/atlantis/netcfg/plugins/modules",
    "ansible_collections/atlantis/netcfg/plugins/plugin_utils/board/install.py",
    "ansible_collections/atlantis/netcfg/plugins/plugin_utils/zipapp_action.py",
    "checklist",
    "cli",
    "core",
    "computers",
    "inventory",
    "links/cost.py",
    "links/lte",
    "links/policy.py",
    "links/qualify/archive.py",
    "links/qualify/compare.py",
    "links/qualify/figures.py",
    "links/qualify/grids.py",
    "links/qualify/judgement.py",
    "links/qualify/record.py",
    "links/qualify/samples.py",
    "links/qualify/search.py",
    "links/qualify/transfers.py",
    "links/satellite.py",
    "links/standing_traffic.py",
    "links/status.py",
    "links/wifi.py",
    "operations",
    "records",
    "robots",
    "routeros",
    "runs",
    "vpn/authority",
    "vpn/enrolment_package",
    "vpn/ledger",
    "vpn/members.py",
    "vpn/pki",
    "vpn/policy.py",
    "vpn/recipients.py",
    "vpn/rehearsal.py",
    "vpn/reports.py",
    "vpn/requests.py",
    "vpn/router_import.py",
)
"""What a technician or a partner reads of a run, a checklist, a hand-out, and of the commands around them.

Not here, and in English in every language: the making of bundles.
"""

ERRORS = _set("""
    core/crash_report.py links/lte/at.py links/lte/rutos_read.py links/qualify/profile.py routeros/_items.py
    routeros/api/_values.py routeros/api/_wire.py vpn/names.py vpn/server.py
    """)
"""Files of which only raised errors and `msg` texts are messages; the rest is data."""
NOT_REHEARSED = "emulator"
"""Of this part only what `NOT_REHEARSED` lists is read by a person; the rest are the words of devices."""
HANDOUT = "templates/handout"
"""Folder of the pages that a partner gets: `*.txt.j2`, translated block by block."""
PLAYS = ("playbooks", "roles")
"""Folders whose tasks are named on the progress line."""

OUT: Mapping[str, str] = {
    "checklist/probes/agent": "a program that runs on the gateway; what it saw is data, judged by the probes",
    "robots/listener.py": "a program that runs on other computers; what it heard is data",
    "core/compiled_catalogue.py": "a damaged file is written again, and no one is told",
    "core/reading_programs.py": "the closed list of programs",
    "checklist/runner/simulated": "what emulated computers print",
    "cli/vpn/__init__.py": "it holds nothing",
    "inventory/json_schema.py": "files for editors, which are in English",
    "inventory/key_reference.py": "a page for engineers, which is in English",
    "inventory/new_inventory/files.py": "comments and values of files, which are in English",
    "inventory/new_inventory/yaml_text.py": "the grammar of files",
    "operations/computers/_emulation.py": "programs of a rehearsal, and what Ansible calls them",
    "computers/bundle": "the making of bundles, which is in English",
    "core/processes/remote_bundle.py": "names of files",
    "core/eventlog.py": "lines of a log",
    "routeros/assumptions.py": "for engineers: `device verify` prints what docs/engineers/assumptions.md lists",
    "operations/pilot_network/network.py": "arguments of ip and nft",
    "operations/pilot_network/robot.py": "what a DDS message holds",
    "operations/lte/assumptions.py": "what engineers have to test on a real unit, as of RouterOS",
    "routeros/menus": "RouterOS's own language",
    "routeros/rsc": "the grammar of export text",
    "routeros/apply/_inverse.py": "RouterOS's own language",
    "routeros/apply/_scripts.py": "RouterOS's own language",
}
"""Parts of IN whose text is no message, or reaches nobody as one."""


NOT_MESSAGES = _set("""
    compile getattr setattr hasattr startswith endswith removeprefix removesuffix partition rpartition
    split rsplit strip lstrip rstrip replace get pop encode decode open search fullmatch finditer
    findall sub strftime strptime import_module TypeVar NewType which fromisoformat glob AssertionError
    RuntimeError TypeError NotImplementedError count index find Query Ask Program getLogger debug
    write_text environ setdefault joinpath with_suffix with_name StringConstraints
    """)
"""Functions whose texts are no messages: patterns, keys, names of files, and errors of ours that nobody is shown."""
SHOWN = frozenset({"print", "line", "Word", "Flag", "CommandSpec", "translate", "Consent", "Event"})
"""Functions whose texts are messages even where they are a single word."""
LABELLED = frozenset({"item", "read", "measured_evidence", "declared_evidence"})
"""Functions whose first text is the name of an item or of a reading, even where it is a single word."""
SHOWN_NAMES = _set("""
    Stage DriftKind Owner PageText _TITLES _EVIDENCE _STATES _KINDS EVIDENCE KINDS PHASES _PHASES
    FigureTrend RateLimit DoctorSection TrafficSource
    """)
"""Classes and tables whose texts are messages even where they are a single word."""
MODULE_DOCUMENTATION = frozenset({"DOCUMENTATION", "EXAMPLES", "RETURN"})
"""What `ansible-doc` shows of a module, to engineers."""
OF_THE_SYSTEM = tuple(
    form
    for number in (
        *(errno.ENOENT, errno.EACCES, errno.EPERM, errno.EISDIR, errno.ENOTDIR, errno.EEXIST, errno.ENOTEMPTY),
        *(errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO, errno.EBUSY, errno.ENODEV, errno.ENXIO, errno.EMFILE),
        *(errno.ECONNREFUSED, errno.ECONNRESET, errno.ETIMEDOUT, errno.ENETUNREACH, errno.EHOSTUNREACH, errno.EPIPE),
        *(errno.EADDRINUSE, errno.EADDRNOTAVAIL, errno.EINVAL, errno.ENAMETOOLONG, errno.ELOOP),
    )
    for form in (os.strerror(number), os.strerror(number)[:1].lower() + os.strerror(number)[1:])
)
"""What the system says of a file or a connection, at the beginning of a sentence and in it."""
MADE = (
    *OF_THE_SYSTEM,
    "not root",
    "add --rehearse",
    "infrastructure",
    "the modem of {name} is listening",
    "{who} is transmitting",
    "{who} is receiving",
    "{who} is responding",
    "{findings} error in the inventory; no device was contacted",
    "{findings} errors in the inventory; no device was contacted",
    "{findings} warning in robot files",
    "{findings} warnings in robot files",
    "{findings} warning in the inventory; no device was contacted",
    "{findings} warnings in the inventory; no device was contacted",
    "REHEARSED",
    "REHEARSED IN PART",
    "REHEARSED, WITH WARNINGS",
    "DONE",
    "DONE IN PART",
    "DONE, WITH WARNINGS",
    "SAVED",
    "SAVED IN PART",
    "SAVED, WITH WARNINGS",
    "NOTHING TO CHANGE",
    "NOTHING TO CHANGE IN PART",
    "NOTHING TO CHANGE, WITH WARNINGS",
    "LOOKED AT",
    "LOOKED AT IN PART",
    "LOOKED AT, WITH WARNINGS",
    "PLANNED",
    "STOPPED by {signal}",
    "REFUSED",
    "ROLLED BACK",
    "NOT REACHED",
    "UNKNOWN",
    "NOT PROVED",
    "DIFFERENT",
    "FAILED",
    "NOTHING DONE",
    "devices",
    "plan",
    "check",
    "do",
    "limits",
    "next",
    "record",
    "note",
    "{number} changed",
    "{number} unchanged",
    "{number} missing",
    "{number} added",
    "{number} order",
    "{number} foreign",
    "{number} hidden",
    "{number} open",
    "{number} failed",
    "{number} not reached",
    "{number} to change",
    "{number} different",
    "{number} refused",
    "{number} rolled back",
    "{number} unknown",
    "{number} not proved",
    "{number} inventory only",
    "{number} not checked",
    "{number} not rehearsed",
    "{number} not supported yet",
    "background",
    "1 device",
    "1 link",
    "criterion",
    "measured",
    "limit",
    "sent",
    "received",
    "goodput",
    "sustained",
    "size",
    "verdict",
    "direction",
    "proved",
    "{findings} error in the answers; nothing was changed",
    "{findings} errors in the answers; nothing was changed",
    "names",
    "foundation",
    "attachment",
    "policy",
    "cleanup",
    "nothing",
    "registered home",
    "registered roaming",
    "denied",
    "sim missing",
    "sim pin required",
    "sim puk required",
    "disabled",
    "network",
    "way",
    "port link",
    "loss",
    "status",
    "channel",
    "signal",
    "tx signal",
    "tx rate",
    "rx rate",
    "uptime",
    "peer",
    "far signal",
    "next hop seen",
    "kept off packets",
    "kept off",
    "registration",
    "operator",
    "access tech",
    "band",
    "roaming",
    "address",
    "carrier nat",
    "firmware",
    "{number} assumptions about RouterOS that no document or record confirms: {page}",
    "the emulated {vehicle}",
    "robots: no packet of DDS is carried; what is heard follows from their files, and so does who is in the VPN",
    "lte router",
    "satellite terminal",
    "vpn server",
    "operator station",
    "control centre",
    "gateway",
    "switch",
    "router",
    "why",
    "link",
    "what",
    "amount",
    "value",
    "certainty",
    "up %",
    "down %",
    "size          octets    Hz  sent  recv   up% down%  p50 s  p95 s  verdict",
    "4G registration",
    "4G technology",
    "4G operator",
    "4G band",
    "4G cell",
    "4G unit",
    "{variable} is set",
    "missing: apt install {packages}",
    "installing {packages}",
    "not Linux",
    "the kernel has no overlay file system",
    "this computer may not make namespaces",
    "no machine can be run here: {reason}",
    (
        "over {name}, which stands before other links, nobody is asked: while its box answers,"
        " silence behind it moves no traffic"
    ),
    (
        "probes over {name}, which is metered, every {watch} s use {daily} MB a day in normal operation,"
        " as the budget of its canaries demands, and up to {unsteady} MB on a day on which the link fails again"
        " and again"
    ),
    (
        "probes over {name}, which is metered, use {daily} MB a day in normal operation;"
        " less with a longer `metered_probe_s`"
    ),
)
"""Messages that are put together of words, or stand in a template of a device (templates/routeros)."""
SHOWN_KEYWORDS = frozenset({"hint", "help", "summary", "words", "message", "question", "title", "what"})
NOT_KEYWORDS = _set("""
    encoding errors newline mode pattern flags suffix prefix example name takes
    """)

_TWO_WORDS = re.compile(r"[A-Za-z}`)][,;:.!?)`]* [A-Za-z{`(]")
_HEADING = re.compile(r"^[A-Z][a-z]+:$")
_LETTERS = re.compile(r"[A-Za-z]{2,}")
_FOREIGN = re.compile(
    r"^/|^:|^\$|^-{1,2}[a-z]|^#|^\.id|^<|^\*|^[A-Za-z_]+=\S*$|^AT\+"
    r"|^if \{|^ssh |^python3? |^import |^def |^[a-z-]+ --[a-z]"
    r"|\(\?|\\[dws]|\[\^|^%"
    r"|^\{[a-z_]+\}( \{[a-z_]+\})*$|^\{[a-z_]+\}[/.]\S*$"
)
"""Commands of devices and programs, patterns, and values alone."""
_TASK = re.compile(r"^ *- name: ([A-Z][^\n{#]*?)(?: #.*)?$", re.MULTILINE)
_VARIANTS = 12
_TEMPLATE_TEXT = re.compile(
    r"""(?:\bt|\btranslate|\b_)\(\s*(?P<quote>["'])(?P<text>.*?)(?P=quote)\s*[,)]"""
    r"""|(?P<q2>["'])(?P<filtered>[^"'{}]*)(?P=q2)\s*\|\s*(?:translate|t)\b"""
)
"""In a template: what is handed to `translate`, as a call or as a filter."""


def in_scope(root: Path = ROOT) -> list[Path]:
    """The files that hold messages, in the order of their names."""
    package = root / PACKAGE
    found = [path for path in package.rglob("*") if path.suffix in {".py", ".j2"}]
    return sorted(path for path in found if _chosen(path.relative_to(package).as_posix()))


def _chosen(name: str) -> bool:
    def under(parts: Iterable[str]) -> bool:
        return any(name == part or name.startswith(f"{part}/") for part in parts)

    return name in ERRORS or (under(IN) and not under(OUT))


def messages(root: Path = ROOT) -> dict[str, list[str]]:
    """Each message with the files that hold it, in the order of the source."""
    found: dict[str, list[str]] = {}
    for path, texts in _texts(root):
        name = path.relative_to(root).as_posix()
        for text in texts:
            files = found.setdefault(text, [])
            if name not in files:
                files.append(name)
    return found


def _texts(root: Path) -> Iterator[tuple[Path, Iterable[str]]]:
    """The files of all kinds, with their messages."""
    yield root / "tools" / "messages.py", MADE
    for path in in_scope(root):
        is_data = path.relative_to(root / PACKAGE).as_posix() in ERRORS
        yield path, of_source(path.read_text(encoding="utf-8"), template=path.suffix == ".j2", errors_only=is_data)
    for path in sorted((root / PACKAGE / NOT_REHEARSED).rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        listed = [node for node in tree.body if isinstance(node, ast.Assign) and _target(node) == "NOT_REHEARSED"]
        yield path, [text for node in listed for text in _Reader.of(node)]
    for path in sorted((root / HANDOUT).glob("*.txt.j2")):
        yield path, of_handout(path.read_text(encoding="utf-8"))
    for path in sorted(path for folder in PLAYS for path in (root / folder).rglob("*.yml")):
        yield path, map(_escaped, _TASK.findall(path.read_text(encoding="utf-8")))


def _target(node: ast.Assign) -> str:
    return node.targets[0].id if isinstance(node.targets[0], ast.Name) else ""


def of_source(source: str, *, template: bool = False, errors_only: bool = False) -> Iterator[str]:
    """The messages of one file."""
    if template:
        for item in _TEMPLATE_TEXT.finditer(source):
            yield from _lines([item["text"] or item["filtered"] or ""], sure=True)
        return
    tree = ast.parse(source)
    for part in filter(_is_error_text, ast.walk(tree)) if errors_only else [tree]:
        yield from _Reader.of(part)


def _is_error_text(node: ast.AST) -> bool:
    if isinstance(node, ast.Raise):
        return isinstance(node.exc, ast.Call) and _last_name(node.exc.func) not in {"ValueError", "GarbageError"}
    return isinstance(node, ast.Call) and _last_name(node.func) == "msg"


_TAG_LINE = re.compile(r"^\{%.*%\}$", re.MULTILINE)
_TEXT = r"((?:(?!\{%).)*)"
_CONDITION = re.compile(rf"\{{% if [^%]*%\}}{_TEXT}(?:\{{% else %\}}{_TEXT})?\{{% endif %\}}", re.DOTALL)
_VALUE = re.compile(r"\{\{ *([\w.]*?(\w+))(?:\[[^]]*\])? *(?:\|[^}]*)?\}\}")
_RULE = re.compile(r"^(=+|-+|\{\{.*\* .*\}\})$")


def of_handout(source: str) -> Iterator[str]:
    """The messages of a page for partners: headings, entries of lists and paragraphs, each in one line.

    A tag on a line of its own stands between blocks; one within a line makes two messages of the block.
    """
    found: list[str] = []
    for block in re.split(r"\n{2,}", _TAG_LINE.sub("\n", source)):
        for lines in (text.strip("\n").split("\n") for text in _branches(block)):
            if not all(line.startswith("    ") for line in lines):
                found.extend(_pieces(lines))
    yield from dict.fromkeys(item for text in found for item in _lines([text], sure=True))


def _branches(text: str) -> list[str]:
    condition = _CONDITION.search(text)
    if condition is None:
        return [re.sub(r"\{%.*?%\}", "", text)]
    before, after = text[: condition.start()], text[condition.end() :]
    return [item for branch in (condition[1], condition[2] or "") for item in _branches(before + branch + after)]


def _pieces(lines: list[str]) -> Iterator[str]:
    if len(lines) > 1 and _RULE.match(lines[1]):
        text = lines[0]
    elif lines[0].startswith("- "):
        text = " ".join(line.strip() if line.startswith(" ") else f"\n{line[2:]}" for line in lines).strip()
    else:
        text = " ".join(line.strip() for line in lines)
    for line in text.split("\n"):
        names: dict[str, int] = {}

        def named(value: re.Match[str], names: dict[str, int] = names) -> str:
            number = names[value[2]] = names.get(value[2], 0) + 1
            return "{" + value[2] + (str(number) if number > 1 else "") + "}"

        yield _VALUE.sub(named, line).strip()


class _Reader(ast.NodeVisitor):
    """Goes through a module, and knows of each text where it stands."""

    def __init__(self) -> None:
        self.found: list[str] = []
        self._sure = False

    @classmethod
    def of(cls, tree: ast.AST) -> Iterator[str]:
        """The messages of a module, or of a part of it."""
        reader = cls()
        reader.visit(tree)
        yield from dict.fromkeys(reader.found)

    def visit_Expr(self, node: ast.Expr) -> None:
        """Go past docstrings."""
        if not isinstance(node.value, ast.Constant):
            self.generic_visit(node)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        """Leave annotations and decorators alone."""
        for part in [*node.args.defaults, *(item for item in node.args.kw_defaults if item), *node.body]:
            self.visit(part)

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        """Know whether texts here are messages."""
        for part in node.body:
            self._named(part, node.name)

    def visit_Assign(self, node: ast.Assign) -> None:
        """Know whether texts here are messages."""
        target = _target(node)
        if target in MODULE_DOCUMENTATION:
            return
        if target in SHOWN_NAMES and isinstance(node.value, ast.Dict):
            for value in node.value.values:
                self._inside(value, sure=True)
        else:
            self.visit(node.value)

    def _named(self, node: ast.stmt, name: str) -> None:
        if name in SHOWN_NAMES and isinstance(node, ast.Assign):
            self._inside(node.value, sure=True)
        else:
            self.visit(node)

    def visit_Yield(self, node: ast.Yield) -> None:
        """`yield "signal", words` is a label and what stands beside it."""
        if isinstance(node.value, ast.Tuple):
            for place, value in enumerate(node.value.elts):
                self._inside(value, sure=place == 0)
        elif node.value is not None:
            self.visit(node.value)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        """Leave the annotation alone."""
        if node.value is not None:
            self.visit(node.value)

    def visit_Compare(self, node: ast.Compare) -> None:
        """What is compared is data."""

    def visit_Subscript(self, node: ast.Subscript) -> None:
        """Go past keys and types, but not past the errors of a type's own syntax."""
        self.visit(node.value)
        if _last_name(node.value) == "Annotated":
            for part in ast.walk(node.slice):
                if isinstance(part, ast.Call) and _last_name(part.func) == "matching":
                    self.visit(part)

    def visit_MatchValue(self, node: ast.MatchValue) -> None:
        """What is compared is data."""

    def visit_Dict(self, node: ast.Dict) -> None:
        """Go past keys."""
        for value in node.values:
            self.visit(value)

    def visit_Call(self, node: ast.Call) -> None:
        """Know whether texts here are messages."""
        name = _last_name(node.func)
        if name == "msg":
            self._inside(node.args[0], sure=True)
            return
        if isinstance(node.func, ast.Attribute):
            self.visit(node.func.value)
        if name in NOT_MESSAGES or (name == "match" and node.args):
            for argument in node.args:
                if not isinstance(argument, ast.Constant | ast.JoinedStr):
                    self.visit(argument)
            return
        shown = name in SHOWN
        for place, argument in enumerate(node.args):
            after_name = name in {"Word", "Flag", "CommandSpec", "Event"} and place == 0
            self._inside(argument, sure=(shown and not after_name) or (name in LABELLED and place == 0))
        for keyword in node.keywords:
            if keyword.arg not in NOT_KEYWORDS or name == "CommandSpec":  # its flags are options, with a help each
                self._inside(keyword.value, sure=keyword.arg in SHOWN_KEYWORDS)

    def _inside(self, node: ast.expr, *, sure: bool) -> None:
        while isinstance(node, ast.Call) and _last_name(node.func) == "msg":
            node, sure = node.args[0], True
        direct = isinstance(node, ast.Constant | ast.JoinedStr | ast.IfExp | ast.BoolOp | ast.BinOp)
        before, self._sure = self._sure, sure and direct
        self.visit(node)
        self._sure = before

    def visit_Constant(self, node: ast.Constant) -> None:
        """A text without values."""
        self._take(node)

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        """A text with values; messages may stand in the values as well."""
        self._take(node)
        for part in node.values:
            if isinstance(part, ast.FormattedValue):
                before, self._sure = self._sure, False
                self.visit(part.value)
                self._sure = before

    def visit_BinOp(self, node: ast.BinOp) -> None:
        """Texts that are joined by `+`."""
        pieces = list(_flat(node))
        if isinstance(node.op, ast.Add) and any(isinstance(piece, ast.Constant | ast.JoinedStr) for piece in pieces):
            self._take(node)
            for piece in pieces:
                if not isinstance(piece, ast.Constant):
                    self.visit(piece)
        else:
            self.generic_visit(node)

    def _take(self, node: ast.expr) -> None:
        texts = [text for text in _variants(node) if text]
        self.found.extend(_lines(texts, sure=self._sure))


def _flat(node: ast.expr) -> Iterator[ast.expr]:
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        yield from _flat(node.left)
        yield from _flat(node.right)
    else:
        yield node


_Piece = str | tuple[str]
"""Text, or the name of a value."""


def _variants(node: ast.expr) -> list[str]:
    """The msgids that a text may be: one for each choice between constants in it."""
    found = []
    for pieces in _choices(node)[:_VARIANTS]:
        names: dict[str, int] = {}
        text = ""
        for piece in pieces:
            if isinstance(piece, str):
                text += _escaped(piece)
                continue
            number = names[piece[0]] = names.get(piece[0], 0) + 1
            text += "{" + piece[0] + (str(number) if number > 1 else "") + "}"
        found.append(text)
    return found


def _escaped(text: str) -> str:
    """Literal text as a format string; `{name}` in it is filled in later, so it is a value as well."""
    pieces = re.split(r"(\{[a-z_]+\})", text)
    return "".join(
        piece if place % 2 else piece.replace("{", "{{").replace("}", "}}") for place, piece in enumerate(pieces)
    )


def _choices(node: ast.expr) -> list[list[_Piece]]:
    if isinstance(node, ast.Constant):
        return [[node.value]] if isinstance(node.value, str) else [[("value",)]]
    if isinstance(node, ast.JoinedStr):
        return _product([_choices(part) for part in node.values])
    if isinstance(node, ast.FormattedValue):
        plain = _is_choice(node.value) or _is_text(node.value)  # `{'':<18}` is layout
        return _choices(node.value) if plain else [[(_name(node.value),)]]
    if isinstance(node, ast.IfExp) and _is_choice(node):
        return [*_choices(node.body), *_choices(node.orelse)]
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return _product([_choices(part) for part in _flat(node)])
    return [[(_name(node),)]]


def _product(parts: list[list[list[_Piece]]]) -> list[list[_Piece]]:
    total = 1
    for part in parts:
        total *= len(part)
    if total > _VARIANTS:
        parts = [part if len(part) == 1 else [[("value",)]] for part in parts]
    return [[piece for choice in chosen for piece in choice] for chosen in product(*parts)]


def _is_choice(node: ast.expr) -> bool:
    """Whether it is one of several constant texts."""
    if isinstance(node, ast.IfExp):
        return all(_is_choice(branch) or _is_text(branch) for branch in (node.body, node.orelse))
    return False


def _is_text(node: ast.expr) -> bool:
    return isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Constant) and isinstance(node.value, str))


_THROUGH = _set("""
    arg msg conjunction alternatives len str sorted int float round abs repr join list next min max sum line below
    visible
    """)
"""Functions that are named by what they are given."""
_OF_TEXT = _set("removeprefix removesuffix strip rstrip lstrip replace lower upper isoformat")


def _name(node: ast.expr) -> str:
    """The last identifier of an expression, for a translator who has to know what stands there."""
    inner = _inner(node)
    if inner is not None:
        return _name(inner)
    if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Constant) and isinstance(node.slice.value, str):
        return node.slice.value
    return _last_name(node.func if isinstance(node, ast.Call) else node) or "value"


def _inner(node: ast.expr) -> ast.expr | None:
    """The part of an expression that it is named after."""
    match node:
        case (
            ast.Call(func=ast.Name(id="join"), args=[_, inner])
            | ast.Call(func=ast.Name(id="arg"), args=[ast.Call(func=ast.Name(id="ascii"), args=[inner])])
        ):
            pass
        case ast.Call(func=function, args=[inner, *_]) if _last_name(function) in _THROUGH:
            pass
        case ast.Call(func=ast.Attribute(value=inner, attr=name)) if name in _OF_TEXT:
            pass
        case ast.Subscript(value=inner, slice=key) if not (isinstance(key, ast.Constant) and _identifier(key.value)):
            pass
        case ast.BinOp(left=left, right=right):
            inner = right if isinstance(left, ast.Constant) else left
        case ast.BoolOp(values=[inner, *_]) | ast.GeneratorExp(elt=inner) | ast.ListComp(elt=inner):
            pass
        case _:
            return None
    return inner


def _identifier(value: object) -> bool:
    return isinstance(value, str) and value.isidentifier()


def _last_name(node: ast.expr) -> str:
    if isinstance(node, ast.Name):
        return node.id.strip("_") or "value"
    return node.attr.strip("_") if isinstance(node, ast.Attribute) else ""


def _lines(texts: Iterable[str], *, sure: bool) -> Iterator[str]:
    """The msgids of these texts: their lines, without the blanks around them."""
    for text in texts:
        for line in text.split("\n"):
            msgid = re.sub(r"^\d+\. ", "", line.strip())  # the number of a list stays before any translation
            bare = re.sub(r"(?<!\{)\{[a-z_A-Z0-9]*\}|`[^`]*`", "", msgid)
            if not _LETTERS.search(bare) or _FOREIGN.search(msgid):
                continue
            if sure or _HEADING.search(msgid) or (_TWO_WORDS.search(msgid) and re.search(r"[a-z]{2}", bare)):
                yield msgid


def read(path: Path) -> dict[str, str]:
    """Msgid to translation, of what is gone as well; a fuzzy one does not count."""
    if not path.exists():
        return {}
    with path.open("rb") as file:
        catalogue = read_po(file)
    entries: list[Message] = [*catalogue, *catalogue.obsolete.values()]
    return {str(item.id): str(item.string) for item in entries if item.id and item.string and not item.fuzzy}


def conflicts(translations: Mapping[str, str]) -> list[str]:
    """Return the msgids that differ from an earlier one in the names of their values and in the translation alone."""
    by_text: dict[str, str] = {}
    result = []
    for msgid, translation in translations.items():
        text, numbered_translation = number_values(msgid, translation)
        if by_text.setdefault(text, numbered_translation) != numbered_translation:
            result.append(msgid)
    return result


def write(path: Path, found: Mapping[str, list[str]], translations: Mapping[str, str]) -> None:
    """Write the catalogue in the order of the source, and behind it what is gone."""
    catalogue = Catalog(
        locale="pt_PT",
        project="atlantis-netcfg",
        version="1",
        copyright_holder="the authors of atlantis-netcfg",
        msgid_bugs_address="the issues of this repository",
        last_translator="no native speaker has read it yet",
        language_team="European Portuguese",
        header_comment="# European Portuguese. No native speaker has read it yet; terms: docs/pt/glossario.md.",
        fuzzy=False,
        creation_date=datetime(2025, 1, 1, tzinfo=UTC),
        revision_date=datetime(2025, 1, 1, tzinfo=UTC),
    )
    for msgid, files in found.items():
        flags = {"python-brace-format"} if "{" in msgid or "}" in msgid else set()
        catalogue.add(msgid, translations.get(msgid, ""), [(name, 0) for name in files], flags)
    for msgid, translation in sorted(translations.items()):
        if msgid not in found:
            catalogue.obsolete[msgid] = Message(msgid, translation)
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file:
        write_po(file, catalogue, width=0, include_lineno=False)


def main() -> int:
    """Bring the catalogue up to date, or say what it lacks."""
    found, translations = messages(), read(PORTUGUESE)
    if refused := conflicts({msgid: translations[msgid] for msgid in found if msgid in translations}):
        print("\n".join([*refused, "these have the text of another entry, and another translation: choose one"]))
        return 1
    missing = [msgid for msgid in found if msgid not in translations]
    if "--missing" in sys.argv[1:]:
        print("\n".join(missing))
        return 1 if missing else 0
    write(PORTUGUESE, found, translations)
    print(f"{len(found)} messages, {len(missing)} without a translation: {PORTUGUESE.relative_to(ROOT)}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
