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


def hold(way_in: WayIn, tree: Tree, environment: Mapping[str, str]) -> None:
    """Refuse what would lock out the person who asks for it; a run without an SSH session only has its keys checked."""
    result = client(environment)
    if result is not None and way_in.admit and not _admitted(result.address, way_in.admit):
        raise Refused(
            f"you work from {result.address}, which could not log in afterwards: SSH would be admitted from "
            f"{', '.join(way_in.admit)} only. Nothing was changed",
            way_in.hint,
        )
    if result is not None and way_in.port is not None and result.port != way_in.port:
        raise Refused(
            f"your session came in on port {result.port}, and SSH would be admitted on port {way_in.port} only. "
            "Nothing was changed",
            way_in.hint,
        )
    if way_in.key and not _has_key(tree, _account(environment)):
        account = _account(environment)
        raise Refused(
            f"account {account} has no key to log in with, and passwords would no longer do. Nothing was changed",
            f"bring your key there first: `ssh-copy-id {account}@` and the name of this computer",
        )


def _admitted(address: str, networks: tuple[str, ...]) -> bool:
    try:
        result = ipaddress.ip_address(address)
    except ValueError:
        return False
    if isinstance(result, ipaddress.IPv6Address) and result.ipv4_mapped is not None:
        result = result.ipv4_mapped
    return any(result in ipaddress.ip_network(network) for network in networks)


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
