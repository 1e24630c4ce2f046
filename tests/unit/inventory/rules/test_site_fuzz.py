"""Whatever a person does to the inventory ends in findings at places that exist, in our own words."""

import copy
import random
import shutil
from pathlib import Path
from typing import Any

import pytest
import yaml

from atlantis_netcfg.core.errors import NoMatchError
from atlantis_netcfg.inventory import report, validate
from atlantis_netcfg.inventory._schema import FALLBACK

SHIPPED = Path(__file__).parents[4] / "inventory"
FILES = sorted(path.relative_to(SHIPPED) for path in SHIPPED.rglob("*.yml"))
ODD: tuple[Any, ...] = (
    None, True, False, 0, -1, 7.5, float("inf"), "", " ", "off", "é" * 40, "x" * 300, "10.0.0.1", "10.0.0.0/8",
    "0.0.0.0/0", "255.255.255.255", "{{ x }}", "$ANSIBLE_VAULT;1.1;AES256", [], {}, [None], [[]],
    {"a": {"b": []}}, [1, "a"], "2026-11-21", "02:00:5E:00:00:10", "coastal-router", "scc", "all", "lan", "wifi-ptp",
)  # fmt: skip
SECRETS = ("EXAMPLE-provision", "EXAMPLE-vpn", "EXAMPLE-ptp")
SEEDS = [*range(10), *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(10, 40))]
ROUNDS = 12


def places(data: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:  # noqa: ANN401 - what YAML holds
    found = [path] if path else []
    steps = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for step, below in steps:
        found.extend(places(below, (*path, step)))
    return found


def mutate(data: Any, rng: random.Random) -> None:  # noqa: ANN401 - as above
    path = rng.choice(places(data))
    parent = data
    for step in path[:-1]:
        parent = parent[step]
    step, what = path[-1], rng.randrange(5)
    if what == 0:
        del parent[step]
    elif what == 1 and isinstance(parent, dict):
        cut = rng.randrange(len(str(step)) + 1)
        parent[str(step)[:cut] + rng.choice("abz-_9") + str(step)[cut + rng.randrange(2) :]] = parent.pop(step)
    elif what == 2 and isinstance(parent, list):
        parent.append(copy.deepcopy(parent[step]))
    elif what == 3 and isinstance(parent[step], str) and parent[step]:
        cut = rng.randrange(len(parent[step]))
        parent[step] = parent[step][:cut] + rng.choice("0a./:-é") + parent[step][cut + 1 :]
    else:
        parent[step] = copy.deepcopy(rng.choice(ODD))


def check(inventory: Path) -> int:
    try:
        findings = validate(inventory)
    except NoMatchError:
        return 1
    for finding in findings:
        lines = Path(finding.file).read_text(encoding="utf-8", errors="replace").split("\n")
        assert 1 <= finding.line <= len(lines), finding
        assert 1 <= finding.column <= len(lines[finding.line - 1]) + 1, finding
        assert finding.message, finding
        assert finding.hint, finding
        assert FALLBACK not in finding.message, finding
        assert "None" not in finding.message + finding.hint, finding
    told = report(findings)
    assert [secret for secret in SECRETS if secret in told] == []
    return len(findings)


@pytest.mark.smoke("0", "1", "2")
@pytest.mark.parametrize("seed", SEEDS)
def test_randomly_changed_data_is_handled(seed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = random.Random(seed)  # noqa: S311 - a test
    monkeypatch.chdir(tmp_path)
    found = 0
    for number in range(ROUNDS):
        inventory = Path(f"inventory{number}")
        shutil.copytree(SHIPPED, inventory)
        for _ in range(rng.choice((1, 1, 2, 5))):
            path = inventory / rng.choice(FILES)
            data = yaml.safe_load(path.read_text(encoding="utf-8"))
            mutate(data, rng)
            path.write_text(yaml.safe_dump(data, allow_unicode=True, sort_keys=False), encoding="utf-8")
            if not isinstance(data, dict) or not data:
                break
        found += check(inventory)
    assert found > 0


@pytest.mark.smoke("0", "1", "2")
@pytest.mark.parametrize("seed", SEEDS)
def test_randomly_changed_text_is_handled(seed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = random.Random(1000 + seed)  # noqa: S311 - a test
    monkeypatch.chdir(tmp_path)
    found = 0
    for number in range(ROUNDS):
        inventory = Path(f"inventory{number}")
        shutil.copytree(SHIPPED, inventory)
        path = inventory / rng.choice(FILES)
        text = path.read_text(encoding="utf-8")
        cut = rng.randrange(len(text))
        rest = text[cut + rng.randrange(6) :]
        path.write_text(text[:cut] + rng.choice("\t:{}[]'\"#&*!|>%@`-\n ?é,\x07") + rest, encoding="utf-8")
        found += check(inventory)
    assert found > 0
