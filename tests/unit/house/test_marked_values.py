"""Values of messages are marked where a message is made, and nowhere else: `arg` in any other text would be shown."""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[3] / "atlantis_netcfg"
SOURCES = {path.relative_to(PACKAGE).as_posix(): path for path in PACKAGE.rglob("*.py")}


def last_name(node: ast.AST) -> str:
    return getattr(node, "attr", getattr(node, "id", ""))


def classes(parent: ast.AST) -> Iterator[ast.ClassDef]:
    """The classes among statements: reading no expression takes a tenth of the time of `ast.walk`."""
    for name in ("body", "orelse", "handlers", "finalbody", "cases"):
        statements = getattr(parent, name, None)
        for node in statements if isinstance(statements, list) else ():
            if isinstance(node, ast.ClassDef):
                yield node
            yield from classes(node)


def is_built_otherwise(node: ast.ClassDef) -> bool:
    inits = [item for item in node.body if isinstance(item, ast.FunctionDef) and item.name == "__init__"]
    return any(init.args.args[1].arg != "message" for init in inits if init.args.args[1:2] != [])


@cache
def bases_of_classes() -> list[tuple[str, set[str]]]:
    """Name and bases of each class of the product, but not if a class of that name hands on no message."""
    every_class: list[tuple[str, set[str]]] = []
    own = set()
    for source in SOURCES.values():
        for node in classes(ast.parse(source.read_text("utf-8"))):
            every_class.append((node.name, set(map(last_name, node.bases))))
            own |= {node.name} if is_built_otherwise(node) else set()
    return [(name, bases) for name, bases in every_class if name not in own]


@cache
def error_classes(*roots: str) -> set[str]:
    """The errors whose text and hint become messages: `roots` and what hands on `message` and hint unchanged."""
    result = {*roots}
    while more := {name for name, bases in bases_of_classes() if result & bases} - result:
        result |= more
    return result


MODULE_ERROR = "ModuleError"
"""The root of the errors on other computers: their second argument is the hint."""
OF_A_CLOSED_LIST = {"kind", "noun", "where"}
"""Names of parts of a sentence: `MADE` of tools/messages.py has every sentence that they make."""


def parents(source: str) -> dict[ast.AST, ast.AST]:
    return {child: node for node in ast.walk(ast.parse(source)) for child in ast.iter_child_nodes(node)}


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
    errors = error_classes("NetcfgError", MODULE_ERROR)
    is_error = is_call(call, *errors) or (is_call(call, "__init__") and bool(errors & bases_around(call, above)))
    places = 2 if is_call(call, *error_classes(MODULE_ERROR)) else 1
    return is_error and (node in call.args[:places] or name == "hint")


def bases_around(node: ast.AST, above: dict[ast.AST, ast.AST]) -> set[str]:
    while not isinstance(node, ast.ClassDef):
        node = above[node]
    return set(map(last_name, node.bases))


def misplaced_values(source: str) -> Iterator[int]:
    """The lines with `arg(` outside of a message."""
    if "arg(" not in source:
        return
    above = parents(source)
    for node in above:
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
        if isinstance(call, ast.Call) and is_call(call, "msg", *error_classes(MODULE_ERROR)):
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


@pytest.mark.parametrize("package", sorted({name.partition("/")[0] for name in SOURCES}))
def test_values_are_marked_in_messages_and_nowhere_else(package: str) -> None:
    sources = {
        name: path.read_text("utf-8")
        for name, path in SOURCES.items()
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
