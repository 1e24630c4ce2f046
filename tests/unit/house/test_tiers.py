"""Every test is in exactly one tier, every tier is run by a target of the Makefile, and the shards miss nothing."""

import itertools
import re
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

pytest_plugins = ["pytester"]

ROOT = Path(__file__).parents[3]
CONFTEST = ROOT / "tests" / "conftest.py"
TEST_CPU_S = 500
"""What `make test` may cost: ten minutes on two cores of half the speed, a sixth left for collection and load."""
SUITE = """
import pytest
def test_quick(): pass
@pytest.mark.slow
def test_slow(): pass
@pytest.mark.slow
@pytest.mark.smoke
def test_smoke(): pass
@pytest.mark.slow
@pytest.mark.smoke("one", "two")
@pytest.mark.parametrize("case", ["one", "two", "three"])
def test_cases(case): pass
@pytest.mark.smoke("one")
@pytest.mark.parametrize("case", ["one", "two"])
def test_many(case): pass
@pytest.mark.slow
@pytest.mark.campaign
def test_campaign(): pass
@pytest.mark.slow
@pytest.mark.parametrize("card", [pytest.param(1, marks=pytest.mark.arm64)])
def test_arm64(card): pass
"""


@pytest.fixture
def rules(pytestconfig: pytest.Config) -> Any:  # noqa: ANN401 - a conftest is no module that can be imported
    (found,) = [
        plugin
        for plugin in pytestconfig.pluginmanager.get_plugins()
        if isinstance(plugin, ModuleType) and Path(plugin.__file__ or "") == CONFTEST
    ]
    return found


def test_makefile_runs_every_tier_and_ci_all_but_campaign(rules: Any) -> None:  # noqa: ANN401
    makefile = (ROOT / "Makefile").read_text()
    assert set(re.findall(r"--tier (\w+)", makefile)) == set(rules.Tier)
    assert re.findall(r"^ *make (test.*?) ", (ROOT / ".ci" / "run").read_text(), re.MULTILINE) == ["test", "test-full"]


@pytest.mark.parametrize("shards", [1, 2, 3, 7])
def test_shards_cover_each_file_once_at_similar_cost(rules: Any, shards: int) -> None:  # noqa: ANN401
    costs = {f"test_{number}.py": float(number % 11) for number in range(60)}
    shares = rules.share_out(costs, shards)
    assert sorted(path for share in shares for path in share) == sorted(costs)
    sums = [sum(costs[path] for path in share) for share in shares]
    assert max(sums) - min(sums) <= max(costs.values())


def test_each_test_runs_in_one_tier_and_one_shard(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("PYTEST_ADDOPTS", "PYTEST_XDIST_WORKER", "PYTEST_XDIST_WORKER_COUNT"):
        monkeypatch.delenv(name, raising=False)
    pytester.makeconftest(CONFTEST.read_text())
    pytester.makepyfile(**{f"test_{number}": SUITE for number in range(5)})

    def run(*options: str) -> list[str]:
        result = pytester.runpytest_inprocess("-p", "no:cacheprovider", "-v", *options)
        return re.findall(r"^(\S+::\S+) PASSED", result.stdout.str(), re.MULTILINE)

    tiers = {tier: run("--tier", tier) for tier in ("test", "rest", "campaign", "arm64")}
    names = {tier: {name.partition("::")[2] for name in tests} for tier, tests in tiers.items()}
    assert names == {
        "test": {"test_quick", "test_smoke", "test_cases[one]", "test_cases[two]", "test_many[one]"},
        "rest": {"test_slow", "test_cases[three]", "test_many[two]"},
        "campaign": {"test_campaign"},
        "arm64": {"test_arm64[1]"},
    }
    assert sorted(itertools.chain(*tiers.values())) == sorted(run())
    shards = [run("--tier", "rest", "--shard", f"{number}/3") for number in (1, 2, 3)]
    assert all(shards)
    assert sorted(itertools.chain(*shards)) == sorted(tiers["rest"])
    for wrong in ("4/3", "0/3", "2"):
        result = pytester.runpytest_inprocess("-p", "no:cacheprovider", "--tier", "rest", "--shard", wrong)
        assert result.ret == pytest.ExitCode.USAGE_ERROR
        assert f"`{wrong}` is no shard; write K/N, with K from 1 to N" in result.stderr.str()


def test_cost_table_names_existing_files_within_the_budget(rules: Any) -> None:  # noqa: ANN401
    costs = rules.file_costs()
    assert [path for path in costs if not (ROOT / path).is_file()] == []
    assert sum(tiers[rules.Tier.TEST] for tiers in costs.values()) <= TEST_CPU_S


def test_the_page_about_testing_names_files_that_are_there() -> None:
    page = (ROOT / "docs" / "engineers" / "testing.md").read_text()
    rows = page.partition("## What proves each guarantee")[2]
    named = re.findall(r"`(tests/[\w/]+\.py)`", rows)
    assert len(named) > 20
    assert [path for path in named if not (ROOT / path).is_file()] == []
