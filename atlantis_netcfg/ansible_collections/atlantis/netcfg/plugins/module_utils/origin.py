"""From where this run came: the SSH session that must not be cut."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from typing import Mapping

__all__ = ["Client", "client"]

_ANCESTORS = 20


@dataclass(frozen=True)
class Client:
    """The two ends of an SSH session, as the server sees them."""

    address: str
    port: int
    """Of the server."""


def client(environment: Mapping[str, str]) -> Client | None:
    """The session of this process: its own `SSH_CONNECTION`, or, where sudo has dropped it, that of an ancestor."""
    text = environment.get("SSH_CONNECTION") or _of_ancestors()
    words = text.split()
    if len(words) != 4 or not words[3].isdigit():  # noqa: PLR2004 - ssh(1): client address, port, server address, port
        return None
    return Client(words[0].partition("%")[0], int(words[3]))


def _of_ancestors() -> str:
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
