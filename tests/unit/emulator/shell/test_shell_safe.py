"""Safe mode of the console is the same object as the API's: who holds it, who robs whom, and what stays."""

import pytest
from shell_bench import PASSWORD, TECHNICIAN, Bench

CTRL_X = "\x18"
HIJACK = "Hijacking Safe Mode from someone - unroll/release/don't take it [u/r/d]:"
ADD = "/ip pool add name=s ranges=10.0.0.1\r"


@pytest.mark.parametrize("version", ["6.49.10", "7.16", "7.18.2"])
def test_changes_are_undone_shortly_after_a_clean_disconnect(version: str) -> None:
    bench = Bench(version=version)
    before, terminal = bench.text(), bench.terminal()
    assert terminal.type(CTRL_X).endswith("<SAFE> ")
    terminal.type(ADD)
    assert bench.text() != before
    terminal.leave()
    bench.wait(2.1)
    assert bench.text() != before
    bench.wait(0.1)
    assert bench.text() == before
    bench.wait(60)
    assert bench.text() == before


def test_quit_keeps_changes() -> None:
    bench = Bench()
    terminal = bench.terminal()
    terminal.type(CTRL_X + ADD)
    after = bench.text()
    terminal.type("/quit\r")
    assert terminal.session.over
    terminal.leave()
    bench.wait(60)
    assert bench.text() == after


def test_end_of_file_undoes_changes() -> None:
    bench = Bench()
    before, terminal = bench.text(), bench.terminal()
    terminal.type(CTRL_X + ADD + "\x04")
    assert terminal.session.over
    terminal.leave()
    bench.wait(3)
    assert bench.text() == before


def test_silent_session_is_undone_after_nine_minutes() -> None:
    bench = Bench()
    before, terminal = bench.text(), bench.terminal()
    terminal.type(CTRL_X + ADD)
    bench.device.logout(terminal.caller, clean=False)
    bench.wait(539)
    assert bench.text() != before
    bench.wait(4)
    bench.wait(3)
    assert bench.text() == before


def test_hijack_and_undo() -> None:
    bench = Bench()
    before, first = bench.text(), bench.terminal()
    first.type(CTRL_X + ADD)
    second = bench.terminal()
    second.shown()
    assert second.type(CTRL_X) == f"\r\n{HIJACK}"
    assert second.type("u") == "u\r\n[Safe Mode taken]\r\n[admin@MikroTik] <SAFE> "
    assert bench.text() == before
    assert first.shown() == "\r\n[Safe mode released by another user]\r\n[admin@MikroTik] > "


def test_hijack_and_release() -> None:
    bench = Bench()
    before, first = bench.text(), bench.terminal()
    first.type(CTRL_X + ADD)
    second = bench.terminal()
    second.shown()
    second.type(CTRL_X)
    assert second.type("r").endswith("[Safe Mode taken]\r\n[admin@MikroTik] <SAFE> ")
    second.leave()
    bench.wait(60)
    assert bench.text() != before
    assert "<SAFE>" not in first.type("\r")


@pytest.mark.parametrize("key", ["d", "x", "\r", "\x03"])
def test_hijack_declined(key: str) -> None:
    bench = Bench()
    first, second = bench.terminal(), bench.terminal()
    first.type(CTRL_X)
    second.shown()
    second.type(CTRL_X)
    assert second.type(key).endswith("\r\n[admin@MikroTik] > ")
    assert "<SAFE>" in first.type("\r")
    assert "<SAFE>" not in second.type("\r")


def test_safe_mode_is_shared_between_console_and_api() -> None:
    bench = Bench()
    terminal = bench.terminal()
    terminal.type(CTRL_X)
    caller = bench.device.login("admin", PASSWORD, via="api", address=TECHNICIAN)
    (row, _) = bench.device.run(caller, ["/safe-mode/print"])
    assert {"=enabled=true", "=current=false", "=owner=ssh:admin@10.64.101.10"} <= set(row.words)
    bench.device.run(caller, ["/safe-mode/release"])
    assert "<SAFE>" not in terminal.type("\r")
    bench.device.run(caller, ["/safe-mode/take"])
    assert HIJACK in terminal.type(CTRL_X)


def test_exceeding_the_history_leaves_safe_mode_silently() -> None:
    bench = Bench(history_limit=3)
    terminal = bench.terminal()
    terminal.type(CTRL_X)
    for number in range(3):
        assert "<SAFE>" in terminal.type(f"/ip pool add name=p{number} ranges=10.0.0.{number}\r")
    shown = terminal.type("/ip pool add name=p3 ranges=10.0.0.3\r")
    assert "<SAFE>" not in shown
    assert "Safe" not in shown


@pytest.mark.parametrize("command", ["release", "unroll"])
def test_console_is_notified_when_the_api_ends_its_safe_mode(command: str) -> None:
    bench = Bench()
    terminal = bench.terminal()
    terminal.type(CTRL_X)
    caller = bench.device.login("admin", PASSWORD, via="api", address=TECHNICIAN)
    bench.device.run(caller, [f"/safe-mode/{command}"])
    assert terminal.shown() == "\r\n[Safe mode released by another user]\r\n[admin@MikroTik] > "
    assert terminal.shown() == ""
