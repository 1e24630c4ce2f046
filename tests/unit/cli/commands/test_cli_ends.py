"""Every way in which a command line can end."""

import importlib
import io
import json
import os
import re
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from pilot_commands import Table, done
from waiting import HANG_S

from atlantis_netcfg.cli import main
from atlantis_netcfg.cli.base.output import _reminder, progress
from atlantis_netcfg.cli.base.syntax import Arguments
from atlantis_netcfg.core.errors import DeviceError, ExitCode, NoMatchError, OutcomeUnknown, UsageError
from atlantis_netcfg.core.events import Event, Stage

LINE = ["site=coastal"]


def raising(error: BaseException) -> Callable[[Arguments], ExitCode]:
    def act(_arguments: Arguments) -> ExitCode:
        raise error

    return act


@pytest.mark.parametrize("code", list(ExitCode))
def test_exit_code_is_that_of_the_command(code: ExitCode, monkeypatch: pytest.MonkeyPatch) -> None:
    assert main(LINE, table=Table(monkeypatch, lambda _arguments: code)) == code


@pytest.mark.parametrize("error", [UsageError, NoMatchError, DeviceError, OutcomeUnknown])
def test_expected_error_is_shown_with_its_hint(
    error: type[UsageError], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    table = Table(monkeypatch, raising(error("the router is gone", hint="look at its cable")))
    assert main(LINE, table=table) == error.exit
    assert capsys.readouterr() == ("", "error: the router is gone\n       look at its cable\n")


def test_an_error_without_hint_is_one_line(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    main(LINE, table=Table(monkeypatch, raising(DeviceError("refused"))))
    assert capsys.readouterr().err == "error: refused\n"


def test_json_has_the_exit_code_and_every_error(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code = main(["sit=coastal", "--paln", "--json"], table=Table(monkeypatch, done))
    said = capsys.readouterr()
    told = json.loads(said.out)
    assert (code, told["exit"], said.err) == (3, 3, "")
    assert [error["hint"] for error in told["errors"]] == ["did you mean `site=coastal`?", "did you mean `--plan`?"]


def test_unexpected_error_is_one_sentence_and_a_log_file(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path / "state"))
    assert main(LINE, table=Table(monkeypatch, raising(ZeroDivisionError("by nothing")))) == ExitCode.OUR_FAULT
    (log,) = (tmp_path / "state" / "log").iterdir()
    said = capsys.readouterr().err
    assert "Traceback" not in said
    assert str(log) in said
    assert log.stat().st_mode & 0o777 == 0o600
    assert "ZeroDivisionError: by nothing" in log.read_text()


def test_unexpected_error_is_reported_if_no_log_can_be_written(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("ATLANTIS_STATE", str(tmp_path / "file"))
    table = Table(monkeypatch, raising(ZeroDivisionError("by nothing")))
    assert main([*LINE, "--json"], table=table) == ExitCode.OUR_FAULT
    (error,) = json.loads(capsys.readouterr().out)["errors"]
    assert "by nothing" in error["hint"]


@pytest.mark.parametrize(
    ("line", "code"), [(LINE, ExitCode.UNKNOWN), ([*LINE, "--plan"], ExitCode.FAILED), (["show"], ExitCode.FAILED)]
)
def test_ctrl_c_is_reported(
    line: list[str], code: ExitCode, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(line, table=Table(monkeypatch, raising(KeyboardInterrupt()))) == code
    assert capsys.readouterr().err.startswith("error: interrupted by Ctrl-C")


def test_signal_during_an_import_is_deferred(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "slow_to_load.py").write_text(
        "import os, signal, time\nos.kill(os.getpid(), signal.SIGTERM)\ntime.sleep(0.05)\nis_whole = True\n"
    )
    monkeypatch.syspath_prepend(tmp_path)

    def act(_arguments: Arguments) -> ExitCode:
        assert importlib.import_module("slow_to_load").is_whole
        time.sleep(HANG_S)
        return ExitCode.DONE

    assert main(LINE, table=Table(monkeypatch, act)) == ExitCode.UNKNOWN
    assert capsys.readouterr().err.startswith("error: interrupted by SIGTERM")


def test_empty_command_line_shows_the_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == ExitCode.USAGE
    said = capsys.readouterr()
    assert said.out == ""
    assert "Usage:" in said.err


def test_closed_pipe_does_not_change_the_exit_code() -> None:
    source = "import sys; from atlantis_netcfg.cli import main; sys.exit(main(['--help']))"
    read, write = os.pipe()
    os.close(read)
    process = subprocess.run([sys.executable, "-c", source], stdout=write, stderr=subprocess.PIPE, check=False)
    os.close(write)
    assert (process.returncode, process.stderr) == (ExitCode.DONE, b"")


@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-", "<&- >&- 2>&-"])
def test_closed_standard_streams_are_handled(closed: str) -> None:
    """As a service or a wrapper may start it; a file that is opened later must not become one of the three."""
    source = (
        "import sys, os; from atlantis_netcfg.cli import main; sys.exit(main(['inventory', 'validate']) or "
        "os.open('/', 0) < 3)"
    )
    process = subprocess.run(
        ["sh", "-c", f'exec "$@" {closed}', "sh", sys.executable, "-c", source], capture_output=True, check=False
    )
    assert (process.returncode, process.stderr) == (ExitCode.DONE, b"")


def test_standard_streams_stay_inheritable_after_a_play() -> None:
    source = (
        "import os, sys; from atlantis_netcfg.cli import main\n"
        "code = main(['report', 'drift', 'site=coastal', 'device=coastal-cpe'])\n"
        "print(code, [os.get_inheritable(number) for number in (0, 1, 2)])"
    )
    process = subprocess.run([sys.executable, "-c", source], capture_output=True, text=True, check=False)
    assert process.stdout == "3 [True, True, True]\n", process.stderr


def test_unencodable_character_is_replaced() -> None:
    source = "import sys; from atlantis_netcfg.cli import _open_streams as s; s(); print('…')"
    environment = os.environ | {"PYTHONIOENCODING": "ascii"}
    assert subprocess.run([sys.executable, "-c", source], capture_output=True, env=environment, check=True).stdout


def test_progress_goes_to_the_current_stderr(monkeypatch: pytest.MonkeyPatch) -> None:
    instead = io.StringIO()
    monkeypatch.setattr("sys.stderr", instead)
    with progress(quiet=False) as notify:
        notify(Event("quay", Stage.DONE, "as in the inventory"))
    assert instead.getvalue() == "  quay               done  as in the inventory\n"


def test_log_reports_what_it_is_waiting_for() -> None:
    reminded = threading.Event()

    class Log(io.StringIO):
        def write(self, text: str) -> int:
            if "still running" in text:
                reminded.set()
            return super().write(text)

    log = Log()
    with progress(quiet=False, out=log, silence_s=0.01) as notify:
        notify(Event("quay", Stage.DONE, "as in the inventory"))
        for name in ("mast", "buoy", "boat", "pier"):
            notify(Event(name, Stage.CONNECTING, ""))
        reminded.clear()
        assert reminded.wait(HANG_S)
    assert log.getvalue().splitlines()[-1] == (
        "  still running, no news for 0 s: mast (connecting), buoy (connecting), boat (connecting), 1 more"
    )


def test_reminder_shows_time_limits() -> None:
    at_work = [
        (Event("quay", Stage.CONNECTING, "to it", limit_s=120), 40.0),
        (Event("mast", Stage.APPLYING, "", 3, 9), 7.0),
        (Event("buoy", Stage.CONNECTING, "", limit_s=15), 1.0),
    ]
    assert _reminder(at_work, 40.0) == (
        "  still running, no news for 40 s: quay (connecting, 40 s of at most 120 s), mast (applying, 7 s), buoy "
        "(connecting)"
    )


def test_closed_log_stops_neither_reminder_nor_run() -> None:
    class Closed(io.StringIO):
        tries = 0

        def write(self, _text: str) -> int:
            self.tries += 1
            raise BrokenPipeError

    log = Closed()
    with progress(quiet=False, out=log, silence_s=0.001):
        while log.tries < 3:
            pass
    assert log.tries >= 3


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_quiet_progress_is_shown_only_on_a_terminal() -> None:
    terminal, log = Terminal(), io.StringIO()
    for out in (terminal, log):
        with progress(quiet=True, out=out) as notify:
            notify(Event("quay", Stage.CONNECTING, "to it"))
    assert re.search(r"quay +connecting  to it", terminal.getvalue())
    assert log.getvalue() == ""


def test_a_terminal_shows_the_age_of_a_step(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal, clock = Terminal(), iter(range(0, 10_000, 7))
    monkeypatch.setattr("atlantis_netcfg.cli.base.output.time.monotonic", lambda: float(next(clock)))
    with progress(quiet=False, out=terminal) as notify:
        notify(Event("quay", Stage.CONNECTING, "to it"))
        notify(Event("mast", Stage.CONNECTING, f"to {'a far place ' * 9}", limit_s=120))
    assert re.search(r"quay +connecting  to it  \(\d+ s\)", terminal.getvalue())
    assert re.search(r"mast +connecting  to a far place .*…  \(\d+ s of at most 120 s\)", terminal.getvalue())


def test_silence_flag_without_root_is_refused_before_contact(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("atlantis_netcfg.routeros.api.may_cut_off", lambda: False)
    assert main(["device", "verify", "device=coastal-router", "--silence"]) == ExitCode.USAGE
    assert capsys.readouterr().err.splitlines() == [
        "error: `--silence`: on this computer only root can block a connection; no device was contacted",
        "       run the same command with `sudo`, or without `--silence`",
    ]
