"""OpenSSH as Ansible calls it: the same options, and the connection that Ansible has left open."""

from __future__ import annotations

import hashlib
import os
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from atlantis_netcfg.operations.computers._access import key_trouble
from atlantis_netcfg.operations.vpn.errors import HostKeyChanged, ServerAway

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

__all__ = ["ssh_command", "ssh_error"]

_KEPT: Final = "-o ControlMaster=auto -o ControlPersist=30m -o ServerAliveInterval=20 -o ServerAliveCountMax=6"
"""As in ansible.cfg: 6 unanswered probes of 20 s outlive a gap of 70 s."""
_CONNECT_S: Final = 120
"""Ansible's `timeout` there."""
_NOT_FOUND: Final = 127


def ssh_command(access: Mapping[str, Any]) -> Sequence[str]:
    """Program and options up to the host; a command follows them. Ansible's own variables of the environment count."""
    kept = os.environ.get("ANSIBLE_SSH_ARGS", _KEPT)
    words = ["ssh", "-T", "-o", "BatchMode=yes", *shlex.split(access["ssh_args"]), *shlex.split(kept)]
    if "ControlPersist" in kept:
        words += ["-o", f"ControlPath={control_path(access['host'], access['port'], access['user'])}"]
    if key := os.environ.get("ANSIBLE_PRIVATE_KEY_FILE"):
        words += ["-o", f"IdentityFile={key}"]
    words += ["-o", f"ConnectTimeout={_CONNECT_S}", *shlex.split(os.environ.get("ANSIBLE_SSH_EXTRA_ARGS", ""))]
    return [*words, "-p", str(access["port"]), f"{access['user']}@{access['host']}"]


def control_path(host: str, port: int, user: str) -> str:
    """The socket of the connection that Ansible keeps open to a computer; its folder is made if it is not there."""
    folder = Path(os.environ.get("ANSIBLE_SSH_CONTROL_PATH_DIR", "~/.ansible/cp")).expanduser()
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    digest = hashlib.sha1(f"{host}-{port}-{user}".encode(), usedforsecurity=False).hexdigest()
    return str(folder / digest[:10])


def ssh_error(name: str, access: Mapping[str, Any], code: int | None, text: str) -> ServerAway:
    """What ssh has said last, for a person."""
    where = f"{access['user']}@{access['host']}, port {access['port']}"
    last = next((line.strip() for line in reversed(text.splitlines()) if line.strip()), f"exit {code}")
    if (trouble := key_trouble(name, text)) is not None:
        return HostKeyChanged(f"{name} at {access['host']}: {trouble[0]}", hint=trouble[1])
    if "Permission denied" in text:
        return ServerAway(
            f"{name} was reached, and does not let you in as {access['user']}: {last}",
            hint=f"bring your key there: `ssh-copy-id -p {access['port']} {access['user']}@{access['host']}`",
        )
    if "sudo" in last:
        return ServerAway(
            f"{name}: {access['user']} does not become root there without a password: {last}",
            hint=f"on {name}: `echo '{access['user']} ALL=(ALL) NOPASSWD: ALL' > /etc/sudoers.d/atlantis`",
        )
    if code == _NOT_FOUND:
        return ServerAway(f"{name} has no python3: {last}", hint=f"on {name}: `apt-get install python3`")
    return ServerAway(
        f"{name} was not reached ({where}): {last}",
        hint="look at its power and at your way to it; what is recorded waits, and `provision vpn sync` goes on",
    )
