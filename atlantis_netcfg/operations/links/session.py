"""A read-only session to one device, and the router's report about the links."""

from __future__ import annotations

import re
from contextlib import asynccontextmanager
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from ipaddress import AddressValueError, IPv4Address
from typing import TYPE_CHECKING

from atlantis_netcfg.links import policy
from atlantis_netcfg.routeros import api
from atlantis_netcfg.routeros.link_use import LinkUse, in_use
from atlantis_netcfg.routeros.observe import seconds
from atlantis_netcfg.routeros.scheduler_jobs import READ_JOBS

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Mapping, Sequence

    from atlantis_netcfg.links.status import Query
    from atlantis_netcfg.routeros._types import Row


@dataclass(slots=True)
class ReadOnlySession:
    """A read-only session to a RouterOS device, given by its inventory name."""

    name: str
    endpoint: api.Endpoint
    traffic: list[api.Traffic] = field(default_factory=list)

    @asynccontextmanager
    async def open_session(self) -> AsyncIterator[api.Session]:
        """Open a session that is closed at the end of the context; raise DeviceError."""
        session = await api.Session.open(replace(self.endpoint, opening=self.traffic.append))
        try:
            yield session
        finally:
            await session.close(wait=False)

    @property
    def connections(self) -> int:
        """The number of connections, including those that failed before the end of the login."""
        return api.Traffic.total(self.traffic).connections

    @property
    def round_trips(self) -> int:
        """Round trips on the link, including handshakes and logins."""
        return api.Traffic.total(self.traffic).round_trips

    @property
    def bytes(self) -> int:
        """Bytes sent and received, including handshakes and TLS."""
        return api.Traffic.total(self.traffic).bytes


def command(query: Query) -> api.Command:
    """Convert a query to a sentence of the API."""
    return api.Command(query.path, query.words)


def rows(reply: api.Reply) -> tuple[Row, ...] | None:
    """Return the rows of a reply; None if the device refused the query, for example for a missing menu."""
    return None if reply.trap is not None else reply.rows


PINGS = 3
"""Number of pings to each probe target."""
_PORT = ("name", "default-name", "running", "disabled", "rx-byte", "tx-byte")
_RULE = ("chain", "action", "disabled", "packets", "bytes")
_NEIGHBOUR = ("address", "interface", "mac-address", "complete", "disabled", "invalid")
_MENUS = 6
"""Number of queries besides the pings."""
_TRUE = frozenset({"true", "yes"})
_TIME = re.compile(r"(?:(\d+)s)?(?:(\d+)ms)?(?:(\d+)us)?")


@dataclass(frozen=True, slots=True)
class SessionPort:
    """An interface of the router; None means not reported."""

    running: bool | None
    is_disabled: bool | None
    rx_bytes: int | None
    """Bytes since the router was started."""
    tx_bytes: int | None


@dataclass(frozen=True, slots=True)
class Echo:
    """The replies of a probe target to pings over one link."""

    target: str
    sent_count: int
    received_count: int
    rtt_ms: float | None
    """Mean round trip of the pings with a reply."""


@dataclass(frozen=True, slots=True)
class SeenNeighbour:
    """A neighbour that answered ARP on a port."""

    address: str
    mac: str | None


@dataclass(frozen=True, slots=True)
class RouterReading:
    """The router's report about its links at one moment; None means that a query was refused."""

    at: datetime | None = None
    """Time of the complete response, by this computer's clock."""
    uptime_s: float | None = None
    ports: Mapping[str, SessionPort] | None = None
    """Ports by factory name."""
    port_aliases: Mapping[str, str] = field(default_factory=dict)
    """Current names of renamed ports, by factory name."""
    routes: tuple[Row, ...] | None = None
    """Default routes of all routing tables."""
    echoes: Mapping[str, tuple[Echo, ...]] | None = None
    """Replies by link; only of the probe targets whose pings were carried out."""
    neighbours: Mapping[str, tuple[SeenNeighbour, ...]] | None = None
    """Neighbours by port; None also if a port was renamed, because its name then refers to another port."""
    use: LinkUse | None = None
    """Link that is used for a limited time instead of the order in the inventory."""
    drop_counters: Mapping[str, tuple[int, int]] | None = None
    """By firewall chain: packets and bytes counted by its drop rules since they were created or reset."""


def questions(routes: Sequence[policy.LinkRoute]) -> tuple[tuple[api.Command, ...], tuple[policy.PolicyProbe, ...]]:
    """Return all commands to send at once after the login, and the pings among them; only the links' ports."""
    probes = policy.probe_commands(routes, count=PINGS)
    ports = [route.port for route in routes if route.port is not None]
    menus = (
        api.Command("/system/resource/print", ((".proplist", "uptime"),)),
        api.Command("/interface/print", ((".proplist", ",".join(_PORT)),), _either("default-name", ports)),
        api.Command(
            "/ip/route/print", ((".proplist", ",".join(policy.ROUTE_PROPERTIES)),), ("?dst-address=0.0.0.0/0",)
        ),
        api.Command("/ip/arp/print", ((".proplist", ",".join(_NEIGHBOUR)),), _either("interface", ports)),
        api.Command("/ip/firewall/filter/print", ((".proplist", ",".join(_RULE)),), ("?action=drop",)),
        READ_JOBS,
    )
    return (*menus, *(api.Command(probe.path, probe.arguments) for probe in probes)), probes


def _either(field: str, values: Sequence[str]) -> tuple[str, ...]:
    """Return query words for rows with one of these values in a field (Manual, API, "Queries")."""
    return tuple(
        word for place, value in enumerate(values) for word in (f"?{field}={value}", "?#|")[: 2 if place else 1]
    )


async def read_router(device: ReadOnlySession, routes: Sequence[policy.LinkRoute]) -> RouterReading:
    """Read in one session of two round trips; the pings take seconds of the second. Raise DeviceError."""
    queries, probes = questions(routes)
    async with device.open_session() as session:
        replies = await session.flight(queries)
        return replace(read(replies, probes), at=datetime.now(UTC))


def read(replies: Sequence[api.Reply], probes: Sequence[policy.PolicyProbe]) -> RouterReading:
    """Parse the replies to `questions`, in their order."""
    resource, ports, routes, neighbours, rules, jobs = (rows(reply) for reply in replies[:_MENUS])
    port_names = {row["default-name"]: row.get("name", "") for row in ports or () if "default-name" in row}
    port_aliases = {port: name for port, name in port_names.items() if name != port}
    return RouterReading(
        uptime_s=seconds(resource[0].get("uptime", "")) if resource else None,
        ports=None if ports is None else {row["default-name"]: _port(row) for row in ports if "default-name" in row},
        port_aliases=port_aliases,
        routes=routes,
        echoes=_echoes(probes, replies[_MENUS:]),
        neighbours=None if neighbours is None or port_aliases else _by_port(neighbours),
        use=in_use(jobs or ()),
        drop_counters=None if rules is None else _counters_by_chain(rules),
    )


def _port(row: Row) -> SessionPort:
    return SessionPort(
        _parse_bool(row.get("running")),
        _parse_bool(row.get("disabled")),
        _parse_int(row.get("rx-byte")),
        _parse_int(row.get("tx-byte")),
    )


def _parse_bool(text: str | None) -> bool | None:
    return None if text is None else text in _TRUE


def _parse_int(text: str | None) -> int | None:
    return int(text) if text is not None and text.isdecimal() else None


def _echoes(probes: Sequence[policy.PolicyProbe], replies: Sequence[api.Reply]) -> dict[str, tuple[Echo, ...]]:
    result: dict[str, tuple[Echo, ...]] = {}
    for probe, reply in zip(probes, replies, strict=True):
        echo = _echo(probe.target, rows(reply))
        if echo is not None:
            result[probe.link] = (*result.get(probe.link, ()), echo)
    return result


def _echo(target: str, answers: Sequence[Row] | None) -> Echo | None:
    """Parse the rows of a ping: each has the sums so far, so the last one is the result."""
    if not answers:
        return None
    sent_count, received_count = (_parse_int(answers[-1].get(name)) for name in ("sent", "received"))
    if not sent_count or received_count is None:
        return None
    return Echo(
        target, sent_count, received_count, _milliseconds(answers[-1].get("avg-rtt")) if received_count else None
    )


def _milliseconds(text: str | None) -> float | None:
    """Parse `4ms`, `4ms530us`, `1s20ms` to milliseconds."""
    match = _TIME.fullmatch(text or "")
    if not text or match is None:
        return None
    whole, thousandths, millionths = (int(part or 0) for part in match.groups())
    return whole * 1000 + thousandths + millionths / 1000


def _by_port(answers: Sequence[Row]) -> dict[str, tuple[SeenNeighbour, ...]]:
    """Return the ARP neighbours of each port; an entry without a MAC address is an unanswered ARP request."""
    result: dict[str, tuple[SeenNeighbour, ...]] = {}
    for row in answers:
        dead = any(row.get(flag) in _TRUE for flag in ("disabled", "invalid")) or row.get("complete") in {"false", "no"}
        if dead or not row.get("mac-address") or not _is_address(row.get("address", "")):
            continue
        port = row.get("interface", "")
        result[port] = (*result.get(port, ()), SeenNeighbour(row["address"], row["mac-address"]))
    return result


def _is_address(text: str) -> bool:
    try:
        IPv4Address(text)
    except AddressValueError:
        return False
    return True


def _counters_by_chain(rules: Sequence[Row]) -> dict[str, tuple[int, int]]:
    result: dict[str, tuple[int, int]] = {}
    for row in rules:
        packets, nbytes = _parse_int(row.get("packets")), _parse_int(row.get("bytes"))
        if row.get("disabled") in _TRUE or packets is None or nbytes is None:
            continue
        before = result.get(row.get("chain", ""), (0, 0))
        result[row.get("chain", "")] = before[0] + packets, before[1] + nbytes
    return result
