"""The console over SSH against a router twin: trust before the password, and files."""

import logging
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.emulator.routeros import EmulatorSpec, RouterSpec, RunningSite, SiteSpec, User
from atlantis_netcfg.routeros.console.ssh import open_ssh, upload
from atlantis_netcfg.routeros.console.types import (
    ConsoleLoginError,
    ConsoleLost,
    ConsoleUnreachable,
    HostKeyMismatch,
    UnknownHostKey,
)

WORD = Secret("pa$$ \"w\\ord'")


@pytest.fixture
def site(tmp_path: Path) -> Iterator[RunningSite]:
    spec = RouterSpec(name="box", users=(User(name="provision", password=WORD.reveal()),), unroll_delay_s=0.05)
    with RunningSite(SiteSpec(name="quay", emulators=(EmulatorSpec(router=spec),)), tmp_path) as running:
        yield running


def where(site: RunningSite) -> tuple[str, int, str]:
    ready: dict[str, Any] = site.ready["box"]
    return ready["host"], ready["ssh"], ready["host_key"]


def logins(site: RunningSite) -> int:
    return int(site.do("box", "counters")["logins"])


def test_unknown_or_changed_host_key_gets_no_password(site: RunningSite) -> None:
    host, port, key = where(site)
    with pytest.raises(UnknownHostKey) as unknown:
        open_ssh(host, port, "provision", WORD, pin=None, timeout_s=10)
    assert unknown.value.fingerprint == key
    with pytest.raises(HostKeyMismatch) as changed:
        open_ssh(host, port, "provision", WORD, pin="SHA256:another", timeout_s=10)
    assert (changed.value.pinned_key, changed.value.actual_key) == ("SHA256:another", key)
    assert logins(site) == 0


def test_session_runs_commands_and_logs_no_secret(site: RunningSite, caplog: pytest.LogCaptureFixture) -> None:
    host, port, key = where(site)
    with caplog.at_level(logging.DEBUG):
        console = open_ssh(host, port, "provision", WORD, pin=key, timeout_s=10)
        assert console.host_key == key
        console.run(
            '/user add name=other group=full password="secret \\$1"', timeout_s=10, secrets=[Secret("secret $1")]
        )
        console.close()
    assert "secret" not in caplog.text
    assert WORD.reveal() not in caplog.text
    again = open_ssh(host, port, "other", Secret("secret $1"), pin=key, timeout_s=10)
    assert again.rows("/ip/address")[0]["address"] == "10.64.101.1/24"
    again.close()


def test_a_closed_session_undoes_safe_mode(site: RunningSite) -> None:
    host, port, key = where(site)
    before = site.do("box", "export", header=False)
    console = open_ssh(host, port, "provision", WORD, pin=key, timeout_s=10)
    console.take_safe_mode()
    console.run("/ip address add address=10.0.0.1/24 interface=ether1", timeout_s=10)
    assert site.do("box", "export", header=False) != before
    console.close()
    again = open_ssh(host, port, "provision", WORD, pin=key, timeout_s=10)
    while "10.0.0.1" in again.run("/export", timeout_s=10):
        pass
    again.close()
    assert site.do("box", "export", header=False) == before


def test_wrong_password_is_reported_without_the_password(site: RunningSite) -> None:
    host, port, key = where(site)
    with pytest.raises(ConsoleLoginError) as failed:
        open_ssh(host, port, "provision", Secret("guess"), pin=key, timeout_s=10)
    assert "guess" not in str(failed.value)


def test_dropped_connection_raises_console_lost(site: RunningSite) -> None:
    host, port, key = where(site)
    console = open_ssh(host, port, "provision", WORD, pin=key, timeout_s=10)
    site.do("box", "drop")
    with pytest.raises(ConsoleLost):
        console.run(":put 1", timeout_s=10)
    console.close()


def test_refused_connection_is_reported() -> None:
    with pytest.raises(ConsoleUnreachable, match="cannot open an SSH session"):
        open_ssh("127.0.0.1", 1, "provision", WORD, pin="SHA256:x", timeout_s=1)


def test_non_ssh_server_causes_no_traceback_on_the_screen() -> None:
    program = """
import socket, threading
from atlantis_netcfg.routeros.console.ssh import open_ssh
from atlantis_netcfg.routeros.console.types import ConsoleUnreachable
from atlantis_netcfg.core.secret import Secret
door = socket.create_server(("127.0.0.1", 0))
threading.Thread(target=lambda: door.accept()[0].close(), daemon=True).start()
try:
    open_ssh("127.0.0.1", door.getsockname()[1], "admin", Secret(""), pin="SHA256:x", timeout_s=10)
except ConsoleUnreachable as error:
    print(error)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert "cannot open an SSH session" in done.stdout
    assert done.stderr == ""


def test_file_is_uploaded_only_to_a_host_with_a_pinned_key(site: RunningSite, tmp_path: Path) -> None:
    host, port, key = where(site)
    source = tmp_path / "notes.txt"
    source.write_text("a line\n" * 10_000)
    seen: list[int] = []
    target = {"pin": key, "source": source, "name": "notes.txt"}
    upload(host, port, "provision", WORD, progress=lambda sent, _total: seen.append(sent), **target)  # type: ignore[arg-type]
    assert seen[-1] == 70_000
    console = open_ssh(host, port, "provision", WORD, pin=key, timeout_s=10)
    assert console.run(":put [/file get [find name=notes.txt] size]", timeout_s=10) == "70000"
    console.close()
    with pytest.raises(UnknownHostKey):
        upload(host, port, "provision", WORD, pin=None, source=source, name="notes.txt")
