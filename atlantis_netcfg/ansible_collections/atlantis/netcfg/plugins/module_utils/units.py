"""The units of systemd: what they are now, and how they are brought to what is declared."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from .programs import last_lines, run, succeed
from .refused import Refused

if TYPE_CHECKING:
    from typing import Callable

    from .programs import Done

__all__ = ["State", "Systemd"]

_NO_INSTALL = ("static", "generated", "transient", "alias", "indirect", "enabled-runtime", "linked")
"""States of a unit file that `systemctl enable` does not change for the better."""
_SETTLE_S = 1.0
"""So long a service has to live to count as started: one that cannot run mostly dies at once."""


@dataclass(frozen=True)
class State:
    """What systemd tells of a unit."""

    load: str
    active: str
    sub: str
    file: str
    condition: bool
    stale: bool
    """Its file is newer than what systemd has read."""

    @property
    def is_there(self) -> bool:
        """Whether systemd knows it."""
        return self.load not in ("not-found", "")

    def enabled_as(self, *, desired: bool) -> bool:
        """Whether it already starts, or does not start, with the computer, as far as that can be said of it."""
        if self.file in _NO_INSTALL:
            return True
        return (self.file == "enabled") == desired


class Systemd:
    """The manager of this computer; `run` and `sleep` are given by tests."""

    def __init__(self, run: Callable[[list[str]], Done] = run, sleep: Callable[[float], None] = time.sleep) -> None:
        self.run = run
        self.sleep = sleep

    def look(self, name: str) -> State:
        """Ask for the state of a unit."""
        desired = "LoadState,ActiveState,SubState,UnitFileState,ConditionResult,NeedDaemonReload"
        done = self.run(["systemctl", "show", "--property", desired, "--", name])
        if done.code != 0:
            raise Refused(
                f"systemd does not answer:\n{last_lines(done.said)}",
                "`systemctl is-system-running` tells why; a container without systemd cannot be a gateway",
            )
        values = dict(line.split("=", 1) for line in done.said.splitlines() if "=" in line)
        return State(
            load=values.get("LoadState", ""),
            active=values.get("ActiveState", ""),
            sub=values.get("SubState", ""),
            file=values.get("UnitFileState", ""),
            condition=values.get("ConditionResult") != "no",
            stale=values.get("NeedDaemonReload") == "yes",
        )

    def reload_manager(self) -> None:
        """Let systemd read the unit files again."""
        succeed(self.run(["systemctl", "daemon-reload"]), "systemd could not read its unit files again")

    def enable(self, name: str, *, desired: bool) -> None:
        """Let it start, or not start, with the computer."""
        verb = "enable" if desired else "disable"
        succeed(self.run(["systemctl", verb, "--", name]), f"unit {name} could not be {verb}d")

    def order(self, verb: str, name: str, *, wait: bool = True) -> None:
        """Start, stop, restart or reload; without `wait` the order is only placed."""
        if verb != "stop":
            self.run(["systemctl", "reset-failed", "--", name])
        done = self.run(["systemctl", verb, *([] if wait else ["--no-block"]), "--", name])
        if done.code != 0:
            raise self._failure(f"unit {name} could not be brought to {verb}", name)

    def settle(self) -> None:
        """Wait until a service that cannot run has died."""
        self.sleep(_SETTLE_S)

    def must_run(self, name: str, *, waited: bool) -> None:
        """Read back that a unit runs; where nobody waited for it, that it has not failed."""
        state = self.look(name)
        if state.active in ("active", "reloading") or (not waited and state.active == "activating"):
            return
        if state.active == "inactive" and not state.condition:
            raise Refused(
                f"unit {name} did not start: a condition of its unit file does not hold on this computer",
                f"`systemctl status {name}` names the condition",
            )
        if state.active == "inactive" and not waited:
            return
        raise self._failure(f"unit {name} does not stay up: it is {state.active} ({state.sub})", name)

    def _failure(self, what: str, name: str) -> Refused:
        text = last_lines(self.run(["journalctl", "--unit", name, "--lines", "8", "--output", "cat", "--quiet"]).said)
        return Refused(
            what + (f":\n{text}" if text else ""),
            f"on the computer: `systemctl status {name}`, `journalctl -eu {name}`",
        )
