"""Put the live files of the server in their places while the tunnel is up: who is admitted, the list, the firewall.

They are put by the very core of the module `configure`, and what is loaded is noted in its stamps: a run of the role
finds nothing to do. Whoever is admitted no longer has his session ended.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
from typing import TYPE_CHECKING, Any

from .lock import alone
from .placing import Placing
from .strays import clear, strays
from .vpn_end import Ending, Unheard
from .wishes import Wishes

if TYPE_CHECKING:
    from typing import Mapping, Sequence

    from .vpn_server import Server

__all__ = ["push"]


def push(server: Server, files: Sequence[Mapping[str, Any]], only: Sequence[str]) -> dict[str, Any]:
    """Do it; `files` as `configure` has them, or with `sha256` in the place of a content that may be there already.

    `only` are folders in which nothing else stays. Gives `changes`, `ended` (sessions, with replies) and `told`; or
    `lacks`, the paths whose content is needed after all, and nothing was done.
    """
    server.must_be()
    with alone(server.tree):
        whole = [_whole(server, file) for file in files]
        lacks = [file["path"] for file in whole if file["content"] is None]
        if lacks:
            return {"lacks": lacks, "changes": [], "ended": [], "told": []}
        values = {"files": whole, "only": list(only)}
        wishes = Wishes.of(values)
        left = strays(server.tree, wishes)
        wishes = Wishes.of({**values, "absent": left})
        contents = {file.path: file.content for file in wishes.files}
        _hold_list(server, contents.get(server.place.crl))
        before = set(server.admitted())
        placing = Placing(server.tree, wishes, server.run)
        placing.place()
        clear(server.tree, wishes, left)
        changes = [*placing.changes(), *_load(server, contents.get(server.place.firewall)), *_redirects(server)]
        gone = before - set(server.admitted())
        ending = Ending(gone)
        if gone:
            ending.run(server, Unheard(server, ()))
    return {"lacks": [], "changes": changes, "ended": ending.ended, "told": ending.told}


def _whole(server: Server, file: Mapping[str, Any]) -> dict[str, Any]:
    """With its content, if it was sent or is there; else with None."""
    values = dict(file)
    digest = values.pop("sha256", None)
    if values.get("content") is None:
        content = server.tree.read(values["path"])
        same = content is not None and hashlib.sha256(content).hexdigest() == digest
        values["content"] = content.decode() if content is not None and same else None
    return values


def _hold_list(server: Server, new: bytes | None) -> None:
    """Hold a list that differs from the one in place against that one and against the clock."""
    path = server.place.crl
    if new is None or new == server.tree.read(path):
        return
    beside = server.tree.stage(path, new, 0o600, os.geteuid(), os.getegid())
    try:
        server.hold(beside)
    finally:
        server.tree.unstage(path)


def _redirects(server: Server) -> list[str]:
    """Switch ICMP redirects off; that they are on after all is seen by who looks."""
    with contextlib.suppress(OSError):
        if server.stop_redirects():
            return ["ICMP redirects switched off"]
    return []


def _load(server: Server, ruleset: bytes | None) -> list[str]:
    """Load the ruleset unless it is the one that was loaded last, and the kernel has it still."""
    firewall, path = server.firewall, server.tree.at(server.place.firewall)
    if ruleset is None or (firewall.is_noted(ruleset) and firewall.is_as(path) is not False):
        return []
    firewall.load(ruleset, path)
    return ["firewall loaded"]
