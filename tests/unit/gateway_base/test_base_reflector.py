"""What answers the checklists of other computers: laid down in the VPN alone, and a program that says what came."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from atlantis_netcfg.checklist.probes.agent.main import reflect
from atlantis_netcfg.checklist.probes.agent.streams import ProbeError
from atlantis_netcfg.declaration import load
from atlantis_netcfg.declaration.model import REFLECTOR_PORT, ServerComputer
from atlantis_netcfg.gateway.base import gateway_base
from atlantis_netcfg.gateway.reflector import PROGRAM, SERVICE, reflector

if TYPE_CHECKING:
    from collections.abc import Iterator

CHECKOUT = Path(__file__).parents[3]
SHIPPED = load(CHECKOUT / "inventory")
COMPUTERS = {"coastal-gateway": "10.80.0.21", "te4sea-gateway": "10.80.0.22", "scc-control": "10.80.0.2"}
UNIT = f"/etc/systemd/system/{SERVICE}"
HERE = "127.0.0.1"


@pytest.mark.parametrize("name", COMPUTERS)
def test_it_is_bound_to_the_address_in_the_vpn_and_open_to_our_own_computers(name: str) -> None:
    configuration = gateway_base(SHIPPED, SHIPPED.hosts[name]).configuration
    files = {file.path: file.content for file in configuration.files}
    assert f"ExecStart=/usr/bin/python3 -I {PROGRAM} {name} {COMPUTERS[name]} {REFLECTOR_PORT}\n" in files[UNIT]
    rules = [line.strip() for line in files["/etc/nftables.conf"].splitlines() if str(REFLECTOR_PORT) in line]
    pool = SHIPPED.pilot.vpn.infrastructure
    assert rules == [
        f'ip saddr {{ {pool} }} udp dport {REFLECTOR_PORT} accept comment "checklists of other sites"',
    ]
    assert [(unit.enabled, unit.active) for unit in configuration.units if unit.name == SERVICE] == [(True, True)]
    assert [check.finding for check in configuration.checks if SERVICE in check.run] == [
        f"nothing answers the checklists of other sites at UDP port {REFLECTOR_PORT}"
    ]


def test_of_a_computer_outside_the_vpn_it_is_taken_away() -> None:
    box = SHIPPED.hosts["scc-control"]
    assert isinstance(box.device, ServerComputer)
    outside = replace(box, device=box.device.model_copy(update={"vpn_address": None}))
    found = reflector(outside)
    assert found.absent == (UNIT, PROGRAM)
    assert (found.files, found.units, found.checks) == ((), (), ())
    declaration = replace(SHIPPED, hosts={**SHIPPED.hosts, "scc-control": outside})
    rules = [file.content for file in gateway_base(declaration, outside).configuration.files if "nft" in file.path]
    assert str(REFLECTOR_PORT) not in "".join(rules)


@pytest.fixture
def port() -> Iterator[int]:
    """Of the program, which runs here."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind((HERE, 0))
        number: int = free.getsockname()[1]
    command = [sys.executable, "-I", str(CHECKOUT / "templates/gateway/reflector.py"), "scc-control", HERE, str(number)]
    with subprocess.Popen(command) as program:
        try:
            while f":{number:04X} " not in Path("/proc/net/udp").read_text(encoding="ascii"):
                assert program.poll() is None
            yield number
        finally:
            program.kill()


def asked(port: int, count: int = 3) -> dict[str, object]:
    return {"source": HERE, "address": HERE, "port": port, "count": count, "within_s": 5.0}


def test_the_very_tokens_come_back_with_the_way_by_which_they_came(port: int) -> None:
    found = reflect(asked(port))
    rows = [json.loads(data) for *_, data in found["answers"]]
    assert [row["token"] for row in rows] == found["tokens"]
    assert len(set(found["tokens"])) == 3
    assert {(row["host"], row["from"], row["to"], row["by"]) for row in rows} == {("scc-control", HERE, HERE, "lo")}
    assert {(sender, interface) for sender, interface, *_ in found["answers"]} == {(HERE, "lo")}
    assert all(0 < delay < 5 for _, _, delay, _ in found["answers"])


def test_nothing_else_is_answered_and_no_answer_is_longer_than_its_message(port: int) -> None:
    token = b"0" * 32
    good = (b"atlantis-reflect " + token).ljust(224)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as here:
        here.settimeout(5)
        for message in (
            b"",
            b"atlantis-reflect " + token,
            b"x" * 224,
            good[:-1] + b"x",
            b"atlantis-reflect " + b"g" * 32,
        ):
            here.sendto(message, (HERE, port))
        here.sendto(good, (HERE, port))
        answer = here.recv(4096)
    assert json.loads(answer)["token"] == token.decode(), "the first that is answered"
    assert len(answer) <= len(good)


def test_that_nobody_listens_is_told_as_a_refusal() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind((HERE, 0))
        number = free.getsockname()[1]
    with pytest.raises(ProbeError) as refused:
        reflect(asked(number))
    assert refused.value.trouble == "refused"


def test_without_its_own_address_nothing_is_sent() -> None:
    with pytest.raises(ProbeError) as unreachable:
        reflect({**asked(9), "source": "192.0.2.1"})
    assert unreachable.value.trouble == "unreachable"
    assert "192.0.2.1" in unreachable.value.words
