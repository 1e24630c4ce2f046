"""One emulated router without sockets: sentences in, reply sentences out, time by the caller's clock."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from atlantis_netcfg.twin.answers import Answer, Caller
    from atlantis_netcfg.twin.spec import RouterSpec

__all__ = ["Device", "Service"]


@dataclass(frozen=True, slots=True)
class Service:
    """A row of `/ip/service` as the wire needs it; `certificate` is None where none is set."""

    name: str
    port: int
    enabled: bool
    certificate: str | None
    max_sessions: int
    tls_version: str


class Device:
    """A router twin's core. Synchronous; every method but `path_open`, `services` and `export` may change its state."""

    def __init__(self, spec: RouterSpec, now: Callable[[], float]) -> None:
        """`now` is a monotonic clock in seconds, the one that `due()` speaks about."""
        raise NotImplementedError

    spec: RouterSpec
    revision: int
    """Grows with every change of the configuration: whoever caches `path_open` or `services` looks here."""
    wants_reboot: bool
    """A caller has asked for `/system/reboot` (or a backup load): the wire closes every socket and calls `reboot()`."""

    def challenge(self) -> str:
        """A fresh challenge for the login of before 6.43 (`/login` without a name)."""
        raise NotImplementedError

    def login(self, user: str, password: str, *, via: str, address: str) -> Caller:
        """Open a session over service `via`. Raises Trap in the router's words."""
        raise NotImplementedError

    def login_response(self, user: str, challenge: str, response: str, *, via: str, address: str) -> Caller:
        """The old login's second step: `response` is `00` + md5(0x00 + password + challenge) in hex."""
        raise NotImplementedError

    def logout(self, caller: Caller, *, clean: bool) -> None:
        """The session is gone: closed by its client (`clean`), or silent (the router does not know it yet)."""
        raise NotImplementedError

    def run(self, caller: Caller, words: Sequence[str]) -> list[Answer]:
        """Answer one sentence, without tags.

        If the last answer is not `last`, the sentence goes on under its `.tag` (`/listen`), and `pending` brings the
        rest. `/quit` ends with `!fatal`: the wire closes then.
        """
        raise NotImplementedError

    def pending(self, caller: Caller) -> list[tuple[str, Answer]]:
        """Later answers of sentences that went on, with the tag of their sentence; each is handed out once."""
        raise NotImplementedError

    def due(self) -> float | None:
        """When, on the `now` clock, `tick` has something to do; None if nothing is scheduled."""
        raise NotImplementedError

    def tick(self) -> None:
        """Do what has become due: notice dead sessions, undo their safe mode, run schedulers."""
        raise NotImplementedError

    def reboot(self) -> None:
        """Restart: all sessions and safe mode end (with undo), history is empty, the rest stays as on flash."""
        raise NotImplementedError

    def path_open(self, caller: str, local: str, service: str, *, established: bool = False) -> bool:
        """Would a packet from the technician's address `caller` reach `service` at `local`, and the answer come back.

        `established`: for a session that exists already (its connection is tracked).
        """
        raise NotImplementedError

    def services(self) -> Mapping[str, Service]:
        """The services by name, as they are configured now."""
        raise NotImplementedError

    def export(
        self, *, verbose: bool = False, terse: bool = False, show_sensitive: bool = False, menu: str = "/"
    ) -> str:
        """What `/export` prints, header included."""
        raise NotImplementedError

    def snapshot(self) -> dict[str, Any]:
        """The flash as JSON-able data: the configuration with the changes of an open safe mode undone."""
        raise NotImplementedError

    def restore(self, flash: Mapping[str, Any]) -> None:
        """Boot from what `snapshot` returned; sessions, safe mode and history are gone."""
        raise NotImplementedError
