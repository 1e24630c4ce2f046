"""paramiko: one command per channel, files, the host key."""

import base64
import hashlib
import io
import json
from pathlib import Path
from typing import Any

import paramiko
import pytest
from cryptography.hazmat.primitives.asymmetric import ed25519
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from shell_site import PASSWORD, paramiko_on, run, twin
from waiting import HANG_S

from atlantis_netcfg.emulator.routeros import RouterLink

SEED = """/ip firewall filter add chain=input action=accept comment="a remark that is long enough to be wrapped" \\
    connection-state=established,related
/interface ovpn-client add name=vpn connect-to=192.0.2.1 user=box password=geheim
"""
FORMS: dict[str, dict[str, Any]] = {
    "/export": {},
    "/export verbose": {"verbose": True},
    "/export terse": {"terse": True},
    "/export show-sensitive": {"show_sensitive": True},
    "/ip firewall export": {"menu": "/ip/firewall"},
}


def timeless(export: str) -> str:
    """Without the first line, in which the clock runs."""
    first, rest = export.split("\n", 1)
    assert " by RouterOS " in first
    return rest


@pytest.mark.parametrize("version", ["6.49.10", "7.9.2", "7.16", "7.18.2", "7.21.5"])
def test_export_equals_that_of_the_emulator(tmp_path: Path, version: str) -> None:
    with twin(tmp_path, version=version, seed=SEED) as box, paramiko_on(box) as client:
        for command, options in FORMS.items():
            if version.startswith("6.") and "sensitive" in command:
                continue
            shown, status = run(client, command)
            wanted = box.export(**options | ({"show_sensitive": True} if version.startswith("6.") else {}))
            assert (timeless(shown.replace("\r\n", "\n")), status) == (timeless(wanted), 0)
            assert shown.count("\r\n") == shown.count("\n")
            assert timeless(run(client, command)[0]) == timeless(shown)


def test_output_and_status(tmp_path: Path) -> None:
    with twin(tmp_path) as box, paramiko_on(box) as client:
        assert run(client, "/ip/pool/add name=p ranges=10.0.0.1") == ("", 0)
        assert run(client, ":put [/ip/pool/add name=q ranges=10.0.0.2]") == ("*2\r\n", 0)
        assert run(client, ":put [/ip/pool/print detail as-value]") == (
            ".id=*1;name=p;next-pool=none;ranges=10.0.0.1;.id=*2;name=q;next-pool=none;ranges=10.0.0.2\r\n",
            0,
        )
        assert run(client, ":put [/ip/pool/get p ranges]") == ("10.0.0.1\r\n", 0)
        assert run(client, "/ip pool print as-value") == ("", 0)
        assert run(client, "/ip pool add name=p ranges=10.0.0.3") == ("failure: pool with such name exists\r\n", 1)
        assert run(client, "/ip poool print") == ("bad command name poool (line 1 column 5)\r\n", 1)
        assert len(box.rows("/ip/pool/print")) == 2


def test_each_channel_is_a_separate_session(tmp_path: Path) -> None:
    with twin(tmp_path) as box, paramiko_on(box) as client:
        assert run(client, "/ip address")[0] == ""
        assert run(client, "print count-only")[0].startswith("bad command name print")
        shell = client.invoke_shell()
        assert "3" in run(client, ":put [/user/active/print count-only]")[0] or box.rows("/user/active/print")
        shell.close()


def test_files(tmp_path: Path) -> None:
    data = bytes(range(256)) * 300
    with twin(tmp_path, version="7.21.5") as box, paramiko_on(box) as client:
        files = client.open_sftp()
        for _ in range(2):
            files.putfo(io.BytesIO(data), "/package.bin")
            assert files.listdir("/") == ["package.bin"]
            assert files.stat("package.bin").st_size == len(data)
            back = io.BytesIO()
            files.getfo("package.bin", back)
            assert back.getvalue() == data
        shown, _ = run(client, ':put [/file get [find name="package.bin"] size]')
        assert shown.strip() == str(len(data))
        files.rename("package.bin", "other.bin")
        files.remove("other.bin")
        assert files.listdir() == []
        with pytest.raises(FileNotFoundError):
            files.stat("other.bin")


def test_folders_and_relative_names(tmp_path: Path) -> None:
    with twin(tmp_path, version="7.21.5") as box, paramiko_on(box) as client:
        files = client.open_sftp()
        files.mkdir("flash")
        files.chdir("flash")
        files.putfo(io.BytesIO(b"a"), "./sub/../one")
        files.mkdir("sub")
        files.putfo(io.BytesIO(b"b"), "sub/two")
        assert sorted(files.listdir()) == ["one", "sub"]
        assert files.listdir("sub") == ["two"]
        assert files.listdir("/") == ["flash"]
        assert [row[1:] for row in box.rows("/file/print", "=.proplist=name,type")] == [
            ["=name=flash", "=type=directory"],
            ["=name=flash/one", "=type=.txt file"],
            ["=name=flash/sub", "=type=directory"],
            ["=name=flash/sub/two", "=type=.txt file"],
        ]
        with pytest.raises(FileNotFoundError):
            files.putfo(io.BytesIO(b"c"), "nowhere/three")
        for name in ("sub", "/flash/one"):
            with pytest.raises(OSError, match=r"not empty|cannot make"):
                (files.rmdir if name == "sub" else files.mkdir)(name)
        files.remove("sub/two")
        files.rmdir("sub")
        assert files.listdir() == ["one"]


RECORDED = [
    pytest.param(case, id=f"{case['version']} {case['input']}")
    for line in (Path(__file__).parents[3] / "data" / "recorded" / "cases.jsonl").read_text("utf-8").splitlines()
    if (case := json.loads(line))["door"] == "ssh"
]


def private(kind: str) -> paramiko.PKey:
    """Return a new key."""
    if kind == "rsa":
        return paramiko.RSAKey.generate(2048)
    made = ed25519.Ed25519PrivateKey.generate().private_bytes(Encoding.PEM, PrivateFormat.OpenSSH, NoEncryption())
    return paramiko.Ed25519Key.from_private_key(io.StringIO(made.decode()))


@pytest.mark.parametrize("case", RECORDED)
def test_login_with_a_key(tmp_path: Path, case: dict[str, Any]) -> None:
    key = private(case["input"].partition("key ")[2] or "ed25519")
    with twin(tmp_path, version=case["version"]) as box:
        with paramiko_on(box) as client:
            line = f'/user/ssh-keys/add user=admin key="{key.get_name()} {key.get_base64()} me@here"'
            assert run(client, line) == ("", 0)
        if case["refused"]:
            with pytest.raises(paramiko.AuthenticationException), paramiko_on(box):
                pass
            with paramiko_on(box, "guest") as other:
                assert run(other, ":put kept") == ("kept\r\n", 0)
            return
        with paramiko_on(box, key=key) as client:
            assert run(client, ":put kept") == ("kept\r\n", 0)
        with pytest.raises(paramiko.AuthenticationException), paramiko_on(box, key=private("ed25519")):
            pass
        with pytest.raises(paramiko.AuthenticationException), paramiko_on(box, "guest", key=key):
            pass


def test_settings_allow_password_login_for_a_user_with_a_key(tmp_path: Path) -> None:
    key = private("ed25519")
    line = f'/user/ssh-keys/add user=admin key="{key.get_name()} {key.get_base64()}"'
    for version, setting in (("7.18.2", "always-allow-password-login=yes"), ("7.21.5", "password-authentication=yes")):
        with twin(tmp_path / version, version=version) as box:
            with paramiko_on(box) as client:
                assert run(client, f"/ip ssh set {setting}") == ("", 0)
                assert run(client, line) == ("", 0)
            with paramiko_on(box) as client:
                assert run(client, ":put kept") == ("kept\r\n", 0)


def test_uploaded_script_runs_only_with_the_auto_suffix(tmp_path: Path) -> None:
    script = b'/ip pool add name=up ranges=10.0.0.1\n:put "done"\n/ip pool add name=up ranges=10.0.0.1\n'
    with twin(tmp_path) as box, paramiko_on(box) as client:
        files = client.open_sftp()
        files.putfo(io.BytesIO(script), "setup.auto.rsc")
        assert sorted(files.listdir()) == ["setup.auto.log", "setup.auto.rsc"]
        log = io.BytesIO()
        files.getfo("setup.auto.log", log)
        assert log.getvalue() == b"done\nfailure: pool with such name exists\n"
        assert len(box.rows("/ip/pool/print")) == 1
        files.putfo(io.BytesIO(b"/ip pool remove up\n"), "undo.rsc")
        assert len(box.rows("/ip/pool/print")) == 1
        assert run(client, "/import file-name=undo.rsc") == ("Script file loaded and executed successfully\r\n", 0)
        assert box.rows("/ip/pool/print") == []


def test_full_disk_refuses_uploads(tmp_path: Path) -> None:
    with twin(tmp_path, disk_bytes=1000) as box, paramiko_on(box) as client:
        files = client.open_sftp()
        files.putfo(io.BytesIO(b"x" * 900), "fits")
        assert box.rows("/system/resource/print", "=.proplist=free-hdd-space") == [["!re", "=free-hdd-space=100"]]
        assert run(client, "/export file=neither") == ("failure: disk full\r\n", 1)
        with pytest.raises(OSError, match="size mismatch"):
            files.putfo(io.BytesIO(b"x" * 200), "does-not")
        with files.open("does-not", "w") as file, pytest.raises(OSError, match="disk full"):
            file.write(b"x" * 200)
        files.remove("fits")
        files.putfo(io.BytesIO(b"x" * 200), "does-not")


def test_user_without_the_policy_cannot_access_files(tmp_path: Path) -> None:
    with twin(tmp_path) as box, paramiko_on(box, "guest") as client:
        with pytest.raises(PermissionError):
            client.open_sftp().listdir()
        assert run(client, "/ip pool add name=x ranges=10.0.0.1") == ("not enough permissions (9)\r\n", 1)


def test_wrong_password_and_wrong_user(tmp_path: Path) -> None:
    with twin(tmp_path) as box:
        for user, password in (("admin", "wrong"), ("nobody", PASSWORD)):
            with pytest.raises(paramiko.AuthenticationException), paramiko_on(box, user, password):
                pass
        assert box.do("counters")["logins"] == 0


def seen(port: int) -> str:
    with paramiko.Transport(("127.0.0.1", port)) as transport:
        transport.start_client(timeout=HANG_S)
        digest = hashlib.sha256(transport.get_remote_server_key().asbytes()).digest()
    return "SHA256:" + base64.b64encode(digest).decode().rstrip("=")


def test_host_key_survives_a_restart_and_changes_on_rekey(tmp_path: Path) -> None:
    with twin(tmp_path) as box:
        first = box.info["host_key"]
        assert seen(box.port) == first
        box.do("restart")
        assert seen(box.port) == first
        second = box.do("rekey")
        assert second != first
        assert seen(box.port) == second


def test_slow_link_is_counted(tmp_path: Path) -> None:
    with twin(tmp_path, link=RouterLink(delay_s=0.05)) as box, paramiko_on(box) as client:
        before = box.do("counters")
        assert run(client, ':put "a"')[0] == "a\r\n"
        after = box.do("counters")
        assert 2 <= after["turns"] - before["turns"] <= 6
        assert after["sentences"] - before["sentences"] == 1
        assert after["wire_in"] > before["wire_in"]
