"""The twin of a computer beside the programs themselves, which run in a network namespace of their own."""

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from waiting import HANG_S

from atlantis_netcfg.checklist.probes import CommandResult
from atlantis_netcfg.checklist.probes.site_checks.parse import addresses, neighbours
from atlantis_netcfg.emulator.linux import (
    AddressSpec,
    CertificateSpec,
    Computer,
    ComputerSpec,
    EchoSpec,
    InterfaceSpec,
    NeighbourSpec,
    RouteSpec,
    UdpSpec,
)
from atlantis_netcfg.emulator.routeros.certificates import issue

pytestmark = pytest.mark.namespace

SPEC = ComputerSpec(
    interfaces=(
        InterfaceSpec(
            name="eth0",
            mac="02:00:5E:00:01:10",
            addresses=(AddressSpec(address="10.64.1.10/24"), AddressSpec(address="10.64.1.11/24", lease_s=3000)),
        ),
    ),
    routes=(
        RouteSpec(via="10.64.1.1", dev="eth0"),
        RouteSpec(to="192.0.2.0/24", via="10.64.1.1", dev="eth0", metric=600),
    ),
    neighbours=(NeighbourSpec(address="10.64.1.1", dev="eth0", mac="02:00:5E:10:01:01", state="PERMANENT"),),
    echoes={"10.64.1.10": EchoSpec(rtt_ms=0.05)},
    udp=(UdpSpec(port=7410, address="10.64.1.10", uid=0),),
)
COMMANDS = (
    "ip -j addr show",
    "ip -j addr show dev eth0",
    "ip -j -s link show dev eth0",
    "ip -j route show",
    "ip -j route show default",
    "ip -j route show dev eth0",
    "ip -j neigh show",
    "ip -j neigh show dev eth0",
    "ip -j neigh show to 10.64.1.1",
    "ip -j route get 192.0.2.7",
    "ip -j route get 10.64.1.1",
    "ip -j rule",
    "ip -j addr show dev nope",
    "ip -j route show dev nope",
    "ip -j neigh show dev nope",
    "ping -n -c 2 -i 0.2 -W 1 10.64.1.10",
    "ping -n -c 1 -i 0.2 -W 1 10.64.1.99",
    "ping -n -c 1 -i 0.2 -W 1 -I eth0 10.64.1.99",
    "ping -n -c 1 -W 1 -I nope 10.64.1.99",
    "cat /proc/net/udp",
    "cat /nope",
)
Printed = tuple[int, str, str]
_OF_THE_CARD = ("ifindex", "link", "qdisc", "txqlen")
"""What depends on the kind of card: the real one is one end of a cable inside the kernel."""


@pytest.fixture(scope="module")
def real() -> Mapping[str, Printed]:
    program = Path(__file__).with_name("asked_programs.py")
    asked = json.dumps([command.split() for command in COMMANDS])
    become = () if os.geteuid() == 0 else ("--user", "--map-root-user")
    words = ["unshare", *become, "--net", sys.executable, str(program)]
    done = subprocess.run(words, input=asked, capture_output=True, text=True, timeout=HANG_S, check=True)
    return dict(zip(COMMANDS, (tuple(one) for one in json.loads(done.stdout)), strict=True))


def twin(command: str) -> Printed:
    return Computer(SPEC).answer(command.split())


@pytest.mark.parametrize("command", COMMANDS)
def test_emulator_output_equals_that_of_the_program(command: str, real: Mapping[str, Printed]) -> None:
    emulated = twin(command)
    assert emulated[0] == real[command][0]
    assert emulated[2] == real[command][2]
    compare = _rows if command.startswith("ip") else _shape
    assert compare(emulated[1]) == compare(real[command][1])


def _rows(out: str) -> list[tuple[tuple[str, Any], ...]] | str:
    """Rows with their keys in order; the other end of the cable, IPv6 and figures of the card left out."""
    if not out:
        return out
    rows = [row for row in json.loads(out) if row and row.get("ifname") != "far"]
    return [tuple((key, _value(key, row[key])) for key in row if key not in _OF_THE_CARD) for row in rows]


def _value(key: str, value: Any) -> Any:  # noqa: ANN401 - JSON
    if key == "addr_info":
        return [list(one.items()) for one in value if one["family"] == "inet"]
    return {way: list(counts) for way, counts in value.items()} if key == "stats64" else value


def _shape(out: str) -> list[str]:
    """Lines, times and the kernel's own numbers left out."""
    lines = out.splitlines()
    if lines and "local_address" in lines[0]:
        return [lines[0], *(" ".join(line.split()[1:9]) for line in lines[1:])]
    times = re.compile(r"time[= ][\d.]+|= [\d./]+ ms")
    return [times.sub("T", line) for line in lines]


def test_our_parsers_read_both_outputs_alike(real: Mapping[str, Printed]) -> None:
    both = [
        CommandResult(None, "", *told["ip -j addr show"])
        for told in (real, {"ip -j addr show": twin("ip -j addr show")})
    ]
    held = [addresses(one, "it") for one in both]
    assert held[0] == held[1]
    tables = [CommandResult(None, "", *real["ip -j neigh show"]), CommandResult(None, "", *twin("ip -j neigh show"))]
    assert neighbours(tables[0], "it") == neighbours(tables[1], "it")


@pytest.mark.skipif(shutil.which("openssl") is None, reason="no openssl on this computer")
def test_certificates_are_printed_as_openssl_does(tmp_path: Path) -> None:
    since = datetime(2026, 3, 5, 7, 8, 9, tzinfo=UTC)
    pem = issue({"common-name": "coastal-gateway", "key-size": "prime256v1", "days-valid": "10"}, now=since)
    wrap = "-----BEGIN OpenVPN tls-crypt-v2 client key-----\nAAAA\n-----END OpenVPN tls-crypt-v2 client key-----\n"
    path = tmp_path / "identity"
    path.write_text(f"# ours\n<cert>\n{pem}</cert>\n<tls-crypt-v2>\n{wrap}</tls-crypt-v2>\n", encoding="ascii")
    words = ["openssl", "storeutl", "-noout", "-text", "-certs", str(path)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=HANG_S, check=False)
    until = datetime(2026, 3, 15, 7, 8, 9, tzinfo=UTC)
    told = CertificateSpec(subject="coastal-gateway", issuer="coastal-gateway", not_before=since, not_after=until)
    spec = SPEC.model_copy(update={"certificates": {str(path): (told,)}})
    emulated = Computer(spec).answer(words)[1].splitlines()
    wanted = ("0: Certificate", "        Issuer", "            Not ", "        Subject:", "Total found")
    assert [line for line in done.stdout.splitlines() if line.startswith(wanted)] == [
        line for line in emulated if line.startswith(wanted)
    ]
    assert "PRIVATE" not in done.stdout
