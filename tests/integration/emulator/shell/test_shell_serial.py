"""pyserial on the twin's serial line: login, the questions of a first login, what reaches the line."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import serial
from shell_site import PASSWORD, Twin, twin
from waiting import HANG_S

from atlantis_netcfg.emulator.routeros import WireBehaviour

PROMPT = b"] > "


class Cable:
    """The technician's end."""

    def __init__(self, path: str) -> None:
        self.port = serial.Serial(path, 115200, timeout=0.05)

    def until(self, *wanted: bytes) -> str:
        """Everything up to one of the words, at the end of what came. Silence for too long fails."""
        found, end = b"", time.monotonic() + HANG_S
        while not found.endswith(wanted):
            assert time.monotonic() < end, found
            found += self.port.read(1) + self.port.read(self.port.in_waiting)
        return found.decode()

    def say(self, text: str, *wanted: bytes) -> str:
        self.port.write(text.encode())
        return self.until(*wanted)

    def login(self, name: str = "admin+cet200w", password: str = PASSWORD) -> str:
        self.say("\r", b"Login: ")
        self.say(f"{name}\r", b"Password: ")
        return self.say(f"{password}\r", PROMPT, b"Login: ", b"[Y/n]: ")


@contextmanager
def cable(box: Twin) -> Iterator[Cable]:
    end = Cable(box.info["serial"])
    try:
        yield end
    finally:
        end.port.close()


def test_login(tmp_path: Path) -> None:
    with twin(tmp_path, serial=True) as box, cable(box) as line:
        assert "Login failed, incorrect username or password" in line.login(password="wrong")
        line.say("admin+cet200w\r", b"Password: ")
        assert "Press F1 for help" in line.say(f"{PASSWORD}\r", PROMPT)
        assert line.say(":put [/ip/address/get 0 address]\r", PROMPT).splitlines()[1].startswith("no such item")
        assert "=via=console" in str(box.rows("/user/active/print"))
        assert line.say("\x04", b"Login: ").endswith("Login: ")
        assert "=via=console" not in str(box.rows("/user/active/print"))


def test_user_without_local_policy_is_rejected(tmp_path: Path) -> None:
    with twin(tmp_path, serial=True) as box, cable(box) as line:
        box.do("console", words=["/user/group/add", "=name=remote", "=policy=ssh,read"])
        box.do("console", words=["/user/set", "=numbers=guest", "=group=remote"])
        assert "Login failed" in line.login("guest")


def test_first_login(tmp_path: Path) -> None:
    with twin(tmp_path, serial=True, factory=True) as box, cable(box) as line:
        assert "Do you want to see the software license?" in line.login()
        assert "remove this default configuration" in line.say("n", b"disconnected.\r\n")
        line.say("\r", b"new password> ")
        line.say("harbour\r", b"repeat new password> ")
        assert "Password changed" in line.say("harbour\r", PROMPT)
        line.say("\x04", b"Login: ")
        assert "license" not in line.login(password="harbour")
        assert box.info["serial"]


def test_serial_line_survives_network_faults_and_restarts_on_reboot(tmp_path: Path) -> None:
    with twin(tmp_path, serial=True, knobs=WireBehaviour(boot_s=0.2)) as box, cable(box) as line:
        line.login()
        for fault in ("drop", "vanish"):
            box.do(fault)
        box.do("gap", seconds=3600)
        assert "name: MikroTik" in line.say("/system identity print\r", PROMPT)
        line.say("/system reboot\r", b"[y/N]:")
        assert "Rebooting" in line.say("y", b"Login: ")
        assert line.login().endswith("[admin@MikroTik] > ")


def test_safe_mode_on_the_line(tmp_path: Path) -> None:
    with twin(tmp_path, serial=True, version="6.49.10", unroll_delay_s=0.0) as box, cable(box) as line:
        before = box.export(header=False)
        for _ in range(2):
            line.login()
            assert "[Safe Mode taken]" in line.say("\x18", b"<SAFE> ")
            line.say("/ip pool add name=s ranges=10.0.0.1\r", b"<SAFE> ")
            assert box.export(header=False) != before
            line.say("\x04", b"Login: ")
            line.login()
            assert box.export(header=False) == before
            line.say("/quit\r", b"Login: ")


def test_terminal_that_ignores_the_probe_gets_no_output(tmp_path: Path) -> None:
    with twin(tmp_path, serial=True, knobs=WireBehaviour(probe_s=0.1)) as box, cable(box) as line:
        line.say("\r", b"Login: ")
        line.say("admin\r", b"Password: ")
        assert "\x1bZ" in line.say(f"{PASSWORD}\r", b"] > \x1b[K")
        assert "MikroTik\r\n" not in line.say("/system identity print\r", b"] > \x1b[K")
        assert box.info["serial"] == line.port.port


def test_long_output_is_complete(tmp_path: Path) -> None:
    with twin(tmp_path, serial=True) as box, cable(box) as line:
        line.login("admin+cet9999w")
        shown = line.say("/export verbose\r", PROMPT)
        assert shown.replace("\r\n", "\n").split("\n")[2:-1] == box.export(verbose=True).split("\n")[1:-1]
