"""The AT driver against a modem on a pty: readings from data cases, owners, silence, and what may be sent at all."""

import ast
import dataclasses
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml
from row_subtests import for_each_row

import atlantis_netcfg
from atlantis_netcfg.emulator.modem import AtModemSpec, RunningModem
from atlantis_netcfg.links.lte import LteReading, Registration, at
from atlantis_netcfg.links.lte import at as driver

DATA: dict[str, Any] = yaml.safe_load(Path(__file__).with_name("at_cases.yml").read_text(encoding="utf-8"))
HEARD: list[str] = []
"""Every line that came to an emulated modem during the tests of this file."""


@contextmanager
def modem(**said: Any) -> Iterator[RunningModem]:  # noqa: ANN401 (fields of ModemSpec)
    with RunningModem(AtModemSpec(**said)) as running:
        try:
            yield running
        finally:
            HEARD.extend(running.inputs)
            assert running.forbidden == []


@for_each_row("case", DATA["cases"], ids=lambda case: str(case["why"])[:60])
def test_readings(case: dict[str, Any]) -> None:
    spec = dict(case["modem"])
    if "noise" in spec:
        spec["noise"] = spec["noise"].encode("latin-1")
    expected = {field.name: None for field in dataclasses.fields(LteReading)} | DATA["base"] | case["reading"]
    with modem(**spec) as running:
        look = at.read(running.path)
        assert dataclasses.asdict(look.reading) == expected | {"state": Registration(expected["state"])}
        assert running.inputs[: len(at.READS)] == list(at.READS)
        assert look.commands == len(running.inputs)


def test_reading_twice_gives_the_same_result() -> None:
    with modem() as running:
        assert at.read(running.path) == at.read(running.path)


def test_silent_modem_is_reported() -> None:
    with modem(mute_after=4) as running, pytest.raises(at.AtSilent) as caught:
        at.read(running.path, answer_s=0.2)
    assert "no answer to AT+CGREG? within 0.2 s" in str(caught.value)


def test_disappeared_modem_is_reported() -> None:
    with modem(mute_after=0) as running:
        path = running.path
    with pytest.raises(at.AtUnreachable):
        at.read(path)


def test_port_in_use_is_left_alone() -> None:
    with modem() as running:
        holder = subprocess.Popen(
            [sys.executable, "-c", f"f = open({running.path!r}, 'rb', 0); print('open', flush=True); input()"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert holder.stdout is not None
        assert holder.stdout.readline() == "open\n"
        with pytest.raises(at.PortBusy, match=rf"process {holder.pid}\)"):
            at.read(running.path)
        assert running.inputs == []
        holder.communicate("\n")
        assert at.read(running.path).reading.state is Registration.REGISTERED_HOME


def test_a_lock_file_of_a_living_process_counts(tmp_path: Path) -> None:
    proc = tmp_path / "proc"
    (proc / "4711").mkdir(parents=True)
    (proc / "4711" / "comm").write_text("pppd\n")
    (tmp_path / "LCK..ttyUSB2").write_text("      4711\n")
    with pytest.raises(at.PortBusy, match=r"pppd, process 4711, by "):
        at.require_free("/dev/ttyUSB2", proc=proc, locks=(tmp_path,))
    (tmp_path / "LCK..ttyUSB2").write_text("      4712\n")
    at.require_free("/dev/ttyUSB2", proc=proc, locks=(tmp_path,))


def test_running_modem_manager_blocks_every_port(tmp_path: Path) -> None:
    program = tmp_path / "ModemManager"
    shutil.copy(shutil.which("cat") or "", program)
    with subprocess.Popen([program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(b"here\n")
        assert process.stdout.read(5) == b"here\n"
        with pytest.raises(at.PortBusy) as caught:
            at.require_free("/dev/ttyUSB2", locks=())
        process.communicate()
    assert f"(process {process.pid})" in str(caught.value)
    assert "driver: modemmanager" in str(caught.value.hint)
    at.require_free("/dev/ttyUSB2", locks=())


@pytest.mark.parametrize(
    "command",
    [
        *("AT+CFUN=1", "AT+COPS=0", 'AT+CPIN="1234"', "ATE0", "AT+CMEE=2", "AT+CGSN", "ATZ"),
        *("AT+CPIN?\rAT+CFUN=0", "at+csq"),
    ],
)
def test_non_read_command_is_refused_before_sending(command: str) -> None:
    with modem() as running:
        with at.AtModem(running.path) as opened, pytest.raises(at.CommandForbidden) as caught:
            opened.ask(command)
        assert "1234" not in str(caught.value)
        assert running.inputs == []


def test_allow_list_equals_the_commands_in_the_source() -> None:
    """Static: each text that looks like a command to a 4G modem, acoustic modems and emulators excluded."""
    package = Path(atlantis_netcfg.__file__).parent
    found: set[str] = set()
    for path in package.rglob("*.py"):
        if {"acoustic", "emulator"} & set(path.relative_to(package).parts):
            continue
        tree = ast.parse(path.read_text(encoding="utf-8"))
        found |= {
            node.value
            for node in ast.walk(tree)
            if isinstance(node, ast.Constant)
            and isinstance(node.value, str)
            and re.fullmatch(r"AT(?:[A-Z]\d?|[+^*$&#%].+)", node.value.strip(), re.IGNORECASE)
        }
    assert found == at.ALLOW_LIST


def test_only_place_that_writes_to_the_port_checks_the_command() -> None:
    driver_file = Path(driver.__file__)
    writes = [
        (path, node.lineno)
        for path in (driver_file,)
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Attribute) and node.attr in ("write", "writelines", "sendall")
    ]
    assert [path for path, _ in writes] == [driver_file]
    lines = driver_file.read_text(encoding="utf-8").splitlines()
    before = "\n".join(lines[: writes[0][1]])
    assert before.index("data = require_allowed(command)") < before.index("port.write(data)")


def test_allow_list_contains_only_reads() -> None:
    documented = {'AT+QENG="servingcell"'}
    assert {command for command in at.ALLOW_LIST if "=" in command} <= documented
    assert not [command for command in at.ALLOW_LIST if re.match(r"AT\+(CGSN|CIMI|CCID|ICCID|QCCID)", command)]


def test_all_recorded_commands_are_allowed() -> None:
    """Dynamic: the recorder at the port during all tests of this file that ran in this process."""
    with modem() as running:
        at.read(running.path)
    assert set(HEARD) <= at.ALLOW_LIST
    assert set(at.READS) <= set(HEARD)


def test_terminal_of_another_container_does_not_block_ours() -> None:
    """Each has its own numbering: what holds `/dev/pts/0` in there does not hold ours."""
    if os.geteuid() != 0:
        pytest.skip("making a mount namespace needs root")
    mount = "mount -t devpts -o newinstance,ptmxmode=0666 none /dev/pts && exec "
    with RunningModem(AtModemSpec()) as running:
        hold = (
            f"import os\nwhile os.ttyname(os.openpty()[1]) != {running.path!r}: pass\nprint('up', flush=True)\ninput()"
        )
        inside = ["unshare", "--mount", "sh", "-c", f"{mount} {shlex.join([sys.executable, '-c', hold])}"]
        with subprocess.Popen(inside, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            assert process.stdout.readline() == "up\n"
            at.require_free(running.path, locks=())
            process.kill()
