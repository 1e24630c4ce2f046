"""netmiko's driver for RouterOS, unchanged: prompts, commands, safe mode, first login, files, a slow link."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from netmiko import BaseConnection, ConnectHandler, NetmikoAuthenticationException, file_transfer
from shell_site import PASSWORD, Twin, paramiko_on, twin
from waiting import HANG_S

from atlantis_netcfg.emulator.routeros import RouterLink


@contextmanager
def netmiko_on(box: Twin, **options: Any) -> Iterator[BaseConnection]:  # noqa: ANN401 (netmiko's own)
    wanted = {"port": box.port, "username": "admin", "password": PASSWORD, **options}
    connection = ConnectHandler(device_type="mikrotik_routeros", host="127.0.0.1", **wanted)
    try:
        yield connection
    finally:
        connection.disconnect()


@pytest.mark.parametrize("version", ["6.49.10", "7.18.2"])
def test_commands(tmp_path: Path, version: str) -> None:
    with twin(tmp_path, version=version) as box, netmiko_on(box) as connection:
        assert connection.find_prompt() == "[admin@MikroTik] >"
        for _ in range(2):
            assert connection.send_command("/system identity print") == "name: MikroTik"
            assert "RB5009UPr+S+" in connection.send_command("/system routerboard print")
            assert "10.64.101.1/24" in connection.send_command("/ip address print")
        assert connection.send_command("/ip adress print") == "bad command name adress (line 1 column 5)"
        export = str(connection.send_command("/export"))
        assert [line.rstrip() for line in export.splitlines()[1:]] == (
            box.export(show_sensitive=version.startswith("6.")).splitlines()[1:]
        )


def test_config_set(tmp_path: Path) -> None:
    lines = [f"/ip pool add name=p{number} ranges=10.0.0.{number}" for number in range(1, 11)]
    with twin(tmp_path) as box, netmiko_on(box) as connection:
        connection.send_config_set(lines)
        assert len(box.rows("/ip/pool/print")) == len(lines)
        shown = connection.send_config_set(lines[:1])
        assert len(box.rows("/ip/pool/print")) == len(lines)
        assert "p1" in shown


def test_as_value_in_one_line(tmp_path: Path) -> None:
    with twin(tmp_path) as box, netmiko_on(box) as connection:
        shown = str(connection.send_command(":put [/ip/address/print detail as-value]"))
        assert shown.startswith(".id=*1;address=10.64.101.1/24;")
        assert "\n" not in shown
        assert box.rows("/ip/address/print")


def test_safe_mode_before_7_18(tmp_path: Path) -> None:
    with twin(tmp_path, version="7.16", unroll_delay_s=0.0) as box:
        before = box.export(header=False)
        with netmiko_on(box) as connection:
            connection.write_channel("\x18")
            assert "[Safe Mode taken]" in connection.read_until_pattern("<SAFE>")
            connection.send_command_timing("/ip pool add name=s ranges=10.0.0.1")
            assert box.export(header=False) != before
            assert connection.remote_conn is not None
            connection.remote_conn.close()  # a clean end, and no /quit
            connection.cleanup = lambda *_: None  # type: ignore[method-assign]
        with netmiko_on(box) as connection:
            assert "<SAFE>" not in connection.find_prompt()
        assert box.export(header=False) == before


def test_first_login(tmp_path: Path) -> None:
    laptop = {"address": "192.168.88.1/24", "port": "ether2", "technician": "192.168.88.10"}
    with twin(tmp_path, factory=True, first_contact=laptop) as box:
        for _ in range(2):
            with netmiko_on(box, port=box.info["first_contact"]["ports"]["22"]) as connection:
                assert connection.find_prompt() == "[admin@MikroTik] >"
                assert "192.168.88.1/24" in connection.send_command("/ip address print")
        box.do("restart")
        with netmiko_on(box, port=box.info["first_contact"]["ports"]["22"]) as connection:
            assert connection.send_command("/system identity print") == "name: MikroTik"


def test_wrong_password(tmp_path: Path) -> None:
    with twin(tmp_path) as box, pytest.raises(NetmikoAuthenticationException), netmiko_on(box, password="wrong"):
        pass
    assert box


def test_file_transfer(tmp_path: Path) -> None:
    source = tmp_path / "source.txt"
    source.write_text("x" * 5000)
    with twin(tmp_path / "state") as box, netmiko_on(box) as connection:
        with paramiko_on(box) as client:
            client.open_sftp().mkdir("flash")
        for _ in range(2):
            done = file_transfer(
                connection,
                source_file=str(source),
                dest_file="there.txt",
                file_system="flash",
                direction="put",
                disable_md5=True,
                overwrite_file=True,
            )
            assert done["file_exists"]
            assert done["file_transferred"]
        assert any("=name=flash/there.txt" in row for row in box.rows("/file/print"))


@pytest.mark.slow
def test_over_a_satellite_link(tmp_path: Path) -> None:
    link = RouterLink(delay_s=0.35, rate_up_bps=352_000, rate_down_bps=704_000)
    with (
        twin(tmp_path, link=link) as box,
        netmiko_on(box, conn_timeout=HANG_S, banner_timeout=HANG_S, auth_timeout=HANG_S) as nm,
    ):
        assert nm.send_command("/system identity print", read_timeout=HANG_S) == "name: MikroTik"
        assert "10.64.101.1/24" in nm.send_command("/ip address print", read_timeout=HANG_S)
        nm.send_config_set(["/ip pool add name=far ranges=10.0.0.1"], read_timeout=HANG_S)
        assert len(box.rows("/ip/pool/print")) == 1
