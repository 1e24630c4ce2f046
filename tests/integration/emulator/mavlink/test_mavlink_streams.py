"""Streams of pymavlink's own sender are judged by our probe; our twin's stream is read by pymavlink's own receiver."""

import asyncio
import socket
import threading
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, closing
from dataclasses import replace
from typing import Any

import pytest
from pymavlink import mavutil
from waiting import wait_until

from atlantis_netcfg.checklist.probes import Listen, Place, ProbeResult
from atlantis_netcfg.checklist.probes.rc_rf import RcExpectation, RcHeard, StickMovementProbe
from atlantis_netcfg.checklist.runner import ask_here
from atlantis_netcfg.emulator.mavlink import AutopilotSpec, RunningAutopilot

Probe = RcHeard | StickMovementProbe
WANTED = RcExpectation("Stork", "this computer", 0, address="127.0.0.1")


def listening(probe: Probe, listen_s: float | None) -> Listen:
    (question,) = probe.asks()
    assert isinstance(question, Listen)
    question = replace(question, address="127.0.0.1")
    return question if listen_s is None else replace(question, listen_s=listen_s)


def judged(probes: Mapping[str, tuple[Probe, float | None]]) -> dict[str, ProbeResult]:
    """Listen at all ports at the same time, by the program that listens on site."""
    questions = [(name, listening(*probe)) for name, probe in probes.items()]
    answers = asyncio.run(ask_here(questions, lambda _key, _answer: None))
    return {
        name: probe.judge({question.name: answers[name]})
        for (name, question), (probe, _) in zip(questions, probes.values(), strict=True)
    }


def codes(found: ProbeResult) -> list[str]:
    return [f"{one.verdict} {one.code}" for one in found.findings]


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


@pytest.fixture
def environment(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of pymavlink, which writes into it as well."""
    monkeypatch.setenv("MAVLINK20", "1")
    monkeypatch.setenv("MAVLINK_DIALECT", "common")


@pytest.fixture
def sender(environment: None) -> Iterator[int]:  # noqa: ARG001
    """An autopilot on pymavlink's own UDP link, which moves its sticks; gives the port to which it sends."""
    port, over = free_port(), threading.Event()
    link = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", source_system=1, source_component=1, dialect="common")

    def send() -> None:
        for turn in range(1, 600):
            link.mav.heartbeat_send(2, 3, 0x51, 0, 3)
            link.mav.sys_status_send(0x10000, 0x10000, 0x10000, 250, 16200, -1, -1, 0, 0, 0, 0, 0, 0)
            axes = [1500 + 100 * ((turn + axis) % 4) for axis in range(4)]
            link.mav.rc_channels_send(50 * turn, 8, *axes, *[1500] * 4, *[65535] * 10, 180)
            if over.wait(0.05):
                return

    running = threading.Thread(target=send)
    running.start()
    with closing(link):
        yield port
        over.set()
        running.join()


def test_pymavlinks_own_stream_is_understood(sender: int) -> None:
    # One port, one listener: these wait for each other.
    wanted = replace(WANTED, port=sender)
    probes: dict[str, tuple[Probe, float | None]] = {
        "heard": (RcHeard(wanted, Place.LAPTOP), None),
        "sticks": (StickMovementProbe(wanted, Place.LAPTOP), 0.6),
    }
    found = judged(probes)
    assert {name: codes(one) for name, one in found.items()} == {"heard": ["PASS rc-heard"], "sticks": ["PASS moved"]}
    assert found["heard"].evidence[0].value.startswith("MAVLink 2, ")


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.usefixtures("environment")
def test_pymavlink_receives_from_the_emulator(version: int) -> None:
    with RunningAutopilot(AutopilotSpec(version=version, rssi=77, is_armed=True, every_s=0.02)) as twin:
        link: Any = mavutil.mavlink_connection(f"udpin:127.0.0.1:{twin.port}", dialect="common")
        with closing(link):
            beat = link.recv_match(type="HEARTBEAT", blocking=True)
            channels = link.recv_match(type="RC_CHANNELS", blocking=True)
            status = link.recv_match(type="SYS_STATUS", blocking=True)
            radio = link.recv_match(type="RADIO_STATUS", blocking=True)
            assert link.mav.total_receive_errors == 0
            assert link.packet_loss() == 0
        assert twin.forbidden == []
    assert (beat.get_srcSystem(), beat.base_mode & 0x80, beat.autopilot) == (1, 0x80, 3)
    assert (channels.chancount, channels.rssi, channels.chan18_raw) == (16, 77, 0xFFFF)
    assert status.onboard_control_sensors_health & 0x10000
    assert radio.get_type() == "RADIO_STATUS"


CASES: dict[str, tuple[AutopilotSpec, str, list[str]]] = {
    "healthy": (AutopilotSpec(), "heard", ["PASS rc-heard"]),
    "MAVLink 1": (AutopilotSpec(version=1), "heard", ["PASS rc-heard"]),
    "cut over datagrams": (AutopilotSpec(split=True), "heard", ["PASS rc-heard"]),
    "armed": (AutopilotSpec(is_armed=True), "heard", ["FAIL armed"]),
    "other system": (AutopilotSpec(system_id=9), "heard", ["FAIL other-system"]),
    "beside others": (AutopilotSpec(ground_station=True, other_system=5), "heard", ["PASS rc-heard"]),
    "no heartbeat": (AutopilotSpec(heartbeat=False), "heard", ["FAIL no-heartbeat"]),
    "no channels in the stream": (AutopilotSpec(channels=None), "heard", ["INCONCLUSIVE no-channels"]),
    "no channel": (AutopilotSpec(channels=0, rssi=255), "heard", ["FAIL no-receiver"]),
    "odd": (AutopilotSpec(odd_us=0), "heard", ["FAIL channels-odd"]),
    "absent": (AutopilotSpec(receiver_present=False), "heard", ["FAIL receiver-absent"]),
    "disabled": (AutopilotSpec(receiver_enabled=False), "heard", ["FAIL receiver-disabled"]),
    "reports the remote-control receiver as unhealthy": (
        AutopilotSpec(receiver_healthy=False),
        "heard",
        ["FAIL receiver-unhealthy"],
    ),
    "no status": (AutopilotSpec(status=False), "heard", ["WARN no-sys-status"]),
    "rssi unknown": (AutopilotSpec(rssi=255), "heard", ["WARN rssi-unknown"]),
    "rssi unsteady": (AutopilotSpec(rssi_swing=120), "heard", ["WARN rssi-unsteady"]),
    "corrupted": (AutopilotSpec(corruption_interval=3), "heard", ["WARN damaged"]),
    "garbage": (AutopilotSpec(garbage=True), "heard", ["FAIL not-mavlink"]),
    "silent": (AutopilotSpec(silent=True), "heard", ["INCONCLUSIVE silent"]),
    "sticks": (AutopilotSpec(), "sticks", ["PASS moved"]),
    "sticks at rest": (AutopilotSpec(moving=0), "sticks", ["FAIL no-movement"]),
    "one stick": (AutopilotSpec(moving=2), "sticks", ["WARN few-moved"]),
    "stream stops": (AutopilotSpec(silent_after=3), "heard", ["FAIL heartbeat-lost"]),
    "channels stop": (AutopilotSpec(channels_stop_after=3), "heard", ["FAIL channels-stale"]),
    "armed meanwhile": (AutopilotSpec(armed_after=8), "sticks", ["FAIL armed"]),
}
SHORT_S = 2.0
"""The sticks go round once."""
STOPS_S = 3.8
"""Longer than the oldest message that passes."""


def test_every_mood_gets_its_verdict() -> None:
    """All of them at once; nothing is sent to any."""
    probes: dict[str, tuple[Probe, float | None]] = {}
    twins = []
    with ExitStack() as stack:
        for name, (spec, step, _) in CASES.items():
            twin = stack.enter_context(RunningAutopilot(spec))
            wanted = replace(WANTED, port=twin.port)
            probe = RcHeard(wanted, Place.LAPTOP) if step == "heard" else StickMovementProbe(wanted, Place.LAPTOP)
            probes[name] = (probe, STOPS_S if name.endswith(("stop", "stops")) else SHORT_S)
            twins.append(twin)
        found = judged(probes)
        assert [twin.forbidden for twin in twins if twin.forbidden] == []
    assert {name: codes(one) for name, one in found.items()} == {name: case[2] for name, case in CASES.items()}


def test_port_used_by_a_ground_station_is_reported_as_in_use() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.bind(("127.0.0.1", 0))
        wanted = replace(WANTED, port=station.getsockname()[1])
        found = judged({"busy": (RcHeard(wanted, Place.LAPTOP), SHORT_S)})["busy"]
    assert codes(found) == ["INCONCLUSIVE in-use"]


def test_packets_sent_to_the_emulator_are_counted() -> None:
    with RunningAutopilot(AutopilotSpec()) as twin, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as somebody:
        somebody.sendto(b"\xfd", twin.source)
        assert wait_until(lambda: twin.forbidden) == [b"\xfd"]
