"""The twins of a site as a process of their own: SSH and serial line are told, and work from outside."""

from pathlib import Path

import paramiko
import serial
from shell_site import PASSWORD
from waiting import HANG_S

from atlantis_netcfg.emulator.routeros import EmulatorSpec, RouterSpec, SiteSpec, User, spawn


def test_emulator_runs_in_a_separate_process(tmp_path: Path) -> None:
    users = (User(name="admin", password=PASSWORD),)
    spec = EmulatorSpec(router=RouterSpec(name="router", serial=True, users=users))
    plain = EmulatorSpec(router=RouterSpec(name="plain", users=users))
    with spawn(SiteSpec(name="site", emulators=(spec, plain)), tmp_path) as site:
        told = site.ready["router"]
        assert site.do("router", "info") == told
        assert told["ports"]["22"] == told["ssh"]
        assert site.ready["plain"]["serial"] is None
        with paramiko.Transport(("127.0.0.1", told["ssh"])) as transport:
            transport.connect(username="admin", password=PASSWORD)
            assert transport.get_remote_server_key().fingerprint == told["host_key"]
            channel = transport.open_session()
            channel.exec_command(':put "there"')
            assert channel.makefile("rb").read() == b"there\r\n"
        with serial.Serial(told["serial"], timeout=HANG_S) as line:
            line.write(b"\r")
            assert line.read_until(b"Login: ").endswith(b"Login: ")
        again = site.do("router", "restart")
        assert again["host_key"] == told["host_key"]
        assert again["ssh"] == told["ssh"]
