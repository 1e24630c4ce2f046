"""Lead this computer's test packets over one bearer, and have the router count them on every bearer.

The site's traffic is not moved: a routing rule for this computer's address and the far end's, and rows of the mangle
table that do nothing but count (`action=passthrough`) for exactly this flow, on each link and in each direction. They
are on the router under safe mode for as long as the measurement lasts, bear `MARK`, and are seen to be gone after it.
Mangle, not the filter: there they stand before whatever accepts or drops, and a filter of ours has no fasttrack.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.core.errors import DeviceFailed
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.operations.allow_list_test.prove import MARK
from atlantis_netcfg.qualify.measured_run import LinkCount
from atlantis_netcfg.routeros.api import Command

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from atlantis_netcfg.routeros.api import Reply, Session

_MANGLE = "/ip/firewall/mangle"
_RULE = "/routing/rule"
FEW = 2
"""Packets by which two counts may differ though nothing is known to be lost: questions for counters, a copy."""


@dataclass(frozen=True, slots=True)
class MeasuredFlow:
    """The test packets of a run, as the router sees them before it translates addresses."""

    source: str
    source_port: int
    far: str
    far_port: int


@dataclass(frozen=True, slots=True)
class FlowCounts:
    """What a router has counted since the rows were made; packets and bytes by port and direction."""

    up: Mapping[str, tuple[int, int]]
    down: Mapping[str, tuple[int, int]]
    ports: Mapping[str, tuple[int, int]]
    """Received and sent bytes of each port, whatever they were."""


def rows(flow: MeasuredFlow, link: str, ports: Sequence[str], rules: Reply, mangle: Reply) -> tuple[Command, ...]:
    """The rows that lead the flow over a link and count it on every port; ahead of all others."""
    where = (("src-address", f"{flow.source}/32"), ("dst-address", f"{flow.far}/32"), ("table", f"via-{link}"))
    rule = Command(f"{_RULE}/add", (("action", "lookup-only-in-table"), ("comment", MARK), *where, *_first(rules)))
    return (rule, *_counting(flow, ports, _first(mangle)))


def _counting(flow: MeasuredFlow, ports: Sequence[str], first: tuple[tuple[str, str], ...]) -> Iterator[Command]:
    words = (("action", "passthrough"), ("chain", "forward"), ("comment", MARK), ("protocol", "udp"))
    for port in ports:
        up = (
            ("out-interface", port),
            ("src-address", flow.source),
            ("src-port", str(flow.source_port)),
            ("dst-address", flow.far),
            ("dst-port", str(flow.far_port)),
        )
        down = (
            ("in-interface", port),
            ("src-address", flow.far),
            ("src-port", str(flow.far_port)),
            ("dst-address", flow.source),
            ("dst-port", str(flow.source_port)),
        )
        for way in (up, down):
            yield Command(f"{_MANGLE}/add", (*words, *way, *first))


def _first(reply: Reply) -> tuple[tuple[str, str], ...]:
    found = next((row[".id"] for row in reply.checked().rows if ".id" in row and row.get("dynamic") != "true"), None)
    return () if found is None else (("place-before", found),)


async def first_rows(session: Session) -> tuple[Reply, Reply]:
    """What stands on the router now, for `rows`."""
    ids = (".proplist", ".id,dynamic")
    rules, mangle = await session.flight([Command(f"{menu}/print", (ids,)) for menu in (_RULE, _MANGLE)])
    return rules, mangle


async def counters(session: Session) -> FlowCounts:
    """Read the counting rows and the ports. Raises Refused, DeviceFailed where a row tells no count."""
    rule = Command(
        f"{_MANGLE}/print", ((".proplist", "in-interface,out-interface,packets,bytes"),), (f"?comment={MARK}",)
    )
    interfaces = Command("/interface/print", ((".proplist", "name,default-name,rx-byte,tx-byte"),))
    marked, ports = await session.flight([rule, interfaces])
    up, down = dict[str, tuple[int, int]](), dict[str, tuple[int, int]]()
    for row in marked.checked().rows:
        if "packets" not in row or "bytes" not in row:
            raise DeviceFailed("the router tells no count of the rows that count the test packets")
        count = int(row["packets"]), int(row["bytes"])
        if "out-interface" in row:
            up[row["out-interface"]] = count
        elif "in-interface" in row:
            down[row["in-interface"]] = count
    read = {
        row.get("default-name") or row["name"]: (int(row["rx-byte"]), int(row["tx-byte"]))
        for row in ports.checked().rows
        if row.get("rx-byte", "").isdecimal() and row.get("tx-byte", "").isdecimal()
    }
    return FlowCounts(up, down, read)


def link_counts(links: Mapping[str, str], before: FlowCounts, after: FlowCounts | None) -> tuple[LinkCount, ...]:
    """What was counted on each link of the site; `links`: port to link. `after` None: the router was not read again."""
    return tuple(_count(link, port, before, after) for port, link in links.items())


def _count(link: str, port: str, before: FlowCounts, after: FlowCounts | None) -> LinkCount:
    if after is None:
        return LinkCount(link=link)
    up, down = after.up.get(port, (None, None)), after.down.get(port, (None, None))
    rx, tx = _risen(before, after, port)
    return LinkCount(
        link=link,
        test_packets_up=up[0],
        test_bytes_up=up[1],
        test_packets_down=down[0],
        test_bytes_down=down[1],
        port_bytes_up=tx,
        port_bytes_down=rx,
    )


def _risen(before: FlowCounts, after: FlowCounts, port: str) -> tuple[int | None, int | None]:
    if port not in before.ports or port not in after.ports:
        return None, None
    rx, tx = (now - then for then, now in zip(before.ports[port], after.ports[port], strict=True))
    return (rx, tx) if rx >= 0 and tx >= 0 else (None, None)


def judge_way(link: str, counts: Sequence[LinkCount], sent: int, received: int, lost: int) -> tuple[Verdict, str]:
    """Say whether the test packets left by the link that was meant, and by no other.

    `sent` and `received` are this computer's packets, `lost` how many of them may be lost on the way at most.
    """
    meant = next((count for count in counts if count.link == link), None)
    if meant is None or meant.test_packets_up is None or meant.test_packets_down is None:
        return Verdict.INCONCLUSIVE, "the router has not told what it counted"
    for other in counts:
        strayed = (other.test_packets_up or 0) + (other.test_packets_down or 0)
        if other.link != link and strayed:
            return Verdict.FAIL, f"{strayed} test packets went over {other.link}"
    up, down = meant.test_packets_up, meant.test_packets_down
    counted = f"the router counted {up} packets up and {down} down over {link}"
    if not up and received:
        return Verdict.FAIL, f"none of {sent} packets went over {link}, and {received} answers came by another way"
    fits = 0 <= sent - up + FEW <= lost + 2 * FEW and received - FEW <= down <= up + FEW
    if not sent or not fits:
        return Verdict.INCONCLUSIVE, f"{sent} packets were sent and {received} came, and {counted}"
    return Verdict.PASS, f"{counted}, and none over another link"
