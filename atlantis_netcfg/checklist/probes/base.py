"""Data model of checklist steps: the cell of a step, its probe, the probe's requests and their results.

A probe is two functions: `asks` returns its requests, `judge` returns findings and evidence. Also here: the findings
for a request without a complete result, from which nothing follows, and one-line evidence.

Requests are data; nothing else is ever sent.

No response is a result, and is never confused with a refusal.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any, Literal, Protocol

from atlantis_netcfg.checklist import report
from atlantis_netcfg.core.events import Verdict, worst
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory import model
from atlantis_netcfg.links import LinkFinding

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from datetime import datetime

    from atlantis_netcfg.checklist.probes.robot_files import RobotFiles
    from atlantis_netcfg.inventory import Host, Inventory
    from atlantis_netcfg.links.qualify.record import QualifyRecord
    from atlantis_netcfg.links.status import Query
    from atlantis_netcfg.robots.observation import RobotObservation


class Place(StrEnum):
    """Where a request is sent from."""

    GATEWAY = "gateway"
    """The site's gateway computer: all its requests travel in one SSH command."""
    LAPTOP = "laptop"
    """This computer."""
    ROUTER = "router"
    """A RouterOS device, by its API: all its requests travel in one session."""


@dataclass(frozen=True, slots=True)
class Say:
    """Data sent into a stream, and the pattern that ends the wait for its response."""

    data: bytes
    until: bytes
    """Regular expression, searched in the data received since; a match sends the next message.

    Without a match in time, nothing more is sent: later messages depend on it.
    For example, a transmission depends on the response that allows it. Listening (`Listen.listen_s`) continues.
    """
    within_s: float = 5.0


@dataclass(frozen=True, slots=True)
class Listen:
    """Listen to a stream, after sending some messages.

    Many devices serve one client: identical requests of several items are sent once, and different ones to the same
    endpoint (place, transport, address and port, or device) one after the other, in the order of the items.
    """

    name: str
    """Name of the response, unique within the probe."""
    place: Place
    transport: Literal["tcp", "udp", "serial"]
    """udp: datagrams that arrive at `port` are received, nothing is sent."""
    address: str = ""
    port: int = 0
    device: str = ""
    baud: int = 0
    say: tuple[Say, ...] = ()
    listen_s: float = 0.0
    """Time to listen after the last message was sent; the stream is closed then."""
    enough: bytes = b""
    """Regular expression over all received data; a match ends listening early. Empty: none."""
    connect_s: float = 10.0
    max_bytes: int = 262_144
    turn: str = ""
    """Requests with the same value run one after another, whatever their endpoint: they share a medium."""


@dataclass(frozen=True, slots=True)
class RunProgram:
    """Run a read-only program; it must be listed in `core/reading_programs.py`."""

    name: str
    place: Place
    argv: tuple[str, ...]
    within_s: float = 20.0
    turn: str = ""
    """Requests with the same value run one after another, in the order of the items."""


@dataclass(frozen=True, slots=True)
class DhcpDiscoverRequest:
    """Discover the DHCP servers of a segment: DISCOVER is broadcast, every OFFER is kept, and none is accepted."""

    name: str
    place: Place
    interface: str
    """Name of the interface, or its address, since few sites declare a name."""
    within_s: float = 8.0
    cards: tuple[str, ...] = ()
    """Further cards to send requests for: a server may serve only known cards. The interface's own is always used."""


@dataclass(frozen=True, slots=True)
class RouterSolicitRequest:
    """Discover the IPv6 routers of a segment: every advertisement is kept, and none is applied."""

    name: str
    place: Place
    interface: str
    """As in `DhcpDiscoverRequest`."""
    within_s: float = 8.0
    """Routers respond within 0.5 s, and within 3.5 s if they have just advertised (RFC 4861, 6.2.6)."""


@dataclass(frozen=True, slots=True)
class DdsDiscoverRequest:
    """Discover the DDS participants at a local address: a participant without topics announces itself, and leaves."""

    name: str
    place: Place
    address: str
    """Address at which others of the pilot look for the participants."""
    domain: int
    ports: tuple[int, ...]
    """Ports at which the participants receive announcements."""
    within_s: float = 3.0


@dataclass(frozen=True, slots=True)
class ReflectRequest:
    """Send messages to another computer of the pilot, which returns their content (`computers/reflector.py`).

    They are sent by the regular route for that address, like the data of any program.
    """

    name: str
    place: Place
    source: str
    """VPN address of the computer that sends the request."""
    address: str
    port: int
    count: int = 3
    within_s: float = 10.0
    """Time to wait for the responses."""


@dataclass(frozen=True, slots=True)
class RouterOsQuery:
    """One read-only command of RouterOS' API."""

    name: str
    host: str
    query: Query
    place: Literal[Place.ROUTER] = Place.ROUTER


@dataclass(frozen=True, slots=True)
class LinkStatusRequest:
    """Status of a link of the site, as in `provision links`; read once for all items that need it."""

    name: str
    link: str
    place: Literal[Place.ROUTER] = Place.ROUTER


@dataclass(frozen=True, slots=True)
class AllowListTestRequest:
    """Whether the satellite allows exactly the traffic in the inventory (`provision measure satellite`, metered)."""

    name: str
    link: str
    place: Literal[Place.ROUTER] = Place.ROUTER


@dataclass(frozen=True, slots=True)
class LinkRecordRequest:
    """Newest stored measurement of a link, made by `provision measure link`. Nothing is sent."""

    name: str
    site: str
    link: str
    place: Literal[Place.LAPTOP] = Place.LAPTOP


@dataclass(frozen=True, slots=True)
class RobotsHeardRequest:
    """Listen for robots (DDS), once for all items that need it; nothing is published."""

    name: str
    host: str = ""
    """Name of the pilot's computer that listens; empty: this one."""
    seconds: float = 20.0
    place: Literal[Place.LAPTOP] = Place.LAPTOP


@dataclass(frozen=True, slots=True)
class VpnMembersRequest:
    """VPN members that are robots, and members with a session on the server; read once for all items that need it."""

    name: str
    place: Literal[Place.LAPTOP] = Place.LAPTOP


Question = (
    Listen
    | RunProgram
    | DhcpDiscoverRequest
    | RouterSolicitRequest
    | DdsDiscoverRequest
    | ReflectRequest
    | RouterOsQuery
    | LinkStatusRequest
    | AllowListTestRequest
    | LinkRecordRequest
    | RobotsHeardRequest
    | VpnMembersRequest
)


class Trouble(StrEnum):
    """Reason why there is no complete response."""

    REFUSED = "refused"
    """A computer is there, but nothing listens, or it refused the connection."""
    SILENT = "silent"
    """No response from that address within the time."""
    UNREACHABLE = "unreachable"
    """No route, or no such host."""
    BUSY = "busy"
    """Another program holds the serial port, or the UDP port on which a stream arrives."""
    MISSING = "missing"
    """No such serial port, no such program on that computer."""
    DENIED = "denied"
    """Permission denied."""
    CLOSED = "closed"
    """The other end closed the connection at once, like a server that accepts one client only."""
    NO_PLACE = "no place"
    """The computer or router that should have sent the request was not reached: nothing is known."""


@dataclass(frozen=True, slots=True)
class Transcript:
    """Data received on a stream."""

    trouble: Trouble | None
    words: str = ""
    """Error message of the system or of the place."""
    chunks: tuple[tuple[float, bytes], ...] = ()
    """Seconds since `began` and the data received then: as it came from a stream, or one UDP datagram each."""
    began: float = 0.0
    """Seconds since 1970 by the clock of the computer that listened."""
    ended_s: float = 0.0
    """End of listening, seconds since `began`."""
    senders: tuple[str, ...] = ()
    """UDP only: sender address of each of `chunks`; empty: not recorded, or not UDP."""

    @property
    def data(self) -> bytes:
        """All data as one value."""
        return b"".join(data for _, data in self.chunks)


@dataclass(frozen=True, slots=True)
class CommandResult:
    """Output of a program."""

    trouble: Trouble | None
    words: str = ""
    rc: int = 0
    out: str = ""
    err: str = ""
    began: float = 0.0
    """Seconds since 1970 by the clock of the computer that ran it."""
    request_time: float = 0.0
    """When the request was sent, seconds since 1970 by this computer's clock; 0: not recorded."""
    response_time: float = 0.0
    """When its response arrived; the other clock's reading in between shows how wrong that clock is."""


@dataclass(frozen=True, slots=True)
class Rows:
    """Rows of a RouterOS menu."""

    trouble: Trouble | None
    words: str = ""
    rows: tuple[Mapping[str, str], ...] | None = None
    """None: the device does not know the menu, or refused."""
    request_time: float = 0.0
    """When the request was sent, seconds since 1970 by this computer's clock; 0: not recorded."""
    response_time: float = 0.0
    """When its response arrived; the other clock's reading in between shows how wrong that clock is."""


@dataclass(frozen=True, slots=True)
class LinkStatusResult:
    """Status of a link: the dictionary of `operations.links.LinksStatus.as_dict` for it."""

    trouble: Trouble | None
    words: str = ""
    link: Mapping[str, Any] | None = None


@dataclass(frozen=True, slots=True)
class AllowListTestResult:
    """Result of the test of the satellite's allow-list."""

    trouble: Trouble | None
    words: str = ""
    findings: tuple[LinkFinding, ...] = ()
    bill: str = ""
    """Cost of the test, in words."""
    seconds: float = 0.0
    """How long silent targets were tried."""


@dataclass(frozen=True, slots=True)
class LinkRecordResult:
    """The newest measurement of a link, judged from its samples."""

    trouble: Trouble | None
    words: str = ""
    record: QualifyRecord | None = None
    """None without trouble: no record exists."""
    now: datetime | None = None
    """When it was read, by this computer's clock."""
    is_rehearsal: bool = False
    """Whether it is from a rehearsal on an emulated link; otherwise such a measurement does not count."""


@dataclass(frozen=True, slots=True)
class DhcpOffer:
    """Offer of one DHCP server."""

    server: str
    """Server identifier (RFC 2132, option 54), otherwise the address that the packet came from."""
    mac: str | None
    """Network card that sent it, in lower case with colons; None: not reported by the system."""
    address: str
    """Offered address."""
    router: str | None = None
    """Offered default gateway (option 3), the first."""


@dataclass(frozen=True, slots=True)
class DhcpOffers:
    """The DHCP servers that responded on a segment; no trouble and no offers: none within the timeout."""

    trouble: Trouble | None
    words: str = ""
    offers: tuple[DhcpOffer, ...] = ()


@dataclass(frozen=True, slots=True)
class RouterAdvertisement:
    """Advertisement of one IPv6 router (RFC 4861, 4.2)."""

    address: str
    mac: str
    """Network card that sent it, in lower case with colons."""
    lifetime_s: int
    """Lifetime as a default router; 0: it is not a default router."""
    prefixes: tuple[str, ...] = ()
    """Prefixes from which computers form their addresses, or which they reach without a router."""


@dataclass(frozen=True, slots=True)
class RouterAdvertisements:
    """The IPv6 routers that advertised themselves on a segment; no trouble and no routers: none."""

    trouble: Trouble | None
    words: str = ""
    routers: tuple[RouterAdvertisement, ...] = ()


@dataclass(frozen=True, slots=True)
class DdsDiscoverResult:
    """Data sent by DDS participants to one that announced itself; no trouble and no data: none responded."""

    trouble: Trouble | None
    words: str = ""
    prefix: bytes = b""
    """Identity of the participant that announced itself, new each time (GUID prefix, DDSI-RTPS 9.3.1)."""
    datagrams: tuple[tuple[str, bytes], ...] = ()
    """Address of the sender, and the message."""


@dataclass(frozen=True, slots=True)
class ReflectReply:
    """A datagram received while waiting for responses."""

    sender: str
    """Address that it came from."""
    interface: str
    """Interface on which it arrived."""
    delay_s: float
    """Time since the message with its token was sent; without a token, since the first message."""
    data: bytes


@dataclass(frozen=True, slots=True)
class ReflectResult:
    """The returned messages; no trouble and no messages: no response within the timeout."""

    trouble: Trouble | None
    words: str = ""
    tokens: tuple[str, ...] = ()
    """Tokens of the sent messages, new each time."""
    answers: tuple[ReflectReply, ...] = ()


@dataclass(frozen=True, slots=True)
class RobotsHeardResult:
    """The robots that were detected, and what they publish."""

    trouble: Trouble | None
    words: str = ""
    observation: RobotObservation | None = None


@dataclass(frozen=True, slots=True)
class VpnMember:
    """A VPN member that is a robot."""

    name: str
    vehicle: str
    has_certificate: bool
    """Whether it has a certificate that is not revoked."""
    session: str = ""
    """Address and port from which it is connected now; empty: not connected."""


@dataclass(frozen=True, slots=True)
class VpnMembersResult:
    """The VPN members that are robots."""

    trouble: Trouble | None
    words: str = ""
    members: tuple[VpnMember, ...] = ()


Answer = (
    Transcript
    | CommandResult
    | Rows
    | LinkStatusResult
    | AllowListTestResult
    | LinkRecordResult
    | DhcpOffers
    | RouterAdvertisements
    | DdsDiscoverResult
    | ReflectResult
    | RobotsHeardResult
    | VpnMembersResult
)


@dataclass(frozen=True, slots=True)
class ProbeResult:
    """Findings and evidence of a probe. A result without findings never passes."""

    findings: tuple[LinkFinding, ...]
    """The worst finding is the item's verdict; its message is the first of the worst ones."""
    evidence: tuple[report.Evidence, ...] = ()

    @property
    def verdict(self) -> Verdict:
        """Worst verdict of the findings; ERROR if there are none: such a probe is broken."""
        return worst(finding.verdict for finding in self.findings) if self.findings else Verdict.ERROR


class Probe(Protocol):
    """A probe of the checklist; the first line of its class docstring says what must hold."""

    def asks(self) -> tuple[Question, ...]:
        """Return all requests; their names must be unique within the probe."""
        ...

    def judge(self, results: Mapping[str, Answer]) -> ProbeResult:
        """Judge the responses, one for each request by its name."""
        ...


@dataclass(frozen=True, slots=True)
class Consent:
    """Consent that a person must give before an active step; shown verbatim."""

    question: str
    """`Sparus is in the water, and its modem may transmit`."""
    prompt: str = ""
    """What the person does while the tool listens: `ask the pilot to move the right stick in circles`."""
    cost: bool = False
    """Whether it costs on a metered link, so that `--accept-cost` or a yes is required as well."""


@dataclass(frozen=True, slots=True)
class EvidenceRequest:
    """Evidence that a person must give in addition to the verdict."""

    kind: model.EvidenceKind = model.EvidenceKind.NONE
    unit: str = ""
    low: float | None = None
    high: float | None = None

    @property
    def words(self) -> str:
        """Description, such as `a number in V, 14.8 to 16.8`; empty if no evidence is needed."""
        if self.kind is not model.EvidenceKind.NUMBER:
            return _EVIDENCE[self.kind]
        if self.low is None:
            return msg(f"a number in {arg(self.unit)}, {arg(self.high):g} at most")
        if self.high is None:
            return msg(f"a number in {arg(self.unit)}, {arg(self.low):g} at least")
        return msg(f"a number in {arg(self.unit)}, {arg(self.low):g} to {arg(self.high):g}")

    def outside(self, value: float) -> bool:
        """Return whether a number is outside the limits."""
        return (self.low is not None and value < self.low) or (self.high is not None and value > self.high)


_EVIDENCE = {
    model.EvidenceKind.NONE: "",
    model.EvidenceKind.TEXT: "a note with what was seen",
    model.EvidenceKind.PHOTO: "a photo",
}


@dataclass(frozen=True, slots=True)
class Step:
    """Definition of one checklist item: a probe or a check by a person."""

    name: str
    """Third part of the item's id; empty for the main item of the column."""
    title: str
    kind: report.ItemKind
    phase: report.Phase
    probe: Probe | None = None
    """None: a person checks."""
    do: str = ""
    """For a person: what to do."""
    look_for: str = ""
    """For a person: what shows that it is well."""
    consent: Consent | None = None
    """Consent that an active step needs."""
    unless: str = ""
    """Why it does not apply: the item is a SKIP with this reason."""
    concerns: tuple[str, ...] = ()
    """Names of hosts that it concerns, for the drawing."""
    by: tuple[str, ...] = ()
    """For a person: names of the only people who may answer or override it; empty: anybody."""
    evidence: EvidenceRequest = EvidenceRequest()
    """For a person: evidence that is required besides the answer."""

    def __post_init__(self) -> None:
        """Check that the fields fit the kind: automatic, active or by a person."""
        if not self.unless and (self.kind is report.ItemKind.PERSON) != (self.probe is None):
            raise ValueError(
                msg(f"step `{arg(self.title)}`: a person's step must have no probe, every other step must have one")
            )
        if (self.kind is report.ItemKind.ACTIVE) != (self.consent is not None):
            raise ValueError(msg(f"step `{arg(self.title)}`: active steps, and only these, need consent"))


SITE = "site"
"""The endpoint of the site's own checks."""
ITEMS = "items"
"""The endpoint of the items that the pilot declares in `checklist.items`."""
ROBOT = "robot"
"""Endpoint of the data that robots publish, checked against their files."""
INTEGRATION = "integration"
"""The endpoint of the integration record of a robot."""


@dataclass(frozen=True, slots=True)
class Cell:
    """Input from which the steps of a column are built: a cell of the table."""

    inventory: Inventory
    site: str
    vehicle: str | None
    """Key of the vehicle; None: the location."""
    endpoint: str
    """A column of Table 3, `ethernet`, `site`, `items`, `robot` or `integration`."""
    mission: str = ""
    """Name of the mission whose items are included as well; empty: none."""
    robots: RobotFiles | None = field(default=None, compare=False, repr=False)
    """Files of the robots that are tested at the site, for the endpoints that need them."""

    @property
    def row(self) -> str:
        """First part of an item's id: the vehicle, or the site."""
        return self.vehicle or self.site

    @property
    def name(self) -> str:
        """Title of the row for people."""
        return self.site_config.title if self.vehicle is None else self.inventory.vehicles[self.vehicle].name

    @property
    def site_config(self) -> model.Site:
        """The site."""
        return self.inventory.sites[self.site]

    @property
    def endpoints(self) -> model.Endpoints:
        """Endpoints of the row in the inventory."""
        if self.vehicle is not None:
            return self.inventory.vehicles[self.vehicle].endpoints
        return self.site_config.location.endpoints

    @property
    def gateway(self) -> Host | None:
        """Computer from which the site's probes run: its gateway, otherwise its control centre."""
        return self.inventory.computer_of(self.site)

    @property
    def router(self) -> Host | None:
        """The site's router."""
        return self.inventory.router_of(self.site)

    @property
    def wifi(self) -> model.WifiEndpoint | None:
        """Wi-Fi endpoint of the row; a station without further settings is seen by the router's access point."""
        wifi, router = self.endpoints.wifi, self.router
        if wifi is None or router is None or self.vehicle is None or wifi.seen_by is not None:
            return wifi
        if wifi.role is model.WifiRole.ACCESS_POINT:
            return wifi
        opens = isinstance(router.device, model.Router) and router.device.access_point is not None
        return wifi.model_copy(update={"seen_by": router.name}) if opens else wifi

    def place(self, seen_from: model.SeenFrom) -> Place:
        """Return where a probe of this cell runs: for a site without a gateway, the laptop."""
        if seen_from is model.SeenFrom.GATEWAY and self.gateway is not None:
            return Place.GATEWAY
        return Place.LAPTOP

    def address(self, inventory_address: object) -> str | None:
        """Return the address in the inventory, else of the row's DHCP reservation at this site; None if unknown."""
        if inventory_address is not None:
            return str(inventory_address)
        reservations = (item for item in self.site_config.lan.reservations if item.name == self.vehicle)
        return next((str(reservation.address) for reservation in reservations), None)


def measured_evidence(what: str, value: object, unit: str = "") -> report.Evidence:
    """Return evidence measured by this tool."""
    return report.Evidence(type=report.EvidenceType.MEASURED, what=what, value=number(value, unit))


def read(what: str, value: object, unit: str = "") -> report.Evidence:
    """Return evidence read from a device."""
    return report.Evidence(type=report.EvidenceType.READ, what=what, value=number(value, unit))


def declared_evidence(what: str, value: object) -> report.Evidence:
    """Return evidence from the inventory."""
    return report.Evidence(type=report.EvidenceType.DECLARED, what=what, value=str(value))


def number(value: object, unit: str = "") -> str:
    """Write a value with its unit: `-52 dBm`; a number without needless zeros."""
    text = f"{value:g}" if isinstance(value, float) else str(value)
    return f"{text} {unit}" if unit else text


PLACES = {Place.GATEWAY: "the gateway", Place.LAPTOP: "this computer", Place.ROUTER: "the router"}
"""Place -> its name in messages."""
_PACKAGES = {"ping": "iputils-ping", "ip": "iproute2"}
"""Program -> its package in Debian and Ubuntu, where the names differ."""


def no_answer_finding(who: str, answer: Answer | None) -> LinkFinding:
    """Return the finding for a request that could not be sent to `who`; it never fails, as nothing is known."""
    words = getattr(answer, "words", "") or "no response"
    hint = msg(f"make {arg(who)} reachable, then check again")
    return LinkFinding(Verdict.INCONCLUSIVE, "not-asked", msg(f"{arg(who)} could not be queried: {arg(words)}"), hint)


def not_run(place: Place, program: str, ran: Answer | None) -> Iterator[LinkFinding]:
    """Yield why a program has no usable output; nothing if it ran."""
    where = PLACES[place]
    if not isinstance(ran, CommandResult):
        yield no_answer_finding(where, ran)
    elif ran.trouble is Trouble.MISSING:
        hint = msg(f"install it there: sudo apt install {arg(_PACKAGES.get(program, program))}")
        yield LinkFinding(
            Verdict.INCONCLUSIVE, "program-missing", msg(f"{arg(where)} has no program `{arg(program)}`"), hint
        )
    elif ran.trouble is Trouble.SILENT:
        hint = msg(f"check whether {arg(where)} is overloaded, then check again")
        message = msg(f"`{arg(program)}` timed out on {arg(where)}")
        yield LinkFinding(Verdict.INCONCLUSIVE, "program-slow", message, hint)
    elif ran.trouble is not None:
        yield no_answer_finding(where, ran)


def rows_of(answer: Answer | None) -> tuple[dict[str, str], ...] | None:
    """Return the rows of a menu; None if it was not read, or the device does not have it."""
    if not isinstance(answer, Rows) or answer.trouble is not None or answer.rows is None:
        return None
    return tuple(dict(row) for row in answer.rows)
