"""DDS and the links that it may not cross: real participants, a real OpenVPN, and the firewalls of gateway and router.

    coastal-gateway -- router -- wifi-ptp, satellite -- the VPN of tests/integration/vpn/network -- scc-control

The router's firewall is the translation of its rendered text. A change of link is a change of its default route, after
which connections begin again, as on a real one. The times are shorter than those of a pilot.
"""

import os
import re
import shlex
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from importlib.util import find_spec
from ipaddress import ip_interface
from pathlib import Path

import pytest
from dds_stand import Participant
from matrix_papers import host
from matrix_stand import NET, Vpn, vpn
from nft_translation import translate
from waiting import HANG_S, wait_until

from atlantis_netcfg.computers import base
from atlantis_netcfg.computers.dds import TUNING, profile_in_use, profile_views, profiles
from atlantis_netcfg.computers.dds_link import SERVICE, dds_link
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.inventory.model import Dds, Pace, RosDistribution, RosMiddleware
from atlantis_netcfg.routeros import rsc
from atlantis_netcfg.routeros.render import RouterView, router, router_view

if find_spec("cyclonedds") is None:
    pytest.skip("PyPI has no cyclonedds for this machine", allow_module_level=True)
pytestmark = [pytest.mark.slow, pytest.mark.namespace]
SHIPPED = Path(__file__).parents[4] / "inventory"
PROGRAM = Path(__file__).with_name("programs") / "python_peer.py"
GATEWAY, CENTRE, ROUTER = "coastal-gateway", "scc-control", "router"
WIFI, SATELLITE = "wifi-ptp", "satellite"
KEPT_OFF = "DDS, kept off this link"
_EVERY_S, _REMEMBERED_S, _ANNOUNCE_S = 1, 3, 2


@dataclass
class Quay:
    """The gateway of the VPN's stand with a router before it."""

    made: Vpn
    view: RouterView

    def use(self, link: str) -> None:
        """Let the default route lead over a link."""
        gateway = next(uplink.gateway for uplink in self.view.uplinks if uplink.name == link)
        self.made.run(ROUTER, "ip", "route", "replace", "default", "via", gateway)
        self.made.run(ROUTER, "conntrack", "-F")

    def nft(self, who: str, *words: str) -> str:
        return self.made.run(who, "nft", *words)

    def packets(self, who: str, comment: str) -> int:
        """How many packets a rule has met, by its comment."""
        lines = [line for line in self.nft(who, "list", "ruleset").splitlines() if f'"{comment}"' in line]
        assert len(lines) == 1, f"no rule says {comment}"
        return int(re.findall(r"counter packets (\d+)", lines[0])[0])

    def kept_off(self) -> bool:
        return "ip expires" in self.nft(GATEWAY, "list", "set", "inet", "atlantis", "no_dds")

    def answers(self, who: str, whom: str) -> bool:
        """Whether a computer reaches another one in the tunnel."""
        address = str(self.made.authority.membership().members[whom].address)
        words = ["ip", "netns", "exec", self.made.name(who), "ping", "-q", "-c", "1", "-W", "2", address]
        return subprocess.run(words, capture_output=True, check=False).returncode == 0


def pilot() -> Inventory:
    declaration = load(SHIPPED)
    dds = Dds(distribution=RosDistribution.HUMBLE, middleware=RosMiddleware.CYCLONE_DDS)
    return replace(declaration, pilot=declaration.pilot.model_copy(update={"dds": dds}))


def file_of(declaration: Inventory, path: str) -> str:
    files = base.gateway_base(declaration, declaration.hosts[GATEWAY]).configuration.files
    return next(file.content for file in files if file.path == path)


def _router(made: Vpn, view: RouterView) -> None:
    """Put the site's router between the gateway and the internet: its LAN, and two links with a hop of their own."""
    space = made.name(ROUTER)
    subprocess.run(["ip", "netns", "add", space], check=True)
    made.stack.callback(subprocess.run, ["ip", "netns", "delete", space], check=True)
    made.run(
        ROUTER, "sysctl", "-qw", "net.ipv4.ip_forward=1", "net.ipv4.conf.all.rp_filter=0", "net.ipv4.icmp_ratelimit=0"
    )
    made.run(ROUTER, "ip", "link", "set", "lo", "up")
    lan = ip_interface(view.lan.address)
    made.run(GATEWAY, "ip", "link", "delete", "eth0")
    _wire(made, GATEWAY, "eth0", f"10.64.1.10/{lan.network.prefixlen}", ROUTER, view.bridge, view.lan.address)
    made.run(GATEWAY, "ip", "route", "add", "default", "via", str(lan.ip))
    for link in (uplink for uplink in view.uplinks if uplink.name in {WIFI, SATELLITE}):
        far = f"{link.gateway}/{ip_interface(link.interface_address).network.prefixlen}"
        _wire(made, ROUTER, link.port, link.interface_address, NET, link.name, far)


def _wire(made: Vpn, near: str, name: str, address: str, far: str, other: str, far_address: str) -> None:  # noqa: PLR0913, PLR0917 - two ends
    made.run(near, "ip", "link", "add", name, "type", "veth", "peer", "name", other, "netns", made.name(far))
    for who, interface, own in ((near, name, address), (far, other, far_address)):
        made.run(who, "ip", "address", "add", own, "dev", interface)
        made.run(who, "ip", "link", "set", interface, "up")


@contextmanager
def quay(folder: Path, declaration: Inventory) -> Iterator[Quay]:
    """The VPN is up over the Wi-Fi bridge, both firewalls are loaded, and the gateway's unit runs."""
    device = declaration.hosts["coastal-router"]
    view, text = router_view(declaration, device), router(declaration, device)

    def between(made: Vpn) -> None:
        _router(made, view)
        made.run(ROUTER, "nft", "-f", "-", text=translate(rsc.parse(text, "coastal-router")).text())
        Quay(made, view).use(WIFI)
        made.run(GATEWAY, "nft", "-f", "-", text=file_of(declaration, "/etc/nftables.conf"))

    wishes = [host(declaration, GATEWAY), host(declaration, CENTRE)]
    with vpn(declaration, wishes, folder, before=between) as made, unit(made, declaration):
        yield Quay(made, view)


@contextmanager
def unit(made: Vpn, declaration: Inventory) -> Iterator[None]:
    """Run the command of the gateway's unit as systemd reads it (systemd.service(5), Command lines)."""
    text = file_of(declaration, f"/etc/systemd/system/{SERVICE}").replace("\\\n", " ")
    command = next(line for line in text.splitlines() if line.startswith("ExecStart=")).removeprefix("ExecStart=")
    words = shlex.split(command.replace("%%", "%").replace("$$", "$"))
    process = subprocess.Popen(
        ["ip", "netns", "exec", made.name(GATEWAY), *words],
        stdout=subprocess.DEVNULL,
        start_new_session=True,
        env={**os.environ, "LC_ALL": "C"},
    )
    try:
        yield
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def speaker(made: Vpn, name: str, folder: Path) -> Participant:
    """A participant with the computer's own profile, in the dialect of Cyclone DDS 11."""
    used = profile_in_use(made.declaration, made.declaration.hosts[name]).link
    views = profile_views(made.declaration, made.declaration.hosts[name], "pypi")
    view = next(each for each in views if each.link == used)
    path = folder / f"{name}.xml"
    path.write_text(profiles(view)[f"{used}/cyclonedds.xml"], encoding="utf-8")
    process = made.start(name, sys.executable, str(PROGRAM), name[:7], "0", environment={"CYCLONEDDS_URI": str(path)})
    return Participant(name, process)


def _heard_again(one: Participant) -> bool:
    begun = time.monotonic()
    return one.wait(lambda: len(one.heard(begun)) > 2, begun + HANG_S)


def test_dds_crosses_the_bridge_and_never_the_satellite(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(TUNING, Pace.SATELLITE, replace(TUNING[Pace.SATELLITE], announce_s=_ANNOUNCE_S))
    monkeypatch.setattr(
        base,
        "dds_link",
        lambda *of: replace(dds_link(*of), every_s=_EVERY_S, remembered_s=_REMEMBERED_S),  # type: ignore[type-var]
    )
    declaration = pilot()
    with quay(tmp_path, declaration) as stand:
        made = stand.made
        assert GATEWAY not in dict(profile_in_use(declaration, declaration.hosts[CENTRE]).peers)
        gateway, centre = (speaker(made, name, tmp_path) for name in (GATEWAY, CENTRE))
        assert _heard_again(centre), (gateway.lines, centre.lines)
        assert _heard_again(gateway), (gateway.lines, centre.lines)
        assert not stand.kept_off()

        stand.use(SATELLITE)
        wait_until(stand.kept_off)
        # Nobody but the unit sends anything now: the server knows the new address, and everything else passes.
        wait_until(lambda: stand.answers(CENTRE, GATEWAY))
        assert stand.answers(GATEWAY, CENTRE)
        drops = stand.packets(GATEWAY, KEPT_OFF)
        wait_until(lambda: stand.packets(GATEWAY, KEPT_OFF) > drops + 15)  # the centre says what came before
        heard = len(centre.heard())
        wait_until(lambda: stand.packets(GATEWAY, KEPT_OFF) > drops + 45)
        assert len(centre.heard()) == heard
        # The link itself: not one echo of the unit, and the drops are not those of the allow-list.
        assert stand.packets(ROUTER, "atlantis: no DDS over satellite") > 0
        assert stand.packets(ROUTER, "atlantis: satellite, everything else") == 0

        stand.use(WIFI)
        assert _heard_again(centre), (gateway.lines, centre.lines)
        assert _heard_again(gateway), (gateway.lines, centre.lines)
        assert not stand.kept_off()


def test_unresponsive_router_or_forged_icmp_does_not_block_dds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A forged refusal of another computer in the LAN does not count, nor one that is not related to an echo."""
    monkeypatch.setattr(base, "dds_link", lambda *of: replace(dds_link(*of), every_s=_EVERY_S))  # type: ignore[type-var]
    with quay(tmp_path, pilot()) as stand:
        raw = stand.made.socket(ROUTER, socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_ICMP)
        with suppress(PermissionError):
            raw.sendto(bytes([3, 13, 0xFC, 0xF2, 0, 0, 0, 0]), ("10.64.1.10", 0))
        assert stand.answers(GATEWAY, CENTRE)
        assert not stand.kept_off()
