"""The gateway's program: what it would send, how it reads the end of a program, its rate and its cap."""

import json
import os
import time
from pathlib import Path
from typing import Any

import pytest
from retrieval_programs import program

NOW = time.time()


@pytest.fixture
def sender(tmp_path: Path) -> Any:  # noqa: ANN401 - a program, no module of ours
    made = program("retrieval")
    for name in ("JOB", "STATUS", "COUNTS", "KEPT", "HASHES", "LOCK"):
        setattr(made, name, tmp_path / f"{name}.json")
    return made


def record(folder: Path, path: str, data: bytes = b"bag", age_s: float = 600) -> Path:
    place: Path = folder / path
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_bytes(data)
    os.utime(place, (NOW - age_s, NOW - age_s))
    return place


def listed(sender: Any, folder: Path, **how: Any) -> dict[str, Any]:  # noqa: ANN401 - as above
    wish = {"pattern": "*", "again": False, "before": NOW} | how
    found: dict[str, Any] = sender.listed({"folder": str(folder)}, wish)
    return found


def test_lists_only_finished_files_and_follows_no_symlinks(sender: Any, tmp_path: Path) -> None:  # noqa: ANN401 - as above
    folder = tmp_path / "bags"
    record(folder, "bag-1/a.db3", b"x" * 100)
    record(folder, "bag-2/b.db3", age_s=5)
    record(folder, "bag-2/odd\nname")
    record(tmp_path / "elsewhere", "secret")
    (folder / "link").symlink_to(tmp_path / "elsewhere" / "secret")
    (folder / "folder").symlink_to(tmp_path / "elsewhere")
    os.mkfifo(folder / "pipe")
    found = listed(sender, folder)
    assert [row[0] for row in found["rows"]] == ["bag-1/a.db3"]
    assert {name: found[name] for name in ("files", "bytes", "kept", "writing", "unnamed")} == {
        "files": 1,
        "bytes": 100,
        "kept": 0,
        "writing": 1,
        "unnamed": 1,
    }
    assert listed(sender, folder, pattern="bag-2/*")["files"] == 0


def test_retrieved_files_are_skipped_unless_changed_or_to_be_compared(sender: Any, tmp_path: Path) -> None:  # noqa: ANN401 - as above
    folder = tmp_path / "bags"
    path = record(folder, "a", b"x" * 100)
    state = path.stat()
    sender.KEPT.write_text(json.dumps({"a": [state.st_size, state.st_mtime_ns, "…"]}))
    assert (listed(sender, folder)["files"], listed(sender, folder)["kept"]) == (0, 1)
    again = listed(sender, folder, again=True)
    assert (again["files"], again["bytes"], again["compared"]) == (1, 0, 1)
    record(folder, "a", b"y" * 100, age_s=300)
    assert listed(sender, folder)["files"] == 1


def test_files_changed_or_deleted_meanwhile_are_reported(sender: Any, tmp_path: Path) -> None:  # noqa: ANN401 - as above
    folder = tmp_path / "bags"
    for name in ("same", "grows", "goes"):
        record(folder, name)
    job = {"files": listed(sender, folder)["rows"]}
    left: dict[str, list[str]] = {"changed": [], "gone": [], "differ": []}
    rows = sender.digested({"folder": str(folder)}, job, left)
    record(folder, "grows", b"more", age_s=0)
    (folder / "goes").unlink()
    assert [row[0] for row in sender.unchanged({"folder": str(folder)}, rows, left)] == ["same"]
    assert left == {"changed": ["grows"], "gone": ["goes"], "differ": []}


@pytest.mark.parametrize(
    ("code", "text", "name"),
    [
        (255, "ssh: connect to host 192.0.2.2 port 22: Connection timed out", "Away"),
        (12, "rsync: connection unexpectedly closed", "Away"),
        (30, "rsync error: timeout in data send/receive", "Away"),
        (1, "rsync: syntax or usage error", "Refused"),
    ],
)
def test_lost_link_is_retried_and_refusal_is_not(sender: Any, code: int, text: str, name: str) -> None:  # noqa: ANN401 - as above
    found = sender.failure(code, f"{text}\nlast line\n".encode())
    assert (type(found).__name__, str(found)) == (name, text)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("rsync: [receiver] write failed: No space left on device (28)", "the disk of the control centre is full"),
        (
            "atlantis: option not admitted: --delete\nrsync error: in protocol data stream",
            "refuses it (atlantis: option",
        ),
        ("svc-retrieval@192.0.2.2: Permission denied (publickey).", "does not admit this gateway"),
        (
            "@ WARNING: REMOTE HOST IDENTIFICATION HAS CHANGED! @\nHost key verification failed.",
            "declared SSH host key",
        ),
    ],
)
def test_permanent_refusal_has_a_clear_message(sender: Any, text: str, words: str) -> None:  # noqa: ANN401 - as above
    found = sender.failure(12, text.encode())
    assert type(found).__name__ == "Refused"
    assert words in str(found)


class Clock:
    """Time that passes when somebody sleeps."""

    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


@pytest.mark.parametrize("rate_bps", [17_600, 70_400, 8_000_000])
def test_rate_limit_includes_wire_overhead(sender: Any, monkeypatch: pytest.MonkeyPatch, rate_bps: int) -> None:  # noqa: ANN401 - as above
    clock = Clock()
    monkeypatch.setattr(sender, "time", clock)
    meter = sender.Meter({"cap_bytes": None, "rate_bps": rate_bps})
    sent, start = 0, clock.now
    while clock.now < start + 60:
        meter.pace(meter.portion)
        sent += meter.portion
    assert sent * sender.WIRE * 8 / (clock.now - start) == pytest.approx(rate_bps, rel=0.02)
    assert meter.portion * sender.WIRE * 8 / rate_bps <= 0.31, "no burst is longer than a third of a second"


def test_cap_stops_transfer_and_is_counted_across_connections(sender: Any, monkeypatch: pytest.MonkeyPatch) -> None:  # noqa: ANN401 - as above
    class Ended(Exception):
        pass

    def end(code: int) -> None:
        raise Ended(code)

    monkeypatch.setattr(sender.os, "_exit", end)
    job = {"cap_bytes": 12_000, "rate_bps": 8e6}
    first = sender.Meter(job)
    first.count(5_000)
    first.save()
    second = sender.Meter(job)
    second.count(4_999)
    with pytest.raises(Ended):
        second.count(10)
    assert json.loads(sender.COUNTS.read_text())["spent"] is True


def test_other_link_is_detected_by_its_round_trip_time(sender: Any, capsys: pytest.CaptureFixture[str]) -> None:  # noqa: ANN401 - as above
    job = {"rtt_max_s": 0.2, "link": "4g"}
    assert [sender.too_slow(job, rtt) for rtt in (0.05, 0.2, 0.65)] == [False, False, True]
    assert capsys.readouterr().err == "an answer takes 0.7 s: the traffic does not go over 4g now\n"
    assert not sender.too_slow({"rtt_max_s": None, "link": "satellite"}, 5.0)
