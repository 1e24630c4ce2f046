"""The ModemManager driver over a real D-Bus daemon, with python-dbusmock in ModemManager's place."""

import dataclasses
import json
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml
from jeepney import DBusAddress, MessageType, new_method_call
from jeepney.io.blocking import open_dbus_connection
from waiting import HANG_S

from atlantis_netcfg.links.lte import LteReading, Registration
from atlantis_netcfg.links.lte.modemmanager import MmUnreachable, read

HERE = Path(__file__).parent
CASES: list[dict[str, Any]] = yaml.safe_load((HERE / "mm_cases.yml").read_text(encoding="utf-8"))
MM = "org.freedesktop.ModemManager1"
MODEM_PATH, BEARER_PATH = "/org/freedesktop/ModemManager1/Modem/0", "/org/freedesktop/ModemManager1/Bearer/0"


@contextmanager
def bus(folder: Path) -> Iterator[str]:
    """A D-Bus daemon of our own; gives its address."""
    address = f"unix:path={folder}/bus"
    daemon = subprocess.Popen(
        ["dbus-daemon", "--session", "--nofork", "--nopidfile", f"--address={address}", "--print-address"],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert daemon.stdout is not None
        assert daemon.stdout.readline().startswith(address)
        yield address
    finally:
        daemon.terminate()
        daemon.communicate()


@contextmanager
def manager(folder: Path, objects: dict[str, Any]) -> Iterator[tuple[str, Path]]:
    """ModemManager on a bus of its own; gives the bus' address and the log of calls."""
    log = folder / "calls"
    with bus(folder) as address:
        mock = subprocess.Popen(
            [
                *("/usr/bin/python3", "-m", "dbusmock", "--logfile", str(log)),
                *("--template", str(HERE / "mm_template.py"), "--parameters", json.dumps(objects)),
            ],
            env={"DBUS_SYSTEM_BUS_ADDRESS": address, "PATH": "/usr/bin:/bin"},
        )
        try:
            _wait_for_name(address, mock)
            yield address, log
        finally:
            mock.terminate()
            mock.wait()


def _wait_for_name(address: str, mock: subprocess.Popen[bytes]) -> None:
    """Until the name is owned and its first answer has come."""
    ask = DBusAddress("/org/freedesktop/DBus", bus_name="org.freedesktop.DBus", interface="org.freedesktop.DBus")
    with open_dbus_connection(address) as connection:
        while mock.poll() is None:
            reply = connection.send_and_get_reply(new_method_call(ask, "NameHasOwner", "s", (MM,)), timeout=HANG_S)
            if reply.body[0]:
                break
        manager = DBusAddress("/org/freedesktop/ModemManager1", bus_name=MM, interface=f"{MM}")
        reply = connection.send_and_get_reply(new_method_call(manager, "ScanDevices"), timeout=HANG_S)
        while reply.header.message_type is MessageType.error and mock.poll() is None:
            reply = connection.send_and_get_reply(new_method_call(manager, "ScanDevices"), timeout=HANG_S)
    assert mock.poll() is None


def objects_of(case: dict[str, Any]) -> dict[str, Any]:
    modem = dict(case["modem"]) | ({"Bearers": [BEARER_PATH]} if "bearer" in case else {"Bearers": []})
    interfaces = {f"{MM}.Modem": modem}
    interfaces |= {f"{MM}.Modem.Modem3gpp": case["network"]} if "network" in case else {}
    interfaces |= {f"{MM}.Modem.Signal": case["signal"]} if "signal" in case else {}
    bearer = {BEARER_PATH: {f"{MM}.Bearer": case["bearer"]}} if "bearer" in case else {}
    return {MODEM_PATH: interfaces} | bearer


@pytest.mark.parametrize("case", CASES, ids=lambda case: str(case["why"])[:60])
def test_readings(case: dict[str, Any], tmp_path: Path) -> None:
    with manager(tmp_path, objects_of(case)) as (address, log):
        look = read(address)
        assert read(address) == look
        calls = log.read_text(encoding="utf-8")
    expected = {field.name: None for field in dataclasses.fields(LteReading)} | {"source": "modemmanager"}
    state = Registration(case["reading"]["state"])
    assert dataclasses.asdict(look.reading) == expected | case["reading"] | {"state": state}
    assert [finding.code for finding in look.findings] == case.get("findings", [])
    asked = {line.split()[1] for line in calls.splitlines() if line.split()} - {"ScanDevices"}
    assert asked <= {"GetManagedObjects", "GetAll"}
    assert "GetManagedObjects" in asked
    assert look.calls == 1 + ("bearer" in case)
    assert "356938035643809" not in repr(look)


def test_two_modems_are_refused_as_ambiguous(tmp_path: Path) -> None:
    modem = {f"{MM}.Modem": {"State": 8, "Bearers": []}}
    with (
        manager(tmp_path, {MODEM_PATH: modem, MODEM_PATH[:-1] + "1": modem}) as (address, _),
        pytest.raises(MmUnreachable, match="2 modems"),
    ):
        read(address)


def test_missing_modem_is_reported(tmp_path: Path) -> None:
    with manager(tmp_path, {}) as (address, _), pytest.raises(MmUnreachable, match="no modem"):
        read(address)


def test_stopped_modem_manager_is_not_started(tmp_path: Path) -> None:
    with bus(tmp_path) as address, pytest.raises(MmUnreachable) as caught:
        read(address)
    assert str(caught.value) == "ModemManager is not running on this computer"


def test_missing_dbus_is_reported(tmp_path: Path) -> None:
    with pytest.raises(MmUnreachable, match="no D-Bus"):
        read(f"unix:path={tmp_path}/nowhere")
