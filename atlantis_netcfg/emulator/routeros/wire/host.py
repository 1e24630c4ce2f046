"""The seam between the connections of a router twin and the router itself."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    import asyncio
    from random import Random

    from atlantis_netcfg.emulator.routeros.wire.dialogue import Dialogue
    from atlantis_netcfg.emulator.routeros.wire.faults import Fault
    from atlantis_netcfg.emulator.routeros.wire.knobs import Knobs, Pace
    from atlantis_netcfg.emulator.routeros.wire.link import Bearer
    from atlantis_netcfg.emulator.routeros.wire.pipe import Pipe
    from atlantis_netcfg.emulator.routeros.wire.tally import Tally
    from atlantis_netcfg.emulator.routeros.wire.tls import Channel

__all__ = ["Host", "Line", "Member"]


class Line(Protocol):
    """A way to the router that is no connection: its serial line."""

    def down(self, *, clean: bool) -> None:
        """The router goes down."""

    def up(self) -> None:
        """The router is back."""

    def check(self) -> None:
        """Log out if somebody has removed this session from `/user/active`."""

    def say_pending(self) -> None:
        """Say what the router has to say unasked."""


class Member(Protocol):
    """A connection as its router sees it."""

    tally: Tally
    pipe: Pipe

    def drop(self) -> None:
        """Reset under both ends at once; what was under way is lost."""

    def vanish(self) -> None:
        """Silence for good, and neither end is told."""

    def rebooted(self, *, clean: bool) -> None:
        """The router has lost its memory; `clean` if it closed its sockets first."""

    def check(self) -> None:
        """Close if somebody has removed this session from `/user/active`."""

    def say_pending(self) -> None:
        """Say what the router has to say unasked."""


class Host(Protocol):
    """What a connection needs of its router."""

    @property
    def bearer(self) -> Bearer:
        """What carries the bytes."""

    @property
    def air(self) -> asyncio.Event:
        """Cleared while the bearer has a gap."""

    @property
    def knobs(self) -> Knobs:
        """The knobs of this moment."""

    @property
    def pace(self) -> Pace:
        """How fast the router answers."""

    @property
    def chance(self) -> Random | None:
        """What shuffles, or None for the order of arrival."""

    @property
    def booting(self) -> bool:
        """The router is down."""

    @property
    def silent_timeout_s(self) -> float:
        """Until the router's TCP gives a silent peer up."""

    def dialogue(self, service: str) -> Dialogue:
        """A session in which nobody has logged in."""

    def channel(self, service: str) -> Channel:
        """TLS with the certificate of this moment, or plain."""

    def admits(self, service: str, address: str | None = None) -> bool:
        """Does the service, which has seen a packet, talk to this client; `address` is his, if not the technician's."""

    def reaches(self, service: str, *, established: bool) -> bool:
        """Do packets get through the router's own configuration, both ways."""

    def opened(self, pipe: Pipe) -> None:
        """A client has connected."""

    def closed(self, pipe: Pipe) -> None:
        """Neither end will be heard of again."""

    def watch(self, task: asyncio.Task[None]) -> None:
        """Stop the twin with an error if `task` fails."""

    def upon(self, command: str) -> list[Fault]:
        """Count a sentence; the faults that strike at it."""

    def strike(self, fault: Fault) -> None:
        """Let a fault happen that concerns more than one connection."""

    async def settle(self) -> None:
        """Let what has changed in the router take effect on its wire: path, listeners, flash, reboot."""

    def tell(self) -> None:
        """Let all sessions say what their `/listen` has seen, and look at the clock again."""
