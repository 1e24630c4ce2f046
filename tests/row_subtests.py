"""Run one test over all rows of a table: each row that fails is reported by name, and one that holds costs nothing."""

import functools
import inspect
import itertools
from collections.abc import Callable, Iterable
from typing import Any

import pytest

Test = Callable[..., None]
Labels = Iterable[object] | Callable[[Any], object] | None


def for_each_row(names: str | tuple[str, ...], rows: Iterable[Any], ids: Labels = None) -> Callable[[Test], Test]:
    """Do what `pytest.mark.parametrize` does, with one test for all rows, which share its fixtures."""
    arguments = names.replace(",", " ").split() if isinstance(names, str) else list(names)
    table = [tuple(row) if len(arguments) > 1 else (row,) for row in rows]
    if ids is None or callable(ids):
        labels = ["-".join(str(ids(value) if ids else value) for value in row) for row in table]
    else:
        labels = [str(label) for label in ids]
    axis = [(label, dict(zip(arguments, row, strict=True))) for label, row in zip(labels, table, strict=True)]
    assert axis, "a table without rows"

    def decorate(test: Test) -> Test:
        check = getattr(test, "check", test)
        axes = [*getattr(test, "axes", ()), axis]

        @functools.wraps(check)
        def run(subtests: pytest.Subtests, **fixtures: Any) -> None:  # noqa: ANN401 - fixtures of any kind
            for cell in itertools.product(*axes):
                try:
                    check(**fixtures, **{name: value for _, values in cell for name, value in values.items()})
                except (Exception, pytest.fail.Exception):
                    with subtests.test("-".join(label for label, _ in cell)):
                        raise

        given = {name for rows in axes for name in rows[0][1]}
        remaining = [each for each in inspect.signature(check).parameters.values() if each.name not in given]
        fixture = inspect.Parameter("subtests", inspect.Parameter.POSITIONAL_OR_KEYWORD)
        vars(run).update(check=check, axes=axes, __signature__=inspect.Signature([fixture, *remaining]))
        return run

    return decorate
