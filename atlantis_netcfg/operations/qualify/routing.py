"""Routing of this computer's test packets over one link, and counting them on every link.

The site's traffic is not moved. There is a routing rule for this computer's address and the far end's, and rows of the
mangle table that only count (`action=passthrough`) this flow on each link and in each direction. They are on the router
under safe mode for as long as the measurement lasts, have the comment `MARK`, and their removal is verified. Mangle,
not the filter: it runs before any rule that accepts or drops, and a filter of this toolkit has no fasttrack.

Through the VPN the flow is this computer's own tunnel, which contains the test packets: it alone is routed and counted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import DeviceError
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.links.qualify.measured_run import LinkCount
from atlantis_netcfg.operations.allow_list_test.plan import MARK
from atlantis_netcfg.routeros import api

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence


_MANGLE = "/ip/firewall/mangle"
_RULE = "/routing/rule"
_NOT_READ = "the router did not report its counters"
FEW = 2
"""Tolerated difference in packets between two counts without known loss: counter requests, a duplicate."""


@dataclass(frozen=True, slots=True)
class MeasuredFlow:
    """The test packets of a run, or the tunnel around them, as the router sees them before NAT."""

    source: str
    source_port: int | None
    """None: any port, because OpenVPN does not report the source port of a tunnel."""
    far: str
    far_port: int


@dataclass(frozen=True, slots=True)
class FlowCounts:
    """The router's counts since the rows were created; packets and bytes by port and direction."""

    up: Mapping[str, tuple[int, int]]
    down: Mapping[str, tuple[int, int]]
    ports: Mapping[str, tuple[int, int]]
    """Received and sent bytes of each port, including other traffic."""


def rows(
    flow: MeasuredFlow, link: str, ports: Sequence[str], rules: api.Reply, mangle: api.Reply
) -> tuple[api.Command, ...]:
    """Return the rows, before all others, that route the flow over a link and count it on every port."""
    where = (("src-address", f"{flow.source}/32"), ("dst-address", f"{flow.far}/32"), ("table", f"via-{link}"))
    rule = api.Command(
        f"{_RULE}/add", (("action", "lookup-only-in-table"), ("comment", MARK), *where, *_place_before_first(rules))
    )
    return (rule, *_counter_commands(flow, ports, _place_before_first(mangle)))


def _counter_commands(
    flow: MeasuredFlow, ports: Sequence[str], first: tuple[tuple[str, str], ...]
) -> Iterator[api.Command]:
    words = (("action", "passthrough"), ("chain", "forward"), ("comment", MARK), ("protocol", "udp"))
    near, far = _endpoint_match(flow.source, flow.source_port), _endpoint_match(flow.far, flow.far_port)
    for port in ports:
        up = (("out-interface", port), *near("src"), *far("dst"))
        down = (("in-interface", port), *far("src"), *near("dst"))
        for way in (up, down):
            yield api.Command(f"{_MANGLE}/add", (*words, *way, *first))


def _endpoint_match(address: str, port: int | None) -> Callable[[str], tuple[tuple[str, str], ...]]:
    number = () if port is None else (("port", str(port)),)
    return lambda side: tuple((f"{side}-{name}", value) for name, value in (("address", address), *number))


def _place_before_first(reply: api.Reply) -> tuple[tuple[str, str], ...]:
    first_id = next((row[".id"] for row in reply.check().rows if ".id" in row and row.get("dynamic") != "true"), None)
    return () if first_id is None else (("place-before", first_id),)


async def first_rows(session: api.Session) -> tuple[api.Reply, api.Reply]:
    """Return the current rules of the router, which `rows` needs."""
    ids = (".proplist", ".id,dynamic")
    rules, mangle = await session.flight([api.Command(f"{menu}/print", (ids,)) for menu in (_RULE, _MANGLE)])
    return rules, mangle


async def counters(session: api.Session) -> FlowCounts:
    """Read the counting rows and the ports; raise DeviceError if a row has no count or a read is refused."""
    rule = api.Command(
        f"{_MANGLE}/print", ((".proplist", "in-interface,out-interface,packets,bytes"),), (f"?comment={MARK}",)
    )
    interfaces = api.Command("/interface/print", ((".proplist", "name,default-name,rx-byte,tx-byte"),))
    rule_reply, ports = await session.flight([rule, interfaces])
    up, down = dict[str, tuple[int, int]](), dict[str, tuple[int, int]]()
    for row in rule_reply.check().rows:
        if "packets" not in row or "bytes" not in row:
            raise DeviceError("the router reports no counters for the test packets")
        count = int(row["packets"]), int(row["bytes"])
        if "out-interface" in row:
            up[row["out-interface"]] = count
        elif "in-interface" in row:
            down[row["in-interface"]] = count
    read = {
        row.get("default-name") or row["name"]: (int(row["rx-byte"]), int(row["tx-byte"]))
        for row in ports.check().rows
        if row.get("rx-byte", "").isdecimal() and row.get("tx-byte", "").isdecimal()
    }
    return FlowCounts(up, down, read)


async def router_words(session: api.Session) -> str | None:
    """Return the router's model and version as text; None if it does not report them."""
    read = api.Command("/system/resource/print", ((".proplist", "version,board-name"),))
    row = next(iter((await session.command(read)).check().rows), {})
    return (
        msg(f"{arg(row.get('board-name', 'a router'))}, RouterOS {arg(row['version'])}") if "version" in row else None
    )


def link_counts(links: Mapping[str, str], before: FlowCounts, after: FlowCounts | None) -> tuple[LinkCount, ...]:
    """Return the counts of each link; `links` maps port to link. `after` None: the router was not read again."""
    return tuple(_link_count(link, port, before, after) for port, link in links.items())


def _link_count(link: str, port: str, before: FlowCounts, after: FlowCounts | None) -> LinkCount:
    if after is None:
        return LinkCount(link=link)
    up, down = after.up.get(port, (None, None)), after.down.get(port, (None, None))
    rx, tx = _port_increase(before, after, port)
    return LinkCount(
        link=link,
        test_packets_up=up[0],
        test_bytes_up=up[1],
        test_packets_down=down[0],
        test_bytes_down=down[1],
        port_bytes_up=tx,
        port_bytes_down=rx,
    )


def _port_increase(before: FlowCounts, after: FlowCounts, port: str) -> tuple[int | None, int | None]:
    if port not in before.ports or port not in after.ports:
        return None, None
    rx, tx = (now - then for then, now in zip(before.ports[port], after.ports[port], strict=True))
    return (rx, tx) if rx >= 0 and tx >= 0 else (None, None)


def _not_read(counts: Sequence[LinkCount]) -> str | None:
    """Return the reason why uncounted links prevent a verdict; None if all were counted."""
    unread = [count.link for count in counts if count.test_packets_up is None or count.test_packets_down is None]
    return msg(f"{arg(_NOT_READ)} on {arg(join(', ', unread))}") if unread else None


def judge_way(
    link: str, counts: Sequence[LinkCount], sent_packets: int, received_packets: int, lost_packets: int
) -> tuple[Verdict, str]:
    """Judge whether the test packets used the selected link and no other.

    `sent_packets` and `received_packets` are this computer's packets, of which at most `lost_packets` may be lost.
    """
    expected_link = next((count for count in counts if count.link == link), None)
    if expected_link is None or expected_link.test_packets_up is None or expected_link.test_packets_down is None:
        return Verdict.INCONCLUSIVE, _NOT_READ
    for other in counts:
        stray_packets = (other.test_packets_up or 0) + (other.test_packets_down or 0)
        if other.link != link and stray_packets:
            return Verdict.FAIL, msg(f"{arg(stray_packets)} test packets used {arg(other.link)}")
    if (silent := _not_read(counts)) is not None:
        return Verdict.INCONCLUSIVE, silent
    up, down = expected_link.test_packets_up, expected_link.test_packets_down
    counts_text = msg(f"the router counted {arg(up)} packets up and {arg(down)} down over {arg(link)}")
    if not up and received_packets:
        return (
            Verdict.FAIL,
            msg(
                f"none of {arg(sent_packets)} packets used {arg(link)}, and {arg(received_packets)} responses arrived "
                "another way"
            ),
        )
    fits = 0 <= sent_packets - up + FEW <= lost_packets + 2 * FEW and received_packets - FEW <= down <= up + FEW
    if not sent_packets or not fits:
        return (
            Verdict.INCONCLUSIVE,
            msg(f"{arg(sent_packets)} packets were sent and {arg(received_packets)} received, and {arg(counts_text)}"),
        )
    return Verdict.PASS, msg(f"{arg(counts_text)}, and no packets over another link")


def judge_tunnel(
    link: str, counts: Sequence[LinkCount], sent_traffic: TunnelTraffic, received_traffic: TunnelTraffic
) -> tuple[Verdict, str]:
    """Judge whether this computer's tunnel, with its contents, used the selected link alone.

    The tunnel has other packets as well, so the counts must be at least what was sent and received. When it is moved to
    the link, the server may still send a few packets over the previous route.
    """
    expected_link = next((count for count in counts if count.link == link), None)
    if expected_link is None or expected_link.test_packets_up is None or expected_link.test_packets_down is None:
        return Verdict.INCONCLUSIVE, _NOT_READ
    for other in counts:
        up, down = other.test_packets_up or 0, other.test_packets_down or 0
        if other.link != link and (up or (down > FEW and received_traffic.packets)):
            return Verdict.FAIL, msg(f"{arg(up + down)} packets of the tunnel used {arg(other.link)}")
    if (silent := _not_read(counts)) is not None:
        return Verdict.INCONCLUSIVE, silent
    up, down = expected_link.test_packets_up, expected_link.test_packets_down
    counts_text = msg(f"the router counted {arg(up)} packets of the tunnel up and {arg(down)} down over {arg(link)}")
    if not up and received_traffic.packets:
        return (
            Verdict.FAIL,
            msg(
                f"no packet of the tunnel used {arg(link)}, and {arg(received_traffic.packets)} responses arrived "
                "another way"
            ),
        )
    whole = sent_traffic.fits(up, expected_link.test_bytes_up) and received_traffic.fits(
        down, expected_link.test_bytes_down
    )
    if not sent_traffic.packets or not whole:
        return (
            Verdict.INCONCLUSIVE,
            msg(
                f"{arg(sent_traffic.packets)} packets were sent and {arg(received_traffic.packets)} received, and "
                f"{arg(counts_text)}"
            ),
        )
    ours = msg(f"including {arg(sent_traffic.packets)} and {arg(received_traffic.packets)} of this run")
    return Verdict.PASS, msg(f"{arg(counts_text)}, {arg(ours)}, and no packets over another link")


@dataclass(frozen=True, slots=True)
class TunnelTraffic:
    """Packets and bytes on the wire that this computer sent into or received from its tunnel."""

    packets: int
    octets: int

    def fits(self, packets: int, octets: int | None) -> bool:
        """Return whether at least as much was counted, except for a few packets."""
        least = self.octets - FEW * self.octets // max(1, self.packets)
        return packets >= self.packets - FEW and octets is not None and octets >= least
