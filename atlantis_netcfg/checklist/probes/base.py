"""A step of the checklist: the cell that it belongs to, the probe that it runs, and what a probe says.

A probe is two functions: `asks` gives its requests, `judge` gives findings and evidence. Here are also the findings for
a request without a complete result, from which nothing follows, and evidence in one line each.

What a probe may ask, as data: nothing else is ever sent.

What came back of a question. Silence is an answer, and is never mixed up with a refusal.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any, Literal, Protocol

from atlantis_netcfg.checklist import report
from atlantis_netcfg.core.events import Verdict, worst
from atlantis_netcfg.inventory import model
from atlantis_netcfg.links import BearerFinding

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from datetime import datetime

    from atlantis_netcfg.checklist.probes.robot_files import RobotFiles
    from atlantis_netcfg.inventory import Declaration, Host
    from atlantis_netcfg.links.qualify.record import QualifyRecord
    from atlantis_netcfg.links.status import Query
    from atlantis_netcfg.robots.observation import RobotObservation


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
class RunProgram:
    """Run a program that only reads; it must stand in `core/reading_programs.py`."""

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
class RouterSolicitRequest:
    """Ask a segment for its IPv6 routers: every advertisement is kept, and none is believed."""

    name: str
    place: Place
    interface: str
    """As of `DhcpDiscoverRequest`."""
    within_s: float = 8.0
    """Routers answer within 0.5 s, and within 3.5 s if they have just advertised (RFC 4861, 6.2.6)."""


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
class ReflectRequest:
    """Send messages to another computer of the pilot, which sends back what is in them (`gateway/reflector.py`).

    They leave by whatever route the computer has for that address, as the data of any program do.
    """

    name: str
    place: Place
    source: str
    """Address of the computer that asks, in the VPN."""
    address: str
    port: int
    count: int = 3
    within_s: float = 10.0
    """How long the answers are waited for."""


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


@dataclass(frozen=True, slots=True)
class LinkRecordRequest:
    """The newest measurement of a link that this computer keeps: `provision qualify`. Nothing is sent."""

    name: str
    site: str
    bearer: str
    place: Literal[Place.LAPTOP] = Place.LAPTOP


@dataclass(frozen=True, slots=True)
class RobotsHeardRequest:
    """Listen for robots (DDS) once for all who ask; nothing is published."""

    name: str
    host: str = ""
    """The computer of the pilot that listens, by its name; empty: this one."""
    seconds: float = 20.0
    place: Literal[Place.LAPTOP] = Place.LAPTOP


@dataclass(frozen=True, slots=True)
class VpnMembersRequest:
    """Which members of the VPN are robots, and whom the server has a session of, once for all who ask."""

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
    """Why there is no whole answer."""

    REFUSED = "refused"
    """A computer is there, but nothing listens, or it turned us away."""
    SILENT = "silent"
    """Nobody answered at that address within the time."""
    UNREACHABLE = "unreachable"
    """No route, or no such host."""
    BUSY = "busy"
    """Another program holds the serial port, or the UDP port on which a stream arrives."""
    MISSING = "missing"
    """No such serial port, no such program on that computer."""
    DENIED = "denied"
    """We may not."""
    CLOSED = "closed"
    """The other end hung up at once, as one does that serves one client only."""
    NO_PLACE = "no place"
    """The computer or router that should have asked was not reached: nothing is known."""


@dataclass(frozen=True, slots=True)
class Transcript:
    """What was heard on a stream."""

    trouble: Trouble | None
    words: str = ""
    """The trouble in the words of the system or of the place."""
    chunks: tuple[tuple[float, bytes], ...] = ()
    """Seconds since `began`, and what came then: as it came from a stream, one datagram each from UDP."""
    began: float = 0.0
    """Seconds since 1970 by the clock of the computer that listened."""
    ended_s: float = 0.0
    """When the listening ended, seconds since `began`."""
    senders: tuple[str, ...] = ()
    """Of UDP: the address that each of `chunks` came from; empty: nobody has looked, or it is no UDP."""

    @property
    def data(self) -> bytes:
        """All of it."""
        return b"".join(data for _, data in self.chunks)


@dataclass(frozen=True, slots=True)
class CommandResult:
    """What a program printed."""

    trouble: Trouble | None
    words: str = ""
    rc: int = 0
    out: str = ""
    err: str = ""
    began: float = 0.0
    """Seconds since 1970 by the clock of the computer that ran it."""
    request_time: float = 0.0
    """Seconds since 1970 by this computer's clock, when the question left; 0: nobody has looked."""
    response_time: float = 0.0
    """The same, when its answer was here: what the other clock showed in between tells how wrong it is."""


@dataclass(frozen=True, slots=True)
class Rows:
    """Rows of a RouterOS menu."""

    trouble: Trouble | None
    words: str = ""
    rows: tuple[Mapping[str, str], ...] | None = None
    """None: the device does not know the menu, or refused."""
    request_time: float = 0.0
    """Seconds since 1970 by this computer's clock, when the question left; 0: nobody has looked."""
    response_time: float = 0.0
    """The same, when its answer was here: what the other clock showed in between tells how wrong it is."""


@dataclass(frozen=True, slots=True)
class LinkStatusResult:
    """How a bearer is; the dictionary of `operations.links.Looked.as_dict` for it."""

    trouble: Trouble | None
    words: str = ""
    bearer: Mapping[str, Any] | None = None


@dataclass(frozen=True, slots=True)
class AllowListTestResult:
    """What the proof of the satellite's allow-list has found."""

    trouble: Trouble | None
    words: str = ""
    findings: tuple[BearerFinding, ...] = ()
    bill: str = ""
    """What it has cost, in words."""
    seconds: float = 0.0
    """How long silent targets were asked."""


@dataclass(frozen=True, slots=True)
class LinkRecordResult:
    """The newest measurement of a link, judged from its samples."""

    trouble: Trouble | None
    words: str = ""
    record: QualifyRecord | None = None
    """None without trouble: there is none."""
    now: datetime | None = None
    """When it was read, by this computer's clock."""
    is_rehearsal: bool = False
    """A rehearsal's, of an emulated link; else such a measurement counts for nothing."""


@dataclass(frozen=True, slots=True)
class DhcpOffer:
    """What one DHCP server offers."""

    server: str
    """Its identifier (RFC 2132, option 54), else the address that the packet came from."""
    mac: str | None
    """Of the card that sent it, in lower case with colons; None: the system does not tell."""
    address: str
    """That it would give."""
    router: str | None = None
    """Default gateway that it would give (option 3), the first."""


@dataclass(frozen=True, slots=True)
class DhcpOffers:
    """Which DHCP servers answered on a segment; without trouble and without offers: nobody within the time."""

    trouble: Trouble | None
    words: str = ""
    offers: tuple[DhcpOffer, ...] = ()


@dataclass(frozen=True, slots=True)
class RouterAdvertisement:
    """What one IPv6 router says of itself (RFC 4861, 4.2)."""

    address: str
    mac: str
    """Of the card that sent it, in lower case with colons."""
    lifetime_s: int
    """As a default router; 0: it is none."""
    prefixes: tuple[str, ...] = ()
    """From which computers give themselves addresses, or which they reach without a router."""


@dataclass(frozen=True, slots=True)
class RouterAdvertisements:
    """Which IPv6 routers advertised themselves on a segment; without trouble and without routers: none."""

    trouble: Trouble | None
    words: str = ""
    routers: tuple[RouterAdvertisement, ...] = ()


@dataclass(frozen=True, slots=True)
class DdsDiscoverResult:
    """What DDS participants have sent to one that announced itself; nothing without trouble: nobody answered."""

    trouble: Trouble | None
    words: str = ""
    prefix: bytes = b""
    """Identity of the one that announced itself, made up anew each time (GUID prefix, DDSI-RTPS 9.3.1)."""
    datagrams: tuple[tuple[str, bytes], ...] = ()
    """Address of the sender, and the message."""


@dataclass(frozen=True, slots=True)
class ReflectReply:
    """A datagram that came while answers were waited for."""

    sender: str
    """The address that it came from."""
    interface: str
    """By which it came in."""
    delay_s: float
    """Since the message left whose token it bears; since the first one where it bears none."""
    data: bytes


@dataclass(frozen=True, slots=True)
class ReflectResult:
    """What came back; nothing without trouble: nobody answered within the time."""

    trouble: Trouble | None
    words: str = ""
    tokens: tuple[str, ...] = ()
    """Of the messages that were sent, made up anew each time."""
    answers: tuple[ReflectReply, ...] = ()


@dataclass(frozen=True, slots=True)
class RobotsHeardResult:
    """Which robots were heard, and what they publish."""

    trouble: Trouble | None
    words: str = ""
    observation: RobotObservation | None = None


@dataclass(frozen=True, slots=True)
class VpnMember:
    """A robot in the VPN."""

    name: str
    vehicle: str
    has_certificate: bool
    """Whether it has a certificate that was not revoked."""
    session: str = ""
    """Address and port from which it is connected now; empty: it is not."""


@dataclass(frozen=True, slots=True)
class VpnMembersResult:
    """The robots in the VPN."""

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
    """What follows from the answers. Without a finding nothing was seen, and that never passes."""

    findings: tuple[BearerFinding, ...]
    """The worst comes to the item's verdict; its message is the first of those."""
    evidence: tuple[report.Evidence, ...] = ()

    @property
    def verdict(self) -> Verdict:
        """The worst finding; of none, ERROR: a probe that says nothing is broken."""
        return worst(finding.verdict for finding in self.findings) if self.findings else Verdict.ERROR


class Probe(Protocol):
    """The first line of its docstring is what the technician reads."""

    def asks(self) -> tuple[Question, ...]:
        """Every question, with names that are unlike each other."""
        ...

    def judge(self, results: Mapping[str, Answer]) -> ProbeResult:
        """Judge the answers, one for each question by its name."""
        ...


@dataclass(frozen=True, slots=True)
class Consent:
    """What a person has to agree to before an active step, shown word by word."""

    question: str
    """`Sparus is in the water, and its modem may transmit`."""
    prompt: str = ""
    """What the person does while the tool listens: `ask the pilot to move the right stick in circles`."""
    cost: bool = False
    """It costs on a metered link: `--accept-cost` or a yes is asked as well."""


@dataclass(frozen=True, slots=True)
class EvidenceRequest:
    """What a person has to give besides the answer that it holds."""

    kind: model.EvidenceKind = model.EvidenceKind.NONE
    unit: str = ""
    low: float | None = None
    high: float | None = None

    @property
    def words(self) -> str:
        """`a number in V, 14.8 to 16.8`; empty where nothing has to be given."""
        if self.kind is not model.EvidenceKind.NUMBER:
            return _EVIDENCE[self.kind]
        if self.low is None:
            return f"a number in {self.unit}, {self.high:g} at most"
        if self.high is None:
            return f"a number in {self.unit}, {self.low:g} at least"
        return f"a number in {self.unit}, {self.low:g} to {self.high:g}"

    def outside(self, value: float) -> bool:
        """Whether a number does not pass."""
        return (self.low is not None and value < self.low) or (self.high is not None and value > self.high)


_EVIDENCE = {
    model.EvidenceKind.NONE: "",
    model.EvidenceKind.TEXT: "a note with what was seen",
    model.EvidenceKind.PHOTO: "a photo",
}


@dataclass(frozen=True, slots=True)
class Step:
    """One item to be: what a program looks at, or a person."""

    name: str
    """Third part of the item's id; empty for the column's own, main item."""
    title: str
    kind: report.ItemKind
    phase: report.Phase
    probe: Probe | None = None
    """None: a person looks."""
    do: str = ""
    """For a person: what to do."""
    look_for: str = ""
    """For a person: what tells that it is well."""
    consent: Consent | None = None
    """Of an active step."""
    unless: str = ""
    """Why it does not apply: the item is a SKIP with this reason."""
    concerns: tuple[str, ...] = ()
    """Names of hosts that it speaks of, for the drawing."""
    by: tuple[str, ...] = ()
    """For a person: names of those who alone may answer or override it; empty: anybody."""
    evidence: EvidenceRequest = EvidenceRequest()
    """For a person: what has to be given besides the answer."""

    def __post_init__(self) -> None:
        """Hold the three kinds apart."""
        if not self.unless and (self.kind is report.ItemKind.PERSON) != (self.probe is None):
            raise ValueError(f"step `{self.title}`: a person's step has no probe, every other one has")
        if (self.kind is report.ItemKind.ACTIVE) != (self.consent is not None):
            raise ValueError(f"step `{self.title}`: consent is asked for active steps, and for all of them")


SITE = "site"
"""The endpoint of the site's own checks."""
ITEMS = "items"
"""The endpoint of what the pilot declares below `checklist.items`."""
ROBOT = "robot"
"""The endpoint of what robots publish, beside their files."""
INTEGRATION = "integration"
"""The endpoint of the integration record of a robot."""


@dataclass(frozen=True, slots=True)
class Cell:
    """What the steps of a column are made from."""

    declaration: Declaration
    site: str
    vehicle: str | None
    """Key; None: the location."""
    endpoint: str
    """A column of Table 3, `ethernet`, `site`, `items`, `robot` or `integration`."""
    mission: str = ""
    """Name of the mission whose items are asked as well; empty: none."""
    robots: RobotFiles | None = field(default=None, compare=False, repr=False)
    """The files of the robots that are tested at the site, for the endpoints that need them."""

    @property
    def row(self) -> str:
        """The first part of an item's id."""
        return self.vehicle or self.site

    @property
    def name(self) -> str:
        """The row in words."""
        return self.site_config.title if self.vehicle is None else self.declaration.vehicles[self.vehicle].name

    @property
    def site_config(self) -> model.Site:
        """The site."""
        return self.declaration.sites[self.site]

    @property
    def endpoints(self) -> model.Endpoints:
        """How the row's endpoints are seen."""
        if self.vehicle is not None:
            return self.declaration.vehicles[self.vehicle].endpoints
        return self.site_config.location.endpoints

    @property
    def gateway(self) -> Host | None:
        """The computer that probes of the site look from: its gateway, else its control centre."""
        return self.declaration.computer_of(self.site)

    @property
    def router(self) -> Host | None:
        """The site's router."""
        return self.declaration.router_of(self.site)

    @property
    def wifi(self) -> model.WifiEndpoint | None:
        """The row's own Wi-Fi; a station of which nothing else is declared is seen by the router's access point."""
        wifi, router = self.endpoints.wifi, self.router
        if wifi is None or router is None or self.vehicle is None or wifi.seen_by is not None:
            return wifi
        if wifi.role is model.WifiRole.ACCESS_POINT:
            return wifi
        opens = isinstance(router.device, model.Router) and router.device.access_point is not None
        return wifi.model_copy(update={"seen_by": router.name}) if opens else wifi

    def place(self, seen_from: model.SeenFrom) -> Place:
        """Where a probe of this cell stands: a site without a gateway is looked at from the laptop."""
        if seen_from is model.SeenFrom.GATEWAY and self.gateway is not None:
            return Place.GATEWAY
        return Place.LAPTOP

    def address(self, inventory_address: object) -> str | None:
        """The declared address, else that of the row's DHCP reservation at this site; None: nobody says."""
        if inventory_address is not None:
            return str(inventory_address)
        reservations = (item for item in self.site_config.lan.reservations if item.name == self.vehicle)
        return next((str(reservation.address) for reservation in reservations), None)


def measured_evidence(what: str, value: object, unit: str = "") -> report.Evidence:
    """Give what this tool has measured."""
    return report.Evidence(type=report.EvidenceType.MEASURED, what=what, value=number(value, unit))


def read(what: str, value: object, unit: str = "") -> report.Evidence:
    """Give what a device has said."""
    return report.Evidence(type=report.EvidenceType.READ, what=what, value=number(value, unit))


def declared_evidence(what: str, value: object) -> report.Evidence:
    """Give what the inventory says."""
    return report.Evidence(type=report.EvidenceType.DECLARED, what=what, value=str(value))


def number(value: object, unit: str = "") -> str:
    """Write a value with its unit: `-52 dBm`; a number without needless zeros."""
    text = f"{value:g}" if isinstance(value, float) else str(value)
    return f"{text} {unit}" if unit else text


PLACES = {Place.GATEWAY: "the gateway", Place.LAPTOP: "this computer", Place.ROUTER: "the router"}
"""A place in words."""
_PACKAGES = {"ping": "iputils-ping", "ip": "iproute2"}
"""Where the package of Debian and Ubuntu is not called as its program is."""


def no_answer_finding(who: str, answer: Answer | None) -> BearerFinding:
    """Say that `who` could not be asked; it never fails anything, for nothing is known."""
    words = getattr(answer, "words", "") or "it does not answer"
    hint = f"make {who} reachable first, then ask again"
    return BearerFinding(Verdict.INCONCLUSIVE, "not-asked", f"{who} could not be asked: {words}", hint)


def not_run(place: Place, program: str, ran: Answer | None) -> Iterator[BearerFinding]:
    """Say why a program has printed nothing that counts; nothing, if it was carried out."""
    where = PLACES[place]
    if not isinstance(ran, CommandResult):
        yield no_answer_finding(where, ran)
    elif ran.trouble is Trouble.MISSING:
        hint = f"on it: sudo apt install {_PACKAGES.get(program, program)}"
        yield BearerFinding(Verdict.INCONCLUSIVE, "program-missing", f"{where} has no program `{program}`", hint)
    elif ran.trouble is Trouble.SILENT:
        hint = f"look whether {where} is overloaded, then ask again"
        message = f"`{program}` did not come to an end in time on {where}"
        yield BearerFinding(Verdict.INCONCLUSIVE, "program-slow", message, hint)
    elif ran.trouble is not None:
        yield no_answer_finding(where, ran)


def rows_of(answer: Answer | None) -> tuple[dict[str, str], ...] | None:
    """Give the rows of a menu; None: it was not asked, or the device does not have it."""
    if not isinstance(answer, Rows) or answer.trouble is not None or answer.rows is None:
        return None
    return tuple(dict(row) for row in answer.rows)
