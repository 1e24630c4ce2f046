"""SSH session of a run: refuse changes that would prevent its next login. Also the lock: one run at a time."""

from __future__ import annotations

import contextlib
import fcntl
import ipaddress
import os
import pwd
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Iterator, Mapping

from atlantis_netcfg.core.messages import arg

from .errors import ModuleError, as_module_error

if TYPE_CHECKING:
    from .desired_state import SshRequirements
    from .filesystem import FileSystem

_ANCESTORS = 20


@dataclass(frozen=True)
class SshClient:
    """The two ends of an SSH session, as the server sees them."""

    address: str
    port: int
    """Port of the server."""


def client(environment: Mapping[str, str]) -> SshClient | None:
    """Return the SSH session of this process: its `SSH_CONNECTION`, or an ancestor's if sudo has dropped it."""
    text = environment.get("SSH_CONNECTION") or _read_ssh_connection()
    words = text.split()
    if len(words) != 4 or not words[3].isdigit():  # noqa: PLR2004 - ssh(1): client address, port, server address, port
        return None
    return SshClient(words[0].partition("%")[0], int(words[3]))


def _read_ssh_connection() -> str:
    pid = "self"
    for _ in range(_ANCESTORS):
        try:
            variables = Path(f"/proc/{pid}/environ").read_bytes().split(b"\0")
            pid = Path(f"/proc/{pid}/stat").read_bytes().rpartition(b")")[2].split()[1].decode()
        except OSError:
            return ""
        for variable in variables:
            if variable.startswith(b"SSH_CONNECTION="):
                return variable.partition(b"=")[2].decode(errors="replace")
        if pid == "0":
            return ""
    return ""


_KINDS = (b"ssh-", b"ecdsa-sha2-", b"sk-")
"""Prefixes of the key types that sshd(8) accepts."""


def require_access(way_in: SshRequirements, tree: FileSystem, environment: Mapping[str, str]) -> None:
    """Raise ModuleError if the change would lock the user out; without an SSH session, check the keys only."""
    result = client(environment)
    if result is not None and way_in.admit and not _is_admitted(result.address, way_in.admit):
        raise ModuleError(
            f"you work from {arg(result.address)}, which could not log in afterwards: SSH would be allowed from "
            f"{arg(', '.join(way_in.admit))} only. Nothing was changed",
            way_in.hint,
        )
    if result is not None and way_in.port is not None and result.port != way_in.port:
        raise ModuleError(
            f"your session uses port {arg(result.port)}, but SSH would be allowed on port {arg(way_in.port)} only. "
            "Nothing was changed",
            way_in.hint,
        )
    if way_in.key and not _has_key(tree, _account(environment)):
        account = _account(environment)
        raise ModuleError(
            f"account {arg(account)} has no key to log in with, and passwords would no longer be accepted. Nothing was "
            "changed",
            f"copy your key there first: `ssh-copy-id {arg(account)}@` and the name of this computer",
        )


def _is_admitted(address: str, networks: tuple[str, ...]) -> bool:
    try:
        result = ipaddress.ip_address(address)
    except ValueError:
        return False
    if isinstance(result, ipaddress.IPv6Address) and result.ipv4_mapped is not None:
        result = result.ipv4_mapped
    return any(result in ipaddress.ip_network(network) for network in networks)


def _account(environment: Mapping[str, str]) -> str:
    """Return the account that logged in, also behind sudo."""
    return environment.get("SUDO_USER") or pwd.getpwuid(os.geteuid()).pw_name


def _has_key(tree: FileSystem, account: str) -> bool:
    home = pwd.getpwnam(account).pw_dir
    for name in ("authorized_keys", "authorized_keys2"):
        for line in (tree.read(f"{home}/.ssh/{name}") or b"").splitlines():
            words = line.split()
            if not line.startswith(b"#") and any(word.startswith(_KINDS) for word in words[:-1]):
                return True
    return False


FILE = "/run/lock/atlantis-configure"


@contextlib.contextmanager
def hold_lock(tree: FileSystem, environment: Mapping[str, str] = os.environ) -> Iterator[None]:
    """Hold the computer's lock; the kernel releases it when the process ends, however it ends."""
    try:
        Path(tree.at(FILE)).parent.mkdir(parents=True, exist_ok=True)
        handle = os.open(tree.at(FILE), os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o644)
    except OSError as error:
        raise as_module_error(error, FILE) from error
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.pread(handle, 200, 0).decode(errors="replace").strip()
            raise ModuleError(
                f"another run is active on this computer: {arg(holder or 'it has not written its name yet')}",
                "wait until it ends, then run the same command again; a run that lost its connection continues for "
                "a while",
            ) from None
        result = client(environment)
        text = f"process {os.getpid()}" + (f", started from {result.address}" if result is not None else "")
        os.ftruncate(handle, 0)
        os.pwrite(handle, text.encode(), 0)
        yield
    finally:
        os.close(handle)
