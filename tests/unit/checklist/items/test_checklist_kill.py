"""Killed at any moment, a checklist loses nothing that was said to be written, and is open or signed, never between."""

import os
import signal
import sys
from pathlib import Path

import pytest
from checklist_bench import FAILSAFE, NAME, WIFI, Desk, answer, pages

from atlantis_netcfg.checklist import Confirmation, VehicleState, books, verify
from atlantis_netcfg.core.events import Verdict

_TOUCHES = ("open", "os.rename", "os.mkdir", "os.remove", "os.link", "os.truncate")
"""Audit events after which the disk is another one; writes are counted by themselves."""


NAMES = (WIFI, FAILSAFE)


class _Reaper:
    """Kills its own process before the n-th thing that it does to the disk; a write is torn in its middle."""

    def __init__(self, left: int, state: Path) -> None:
        self.left = left
        self.state = str(state)

    def audit(self, event: str, arguments: tuple[object, ...]) -> None:
        if event in _TOUCHES and self.state in str(arguments):
            self.count()

    def count(self) -> None:
        self.left -= 1
        if self.left < 0:
            os.kill(os.getpid(), signal.SIGKILL)

    def arm(self) -> None:
        sys.addaudithook(self.audit)
        write = os.write

        def torn(descriptor: int, data: bytes) -> int:
            if self.left == 0:
                write(descriptor, bytes(data)[: len(data) // 2])
            self.count()
            return write(descriptor, data)

        os.write = torn  # type: ignore[assignment] # the child's own


def _whole(state: Path, photo: Path, said: int) -> None:
    """A checklist from its beginning to its signature; what was written is said."""
    desk = Desk(state)
    with desk.open(NAMES) as book:
        book.confirm(FAILSAFE, Confirmation(Verdict.PASS, NAME, files=(photo,)))
        os.pwrite(said, b"1", 0)
        answer(book)
        os.pwrite(said, b"2", 0)
        book.sign(NAME, pages)
        os.pwrite(said, b"3", 0)


def _killed(state: Path, photo: Path, left: int) -> tuple[bool, int]:
    """Whether the process was killed, and how far it said that it had come."""
    log = os.open(state.with_suffix(".said"), os.O_RDWR | os.O_CREAT)
    child = os.fork()
    if child == 0:
        try:
            _Reaper(left, state).arm()
            _whole(state, photo, log)
        except BaseException:  # noqa: BLE001 - the child never goes back into pytest
            os._exit(1)
        os._exit(0)
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    assert status in {0, -signal.SIGKILL}
    come = int(os.pread(log, 1, 0) or b"0")
    os.close(log)
    return status != 0, come


def _holds(state: Path, come: int) -> None:
    desk = Desk(state)
    kept = books(desk.folder)
    signed = [one for one in kept if one.state is VehicleState.SIGNED]
    assert come < 3 or signed
    for one in signed:
        assert verify(one.folder) == ()
    if signed:
        return
    with desk.open(NAMES) as book:
        done = [item.id for item in book.items if not item.open]
        assert come < 1 or FAILSAFE in done
        assert come < 2 or len(done) == len(NAMES)
        answer(book)
        book.sign(NAME, pages)
    assert verify(book.folder) == ()


@pytest.mark.slow
def test_kill_before_any_disk_operation_is_survived(tmp_path: Path) -> None:
    photo = tmp_path / "photo.jpg"
    photo.write_bytes(b"a photo" * 20)
    for left in range(1000):
        state = tmp_path / f"{left}" / "state"
        state.mkdir(parents=True)
        killed, come = _killed(state, photo, left)
        _holds(state, come)
        if not killed:
            assert left > 40  # so many moments there are at least
            return
    raise AssertionError("it never comes to its end")
