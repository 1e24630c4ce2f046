"""A rehearsed checklist asks the gateway's real machine: messages reach the control centre as packets, or do not.

The control centre's end of the tunnel stands in the yard: a pair of veth named tun0 in place of the tunnel.
"""

import asyncio
import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from gateway_stand import SHIPPED, Key, Start, ground, machine, technician  # noqa: F401 - fixtures
from waiting import wait_until

from atlantis_netcfg.checklist import plan, probes
from atlantis_netcfg.checklist.rehearsal import check_site
from atlantis_netcfg.checklist.report import Item
from atlantis_netcfg.checklist.runner import ProbeTransport, RealTransport, ask_here, examine
from atlantis_netcfg.checklist.runner.machine_requests import REQUESTS
from atlantis_netcfg.checklist.runner.simulated import rehearsed_ears
from atlantis_netcfg.computers.base import gateway_base
from atlantis_netcfg.computers.reflector import PROGRAM
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.emulator import routeros
from atlantis_netcfg.emulator.lab import Lab, Machine
from atlantis_netcfg.inventory.model import REFLECTOR_PORT
from atlantis_netcfg.operations.common.rehearsal import Rehearsal
from atlantis_netcfg.operations.common.request import Request, Target
from atlantis_netcfg.operations.computers._emulation import RehearsedComputers

pytestmark = [pytest.mark.namespace, pytest.mark.slow]

SITE, NAME, CENTRE = "coastal", "coastal-gateway", "scc-control"
DATA = f"{SITE}/site/data-reaches-scc"
ADDRESS = {NAME: "10.80.0.21", CENTRE: "10.80.0.2", "scc-vpn": "10.80.0.1"}
"""In the VPN, as declared."""
PREFIX = SHIPPED.pilot.vpn.network.prefixlen


def reflector_program() -> str:
    files = gateway_base(SHIPPED, SHIPPED.hosts[NAME]).configuration.files
    return next(file.content for file in files if file.path == PROGRAM)


@pytest.fixture
def stand(ground: Lab, machine: Start) -> Machine:  # noqa: F811 - fixtures
    """The machine in its tunnel, with its reflector; the yard has the addresses of control centre and server."""
    gateway, inside = machine(NAME), f"{ground.name}-m0"
    subprocess.run(
        ["ip", "link", "add", "tun0", "netns", inside, "type", "veth", "peer", "name", "tun0", "netns", ground.name],
        check=True,
    )
    gateway.run(f"ip address add {ADDRESS[NAME]}/{PREFIX} dev tun0 && ip link set tun0 up")
    for host in (CENTRE, "scc-vpn"):
        ground.command(("ip", "address", "add", f"{ADDRESS[host]}/{PREFIX}", "dev", "tun0"))
    ground.command(("ip", "link", "set", "tun0", "up"))
    gateway.put(PROGRAM, reflector_program())
    gateway.run(f"systemd-run --quiet python3 -I {PROGRAM} {NAME} {ADDRESS[NAME]} {REFLECTOR_PORT}")
    return gateway


@contextmanager
def reflector(ground: Lab, folder: Path) -> Iterator[None]:  # noqa: F811 - a fixture's name
    """The control centre's answer to checklists, while the context lasts."""
    (folder / "reflector.py").write_text(reflector_program(), encoding="utf-8")
    words = [sys.executable, "-I", str(folder / "reflector.py"), CENTRE, ADDRESS[CENTRE], str(REFLECTOR_PORT)]
    with subprocess.Popen([*ground.prefix(), *words]) as process:
        try:
            wait_until(lambda: f":{REFLECTOR_PORT} " in ground.command(("ss", "-Huln")).stdout)
            yield
        finally:
            process.kill()


@pytest.fixture
def rehearsed(stand: Machine, technician: Key, tmp_path: Path) -> Iterator[Rehearsal]:  # noqa: F811 - a fixture
    """A rehearsal whose only device is the machine."""
    (tmp_path / "known").write_text(f"{NAME} {stand.host_key}\n")
    target = Target(
        host="127.0.0.1", port=stand.port, known_hosts=str(tmp_path / "known"), identity=str(technician.file)
    )
    with routeros.spawn(routeros.SiteSpec(name=SITE, emulators=()), tmp_path) as emulators:
        computers = RehearsedComputers({NAME: stand}, {NAME: target})
        yield Rehearsal({NAME: target}, ("the rehearsal's own limit",), emulators, computers=computers)


@pytest.fixture
def real_site(stand: Machine, technician: Key, tmp_path: Path) -> RealTransport:  # noqa: F811 - a fixture
    """The same machine as the gateway of a real site."""
    known = tmp_path / "known"
    known.write_text(f"{NAME} {stand.host_key}\n")
    config = tmp_path / "config"
    config.write_text(
        f"Host {NAME}\n HostName 127.0.0.1\n Port {stand.port}\n User root\n IdentityFile {technician.file}\n"
        f" IdentitiesOnly yes\n UserKnownHostsFile {known}\n"
    )
    return RealTransport(SHIPPED, SITE, Request(state=tmp_path / "state"), ssh_config=str(config))


def data_item(ears: ProbeTransport) -> Item:
    entries = [entry for entry in plan(SHIPPED, SITE).entries if entry.item.id == DATA]
    (item,) = asyncio.run(examine(entries, ears, lambda _: None))
    return item


def test_data_reach_the_control_centre_only_as_packets(
    rehearsed: Rehearsal,
    real_site: RealTransport,
    ground: Lab,  # noqa: F811 - a fixture
    tmp_path: Path,
) -> None:
    with rehearsed_ears(SHIPPED, SITE, rehearsed) as ears:
        with reflector(ground, tmp_path):
            item = data_item(ears)
            assert item.verdict is Verdict.PASS, item.message
            assert "scc-control responded to 3 of 3 messages" in item.message
            assert "emulated" not in item.message
            ways = [line.value.partition(", ")[2] for line in item.evidence if "there from" in line.value]
            assert ways == [f"there from {ADDRESS[NAME]} by tun0, back by tun0"] * 3
        stopped = data_item(ears)
        assert stopped.verdict is Verdict.FAIL
        assert stopped.message == "scc-control is reachable, but nothing there responds to messages"
        assert stopped.message == data_item(real_site).message
        ground.command(("ip", "address", "delete", f"{ADDRESS[CENTRE]}/{PREFIX}", "dev", "tun0"))
        silent = data_item(ears)
        assert silent.verdict is Verdict.FAIL
        assert silent.message.startswith("scc-control responded to none of 3 messages through the VPN")
        assert (silent.message, silent.hint) == ((real := data_item(real_site)).message, real.hint)


@pytest.mark.usefixtures("stand")
def test_the_gateway_itself_answers_the_control_centre(ground: Lab) -> None:  # noqa: F811 - a fixture
    request = probes.ReflectRequest("data", probes.Place.GATEWAY, ADDRESS[CENTRE], ADDRESS[NAME], REFLECTOR_PORT)
    answers = asyncio.run(ask_here([("data", request)], lambda *_: None, ground.prefix()))
    replies = answers["data"]
    assert isinstance(replies, probes.ReflectResult)
    assert {(one.sender, json.loads(one.data)["host"]) for one in replies.answers} == {(ADDRESS[NAME], NAME)}
    assert len(replies.answers) == 3


def test_the_whole_checklist_over_a_machine_fails_nothing_that_it_lacks(
    rehearsed: Rehearsal,
    ground: Lab,  # noqa: F811 - a fixture
    tmp_path: Path,
) -> None:
    """Routers are not part of this rehearsal: what they would report stays unknown."""
    told: list[str] = []
    with reflector(ground, tmp_path):
        outcome = check_site(SHIPPED, SITE, rehearsed, lambda event: told.append(event.device))
    items = {item.id: item for item in outcome.items}
    assert sorted(told) == sorted(items)
    assert [(item.id, item.message) for item in outcome.problems if item.verdict is not Verdict.INCONCLUSIVE] == []
    assert items[DATA].verdict is Verdict.PASS
    assert items[f"{SITE}/site/rogue-router"].verdict is Verdict.PASS
    assert {DATA, f"{SITE}/site/vpn", f"{SITE}/site/rogue-router"} <= set(outcome.by_machine)
    pings = next(line for line in items[f"{SITE}/site/vpn"].evidence if line.what.startswith("pings of"))
    assert pings.value.startswith("5 packets transmitted, 5 received")
    assert "the rehearsal's own limit" in outcome.not_rehearsed
    assert {limit for _, limit in REQUESTS if limit} <= set(outcome.not_rehearsed)
    assert outcome.person_items > 0
