"""A router's namespace with its OpenVPN clients, cabled to a namespace with the VPN's server.

    router (10.10.0.2, link wifi-ptp) -- ether1 -- ether1-far -- server (10.10.0.1, and 203.0.113.2)

The server has the product's configuration and firewall, with an authority as a rehearsal makes it.
"""

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import pytest
from router_stand import HOST, SHIPPED
from waiting import HANG_S

from atlantis_netcfg.emulator import lab
from atlantis_netcfg.emulator.lab import hosts
from atlantis_netcfg.emulator.routeros import RunningSite
from atlantis_netcfg.emulator.routeros.dataplane import tunnel
from atlantis_netcfg.emulator.routeros.dataplane.namespace import RouterNamespace, plug_of
from atlantis_netcfg.vpn import server as product
from atlantis_netcfg.vpn.authority.authority import Authority

PORT, LINK = "ether1", SHIPPED.sites[HOST.site].bearers[0]
ENDPOINT = str(SHIPPED.pilot.vpn.endpoint)


@dataclass
class Ground:
    """Both namespaces; the router's follows its rows."""

    router: RouterNamespace
    server: str
    tunnels: tunnel.RouterTunnels
    emulators: RunningSite
    folder: Path
    output: list[str] = field(default_factory=list)

    def apply(self) -> None:
        """Bring the VPN clients to the rows; the namespace follows them by itself."""
        self.tunnels.refresh()

    def inside(self, *words: str) -> str:
        """Run a program at the server."""
        return hosts.program("ip", "netns", "exec", self.server, *words)

    def place(self, path: str) -> Path:
        """Return the place of a file of the server in the test's folder."""
        return self.folder / path.removeprefix("/")

    def write(self, path: str, text: str) -> Path:
        """Write a file of the server, with its paths below the test's folder."""
        for absolute in ("/etc/openvpn/atlantis", "/run/atlantis-vpn", "/etc/atlantis"):
            text = text.replace(absolute, f"{self.folder}{absolute}")
        target = self.place(path)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(text, encoding="utf-8")
        target.chmod(0o600)
        return target


@contextmanager
def ground(emulators: RunningSite, folder: Path) -> Iterator[Ground]:
    with lab.reserve_name() as name:
        namespace, server = RouterNamespace(f"{name}-r"), f"{name}-s"
        for each in (namespace.name, server):
            hosts.add_namespace(each)
        keys = folder / "tunnels"
        keys.mkdir(parents=True)
        tunnels = tunnel.RouterTunnels(partial(emulators.do, HOST.name), namespace.name, keys)
        emulators.do(HOST.name, "attach", namespace=namespace.name)
        place = Ground(namespace, server, tunnels, emulators, folder / "server")
        try:
            _cable(place)
            place.apply()
            yield place
        finally:
            tunnels.close()
            emulators.do(HOST.name, "attach", namespace=None)


def _cable(place: Ground) -> None:
    plug = plug_of(PORT)
    place.router.run("ip", "link", "set", plug, "netns", place.server)
    prefix = LINK.network.prefixlen
    for line in (
        f"address add {LINK.gateway}/{prefix} dev {plug}",
        f"link set {plug} up",
        *(f"address add {address}/32 dev lo" for address in (ENDPOINT, *LINK.canaries)),
    ):
        hosts.program("ip", "-n", place.server, *line.split())


@contextmanager
def vpn_server(place: Ground, folder: Path) -> Iterator[None]:
    """Run the product's server with the authority in a folder, until the block ends."""
    authority = Authority.open(folder)
    host = SHIPPED.hosts[SHIPPED.pilot.vpn.server]
    text = product.server_conf(SHIPPED, host).replace(f"local {host.device.address}", f"local {ENDPOINT}")  # type: ignore[union-attr]
    conf = place.write("/etc/openvpn/server/atlantis.conf", text)
    place.place("/run/atlantis-vpn").mkdir(parents=True, exist_ok=True)
    for name in ("ca.crt", "server/server.crt", "server/server.key", "server/tls-crypt-v2.key", "server/tls-crypt.key"):
        source = folder / name
        place.write(f"{product.FOLDER}/{source.name}", source.read_text(encoding="utf-8"))
    for file in product.live_files(SHIPPED, authority.membership(), authority.crl()):
        place.write(file.path, file.content)
    place.inside("nft", "-f", str(place.place(product.FIREWALL)))
    words = ("ip", "netns", "exec", place.server, "openvpn", "--suppress-timestamps", "--config", str(conf))
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        assert process.stdout is not None
        try:
            for line in process.stdout:
                place.output.append(line)
                if "Initialization Sequence Completed" in line:
                    break
            else:
                pytest.fail("".join(place.output))
            yield
        finally:
            process.terminate()
            process.communicate(timeout=HANG_S)
