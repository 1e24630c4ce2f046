"""What goes out and what comes back, as the device's own strings; nothing is cast and no secret shows in a repr.

And how a session can fail: every text is for a person and names the device, none holds an argument or a row.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Protocol, Self

from atlantis_netcfg.core.errors import DeviceError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from atlantis_netcfg.core.secret import Secret
    from atlantis_netcfg.routeros._types import Row


class Unreachable(DeviceError):
    """No TLS session came about; nothing was sent to the device."""


class CertificateUnknown(DeviceError):
    """The device has a certificate, but we have no pin to compare it with; no login was sent."""

    def __init__(self, message: str, *, fingerprint: str, hint: str | None = None) -> None:
        super().__init__(message, hint=hint)
        self.fingerprint = fingerprint


class CertificateMismatch(DeviceError):
    """The certificate is not the pinned one (another device, a renewal, somebody in between); no login was sent."""

    def __init__(self, message: str, *, pinned_fingerprint: str, fingerprint: str, hint: str | None = None) -> None:
        super().__init__(message, hint=hint)
        self.pinned_fingerprint = pinned_fingerprint
        self.fingerprint = fingerprint


class LoginError(DeviceError):
    """The device refused name and password, or more sessions; the text ends with its words."""


class CommandError(DeviceError):
    """The device refused one command; the session lives on."""

    def __init__(self, message: str, *, trap: Trap, path: str) -> None:
        super().__init__(message)
        self.trap = trap
        self.path = path


class SessionLost(DeviceError):
    """The session is over. `in_flight`: commands were sent and not answered, so that the device may have done them."""

    def __init__(self, message: str, *, in_flight: bool, hint: str | None = None) -> None:
        super().__init__(message, hint=hint)
        self.in_flight = in_flight


class FellSilent(SessionLost):
    """The device owes an answer, and was waited for as long as was agreed; the session was dropped."""


class ProtocolError(SessionLost):
    """What came is not the API, or was cut off in the middle of a word; the session was dropped."""


READING_WINDOW: Final = 100
"""`print` commands in flight at once; a site's router is read in one window. For the others, and for a device that does
not bear so many, see `WINDOW`."""


@dataclass(frozen=True, slots=True)
class Command:
    """One command sentence; a name that starts with `!` unsets, queries are words as sent (`?name=x`, `?#|`)."""

    path: str
    """In the form of the API, command word included: `/ip/address/add`."""
    arguments: tuple[tuple[str, str], ...] = field(default=(), repr=False)
    queries: tuple[str, ...] = field(default=(), repr=False)

    def __post_init__(self) -> None:
        if not self.path.startswith("/") or not all(word.startswith("?") for word in self.queries):
            raise ValueError(f"a command word starts with / and every query word with ?: {self!r}")

    def words(self) -> tuple[str, ...]:
        """Return the sentence, secrets included: for the wire only."""
        return (self.path, *(f"={name}={value}" for name, value in self.arguments), *self.queries)


@dataclass(frozen=True, slots=True)
class Trap:
    """The device's refusal in its own words; `category` 0 to 7 as in the manual, API; None if it gave none."""

    message: str
    category: int | None = None


@dataclass(frozen=True, slots=True)
class Reply:
    """Everything that one command was answered, complete because `!done` was read."""

    rows: tuple[Row, ...] = field(default=(), repr=False)
    ret: str | None = field(default=None, repr=False)
    """What the command returned with `!done`: the `.id` of an added row, the output of a script."""
    trap: Trap | None = None
    path: str = ""
    """The command that was answered."""

    def check(self) -> Self:
        """Return the reply itself. Raises Refused if the device refused the command."""
        if self.trap is not None:
            raise CommandError(f"the device refused {self.path}: {self.trap.message}", trap=self.trap, path=self.path)
        return self


@dataclass(frozen=True, slots=True)
class Endpoint:
    """Where and as whom to log in; the time-outs outlive the gaps of 70 s that satellite links have."""

    host: str
    port: int
    user: str
    password: Secret
    pin: str | None
    """SHA-256 of the DER certificate as hexadecimal digits, colons allowed; None if the device was never met."""
    connect_timeout_s: float = 120.0
    """For the TCP connection and the TLS handshake together; then as much again for the login."""
    reply_timeout_s: float = 180.0
    """Longest silence of a device that owes an answer."""
    window: int = READING_WINDOW
    """Reading commands in flight at once; other commands go in `api.WINDOW`."""
    on_window_shrink: Callable[[], None] = field(default=lambda: None, repr=False, compare=False)
    """Called when the device has fallen silent in `window`, and has then answered in `api.WINDOW`."""
    opening: Callable[[Traffic], object] = field(default=lambda _traffic: None, repr=False, compare=False)
    """Called before a session is opened, with what it will cost: one that fails costs its handshakes, too."""

    def __str__(self) -> str:
        return f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"


@dataclass(slots=True)
class Traffic:
    """What a session cost on the wire so far: TCP's payload in each direction, TLS or SSH included, and round trips.

    A round trip is TCP's handshake, and each time that the device answers what we have said since it was last heard:
    two for the handshake of TLS 1.2, one for that of TLS 1.3. Headers of TCP and IP come to the bytes.
    """

    round_trips: int = 0
    sent_bytes: int = 0
    received_bytes: int = 0
    connections: int = 0
    """Two if the device fell silent in its large window: see `Session.flight`."""
    _is_unanswered: bool = field(default=False, init=False, repr=False, compare=False)
    """We have said something since the device was last heard."""

    def connect(self) -> None:
        """Count a connection that has just been made: its handshake is a round trip."""
        self.connections += 1
        self.round_trips += 1
        self._is_unanswered = False

    def send(self, size: int) -> None:
        """Count bytes that go out."""
        self.sent_bytes += size
        self._is_unanswered = True

    def receive(self, size: int) -> None:
        """Count bytes that have come in: the first ones after we have said something end a round trip."""
        self.received_bytes += size
        self.round_trips += self._is_unanswered
        self._is_unanswered = False

    @property
    def bytes(self) -> int:
        """Both directions together."""
        return self.sent_bytes + self.received_bytes

    @classmethod
    def total(cls, sessions: Iterable[Traffic]) -> Self:
        """Add up what several sessions cost."""
        each = tuple(sessions)
        return cls(
            sum(part.round_trips for part in each),
            sum(entry.sent_bytes for entry in each),
            sum(item.received_bytes for item in each),
            sum(traffic.connections for traffic in each),
        )


class Channel(Protocol):
    """What the executor needs of a session; `api.Session` is one."""

    traffic: Traffic

    async def command(self, command: Command, *, silence_s: float | None = None) -> Reply:
        """Send one command and wait for its answer."""

    async def flight(self, commands: Sequence[Command], *, silence_s: float | None = None) -> list[Reply]:
        """Send commands in batches, one round trip each; the order of execution within a batch is not known."""

    async def close(self, *, wait: bool = True) -> None:
        """End the session, and `wait` until the device knows that; never raises."""
