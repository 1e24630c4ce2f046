"""Logging in over a serial line, whatever the last session has left there."""

from pathlib import Path

import pytest
from desk import Desk, DeskLine

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.routeros.console.terminal import open_serial
from atlantis_netcfg.routeros.console.types import ConsoleLoginError, ConsoleUnreachable

WORD = "sticker"


def test_login_and_command_work() -> None:
    desk = Desk({"/x": "fine"}, password=WORD, logged_in=False)
    desk.begin()
    with DeskLine(desk) as path:
        console = open_serial(path, "admin", Secret(WORD), timeout_s=10)
        assert console.run("/x", timeout_s=5) == "fine"
        assert console.host_key is None
        console.close()
        assert not desk.logged_in


def test_wrong_password_is_reported() -> None:
    desk = Desk(password=WORD, logged_in=False)
    desk.begin()
    with DeskLine(desk) as path, pytest.raises(ConsoleLoginError, match="did not accept the user name and password"):
        open_serial(path, "admin", Secret("guess"), timeout_s=10)


def test_the_session_of_a_killed_run_is_ended_first() -> None:
    desk = Desk({"/x": "fine"}, password=WORD)
    desk.feed("/half a li")
    with DeskLine(desk) as path:
        console = open_serial(path, "admin", Secret(WORD), timeout_s=10)
        assert "/quit" in desk.typed
        assert console.run("/x", timeout_s=5) == "fine"
        console.close()


def test_safe_mode_of_a_killed_run_is_undone() -> None:
    desk = Desk({"/x": "fine"}, password=WORD, safe=True)
    with DeskLine(desk) as path:
        console = open_serial(path, "admin", Secret(WORD), timeout_s=10)
        assert desk.undone
        assert console.run("/x", timeout_s=5) == "fine"
        console.close()


def test_session_with_safe_mode_is_undone_on_close() -> None:
    desk = Desk(password=WORD, logged_in=False)
    desk.begin()
    with DeskLine(desk) as path:
        console = open_serial(path, "admin", Secret(WORD), timeout_s=10)
        console.take_safe_mode()
        console.close()
        again = open_serial(path, "admin", Secret(WORD), timeout_s=10)
        assert desk.undone
        again.close()


def test_missing_serial_line_is_reported(tmp_path: Path) -> None:
    with pytest.raises(ConsoleUnreachable, match="the serial line cannot be opened"):
        open_serial(str(tmp_path / "ttyUSB7"), "admin", Secret(WORD), timeout_s=1)


def test_silent_line_is_reported() -> None:
    desk = Desk(password=WORD, mute=True)
    with DeskLine(desk) as path, pytest.raises(ConsoleUnreachable, match="no RouterOS console responds on this line"):
        open_serial(path, "admin", Secret(WORD), timeout_s=0.1)
