"""A journal with a changed byte or a lost tail: every host of the run is named, or nothing is put back."""

import hashlib
import itertools
import json
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import pytest

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.inventory import Host, Inventory
from atlantis_netcfg.operations.common.kinds import is_supported
from atlantis_netcfg.operations.common.saved_states import hosts_to_restore, saved_run
from atlantis_netcfg.operations.restore import LATEST, confirmed_state
from atlantis_netcfg.runs import (
    DamagedStateError,
    LayerSent,
    NoSuchRun,
    Outcome,
    RunEnd,
    RunResume,
    RunStart,
    StateBackup,
    Store,
    read,
)

AT = datetime(2026, 5, 4, 3, 2, 1, tzinfo=UTC)


@pytest.fixture
def hosts(declaration: Inventory) -> tuple[Host, ...]:
    return tuple(host for host in declaration.site_hosts("coastal") if is_supported(host))


def recorded(state: Path, hosts: tuple[Host, ...], *, ended: bool = True) -> Path:
    """A run that has changed all hosts but the last, which was as declared."""
    names = tuple(host.name for host in hosts)
    store = Store(state, now=lambda: AT)
    started = RunStart(site="coastal", revision="ab", tool="1", hosts=names, rehearsed=False, command="provision")
    with store.start(started) as journal:
        for name in names[:-1]:
            journal.save(name, f"# {name}\n")
            journal.write(LayerSent(device=name, layer="policy", actions=(1,)))
            journal.confirm(name, lambda name=name: f"# {name} after\n")  # type: ignore[misc]
            journal.write(Outcome(device=name, status="changed", exit=0, message=""))
        journal.write(Outcome(device=names[-1], status="unchanged", exit=0, message=""))
        if ended:
            journal.write(RunEnd(exit=0))
    return journal.path


def spoiled(data: bytes) -> Iterator[bytes]:
    """Each byte changed; the tail lost at each line and within each; the tail zeroed."""
    yield from (data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :] for at in range(len(data)))
    yield from (data[:at] for at in range(0, len(data), 7))
    ends = [at + 1 for at, byte in enumerate(data) if byte == ord("\n")]
    yield from (data[:at] for at in ends[:-1])
    yield from (data[:at] + bytes(len(data) - at) for at in ends[:-1])
    yield from (data[:one] + data[other:] for one, other in itertools.pairwise(ends))


def test_rollback_names_every_host_or_fails(tmp_path: Path, hosts: tuple[Host, ...]) -> None:
    journal = recorded(tmp_path, hosts)
    data = journal.read_bytes()
    names = [host.name for host in hosts]
    run = saved_run(tmp_path, "coastal", LATEST, names)
    assert hosts_to_restore(run, hosts, is_explicit=False) == hosts[:-1]
    whole = 0
    for spoilt in spoiled(data):
        journal.write_bytes(spoilt)
        run = saved_run(tmp_path, "coastal", journal.parent.name, names)
        try:
            chosen = hosts_to_restore(run, hosts, is_explicit=False)
        except DamagedStateError:
            continue
        assert chosen == hosts[:-1], spoilt
        whole += 1
    assert DamagedStateError.exit is ExitCode.FAILED
    assert whole < 30, "only where the last line is lost alone"


def test_damaged_newest_run_is_not_skipped(tmp_path: Path, hosts: tuple[Host, ...]) -> None:
    recorded(tmp_path, hosts)
    journal = recorded(tmp_path, hosts)
    lines = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(b"".join(line.replace(b"state-saved", b"state-sawed") for line in lines))
    run = saved_run(tmp_path, "coastal", LATEST, [host.name for host in hosts])
    assert run.id == journal.parent.name
    with pytest.raises(
        DamagedStateError, match=rf"journal of run {run.id} is damaged: line 2 \({hosts[0].name}\) is damaged"
    ):
        hosts_to_restore(run, hosts, is_explicit=True)


def test_explicitly_named_host_is_restored_despite_damage(tmp_path: Path, hosts: tuple[Host, ...]) -> None:
    journal = recorded(tmp_path, hosts)
    journal.write_bytes(journal.read_bytes().replace(b'"exit":0,"message"', b'"exit":1,"message"', 1))
    run = Store(tmp_path).runs("coastal")[0]
    with pytest.raises(DamagedStateError) as refused:
        hosts_to_restore(run, hosts, is_explicit=False)
    assert refused.value.hint is not None
    assert f"device={','.join(host.name for host in hosts[:-1])}`" in refused.value.hint
    assert hosts_to_restore(run, hosts[:-1], is_explicit=True) == hosts[:-1]


def test_missing_or_changed_saved_file_is_reported(tmp_path: Path, hosts: tuple[Host, ...]) -> None:
    journal = recorded(tmp_path, hosts)
    saved = Store(tmp_path).runs("coastal")[0].before(hosts[0].name)
    assert saved is not None
    assert saved.text() == f"# {hosts[0].name}\n"
    saved.path.write_text("# other\n")
    with pytest.raises(DamagedStateError, match="cannot be used: it was changed since"):
        saved.text()
    saved.path.unlink()
    with pytest.raises(DamagedStateError, match="cannot be used: No such file"):
        saved.text()
    assert journal.exists()


def test_possibly_lost_later_state_is_not_skipped(tmp_path: Path, hosts: tuple[Host, ...]) -> None:
    first = recorded(tmp_path, hosts)
    assert confirmed_state(tmp_path, hosts[0], LATEST).run == first.parent.name
    later = recorded(tmp_path, hosts)
    later.write_bytes(later.read_bytes().replace(b"state-confirmed", b"state-confirmet"))
    with pytest.raises(
        DamagedStateError, match=rf"{later.parent.name} is damaged.* a later state of {hosts[0].name}"
    ) as told:
        confirmed_state(tmp_path, hosts[0], LATEST)
    assert f"`run={first.parent.name}`" in str(told.value.hint)
    assert confirmed_state(tmp_path, hosts[0], first.parent.name).run == first.parent.name


def test_a_journal_without_checksums_is_read_and_continued_with_them(tmp_path: Path, hosts: tuple[Host, ...]) -> None:
    journal = recorded(tmp_path, hosts, ended=False)
    rows = [json.loads(line) for line in journal.read_bytes().splitlines()]
    old = "".join(json.dumps({key: row[key] for key in row if key != "sum"}) + "\n" for row in rows)
    journal.write_text(old)
    records = read(journal).records
    assert (len(records), read(journal).damage) == (len(rows), ())
    store = Store(tmp_path)
    with store.resume("coastal", journal.parent.name, RunResume(revision="a", tool="2", command="x")) as again:
        again.write(RunEnd(exit=0))
    assert (len(read(journal).records), read(journal).damage) == (len(rows) + 2, ())
    journal.write_bytes(journal.read_bytes().replace(b'"device"', b'"devise"', 1))
    assert read(journal).damage == ("line 2 is damaged", f"line {len(rows) + 1} is damaged")


def test_torn_line_is_removed_but_a_zeroed_tail_counts_as_damage(tmp_path: Path, hosts: tuple[Host, ...]) -> None:
    journal = recorded(tmp_path, hosts, ended=False)
    data, store = journal.read_bytes(), Store(tmp_path)
    resumed = RunResume(revision="a", tool="2", command="x")
    for torn, damage in ((b'{"at":"2026', 0), (b"{", 0), (bytes(40), 1)):
        journal.write_bytes(data + torn)
        assert read(journal).has_torn_end
        with store.resume("coastal", journal.parent.name, resumed):
            pass
        assert len(read(journal).damage) == damage
        assert read(journal).records[-1] == resumed


def test_first_saved_state_counts_even_if_its_record_is_lost(tmp_path: Path, hosts: tuple[Host, ...]) -> None:
    journal = recorded(tmp_path, hosts, ended=False)
    name = hosts[0].name
    journal.write_bytes(b"".join(journal.read_bytes().splitlines(keepends=True)[:1]))
    store = Store(tmp_path)
    with store.resume("coastal", journal.parent.name, RunResume(revision="a", tool="2", command="x")) as again:
        again.save(name, "# half changed\n")
    saved = [record for record in read(journal).records if isinstance(record, StateBackup)]
    assert [record.sha256 for record in saved] == [
        hashlib.sha256(text).hexdigest() for text in (f"# {name}\n".encode(), b"# half changed\n")
    ]


def test_run_without_its_first_line_is_damaged(tmp_path: Path, hosts: tuple[Host, ...]) -> None:
    journal = recorded(tmp_path, hosts)
    lines = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(b"".join(lines[1:]))
    run = Store(tmp_path).run("coastal", journal.parent.name)
    assert run.start_record is None
    assert run.log.damage == (f"line 1 ({hosts[0].name}) is damaged",)
    with pytest.raises(NoSuchRun):
        Store(tmp_path).run("coastal", "no-run")
