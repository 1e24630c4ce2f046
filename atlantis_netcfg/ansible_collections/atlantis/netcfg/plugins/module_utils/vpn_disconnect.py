"""Disconnect a member at once: CRL, admission, firewall, session, connections; then verify it.

The order is that of facts 5. Without CRL entry and admission no new session is possible; with the firewall closed no
traffic passes; then the session ends. The firewall is loaded in parallel, because it takes longest. Every step runs
even if an earlier one failed, and the result lists the failed steps.

To end a session, the client is ordered to stop, the server drops the session, and the kernel drops its connections.
`client-kill CID HALT` alone leaves the session up for five seconds, or until the client exits; `kill` alone leaves the
client reconnecting for an hour. So both are sent, a moment apart. Packets of the client are blocked before the kill:
OpenVPN exits completely (`Assertion failed at multi.h`) when it kills the session whose packet it has just received in
the same round of its loop. One of fifty kills under traffic did that [measured, 2.6.14].
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import subprocess
import threading
import time
from ipaddress import IPv4Address, ip_address, ip_network
from typing import Any, Callable, Collection, Mapping, Sequence

from atlantis_netcfg.core.messages import arg, msg

from .errors import ModuleError
from .programs import last_lines
from .ssh_access import hold_lock
from .vpn_management import ConnectionEnd, IncompleteStatus, ManagementBusy, ManagementSocket, ServerDown, Session
from .vpn_server import ANSWERS, BUSY, DOWN, ManagedServer

_HEARD_S = 0.01
"""Seconds the server takes to send a HALT; a kill before that would cancel it (measured, 2.6.14)."""
_ROUNDS = 4
"""Rounds; a client that reconnects in between is ended again, because it is no longer admitted."""
_AT_ONCE_S = 0.05
"""Seconds in which a server that is responsive at all responds."""
_QUIET_S = 0.005
_LOOKS = 20
"""Checks, `_QUIET_S` apart, whether a client still sends; one that does is not killed."""
_TABLE = "inet p_atlantis_unheard"
_PEER = re.compile(r"(?:[a-z0-9]+:)?([0-9.]+):([0-9]{1,5})")
_CONNTRACK_S = 10
_PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"


class SessionTermination:
    """Ends every session of these names and addresses. Its attributes hold the result."""

    def __init__(self, common_names: Collection[str], addresses: Collection[str] = ()) -> None:
        self._common_names = common_names
        self._addresses = addresses
        self.ended: list[Session] = []
        """Ended sessions; `replies` holds the responses of the server."""
        self.left: list[Session] = []
        """Sessions that still exist."""
        self.management = DOWN
        self.messages: list[str] = []

    def look(self, server: ManagedServer) -> list[Session]:
        """Return the matching sessions if the server responds at once; an empty list if it does not."""
        try:
            with server.connection(_AT_ONCE_S) as management:
                return self._find(management)
        except (ServerDown, ManagementBusy, ConnectionEnd, IncompleteStatus):
            return []

    def run(
        self,
        server: ManagedServer,
        unheard: ClientBlock,
        meanwhile: Callable[[], None] = lambda: None,
        step: Callable[[str], None] = lambda _name: None,
    ) -> None:
        """End the sessions. `meanwhile` is always run: after the clients were ordered to stop, or if none can be."""
        waits = [meanwhile]
        try:
            with server.connection() as management:
                self._end(management, unheard, waits, step)
                self.management = ANSWERS
        except ServerDown:
            self.management = DOWN
        except (ManagementBusy, ConnectionEnd, IncompleteStatus) as silent:
            self.management = BUSY
            self.messages.append(msg(f"the server's sessions could not be listed: {arg(silent)}"))
        finally:
            while waits:
                waits.pop()()
            unheard.end()

    def _end(
        self,
        management: ManagementSocket,
        unheard: ClientBlock,
        waits: list[Callable[[], None]],
        step: Callable[[str], None],
    ) -> None:
        """Halt, then kill, until none of the sessions is left."""
        self.left = self._find(management)
        for _ in range(_ROUNDS):
            if not self.left:
                break
            replies = {session["cid"]: [management.halt(session["cid"])] for session in self.left}
            deadline = time.monotonic() + _HEARD_S
            step("client told to stop")
            while waits:
                waits.pop()()
            why = unheard.cover(self.left)
            time.sleep(max(0.0, deadline - time.monotonic()))
            if why:
                self.messages.append(why)
            for session in [] if why else self._silent(management):
                if session["cid"] in replies:
                    replies[session["cid"]].append(management.kill(session["real"]))
            self.ended += [{**session, "replies": replies[session["cid"]]} for session in self.left]
            self.left = self._find(management)
            step("session ended")

    def _silent(self, management: ManagementSocket) -> list[Session]:
        """Wait until the sessions receive no more data, and return the silent ones."""
        before: dict[int, int] = {}
        for _ in range(_LOOKS):
            sessions = self._find(management)
            silent = [item for item in sessions if before.get(item["cid"]) == item["received"] and peer(item["real"])]
            if len(silent) == len(sessions):
                break
            before = {row["cid"]: row["received"] for row in sessions}
            time.sleep(_QUIET_S)
        return silent

    def _find(self, management: ManagementSocket) -> list[Session]:
        return filter_sessions(management.sessions(), self._common_names, self._addresses)


class ClientBlock:
    """Temporary nft rules that drop all packets from these clients to the server, but not its packets to them."""

    def __init__(self, server: ManagedServer, sessions: Sequence[Session]) -> None:
        self._server = server
        self._peers = {endpoint for session in sessions if (endpoint := peer(session["real"])) is not None}
        self.holds = False
        """Whether the rules are loaded; set by the code that loads `text`."""

    @property
    def text(self) -> str:
        """Script for nft; empty if there are no clients."""
        rules = [
            f"ip saddr {address} meta l4proto {{ tcp, udp }} th sport {port} drop" for address, port in self._peers
        ]
        chain = ["chain p_input {", "type filter hook input priority raw", *rules, "}"]
        lines = (f"add table {_TABLE}", f"delete table {_TABLE}", f"table {_TABLE} {{", *chain, "}")
        return "\n".join(lines) if rules else ""

    def cover(self, sessions: Sequence[Session]) -> str:
        """Block the clients of these sessions too; return why that failed, or an empty string."""
        peers = {endpoint for session in sessions if (endpoint := peer(session["real"])) is not None}
        if self.holds and peers <= self._peers:
            return ""
        self._peers |= peers
        result = self._server.run(["nft", self.text]) if self._peers else None
        self.holds = result is None or result.code == 0
        return (
            ""
            if self.holds or result is None
            else msg(f"their packets are not blocked: nft: {arg(last_lines(result.output))}")
        )

    def end(self) -> None:
        """Remove the rules, so that the clients are no longer blocked."""
        if self.holds and self._peers:
            self._server.run(["nft", f"delete table {_TABLE}"])


def peer(real: str) -> tuple[str, int] | None:
    """Parse address and port of a client from the status; None if it is not IPv4."""
    match = _PEER.fullmatch(real)
    try:
        return (str(IPv4Address(match[1])), int(match[2])) if match else None
    except ValueError:
        return None


def filter_sessions(
    sessions: Sequence[Session], common_names: Collection[str], addresses: Collection[str]
) -> list[Session]:
    """Return the sessions with one of these common names or VPN addresses."""
    return [
        session for session in sessions if session["common_name"] in common_names or session["virtual"] in addresses
    ]


class ConntrackFlush:
    """Removes the connection tracking entries of addresses, in both directions. It takes 12 ms, in parallel."""

    def __init__(self, addresses: Collection[str]) -> None:
        self.messages: list[str] = []
        self._started: list[subprocess.Popen[bytes]] = []
        self._words = [("conntrack", "-D", way, address) for address in addresses for way in ("-s", "-d")]

    def __enter__(self) -> ConntrackFlush:  # noqa: PYI034 - Python 3.8 has no Self
        environment: dict[str, Any] = dict(os.environ, LC_ALL="C.UTF-8", PATH=_PATH)
        try:
            for words in self._words:
                process = subprocess.Popen(  # noqa: S603 - our own words
                    words,
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.PIPE,
                    env=environment,
                )
                self._started.append(process)
        except OSError as error:
            self.messages.append(msg(f"open connections were not deleted: conntrack: {arg(error.strerror)}"))
        return self

    def __exit__(self, *_: object) -> None:
        for popen in self._started:
            try:
                text = popen.communicate(timeout=_CONNTRACK_S)[1].decode(errors="replace").strip()
            except subprocess.TimeoutExpired:
                popen.kill()
                popen.communicate()
                text = msg(f"timed out after {arg(_CONNTRACK_S)} s")
            if popen.returncode != 0 and " 0 flow entries" not in text:  # there were none
                self.messages.append(msg(f"open connections were not deleted: {arg(text)}"))


class _StepLog:
    """Log of the steps: their times in milliseconds since the start, and the errors of failed steps."""

    def __init__(self) -> None:
        self._began = time.monotonic()
        self.steps: list[list[Any]] = []
        self.messages: list[str] = []

    def step(self, name: str) -> None:
        self.steps.append([name, round((time.monotonic() - self._began) * 1000, 3)])

    def try_step(self, act: Callable[..., None], *arguments: Any) -> bool:  # noqa: ANN401 - whatever the act takes
        """Run a step and record its error; return whether it succeeded."""
        try:
            act(*arguments)
        except ModuleError as refused:
            self.messages.append(
                msg(f"{arg(refused.message)}; {arg(refused.hint)}") if refused.hint else refused.message
            )
            return False
        return True


def revoke(
    server: ManagedServer, files: Sequence[Mapping[str, Any]], common_names: Sequence[str], addresses: Sequence[str]
) -> dict[str, Any]:
    """Revoke members. `files`: changed CRL and ruleset. Return `steps`, `ended` and the result of `verify`."""
    act = _StepLog()
    server.require_installed()
    file_by_path = {file["path"]: file for file in files}
    ending = SessionTermination(common_names, addresses)
    with contextlib.ExitStack() as stack:
        try:
            stack.enter_context(hold_lock(server.tree))
        except ModuleError as busy:
            # Whoever holds it may put older files back, which the second look tells. To wait for him would be worse.
            act.messages.append(busy.message)
        unheard = ClientBlock(server, ending.look(server))
        crl_file = file_by_path.get(server.place.crl)
        # Whose list is older than the server's has a ruleset from the same record: it would let the revoked pass.
        current = act.try_step(_hold_list, server, crl_file)
        ruleset = file_by_path.get(server.place.firewall) if current else None
        closing = threading.Thread(target=act.try_step, args=(_close, server, ruleset, addresses, unheard))
        closing.start()
        if current and act.try_step(_put_list, server, crl_file):
            act.step("list installed")
        for name in common_names:
            act.try_step(server.tree.remove, server.place.admission(name))
        act.step("no longer admitted")

        def wait_for_closing() -> None:
            closing.join()
            act.step("firewall closed")

        ending.run(server, unheard, wait_for_closing, act.step)
        with ConntrackFlush(addresses) as forgetting:
            act.try_step(_keep, server, ruleset)
            act.step("written to disk")
            digests = {path: _digest(file["content"].encode()) for path, file in file_by_path.items()}
            verification = verify(server, common_names, addresses, digests, (ending.management, ending.left))
    act.step("verified")
    result = [*act.messages, *ending.messages, *forgetting.messages, *verification["told"]]
    return {**verification, "steps": act.steps, "ended": ending.ended, "told": result}


def _hold_list(server: ManagedServer, file: Mapping[str, Any] | None) -> None:
    """Stage the new CRL beside its destination. Raises `ModuleError` if it must not be installed."""
    if file is None or server.tree.read(server.place.crl) == file["content"].encode():
        return
    try:
        server.check_crl(_stage(server, file))
    except ModuleError:
        server.tree.unstage(server.place.crl)
        raise


def _put_list(server: ManagedServer, file: Mapping[str, Any] | None) -> None:
    """Move the staged CRL into place, unless it is already there."""
    if file is not None and server.tree.read(server.place.crl) != file["content"].encode():
        server.tree.put(server.place.crl)


def _close(
    server: ManagedServer, file: Mapping[str, Any] | None, addresses: Sequence[str], unheard: ClientBlock
) -> None:
    """Load the ruleset without the addresses; if that fails, remove the addresses from the loaded one.

    The same transaction blocks packets from their clients: each transaction costs the kernel 10 ms.
    """
    if file is None:
        server.firewall.take_out(addresses)
        return
    beside = _stage(server, file)
    try:
        server.firewall.load_only(beside, unheard.text)
        unheard.holds = True
        server.tree.put(server.place.firewall)
    except ModuleError:
        server.firewall.take_out(addresses)
        raise
    finally:
        server.tree.unstage(server.place.firewall)


def _stage(server: ManagedServer, file: Mapping[str, Any]) -> str:
    owner = server.tree.uid(file.get("owner") or "root"), server.tree.gid(file.get("group") or "root")
    return server.tree.stage(file["path"], file["content"].encode(), int(file.get("mode") or "0644", 8), *owner)


def _keep(server: ManagedServer, file: Mapping[str, Any] | None) -> None:
    """Sync the folders to disk and record what is loaded; the next push repairs a power cut before that."""
    place = server.place
    for path in (place.admission("any"), place.crl, place.firewall):
        server.tree.sync(path)
    if file is not None and server.tree.read(place.firewall) == file["content"].encode():
        server.firewall.note(file["content"].encode())


def verify(
    server: ManagedServer,
    common_names: Sequence[str],
    addresses: Sequence[str],
    files: Mapping[str, str],
    result: tuple[str, Sequence[Session]] | None = None,
) -> dict[str, Any]:
    """Verify that the members are out. `files`: SHA-256 of required files. `result`: known sessions, if any.

    Returns `out` (none of them can connect, and none of their traffic passes), `dead` (the server reports no session of
    theirs), `problems` (messages), `told`, and `management` (state of the management socket).
    """
    management, sessions = result if result is not None else server.sessions()[:2]
    problems = [msg(f"{arg(name)} is admitted") for name in server.list_admitted_names() if name in common_names]
    for path, digest in files.items():
        if _digest(server.tree.read(path) or b"") != digest:
            problems.append(msg(f"{arg(path)} does not have the expected content"))
    problems += _firewall_problems(server, addresses) if addresses else []
    there = [
        msg(f"{arg(their['common_name'])} has a session from {arg(their['real'])}")
        for their in filter_sessions(sessions, common_names, addresses)
        if their["virtual"]  # a client that was refused is listed for five seconds more, without an address
    ]
    data = []
    dead = management == ANSWERS or (management == DOWN and server.is_down())
    if not dead:
        silent = (
            "does not respond"
            if management == BUSY
            else "has no management socket, and it is unknown whether it is down"
        )
        data.append(msg(f"no session is confirmed as ended: the server {arg(silent)}"))
    return {
        "out": not problems,
        "dead": dead and not there,
        "left": problems + there,
        "told": data,
        "management": management,
    }


def _firewall_problems(server: ManagedServer, addresses: Sequence[str]) -> list[str]:
    try:
        inside = server.firewall.members()
    except ModuleError as refused:
        return [refused.message]
    if inside is None:
        return ["the firewall is not loaded"]
    networks = [ip_network(network) for network in inside]
    return [
        msg(f"the firewall lets {arg(address)} pass")
        for address in addresses
        if any(ip_address(address) in network for network in networks)
    ]


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
