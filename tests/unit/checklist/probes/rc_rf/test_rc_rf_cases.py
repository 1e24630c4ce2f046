"""Every case lists all that is said; streams are judged as they came, and one byte at a time."""

import re
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as some
from rc_cases import CASES, Case
from rc_said import ARMED, UNUSED, WANTED, Says, bytewise, heard
from row_subtests import for_each_row

from atlantis_netcfg.checklist.probes import Cell, Listen, Place, ProbeResult, Step, Transcript
from atlantis_netcfg.checklist.probes.rc_rf import RcExpectation, RcHeard, StickMovementProbe, steps
from atlantis_netcfg.checklist.report import ItemKind, Phase
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.inventory import Inventory
from atlantis_netcfg.inventory.model import Endpoints

LISTED: dict[str, list[str]] = yaml.safe_load(Path(__file__).with_name("rc_cases.yml").read_text(encoding="utf-8"))


def judged(case: Case, transcript: Transcript) -> ProbeResult:
    wanted = replace(WANTED, **case.wanted)
    if case.step == "heard":
        return RcHeard(wanted, Place.GATEWAY).judge({"stream": transcript})
    return StickMovementProbe(wanted, Place.GATEWAY).judge({"sticks": transcript})


@for_each_row("name", CASES, ids=str)
def test_findings_match_the_case(name: str) -> None:
    case = CASES[name]
    found = judged(case, case.transcript).findings
    assert [f"{one.verdict} {one.code}: {one.message}" for one in found] == LISTED[name]
    assert all(one.hint for one in found if one.verdict is not Verdict.PASS)


@for_each_row("name", CASES, ids=str)
def test_byte_by_byte_arrival_gives_the_same_codes(name: str) -> None:
    case = CASES[name]

    # Between two frames a piece of noise may count as several: the words name how many.
    def codes(transcript: Transcript) -> list[str]:
        return [one.code for one in judged(case, transcript).findings]

    assert codes(bytewise(case.transcript)) == codes(case.transcript)


def test_every_code_has_its_case() -> None:
    assert list(LISTED) == list(CASES)
    codes = {line.split(" ")[1].rstrip(":") for lines in LISTED.values() for line in lines}
    assert codes == {
        *("armed", "channels-odd", "channels-stale", "damaged", "few-channels", "few-moved", "frozen"),
        *("heartbeat-lost", "in-use", "lockstep", "moved", "no-channels", "no-heartbeat", "no-movement"),
        *("no-receiver", "no-sys-status", "not-allowed", "not-heard", "not-live", "not-mavlink"),
        *("of-another-time", "once", "other-component", "other-sender", "other-system", "overridden"),
        *("place-not-reached", "rc-heard", "receiver-absent", "receiver-disabled", "receiver-unhealthy"),
        *("rssi-low", "rssi-unknown", "rssi-unsteady", "rssi-zero", "sender-unknown", "silent"),
    }


def test_evidence_is_listed() -> None:
    transcript = heard([Says().second(1500, 1500, 1000, UNUSED, rssi=190 + second) for second in range(6)])
    found = RcHeard(WANTED, Place.GATEWAY).judge({"stream": transcript})
    assert {one.what: one.value for one in found.evidence} == {
        "stream at UDP port 14550 of coastal-gateway": "MAVLink 2, 24 frames and 0 corrupted pieces in 6 s",
        "system ids with an autopilot": "1",
        "source of its stream": "10.64.1.24",
        "autopilot": "disarmed, 6 heartbeats",
        "channels": "4, 1500 1500 1000 -",
        "rssi": "190 to 195 on its own scale",
        "receiver": "present, enabled, healthy",
    }


def test_telemetry_radio_is_not_mistaken_for_the_remote_control() -> None:
    """RADIO_STATUS has an rssi as well."""
    transcript = heard([[Says().heartbeat(), Says().status(), Says().radio()]] * 6)
    found = RcHeard(WANTED, Place.GATEWAY).judge({"stream": transcript})
    assert "rssi" not in {one.what for one in found.evidence}


def test_range_of_each_moved_channel_is_evidence() -> None:
    case = CASES["sticks moved"]
    assert [one.value for one in judged(case, case.transcript).evidence if one.what == "channel 2"] == [
        "1100 to 1900 us"
    ]


@pytest.mark.parametrize("probe", [RcHeard(WANTED, Place.GATEWAY), StickMovementProbe(WANTED, Place.GATEWAY)])
def test_nothing_is_ever_sent(probe: RcHeard | StickMovementProbe) -> None:
    (question,) = probe.asks()
    assert isinstance(question, Listen)
    assert (question.transport, question.port, question.say, question.address) == ("udp", 14550, (), "")


def ends(*seconds: list[bytes], system: int = 1) -> bool:
    (question,) = RcHeard(replace(WANTED, system_id=system), Place.GATEWAY).asks()
    assert isinstance(question, Listen)
    return bool(re.search(question.enough, heard(seconds).data))


@pytest.mark.parametrize("version", [1, 2])
def test_listening_ends_when_enough_is_received(version: int) -> None:
    says = Says(version=version)
    assert ends(*[says.second()] * 5)
    assert not ends(*[says.second()] * 4)
    assert not ends(*[says.second()] * 5, system=42)
    assert not ends(*[[says.heartbeat(), says.channels()]] * 9)
    # Characters that mean something in a regular expression.
    assert ends(*[Says(ord("*"), version).second()] * 5, system=ord("*"))


def test_sticks_are_observed_until_the_end() -> None:
    (question,) = StickMovementProbe(WANTED, Place.GATEWAY).asks()
    assert isinstance(question, Listen)
    assert not question.enough
    late = heard([*[Says().second()] * 11, Says().second(mode=ARMED)])
    assert StickMovementProbe(WANTED, Place.GATEWAY).judge({"sticks": late}).verdict is Verdict.FAIL


FRAMES = [*Says().second(), *Says(version=1).second(), b"\xfd", b"\xfe", b"\xfd\xff\x01\x00\x00\x01\x01\x41\x00\x00"]


@given(some.lists(some.one_of(some.sampled_from(FRAMES), some.binary(max_size=40)), max_size=12))
def test_no_datagram_makes_the_reader_fail(datagrams: list[bytes]) -> None:
    transcript = heard([datagrams])
    assert RcHeard(WANTED, Place.GATEWAY).judge({"stream": transcript}).findings
    assert StickMovementProbe(WANTED, Place.GATEWAY).judge({"sticks": transcript}).findings


# Which items the column makes of a declaration.


def of(declaration: Inventory, vehicle: str, endpoints: dict[str, object] | None = None) -> tuple[Step, ...]:
    if endpoints is not None:
        one = declaration.vehicles[vehicle].model_copy(update={"endpoints": Endpoints.model_validate(endpoints)})
        declaration = replace(declaration, vehicles={**declaration.vehicles, vehicle: one})
    return steps(Cell(declaration, "coastal", vehicle, "rc_rf"))


def told(made: tuple[Step, ...]) -> list[tuple[str, ItemKind, Phase]]:
    return [(step.name, step.kind, step.phase) for step in made]


def test_stream_is_automatic_and_sticks_need_consent(declaration: Inventory) -> None:
    made = of(declaration, "stork")
    assert told(made) == [
        ("", ItemKind.AUTOMATIC, Phase.BENCH),
        ("sticks", ItemKind.ACTIVE, Phase.BENCH),
        ("failsafe", ItemKind.PERSON, Phase.BENCH),
        ("range", ItemKind.PERSON, Phase.QUAY),
    ]
    wanted = RcExpectation("Stork", "coastal-gateway", 14550, address="10.64.1.24")
    assert [step.probe for step in made[:2]] == [
        RcHeard(wanted, Place.GATEWAY),
        StickMovementProbe(wanted, Place.GATEWAY),
    ]
    assert [step.concerns for step in made] == [("coastal-gateway",), ("coastal-gateway",), (), ()]
    consent = made[1].consent
    assert consent is not None
    assert "the propellers are off Stork, or it is disarmed and secured" in consent.question
    assert consent.prompt.startswith("ask the pilot of Stork to move both sticks")


def test_vehicle_without_a_stream_has_only_steps_for_a_person(declaration: Inventory) -> None:
    made = of(declaration, "stork", {})
    assert told(made) == [
        ("", ItemKind.PERSON, Phase.BENCH),
        ("failsafe", ItemKind.PERSON, Phase.BENCH),
        ("range", ItemKind.PERSON, Phase.QUAY),
    ]
    assert all(step.do and step.look_for for step in made)
    assert "30 m" in made[-1].do


def test_probe_uses_the_declared_values(declaration: Inventory) -> None:
    made = of(declaration, "stork", {"rc_rf": {"port": 14560, "system_id": 7, "rssi_low": 90, "seen_from": "laptop"}})
    wanted = RcExpectation("Stork", "this computer", 14560, 7, 90, "10.64.1.24")
    assert made[0].probe == RcHeard(wanted, Place.LAPTOP)
    assert made[0].concerns == ()
