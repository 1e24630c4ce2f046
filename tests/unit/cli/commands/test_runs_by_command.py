"""`provision report runs` has one row for each command that a person typed."""

import json
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest

from atlantis_netcfg.cli import main
from atlantis_netcfg.core import errors, language
from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.runs import Outcome, RunEnd, RunResume, RunStart, Store

COMMAND = "provision site=coastal --yes"
START = RunStart(site="coastal", revision="", tool="", hosts=("router",), rehearsed=False, command=COMMAND)


@pytest.fixture(autouse=True)
def _lisbon_in_summer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path))
    monkeypatch.setenv("LC_ALL", "C.UTF-8")
    monkeypatch.setenv("TZ", "Europe/Lisbon")
    time.tzset()
    yield
    monkeypatch.undo()
    time.tzset()


def store_of(tmp_path: Path) -> Store:
    return Store(tmp_path, now=lambda: datetime(2026, 7, 1, 23, 30, tzinfo=UTC))


def run(store: Store, start: RunStart = START, *, status: str = "unchanged", code: int | None = 0) -> str:
    """Record a run of each host of `start`; without a code its process was killed."""
    with store.start(start) as journal:
        if code is not None:
            for host in start.hosts:
                journal.write(Outcome(device=host, status=status, exit=code, message=""))
            journal.write(RunEnd(exit=code))
    return journal.run


def type_command(monkeypatch: pytest.MonkeyPatch, act: Callable[[object], ExitCode]) -> int:
    """Type `provision site=coastal`, with `act` in place of what it does."""
    with monkeypatch.context() as patch:
        patch.setattr("atlantis_netcfg.cli.runs.run_site", act)
        return main(["site=coastal"])


def rows(capsys: pytest.CaptureFixture[str], *words: str) -> list[str]:
    """Return the rows of commands, without the lines of their runs."""
    capsys.readouterr()
    assert main(["report", "runs", *words]) == 0
    return [line for line in capsys.readouterr().out.splitlines() if not line.startswith("    ")]


def test_command_with_several_runs_has_one_row(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    store = store_of(tmp_path)

    def provision(_: object) -> ExitCode:
        run(store, replace(START, hosts=("router", "cpe")), status="changed")
        run(store, replace(START, site="scc"))
        run(store)
        return ExitCode.DONE

    for _ in range(2):
        assert type_command(monkeypatch, provision) == 0
    assert rows(capsys) == [f"2026-07-02 00:30  exit code 0  {COMMAND}"] * 2
    assert rows(capsys, "site=scc") == [f"2026-07-02 00:30  exit code 0  {COMMAND}"] * 2
    assert main(["report", "runs", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)["runs"]
    assert len(listed) == 6
    assert len({*map(str, (each["invocations"] for each in listed))}) == 2
    assert [*listed[0]["invocations"].values()] == [COMMAND]


def test_row_shows_the_runs_that_changed_something_and_counts_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    store = store_of(tmp_path)

    def provision(_: object) -> ExitCode:
        run(store)
        run(store, replace(START, hosts=tuple(f"coastal-router-{number}" for number in range(5))), status="changed")
        return ExitCode.DONE

    type_command(monkeypatch, provision)
    capsys.readouterr()
    main(["report", "runs"])
    assert capsys.readouterr().out.splitlines() == [
        f"2026-07-02 00:30  exit code 0  {COMMAND}",
        "    20260701T233000Z-02  coastal  coastal-router-0 changed (0), coastal-router-1",
        "      changed (0), coastal-router-2 changed (0), coastal-router-3 changed (0),",
        "      coastal-router-4 changed (0)",
        "    further runs without changes: 1",
    ]
    main(["report", "runs", "--lang", "pt"])
    text = capsys.readouterr().out
    assert f"2026-07-02 00:30  código de saída 0  {COMMAND}" in text
    assert "coastal-router-4 alterado (0)\n    outras execuções sem alterações: 1\n" in text


@pytest.mark.parametrize(
    ("codes", "command_code", "verdict"),
    [
        ((0, 4, 0), ExitCode.DONE, "exit code 4"),
        ((0, 4, 5), ExitCode.FAILED, "exit code 5"),
        ((0, 0), ExitCode.CHECKS_FAILED, "exit code 6"),
        ((0,), ExitCode.NOTHING, "exit code 7"),
        ((0, 2), ExitCode.DONE, "exit code 2"),
        ((0, 99), ExitCode.FAILED, "exit code 99"),
    ],
)
def test_row_shows_the_worst_outcome(  # noqa: PLR0913, PLR0917 - three of them are pytest's
    codes: tuple[int, ...],
    command_code: ExitCode,
    verdict: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def provision(_: object) -> ExitCode:
        for code in codes:
            run(store_of(tmp_path), code=code)
        return command_code

    type_command(monkeypatch, provision)
    assert rows(capsys) == [f"2026-07-02 00:30  {verdict}  {COMMAND}"]


def test_command_that_fails_after_a_good_run_is_not_shown_as_good(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(_: object) -> ExitCode:
        run(store_of(tmp_path))
        raise errors.DeviceError("refused")

    assert type_command(monkeypatch, fail) == ExitCode.FAILED
    assert rows(capsys) == [f"2026-07-02 00:30  exit code 4  {COMMAND}"]


def test_command_killed_between_two_runs_has_no_result(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def provision(_: object) -> ExitCode:
        run(store_of(tmp_path))
        os._exit(9)

    if (child := os.fork()) == 0:
        type_command(monkeypatch, provision)
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 9
    assert rows(capsys) == [f"2026-07-02 00:30  no result recorded  {COMMAND}"]


def test_unfinished_run_marks_the_row_of_its_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    store = store_of(tmp_path)

    def provision(_: object) -> ExitCode:
        run(store, replace(START, hosts=("cpe",)))
        run(store, code=None)
        return ExitCode.UNKNOWN

    type_command(monkeypatch, provision)
    assert rows(capsys) == [f"2026-07-02 00:30  UNFINISHED  {COMMAND}"]
    assert rows(capsys, "--lang", "pt") == [f"2026-07-02 00:30  INACABADA  {COMMAND}"]
    main(["report", "runs"])
    resume = "provision recover resume site=coastal run=20260701T233000Z-02"
    assert f"    continue: `{resume}`" in capsys.readouterr().out.splitlines()


def test_resumed_run_is_in_the_rows_of_both_commands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    store = store_of(tmp_path)
    resumption = RunResume(revision="", tool="", command="provision recover resume site=coastal")

    def provision(_: object) -> ExitCode:
        run(store, code=None)
        return ExitCode.UNKNOWN

    def resume(_: object) -> ExitCode:
        with store.resume("coastal", "20260701T233000Z", resumption) as journal:
            journal.write(Outcome(device="router", status="changed", exit=0, message=""))
            journal.write(RunEnd(exit=0))
        return ExitCode.DONE

    type_command(monkeypatch, provision)
    type_command(monkeypatch, resume)
    assert rows(capsys) == [
        f"2026-07-02 00:30  exit code 5  {COMMAND}",
        f"2026-07-02 00:30  exit code 0  {resumption.command}",
    ]


def test_journals_without_an_invocation_have_a_row_each(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    store = store_of(tmp_path)
    for name in (run(store), run(store, code=4), run(store, replace(START, site="scc"), code=6)):
        for journal in tmp_path.glob(f"real/*/runs/{name}/journal.jsonl"):
            # as written before there were invocations, and checksums
            lines = [json.loads(line) for line in journal.read_text().splitlines()]
            journal.write_text(
                "".join(
                    json.dumps({key: value for key, value in line.items() if key not in {"sum", "invocation"}}) + "\n"
                    for line in lines
                )
            )
    assert sorted(rows(capsys)) == [
        f"2026-07-02 00:30  exit code 0  {COMMAND}",
        f"2026-07-02 00:30  exit code 4  {COMMAND}",
        f"2026-07-02 00:30  exit code 6  {COMMAND}",
    ]
    assert not (tmp_path / "real" / "commands").exists()


@pytest.mark.parametrize("archived_count", [1001, 12345678])
def test_hint_of_archived_runs_fits_80_columns_in_portuguese(
    archived_count: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run(store_of(tmp_path))
    monkeypatch.setattr(language, "_current_language", language.current())  # restored after the test
    monkeypatch.setattr(Store, "archived_runs", lambda *_: range(archived_count))
    assert main(["report", "runs", "--lang", "pt"]) == 0
    lines = capsys.readouterr().out.splitlines()
    hint = f"{archived_count} execuções antigas no arquivo: `provision report runs --all` também as lista"
    assert " ".join(" ".join(lines[2:]).split()) == hint
    assert [line for line in lines if len(line) > 80] == []
