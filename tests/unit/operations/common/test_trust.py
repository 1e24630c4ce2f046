"""How a computer's SSH host key is known: declared, or in OpenSSH's own list, and never taken over silently."""

import os
import shlex
from dataclasses import replace
from pathlib import Path

import pytest

from atlantis_netcfg.core.errors import DeviceError
from atlantis_netcfg.core.paths import checkout
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.inventory.model import Gateway
from atlantis_netcfg.operations import Request
from atlantis_netcfg.operations.computers._access import key_trouble
from atlantis_netcfg.operations.computers.parts import ACCESS, PARTS
from atlantis_netcfg.operations.trust import KeyState, TrustedComputer, has_identity

GATEWAY = "coastal-gateway"
KEY = "ssh-ed25519 AAAAC3NzaC1lZDI1NTE5AAAAIP8Drwn6vGvGUsdb7vuANhLXoEo1vLPfZKpFqfBMlfd8"


def declared(key: str | None) -> Inventory:
    shipped = load(checkout() / "inventory")
    host = shipped.hosts[GATEWAY]
    assert isinstance(host.device, Gateway)
    device = host.device.model_copy(update={"ssh": host.device.ssh.model_copy(update={"host_key": key})})
    return replace(shipped, hosts={**shipped.hosts, GATEWAY: replace(host, device=device)})


def options(declaration: Inventory, state: Path) -> list[str]:
    access = PARTS[ACCESS](declaration, declaration.hosts[GATEWAY], Request(state=state))
    return [word for word in shlex.split(access["ssh_args"]) if word != "-o"]


def test_undeclared_host_key_must_be_known_already(tmp_path: Path) -> None:
    assert options(declared(None), tmp_path) == [f"HostKeyAlias={GATEWAY}", "StrictHostKeyChecking=yes"]
    assert not (tmp_path / "known_hosts").exists()


def test_only_the_declared_host_key_is_trusted(tmp_path: Path) -> None:
    state = tmp_path / "a folder"
    told = options(declared(KEY), state)
    assert told[1] == "StrictHostKeyChecking=yes"
    file = state / "known_hosts" / GATEWAY
    assert f'UserKnownHostsFile="{file}"' in told
    assert "GlobalKnownHostsFile=/dev/null" in told
    assert file.read_text() == f"{GATEWAY} {KEY}\n"
    options(declared(KEY.replace("Mlfd8", "Mlfd9")), state)
    assert file.read_text() == f"{GATEWAY} {KEY.replace('Mlfd8', 'Mlfd9')}\n"


@pytest.mark.parametrize(
    ("said", "told", "hint"),
    [
        (
            "No ED25519 host key is known for x\nHost key verification failed.",
            "is not known here",
            "provision device trust",
        ),
        (
            "@ WARNING: REMOTE HOST IDENTIFICATION HAS CHANGED! @\nHost key verification failed.",
            "a different SSH host key",
            "-R x",
        ),
    ],
)
def test_openssh_key_errors_are_explained(said: str, told: str, hint: str) -> None:
    trouble = key_trouble("x", said)
    assert trouble is not None
    assert told in trouble[0]
    assert hint in trouble[1]


def test_other_errors_are_not_key_errors() -> None:
    assert key_trouble("x", "ssh: connect to host x port 22: No route to host") is None


@pytest.mark.parametrize(
    ("said", "state"),
    [
        ("root@x: Permission denied (publickey).", KeyState.MATCH),
        ("Host key verification failed.", KeyState.UNKNOWN),
        ("REMOTE HOST IDENTIFICATION HAS CHANGED!\nHost key verification failed.", KeyState.MISMATCH),
    ],
)
def test_checking_a_host_key_does_not_log_in(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, said: str, state: KeyState
) -> None:
    typed = stand_in(tmp_path, monkeypatch, said)
    declaration = declared(None)
    assert TrustedComputer(declaration, declaration.hosts[GATEWAY], Request(state=tmp_path)).look() is state
    words = typed.read_text()
    for option in ("BatchMode=yes", "PreferredAuthentications=none", "ControlPath=none", f"HostKeyAlias={GATEWAY}"):
        assert option in words


def test_unreachable_computer_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stand_in(tmp_path, monkeypatch, "ssh: connect to host x port 22: No route to host")
    declaration = declared(None)
    with pytest.raises(DeviceError, match="was not reached: ssh: connect to host x port 22: No route to host"):
        TrustedComputer(declaration, declaration.hosts[GATEWAY], Request(state=tmp_path)).look()


def stand_in(folder: Path, monkeypatch: pytest.MonkeyPatch, said: str) -> Path:
    """Put a program in the place of OpenSSH that says this; what it was called with is in the file."""
    typed, program = folder / "typed", folder / "bin" / "ssh"
    program.parent.mkdir()
    program.write_text(f"#!/bin/sh\necho \"$@\" > {typed}\nprintf '%s\\n' {shlex.quote(said)} >&2\nexit 255\n")
    program.chmod(0o700)
    monkeypatch.setenv("PATH", f"{program.parent}:{os.environ['PATH']}")
    return typed


def test_every_kind_with_a_login_has_an_identity() -> None:
    hosts = load(checkout() / "inventory").hosts.values()
    kinds = {host.device.kind for host in hosts if has_identity(host)}
    assert kinds >= {"router", "cpe", "gateway", "vpn_server"}
    assert "satellite_terminal" not in kinds
