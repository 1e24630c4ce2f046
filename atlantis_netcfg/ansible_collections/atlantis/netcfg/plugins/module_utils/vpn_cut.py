"""Throw somebody out at once: list, admission, firewall, session, connections; then look whether it is so.

The order is that of facts 5: when list and admission are gone nobody comes in any more, when the firewall is closed
nothing passes, and then the session is ended. The firewall is loaded beside the rest, for it takes longest. Every step
goes on although one before it failed: what was left undone is told.
"""

from __future__ import annotations

import contextlib
import hashlib
import threading
import time
from ipaddress import ip_address, ip_network
from typing import TYPE_CHECKING, Any

from .lock import alone
from .refused import Refused
from .vpn_end import Ending, Forgetting, Unheard, theirs
from .vpn_server import ANSWERS, DOWN, HELD

if TYPE_CHECKING:
    from typing import Callable, Mapping, Sequence

    from .vpn_server import Server
    from .vpn_status import Session

__all__ = ["revoke", "verify"]


class _Act:
    """What was done when, in milliseconds since it began, and what was not done."""

    def __init__(self) -> None:
        self._began = time.monotonic()
        self.steps: list[list[Any]] = []
        self.told: list[str] = []

    def step(self, name: str) -> None:
        self.steps.append([name, round((time.monotonic() - self._began) * 1000, 3)])

    def dare(self, act: Callable[..., None], *arguments: Any) -> bool:  # noqa: ANN401 - whatever the act takes
        """Whether it was done."""
        try:
            act(*arguments)
        except Refused as refused:
            self.told.append(f"{refused.message}; {refused.hint}" if refused.hint else refused.message)
            return False
        return True


def revoke(
    server: Server, files: Sequence[Mapping[str, Any]], common_names: Sequence[str], addresses: Sequence[str]
) -> dict[str, Any]:
    """Do it. `files`: list and ruleset, as far as they change. Gives `steps`, `ended`, and what `verify` gives."""
    act = _Act()
    server.must_be()
    given = {file["path"]: file for file in files}
    ending = Ending(common_names, addresses)
    with contextlib.ExitStack() as stack:
        try:
            stack.enter_context(alone(server.tree))
        except Refused as busy:
            # Whoever holds it may put older files back, which the second look tells. To wait for him would be worse.
            act.told.append(busy.message)
        unheard = Unheard(server, ending.look(server))
        listed = given.get(server.place.crl)
        # Whose list is older than the server's has a ruleset from the same record: it would let the revoked pass.
        current = act.dare(_hold_list, server, listed)
        ruleset = given.get(server.place.firewall) if current else None
        closing = threading.Thread(target=act.dare, args=(_close, server, ruleset, addresses, unheard))
        closing.start()
        if current and act.dare(_put_list, server, listed):
            act.step("list in place")
        for name in common_names:
            act.dare(server.tree.remove, server.place.admission(name))
        act.step("no longer admitted")

        def closed() -> None:
            closing.join()
            act.step("firewall closed")

        ending.run(server, unheard, closed, act.step)
        with Forgetting(addresses) as forgetting:
            act.dare(_keep, server, ruleset)
            act.step("safe on the disk")
            digests = {path: _digest(file["content"].encode()) for path, file in given.items()}
            found = verify(server, common_names, addresses, digests, (ending.management, ending.left))
    act.step("verified")
    result = [*act.told, *ending.told, *forgetting.told, *found["told"]]
    return {**found, "steps": act.steps, "ended": ending.ended, "told": result}


def _hold_list(server: Server, file: Mapping[str, Any] | None) -> None:
    """Lay it beside its place. Raises `Refused` for one that must not get there."""
    if file is None or server.tree.read(server.place.crl) == file["content"].encode():
        return
    try:
        server.hold(_stage(server, file))
    except Refused:
        server.tree.unstage(server.place.crl)
        raise


def _put_list(server: Server, file: Mapping[str, Any] | None) -> None:
    """Put what was laid beside it, unless it is there already."""
    if file is not None and server.tree.read(server.place.crl) != file["content"].encode():
        server.tree.put(server.place.crl)


def _close(server: Server, file: Mapping[str, Any] | None, addresses: Sequence[str], unheard: Unheard) -> None:
    """Load the ruleset without the addresses; where that fails they are taken out of the loaded one.

    In the same act their clients are heard no more: each costs the kernel 10 ms.
    """
    if file is None:
        server.firewall.take_out(addresses)
        return
    beside = _stage(server, file)
    try:
        server.firewall.load_only(beside, unheard.text)
        unheard.holds = True
        server.tree.put(server.place.firewall)
    except Refused:
        server.firewall.take_out(addresses)
        raise
    finally:
        server.tree.unstage(server.place.firewall)


def _stage(server: Server, file: Mapping[str, Any]) -> str:
    owner = server.tree.uid(file.get("owner") or "root"), server.tree.gid(file.get("group") or "root")
    return server.tree.stage(file["path"], file["content"].encode(), int(file.get("mode") or "0644", 8), *owner)


def _keep(server: Server, file: Mapping[str, Any] | None) -> None:
    """Bring the folders to the disk and note what is loaded; a power cut before that is mended by the next push."""
    place = server.place
    for path in (place.admission("any"), place.crl, place.firewall):
        server.tree.sync(path)
    if file is not None and server.tree.read(place.firewall) == file["content"].encode():
        server.firewall.note(file["content"].encode())


def verify(
    server: Server,
    common_names: Sequence[str],
    addresses: Sequence[str],
    files: Mapping[str, str],
    result: tuple[str, Sequence[Session]] | None = None,
) -> dict[str, Any]:
    """Look whether they are out. `files`: SHA-256 of what must be in place. `looked`: who is known to have a session.

    Gives `out` (nobody of them can come in, and nothing of theirs passes), `dead` (nobody of them has a session, by the
    server's own word), `left` (what is wrong, in words), `told`, and `management` (what the socket does).
    """
    management, sessions = result if result is not None else server.sessions()[:2]
    left = [f"{name} is admitted" for name in server.admitted() if name in common_names]
    for path, digest in files.items():
        if _digest(server.tree.read(path) or b"") != digest:
            left.append(f"{path} is not what it has to be")
    left += _passing(server, addresses) if addresses else []
    there = [
        f"{their['common_name']} has a session from {their['real']}"
        for their in theirs(sessions, common_names, addresses)
        if their["virtual"]  # a client that was refused is listed for five seconds more, without an address
    ]
    data = []
    dead = management == ANSWERS or (management == DOWN and server.is_down())
    if not dead:
        silent = "does not answer" if management == HELD else "has no management socket, and is not known to be down"
        data.append(f"no session is confirmed dead: the server {silent}")
    return {
        "out": not left,
        "dead": dead and not there,
        "left": left + there,
        "told": data,
        "management": management,
    }


def _passing(server: Server, addresses: Sequence[str]) -> list[str]:
    try:
        inside = server.firewall.members()
    except Refused as refused:
        return [refused.message]
    if inside is None:
        return ["the firewall is not loaded"]
    networks = [ip_network(network) for network in inside]
    return [
        f"the firewall lets {address} pass"
        for address in addresses
        if any(ip_address(address) in network for network in networks)
    ]


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
