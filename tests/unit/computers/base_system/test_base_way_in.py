"""Module `configure`, the way in: whoever asks for a change is still let in after it, or nothing is changed."""

import os
import pwd
import subprocess
import sys
from pathlib import Path

import pytest
from base_computer import Computer

from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.errors import ModuleError

KEYS = f"{pwd.getpwuid(os.geteuid()).pw_dir}/.ssh/authorized_keys"
FILES = [{"path": "/etc/x", "content": "x"}]


def session(address: str, port: int = 22) -> dict[str, str]:
    return {"SSH_CONNECTION": f"{address} 51234 198.51.100.1 {port}"}


@pytest.fixture
def computer(tmp_path: Path) -> Computer:
    return Computer(tmp_path)


@pytest.mark.parametrize("address", ["192.0.2.7", "::ffff:192.0.2.7", "203.0.113.99"])
def test_admitted_address_may_change_access(computer: Computer, address: str) -> None:
    way_in = {"admit": ["192.0.2.0/28", "203.0.113.0/24"], "port": 22}
    assert computer.converge(files=FILES, way_in=way_in, environment=session(address)) == ["file /etc/x"]


@pytest.mark.parametrize("address", ["192.0.2.99", "198.51.100.7", "fe80::1%eth0", "2001:db8::1", "what"])
@pytest.mark.parametrize("check", [True, False])
def test_change_that_locks_out_the_operator_is_refused(computer: Computer, address: str, check: bool) -> None:  # noqa: FBT001
    way_in = {"admit": ["192.0.2.0/28", "203.0.113.0/24"], "hint": "do that"}
    with pytest.raises(ModuleError) as caught:
        computer.converge(check=check, files=FILES, way_in=way_in, environment=session(address))
    plain = address.partition("%")[0]
    assert caught.value.message == (
        f"you work from {plain}, which could not log in afterwards: SSH would be allowed from 192.0.2.0/28, "
        "203.0.113.0/24 only. Nothing was changed"
    )
    assert caught.value.hint == "do that"
    assert computer.snapshot() == {}


def test_port_of_the_current_session_must_stay_open(computer: Computer) -> None:
    with pytest.raises(ModuleError, match="your session uses port 2222, but SSH would be allowed on port 22 only"):
        computer.converge(files=FILES, way_in={"port": 22}, environment=session("192.0.2.7", 2222))


@pytest.mark.parametrize("text", [None, "", "# ssh-ed25519 AAAA…\n", "ssh-ed25519\n", "no key at all\n"])
def test_passwords_are_disabled_only_if_a_key_exists(computer: Computer, text: str | None) -> None:
    if text is not None:
        computer.put(KEYS, text)
    me = pwd.getpwuid(os.geteuid()).pw_name
    with pytest.raises(ModuleError, match=f"account {me} has no key to log in with") as caught:
        computer.converge(files=FILES, way_in={"key": True})
    assert f"ssh-copy-id {me}@" in caught.value.hint
    computer.put(KEYS, 'from="192.0.2.0/24" ssh-ed25519 AAAAC3Nz technician\n')
    assert computer.converge(files=FILES, way_in={"key": True}) == ["file /etc/x"]


def test_key_must_belong_to_the_logged_in_account(computer: Computer) -> None:
    me = pwd.getpwuid(os.geteuid())
    other = next(account.pw_name for account in pwd.getpwall() if account.pw_dir != me.pw_dir)
    computer.put(KEYS, "ssh-ed25519 AAAAC3Nz technician\n")
    with pytest.raises(ModuleError, match=f"account {other} has no key"):
        computer.converge(files=FILES, way_in={"key": True}, environment={"SUDO_USER": other})


def test_ssh_session_is_found_behind_sudo() -> None:
    """As sudo does it: the variable is in the environment of an ancestor only."""
    program = (
        "from atlantis_netcfg.ansible_collections.atlantis.netcfg.plugins.module_utils.ssh_access import client\n"
        "print(client({}))"
    )
    done = subprocess.run(
        ["sh", "-c", 'env -u SSH_CONNECTION "$0" -c "$1"; exit $?', sys.executable, program],
        env={**os.environ, **session("192.0.2.7", 2222)},
        cwd=Path(__file__).parents[4],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == "SshClient(address='192.0.2.7', port=2222)\n"
