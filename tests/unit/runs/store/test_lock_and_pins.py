"""One run per site, whoever dies; certificates that are only replaced on a person's word."""

import multiprocessing
import os
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier, Semaphore

import pytest
from waiting import HANG_S

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.runs import DamagedPinsError, JournalError, Pins, SiteBusy, Store, write_atomically

HOLD = """
import sys
from pathlib import Path
from atlantis_netcfg.runs import Store

with Store(Path(sys.argv[1])).lock("coastal", "provision site=coastal"):
    print("held", flush=True)
    sys.stdin.read()
"""


def holder(state: Path) -> subprocess.Popen[bytes]:
    arguments = [sys.executable, "-c", HOLD, str(state)]
    process = subprocess.Popen(arguments, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert process.stdout is not None
    assert process.stdout.readline() == b"held\n"
    return process


def test_busy_site_names_its_lock_holder(tmp_path: Path) -> None:
    with holder(tmp_path) as process:
        with pytest.raises(SiteBusy) as busy, Store(tmp_path).lock("coastal", "mine"):
            pass
        assert f"(process {process.pid})" in str(busy.value)
        assert str(busy.value).endswith("provision site=coastal")
        assert busy.value.exit is ExitCode.FAILED
        process.communicate(b"")
    with Store(tmp_path).lock("coastal", "mine"):
        assert b'"command": "mine"' in (tmp_path / "real" / "coastal" / "lock").read_bytes()
    assert (tmp_path / "real" / "coastal" / "lock").read_bytes() == b""


def test_a_killed_holder_frees_the_site(tmp_path: Path) -> None:
    with holder(tmp_path) as process:
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
    with Store(tmp_path).lock("coastal", "mine"):
        assert str(os.getpid()).encode() in (tmp_path / "real" / "coastal" / "lock").read_bytes()


def test_forked_child_does_not_keep_the_site_locked(tmp_path: Path) -> None:
    """A task of Ansible's ends a little after its result has been taken."""
    over = multiprocessing.get_context("fork").Event()
    with Store(tmp_path).lock("coastal", "mine"):
        child = multiprocessing.get_context("fork").Process(target=over.wait, daemon=True)
        child.start()
    with Store(tmp_path).lock("coastal", "mine again"):
        assert child.is_alive()
    over.set()
    child.join(HANG_S)
    assert child.exitcode == 0


def test_stale_lock_content_is_not_blamed(tmp_path: Path) -> None:
    store = Store(tmp_path)
    with holder(tmp_path) as process:
        process.kill()
        process.wait()
    path = tmp_path / "real" / "coastal" / "lock"
    stale = path.read_bytes()
    with store.lock("coastal", "mine"):
        path.write_bytes(stale)
        files = len([*Path("/proc/self/fd").iterdir()])
        with pytest.raises(SiteBusy, match="somebody who has just started"), store.lock("coastal", "other"):
            pass
        assert len([*Path("/proc/self/fd").iterdir()]) == files


def test_sites_are_locked_apart_and_rehearsals_not_at_all(tmp_path: Path) -> None:
    real, rehearsal = Store(tmp_path), Store(tmp_path, is_rehearsal=True)
    with (
        real.lock("coastal", "a"),
        real.lock("scc", "b"),
        rehearsal.lock("coastal", "c"),
        rehearsal.lock("coastal", "d"),
    ):
        names = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("lock")}
    assert names == {"real/coastal/lock", "real/scc/lock"}


def test_exactly_one_of_many_concurrent_locks_wins(tmp_path: Path) -> None:
    everybody, losers = Barrier(8), Semaphore(0)

    def attempt(_number: int) -> bool:
        everybody.wait()
        try:
            with Store(tmp_path).lock("coastal", "race"):
                return all(losers.acquire(timeout=HANG_S) for _ in range(7))
        except SiteBusy:
            losers.release()
            return False

    with ThreadPoolExecutor(8) as pool:
        assert sorted(pool.map(attempt, range(8))) == [False] * 7 + [True]


def test_the_first_certificate_is_pinned_and_stays(tmp_path: Path) -> None:
    pins = Store(tmp_path).pins
    assert pins.get("router") is None
    assert pins.pin("router", "aa") == "aa"
    assert pins.pin("router", "bb") == "aa"
    assert Store(tmp_path).pins.get("router") == "aa"
    assert Store(tmp_path, is_rehearsal=True).pins.get("router") is None


def test_pin_changes_only_explicitly(tmp_path: Path) -> None:
    pins = Pins(tmp_path / "pins.json")
    pins.pin("router", "aa")
    pins.change("router", "bb")
    assert pins.get("router") == "bb"
    pins.change("router", None)
    assert pins.get("router") is None


def test_host_key_is_pinned_separately_from_the_certificate(tmp_path: Path) -> None:
    pins = Pins(tmp_path / "pins.json")
    assert pins.host_key("coastal-router") is None
    pins.change_host_key("coastal-router", "SHA256:first")
    assert pins.host_key("coastal-router") == "SHA256:first"
    assert pins.get("coastal-router") is None
    pins.change_host_key("coastal-router", "SHA256:second")
    assert Pins(tmp_path / "pins.json").host_key("coastal-router") == "SHA256:second"
    pins.change_host_key("coastal-router", None)
    assert pins.host_key("coastal-router") is None


def test_concurrent_pins_are_all_stored(tmp_path: Path) -> None:
    names = [f"device{number}" for number in range(40)]
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda name: Pins(tmp_path / "pins.json").pin(name, name * 2), names))
    assert all(Pins(tmp_path / "pins.json").get(name) == name * 2 for name in names)


@pytest.mark.parametrize("text", ["", "{", "[]", '{"a": 1}'])
def test_damaged_pins_are_refused_and_left_unchanged(tmp_path: Path, text: str) -> None:
    (tmp_path / "pins.json").write_text(text)
    pins = Pins(tmp_path / "pins.json")
    with pytest.raises(DamagedPinsError, match="cannot be read"):
        pins.get("router")
    with pytest.raises(DamagedPinsError):
        pins.pin("router", "aa")
    assert (tmp_path / "pins.json").read_text() == text


def test_a_failed_replacement_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "file"
    write_atomically(path, b"old")

    def full(_descriptor: int, _data: bytes) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.write", full)
    with pytest.raises(OSError, match="No space"):
        write_atomically(path, b"new")
    monkeypatch.undo()
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_unwritable_lock_is_reported(tmp_path: Path) -> None:
    (tmp_path / "real").write_text("a file")
    with pytest.raises(JournalError, match="the site lock cannot be written"), Store(tmp_path).lock("coastal", "c"):
        pass


def test_reduced_window_is_remembered_until_the_certificate_changes(tmp_path: Path) -> None:
    pins = Pins(tmp_path / "pins.json")
    pins.pin("coastal-router", "aa")
    assert pins.window("coastal-router") is None
    pins.narrow("coastal-router", 24)
    assert Pins(tmp_path / "pins.json").window("coastal-router") == 24
    assert pins.window("te4sea-router") is None
    assert pins.pin("coastal-router", "bb") == "aa"
    assert pins.window("coastal-router") == 24
    pins.change("coastal-router", "bb")
    assert pins.window("coastal-router") is None
