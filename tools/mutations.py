"""The small faults that `make mutants` tries, and the numbers of a module's statements."""

from __future__ import annotations

import ast
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

PAIRS = ((ast.Eq, ast.NotEq), (ast.Lt, ast.LtE), (ast.Gt, ast.GtE), (ast.Is, ast.IsNot), (ast.In, ast.NotIn))
SWAPS: dict[type[ast.AST], type[ast.AST]] = {
    **dict([*PAIRS, (ast.And, ast.Or), (ast.Add, ast.Sub), (ast.Mult, ast.FloorDiv), (ast.Div, ast.Mult)]),
    **{new: old for old, new in [*PAIRS, (ast.And, ast.Or), (ast.Add, ast.Sub), (ast.Mult, ast.FloorDiv)]},
}
WITHOUT = (ast.stmt, ast.JoinedStr, ast.excepthandler, ast.match_case)
"""Statements of their own, and texts."""


@dataclass
class Mutation:
    """One possible change of a tree; `apply` makes it."""

    statement: int
    kind: str
    line: int
    old: str
    new: str
    apply: Callable[[], object]


def statements(tree: ast.Module) -> list[ast.stmt]:
    """Number all statements of a module."""
    return [node for node in ast.walk(tree) if isinstance(node, ast.stmt)]


def bodies(tree: ast.AST) -> Iterator[list[ast.stmt]]:
    """Find all lists of statements."""
    for node in ast.walk(tree):
        for name in ("body", "orelse", "finalbody"):
            if isinstance(body := getattr(node, name, None), list):
                yield body


def expressions(node: ast.AST) -> Iterator[ast.AST]:
    """Walk what a statement evaluates itself, without type hints and texts."""
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "type_params"):
            continue
        for child in value if isinstance(value, list) else [value]:
            switch = isinstance(child, ast.keyword) and child.arg in ("frozen", "slots", "kw_only")
            if isinstance(child, ast.AST) and not isinstance(child, WITHOUT) and not switch:
                yield child
                yield from expressions(child)


def mutations(tree: ast.Module) -> Iterator[Mutation]:
    """Find all changes of a module, always in the same order."""
    ignored = {
        id(inner)
        for node in ast.walk(tree)
        if (isinstance(node, ast.FunctionDef) and node.name in ("__repr__", "__str__"))
        or (isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING")
        for inner in ast.walk(node)
    }
    places = {id(node): (body, place) for body in bodies(tree) for place, node in enumerate(body)}
    for number, node in enumerate(statements(tree)):
        if id(node) in ignored or isinstance(node, (ast.Import, ast.ImportFrom, ast.Global, ast.Nonlocal)):
            continue
        if isinstance(node, ast.Return) and node.value is not None and ast.unparse(node.value) != "None":
            change = _setter(node, "value", ast.Constant(None))
            yield Mutation(number, "return", node.lineno, ast.unparse(node), "return None", change)
        call = isinstance(node, ast.Expr) and not isinstance(node.value, (ast.Constant, ast.Yield, ast.YieldFrom))
        if call or isinstance(node, (ast.AugAssign, ast.Raise)):
            body, place = places[id(node)]
            drop = _dropper(body, place)
            yield Mutation(number, "drop", node.lineno, ast.unparse(node), "pass", drop)
        for inner in expressions(node):
            if (mutation := _of_expression(number, inner)) is not None:
                yield mutation


def _of_expression(number: int, node: ast.AST) -> Mutation | None:
    old = ast.unparse(node)
    if isinstance(node, ast.Constant) and isinstance(node.value, (bool, int, float)):
        new = not node.value if isinstance(node.value, bool) else node.value + 1
        return Mutation(number, "const", node.lineno, old, repr(new), _setter(node, "value", new))
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        twice = ast.copy_location(ast.UnaryOp(ast.Not(), node.operand), node)
        return Mutation(number, "not", node.lineno, old, old[4:], _setter(node, "operand", twice))
    if isinstance(node, ast.Compare) and (swap := SWAPS.get(type(node.ops[0]))):
        change = _setter(node, "ops", [swap(), *node.ops[1:]])
        return Mutation(number, "compare", node.lineno, old, swap.__name__, change)
    if isinstance(node, (ast.BoolOp, ast.BinOp)) and (swap := SWAPS.get(type(node.op))):
        texts = (ast.JoinedStr, ast.List, ast.Tuple)
        if isinstance(node, ast.BinOp) and (isinstance(node.left, texts) or isinstance(node.right, texts)):
            return None
        kind = "bool" if isinstance(node, ast.BoolOp) else "arith"
        return Mutation(number, kind, node.lineno, old, swap.__name__, _setter(node, "op", swap()))
    return None


def _setter(node: ast.AST, name: str, value: object) -> Callable[[], object]:
    return lambda: setattr(node, name, value)


def _dropper(body: list[ast.stmt], place: int) -> Callable[[], object]:
    return lambda: body.__setitem__(place, ast.copy_location(ast.Pass(), body[place]))
