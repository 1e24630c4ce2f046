"""The program as a whole: Python 3.8 alone, small, and no question takes another one with it."""

import ast
import json
import os
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest
from ear_stand import ENOUGH_S, asked, asked_apart, listen, served, until_gone
from waiting import HANG_S

from atlantis_netcfg.checklist import probes
from atlantis_netcfg.checklist.probes.agent import BOOT, MODULES, _sources, batch, main, program, read_result
from atlantis_netcfg.checklist.probes.agent.streams import ProbeError

MOST = 10_000
"""Bytes of the program without questions, which travel once a turn; a satellite link takes them in 0.2 s."""


def run(*argv: str, name: str = "it", within_s: float = ENOUGH_S) -> probes.RunProgram:
    return probes.RunProgram(name, probes.Place.LAPTOP, argv, within_s)


@pytest.mark.parametrize(("name", "text"), _sources(), ids=MODULES)
def test_program_needs_only_python_3_8_and_standard_library(name: str, text: str) -> None:
    tree = ast.parse(text, feature_version=(3, 8))
    compile(text, name, "exec")
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            assert {alias.name.partition(".")[0] for alias in node.names} <= sys.stdlib_module_names
        if isinstance(node, ast.ImportFrom):
            module = node.module or ""
            earlier = {other for other, _ in _sources()[: [one for one, _ in _sources()].index(name)]}
            assert module in earlier or module.partition(".")[0] in sys.stdlib_module_names, module


@pytest.mark.parametrize(("name", "text"), _sources(), ids=MODULES)
def test_minified_program_equals_its_source(name: str, text: str) -> None:
    path = Path(main.__file__).with_name(f"{name.rpartition('.')[2]}.py")
    ours, theirs = (ast.parse(source) for source in (path.read_text(), text))
    for tree in (ours, theirs):
        for node in ast.walk(tree):
            if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
                node.value.value = ""
    assert ast.dump(ours) == ast.dump(theirs)


def test_program_is_small() -> None:
    assert len(program({"questions": [], "deadline_s": 0})) < MOST


def test_program_answers_every_kind_of_request() -> None:
    def serve(client: socket.socket) -> None:
        client.recv(100)
        client.sendall(b"\x00\xffanswer\r\n")
        until_gone(client)

    with served(serve) as port:
        told = asked_apart(
            listen(port, name="tcp", say=(probes.Say(b"?\n", rb"\n", ENOUGH_S),)),
            run("env", name="run"),
            run("no-such-program", name="missing"),
            probes.DhcpDiscoverRequest("dhcp", probes.Place.LAPTOP, "no-such-interface"),
        )
    assert told.keys() == {"tcp", "run", "missing", "dhcp"}
    tcp, ran = told["tcp"], told["run"]
    assert isinstance(tcp, probes.Transcript)
    assert tcp.data == b"\x00\xffanswer\r\n"
    assert isinstance(ran, probes.CommandResult)
    assert dict(line.split("=", 1) for line in ran.out.splitlines()).keys() == {"PATH", "LC_ALL"}
    assert (ran.request_time, ran.response_time) == (1.0, 2.0)
    assert (told["dhcp"].trouble, told["dhcp"].words) == (
        probes.Trouble.MISSING,
        "this computer has no interface no-such-interface",
    )
    assert (told["missing"].trouble, told["missing"].words) == (
        probes.Trouble.MISSING,
        "no-such-program: No such file or directory",
    )


def test_output_and_exit_code_of_a_program_are_returned() -> None:
    told = asked(run("sh", "-c", "echo out; echo err >&2; exit 3"))["it"]
    assert isinstance(told, probes.CommandResult)
    assert (told.trouble, told.rc, told.out, told.err) == (None, 3, "out\n", "err\n")


def test_program_that_cannot_run_is_reported(tmp_path: Path) -> None:
    program = tmp_path / "program"
    program.touch(mode=0o600)
    told = asked(run(str(program)))["it"]
    assert (told.trouble, told.words) == (probes.Trouble.DENIED, f"{program}: Permission denied")
    program.chmod(0o700)
    program.write_text("no program")
    assert asked(run(str(program)))["it"].trouble is probes.Trouble.MISSING


def test_hanging_program_is_killed_with_its_children(tmp_path: Path) -> None:
    child = tmp_path / "child"
    told = asked(run("sh", "-c", f"echo so far; sleep 600 & echo $! >{child}; wait", within_s=1.0))["it"]
    assert isinstance(told, probes.CommandResult)
    assert (told.trouble, told.out) == (probes.Trouble.SILENT, "so far\n")
    assert told.words == "sh did not end within 1 s"
    assert ended(int(child.read_text()))


def ended(pid: int) -> bool:
    """Whether a process ends that was killed: a zombie has, even if nobody has asked for it."""
    until = time.monotonic() + HANG_S
    while time.monotonic() < until:
        try:
            if ") Z " in Path(f"/proc/{pid}/stat").read_text():
                return True
        except OSError:
            return True
        time.sleep(0.01)
    return False


def test_crashed_or_hanging_request_does_not_lose_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    def crash(_asked: dict[str, Any]) -> dict[str, Any]:
        raise ZeroDivisionError("division by zero")

    monkeypatch.setitem(main._OTHERS, "dhcp", crash)

    def serve(client: socket.socket) -> None:
        client.sendall(b"something")
        over.wait()

    over = threading.Event()
    crashes = probes.DhcpDiscoverRequest("crashes", probes.Place.LAPTOP, "eth0")
    with served(serve) as port:
        hangs, waits = (listen(port, name=name, listen_s=ENOUGH_S) for name in ("hangs", "waits"))
        made = batch([("hangs", hangs), ("waits", waits), ("runs", run("true", name="runs")), ("crashes", crashes)])
        told: dict[str, Any] = {}
        main.answer_all({**made.request, "deadline_s": 1.0}, lambda key, said: told.update({key: said}))
        over.set()
    assert told.keys() == {"hangs", "waits", "runs", "crashes"}
    with pytest.raises(
        RuntimeError, match=r"the program that listens failed: ZeroDivisionError: division by zero \(.*line \d+\)$"
    ):
        read_result(told["crashes"], crashes, 0, 0)
    assert told["runs"]["rc"] == 0
    so_far = read_result(told["hangs"], hangs, 0, 0)
    assert isinstance(so_far, probes.Transcript)
    assert (so_far.trouble, so_far.words, so_far.data) == (probes.Trouble.SILENT, "timed out", b"something")
    assert told["waits"] == {"trouble": "silent", "words": "timed out"}


def test_program_stops_when_its_reader_is_gone() -> None:
    feed = program(batch([("a", run("true", name="a")), ("b", run("sleep", "600", name="b", within_s=600))]).request)
    reading, writing = os.pipe()
    os.close(reading)
    with subprocess.Popen([sys.executable, "-I", "-c", BOOT], stdin=subprocess.PIPE, stdout=writing) as process:
        os.close(writing)
        process.communicate(feed)
    assert process.returncode == 1


def test_request_order_and_time_limit() -> None:
    questions: dict[str, probes.Question] = {
        "runs": run("true", name="runs", within_s=2),
        "a": listen(1, name="a", connect_s=1, listen_s=5),
        "b": listen(2, name="b", connect_s=1, listen_s=5),
        "a again": listen(1, name="a again", connect_s=1, say=(probes.Say(b"?", b".", 3),), turn="water"),
        "b again": listen(2, name="b again", connect_s=1, say=(probes.Say(b"?", b".", 3),), turn="water"),
        "apart": listen(3, name="apart", connect_s=1, turn="air"),
    }
    made = batch(list(questions.items()))
    assert {row["key"]: row["after"] for row in made.request["questions"]} == {
        "runs": [],
        "a": [],
        "b": [],
        "a again": [1],
        "b again": [2, 3],
        "apart": [],
    }
    assert made.within_s == 6 + 1 + 4 + 1 + 4 + 1
    assert batch([]).within_s == 1


def test_unreachable_end_is_not_contacted_again(monkeypatch: pytest.MonkeyPatch) -> None:
    knocks = []

    def knock(row: dict[str, Any], _sound: object) -> None:
        knocks.append(row["key"])
        trouble = "unreachable" if row["port"] == 1 else "refused"
        raise ProbeError(trouble, f"port {row['port']}")

    monkeypatch.setitem(main._STREAMS, "tcp", knock)
    told = asked(*(listen(port, name=f"{port}{name}") for port in (1, 2) for name in "abc"))
    assert sorted(knocks) == ["1a", "2a", "2b", "2c"]
    assert {name: (one.trouble, one.words) for name, one in told.items()} == {
        **{f"1{name}": (probes.Trouble.UNREACHABLE, "port 1") for name in "abc"},
        **{f"2{name}": (probes.Trouble.REFUSED, "port 2") for name in "abc"},
    }


@pytest.mark.parametrize(
    "question",
    [probes.LinkStatusRequest("l", "satellite"), probes.RouterOsQuery("a", "router", None)],  # type: ignore[arg-type]
)
def test_request_of_another_place_is_refused(
    question: probes.LinkStatusRequest | probes.RouterOsQuery,
) -> None:
    with pytest.raises(ValueError, match="is no question of the program that listens"):
        batch([("it", question)])


def test_requests_are_json() -> None:
    made = batch([("it", listen(9200, say=(probes.Say(b"+++AT?S\n\xff", rb"\r\n\xfe"),), enough=rb"\x00"))])
    assert json.loads(json.dumps(made.request)) == made.request
