"""From the record to the server, and what became of it there: told in the same way by every command."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

from atlantis_netcfg.core.errors import ExitCode, NetcfgError, OutcomeUnknown, UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.core.events import Subscriber
    from atlantis_netcfg.vpn.authority import Authority, Revoked

__all__ = ["Deployed", "NoPush", "Server"]


@dataclass(frozen=True, slots=True)
class Deployed:
    """What is known of the server after a command."""

    lines: tuple[str, ...] = ()
    errors: tuple[NetcfgError, ...] = ()
    told: Mapping[str, Any] = field(default_factory=dict)
    deployed: bool = True
    """Whether the server was seen to be as recorded."""

    @property
    def exit(self) -> ExitCode:
        """How the command ends: what is recorded stands, so that only the server's part counts here."""
        return max((error.exit for error in self.errors), default=ExitCode.DONE)

    def as_json(self) -> dict[str, Any]:
        """For programs."""
        return {"deployed": self.deployed, **self.told}


class Server(Protocol):
    """The server, as the commands ask it."""

    def hold(self, authority: Authority, notify: Subscriber) -> None:
        """Before anything is signed or sent: raise RecordOlder where the server has what the record does not know."""

    def published(self, notify: Subscriber) -> bytes:
        """The list of revoked certificates that it has, PEM."""

    def deploy(self, authority: Authority, notify: Subscriber) -> Deployed:
        """Bring it to what is recorded."""

    def cut(self, authority: Authority, revoked: Revoked, notify: Subscriber) -> Deployed:
        """The same, and see that those who were revoked are dead."""


class NoPush:
    """`--no-push`: nothing is contacted."""

    def hold(self, authority: Authority, notify: Subscriber) -> None:
        """Nobody can tell; what is sent later is held against the server then."""

    def published(self, notify: Subscriber) -> bytes:  # noqa: ARG002 - as Server has it
        """Nobody is asked. Raises UsageError."""
        raise UsageError("the server's list cannot be had without asking it")

    def deploy(self, authority: Authority, notify: Subscriber) -> Deployed:  # noqa: ARG002 - as Server has it
        """Say what is left to do."""
        line = "the server was not asked (`--no-push`): `provision vpn sync` brings it there"
        return Deployed((line,), deployed=False)

    def cut(self, authority: Authority, revoked: Revoked, notify: Subscriber) -> Deployed:  # noqa: ARG002 - as above
        """Tell that whoever is connected stays so: nobody may take this for done."""
        waits = OutcomeUnknown(
            f"{', '.join(revoked.members)}: on the list, and the server does not have it (`--no-push`): "
            "whoever is connected stays so",
            hint=f"`provision vpn sync` cuts them off: {', '.join(authority.roll().queued)}",
        )
        return Deployed(errors=(waits,), deployed=False)
