"""The router of a site on a live data plane, and behind each of its links a world with every address of the tests."""

import socket
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from ipaddress import ip_interface
from pathlib import Path
from typing import Any

from waiting import HANG_S

from atlantis_netcfg.emulator import lab
from atlantis_netcfg.emulator.lab import hosts
from atlantis_netcfg.emulator.routeros import EmulatorSpec, RunningSite, SiteSpec, User
from atlantis_netcfg.emulator.routeros.dataplane.namespace import plug_of
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.operations.common.rehearsal import site_spec
from atlantis_netcfg.routeros.render import router, router_view

SITE, ROUTER = "coastal", "coastal-router"
PORTS = {"wifi-ptp": "ether1", "4g": "ether2", "satellite": "ether3", "technician": "ether8"}
PROBE_TARGETS = {"wifi-ptp": ("198.51.100.11", "198.51.100.12"), "4g": ("198.51.100.21", "198.51.100.22")}
TECHNICIAN = "10.64.101.10"
TIME_SERVER, VPN_SERVER, STRANGER = "192.0.2.123", "203.0.113.2", "203.0.113.3"
WORLD = (TIME_SERVER, "192.0.2.124", VPN_SERVER, STRANGER, "192.0.2.50", "8.8.8.8")
_SILENCE = """
table ip silence {
  set names { type ipv4_addr; }
  chain input {
    type filter hook input priority 0; policy accept;
    iifname "near" ip daddr @names drop
  }
}
"""


@cache
def shipped() -> Inventory:
    return load(Path(__file__).parents[5] / "inventory")


@dataclass
class LiveStage:
    """A running router that is attached to `prefix-router`."""

    prefix: str
    site: RunningSite
    user: User

    def name(self, who: str) -> str:
        return f"{self.prefix}-{who}"

    def do(self, command: str, **arguments: Any) -> Any:  # noqa: ANN401 - JSON of any shape
        return self.site.do(ROUTER, command, **arguments)

    def wait(self, seconds: int) -> None:
        """Let the router's time pass; in steps, because each probe takes real time."""
        for begin in range(0, seconds, 5):
            self.do("wait", seconds=min(5, seconds - begin))

    def run(self, who: str, *words: str, text: str | None = None) -> str:
        result = hosts.output_of(("ip", "netns", "exec", self.name(who), *words), text=text)
        assert result.returncode == 0, f"{' '.join(words)}: {result.stderr}"
        return result.stdout

    def rows(self, menu: str, *words: str) -> list[dict[str, str]]:
        answers = self.do("console", words=[f"{menu}", *words])
        assert [kind for kind, *_ in answers if kind == "!trap"] == [], answers
        return [dict(word[1:].partition("=")[::2] for word in each) for kind, *each in answers if kind == "!re"]

    def console(self, *words: str) -> None:
        assert [kind for kind, *_ in self.do("console", words=list(words))] == ["!done"]

    def way_out(self, address: str = "8.8.8.8") -> str:
        """The device of Linux by which the router sends to an address."""
        return self.run("router", "ip", "route", "get", address).partition(" dev ")[2].split()[0]

    def silence(self, who: str, *addresses: str) -> None:
        """Let these addresses of a world answer nothing, and all others answer again."""
        self.run(who, "nft", "flush", "set", "ip", "silence", "names")
        if addresses:
            self.run(who, "nft", "add", "element", "ip", "silence", "names", f"{{ {', '.join(addresses)} }}")

    @contextmanager
    def socket(self, who: str, kind: int, *at: tuple[str, int]) -> Iterator[socket.socket]:
        """A socket in a namespace, bound to an address and port."""
        sockets = hosts.NamespaceSockets(self.name(who))
        with sockets.socket(kind) as made:
            made.settimeout(HANG_S)
            for each in at:
                made.bind(each)
            yield made
        sockets.close()

    def connections(self, target: str) -> list[str]:
        """Who has a tracked connection to an address and port."""
        rows = self.rows("/ip/firewall/connection/print", f"?dst-address={target}")
        return [row["src-address"] for row in rows]

    def packets(self, comment: str, menu: str = "/ip/firewall/filter") -> int:
        found = self.rows(f"{menu}/print", "=stats=", f"?comment=atlantis: {comment}")
        return sum(int(row["packets"]) for row in found)


def _world(stage: LiveStage, who: str, address: str, *others: str) -> None:
    """Take the plug of a port of the router, as a neighbour with these addresses."""
    plug, name = plug_of(PORTS[who]), stage.name(who)
    hosts.add_namespace(name)
    stage.run("router", *f"ip link set {plug} netns {name} name near".split())
    stage.run(who, "nft", "-f", "-", text=_SILENCE)
    for item in (f"{address} dev near", *(f"{each}/32 dev lo" for each in others)):
        stage.run(who, *f"ip address add {item}".split())
    stage.run(who, *["ip", "link", "set", "near", "up"])


@contextmanager
def live_site(folder: Path) -> Iterator[LiveStage]:
    """The router, configured by what is rendered for it, with a world behind each link."""
    declared = shipped()
    host = declared.hosts[ROUTER]
    (twin,) = site_spec(declared, [host]).emulators
    adopted = f"add address={twin.router.management.address} "  # stands there before anything is declared
    text = "".join(line for line in router(declared, host).splitlines(keepends=True) if not line.startswith(adopted))
    wire = EmulatorSpec(router=twin.router.model_copy(update={"seed": text}))
    with (
        lab.reserve_name() as prefix,
        RunningSite(SiteSpec(name=SITE, emulators=(wire,)), folder) as site,
    ):
        stage = LiveStage(prefix, site, twin.router.users[0])
        hosts.add_namespace(stage.name("router"))
        assert stage.do("attach", namespace=stage.name("router")) == []
        view = router_view(declared, host)
        for link in view.uplinks:
            length = ip_interface(link.interface_address).network.prefixlen
            _world(stage, link.name, f"{link.gateway}/{length}", *PROBE_TARGETS.get(link.name, ()), *WORLD)
        management = ip_interface(view.management.address)
        _world(stage, "technician", f"{TECHNICIAN}/{management.network.prefixlen}")
        stage.run("technician", *f"ip route add default via {management.ip}".split())
        yield stage
