"""The way by which a run came in: nothing is changed if it would be closed afterwards."""

from __future__ import annotations

import ipaddress
import os
import pwd
from typing import TYPE_CHECKING

from .origin import client
from .refused import Refused

if TYPE_CHECKING:
    from typing import Mapping

    from .tree import Tree
    from .wishes import WayIn

__all__ = ["hold"]

_KINDS = (b"ssh-", b"ecdsa-sha2-", b"sk-")
"""How the kinds of keys begin that sshd(8) takes."""


def hold(wish: WayIn, tree: Tree, environment: Mapping[str, str]) -> None:
    """Refuse what would lock out the person who asks for it; a run without an SSH session only has its keys checked."""
    came = client(environment)
    if came is not None and wish.admit and not _admitted(came.address, wish.admit):
        raise Refused(
            f"you work from {came.address}, which could not log in afterwards: SSH would be admitted from "
            f"{', '.join(wish.admit)} only. Nothing was changed",
            wish.hint,
        )
    if came is not None and wish.port is not None and came.port != wish.port:
        raise Refused(
            f"your session came in on port {came.port}, and SSH would be admitted on port {wish.port} only. "
            "Nothing was changed",
            wish.hint,
        )
    if wish.key and not _has_key(tree, _account(environment)):
        account = _account(environment)
        raise Refused(
            f"account {account} has no key to log in with, and passwords would no longer do. Nothing was changed",
            f"bring your key there first: `ssh-copy-id {account}@` and the name of this computer",
        )


def _admitted(address: str, networks: tuple[str, ...]) -> bool:
    try:
        came = ipaddress.ip_address(address)
    except ValueError:
        return False
    if isinstance(came, ipaddress.IPv6Address) and came.ipv4_mapped is not None:
        came = came.ipv4_mapped
    return any(came in ipaddress.ip_network(network) for network in networks)


def _account(environment: Mapping[str, str]) -> str:
    """Who has logged in, also where sudo has made root of it."""
    return environment.get("SUDO_USER") or pwd.getpwuid(os.geteuid()).pw_name


def _has_key(tree: Tree, account: str) -> bool:
    home = pwd.getpwnam(account).pw_dir
    for name in ("authorized_keys", "authorized_keys2"):
        for line in (tree.read(f"{home}/.ssh/{name}") or b"").splitlines():
            words = line.split()
            if not line.startswith(b"#") and any(word.startswith(_KINDS) for word in words[:-1]):
                return True
    return False
