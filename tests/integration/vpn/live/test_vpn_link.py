"""The way to the server: the tool goes over once, requests one round trip each, and what can break is told."""

import asyncio
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import asyncssh
import pytest
from live_stand import NAME, Computer
from local_link import LocalLink

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils import vpn_serve
from atlantis_netcfg.core.processes.remote_bundle import build_live
from atlantis_netcfg.operations.computers import remote_session as link_module
from atlantis_netcfg.operations.computers.remote_session import (
    FOLDER,
    AnswerLost,
    HostKeyMismatch,
    ServerAway,
    ServerRefusal,
    SshLink,
)
from atlantis_netcfg.operations.vpn.server_state import PLACE

pytestmark = pytest.mark.namespace

START, SENT, ASKED = 1, 1, 1
"""Round trips."""


@pytest.fixture(scope="module")
def computer() -> Iterator[Computer]:
    with ExitStack() as stack:
        yield Computer(stack)


def asked(link: LocalLink | SshLink) -> dict[str, Any]:
    return link.ask("sessions", place=dict(PLACE))


def test_tool_is_sent_once_and_resent_if_incomplete(computer: Computer) -> None:
    path = f"{FOLDER}/{build_live().sha256}.pyz"
    computer.run("rm", "-rf", FOLDER)
    with LocalLink(NAME, computer.enter) as link:
        assert asked(link)["management"] == "down"
        assert link.round_trips == START + SENT + ASKED
        asked(link)
        assert link.round_trips == START + SENT + 2 * ASKED
    for harm, trips in (("true", START + ASKED), (f"truncate -s 999 {path}", START + SENT + ASKED)):
        computer.run("sh", "-c", harm)
        with LocalLink(NAME, computer.enter) as link:
            asked(link)
            assert link.round_trips == trips
    assert computer.run("ls", FOLDER).split() == [path.rpartition("/")[2]]
    assert computer.at(path).read_bytes() == build_live().content


def test_computer_that_is_no_vpn_server_is_reported(computer: Computer) -> None:
    with LocalLink(NAME, computer.enter) as link:
        with pytest.raises(ServerRefusal, match="no VPN server was ever set up on this computer") as refused:
            link.ask("push", place=dict(PLACE), files=[], only=[])
        assert "provision site=" in str(refused.value.hint)
        with pytest.raises(AnswerLost, match="failed there at `nonsense`: KeyError"):
            link.ask("nonsense", place=dict(PLACE))
        assert asked(link)["sessions"] == []


@pytest.mark.parametrize("cut", ["exit", "half"])
def test_incomplete_response_counts_as_lost(computer: Computer, cut: str) -> None:
    said = {"exit": "", "half": f"{vpn_serve.MARK}eJwrS\\n"}[cut]
    computer.put(
        "/usr/local/sbin/python3", f"#!/bin/sh\nprintf '{vpn_serve.MARK}hello\\n'\nread x\nprintf '{said}'\n", 0o755
    )
    try:
        with LocalLink(NAME, computer.enter) as link, pytest.raises(AnswerLost, match="before a response to `sess"):
            asked(link)
    finally:
        computer.at("/usr/local/sbin/python3").unlink()


@pytest.mark.parametrize(
    ("script", "words"),
    [
        (f"printf '\\n{link_module._ASKS}3 6\\n'; cat >/dev/null", "has Python 3.6, but at least 3.8"),
        ("echo 'cannot start' >&2; exit 9", r"did not start \(exit 9\): cannot start"),
    ],
)
def test_unusable_python_is_reported(computer: Computer, script: str, words: str) -> None:
    computer.put("/usr/local/sbin/python3", f"#!/bin/sh\n{script}\n", 0o755)
    try:
        with LocalLink(NAME, computer.enter) as link, pytest.raises(ServerAway, match=words):
            asked(link)
    finally:
        computer.at("/usr/local/sbin/python3").unlink()


def test_unwritable_tool_folder_is_reported(computer: Computer) -> None:
    computer.run("rm", "-rf", FOLDER)
    computer.put(FOLDER, "in the way")
    try:
        with LocalLink(NAME, computer.enter) as link, pytest.raises(ServerRefusal, match=FOLDER):
            asked(link)
    finally:
        computer.at(FOLDER).unlink()


@contextmanager
def served(computer: Computer, folder: Path) -> Iterator[dict[str, Any]]:
    """An SSH server whose commands run on that computer; gives how it is reached."""
    host, user = (asyncssh.generate_private_key("ssh-ed25519") for _ in range(2))
    host.write_public_key(folder / "host.pub")
    user.write_private_key(folder / "key")
    (folder / "key").chmod(0o600)
    loop = asyncio.new_event_loop()

    async def process(made: asyncssh.SSHServerProcess[bytes]) -> None:
        started = await asyncio.create_subprocess_exec(
            *computer.enter,
            *("sh", "-c", f"echo Welcome aboard; {made.command}"),
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
        )
        assert started.stdin is not None
        assert started.stdout is not None

        async def say() -> None:
            while data := await made.stdin.read(65536):
                started.stdin.write(data)  # type: ignore[union-attr] # asserted above
            started.stdin.close()  # type: ignore[union-attr] # as above

        saying = asyncio.ensure_future(say())
        while data := await started.stdout.read(65536):
            made.stdout.write(data)
        made.exit(await started.wait())
        await saying

    async def serve() -> asyncssh.SSHAcceptor:
        return await asyncssh.listen(
            "127.0.0.1", 0, server_host_keys=[host], process_factory=process, encoding=None,
            authorized_client_keys=asyncssh.import_authorized_keys(user.export_public_key().decode()),
        )  # fmt: skip

    thread = threading.Thread(target=loop.run_forever)
    thread.start()
    acceptor = asyncio.run_coroutine_threadsafe(serve(), loop).result()
    (folder / "known").write_text(f"{NAME} {host.export_public_key().decode()}")
    options = f"-F none -o HostKeyAlias={NAME} -o StrictHostKeyChecking=yes -o UserKnownHostsFile={folder / 'known'}"
    try:
        yield {
            "host": "127.0.0.1",
            "port": acceptor.get_port(),
            "user": "root",
            "become": False,
            "ssh_args": f"{options} -o IdentityFile={folder / 'key'} -o IdentitiesOnly=yes",
        }
    finally:
        acceptor.close()
        asyncio.run_coroutine_threadsafe(acceptor.wait_closed(), loop).result()
        loop.call_soon_threadsafe(loop.stop)
        thread.join()
        loop.close()


def test_link_over_ssh_works_and_reports_failures(
    computer: Computer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ANSIBLE_SSH_ARGS", "-o ControlMaster=no")
    computer.run("rm", "-rf", FOLDER)
    with served(computer, tmp_path) as access:
        with SshLink(NAME, access) as link:
            assert asked(link)["management"] == "down"
            assert link.round_trips == START + SENT + ASKED
        (tmp_path / "known").write_text(
            f"{NAME} {asyncssh.generate_private_key('ssh-ed25519').export_public_key().decode()}"
        )
        with SshLink(NAME, access) as link, pytest.raises(HostKeyMismatch, match="so nothing was sent to it"):
            asked(link)
    with SshLink(NAME, access) as link, pytest.raises(ServerAway, match=r"was not reached .*Connection refused"):
        asked(link)
