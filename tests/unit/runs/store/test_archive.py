"""Old runs are put aside, so that a thousand of them cost what ten do; nothing that is needed goes, nothing is lost."""

import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from hints_said import advised

from atlantis_netcfg.cli import main
from atlantis_netcfg.runs import KEPT_RUNS, Outcome, Purpose, RunEnd, RunStart, Store

STARTED = RunStart(site="coastal", revision="", tool="", hosts=("router",), rehearsed=False, command="provision")
opened: list[list[str]] = []
"""The files that are opened while somebody counts; what nobody counts is not noted."""


def _note(event: str, arguments: tuple[Any, ...]) -> None:
    if opened and event == "open" and str(arguments[0]).endswith("journal.jsonl"):
        opened[-1].append(str(arguments[0]))


sys.addaudithook(_note)


def counted(act: Callable[[], object]) -> tuple[int, int]:
    opened.append([])
    try:
        act()
    finally:
        found = opened.pop()
    return len(found), sum(path.stat().st_size for path in map(Path, found) if path.exists())


@pytest.fixture
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Store:
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path))
    monkeypatch.setattr("os.fsync", lambda _descriptor: None)  # a thousand runs, and none of them is to survive
    moments = _moments()
    return Store(tmp_path, now=lambda: next(moments))


def _moments() -> Iterator[datetime]:
    moment = datetime(2026, 1, 1, tzinfo=UTC)
    while True:
        moment += timedelta(seconds=1)
        yield moment


def ran(store: Store, status: str = "changed", device: str = "router", *, confirmed: bool = True) -> str:
    with store.start(replace(STARTED, hosts=(device,))) as journal:
        journal.save(device, "# before\n")
        if confirmed:
            journal.confirm(device, lambda: f"# {journal.run}\n")
        journal.write(Outcome(device=device, status=status, exit=0, message=""))
        journal.write(RunEnd(exit=0))
    return journal.run


@pytest.mark.slow
def test_thousand_runs_cost_as_much_as_ten(store: Store, capsys: pytest.CaptureFixture[str]) -> None:
    def costs() -> dict[str, tuple[int, int]]:
        return {
            "runs": counted(lambda: main(["report", "runs", "site=coastal", "--json"])),
            "unfinished": counted(lambda: store.unfinished_runs("coastal")),
            "history": counted(lambda: store.history("coastal", "router").has_unfinished_run()),
            "confirmed": counted(lambda: store.last_confirmed("coastal", ("router",))),
        }

    for _ in range(10):
        ran(store)
    few = costs()
    assert few["runs"][0] == 10
    for _ in range(990):
        ran(store)
    assert costs() == few
    assert few["confirmed"][0] == 1
    begun = counted(lambda: ran(store))[0]
    assert begun <= 4  # its own journal, the one that is put aside, and the latest ones that stand for it
    capsys.readouterr()
    assert main(["report", "runs", "site=coastal"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len([line for line in lines if line.endswith("provision")]) == KEPT_RUNS
    assert len([line for line in lines if "router changed (0, state kept)" in line]) == KEPT_RUNS
    assert len(lines) == 2 * KEPT_RUNS + 1
    assert lines[-1] == f"{1001 - KEPT_RUNS} older runs are archived: `provision report runs --all` lists them too"
    (command,) = advised(lines[-1])
    assert main([*command, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (len(told["runs"]), told["archived"]) == (1001, 1001 - KEPT_RUNS)
    assert [row["run"] for row in told["runs"]] == sorted(row["run"] for row in told["runs"])


def test_archived_run_is_still_available_by_name(store: Store) -> None:
    first = ran(store)
    for _ in range(KEPT_RUNS):
        ran(store)
    assert first not in [run.id for run in store.runs("coastal")]
    assert store.archived_runs("coastal") == (first,)
    run = store.run("coastal", first)
    saved, state = run.before("router"), run.confirmed_state("router")
    assert saved is not None
    assert state is not None
    assert (saved.text(), state.text()) == ("# before\n", f"# {first}\n")


def test_needed_runs_are_not_archived(store: Store) -> None:
    other = ran(store, device="cpe")
    killed = store.start(replace(STARTED, hosts=("gateway",))).run
    unknown = ran(store, "unknown", confirmed=False)
    refused = ran(store, "refused", confirmed=False)
    for _ in range(KEPT_RUNS):
        ran(store, "left-as-found", confirmed=False)
    assert [run.id for run in store.runs("coastal")][:3] == [other, killed, unknown]
    assert refused in store.archived_runs("coastal")
    assert store.last_confirmed("coastal", ("cpe", "router"))["cpe"].run == other
    assert [run.id for run in store.unfinished_runs("coastal")] == [killed, unknown]
    settled = ran(store)
    for _ in range(KEPT_RUNS):
        ran(store, "left-as-found", confirmed=False)
    assert unknown in store.archived_runs("coastal")
    assert [run.id for run in store.runs("coastal")][:3] == [other, killed, settled]
    assert [run.id for run in store.unfinished_runs("coastal")] == [killed]


def test_run_names_stay_unique_with_archived_runs(tmp_path: Path) -> None:
    store = Store(tmp_path, now=lambda: datetime(2026, 1, 1, tzinfo=UTC))
    names = [ran(store, confirmed=False) for _ in range(2 * KEPT_RUNS + 2)]
    assert len({*names}) == len(names) == len(store.runs("coastal")) + len(store.archived_runs("coastal"))
    assert names == sorted(names)


def test_unwritable_archive_does_not_stop_a_run(store: Store, tmp_path: Path) -> None:
    (tmp_path / "real" / "coastal").mkdir(parents=True)
    (tmp_path / "real" / "coastal" / "archive").write_text("a file")
    names = [ran(store) for _ in range(KEPT_RUNS + 2)]
    assert [run.id for run in store.runs("coastal")] == names


def test_killed_backup_is_archived(store: Store) -> None:
    backup = store.start(replace(STARTED, purpose=Purpose.BACKUP)).run
    for _ in range(KEPT_RUNS):
        ran(store)
    assert store.archived_runs("coastal") == (backup,)
