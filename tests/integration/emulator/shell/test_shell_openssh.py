"""The system's own ssh, sftp and scp, and the login flags that Ansible's collection uses, by hand."""

import os
import pty
import re
import select
import subprocess
from pathlib import Path

import paramiko
from shell_site import PASSWORD, Twin, paramiko_on, twin
from waiting import HANG_S

OPTIONS = ("-o", "StrictHostKeyChecking=yes", "-o", "PubkeyAuthentication=no", "-o", "LogLevel=ERROR")
ANSIBLE = re.compile(rb"\[[\w\-.]+@[\w\s\-./]+\] ?(<SAFE)?> ?$")


def known_hosts(box: Twin, tmp_path: Path) -> Path:
    file = tmp_path / "known_hosts"
    with paramiko.Transport(("127.0.0.1", box.port)) as transport:
        transport.start_client(timeout=HANG_S)
        key = transport.get_remote_server_key()
    file.write_text(f"[127.0.0.1]:{box.port} {key.get_name()} {key.get_base64()}\n")
    return file


def openssh(program: str, box: Twin, tmp_path: Path, *arguments: str, stdin: str = "") -> str:
    """What it prints; the password comes from a helper program, as no terminal is there to ask."""
    helper = tmp_path / "password"
    helper.write_text(f"#!/bin/sh\necho '{PASSWORD}'\n")
    helper.chmod(0o700)
    found = subprocess.run(
        [program, *OPTIONS, "-o", f"UserKnownHostsFile={known_hosts(box, tmp_path)}", *arguments],
        env=os.environ | {"SSH_ASKPASS": str(helper), "SSH_ASKPASS_REQUIRE": "force", "HOME": str(tmp_path)},
        input=stdin.encode(),
        capture_output=True,
        timeout=HANG_S,
        check=False,
        start_new_session=True,
    )
    assert found.returncode == 0, found.stderr
    return found.stdout.decode()


def test_one_command(tmp_path: Path) -> None:
    with twin(tmp_path / "state") as box:
        for _ in range(2):
            shown = openssh("ssh", box, tmp_path, "-p", str(box.port), "admin@127.0.0.1", "/system identity print")
            assert shown == "  name: MikroTik\r\n\r\n"


def test_console_without_a_terminal_sends_no_escapes(tmp_path: Path) -> None:
    with twin(tmp_path / "state") as box:
        script = '/ip pool add name=p ranges=10.0.0.1\n:put "done"\n/quit\n'
        shown = openssh("ssh", box, tmp_path, "-T", "-p", str(box.port), "admin@127.0.0.1", stdin=script)
        assert "done\r\n" in shown
        assert "\x1b" not in shown
        assert len(box.rows("/ip/pool/print")) == 1


def test_sftp_and_scp(tmp_path: Path) -> None:
    (tmp_path / "there").write_text("by sftp\n")
    with twin(tmp_path / "state") as box:
        batch = f"put {tmp_path / 'there'} there\nget there {tmp_path / 'back'}\n"
        openssh("sftp", box, tmp_path, "-P", str(box.port), "admin@127.0.0.1", stdin=batch)
        assert (tmp_path / "back").read_text() == "by sftp\n"
        for way in ("-s", "-O"):
            (tmp_path / "there").write_text(f"by scp {way}\n")
            openssh("scp", box, tmp_path, way, "-P", str(box.port), str(tmp_path / "there"), "admin@127.0.0.1:/other")
            openssh("scp", box, tmp_path, way, "-P", str(box.port), "admin@127.0.0.1:/other", str(tmp_path / "again"))
            assert (tmp_path / "again").read_text() == f"by scp {way}\n"


class Screen:
    """A shell channel, read until the prompt that Ansible's collection waits for."""

    def __init__(self, client: paramiko.SSHClient) -> None:
        self.channel = client.invoke_shell(width=80, height=24)
        self.channel.settimeout(HANG_S)

    def until(self, pattern: re.Pattern[bytes]) -> bytes:
        found = b""
        while pattern.search(found) is None:
            piece = self.channel.recv(65536)
            assert piece, found
            found += piece
        return found

    def say(self, data: bytes, pattern: re.Pattern[bytes] = ANSIBLE) -> bytes:
        self.channel.sendall(data)
        return self.until(pattern)


def test_ansible_login_flags(tmp_path: Path) -> None:
    with twin(tmp_path) as box, paramiko_on(box, "admin+cet512w") as client:
        screen = Screen(client)
        assert b"\x1b" not in screen.until(ANSIBLE)
        for _ in range(2):
            shown = screen.say(b"/system resource print without-paging\r")
            assert re.search(rb"version:\s(.*)\s*$", shown, re.MULTILINE)
            assert re.search(rb"free-memory:\s(\d+\.?\d*)([KMG]iB)", shown)
            assert b"\x1b" not in shown
        assert b"\r\nbad command name" in screen.say(b"/ip adress print\r")
        assert box.info["ssh"] == box.port


def test_ansible_reply_to_the_terminal_probe(tmp_path: Path) -> None:
    with twin(tmp_path) as box, paramiko_on(box) as client:
        screen = Screen(client)
        screen.until(re.compile(rb"\x1bZ"))
        shown = screen.say(b"\x1b/Z", re.compile(rb"\] > \x1b\[K$"))
        assert b"Press F1 for help" in shown
        assert box.info["ssh"] == box.port


def test_interactive_terminal(tmp_path: Path) -> None:
    """OpenSSH with a pty, whose terminal answers the probe by its size."""
    with twin(tmp_path / "state") as box:
        hosts = f"UserKnownHostsFile={known_hosts(box, tmp_path)}"
        command = ["ssh", *OPTIONS, "-o", hosts, "-p", str(box.port), "admin@127.0.0.1"]
        child, master = pty.fork()
        if not child:
            os.execvp(command[0], command)  # noqa: S606 (the test's own child)
        try:
            talk(master, b"password: ", f"{PASSWORD}\n".encode())
            talk(master, b"\x1b[6n", b"\x1b[24;80R")
            talk(master, b"] > \x1b[K", b"/system identity print\r")
            talk(master, b"name: MikroTik", b"/quit\r")
            talk(master, b"interrupted", b"")
        finally:
            os.close(master)
            _, status = os.waitpid(child, 0)
        assert os.waitstatus_to_exitcode(status) in (0, -1, 255)


def talk(master: int, wanted: bytes, answer: bytes) -> None:
    found = b""
    while wanted not in found:
        assert select.select([master], [], [], HANG_S)[0], found
        found += os.read(master, 4096)
    os.write(master, answer)
