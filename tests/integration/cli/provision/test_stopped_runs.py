"""Runs that are stopped or killed: the command says what is known of every host, and never hangs."""

import os
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
from hints_said import advised
from quay import PROVISION, ROUTER, Quay, quay
from test_real_run import await_record
from waiting import HANG_S, wait_until

pytestmark = [pytest.mark.slow, pytest.mark.namespace]
SENT = '"kind":"layer-sent"'


@pytest.fixture
def at(tmp_path: Path) -> Iterator[Quay]:
    with quay(tmp_path) as opened:
        yield opened


@contextmanager
def running(at: Quay, *typed: str, nohup: bool = False) -> Iterator[subprocess.Popen[str]]:
    """A run over a slow link, in a session of its own as on a terminal."""
    at.twins.do(ROUTER, "link", delay_s=0.15)
    # Who runs the tests may have been told to ignore it.
    signal.signal(signal.SIGHUP, signal.SIG_IGN if nohup else signal.SIG_DFL)
    with subprocess.Popen(
        [PROVISION, "site=coastal", f"device={ROUTER}", "--yes", f"inventory={at.inventory}", *typed],
        env=at.environment(),
        start_new_session=True,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as process:
        yield process


def children(parent: int) -> list[int]:
    """The processes that a process has started, and theirs."""
    found = []
    for task in Path(f"/proc/{parent}/task").iterdir():
        for child in map(int, (task / "children").read_text(encoding="ascii").split()):
            found += [child, *children(child)]
    return found


def ended(at: Quay, process: subprocess.Popen[str], code: int) -> str:
    text, _ = process.communicate(timeout=HANG_S)
    assert process.returncode == code, text
    at.twins.do(ROUTER, "link", delay_s=0.0)
    return text


def goes_on(at: Quay, command: list[str]) -> None:
    """What was advised, typed to the letter, brings the router to what is declared."""
    at.provision(*command, code=0)
    assert at.json("plan", "site=coastal", code=0)["devices"][ROUTER]["planned"] == 0
    assert not any(row["unfinished"] for row in at.runs())


@pytest.mark.smoke("2")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signal_rolls_the_device_back(at: Quay, number: signal.Signals) -> None:
    before = at.export()
    with running(at) as process:
        await_record(at.state, SENT)
        process.send_signal(number)
        text = ended(at, process, 4)
    assert "rolled back, the device is as before" in text
    assert f"STOPPED by {'Ctrl-C' if number == signal.SIGINT else number.name}" in text
    assert at.export().splitlines() == before.splitlines()
    assert [row["unfinished"] for row in at.runs()] == [False]
    assert at.json("site=coastal", "--yes", code=0)["devices"][ROUTER]["status"] == "changed"


def test_a_signal_that_is_ignored_stops_nothing(at: Quay) -> None:
    with running(at, nohup=True) as process:
        await_record(at.state, SENT)
        process.send_signal(signal.SIGHUP)
        text = ended(at, process, 0)
    assert "STOPPED" not in text


def test_second_ctrl_c_reports_an_unknown_outcome(at: Quay) -> None:
    with running(at) as process:
        await_record(at.state, SENT)
        process.send_signal(signal.SIGINT)
        time.sleep(0.05)  # two signals at once are one
        process.send_signal(signal.SIGINT)
        text = ended(at, process, 5)
    assert "the outcome is unknown: interrupted by SIGINT" in text
    (command,) = advised(text)
    goes_on(at, command)


def test_killed_task_is_reported_with_an_unknown_outcome(at: Quay) -> None:
    with running(at) as process:
        await_record(at.state, SENT)
        (task,) = children(process.pid)
        os.kill(task, signal.SIGKILL)
        text = ended(at, process, 5)
    assert f"{ROUTER} " in text
    assert "the outcome is unknown: the process working on it was killed" in text
    (command,) = advised(text)
    goes_on(at, command)


def test_a_task_that_dies_before_the_first_change_has_changed_nothing(at: Quay) -> None:
    before = at.export()
    with running(at) as process:
        await_record(at.state, '"kind":"run-started"')
        (task,) = children(process.pid)
        os.kill(task, signal.SIGKILL)
        text = ended(at, process, 4)
    assert "nothing was changed: the process working on it was killed" in text
    assert at.export().splitlines() == before.splitlines()
    assert at.json("site=coastal", "--yes", code=0)["devices"][ROUTER]["status"] == "changed"


def test_killed_command_leaves_no_task_behind(at: Quay) -> None:
    before = at.export()
    with running(at) as process:
        await_record(at.state, SENT)
        (task,) = children(process.pid)
        process.kill()
        process.wait()
        await_record(at.state, '"kind":"outcome"')
    wait_until(lambda: not Path(f"/proc/{task}").exists())
    at.twins.do(ROUTER, "link", delay_s=0.0)
    assert at.export().splitlines() == before.splitlines()
    (row,) = at.runs()
    assert (row["exit"], row["unfinished"], row["devices"][ROUTER]["status"]) == (4, False, "rolled-back")
    at.provision("site=coastal", "--yes", code=0)


def test_closed_output_pipe_does_not_stop_the_run(at: Quay) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run(
        [PROVISION, "site=coastal", f"device={ROUTER}", "--yes", "--verbose", f"inventory={at.inventory}"],
        env=at.environment(),
        stdin=subprocess.DEVNULL,
        stdout=writer,
        stderr=writer,
        check=False,
    )
    os.close(writer)
    assert done.returncode == 0
    assert at.json("plan", "site=coastal", code=0)["devices"][ROUTER]["planned"] == 0


def test_ctrl_c_at_the_prompt_changes_nothing(at: Quay) -> None:
    before = at.export()
    keyboard, terminal = os.openpty()
    with (
        os.fdopen(keyboard, "wb"),
        subprocess.Popen(
            [PROVISION, "site=coastal", f"device={ROUTER}", f"inventory={at.inventory}"],
            env=at.environment(),
            stdin=terminal,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            bufsize=0,
        ) as process,
    ):
        os.close(terminal)
        assert process.stdout is not None
        text = b""
        while not text.endswith(b"Type yes (the whole word) to continue, or no: "):
            more = process.stdout.read(65536)
            assert more, text.decode()
            text += more
        # Between the prompt and the reading of the answer Python takes a signal in and goes on to wait: press again.
        while process.poll() is None:
            process.send_signal(signal.SIGINT)
            with suppress(subprocess.TimeoutExpired):
                process.wait(10)
        text = process.stdout.read()
        assert process.returncode == 4, text.decode()
    assert b"interrupted by Ctrl-C at the prompt; nothing was changed" in text
    assert at.export() == before
