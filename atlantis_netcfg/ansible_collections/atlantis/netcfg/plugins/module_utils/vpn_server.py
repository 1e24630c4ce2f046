"""The running server: everything that a request works with, and what several requests do."""

from __future__ import annotations

import contextlib
import os
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from . import vpn_list
from .programs import run
from .refused import Refused
from .stamps import Stamps
from .tree import Tree
from .vpn_firewall import Firewall
from .vpn_management import Closed, Down, Held, opened
from .vpn_status import Torn, sessions, written

if TYPE_CHECKING:
    from typing import Callable, Iterator

    from .programs import Done
    from .vpn_management import Management
    from .vpn_place import Place
    from .vpn_status import Session

__all__ = ["ANSWERS", "DOWN", "HELD", "Server"]

ANSWERS, HELD, DOWN = "answers", "held", "down"
"""What the management socket does; `held`: another client has it, or the server hangs."""
_SILENT = (Held, Closed, Torn)
_CONF = "/proc/sys/net/ipv4/conf"


@dataclass(frozen=True)
class Server:
    """The files, the firewall and the conversation of one server. `run` and `now` are given by tests."""

    place: Place
    tree: Tree = field(default_factory=Tree)
    run: Callable[[list[str]], Done] = run
    now: Callable[[], float] = time.time

    @property
    def stamps(self) -> Stamps:
        """What the toolkit has noted on this computer."""
        return Stamps(self.tree)

    @property
    def firewall(self) -> Firewall:
        """The VPN's table."""
        return Firewall(self.place, self.tree, self.stamps, self.run)

    def must_be(self) -> None:
        """Refuse a computer on which the server was never set up."""
        if self.tree.read(self.place.ca) is None:
            raise Refused(
                "no server of the VPN was ever set up on this computer",
                "`provision site=…` does that; then type the same again",
            )

    def admitted(self) -> list[str]:
        """The common names that have a file, whatever is in it."""
        with contextlib.suppress(FileNotFoundError, NotADirectoryError):
            return sorted(name for name in os.listdir(self.tree.at(self.place.ccd)) if not name.startswith("."))  # noqa: PTH208 - names are wanted
        return []

    def crl(self, path: str | None = None) -> vpn_list.Crl | None:
        """The list of revoked certificates in its place, or at another one."""
        return vpn_list.read(path or self.tree.at(self.place.crl), self.tree.at(self.place.ca), self.run)

    def hold(self, beside: str) -> None:
        """Refuse a list that must not take the place of the one that is there. Raises `Refused`."""
        there = self.tree.read(self.place.crl) is not None
        vpn_list.accept(self.crl(beside), self.crl() if there else None, self.now())

    def redirecting(self) -> list[str]:
        """Interfaces by which the kernel may tell members of a way past this server; `default`: those to come."""
        folder = self.tree.at(_CONF)
        try:
            names = sorted(os.listdir(folder))  # noqa: PTH208 - names are wanted
        except (FileNotFoundError, NotADirectoryError):
            return []
        return [name for name in names if (self.tree.read(f"{_CONF}/{name}/send_redirects") or b"0").strip() != b"0"]

    def stop_redirects(self) -> bool:
        """See that it tells nobody; whether anything had to be done."""
        names = self.redirecting()
        for name in names:
            with open(self.tree.at(f"{_CONF}/{name}/send_redirects"), "w") as file:  # noqa: PTH123 - as in `tree`
                file.write("0\n")
        return bool(names)

    @contextlib.contextmanager
    def asked(self, patience_s: float | None = None) -> Iterator[Management]:
        """A conversation with the server. Raises `Down`, `Held`, `Closed`."""
        patience_s = self.place.patience_s if patience_s is None else patience_s
        with opened(self.tree.at(self.place.socket), patience_s) as management:
            management.greeted()
            yield management

    def sessions(self) -> tuple[str, list[Session], str]:
        """Who has a session: what the socket does, the sessions that it tells, and why it tells none."""
        try:
            with self.asked() as management:
                return ANSWERS, management.sessions(), ""
        except Down as down:
            return DOWN, [], str(down)
        except _SILENT as silent:
            return HELD, [], str(silent)

    def from_file(self) -> tuple[list[Session], int]:
        """Who had a session when the status file was written, and when that was; time 0: it cannot be read."""
        lines = (self.tree.read(self.place.status) or b"").decode(errors="replace").splitlines()
        try:
            return sessions(lines), written(lines)
        except Torn:
            return [], 0

    def unit(self) -> dict[str, str]:
        """What systemd tells of the unit; empty: it tells nothing."""
        desired = "LoadState,ActiveState,SubState,MainPID"
        done = self.run(["systemctl", "show", "--property", desired, "--", self.place.unit])
        if done.code != 0:
            return {}
        return dict(line.split("=", 1) for line in done.said.splitlines() if "=" in line)

    def is_down(self) -> bool:
        """Whether the server surely does not run, so that nobody can have a session: its socket alone does not tell."""
        values = self.unit()
        return values.get("LoadState") == "loaded" and values.get("MainPID") == "0"
