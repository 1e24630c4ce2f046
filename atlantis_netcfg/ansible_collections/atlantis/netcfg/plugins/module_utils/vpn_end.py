"""End sessions: the client is told to stop, the server forgets it, and the kernel what it had open.

`client-kill CID HALT` alone leaves the session up for five seconds, or as long as the client takes to go; `kill` alone
leaves the client asking for an hour. So it is both, a moment apart. And the client is not heard any more when it is
killed: OpenVPN ends altogether (`Assertion failed at multi.h`) when the session whose packet it has just received is
killed in the same round of its loop. One of fifty kills under traffic did that [measured, 2.6.14].
"""

from __future__ import annotations

import os
import re
import subprocess
import time
from ipaddress import IPv4Address
from typing import TYPE_CHECKING, Any

from .programs import last_lines
from .vpn_management import Closed, Down, Held
from .vpn_server import ANSWERS, DOWN, HELD
from .vpn_status import Torn

if TYPE_CHECKING:
    from typing import Callable, Collection, Sequence

    from .vpn_management import Management
    from .vpn_server import Server
    from .vpn_status import Session

__all__ = ["Ending", "Forgetting", "Unheard", "peer", "theirs"]

_HEARD_S = 0.01
"""So long after its HALT the server has sent it; a kill at once would take the message back [measured, 2.6.14]."""
_ROUNDS = 4
"""A client that comes back between two looks is ended again; it has no admission any more."""
_AT_ONCE_S = 0.05
"""So long a server that answers at all may take."""
_QUIET_S = 0.005
_LOOKS = 20
"""So often, that long apart, it is looked whether a client is still heard; one that is is not killed."""
_TABLE = "inet p_atlantis_unheard"
_PEER = re.compile(r"(?:[a-z0-9]+:)?([0-9.]+):([0-9]{1,5})")
_CONNTRACK_S = 10
_PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"


class Ending:
    """End every session of these names and these addresses. What came of it stands in the attributes."""

    def __init__(self, common_names: Collection[str], addresses: Collection[str] = ()) -> None:
        self._common_names = common_names
        self._addresses = addresses
        self.ended: list[Session] = []
        """With `replies`, what the server answered."""
        self.left: list[Session] = []
        """Who has a session after all."""
        self.management = DOWN
        self.told: list[str] = []

    def look(self, server: Server) -> list[Session]:
        """Whom it is about, if the server says so at once; nobody, if it does not."""
        try:
            with server.asked(_AT_ONCE_S) as management:
                return self._find(management)
        except (Down, Held, Closed, Torn):
            return []

    def run(
        self,
        server: Server,
        unheard: Unheard,
        meanwhile: Callable[[], None] = lambda: None,
        step: Callable[[str], None] = lambda _name: None,
    ) -> None:
        """Do it. `meanwhile` is done after the clients were told, or where nobody can be; it has to come to its end."""
        waits = [meanwhile]
        try:
            with server.asked() as management:
                self._end(management, unheard, waits, step)
                self.management = ANSWERS
        except Down:
            self.management = DOWN
        except (Held, Closed, Torn) as silent:
            self.management = HELD
            self.told.append(f"who has a session could not be asked: {silent}")
        finally:
            while waits:
                waits.pop()()
            unheard.end()

    def _end(
        self, management: Management, unheard: Unheard, waits: list[Callable[[], None]], step: Callable[[str], None]
    ) -> None:
        """Halt, then kill, until nobody is there any more."""
        self.left = self._find(management)
        for _ in range(_ROUNDS):
            if not self.left:
                break
            replies = {session["cid"]: [management.halt(session["cid"])] for session in self.left}
            received = time.monotonic() + _HEARD_S
            step("client told to stop")
            while waits:
                waits.pop()()
            why = unheard.cover(self.left)
            time.sleep(max(0.0, received - time.monotonic()))
            if why:
                self.told.append(why)
            for session in [] if why else self._silent(management):
                if session["cid"] in replies:
                    replies[session["cid"]].append(management.kill(session["real"]))
            self.ended += [{**session, "replies": replies[session["cid"]]} for session in self.left]
            self.left = self._find(management)
            step("session dead")

    def _silent(self, management: Management) -> list[Session]:
        """Wait until nothing comes from them any more, and give those of whom that is so."""
        before: dict[int, int] = {}
        for _ in range(_LOOKS):
            found = self._find(management)
            silent = [item for item in found if before.get(item["cid"]) == item["received"] and peer(item["real"])]
            if len(silent) == len(found):
                break
            before = {row["cid"]: row["received"] for row in found}
            time.sleep(_QUIET_S)
        return silent

    def _find(self, management: Management) -> list[Session]:
        return theirs(management.sessions(), self._common_names, self._addresses)


class Unheard:
    """As long as this holds, nothing that these clients send reaches the server; what it sends reaches them."""

    def __init__(self, server: Server, sessions: Sequence[Session]) -> None:
        self._server = server
        self._peers = {found for session in sessions if (found := peer(session["real"])) is not None}
        self.holds = False
        """Set by whoever has `text` loaded."""

    @property
    def text(self) -> str:
        """What nft has to be told; empty: nothing."""
        rules = [
            f"ip saddr {address} meta l4proto {{ tcp, udp }} th sport {port} drop" for address, port in self._peers
        ]
        chain = ["chain p_input {", "type filter hook input priority raw", *rules, "}"]
        lines = (f"add table {_TABLE}", f"delete table {_TABLE}", f"table {_TABLE} {{", *chain, "}")
        return "\n".join(lines) if rules else ""

    def cover(self, sessions: Sequence[Session]) -> str:
        """See that it holds for these; gives why it does not."""
        peers = {found for session in sessions if (found := peer(session["real"])) is not None}
        if self.holds and peers <= self._peers:
            return ""
        self._peers |= peers
        done = self._server.run(["nft", self.text]) if self._peers else None
        self.holds = done is None or done.code == 0
        return "" if self.holds or done is None else f"their packets are not kept away: nft: {last_lines(done.said)}"

    def end(self) -> None:
        """Let them be heard again."""
        if self.holds and self._peers:
            self._server.run(["nft", f"delete table {_TABLE}"])


def peer(real: str) -> tuple[str, int] | None:
    """Address and port of a client, as the status tells them; None: it is not IPv4."""
    found = _PEER.fullmatch(real)
    try:
        return (str(IPv4Address(found[1])), int(found[2])) if found else None
    except ValueError:
        return None


def theirs(sessions: Sequence[Session], common_names: Collection[str], addresses: Collection[str]) -> list[Session]:
    """The sessions of these names or with these addresses in the VPN."""
    return [
        session for session in sessions if session["common_name"] in common_names or session["virtual"] in addresses
    ]


class Forgetting:
    """Let the kernel forget what addresses have open, both ways. It takes 12 ms, beside everything else."""

    def __init__(self, addresses: Collection[str]) -> None:
        self.told: list[str] = []
        self._started: list[subprocess.Popen[bytes]] = []
        self._words = [("conntrack", "-D", way, address) for address in addresses for way in ("-s", "-d")]

    def __enter__(self) -> Forgetting:  # noqa: PYI034 - Python 3.8 has no Self
        environment: dict[str, Any] = dict(os.environ, LC_ALL="C.UTF-8", PATH=_PATH)
        try:
            for words in self._words:
                made = subprocess.Popen(  # noqa: S603 - our own words
                    words,
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.PIPE,
                    env=environment,
                )
                self._started.append(made)
        except OSError as error:
            self.told.append(f"open connections were not forgotten: conntrack: {error.strerror}")
        return self

    def __exit__(self, *_: object) -> None:
        for popen in self._started:
            try:
                text = popen.communicate(timeout=_CONNTRACK_S)[1].decode(errors="replace").strip()
            except subprocess.TimeoutExpired:
                popen.kill()
                popen.communicate()
                text = f"no end after {_CONNTRACK_S} s"
            if popen.returncode != 0 and " 0 flow entries" not in text:  # there were none
                self.told.append(f"open connections were not forgotten: {text}")
