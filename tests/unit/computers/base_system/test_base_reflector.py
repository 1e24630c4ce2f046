"""What answers the checklists of other computers: laid down in the VPN alone, and a program that says what came."""

import json
import socket
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from waiting import HANG_S

from atlantis_netcfg.checklist.probes.agent.main import reflect
from atlantis_netcfg.checklist.probes.agent.streams import ProbeError
from atlantis_netcfg.computers.base import gateway_base
from atlantis_netcfg.computers.reflector import (
    PROGRAM,
    QUALIFY_FOLDER,
    QUALIFY_KEY,
    QUALIFY_SECRET,
    QUALIFY_SERVICE,
    SERVICE,
    link_reflector,
    reflector,
)
from atlantis_netcfg.inventory import load
from atlantis_netcfg.inventory.model import REFLECTOR_PORT, ServerComputer

CHECKOUT = Path(__file__).parents[4]
SHIPPED = load(CHECKOUT / "inventory")
COMPUTERS = {"coastal-gateway": "10.80.0.21", "te4sea-gateway": "10.80.0.22", "scc-control": "10.80.0.2"}
UNIT = f"/etc/systemd/system/{SERVICE}"
HERE = "127.0.0.1"


@pytest.mark.parametrize("name", COMPUTERS)
def test_reflector_is_bound_to_the_vpn_address_and_open_to_our_computers(name: str) -> None:
    configuration = gateway_base(SHIPPED, SHIPPED.hosts[name]).configuration
    files = {file.path: file.content for file in configuration.files}
    assert f"ExecStart=/usr/bin/python3 -I {PROGRAM} {name} {COMPUTERS[name]} {REFLECTOR_PORT}\n" in files[UNIT]
    rules = [line.strip() for line in files["/etc/nftables.conf"].splitlines() if str(REFLECTOR_PORT) in line]
    pool = SHIPPED.pilot.vpn.infrastructure
    assert rules == [f'ip saddr {{ {pool} }} udp dport {REFLECTOR_PORT} accept comment "checklists of other sites"']
    assert [(unit.enabled, unit.active) for unit in configuration.units if unit.name == SERVICE] == [(True, True)]
    assert [check.finding for check in configuration.checks if SERVICE in check.run] == [
        f"nothing responds to checklists of other sites at UDP port {REFLECTOR_PORT}"
    ]


def test_reflector_is_removed_outside_the_vpn() -> None:
    box = SHIPPED.hosts["scc-control"]
    assert isinstance(box.device, ServerComputer)
    outside = replace(box, device=box.device.model_copy(update={"vpn_address": None}))
    found = reflector(outside)
    assert found.absent == (UNIT, PROGRAM)
    assert (found.files, found.units, found.checks) == ((), (), ())
    declaration = replace(SHIPPED, hosts={**SHIPPED.hosts, "scc-control": outside})
    rules = [file.content for file in gateway_base(declaration, outside).configuration.files if "nft" in file.path]
    assert str(REFLECTOR_PORT) not in "".join(rules)


def test_the_far_end_at_the_control_centre_is_open_to_every_site() -> None:
    base = gateway_base(SHIPPED, SHIPPED.hosts["scc-control"])
    files = {file.path: file for file in base.configuration.files}
    rules = [line.strip() for line in files["/etc/nftables.conf"].content.splitlines() if "dport 862" in line]
    assert rules == ['ip saddr { 0.0.0.0/0 } udp dport 862 accept comment "measurements"']
    unit = files[f"/etc/systemd/system/{QUALIFY_SERVICE}"].content.splitlines()
    assert f"WorkingDirectory={QUALIFY_FOLDER}" in unit
    assert f"StandardInput=file:{QUALIFY_KEY}" in unit
    assert (
        "ExecStart=/usr/bin/python3 -s -B -m reflector --name scc-control --port 862 --idle-s 900 --key-file -" in unit
    )
    assert "Restart=on-failure" in unit
    assert {"DynamicUser=yes", "AmbientCapabilities=CAP_NET_BIND_SERVICE", "ProtectSystem=strict"} <= set(unit)
    assert (files[QUALIFY_KEY].content, files[QUALIFY_KEY].mode) == (f"{QUALIFY_SECRET}\n", "0600")
    assert base.qualify_secret == QUALIFY_SECRET
    assert "EXAMPLE-key-of-the-far-end" not in json.dumps(base.as_dict())
    (row,) = [row for row in base.configuration.units if row.name == QUALIFY_SERVICE]
    assert (row.enabled, row.active) == (False, None), "a measurement starts it"
    assert QUALIFY_KEY in row.after, "a new key is read by a new start"


def test_a_high_port_needs_no_capability() -> None:
    assert SHIPPED.pilot.qualify is not None
    qualify = SHIPPED.pilot.qualify.model_copy(update={"port": 8862})
    high = link_reflector("scc-control", SHIPPED.pilot.model_copy(update={"qualify": qualify}))
    (unit,) = [file.content for file in high.files if file.path.endswith(QUALIFY_SERVICE)]
    assert "CapabilityBoundingSet=\n" in unit
    assert "CAP_NET_BIND_SERVICE" not in unit


@pytest.mark.parametrize("name", COMPUTERS)
def test_far_end_is_removed_elsewhere(name: str) -> None:
    pilot = SHIPPED.pilot if name != "scc-control" else SHIPPED.pilot.model_copy(update={"qualify": None})
    base = gateway_base(replace(SHIPPED, pilot=pilot), SHIPPED.hosts[name])
    assert {f"/etc/systemd/system/{QUALIFY_SERVICE}", QUALIFY_KEY} <= {*base.configuration.absent}
    assert QUALIFY_FOLDER in base.configuration.only
    assert base.qualify_secret is None
    assert not [file for file in base.configuration.files if "dport 862" in file.content or "qualify" in file.path]


def test_far_end_program_starts_and_reads_its_key_from_stdin(tmp_path: Path) -> None:
    """As the unit starts it, but for systemd."""
    for file in link_reflector("scc-control", SHIPPED.pilot).files:
        if file.path.startswith(f"{QUALIFY_FOLDER}/"):
            path = tmp_path / file.path.removeprefix(f"{QUALIFY_FOLDER}/")
            path.parent.mkdir(exist_ok=True)
            path.write_text(file.content)
    command = [sys.executable, "-s", "-B", "-m", "reflector", "--port", "0", "--key-file", "-", "--address", HERE]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, cwd=tmp_path, text=True, stdin=pipe, stdout=pipe) as program:
        assert program.stdin is not None
        assert program.stdout is not None
        program.stdin.write("a key of 16 octets, and more\n")
        program.stdin.close()
        assert program.stdout.readline().startswith("ready on port ")
        program.terminate()
    assert program.returncode == 0


@pytest.fixture
def port() -> Iterator[int]:
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


def test_tokens_come_back_with_the_path_they_took(port: int) -> None:
    found = reflect(asked(port))
    rows = [json.loads(data) for *_, data in found["answers"]]
    assert [row["token"] for row in rows] == found["tokens"]
    assert len(set(found["tokens"])) == 3
    assert {(row["host"], row["from"], row["to"], row["by"]) for row in rows} == {("scc-control", HERE, HERE, "lo")}
    assert {(sender, interface) for sender, interface, *_ in found["answers"]} == {(HERE, "lo")}
    assert all(0 < delay < 5 for _, _, delay, _ in found["answers"])


def test_only_valid_messages_are_answered_without_amplification(port: int) -> None:
    token = b"0" * 32
    good = (b"atlantis-reflect " + token).ljust(224)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as here:
        here.settimeout(HANG_S)
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


def test_closed_port_is_reported_as_refused() -> None:
    with pytest.raises(ProbeError) as refused:
        reflect(asked(9))
    assert refused.value.trouble == "refused"


def test_missing_source_address_is_reported_as_unreachable() -> None:
    with pytest.raises(ProbeError) as unreachable:
        reflect({**asked(9), "source": "192.0.2.1"})
    assert unreachable.value.trouble == "unreachable"
    assert "192.0.2.1" in unreachable.value.words
