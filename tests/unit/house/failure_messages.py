"""Every message of the source with which a command or a device ends with exit code 4, 5 or 6, by its syntax tree.

A message is what an exception of such a code is made with, what a result of such a status says, and what is printed
with such a code. `…` stands for what is filled in. Where a message only passes on a reason, what makes the reason is
read as well (REASONS, REASON_CALLS). Findings of a checklist are not among them: each has a hint of its own.
"""

import ast
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[3] / "atlantis_netcfg"
CODES = frozenset({"FAILED", "UNKNOWN", "CHECKS_FAILED"})
STATUSES = frozenset({"REFUSED", "ROLLED_BACK", "LEFT_AS_FOUND", "UNKNOWN", "DRIFTED"})
REASON_CALLS = {
    "Objection": "routeros/first_contact/",
    "_fail": "routeros/api/",
    "problems.append": "routeros/planner/",
    "os_errors_as": "vpn/",
}
"""Calls whose first text is passed on by a message, each with where it stands."""
REASONS = {
    "routeros/guard/_access.py": "*",
    "routeros/guard/_firewall.py": "_harm_text",
    "routeros/guard/_link.py": "*",
    "routeros/guard/_route.py": "*",
    "routeros/planner/__init__.py": "_find_unsupported _version_problem",
    "routeros/commands.py": "objections",
    "routeros/apply/_change.py": "_missing_policies _missing_certificates _forbidden_features",
    "routeros/apply/_executor.py": "_summary _describe_no_protection",
    "routeros/apply/_work.py": "find_missing_consent",
    "vpn/authority/ledger_session.py": "beyond_record",
    "vpn/authority/check.py": "_check_unsigned_lines _check_unfinished _check_times _check_server _check_certificates"
    " _disagreements",
    "vpn/ledger/file.py": "read",
}
"""Functions whose texts are passed on by a message: what they return, yield, or name `damage` or `text`."""
_NAMED = ("damage", "text")
LEAST = 7
"""Letters of fixed text that a message needs, so that it can be looked for."""
_ANY = "…"
_BLOCKS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
_MOST_VARIANTS = 12


@dataclass(frozen=True, order=True)
class Message:
    """Where it stands, what makes it, and its words."""

    file: str
    made_by: str
    text: str

    @property
    def fixed(self) -> str:
        """Its letters without what is filled in."""
        return re.sub(r"[^a-zA-Z]", "", self.text)


class _Unmark(ast.NodeTransformer):
    """Replaces `msg(…)` and `arg(…)` by what stands inside, and `join(separator, parts)` by `separator.join(parts)`."""

    def visit_Call(self, node: ast.Call) -> ast.AST:
        self.generic_visit(node)
        match node:
            case ast.Call(func=ast.Name(id="msg" | "arg"), args=[text]):
                return text
            case ast.Call(func=ast.Name(id="join"), args=[separator, parts]):
                join = ast.Attribute(separator, "join", ast.Load())
                return ast.copy_location(ast.Call(ast.copy_location(join, node), [parts], []), node)
        return node


def parse_unmarked(source: str) -> ast.Module:
    """Return the syntax tree of a source as if its messages were plain f-strings."""
    tree = _Unmark().visit(ast.parse(source))
    assert isinstance(tree, ast.Module)
    return tree


def messages() -> set[Message]:
    """All messages of the package."""
    trees = {path: parse_unmarked(path.read_text(encoding="utf-8")) for path in sorted(PACKAGE.rglob("*.py"))}
    failures = failing(list(trees.values()))
    found: set[Message] = set()
    for path, tree in trees.items():
        name = str(path.relative_to(PACKAGE))
        found |= {Message(name, made_by, text) for made_by, text in read(tree, failures)}
        reasons = {Message(name, made_by, text) for made_by, text in passed_on(tree, name)}
        found |= {reason for reason in reasons if len(reason.fixed) >= LEAST}
    return found


def failing(trees: Sequence[ast.Module]) -> frozenset[str]:
    """Names of the exception classes that end with one of these codes, by themselves or by what they come from."""
    classes = [node for tree in trees for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]
    found: set[str] = set()
    for _ in range(len(classes)):
        more = {node.name for node in classes if _exit(node) in CODES or (_exit(node) is None and _bases(node) & found)}
        if more <= found:
            break
        found |= more
    return frozenset(found)


def _exit(node: ast.ClassDef) -> str | None:
    """What the class itself says: `exit = ExitCode.FAILED`; None where it says nothing."""
    for statement in node.body:
        targets = statement.targets if isinstance(statement, ast.Assign) else [getattr(statement, "target", None)]
        if any(isinstance(target, ast.Name) and target.id == "exit" for target in targets):
            value = getattr(statement, "value", None)
            return value.attr if isinstance(value, ast.Attribute) else None
    return None


def _bases(node: ast.ClassDef) -> set[str]:
    return {ast.unparse(base).rpartition(".")[2] for base in node.bases}


def read(tree: ast.Module, failures: frozenset[str]) -> Iterator[tuple[str, str]]:
    """What makes a message, and its text, for each in one file."""
    for function, class_name in functions(tree):
        for call in (node for node in inside(function) if isinstance(node, ast.Call)):
            name = ast.unparse(call.func).rpartition(".")[2]
            made_by = class_name if class_name in failures and name in {"cls", "__init__"} else name
            message = _first_text(call) if made_by in failures else _of_a_result(call)
            if message is not None:
                yield from ((made_by, " ".join(text.split())) for text in variants(message, function))


def passed_on(tree: ast.Module, file: str) -> Iterator[tuple[str, str]]:
    """The reasons that are made in one file: by its REASON_CALLS, and by its REASONS."""
    calls = tuple(name for name, folder in REASON_CALLS.items() if file.startswith(folder))
    names = REASONS.get(file, "").split()
    if not calls and not names:
        return
    for function, _ in functions(tree):
        name = getattr(function, "name", "")
        for node in inside(function):
            value: ast.expr | None = None
            if isinstance(node, ast.Call) and calls and ast.unparse(node.func).endswith(calls):
                value = _first_text(node)
            elif name and (name in names or "*" in names):
                value = _given_back(node) or (_reason(node) if name in names else None)
            if value is not None and isinstance(value, ast.Constant | ast.JoinedStr | ast.BinOp | ast.IfExp):
                yield from ((name, " ".join(text.split())) for text in variants(value, function))


def _given_back(node: ast.AST) -> ast.expr | None:
    """What is returned or yielded."""
    if not isinstance(node, ast.Yield | ast.Return):
        return None
    return node.value.elts[0] if isinstance(node.value, ast.Tuple) else node.value


def _reason(node: ast.AST) -> ast.expr | None:
    """What is assigned to one of the names that hold a reason."""
    if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and node.targets[0].id in _NAMED:
        return node.value
    return None


def functions(tree: ast.Module) -> Iterator[tuple[ast.AST, str]]:
    """Each function with the class right around it, and the file outside of them."""
    waiting: list[tuple[ast.AST, str]] = [(tree, "")]
    while waiting:
        node, class_name = waiting.pop()
        if not isinstance(node, ast.ClassDef):
            yield node, class_name
        name = node.name if isinstance(node, ast.ClassDef) else ""
        waiting.extend((child, name) for child in _inner(node))


def _inner(node: ast.AST) -> Iterator[ast.AST]:
    """The functions and classes that stand in a node, not in one another."""
    waiting = list(ast.iter_child_nodes(node))
    while waiting:
        child = waiting.pop()
        if isinstance(child, _BLOCKS):
            yield child
        elif isinstance(child, ast.stmt | ast.ExceptHandler | ast.match_case):
            waiting.extend(ast.iter_child_nodes(child))


def inside(function: ast.AST) -> list[ast.AST]:
    """What stands in a function, without the functions and classes within it."""
    found: list[ast.AST] = []
    waiting = list(ast.iter_child_nodes(function))
    while waiting:
        node = waiting.pop()
        if not isinstance(node, _BLOCKS):
            found.append(node)
            waiting.extend(ast.iter_child_nodes(node))
    return found


def _first_text(call: ast.Call) -> ast.expr | None:
    return call.args[0] if call.args else None


def _of_a_result(call: ast.Call) -> ast.expr | None:
    """The words beside a status or a code that is not green: the first text after it, or `message=`."""
    given = [*call.args, *(keyword.value for keyword in call.keywords)]
    place = next((number for number, value in enumerate(given) if _is_not_green(value)), None)
    if place is None or ast.unparse(call.func).rpartition(".")[2] in {"add", "get"}:
        return None
    named = {keyword.arg: keyword.value for keyword in call.keywords}
    if "message" in named:
        return named["message"]
    pairs = (value.elts[0] for value in given if isinstance(value, ast.List) and value.elts)
    words = [pair.elts[0] for pair in pairs if isinstance(pair, ast.Tuple)]
    return next((text for text in [*words, *given] if text in words or _says(text)), None)


def _says(value: ast.expr) -> bool:
    """Whether it is a text, and not a word for a program."""
    is_text = isinstance(value, ast.Constant) and isinstance(value.value, str) and " " in value.value
    return is_text or isinstance(value, ast.JoinedStr | ast.BinOp)


def _is_not_green(value: ast.expr) -> bool:
    """`Status.REFUSED`, `ExitCode.FAILED`, or a choice with one of them."""
    if isinstance(value, ast.IfExp):
        return _is_not_green(value.body) or _is_not_green(value.orelse)
    if not isinstance(value, ast.Attribute):
        return False
    return value.attr in {"Status": STATUSES, "ExitCode": CODES}.get(
        ast.unparse(value.value).rpartition(".")[2], frozenset()
    )


def variants(value: ast.expr, function: ast.AST, within: frozenset[str] = frozenset()) -> list[str]:
    """Each text that an expression may give, as far as it can be read here; `within`: names that are being read."""
    match value:
        case ast.Constant(value=str(text)):
            return [text]
        case ast.JoinedStr(values=parts):
            return _joined([_part(part, function, within) for part in parts])
        case ast.BinOp(left=left, op=ast.Add(), right=right):
            return _joined([variants(left, function, within), variants(right, function, within)])
        case ast.IfExp(body=body, orelse=orelse):
            return [*variants(body, function, within), *variants(orelse, function, within)]
        case ast.Name(id=name) if name not in within:
            return _assigned(name, function, within | {name}) or [_ANY]
        case _:
            return [_ANY]


def _part(part: ast.expr, function: ast.AST, within: frozenset[str]) -> list[str]:
    """What is filled in is `…`, unless it is a choice of texts, or a name for texts that can be read here."""
    if isinstance(part, ast.Constant):
        return [str(part.value)]
    if isinstance(part, ast.FormattedValue) and isinstance(part.value, ast.IfExp | ast.Name):
        return variants(part.value, function, within)
    return [_ANY]


def _joined(parts: Sequence[list[str]]) -> list[str]:
    found = [""]
    for part in parts:
        found = [before + after for before in found for after in part][:_MOST_VARIANTS]
    return found


def _assigned(name: str, function: ast.AST, within: frozenset[str]) -> list[str]:
    """The texts that a name is given in a function; none where one of them cannot be read."""
    found: list[str] = []
    for node in inside(function):
        if isinstance(node, ast.Assign) and any(isinstance(to, ast.Name) and to.id == name for to in node.targets):
            if not isinstance(node.value, ast.Constant | ast.JoinedStr | ast.BinOp | ast.IfExp):
                return []
            found += variants(node.value, function, within)
    return found
