"""What the stations of the gateway's own access point reach: the real firewall, and packets between namespaces.

The radio is a veth: that stations are kept apart on the air is hostapd's, and shown in `test_gateway_hwsim.py`.
"""

import os
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import pytest

from atlantis_netcfg.computers.base import gateway_base
from atlantis_netcfg.inventory import load
from atlantis_netcfg.inventory.model import Gateway, GatewayAccessPoint

pytestmark = [
    pytest.mark.slow,
    pytest.mark.namespace,
    pytest.mark.skipif(os.geteuid() != 0, reason="making a network namespace needs root"),
]

DECLARATION = load(Path(__file__).parents[4] / "inventory")
STATION, OTHER, GATEWAY, FAR = (f"w{name}{os.getpid()}" for name in ("st", "ot", "gw", "far"))
SERVER, SECOND, ROUTER = "203.0.113.2", "203.0.113.9", "10.64.1.1"
_ANSWER = """\
import socket, sys
answering = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
answering.bind((sys.argv[1], int(sys.argv[2])))
print("ready", flush=True)
while True:
    text, sender = answering.recvfrom(99)
    answering.sendto(sender[0].encode(), sender)
"""
_ASK = """\
import socket, sys
asking = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
asking.settimeout(float(sys.argv[3]))
asking.sendto(b"who am I?", (sys.argv[1], int(sys.argv[2])))
try:
    print(asking.recvfrom(99)[0].decode())
except OSError:
    pass
"""


def ruleset(*, vpn: bool) -> str:
    """What the shipped coastal gateway gets with an access point of its own."""
    host = DECLARATION.hosts["coastal-gateway"]
    assert isinstance(host.device, Gateway)
    radio = GatewayAccessPoint.model_validate(
        {
            "interface": "wlan3",
            "ssid": "EXAMPLE-GATEWAY",
            "standard": "802.11ac",
            "band": "5ghz",
            "frequency_mhz": 5500,
            "country": "portugal",
            "key": "EXAMPLE-gateway-key",
            "network": "10.71.1.0/24",
            "address": "10.71.1.1",
            "vpn": vpn,
        }
    )
    changed = replace(host, device=host.device.model_copy(update={"access_point": radio}))
    base = gateway_base(DECLARATION, changed)
    return next(file.content for file in base.configuration.files if file.path == "/etc/nftables.conf")


def _run(*words: str, text: str | None = None) -> str:
    return subprocess.run(words, check=True, capture_output=True, text=True, input=text).stdout


def _cable(near: str, name: str, far: str, other: str) -> None:
    _run("ip", "-n", near, "link", "add", name, "type", "veth", "peer", "name", other, "netns", far)
    for where, what in ((near, name), (far, other)):
        _run("ip", "-n", where, "link", "set", what, "up")


@pytest.fixture(scope="module")
def air() -> Iterator[None]:
    """Two stations, the gateway that forwards, and behind it the router with the VPN's server."""
    with ExitStack() as stack:
        for name in (STATION, OTHER, GATEWAY, FAR):
            _run("ip", "netns", "add", name)
            stack.callback(_run, "ip", "netns", "delete", name)
            _run("ip", "-n", name, "link", "set", "lo", "up")
        _run("ip", "-n", GATEWAY, "link", "add", "wlan3", "type", "bridge")
        _run("ip", "-n", GATEWAY, "link", "set", "wlan3", "up")
        for number, station in enumerate((STATION, OTHER), start=50):
            _cable(station, "eth0", GATEWAY, f"port{number}")
            _run("ip", "-n", GATEWAY, "link", "set", f"port{number}", "master", "wlan3")
            # On the air stations are apart (ap_isolate): here each port of the bridge is.
            _run("ip", "netns", "exec", GATEWAY, "bridge", "link", "set", "dev", f"port{number}", "isolated", "on")
            _run("ip", "-n", station, "address", "add", f"10.71.1.{number}/24", "dev", "eth0")
            _run("ip", "-n", station, "route", "add", "default", "via", "10.71.1.1")
        _cable(GATEWAY, "eth0", FAR, "eth0")
        _run("ip", "-n", GATEWAY, "address", "add", "10.71.1.1/24", "dev", "wlan3")
        _run("ip", "-n", GATEWAY, "address", "add", "10.64.1.10/24", "dev", "eth0")
        _run("ip", "-n", GATEWAY, "route", "add", "default", "via", ROUTER)
        _run("ip", "-n", FAR, "address", "add", f"{ROUTER}/24", "dev", "eth0")
        for address in (SERVER, SECOND):
            _run("ip", "-n", FAR, "address", "add", f"{address}/32", "dev", "lo")
        _run("ip", "netns", "exec", GATEWAY, "sh", "-c", "echo 1 > /proc/sys/net/ipv4/ip_forward")
        answering = ((FAR, SERVER, 1194), (FAR, SERVER, 1195), (FAR, SECOND, 1194), (FAR, ROUTER, 53))
        for where, address, port in (*answering, (OTHER, "10.71.1.51", 9000)):
            stack.callback(_end, _answer(where, address, port))
        yield


def _answer(where: str, address: str, port: int) -> subprocess.Popen[str]:
    words = ("ip", "netns", "exec", where, "python3", "-c", _ANSWER, address, str(port))
    process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    process.stdout.close()
    return process


def _end(process: subprocess.Popen[str]) -> None:
    process.kill()
    process.wait()


def _asked(address: str, port: int, within_s: float = 1.0, who: str = STATION) -> str:
    """Who has answered sees the station as this address; empty: nobody."""
    return _run("ip", "netns", "exec", who, "python3", "-c", _ASK, address, str(port), str(within_s)).strip()


def _load(*, vpn: bool) -> None:
    _run("ip", "netns", "exec", GATEWAY, "nft", "-f", "-", text=ruleset(vpn=vpn))


@pytest.mark.usefixtures("air")
def test_stations_reach_only_the_vpn_server_through_the_gateway() -> None:
    _load(vpn=True)
    _load(vpn=True)
    assert _asked(SERVER, 1194, 10.0) == "10.64.1.10", "the router knows the gateway alone"
    refused = ((SERVER, 1195), (SECOND, 1194), (ROUTER, 53), ("10.71.1.51", 9000))
    assert {target: _asked(*target) for target in refused} == dict.fromkeys(refused, "")


@pytest.mark.usefixtures("air")
def test_the_gateway_that_forwards_is_no_router_for_the_lan() -> None:
    _load(vpn=True)
    _run("ip", "-n", FAR, "route", "replace", "10.71.1.0/24", "via", "10.64.1.10")
    assert _asked("10.71.1.51", 9000, who=FAR) == ""


@pytest.mark.usefixtures("air")
def test_without_vpn_forwarding_stations_reach_nothing() -> None:
    _load(vpn=True)
    assert _asked(SERVER, 1194, 10.0)
    _load(vpn=False)
    assert _asked(SERVER, 1194) == ""
    assert "masquerade" not in _run("ip", "netns", "exec", GATEWAY, "nft", "list", "ruleset")
