"""The files are dealt to the workers with nothing lost, and the short tests stand where others steal."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from collections.abc import Callable

FILES = {"long": 7, "short": 60, "slow": 5, "short too": 40, "slow too": 9, "long too": 3}
"""How many tests each has; its name begins with how long they are."""
MARKS = {
    "long": {"slow": pytest.mark.slow.mark, "timeout": pytest.mark.timeout(300).mark},
    "slow": {"slow": pytest.mark.slow.mark, "timeout": pytest.mark.timeout(120).mark},
    "short": {},
}


def ordered(pytestconfig: pytest.Config, workers: int) -> list[Any]:
    """Tests in the order in which so many workers have them."""
    (rules,) = [
        plugin
        for plugin in pytestconfig.pluginmanager.get_plugins()
        if Path(getattr(plugin, "__file__", None) or "") == Path(__file__).parents[2] / "conftest.py"
    ]
    deal: Callable[[Any, list[Any]], None] = rules.pytest_collection_modifyitems
    tests: list[Any] = [
        SimpleNamespace(path=name, number=number, get_closest_marker=MARKS[name.split()[0]].get)
        for name, count in FILES.items()
        for number in range(count)
    ]
    deal(SimpleNamespace(workerinput={"workercount": workers}), tests)
    return tests


@pytest.mark.parametrize("workers", [1, 2, 3, 4, 8])
def test_nothing_is_lost_and_a_file_stays_together(workers: int, pytestconfig: pytest.Config) -> None:
    tests = ordered(pytestconfig, workers)
    assert {(test.path, test.number) for test in tests} == {
        (name, number) for name, count in FILES.items() for number in range(count)
    }
    assert len(tests) == sum(FILES.values())
    for name in ("long", "slow", "long too", "slow too"):
        places = [place for place, test in enumerate(tests) if test.path == name]
        assert places == [*range(places[0], places[0] + FILES[name])]


def test_each_worker_begins_with_long_or_slow_tests(pytestconfig: pytest.Config) -> None:
    tests = ordered(pytestconfig, 2)
    half = len(tests) // 2
    assert [test.path for test in (tests[0], tests[half])] == ["long", "slow too"]
    assert {test.path.split()[0] for test in (tests[half - 1], tests[-1])} == {"short"}
