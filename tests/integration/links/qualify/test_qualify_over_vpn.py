"""`over=vpn` through a real OpenVPN: a laptop in the VPN, behind a Linux router with two links in a site's place.

    technician -- quay -- [wan, or other] -- net -- [10.64.0.0/24] -- server, scc-control with our far end

The router is told the rows of the product in RouterOS's words, and does with `ip rule` and `nft` what they say; how a
RouterOS router does it is not shown here. Sizes are counted by the kernel, at the router's ports.
"""

from __future__ import annotations

import asyncio
import contextlib
import ctypes
import json
import sys
import threading
from dataclasses import dataclass, field, replace
from functools import partial
from ipaddress import IPv4Address
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, cast

import pytest
from matrix_papers import host
from matrix_stand import CENTRE, NET, _cable, _ip, _namespace, vpn

from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.inventory import load
from atlantis_netcfg.links.qualify.figures import train_figures
from atlantis_netcfg.links.qualify.measured_run import SAMPLES_FILE, BudgetLimits, Selection
from atlantis_netcfg.links.qualify.samples import read
from atlantis_netcfg.operations.qualify import plan, run
from atlantis_netcfg.operations.qualify.far_end import far_end_of
from atlantis_netcfg.operations.qualify.run import TUNNEL_MTU, LinkRun
from atlantis_netcfg.routeros.api import Command, Reply
from atlantis_netcfg.vpn.authority.model import EnrolmentRequest
from atlantis_netcfg.vpn.identity import MemberKind

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable, Iterator, Sequence

    from matrix_stand import Vpn

    from atlantis_netcfg.links.qualify.measured_run import MeasuredRun
    from atlantis_netcfg.operations.common.request import Request

pytestmark = [pytest.mark.namespace, pytest.mark.slow]
SHIPPED = Path(__file__).parents[4] / "inventory"
LAPTOP, QUAY = "technician-laptop", "quay"
PORTS = {"ether1": "eth0", "ether2": "eth1", "ether3": "eth2"}
"""Of the declared router: wifi-ptp, 4g, satellite; the last one has no cable here."""
TABLES = {"via-wifi-ptp": "101", "via-4g": "102"}
BUDGET, LARGEST = 150_000, 112 + 28 + 52
_CLONE_NEWNET = 0x40000000
_NFT = """\
table ip nat {
  chain after {
    type nat hook postrouting priority srcnat
    oifname { "eth0", "eth1" } masquerade
  }
}
table ip count {
  chain forward { type filter hook forward priority mangle
  }
}
"""


@dataclass
class LinuxRouter:
    """Does what rows of the product say, as a Linux kernel does it; `leads` False: it takes rules, and ignores them."""

    made: Vpn
    leads: bool = True
    rows: dict[str, Command] = field(default_factory=dict)

    async def flight(self, commands: Sequence[Command], *, silence_s: float | None = None) -> list[Reply]:  # noqa: ARG002 - a session's
        return [self._done(command) for command in commands]

    async def command(self, command: Command, *, silence_s: float | None = None) -> Reply:  # noqa: ARG002 - as above
        return self._done(command)

    def _done(self, command: Command) -> Reply:
        menu, _, what = command.path.rpartition("/")
        words = dict(command.arguments)
        if command.path == "/safe-mode/print":
            return Reply(rows=({"enabled": "true", "current": "true"},))
        if what == "add":
            return self._add(menu, words)
        if what == "remove":
            return self._remove(words[".id"])
        if command.path == "/interface/print":
            return Reply(rows=())
        if what == "print" and "packets" in words.get(".proplist", ""):
            return Reply(rows=tuple(self._counted()))
        mine = [name for name, row in self.rows.items() if row.path.startswith(menu)] if command.queries else []
        return Reply(rows=tuple({".id": name} for name in mine))

    def _add(self, menu: str, words: dict[str, str]) -> Reply:
        name = f"*{len(self.rows) + 1:X}"
        self.rows[name] = Command(f"{menu}/add", tuple(words.items()))
        if menu == "/routing/rule":
            if self.leads:
                self._rule("add", words)
            return Reply(ret=name)
        matches = [f'{side[:1]}ifname "{PORTS[words[f"{side}-interface"]]}"' for side in _sides(words)]
        matches += [f"ip {way[0]}addr {words[f'{way}-address']}" for way in ("src", "dst")]
        matches += [f"udp {way[0]}port {words[f'{way}-port']}" for way in ("src", "dst") if f"{way}-port" in words]
        self.made.run(QUAY, "nft", f'add rule ip count forward {" ".join(matches)} counter comment "{name}"')
        return Reply(ret=name)

    def _remove(self, name: str) -> Reply:
        row = self.rows.pop(name)
        if row.path == "/routing/rule/add" and self.leads:
            self._rule("del", dict(row.arguments))
        return Reply()

    def _rule(self, verb: str, words: dict[str, str]) -> None:
        where = f"from {words['src-address']} to {words['dst-address']} lookup {TABLES[words['table']]}"
        _ip(self.made, QUAY, f"rule {verb} {where} priority 100")

    def _counted(self) -> Iterator[dict[str, str]]:
        listed = json.loads(self.made.run(QUAY, "nft", "-j", "list", "chain", "ip", "count", "forward"))["nftables"]
        for rule in (each["rule"] for each in listed if "rule" in each):
            row = self.rows.get(rule["comment"])
            if row is None:
                continue
            counter = next(part["counter"] for part in rule["expr"] if "counter" in part)
            words = dict(row.arguments)
            port = {f"{side}-interface": words[f"{side}-interface"] for side in _sides(words)}
            yield {**port, "packets": str(counter["packets"]), "bytes": str(counter["bytes"])}


def _sides(words: dict[str, str]) -> list[str]:
    return [side for side in ("in", "out") if f"{side}-interface" in words]


def _quay(made: Vpn) -> None:
    """Put the laptop behind a router with two links, each in a network of its own."""
    made.run(LAPTOP, "ip", "link", "delete", "eth0")
    _namespace(made, QUAY)
    _ip(made, QUAY, "link add mgmt type bridge", "link set mgmt up", "address add 10.64.101.1/24 dev mgmt")
    _cable(made, LAPTOP, "mgmt", "10.64.101.10/24", "10.64.101.1", at=QUAY)
    _ip(made, NET, "link add other type bridge", "link set other up", "address add 198.51.100.1/24 dev other")
    _cable(made, QUAY, "other", "198.51.100.2/24", "198.51.100.1")
    _ip(made, QUAY, "link set eth0 down", "link set eth0 name eth1", "link set eth1 up")
    _cable(made, QUAY, "wan", "192.0.2.200/24", "192.0.2.1")
    for table, way in (("101", "via 192.0.2.1 dev eth0"), ("102", "via 198.51.100.1 dev eth1")):
        _ip(made, QUAY, f"route add default {way} table {table}")
    made.run(QUAY, "nft", "-f", "-", text=_NFT)


@pytest.fixture(scope="module")
def stand(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Vpn]:
    declaration, folder = load(SHIPPED), tmp_path_factory.mktemp("vpn")
    laptop = EnrolmentRequest(LAPTOP, MemberKind.LAPTOP, None, LAPTOP, address=IPv4Address("10.80.0.40"))
    with vpn(declaration, [host(declaration, CENTRE), laptop], folder, before=_quay) as made:
        key = folder / "stamp.key"
        key.write_bytes(far_end_of(declaration, over_vpn=True).key or b"")
        far = made.start(
            CENTRE, sys.executable, "-P", "-m", "atlantis_netcfg.links.qualify.reflector", "--key-file", str(key)
        )
        assert far.stdout is not None
        with far.stdout:
            assert "ready on port 862" in far.stdout.readline()
            yield made


def measured(
    made: Vpn, folder: Path, monkeypatch: pytest.MonkeyPatch, max_bytes: int | None = None, *, leads: bool = True
) -> tuple[MeasuredRun, LinuxRouter]:
    """Measure the link that does not carry the traffic, from within the laptop."""
    router = LinuxRouter(made, leads)
    monkeypatch.setattr(run, "device_job", lambda *_arguments: SimpleNamespace(endpoint=None))
    monkeypatch.setattr(run, "build_plan", partial(_hurried, plan.build_plan))
    monkeypatch.setattr(run, "Session", SimpleNamespace(open=_opened(router)))
    bearer = next(each for each in made.declaration.sites["coastal"].bearers if each.name == "4g")
    limits = BudgetLimits(max_bytes=max_bytes)
    far = far_end_of(made.declaration, over_vpn=True)
    made_run = LinkRun(made.declaration, "coastal", bearer, Selection.TELEMETRY, limits, folder, far, over_vpn=True)
    found: list[MeasuredRun] = []
    within(made, LAPTOP, lambda: found.append(made_run.measure(cast("Request", None))[0]))
    return found[0], router


def _hurried(planned: Callable[..., plan.QualifyPlan], *arguments: Any, **named: Any) -> plan.QualifyPlan:  # noqa: ANN401
    return replace(planned(*arguments, **{**named, "is_rehearsal": True}), cells=(), sizes=())


def _opened(router: LinuxRouter) -> Callable[[object], Any]:
    @contextlib.asynccontextmanager
    async def session() -> AsyncIterator[LinuxRouter]:
        yield router

    async def opened(_endpoint: object) -> contextlib.AbstractAsyncContextManager[LinuxRouter]:
        await asyncio.sleep(0)
        return session()

    return opened


def within(made: Vpn, who: str, action: Callable[[], None]) -> None:
    """Do it in a thread that stands in a namespace; sockets stay where they were made."""
    failures: list[BaseException] = []

    def enter() -> None:
        try:
            with Path("/run/netns", made.name(who)).open("rb") as door:
                assert ctypes.CDLL(None, use_errno=True).setns(door.fileno(), _CLONE_NEWNET) == 0
            action()
        except BaseException as error:  # noqa: BLE001 - raised again below
            failures.append(error)

    thread = threading.Thread(target=enter)
    thread.start()
    thread.join()
    for failure in failures:
        raise failure


def octets(made: Vpn, port: str) -> int:
    """IP octets that have passed a port of the router, both ways, as its kernel counts; 14 are Ethernet's."""
    (link,) = json.loads(made.run(QUAY, "ip", "-s", "-j", "link", "show", port))
    ways = (link["stats64"]["rx"], link["stats64"]["tx"])
    return sum(way["bytes"] - 14 * way["packets"] for way in ways)


def test_tunnel_over_the_link_is_counted_and_billed_with_its_overhead(
    stand: Vpn, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = {port: octets(stand, port) for port in ("eth0", "eth1")}
    found, router = measured(stand, tmp_path, monkeypatch)
    used = {port: octets(stand, port) - before[port] for port in before}
    assert (found.way, found.reason) == (Verdict.PASS, "done"), found.way_reason
    assert router.rows == {}
    assert (found.far_end.address, found.far_end.source, found.far_end.over_vpn) == ("10.80.0.2", "10.80.0.40", True)
    counts = {each.link: each for each in found.counts}
    assert counts["wifi-ptp"].test_packets_up == 0
    paid = found.sent_bytes + found.received_bytes
    # A packet is lost while the tunnel moves; ARP and the tunnel's own pings are all that comes on top.
    assert paid - LARGEST <= used["eth1"] <= 1.01 * paid
    assert used["eth0"] < 1_000
    assert (found.path_mtu_up, found.path_mtu_both) == (1448, 1448)
    assert TUNNEL_MTU in found.remarks
    with (tmp_path / SAMPLES_FILE).open(encoding="utf-8") as lines:
        idle = train_figures(read(lines), "idle")
    assert (idle.loss.sent, idle.loss.lost) == (600, 0)


def test_tunnel_over_another_link_proves_nothing_and_stays_in_budget(
    stand: Vpn, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = octets(stand, "eth0")
    found, _ = measured(stand, tmp_path, monkeypatch, BUDGET, leads=False)
    used = octets(stand, "eth0") - before
    assert (found.way, found.reason) == (Verdict.FAIL, "bytes"), found.way_reason
    assert "packets of the tunnel used wifi-ptp" in found.way_reason
    assert 0.6 * BUDGET < used <= BUDGET + LARGEST
