"""Values of messages are marked where a message is made, and nowhere else: `arg` in any other text would be shown."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[3] / "atlantis_netcfg"
TREES = {path.relative_to(PACKAGE).as_posix(): ast.parse(path.read_text("utf-8")) for path in PACKAGE.rglob("*.py")}


def last_name(node: ast.AST) -> str:
    return getattr(node, "attr", getattr(node, "id", ""))


def error_classes(root: str) -> set[str]:
    """The errors whose text and hint become messages: `root` and what hands on `message` and hint unchanged."""
    classes = [node for tree in TREES.values() for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]
    own = {
        node.name
        for node in classes
        for item in node.body
        if isinstance(item, ast.FunctionDef) and item.name == "__init__" and item.args.args[1:2] != []
        if item.args.args[1].arg != "message"
    }
    result = {root}
    while (
        more := {node.name for node in classes if result & set(map(last_name, node.bases)) and node.name not in own}
        - result
    ):
        result |= more
    return result


MODULE_ERRORS = error_classes("ModuleError")
"""Errors on other computers: their second argument is the hint."""
ERRORS = error_classes("NetcfgError") | MODULE_ERRORS
OF_A_CLOSED_LIST = {"kind", "noun", "where"}
"""Names of parts of a sentence: `MADE` of tools/messages.py has every sentence that they make."""


def parents(tree: ast.AST) -> dict[ast.AST, ast.AST]:
    return {child: node for node in ast.walk(tree) for child in ast.iter_child_nodes(node)}


def is_call(node: ast.AST | None, *names: str) -> bool:
    return isinstance(node, ast.Call) and last_name(node.func) in names


def makes_messages(node: ast.AST, above: dict[ast.AST, ast.AST]) -> bool:
    """Whether the text that an expression is part of is given to what makes a message of it."""
    parts = ast.FormattedValue | ast.JoinedStr | ast.IfExp | ast.BinOp | ast.Lambda | ast.keyword
    while isinstance(above[node], parts) or is_call(above[node], "str", "format", "sub"):
        node = above[node]
    name = getattr(node, "arg", "") if isinstance(node, ast.keyword) else ""
    call = above[node]
    if is_call(call, "msg", "translate", "Message"):
        return True
    assert isinstance(call, ast.Call)
    is_error = is_call(call, *ERRORS) or (is_call(call, "__init__") and bool(ERRORS & bases_around(call, above)))
    places = 2 if is_call(call, *MODULE_ERRORS) else 1
    return is_error and (node in call.args[:places] or name == "hint")


def bases_around(node: ast.AST, above: dict[ast.AST, ast.AST]) -> set[str]:
    while not isinstance(node, ast.ClassDef):
        node = above[node]
    return set(map(last_name, node.bases))


def misplaced_values(source: str) -> Iterator[int]:
    """The lines with `arg(` outside of a message."""
    tree = ast.parse(source)
    above = parents(tree)
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "arg":
            try:
                is_right = makes_messages(node, above)
            except AssertionError:
                is_right = False
            if not is_right:
                yield node.lineno


def unmarked_values(source: str) -> Iterator[int]:
    """The lines of `msg(…)`, or of an error of another computer, with a value that is not in `arg(…)`."""
    for call in ast.walk(ast.parse(source)):
        if isinstance(call, ast.Call) and is_call(call, "msg", *MODULE_ERRORS):
            texts = [node for part in call.args for node in choices(part) if isinstance(node, ast.JoinedStr)]
            unmarked = [value for text in texts for value in values(text) if not is_call(value, "arg")]
            yield from (value.lineno for value in unmarked if last_name(value) not in OF_A_CLOSED_LIST)


def choices(node: ast.expr) -> list[ast.expr]:
    return [*choices(node.body), *choices(node.orelse)] if isinstance(node, ast.IfExp) else [node]


def values(node: ast.expr) -> Iterator[ast.expr]:
    """The values of a text; a choice between texts is not one of them."""
    if isinstance(node, ast.JoinedStr):
        for part in node.values:
            yield from values(part.value) if isinstance(part, ast.FormattedValue) else ()
    elif isinstance(node, ast.IfExp):
        yield from (*values(node.body), *values(node.orelse))
    elif not isinstance(node, ast.Constant):
        yield node


@pytest.mark.parametrize("package", sorted({name.partition("/")[0] for name in TREES}))
def test_values_are_marked_in_messages_and_nowhere_else(package: str) -> None:
    sources = {
        name: (PACKAGE / name).read_text("utf-8")
        for name in TREES
        if name.partition("/")[0] == package and name != "core/messages.py"
    }
    assert {name: lines for name, text in sources.items() if (lines := list(misplaced_values(text)))} == {}
    assert {name: lines for name, text in sources.items() if (lines := list(unmarked_values(text)))} == {}


@pytest.mark.parametrize(
    "source",
    [
        'print(f"{arg(name)} is gone")',
        'text = f"{arg(name)} is gone"',
        'UsageError("gone", f"{arg(name)}")',
        'ModuleError("gone", "look there", f"{arg(name)}")',
        'sorted((f"{arg(name)}", "b"))',
    ],
)
def test_a_value_outside_of_a_message_is_refused(source: str) -> None:
    assert list(misplaced_values(source)) == [1]


@pytest.mark.parametrize(
    "source",
    [
        "msg(f\"{arg(name)} is {'gone' if away else f'at {arg(place)}'}\")",
        'raise UsageError(f"{arg(name)} is gone" if away else "here", hint=f"look at {arg(place)}")',
        'print(translate(f"{arg(name)} is gone"))',
        'raise ModuleError(f"{arg(name)} is gone", f"look at {arg(place)}")',
        "msg(TEXT.format(name=arg(name)))",
    ],
)
def test_values_of_a_message_are_accepted(source: str) -> None:
    assert list(misplaced_values(source)) == []
    assert list(unmarked_values(source)) == []


@pytest.mark.parametrize("name", ["msg", "ModuleError"])
def test_a_value_without_mark_is_refused(name: str) -> None:
    assert list(unmarked_values(f"{name}(f'{{arg(name)}} is at {{place}}')")) == [1]
