"""What a probe may ask, as data: nothing else is ever sent."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from atlantis_netcfg.bearers.query import Query


class Place(StrEnum):
    """Where a question is asked from."""

    GATEWAY = "gateway"
    """The site's gateway computer: all its questions travel in one SSH command."""
    LAPTOP = "laptop"
    """This computer."""
    ROUTER = "router"
    """A RouterOS device, by its API: all its questions in one session."""


@dataclass(frozen=True, slots=True)
class Say:
    """Something sent into a stream, and what ends the waiting for its answer."""

    data: bytes
    until: bytes
    """Regular expression, searched in what has come since; the next thing is said when it matches.

    When it does not match within the time, nothing more is said: whatever stands after it in the script depends on it,
    a transmission on the answer that allows it. The listening (`Listen.listen_s`) goes on all the same.
    """
    within_s: float = 5.0


@dataclass(frozen=True, slots=True)
class Listen:
    """Listen to a stream, saying some things first.

    Many devices serve one client: identical questions of several items are asked once, and different ones to the same
    end (place, transport, address and port, or device) one after the other, in the order of the items.
    """

    name: str
    """Of the answer, unlike all others of the same probe."""
    place: Place
    transport: Literal["tcp", "udp", "serial"]
    """udp: datagrams that arrive at `port` are taken, nothing is sent."""
    address: str = ""
    port: int = 0
    device: str = ""
    baud: int = 0
    say: tuple[Say, ...] = ()
    listen_s: float = 0.0
    """After the last thing was said; the stream is closed then."""
    enough: bytes = b""
    """Regular expression over all that was heard: listening ends early; empty: it does not."""
    connect_s: float = 10.0
    max_bytes: int = 262_144
    turn: str = ""
    """Questions with the same word are asked one after another, whatever end they go to: they share a medium."""


@dataclass(frozen=True, slots=True)
class Run:
    """Run a program that only reads; it must stand in `checklist/probes/allowed.py`."""

    name: str
    place: Place
    argv: tuple[str, ...]
    within_s: float = 20.0
    turn: str = ""
    """Questions with the same word are asked one after another, in the order of the items."""


@dataclass(frozen=True, slots=True)
class DhcpDiscoverRequest:
    """Ask a segment for the DHCP servers on it: DISCOVER is broadcast, every OFFER is kept, and none is taken."""

    name: str
    place: Place
    interface: str
    """Its name, or an address: then the interface that has that address, since few sites declare a name."""
    within_s: float = 8.0
    cards: tuple[str, ...] = ()
    """In whose name it is asked besides: a server may answer only those that it knows. Of the interface, always."""


@dataclass(frozen=True, slots=True)
class DdsDiscoverRequest:
    """Ask for the DDS participants at an address of the computer that asks: one without topics comes, and leaves."""

    name: str
    place: Place
    address: str
    """Where others of the pilot look for them."""
    domain: int
    ports: tuple[int, ...]
    """Where they hear announcements."""
    within_s: float = 3.0


@dataclass(frozen=True, slots=True)
class RouterOsQuery:
    """One reading command of RouterOS' API."""

    name: str
    host: str
    query: Query
    place: Literal[Place.ROUTER] = Place.ROUTER


@dataclass(frozen=True, slots=True)
class LinkStatusRequest:
    """How a bearer of the site is: the look of `provision links`, taken once for all who ask."""

    name: str
    bearer: str
    place: Literal[Place.ROUTER] = Place.ROUTER


@dataclass(frozen=True, slots=True)
class AllowListTestRequest:
    """Whether the satellite lets through what is declared and nothing else: `provision prove`. It costs."""

    name: str
    bearer: str
    place: Literal[Place.ROUTER] = Place.ROUTER


Question = (
    Listen | Run | DhcpDiscoverRequest | DdsDiscoverRequest | RouterOsQuery | LinkStatusRequest | AllowListTestRequest
)
