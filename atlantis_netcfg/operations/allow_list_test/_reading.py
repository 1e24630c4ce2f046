"""What the router says of its satellite port and of the filter in front of it, and the pings that it sends."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from atlantis_netcfg.bearers.policy import ROUTE_PROPERTIES
from atlantis_netcfg.core.errors import DeviceFailed
from atlantis_netcfg.routeros.api import Command

if TYPE_CHECKING:
    from collections.abc import Sequence

    from atlantis_netcfg.operations.allow_list_test._plan import Task
    from atlantis_netcfg.routeros._types import Row
    from atlantis_netcfg.routeros.api import Reply

__all__ = ["Reading", "answered", "factory_ping", "ping", "read", "reads"]

_TRUE = frozenset({"true", "yes"})
_RULE = ".id,chain,action,comment,packets,src-address,src-port,dst-address,dst-port,protocol"


@dataclass(frozen=True, slots=True)
class Reading:
    """The counters at one moment; packets and bytes since they were made or reset."""

    port_bytes: int
    """Both directions."""
    port_name: str
    """What the port is called now: its identity is its default name."""
    rules: tuple[Row, ...]
    """Of the two chains of the satellite."""
    routes: tuple[Row, ...]
    tunnels: tuple[Row, ...]

    def chain(self, name: str) -> tuple[Row, ...]:
        """The rules of a chain, in their order."""
        return tuple(row for row in self.rules if row.get("chain") == name)

    @property
    def tunnel_up(self) -> bool | None:
        """Whether one of its OpenVPN tunnels runs; None: it has none."""
        return any(row.get("running") in _TRUE for row in self.tunnels) if self.tunnels else None

    def dropped(self, chain: str) -> int:
        """Packets that the drop rules of a chain have met."""
        return sum(_number(row, "packets") for row in self.chain(chain) if row.get("action") == "drop")

    def answers(self, chain: str, task: Task) -> int:
        """Packets that came back from a target, by the rule that lets its answers in."""
        return self._passed(chain, task, "src")

    def questions(self, chain: str, task: Task) -> int:
        """Packets that went out to a target, by the rule that lets them out."""
        return self._passed(chain, task, "dst")

    def _passed(self, chain: str, task: Task, side: str) -> int:
        wanted = {f"{side}-address": task.address, f"{side}-port": str(task.port), "protocol": task.transport}
        return sum(
            _number(row, "packets")
            for row in self.chain(chain)
            if row.get("action") == "return" and all(row.get(name) == value for name, value in wanted.items())
        )


def reads(port: str, chains: Sequence[str]) -> tuple[Command, ...]:
    """The questions, for one flight; `read` understands the answers in this order."""
    both = (*(f"?chain={chain}" for chain in chains), "?#|")
    return (
        Command("/interface/print", ((".proplist", "name,default-name,rx-byte,tx-byte"),), (f"?default-name={port}",)),
        Command("/ip/firewall/filter/print", ((".proplist", _RULE),), both),
        Command("/ip/route/print", ((".proplist", ",".join(ROUTE_PROPERTIES)),), ("?dst-address=0.0.0.0/0",)),
        Command("/interface/ovpn-client/print", ((".proplist", "name,running"),)),
    )


def read(port: str, replies: Sequence[Reply]) -> Reading:
    """Understand the answers to `reads`. Raises DeviceFailed if the port is not there, Refused."""
    interfaces, rules, routes, tunnels = (reply.checked().rows for reply in replies)
    found = next((row for row in interfaces if row.get("default-name") == port), None)
    if found is None or "rx-byte" not in found or "tx-byte" not in found:
        raise DeviceFailed(
            f"the router tells no byte counters of port {port}, and without them nothing is sent",
            hint="is the socket of the satellite's cable declared as its port? `provision drift site=…` compares",
        )
    return Reading(
        port_name=found.get("name", port),
        port_bytes=_number(found, "rx-byte") + _number(found, "tx-byte"),
        rules=tuple(rules),
        routes=tuple(routes),
        tunnels=tuple(tunnels),
    )


def ping(address: str, source: str, count: int = 1) -> Command:
    """Echo requests from the link's own address; `/tool/ping` is in the trees of all versions, `/ping` left at 7.23."""
    return Command("/tool/ping", (("address", address), ("src-address", source), ("count", str(count))))


def factory_ping(address: str, port: str) -> Command:
    """Ask by ARP who has an address on a port, by the name that it has now.

    It costs no airtime, and needs no address of that network.
    """
    return Command("/tool/ping", (("address", address), ("arp-ping", "yes"), ("interface", port), ("count", "2")))


def answered(reply: Reply) -> bool:
    """Whether any of the echoes came back; the router's own refusal to send is no answer."""
    rows = reply.rows if reply.trap is None else ()
    return any(_number(row, "received") > 0 for row in rows)


def _number(row: Row, name: str) -> int:
    text = row.get(name, "")
    return int(text) if text.isdecimal() else 0
