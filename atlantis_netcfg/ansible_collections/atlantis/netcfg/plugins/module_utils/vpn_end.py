"""End sessions: the client is told to stop, the server forgets it, and the kernel what it had open.

`client-kill CID HALT` alone leaves the session up for five seconds, or as long as the client takes to go; `kill` alone
leaves the client asking for an hour. So it is both, a moment apart.
"""

from __future__ import annotations

import os
import subprocess
import time
from typing import TYPE_CHECKING, Any

from .vpn_management import Closed, Down, Held
from .vpn_server import ANSWERS, DOWN, HELD
from .vpn_status import Torn

if TYPE_CHECKING:
    from typing import Callable, Collection, Sequence

    from .vpn_management import Management
    from .vpn_server import Server
    from .vpn_status import Session

__all__ = ["Ending", "Forgetting", "theirs"]

_HEARD_S = 0.01
"""So long after its HALT the server has sent it; a kill at once would take the message back [measured, 2.6.14]."""
_ROUNDS = 4
"""A client that comes back between two looks is ended again; it has no admission any more."""
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

    def run(
        self, server: Server, meanwhile: Callable[[], None], step: Callable[[str], None] = lambda _name: None
    ) -> None:
        """Do it. `meanwhile` is done after the clients were told, or where nobody can be; it has to come to its end."""
        waits = [meanwhile]
        try:
            with server.asked() as management:
                self._end(management, waits, step)
                self.management = ANSWERS
        except Down:
            self.management = DOWN
        except (Held, Closed, Torn) as silent:
            self.management = HELD
            self.told.append(f"who has a session could not be asked: {silent}")
        while waits:
            waits.pop()()

    def _end(self, management: Management, waits: list[Callable[[], None]], step: Callable[[str], None]) -> None:
        """Halt, then kill, until nobody is there any more."""
        self.left = self._find(management)
        for _ in range(_ROUNDS):
            replies = {session["cid"]: [management.halt(session["cid"])] for session in self.left}
            heard = time.monotonic() + _HEARD_S
            while waits:
                waits.pop()()
            if not self.left:
                break
            step("client told to stop")
            time.sleep(max(0.0, heard - time.monotonic()))
            for session in self._find(management):
                if session["cid"] in replies:
                    replies[session["cid"]].append(management.kill(session["real"]))
            self.ended += [{**session, "replies": replies[session["cid"]]} for session in self.left]
            self.left = self._find(management)
            step("session dead")

    def _find(self, management: Management) -> list[Session]:
        return theirs(management.sessions(), self._common_names, self._addresses)


def theirs(sessions: Sequence[Session], common_names: Collection[str], addresses: Collection[str]) -> list[Session]:
    """The sessions of these names or with these addresses in the VPN."""
    return [one for one in sessions if one["common_name"] in common_names or one["virtual"] in addresses]


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
        for one in self._started:
            try:
                said = one.communicate(timeout=_CONNTRACK_S)[1].decode(errors="replace").strip()
            except subprocess.TimeoutExpired:
                one.kill()
                one.communicate()
                said = f"no end after {_CONNTRACK_S} s"
            if one.returncode != 0 and " 0 flow entries" not in said:  # there were none
                self.told.append(f"open connections were not forgotten: {said}")
