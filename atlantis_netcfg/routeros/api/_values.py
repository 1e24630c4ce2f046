"""Commands and replies as the device's own strings (no casts, no secret in a repr), and the session errors.

Every error text is written for the user and names the device; none contains an argument or a row.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, Protocol, Self

from atlantis_netcfg.core.errors import DeviceError
from atlantis_netcfg.core.messages import arg

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from atlantis_netcfg.core.secret import Secret
    from atlantis_netcfg.routeros._types import Row


class Unreachable(DeviceError):
    """No TLS session could be established; nothing was sent to the device."""


class CertificateUnknown(DeviceError):
    """The device presented a certificate, but no pin is known; no login was sent."""

    def __init__(self, message: str, *, fingerprint: str, hint: str | None = None) -> None:
        super().__init__(message, hint=hint)
        self.fingerprint = fingerprint


class CertificateMismatch(DeviceError):
    """The certificate differs from the pin (other device, renewal or interception); no login was sent."""

    def __init__(self, message: str, *, pinned_fingerprint: str, fingerprint: str, hint: str | None = None) -> None:
        super().__init__(message, hint=hint)
        self.pinned_fingerprint = pinned_fingerprint
        self.fingerprint = fingerprint


class LoginError(DeviceError):
    """The device refused the login or another session; the text ends with the device's message."""


class CommandError(DeviceError):
    """The device refused one command; the session continues."""

    def __init__(self, message: str, *, trap: Trap, path: str) -> None:
        super().__init__(message)
        self.trap = trap
        self.path = path


class SessionLost(DeviceError):
    """The session is closed. `in_flight`: commands were sent without a reply, so the device may have executed them."""

    def __init__(self, message: str, *, in_flight: bool, hint: str | None = None) -> None:
        super().__init__(message, hint=hint)
        self.in_flight = in_flight


class FellSilent(SessionLost):
    """The device sent no reply within the agreed time; the session was dropped."""


class ProtocolError(SessionLost):
    """The data received is not the API protocol, or was truncated inside a word; the session was dropped."""


READING_WINDOW: Final = 100
"""`print` commands in flight at once: enough to read a site's router in one window.

`WINDOW` applies to other commands, and to a device that does not support this many.
"""


@dataclass(frozen=True, slots=True)
class Command:
    """One API command; a name that starts with `!` unsets, queries are sent unchanged (`?name=x`, `?#|`)."""

    path: str
    """API path including the command word: `/ip/address/add`."""
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
    """The device's error message; `category` is 0 to 7 (manual, API), None if not given."""

    message: str
    category: int | None = None


@dataclass(frozen=True, slots=True)
class Reply:
    """Complete reply to one command (`!done` was received)."""

    rows: tuple[Row, ...] = field(default=(), repr=False)
    ret: str | None = field(default=None, repr=False)
    """Value returned with `!done`: the `.id` of an added row, or the output of a script."""
    trap: Trap | None = None
    path: str = ""
    """The command to which this is the reply."""

    def check(self) -> Self:
        """Return the reply itself. Raises CommandError if the device refused the command."""
        if self.trap is not None:
            raise CommandError(
                f"the device refused {arg(self.path)}: {arg(self.trap.message)}", trap=self.trap, path=self.path
            )
        return self


@dataclass(frozen=True, slots=True)
class Endpoint:
    """Address, user and timeouts of a session; the timeouts exceed the 70 s gaps of satellite links."""

    host: str
    port: int
    user: str
    password: Secret
    pin: str | None
    """SHA-256 of the DER certificate as hexadecimal digits, colons allowed; None: no certificate pinned yet."""
    connect_timeout_s: float = 120.0
    """Timeout for TCP connection and TLS handshake together; the login has the same timeout again."""
    reply_timeout_s: float = 180.0
    """Maximum silence of a device that owes a reply."""
    window: int = READING_WINDOW
    """Read commands in flight at once; other commands use `api.WINDOW`."""
    on_window_shrink: Callable[[], None] = field(default=lambda: None, repr=False, compare=False)
    """Called when the device did not respond with `window`, but did with `api.WINDOW`."""
    opening: Callable[[Traffic], object] = field(default=lambda _traffic: None, repr=False, compare=False)
    """Called with the expected traffic before a session is opened: a failed session also costs its handshakes."""

    def __str__(self) -> str:
        return f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"


@dataclass(slots=True)
class Traffic:
    """Cost of a session so far: TCP payload in each direction (TLS or SSH included), and round trips.

    Round trips are the TCP handshake, and each time that the device replies to what we sent since its previous reply:
    two for the handshake of TLS 1.2, one for TLS 1.3. TCP and IP headers are not included in the bytes.
    """

    round_trips: int = 0
    sent_bytes: int = 0
    received_bytes: int = 0
    connections: int = 0
    """Connections; two if the device became silent with its large window: see `Session.flight`."""
    _is_unanswered: bool = field(default=False, init=False, repr=False, compare=False)
    """Data was sent since the device last responded."""

    def connect(self) -> None:
        """Count a new connection; its handshake is one round trip."""
        self.connections += 1
        self.round_trips += 1
        self._is_unanswered = False

    def send(self, size: int) -> None:
        """Count sent bytes."""
        self.sent_bytes += size
        self._is_unanswered = True

    def receive(self, size: int) -> None:
        """Count received bytes; the first ones after something was sent complete a round trip."""
        self.received_bytes += size
        self.round_trips += self._is_unanswered
        self._is_unanswered = False

    @property
    def bytes(self) -> int:
        """Bytes of both directions."""
        return self.sent_bytes + self.received_bytes

    @classmethod
    def total(cls, sessions: Iterable[Traffic]) -> Self:
        """Return the sum over several sessions."""
        each = tuple(sessions)
        return cls(
            sum(part.round_trips for part in each),
            sum(entry.sent_bytes for entry in each),
            sum(item.received_bytes for item in each),
            sum(traffic.connections for traffic in each),
        )


class Channel(Protocol):
    """The session interface that the executor needs; implemented by `api.Session`."""

    traffic: Traffic

    async def command(self, command: Command, *, silence_s: float | None = None) -> Reply:
        """Send one command and wait for its reply."""

    async def flight(self, commands: Sequence[Command], *, silence_s: float | None = None) -> list[Reply]:
        """Send commands in batches, one round trip each; the order of execution within a batch is not known."""

    async def close(self, *, wait: bool = True) -> None:
        """Close the session; with `wait`, until the device has confirmed. Never raises."""
