"""What is written can be read back, whatever happens in between."""

import errno
import json
import os
import shutil
import signal
import stat
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import NoReturn

import pytest

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.messages import Message, arg, msg
from atlantis_netcfg.operations.lte.units import LteResult
from atlantis_netcfg.routeros import Status
from atlantis_netcfg.runs import (
    ActionAcknowledgement,
    ActionConfirmation,
    DamagedStateError,
    DeviceObservation,
    Journal,
    JournalError,
    LayerSent,
    NoSuchRun,
    Outcome,
    PlannedAction,
    PlanRecord,
    ProtectionRecord,
    Purpose,
    Record,
    ReleaseRecord,
    Releasing,
    RollbackRecord,
    RunEnd,
    RunResume,
    RunStart,
    SignRecord,
    StateBackup,
    StateConfirmation,
    StatesOnly,
    Store,
    VerificationRecord,
    conclude,
    mark_unrecorded,
    new_run,
    read,
    run_order,
)

STARTED = RunStart(
    site="coastal", revision="ab" * 32, tool="0.1", hosts=("router", "cpe"), rehearsed=False, command="provision"
)
EVERY: tuple[Record, ...] = (
    STARTED,
    RunResume(revision="cd" * 32, tool="0.2", command="provision recover resume"),
    DeviceObservation(device="router", version="7.18.2", identity="Küste", state="00"),
    StateBackup(device="router", file="before/router.rsc", sha256="11"),
    PlanRecord(
        device="router",
        plan="22",
        actions=(
            PlannedAction(
                number=1, layer="policy", menu="/ip/address", verb="add", subject="a", values=(("address", "10.0.0.1"),)
            ),
        ),
    ),
    ProtectionRecord(device="router", how="safe-mode"),
    SignRecord(device="router", sign="run 1 of provision@10.0.0.2"),
    LayerSent(device="router", layer="foundation", actions=(1,)),
    ActionAcknowledgement(device="router", actions=(1,)),
    VerificationRecord(device="router", state="33"),
    Releasing(device="router"),
    ReleaseRecord(device="router"),
    ActionConfirmation(device="router", actions=(1,)),
    RollbackRecord(device="router", reason="a trap"),
    StateConfirmation(device="router", file="confirmed/router-44.rsc", sha256="44"),
    Outcome(device="router", status="changed", exit=0, message="1 of 1"),
    RunEnd(exit=0),
)


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path, now=lambda: datetime(2026, 5, 4, 3, 2, 1, tzinfo=UTC))


def journal_file(journal: Journal) -> Path:
    return journal.directory / "journal.jsonl"


def test_every_record_round_trips(store: Store) -> None:
    with store.start(STARTED) as journal:
        for record in EVERY[1:]:
            journal.write(record)
    log = read(journal_file(journal))
    assert log.records == EVERY
    assert log.damage == ()
    assert log.entries[0].at == datetime(2026, 5, 4, 3, 2, 1, tzinfo=UTC)


def test_lines_are_plain_json_that_a_person_can_read(store: Store) -> None:
    with store.start(STARTED) as journal:
        journal.write(EVERY[2])
    first, second = journal_file(journal).read_text().splitlines()
    assert json.loads(first)["kind"] == "run-started"
    assert "Küste" in second


def test_journal_layout_and_file_modes(store: Store, tmp_path: Path) -> None:
    with store.start(STARTED) as journal:
        journal.save("router", "# export\n")
    run = tmp_path / "real" / "coastal" / "runs" / "20260504T030201Z"
    assert journal.directory == run
    assert journal.run == "20260504T030201Z"
    assert (run / "before" / "router.rsc").read_text() == "# export\n"
    for path in tmp_path.rglob("*"):
        assert stat.S_IMODE(path.stat().st_mode) == (0o700 if path.is_dir() else 0o600), path


def test_runs_of_one_second_have_ordered_names(store: Store) -> None:
    names = []
    for _ in range(3):
        with store.start(STARTED) as journal:
            names.append(journal.run)
    assert names == sorted(set(names))
    assert [run.id for run in store.runs("coastal")] == names


def test_runs_stay_ordered_when_the_clock_is_set_back(tmp_path: Path) -> None:
    (tmp_path / "a person's notes").mkdir()
    moments = [datetime(2026, 5, 4, 3, 2, second, tzinfo=UTC) for second in (30, 10, 10, 40)]
    names = [new_run(tmp_path, moment).name for moment in moments]
    assert names == ["20260504T030230Z", "20260504T030230Z-02", "20260504T030230Z-03", "20260504T030240Z"]
    assert sorted(names, key=run_order) == names


def test_over_a_hundred_runs_of_one_second_stay_ordered(tmp_path: Path) -> None:
    names = [new_run(tmp_path, datetime(2026, 5, 4, tzinfo=UTC)).name for _ in range(101)]
    assert names[-1].endswith("-101")
    assert sorted(names, key=run_order) == names


def test_run_after_the_clock_was_set_back_is_the_latest(tmp_path: Path) -> None:
    moments = [datetime(2026, 5, 4, tzinfo=UTC), datetime(2025, 1, 1, tzinfo=UTC)]
    made = []
    for moment in moments:
        with Store(tmp_path, now=lambda moment=moment: moment).start(STARTED) as journal:  # type: ignore[misc]
            made.append(journal.run)
    assert [run.id for run in Store(tmp_path).runs("coastal")] == made


def test_a_torn_last_line_is_reported_and_the_rest_is_read(store: Store) -> None:
    with store.start(STARTED) as journal:
        journal.write(EVERY[2])
    data = journal_file(journal).read_bytes()
    whole = data.index(b"\n") + 1
    for length in range(whole + 1, len(data)):
        journal_file(journal).write_bytes(data[:length])
        log = read(journal_file(journal))
        assert log.records == (STARTED,)
        assert (log.damage, log.has_torn_end) == ((), True)


def test_resuming_closes_the_torn_line_and_appends(store: Store) -> None:
    with store.start(STARTED) as journal:
        run = journal.run
    with journal_file(journal).open("ab") as file:
        file.write(b'{"at":"2026')
    with store.resume("coastal", run, RunResume(revision="", tool="", command="c")) as again:
        again.write(RunEnd(exit=0))
    loaded = store.run("coastal", run)
    assert [type(record) for record in loaded.log.records] == [RunStart, RunResume, RunEnd]
    assert (loaded.log.damage, loaded.log.has_torn_end) == ((), False)
    assert loaded.exit == 0


def test_a_line_of_a_later_version_is_reported_not_fatal(store: Store) -> None:
    with store.start(STARTED) as journal:
        pass
    with journal_file(journal).open("ab") as file:
        file.write(b'{"at":"2026-05-04T00:00:00+00:00","kind":"teleported"}\n[1]\n{}\n')
    assert read(journal_file(journal)).damage == tuple(f"line {number} is damaged" for number in (2, 3, 4))


def test_an_earlier_saved_state_is_never_overwritten(store: Store) -> None:
    with store.start(STARTED) as journal:
        for text in ("one", "one", "two", "three"):
            journal.save("router", text)
    files = {path.name: path.read_text() for path in (journal.directory / "before").iterdir()}
    assert files == {"router.rsc": "one", "router.2.rsc": "two", "router.3.rsc": "three"}
    first = store.run("coastal", journal.run).before("router")
    assert first is not None
    assert first.text() == "one"


def test_runs_that_confirm_the_same_state_share_one_private_file(store: Store, tmp_path: Path) -> None:
    runs = []
    for text in ("one", "one", "two"):
        with store.start(STARTED) as journal:
            journal.confirm("router", lambda text=text: text)  # type: ignore[misc]  # bound now, called now
            runs.append(journal.run)
    files = list((tmp_path / "real" / "coastal" / "confirmed").iterdir())
    assert sorted(path.read_text() for path in files) == ["one", "two"]
    assert {stat.S_IMODE(path.stat().st_mode) for path in files} == {0o600}
    states = [store.run("coastal", run).confirmed_state("router") for run in runs]
    assert [(state.run, state.text()) for state in states if state] == list(
        zip(runs, ("one", "one", "two"), strict=True)
    )
    assert {device: state.run for device, state in store.last_confirmed("coastal", ("router", "cpe")).items()} == {
        "router": runs[-1]
    }
    assert store.last_confirmed("nowhere", ("router",)) == {}


def test_changed_or_lost_confirmed_state_is_refused_and_rewritten(store: Store) -> None:
    with store.start(STARTED) as journal:
        journal.confirm("router", lambda: "one")
        state = store.run("coastal", journal.run).confirmed_state("router")
        assert state is not None
        state.path.write_text("something else")
        with pytest.raises(DamagedStateError, match="cannot be used: it was changed since"):
            state.text()
        journal.confirm("router", lambda: "one")
        assert state.text() == "one"
        state.path.unlink()
        with pytest.raises(DamagedStateError, match="cannot be used: No such file"):
            state.text()
        journal.confirm("router", lambda: "one")
        assert state.text() == "one"


def test_failed_write_of_confirmed_state_does_not_end_the_journal(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_descriptor: int) -> NoReturn:
        raise OSError(errno.EDQUOT, os.strerror(errno.EDQUOT))

    with store.start(STARTED) as journal:
        monkeypatch.setattr("os.fsync", full)
        with pytest.raises(JournalError, match="the confirmed state cannot be written"):
            journal.confirm("router", lambda: "text")
        monkeypatch.undo()
        journal.write(EVERY[2])
    assert store.run("coastal", journal.run).confirmed_state("router") is None


@pytest.mark.parametrize("name", ["../x", "", "a/b", ".hidden", "a\0b"])
def test_names_cannot_leave_the_state_directory(store: Store, name: str) -> None:
    with store.start(STARTED) as journal, pytest.raises(ValueError, match="file name"):
        journal.save(name, "text")
    with pytest.raises(ValueError, match="file name"):
        store.lock(name, "c")


def test_full_disk_is_reported_and_ends_all_writing(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    with store.start(STARTED) as journal:
        real = os.write

        def short(descriptor: int, data: bytes) -> int:
            if len(data) > 10:
                return real(descriptor, data[:10])
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        monkeypatch.setattr("os.write", short)
        with pytest.raises(JournalError, match="No space left on device") as failure:
            journal.write(EVERY[2])
        monkeypatch.undo()
        assert failure.value.exit is ExitCode.FAILED
        with pytest.raises(JournalError, match="No space left on device"):
            journal.write(EVERY[3])
    assert read(journal_file(journal)).records == (STARTED,)
    assert read(journal_file(journal)).damage == ()


def _deleted(state: Path) -> None:
    shutil.rmtree(state / "real")


def _moved(state: Path) -> None:
    (state / "real").rename(state / "elsewhere")


def _replaced(state: Path) -> None:
    shutil.copytree(state / "real", state / "copy")
    shutil.rmtree(state / "real")
    (state / "copy").rename(state / "real")


@pytest.mark.parametrize("lost", [_deleted, _moved, _replaced])
def test_journal_removed_during_a_run_is_reported_and_not_replaced(
    store: Store, tmp_path: Path, lost: Callable[[Path], None]
) -> None:
    with store.start(STARTED) as journal:
        lost(tmp_path)
        kept = sorted(tmp_path.rglob("*"))
        with pytest.raises(JournalError, match="the confirmed state cannot be written: the folder of the run was"):
            journal.confirm("router", lambda: "text")
        with pytest.raises(JournalError, match="the state before the run cannot be written: the folder of the run"):
            journal.save("router", "text")
        assert sorted(tmp_path.rglob("*")) == kept
    shutil.rmtree(tmp_path / "elsewhere", ignore_errors=True)
    with store.start(STARTED) as journal:
        lost(tmp_path)
        for record in EVERY[2:4]:
            with pytest.raises(
                JournalError, match="the journal cannot be written: the folder of the run was"
            ) as failure:
                journal.write(record)
        assert failure.value.hint is not None
        assert "then run the same command again" in failure.value.hint


@pytest.mark.parametrize(
    ("code", "unproved"),
    [
        (ExitCode.DONE, ExitCode.CHECKS_FAILED),
        (ExitCode.CHANGES, ExitCode.CHECKS_FAILED),
        *((code, code) for code in ExitCode if code not in (ExitCode.DONE, ExitCode.CHANGES)),
    ],
)
def test_unrecorded_result_does_not_pass(store: Store, tmp_path: Path, code: ExitCode, unproved: ExitCode) -> None:
    given = LteResult(name="unit", status=Status.CHANGED, exit=code, message="2 settings read back")
    with store.start(STARTED) as journal:
        assert mark_unrecorded(given, conclude(journal, EVERY[2])) is given
        _deleted(tmp_path)
        failure = conclude(journal, outcome("router", "changed"), RunEnd(exit=0))
    assert failure is not None
    told = mark_unrecorded(mark_unrecorded(given, failure), failure)
    assert (told.exit, told.message) == (unproved, "2 settings read back; not recorded")
    assert told.notes == (str(failure),)
    assert told.hint == failure.hint


def test_a_backup_that_is_a_part_of_a_run_does_not_end_it(store: Store) -> None:
    """Killed after it, an upgrade is open: the end of its backup is not its own."""
    with store.start(replace(STARTED, hosts=("router",), purpose=Purpose.UPGRADE)) as journal:
        inner = StatesOnly(journal)
        inner.save("router", "# before\n")
        inner.confirm("router", lambda: "")
        inner.write(outcome("router", "unchanged"))
    run = store.run("coastal", journal.run)
    assert run.before("router") is not None
    assert run.unsettled_devices == ("router",)
    assert run.confirmed_state("router") is None


def test_failed_state_save_leaves_no_file(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_descriptor: int) -> NoReturn:
        raise OSError(errno.EDQUOT, os.strerror(errno.EDQUOT))

    with store.start(STARTED) as journal:
        monkeypatch.setattr("os.fsync", full)
        with pytest.raises(JournalError, match="the state before the run cannot be written"):
            journal.save("router", "text")
        monkeypatch.undo()
        with pytest.raises(JournalError):
            journal.write(EVERY[2])
    assert [path for path in (journal.directory / "before").iterdir() if path.is_file()] == []


def test_unwritable_state_directory_is_reported(tmp_path: Path) -> None:
    (tmp_path / "real").write_text("a file")
    with pytest.raises(JournalError, match="the journal cannot be written"):
        Store(tmp_path).start(STARTED)


def test_unknown_run_is_reported_with_the_existing_ones(store: Store) -> None:
    with pytest.raises(NoSuchRun, match="coastal has no run 1") as failure:
        store.run("coastal", "1")
    assert failure.value.hint == "its latest runs: none yet"
    with store.start(STARTED):
        pass
    with pytest.raises(NoSuchRun) as failure:
        store.run("coastal", "1")
    assert failure.value.hint == "its latest runs: 20260504T030201Z"
    assert failure.value.exit is ExitCode.NOTHING
    assert store.sites() == ("coastal",)


def outcome(device: str, status: str) -> Outcome:
    return Outcome(device=device, status=status, exit=0, message="")


def test_run_with_an_unsettled_device_is_unfinished(store: Store) -> None:
    with store.start(STARTED) as killed:
        killed.write(outcome("cpe", "unchanged"))
    assert [run.id for run in store.unfinished_runs("coastal")] == [killed.run]
    assert store.run("coastal", killed.run).unsettled_devices == ("router",)
    with store.start(STARTED) as unknown:
        for device, status in (("cpe", "unknown"), ("router", "changed")):
            unknown.write(outcome(device, status))
        unknown.write(RunEnd(exit=5))
    assert [run.id for run in store.unfinished_runs("coastal")] == [unknown.run]
    with store.resume("coastal", unknown.run, RunResume(revision="", tool="", command="")) as again:
        assert store.run("coastal", unknown.run).exit is None
        again.write(outcome("cpe", "changed"))
        again.write(RunEnd(exit=0))
    assert store.unfinished_runs("coastal") == ()
    assert store.unfinished_runs("nowhere") == ()


@pytest.mark.parametrize("status", ["left-as-found", "refused", "rolled-back", "planned", "drifted", "half-adopted"])
def test_refused_or_rolled_back_run_settles_no_earlier_run(store: Store, status: str) -> None:
    with store.start(STARTED) as killed:
        pass
    with store.start(STARTED) as refused:
        for device in STARTED.hosts:
            refused.write(outcome(device, status))
        refused.write(RunEnd(exit=4))
    assert [run.id for run in store.unfinished_runs("coastal")] == [killed.run]


SETTLING = {
    (Purpose.CONFIGURE, Purpose.CONFIGURE),
    (Purpose.CONFIGURE, Purpose.ADOPT),
    (Purpose.ADOPT, Purpose.ADOPT),
    (Purpose.UPGRADE, Purpose.UPGRADE),
    (Purpose.INSTALL, Purpose.INSTALL),
}


@pytest.mark.parametrize("earlier", Purpose)
@pytest.mark.parametrize("later", Purpose)
def test_only_a_run_of_the_same_purpose_settles_an_earlier_one(store: Store, earlier: Purpose, later: Purpose) -> None:
    with store.start(replace(STARTED, purpose=earlier)) as killed:
        pass
    with store.start(replace(STARTED, purpose=later)) as second:
        for device in STARTED.hosts:
            second.write(outcome(device, "changed"))
    settled = (later, earlier) in SETTLING or earlier is Purpose.BACKUP
    assert [run.id for run in store.unfinished_runs("coastal")] == ([] if settled else [killed.run])


def test_device_with_possible_leftovers_is_not_settled(store: Store) -> None:
    with store.start(STARTED) as lost:
        lost.write(outcome("cpe", "unchanged"))
        lost.write(replace(outcome("router", "left-as-found"), open=True))
    assert store.run("coastal", lost.run).unsettled_devices == ("router",)
    assert store.history("coastal", "router").has_unfinished_run()
    assert not store.history("coastal", "cpe").has_unfinished_run()
    assert not store.history("coastal", "router", current=lost.run).has_unfinished_run()


def test_sign_can_be_taken_over_by_its_journal_or_named_dead_run(store: Store) -> None:
    sign = f"run 20260504T030201Z of {STARTED.command}@10.0.0.2"
    with store.start(STARTED) as journal:
        journal.write(SignRecord(device="router", sign=sign))
    history = store.history("coastal", "router", dead="another")
    assert history.can_take_over(journal.run, sign)
    assert not history.can_take_over(journal.run, sign.replace("10.0.0.2", "10.0.0.3"))
    assert not store.history("coastal", "cpe").can_take_over(journal.run, sign)
    assert not history.can_take_over("unknown", sign)
    assert history.can_take_over("another", "run another of somebody")


def test_run_lists_acknowledged_and_confirmed_actions(store: Store) -> None:
    with store.start(STARTED) as journal:
        for record in EVERY[2:]:
            journal.write(record)
        journal.write(ActionAcknowledgement(device="router", actions=(3, 2)))
    run = store.run("coastal", journal.run)
    assert run.acknowledged_actions("router") == (1, 2, 3)
    assert run.confirmed_actions("router") == (1,)
    assert run.confirmed_actions("cpe") == ()
    assert run.before("cpe") is None
    assert run.at == datetime(2026, 5, 4, 3, 2, 1, tzinfo=UTC)
    assert run.start_record == STARTED


KILLED = """
import sys
from pathlib import Path
from atlantis_netcfg.runs import ActionAcknowledgement, RunStart, Store

journal = Store(Path(sys.argv[1])).start(
    RunStart(site="coastal", revision="", tool="", hosts=("router",), rehearsed=False, command="c"))
number = 0
while True:
    number += 1
    journal.write(ActionAcknowledgement(device="router", actions=(number,)))
    print(number, flush=True)
"""


def test_a_kill_loses_nothing_that_was_written(tmp_path: Path) -> None:
    for written in range(1, 6):
        arguments = [sys.executable, "-c", KILLED, str(tmp_path)]
        with subprocess.Popen(arguments, stdout=subprocess.PIPE) as process:
            assert process.stdout is not None
            printed = [int(process.stdout.readline()) for _ in range(written)]
            assert printed == list(range(1, written + 1))
            os.kill(process.pid, signal.SIGKILL)
    for written, run in enumerate(Store(tmp_path).runs("coastal"), start=1):
        numbers = run.acknowledged_actions("router")
        assert numbers == tuple(range(1, len(numbers) + 1))
        assert len(numbers) >= written
        assert run.unsettled_devices == ("router",)


def test_a_message_read_back_from_the_journal_keeps_its_values(store: Store) -> None:
    """`report runs` shows it in the language of its reader."""
    message = msg(f"{arg(2)} of {arg(3)} changes are left on {arg('router')}")
    outcome = Outcome(device="router", status="failed", exit=4, message=message)
    with store.start(STARTED) as journal:
        journal.write(outcome)
    data = json.loads(journal_file(journal).read_text(encoding="utf-8").splitlines()[-1])
    assert data["message"] == "2 of 3 changes are left on router"
    record = read(journal_file(journal)).records[-1]
    assert record == outcome
    assert isinstance(record, Outcome)
    assert isinstance(record.message, Message)
    assert record.message.source == f"{arg(2)} of {arg(3)} changes are left on {arg('router')}"
