"""A stop signal at any moment of a start: nothing on the screen but the normal end, and no command that goes on."""

import os
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from waiting import HANG_S

from atlantis_netcfg.core.paths import checkout

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
ENDED = "nothing was changed"


def typed(state: Path, words: tuple[str, ...]) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [checkout() / "provision", *words],
        env={**os.environ, "ATLANTIS_STATE": str(state), "PYTHONUNBUFFERED": "1"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def whole(state: Path, words: tuple[str, ...]) -> tuple[float, int]:
    """How long the command takes, and how it ends if nobody stops it."""
    begun = time.monotonic()
    with typed(state, words) as process:
        process.communicate(timeout=HANG_S)
    return time.monotonic() - begun, process.returncode


def moments(number: int, until_s: float) -> Iterator[tuple[float, signal.Signals]]:
    for each in range(number):
        yield until_s * (each + 0.5) / number, SIGNALS[each % len(SIGNALS)]


def stop_at(state: Path, words: tuple[str, ...], after_s: float, number: signal.Signals, usual: int) -> None:
    with typed(state, words) as process:
        time.sleep(after_s)
        ended_before = process.poll() is not None
        process.send_signal(number)
        out, err = process.communicate(timeout=HANG_S)
    place = (after_s, number.name, process.returncode, out, err)
    assert "Traceback" not in err, place
    assert "Exception ignored" not in err, place
    if ended_before:
        assert process.returncode == usual, place
    elif process.returncode == -number:
        assert (out, err) == ("", ""), place
    elif process.returncode != usual:
        assert process.returncode == 4, place
        assert ENDED in out + err, place
    else:
        assert out or err, place


REHEARSAL = ("plan", "site=coastal", "--rehearse")


@pytest.mark.parametrize(
    ("words", "number"),
    [
        (("inventory", "validate"), 24),
        pytest.param(REHEARSAL, 24, marks=pytest.mark.slow),
        pytest.param(REHEARSAL, 500, marks=pytest.mark.campaign),
    ],
)
def test_signal_at_any_moment_of_startup_is_handled(tmp_path: Path, words: tuple[str, ...], number: int) -> None:
    took_s, usual = min(whole(tmp_path, words) for _ in range(2))
    for after_s, which in moments(number, min(took_s, 3.0)):
        stop_at(tmp_path, words, after_s, which, usual)
