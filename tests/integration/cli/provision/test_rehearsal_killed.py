"""A rehearsal that is killed leaves temporary files; the next command, whichever it is, removes them."""

import os
import select
import signal
import subprocess
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from quay import PROVISION
from waiting import HANG_S


def descendants(pid: int) -> Iterator[int]:
    """Processes that a process has started, and those that they have."""
    for task in Path("/proc", str(pid), "task").iterdir():
        with suppress(OSError):
            for child in (task / "children").read_text(encoding="ascii").split():
                yield int(child)
                yield from descendants(int(child))


def is_twins(pid: int) -> bool:
    return "atlantis_netcfg.emulator.routeros" in Path("/proc", str(pid), "cmdline").read_text(encoding="utf-8")


@pytest.mark.slow
def test_next_command_removes_leftovers_of_a_killed_rehearsal(tmp_path: Path) -> None:
    place = tmp_path / "tmp"
    place.mkdir()
    environment = {**os.environ, "TMPDIR": str(place), "ATLANTIS_STATE": str(tmp_path), "ATLANTIS_NO_MACHINES": "1"}
    words = [PROVISION, "site=coastal", "device=coastal-router", "--rehearse", "--yes"]
    with subprocess.Popen(words, env=environment, stderr=subprocess.PIPE, text=True) as rehearsal:
        assert rehearsal.stderr is not None
        assert any(" sent (" in line for line in rehearsal.stderr)
        running = list(descendants(rehearsal.pid))
        (twins,) = filter(is_twins, running)
        end = os.pidfd_open(twins)
        for process in (rehearsal.pid, *running):
            if process != twins:
                with suppress(ProcessLookupError):
                    os.kill(process, signal.SIGKILL)
    assert select.select([end], [], [], HANG_S)[0]
    os.close(end)
    assert [path.name for path in place.glob("atlantis-twins-*.tmp")]
    subprocess.run([PROVISION, "inventory", "validate"], env=environment, stdout=subprocess.DEVNULL, check=True)
    assert list(place.iterdir()) == []
