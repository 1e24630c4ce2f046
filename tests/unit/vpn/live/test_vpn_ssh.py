"""How the VPN's server is reached: as Ansible does it, and what ssh says in words for a person."""

import configparser
from pathlib import Path

import pytest
from ansible.plugins.connection.ssh import Connection

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.operations.computers.remote_session import (
    _SSH_OPTIONS,
    HostKeyMismatch,
    ServerAway,
    control_path,
    ssh_command,
    ssh_error,
)

ACCESS = {
    "host": "192.0.2.10",
    "port": 2222,
    "user": "tech",
    "become": True,
    "ssh_args": "-o HostKeyAlias=scc-vpn -o UserKnownHostsFile='/a b'",
    "metered": "",
}


def test_ssh_options_match_ansible(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("ANSIBLE_SSH_CONTROL_PATH_DIR", str(tmp_path / "cp"))
    monkeypatch.delenv("ANSIBLE_SSH_ARGS", raising=False)
    settings = configparser.ConfigParser(comment_prefixes=(";", "#"))
    settings.read(Path(__file__).parents[4] / "ansible.cfg")
    assert settings["ssh_connection"]["ssh_args"] == _SSH_OPTIONS
    words = list(ssh_command(ACCESS))
    assert words[:2] == ["ssh", "-T"]
    assert words[-3:] == ["-p", "2222", "tech@192.0.2.10"]
    for option in (
        "BatchMode=yes",
        "ControlMaster=auto",
        "ServerAliveCountMax=6",
        "HostKeyAlias=scc-vpn",
        "UserKnownHostsFile=/a b",
        f"ConnectTimeout={settings['defaults']['timeout']}",
        f"ControlPath={control_path('192.0.2.10', 2222, 'tech')}",
    ):
        assert words[words.index(option) - 1] == "-o"


def test_ansible_control_connection_is_shared(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("ANSIBLE_SSH_CONTROL_PATH_DIR", str(tmp_path / "cp"))
    theirs = Connection._create_control_path("192.0.2.10", 2222, "tech")
    assert control_path("192.0.2.10", 2222, "tech") == theirs % {"directory": tmp_path / "cp"}
    assert (tmp_path / "cp").stat().st_mode & 0o777 == 0o700
    monkeypatch.setenv("ANSIBLE_SSH_ARGS", "-o ControlMaster=no")
    monkeypatch.setenv("ANSIBLE_SSH_EXTRA_ARGS", "-F none")
    monkeypatch.setenv("ANSIBLE_PRIVATE_KEY_FILE", "/a/key")
    words = ssh_command(ACCESS)
    assert {"ControlMaster=no", "-F", "none", "IdentityFile=/a/key"} <= set(words)
    assert not [word for word in words if "ControlP" in word]


@pytest.mark.parametrize(
    ("code", "said", "kind", "words", "hint"),
    [
        (255, "ssh: connect to host 192.0.2.10 port 2222: No route to host\n", ServerAway, "No route", "sync"),
        (255, "", ServerAway, "exit 255", "sync"),
        (
            255,
            "@ WARNING: REMOTE HOST IDENTIFICATION HAS CHANGED! @\nHost key verification failed.\n",
            HostKeyMismatch,
            "it shows a different SSH host key than before",
            "ssh-keygen -R scc-vpn",
        ),
        (
            255,
            "tech@192.0.2.10: Permission denied (publickey).\n",
            ServerAway,
            "refused the login as tech",
            "ssh-copy-id",
        ),
        (1, "sudo: a password is required\n", ServerAway, "cannot become root", "sudoers"),
        (127, "sh: 1: python3: not found\n", ServerAway, "has no python3", "apt-get install python3"),
    ],
)
def test_ssh_errors_are_explained(code: int, said: str, kind: type[ServerAway], words: str, hint: str) -> None:
    trouble = ssh_error("scc-vpn", ACCESS, code, said)
    assert type(trouble) is kind
    assert str(trouble).startswith("scc-vpn")
    assert words in str(trouble)
    assert hint in str(trouble.hint)
    assert trouble.exit is ExitCode.UNKNOWN
