"""Whole sites under random faults: a few seeds in CI, a range of them with `make campaign`.

`make campaign ARGS='tests/campaign --fault-seeds 0:300'` plays these seeds; what was seen is added to
`campaign.jsonl` in the folder that `--fault-records` names (otherwise in pytest's own), a line a round.
"""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest

from campaign import __main__
from campaign.faults import draw
from campaign.rounds import Player
from campaign.site import VERSIONS

CHECKOUT = Path(__file__).resolve().parents[2]
SAMPLE: tuple[tuple[int, ...], ...] = ((8, 53, 65), (57, 17), (97, 2))
"""Seeds of CI, those in a row one after another."""
PIECE = 5
"""So many seeds of a range are one test, which a worker of xdist plays one after another."""

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(os.geteuid() != 0, reason="making a network namespace needs root"),
    pytest.mark.skipif(
        not (CHECKOUT / ".venv-strangers/stamp").exists(), reason="no .venv-strangers here: `tools/strangers` makes it"
    ),
]


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "fault_seeds" in metafunc.fixturenames:
        seeds = chosen(metafunc.config.getoption("--fault-seeds"))
        pieces = [tuple(seeds[at : at + PIECE]) for at in range(0, len(seeds), PIECE)]
        metafunc.parametrize("fault_seeds", pieces, ids=lambda piece: f"{piece[0]}-{piece[-1]}")


def chosen(text: str) -> list[int]:
    """`0:300` or `3,17,20`."""
    first, colon, end = text.partition(":")
    return list(range(int(first or 0), int(end))) if colon else [int(each) for each in text.split(",")]


def play(seeds: tuple[int, ...], folder: Path, references: Path) -> list[dict[str, Any]]:
    """Play rounds in a network and with mounts of their own."""
    environment = {name: value for name, value in os.environ.items() if name != "ATLANTIS_STATE"}
    done = subprocess.run(
        [
            *("unshare", "--net", "--mount", "--propagation", "private"),
            *(sys.executable, "-P", "-m", "campaign", "--folder", str(folder), "--references", str(references)),
            *map(str, seeds),
        ],
        env={**environment, "PYTHONPATH": os.pathsep.join(map(str, _paths()))},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


def _paths() -> Iterator[Path]:
    yield CHECKOUT / "tests"
    yield CHECKOUT / "tests/integration/cli/provision"
    yield CHECKOUT / "tests/integration/routeros/upgrade"


def report(records: list[dict[str, Any]], folder: Path) -> list[str]:
    return [
        f"seed {record['seed']}: {violation}\n"
        f"    again: make campaign ARGS='tests/campaign --fault-seeds {record['seed']}:{record['seed'] + 1}'\n"
        f"    seen:  {folder / ('seed-' + str(record['seed'])) / 'log.txt'}"
        for record in records
        for violation in record["violations"]
    ]


@pytest.fixture
def references(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Configured devices, which all workers share."""
    base = tmp_path_factory.getbasetemp()
    return (base.parent if os.environ.get("PYTEST_XDIST_WORKER") else base) / "campaign-references"


@pytest.fixture
def fault_records(request: pytest.FixtureRequest, references: Path) -> Path:
    named: Path | None = request.config.getoption("--fault-records")
    return named or references.with_name("campaign.jsonl")


def test_the_sample_has_every_version_and_every_command() -> None:
    rounds = [draw(seed) for seeds in SAMPLE for seed in seeds]
    assert {each.version for each in rounds} == set(VERSIONS)
    assert {each.command for each in rounds} >= {"apply", "apply FILE", "restore", "use", "upgrade", "rollback"}


def test_exception_in_driver_fails_only_its_seed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_player: Player, seed: int) -> dict[str, Any]:
        raise RuntimeError(f"the relay of seed {seed} is gone")

    monkeypatch.setattr(Player, "play", fail)
    monkeypatch.setattr(__main__, "Stage", lambda _folder: nullcontext())
    monkeypatch.setattr(__main__, "Stranger", lambda _folder: nullcontext())
    monkeypatch.setattr(sys, "argv", ["campaign", "--folder", str(tmp_path), "--references", str(tmp_path), "7", "8"])
    assert __main__.main() == 0
    records = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [violation.splitlines()[-1] for record in records for violation in record["violations"]] == [
        "RuntimeError: the relay of seed 7 is gone",
        "RuntimeError: the relay of seed 8 is gone",
    ]
    assert [line.partition(":")[0] for line in report(records, tmp_path) if line.startswith("seed")] == [
        "seed 7",
        "seed 8",
    ]


@pytest.mark.parametrize("seeds", SAMPLE, ids=str)
def test_fault_sample_has_no_violations(tmp_path: Path, references: Path, seeds: tuple[int, ...]) -> None:
    records = play(seeds, tmp_path / "rounds", references)
    assert [record["seed"] for record in records] == list(seeds)
    assert not (violations := report(records, tmp_path / "rounds")), "\n".join(violations)
    assert all(record["struck"] for record in records), "a seed of the sample in which nothing strikes"


@pytest.mark.campaign
def test_fault_range_has_no_violations(
    tmp_path: Path, references: Path, fault_seeds: tuple[int, ...], fault_records: Path
) -> None:
    records = play(fault_seeds, tmp_path / "rounds", references)
    with fault_records.open("a", encoding="utf-8") as file:
        file.writelines(json.dumps(record) + "\n" for record in records)
    assert not (violations := report(records, tmp_path / "rounds")), "\n".join(violations)
