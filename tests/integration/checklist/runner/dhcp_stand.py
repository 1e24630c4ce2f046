"""A segment in a namespace of its own, with DHCP servers and IPv6 routers of Debian's dnsmasq on it.

from dhcp_stand import Segment, segment   # a fixture; the tests are marked `namespace`
"""

import asyncio
import os
import signal
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from atlantis_netcfg.checklist.probes import (
    DhcpDiscoverRequest,
    DhcpOffers,
    Place,
    RouterAdvertisements,
    RouterSolicitRequest,
)
from atlantis_netcfg.checklist.runner import ask_here

CABLE = "10.64.9.7"
"""Address of the interface that asks, which no server has given it."""


@dataclass
class Segment:
    """A bridge; `ask0` hangs on it, with a computer's address."""

    name: str
    folder: Path
    servers: list[int] = field(default_factory=list)

    def ip(self, *words: str) -> None:
        subprocess.run(["ip", "-n", self.name, *words], check=True, capture_output=True)

    def plug(self, interface: str, address: str) -> None:
        """A computer's interface on the segment."""
        self.ip("link", "add", interface, "type", "veth", "peer", "name", f"{interface}-p")
        self.ip("link", "set", f"{interface}-p", "master", "br0", "up")
        self.ip("address", "add", address, "dev", interface)
        self.ip("link", "set", interface, "up")

    def serve(self, interface: str, subnet: str) -> str:
        """A DHCP server with the first address of a /24; its MAC address. It is ready when this returns."""
        self.plug(interface, f"{subnet}.1/24")
        more = [f"--dhcp-range={subnet}.100,{subnet}.150,1h", "--dhcp-authoritative", "--no-ping"]
        return self._start(interface, *more, f"--dhcp-leasefile={self.leases(interface)}")

    def advertise(self, interface: str, prefix: str) -> str:
        """An IPv6 router with an address of a /64; its MAC address."""
        self.plug(interface, f"{prefix}1/64")
        return self._start(interface, "--enable-ra", f"--dhcp-range={prefix},ra-only,64,2h")

    def _start(self, interface: str, *words: str) -> str:
        command = ["ip", "netns", "exec", self.name, "dnsmasq", "--conf-file=/dev/null", "--port=0", "--user=root"]
        command += [f"--interface={interface}", "--bind-interfaces", *words]
        command += [f"--pid-file={self.folder}/{interface}.pid", "--log-dhcp", f"--log-facility={self.log(interface)}"]
        subprocess.run(command, check=True, capture_output=True)
        self.servers.append(int((self.folder / f"{interface}.pid").read_text()))
        told = subprocess.run(
            ["ip", "netns", "exec", self.name, "cat", f"/sys/class/net/{interface}/address"],
            check=True,
            capture_output=True,
            text=True,
        )
        return told.stdout.strip()

    def leases(self, interface: str) -> Path:
        return self.folder / f"{interface}.leases"

    def log(self, interface: str) -> Path:
        return self.folder / f"{interface}.log"

    def ask(self, interface: str, within_s: float, *before: str) -> DhcpOffers:
        """Probe the segment from this interface, by the program in a process of its own."""
        question = DhcpDiscoverRequest("it", Place.LAPTOP, interface, within_s)
        words = ("ip", "netns", "exec", self.name, *before)
        found = asyncio.run(ask_here([("it", question)], lambda *_: None, words))["it"]
        assert isinstance(found, DhcpOffers)
        return found

    def solicit(self, interface: str, within_s: float, *before: str) -> RouterAdvertisements:
        """The same for IPv6 routers."""
        question = RouterSolicitRequest("it", Place.LAPTOP, interface, within_s)
        words = ("ip", "netns", "exec", self.name, *before)
        found = asyncio.run(ask_here([("it", question)], lambda *_: None, words))["it"]
        assert isinstance(found, RouterAdvertisements)
        return found


@pytest.fixture
def segment(tmp_path: Path) -> Iterator[Segment]:
    if os.geteuid() != 0:
        pytest.skip("making a network namespace needs root")
    name = f"dhcp-{os.getpid()}"
    subprocess.run(["ip", "netns", "add", name], check=True)
    made = Segment(name, tmp_path)
    try:
        made.ip("link", "add", "br0", "type", "bridge")
        made.ip("link", "set", "br0", "up")
        made.plug("ask0", f"{CABLE}/24")
        yield made
    finally:
        for server in made.servers:
            os.kill(server, signal.SIGTERM)
        subprocess.run(["ip", "netns", "delete", name], check=True)
