"""Queries of the API (Manual, API: Queries): a stack machine over the properties of an item."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.routeros.answers import Trap

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

__all__ = ["matches"]

_OPERATIONS = re.compile(r"[!&|.]|\d+")


def matches(queries: Sequence[str], row: Mapping[str, str], *, orders_texts: bool = True) -> bool:
    """Run the query words (without their `?`) on one item; any false left on the stack rejects it.

    Raises Trap on a word that is none.
    """
    stack: list[bool] = []
    for query in queries:
        if query.startswith("#"):
            _operate(query[1:], stack)
        else:
            stack.append(_test(query, row, orders_texts=orders_texts))
    return all(stack)


def _test(query: str, row: Mapping[str, str], *, orders_texts: bool) -> bool:
    if query.startswith("-"):
        return query[1:] not in row
    if query.startswith(("<", ">")):
        name, _, value = query[1:].partition("=")
        return name in row and _less(row[name], value, greater=query.startswith(">"), orders_texts=orders_texts)
    name, equals, value = query.removeprefix("=").partition("=")
    return row.get(name, "") == value if equals else bool(row.get(name))


def _less(own: str, other: str, *, greater: bool, orders_texts: bool) -> bool:
    """Compare numbers, or texts letter by letter. Assumption: api-query-order."""
    if greater:
        own, other = other, own
    return int(own) < int(other) if own.isdecimal() and other.isdecimal() else orders_texts and own < other


def _operate(text: str, stack: list[bool]) -> None:
    operations = _OPERATIONS.findall(text)
    if not operations or "".join(operations) != text:
        raise Trap("invalid query")
    for operation in operations:
        _apply(operation, stack)


def _apply(operation: str, stack: list[bool]) -> None:
    """Below its bottom the stack holds an endless supply of true values."""
    if operation == "!":
        stack.append(not _pop(stack))
    elif operation == "&":
        right, left = _pop(stack), _pop(stack)
        stack.append(left and right)
    elif operation == "|":
        right, left = _pop(stack), _pop(stack)
        stack.append(left or right)
    elif operation == ".":
        stack.append(stack[-1] if stack else True)
    else:
        index = int(operation)
        stack.append(stack[-1 - index] if index < len(stack) else True)


def _pop(stack: list[bool]) -> bool:
    return stack.pop() if stack else True
