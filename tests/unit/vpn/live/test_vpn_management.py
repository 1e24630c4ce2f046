"""The conversation with OpenVPN's management socket: whole, in single bytes, interrupted, silent, and hostile."""

import contextlib
import socket
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils import vpn_management
from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.vpn_management import (
    ConnectionEnd,
    IncompleteStatus,
    ManagementBusy,
    ManagementSocket,
    ServerDown,
    open_socket,
    parse_status_time,
    sessions,
)

GREETING = ">INFO:OpenVPN Management Interface Version 5 -- type 'help' for more info\r\n"
NOTICES = ">LOG:1700000000,I,MULTI: something\r\n>CLIENT:ESTABLISHED,7\r\n>BYTECOUNT_CLI:7,10,20\r\n"
# Of OpenVPN 2.6.14, with an address of the documentation.
HEADER = (
    "HEADER\tCLIENT_LIST\tCommon Name\tReal Address\tVirtual Address\tVirtual IPv6 Address\tBytes Received\tBytes Sent"
    "\tConnected Since\tConnected Since (time_t)\tUsername\tClient ID\tPeer ID\tData Channel Cipher"
)
ROW = (
    "CLIENT_LIST\tiqua-d0\t192.0.2.7:40000\t10.80.17.1\t\t2706\t2372\t2026-11-22 06:56:58\t1795330618\tUNDEF\t7\t0\tAES"
)
STATUS = f"""TITLE\tOpenVPN 2.6.14\r
TIME\t2026-11-22 07:00:00\t1795330800\r
{HEADER}\r
{ROW}\r
HEADER\tROUTING_TABLE\tVirtual Address\tCommon Name\tReal Address\tLast Ref\tLast Ref (time_t)\r
ROUTING_TABLE\t10.80.17.1\tiqua-d0\t192.0.2.7:40000\t2026-11-22 06:57:00\t1795330620\r
GLOBAL_STATS\tMax bcast/mcast queue length\t0\r
END\r
"""
SESSION = {
    "cid": 7,
    "common_name": "iqua-d0",
    "real": "192.0.2.7:40000",
    "virtual": "10.80.17.1",
    "since": 1795330618,
    "received": 2706,
    "sent": 2372,
}


@contextmanager
def served(
    *replies: str, single: bool = False, patience_s: float = 5.0
) -> Iterator[tuple[ManagementSocket, list[str]]]:
    """A server that greets, and gives one reply to each command; without one more it closes."""
    here, there = socket.socketpair()
    heard: list[str] = []

    def serve() -> None:
        with closing(there), contextlib.suppress(OSError):
            said(there, GREETING)
            lines = there.makefile()
            for reply in replies:
                heard.append(lines.readline())
                said(there, reply)

    def said(to: socket.socket, text: str) -> None:
        data = text.encode()
        for piece in [data[at : at + 1] for at in range(len(data))] if single else [data]:
            to.sendall(piece)

    thread = threading.Thread(target=serve)
    thread.start()
    with closing(here):
        yield ManagementSocket(here, patience_s), heard
    thread.join()


@pytest.mark.parametrize("single", [False, True], ids=["whole", "bytewise"])
@pytest.mark.parametrize("notices", ["", NOTICES], ids=["quiet", "notices"])
def test_management_dialogue(single: bool, notices: str) -> None:  # noqa: FBT001 - a case
    replies = (
        notices + STATUS.replace(ROW, f"{ROW}\r\n{notices.rstrip()}" if notices else ROW),
        notices + "SUCCESS: client-kill command succeeded\r\n" + notices,
        notices + "ERROR: client at address 192.0.2.7:40000 not found\r\n",
    )
    with served(*replies, single=single) as (management, heard):
        management.wait_for_greeting()
        assert management.sessions() == [SESSION]
        assert management.halt(7) == "SUCCESS: client-kill command succeeded"
        assert management.kill("192.0.2.7:40000").startswith("ERROR: ")
    assert heard == ["status 3\n", "client-kill 7 HALT\n", "kill 192.0.2.7:40000\n"]


@pytest.mark.parametrize("real", ["192.0.2.7:1\nkill x", "iqua-d0", "", "192.0.2.7", "a b:1", "192.0.2.7:1\n", "x;y:1"])
def test_kill_accepts_only_an_address(real: str) -> None:
    with served() as (management, heard), pytest.raises(ValueError, match="not the address and port of a client"):
        management.kill(real)
    assert heard == []


def test_halt_accepts_only_a_session_number() -> None:
    with served() as (management, _), pytest.raises(ValueError, match="invalid literal"):
        management.halt("7 HALT\nkill all")  # type: ignore[arg-type] # what must not come this far


def test_unserved_connection_times_out(tmp_path: Path) -> None:
    path = str(tmp_path / "management.sock")
    with closing(socket.socket(socket.AF_UNIX)) as server:
        server.bind(path)
        server.listen(1)
        with (
            open_socket(path, 0.05) as management,
            pytest.raises(ManagementBusy, match=r"not responded for 0\.05 s"),
        ):
            management.wait_for_greeting()
    with pytest.raises(ServerDown, match="no server listens on"), open_socket(path, 0.05):
        pass
    with pytest.raises(ServerDown, match="no server listens on"), open_socket(str(tmp_path / "none"), 0.05):
        pass


def test_full_backlog_is_reported_as_busy(tmp_path: Path) -> None:
    path = str(tmp_path / "management.sock")
    with contextlib.ExitStack() as stack:
        server = stack.enter_context(closing(socket.socket(socket.AF_UNIX)))
        server.bind(path)
        server.listen(0)
        waiting = stack.enter_context(closing(socket.socket(socket.AF_UNIX)))
        waiting.connect(path)
        with pytest.raises(ManagementBusy, match="refuses the connection:"), open_socket(path, 0.05):
            pass


def test_socket_path_that_is_too_long_is_shortened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / ("a" * 100)
    folder.mkdir()
    monkeypatch.chdir(folder)
    with closing(socket.socket(socket.AF_UNIX)) as server:
        server.bind("s")
        server.listen(1)
        with open_socket(str(folder / "s"), 1):
            pass
    assert vpn_management._short("/run/s") == "/run/s"


@pytest.mark.parametrize("replies", [(), (STATUS[:200],), (NOTICES,)], ids=["at once", "in a reply", "before a reply"])
def test_closed_management_socket_is_reported(replies: tuple[str, ...]) -> None:
    with served(*replies) as (management, _):
        management.wait_for_greeting()
        with pytest.raises(ConnectionEnd, match="closed its management socket"):
            management.sessions()


def test_server_refusing_its_status_is_reported() -> None:
    with served("ERROR: unknown command\r\n") as (management, _):
        management.wait_for_greeting()
        with pytest.raises(ConnectionEnd, match="unknown command"):
            management.sessions()


def test_columns_are_located_by_name() -> None:
    header = (
        "HEADER\tCLIENT_LIST\tClient ID\tNew\tCommon Name\tBytes Sent\tBytes Received\tConnected Since (time_t)"
        "\tVirtual Address\tReal Address"
    )
    row = "CLIENT_LIST\t7\tx\tiqua-d0\t2372\t2706\t1795330618\t10.80.17.1\t192.0.2.7:40000"
    lines = [header, row, "END"]
    assert sessions(lines) == [SESSION]
    assert sessions([HEADER, "END"]) == []
    assert (parse_status_time(STATUS.splitlines()), parse_status_time([]), parse_status_time(["TIME\tx"])) == (
        1795330800,
        0,
        0,
    )


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ([], "no header"),
        (["END"], "no header"),
        ([ROW, "END"], "does not match its header:"),
        ([HEADER, ROW + "\tmore", "END"], "does not match its header:"),
        ([HEADER, ROW.rpartition("\t")[0], "END"], "does not match its header:"),
        ([HEADER, ROW], "the status is incomplete"),
        ([HEADER, ROW.replace("\t7\t", "\tseven\t"), "END"], "is invalid:"),
        ([HEADER.replace("Client ID", "Number"), ROW, "END"], "a row of CLIENT_LIST is invalid: 'Client ID'"),
    ],
)
def test_incomplete_status_is_refused(lines: list[str], words: str) -> None:
    with pytest.raises(IncompleteStatus, match=words):
        sessions(lines)
