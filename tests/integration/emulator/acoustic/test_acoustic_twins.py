"""The emulated modems on their sockets: asked by a client of its own, and by our probes through the real ear."""

import asyncio
import struct
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from second_client import AtClient, BeaconClient, Wire

from atlantis_netcfg.checklist import Scope, plan
from atlantis_netcfg.checklist.probes import Answer, Cell, Listen, Place, Probe, ProbeResult, acoustic, usbl
from atlantis_netcfg.checklist.runner import OnAnswer, ask_here, examine
from atlantis_netcfg.checklist.runner.results import Questions
from atlantis_netcfg.emulator.acoustic import EvologicsSpec, RunningEvologics, RunningSeatrac, SeatracSpec
from atlantis_netcfg.inventory import Inventory
from atlantis_netcfg.inventory.loader import load

Twin = RunningEvologics | RunningSeatrac
ROOT = Path(__file__).parents[4]


def test_a_modem_answers_another_client() -> None:
    spec = EvologicsSpec(local_address=7, before=(b"raw\r\n", b"+++AT:5:\r\n+++\r\n"), fix_every_s=0.01, hears=(3,))
    with RunningEvologics(spec) as twin, AtClient(twin.host, twin.port) as client:
        assert client.ask("AT?S") == b"INITIATION LISTEN 16384"
        assert client.ask("AT?AL") == b"7"
        listing = dict(line.split(": ") for line in client.ask("AT&V").decode().splitlines())
        assert (listing["Local Address"], listing["Source Level"], listing["IM Rerty Count"]) == ("7", "3", "1")
        assert client.ask("AT?P").count(b"\n") == 8
        fix = client.wait("USBLLONG")
        assert (len(fix), fix[3]) == (17, "3")
        assert float(fix[13]) * 1e-6 * 1500 == pytest.approx(14.065, abs=0.01)
        assert twin.forbidden == []


def test_modem_counts_forbidden_commands() -> None:
    with RunningEvologics(EvologicsSpec(hears=())) as twin, AtClient(twin.host, twin.port) as client:
        for command in ("AT!L0", "AT@CTRL", "AT&W", "ATZ0", "ATC", "AT*SEND,5,2,hello"):
            client.send(f"+++{command}\n".encode())
            assert client.frame() == ("AT", b"ERROR WRONG COMMAND")
        client.send(b"+++\n")
        assert client.frame() == ("AT", b"ERROR WRONG COMMAND")
        client.send(b"AT?S\n")
        assert client.frame() == ("AT", b"ERROR WRONG COMMAND"), "without +++ it is data, and would be transmitted"
        assert len(twin.forbidden) == 8
        assert not twin.transmitted


@pytest.mark.parametrize("in_water", [True, False])
def test_message_sent_in_air_is_counted(in_water: bool) -> None:  # noqa: FBT001 - a case
    text = "a\n\x00+"
    with RunningEvologics(EvologicsSpec(in_water=in_water, hears=())) as twin, AtClient(twin.host, twin.port) as client:
        assert client.ask(f"AT*SENDIM,{len(text)},2,ack,{text}") == b"OK"
        assert client.wait("DELIVEREDIM") == ["DELIVEREDIM", "2"]
        assert client.ask(f"AT*SENDIM,{len(text)},9,ack,{text}") == b"OK"
        assert client.wait("FAILEDIM") == ["FAILEDIM", "9"]
        assert twin.transmitted == [(2, text.encode()), (9, text.encode())]
        assert twin.transmitted_in_air == ([] if in_water else twin.transmitted)


def test_modem_accepts_one_client_by_default() -> None:
    with RunningEvologics(EvologicsSpec()) as twin, AtClient(twin.host, twin.port) as first:
        assert first.ask("AT?AL") == b"1"
        with Wire(twin.host, twin.port) as second:
            assert second.byte() == b""
        assert first.ask("AT?AL") == b"1"


def test_modem_can_accept_several_clients() -> None:
    with RunningEvologics(EvologicsSpec(seats=None)) as twin, AtClient(twin.host, twin.port) as first:
        with AtClient(twin.host, twin.port) as second:
            assert second.ask("AT?AL") == b"1"
        assert first.ask("AT?AL") == b"1"


def test_a_beacon_answers_another_client() -> None:
    with RunningSeatrac(SeatracSpec(beacon=5, in_water=True)) as twin, BeaconClient(twin.host, twin.port) as client:
        client.order(0x01)
        assert client.wait(0x01) == struct.pack("<I", 123456)
        client.order(0x15)
        assert client.wait(0x15)[96] == 5
        client.order(0x3A)
        assert client.wait(0x3A) == b"\x3b"
        client.order(0x40, bytes([2, 4]))
        assert client.wait(0x40) == bytes([0, 2])
        assert client.wait(0x42)[1] == 2
        client.order(0x40, bytes([3, 4]))
        assert client.wait(0x43) == bytes([0x34, 3])
        assert (twin.forbidden, twin.damaged, twin.transmitted, twin.transmitted_in_air) == ([], [], [2, 3], [])


def test_beacon_counts_forbidden_commands() -> None:
    with RunningSeatrac(SeatracSpec(hears=())) as twin, BeaconClient(twin.host, twin.port) as client:
        for number in (0x03, 0x0D, 0x12, 0x16, 0x18, 0x19, 0x20, 0x22, 0x48, 0x60):
            client.order(number)
        client.order(0x15, spoilt=1)
        client.order(0x40, bytes([2, 4]))
        assert client.wait(0x40) == bytes([0, 2])
        assert (len(twin.forbidden), len(twin.damaged), twin.transmitted_in_air) == (10, 1, [2])


@pytest.mark.parametrize(("busy", "expected"), [(True, 0x30), (False, 0x00)])
def test_busy_beacon_sends_no_ping(busy: bool, expected: int) -> None:  # noqa: FBT001 - a case
    spec = SeatracSpec(busy=busy, hears=(), in_water=True)
    with RunningSeatrac(spec) as twin, BeaconClient(twin.host, twin.port) as client:
        client.order(0x40, bytes([2, 4]))
        assert client.wait(0x40) == bytes([expected, 2])
        assert len(twin.transmitted) == (expected == 0)


def _probe(declaration: Inventory, row: str, column: str, step: str) -> Probe:
    steps_of = acoustic.steps if column == "acoustic" else usbl.steps
    steps = steps_of(Cell(declaration, "coastal", row, column))
    probe = next(one.probe for one in steps if one.name == step)
    assert probe is not None
    return probe


def _at(question: Listen, twin: Twin) -> Listen:
    """The same script for a twin; where nothing comes, nobody waits for long."""
    if twin.spec.silent:
        tired = tuple(replace(say, within_s=0.3) for say in question.say)
        question = replace(question, say=tired, listen_s=0.3)
    if twin.path:
        return replace(question, transport="serial", address="", port=0, device=twin.path, baud=115200)
    return replace(question, address=twin.host, port=twin.port)


WATER_1 = EvologicsSpec(in_water=True, fix_every_s=0.02)
WATER_2 = EvologicsSpec(in_water=True, local_address=2, hears=(1,), reaches=(1,), fix_every_s=0.02)
ASKED: dict[str, tuple[tuple[str, str, str], tuple[Twin, ...], list[str]]] = {
    "well": (("girona500", "acoustic", ""), (RunningEvologics(WATER_1),), ["listens"]),
    "byte by byte": (
        ("girona500", "acoustic", ""),
        (RunningEvologics(WATER_1.model_copy(update={"piecewise": True, "byte_s": 0.0001})),),
        ["listens"],
    ),
    "fleet": (
        ("girona500", "acoustic", "fleet"),
        (RunningEvologics(WATER_1), RunningEvologics(WATER_2.model_copy(update={"packet_time_ms": 500}))),
        ["packet-time-differs"],
    ),
    "fixes": (("girona500", "usbl", ""), (RunningEvologics(WATER_1),), ["heard"]),
    "message": (("girona500", "acoustic", "message"), (RunningEvologics(WATER_1),), ["delivered"]),
    "too loud": (
        ("girona500", "acoustic", "message"),
        (RunningEvologics(WATER_1.model_copy(update={"source_level": 0})),),
        ["too-loud"],
    ),
    "refused": (("girona500", "acoustic", ""), (RunningEvologics(EvologicsSpec(refuses=True)),), ["in-use"]),
    "held": (("girona500", "acoustic", ""), (RunningEvologics(EvologicsSpec(is_occupied=True)),), ["in-use"]),
    "silent": (("girona500", "acoustic", ""), (RunningEvologics(EvologicsSpec(silent=True)),), ["in-use"]),
    "beacon": (("zarco", "acoustic", ""), (RunningSeatrac(SeatracSpec()),), ["listens"]),
    "beacon on a serial port": (("zarco", "acoustic", ""), (RunningSeatrac(SeatracSpec(serial=True)),), ["listens"]),
    "ping": (("zarco", "usbl", "ping"), (RunningSeatrac(SeatracSpec(in_water=True)),), ["answered"]),
}


def test_probes_judge_the_emulators_over_real_connections() -> None:
    declaration = load(ROOT / "inventory")
    probes = {name: _probe(declaration, *which) for name, (which, _, _) in ASKED.items()}
    with ExitStack() as running:
        questions = {}
        for name, (_, twins, _) in ASKED.items():
            for question, twin in zip(probes[name].asks(), twins, strict=True):
                assert isinstance(question, Listen)
                running.enter_context(twin)
                questions[f"{name}#{question.name}"] = _at(question, twin)
        answers = asyncio.run(ask_here(list(questions.items()), lambda *_: None))
        found = {name: _codes(name, probes[name], answers) for name in ASKED}
    assert found == {name: codes for name, (_, _, codes) in ASKED.items()}
    for _, twins, _ in ASKED.values():
        for twin in twins:
            assert (twin.forbidden, list(twin.transmitted_in_air)) == ([], [])


def _codes(name: str, probe: Probe, answers: object) -> list[str]:
    assert isinstance(answers, dict)
    judged: ProbeResult = probe.judge({one.name: answers[f"{name}#{one.name}"] for one in probe.asks()})
    return [finding.code for finding in judged.findings]


@dataclass(frozen=True)
class Ears:
    """The real program, led to twins."""

    twins: dict[str, Twin]

    async def ask(self, place: Place, host: str | None, questions: Questions, heard: OnAnswer) -> Mapping[str, Answer]:
        assert (place, host) == (Place.GATEWAY, None)
        led = []
        for key, question in questions:
            assert isinstance(question, Listen)
            led.append((key, _at(question, self.twins[question.address])))
        return await ask_here(led, heard)


def test_single_client_modem_is_shared_by_all_checks(tmp_path: Path) -> None:
    """Both columns, the fleet and what transmits: no twin is ever opened by two at a time, and each is read once."""
    declaration = load(ROOT / "inventory")
    twins: dict[str, Twin] = {
        "10.64.1.21": RunningEvologics(WATER_1),
        "10.64.1.22": RunningEvologics(WATER_2),
        "10.64.1.23": RunningSeatrac(SeatracSpec(in_water=True)),
        "10.64.1.25": RunningSeatrac(SeatracSpec(in_water=True, beacon=2, hears=(1,))),
    }
    scope = Scope(vehicles=("girona500", "sparus", "zarco", "mares"), endpoints=("acoustic", "usbl"))
    entries = plan(declaration, "coastal", scope).entries
    with ExitStack() as running:
        for twin in twins.values():
            running.enter_context(twin)
        items = asyncio.run(examine(entries, Ears(twins), lambda _: None, state=lambda: tmp_path))
    assert {item.id: str(item.verdict) for item in items} == {
        f"{row}/{item}": "PASS"
        for row, its in {
            "girona500": ("acoustic", "acoustic/fleet", "acoustic/message", "usbl"),
            "sparus": ("acoustic", "acoustic/message", "usbl"),
            "zarco": ("acoustic", "acoustic/fleet", "usbl", "usbl/ping"),
            "mares": ("acoustic", "usbl"),
        }.items()
        for item in its
    }
    assert [twin.met for twin in twins.values()] == [2, 2, 2, 1]
    assert [(twin.forbidden, len(twin.transmitted)) for twin in twins.values()] == [([], 1), ([], 1), ([], 1), ([], 0)]


def test_disconnected_client_frees_the_modem() -> None:
    """Also one who leaves in the middle of an answer: nobody is turned away, and the twin goes on."""
    with RunningEvologics(EvologicsSpec(fix_every_s=0.001)) as twin:
        for _ in range(20):
            with AtClient(twin.host, twin.port) as client:
                client.send(b"+++AT?S\n+++AT&V\n+++AT?E\n")
                assert client.byte() == b"+"
        with AtClient(twin.host, twin.port) as client:
            assert client.ask("AT?AL") == b"1"
        assert twin.met == 21
