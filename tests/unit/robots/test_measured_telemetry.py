"""`provision measure fit observed=…`: what was heard becomes `telemetry:`, and nothing else in the file changes."""

import json
import shutil
from collections.abc import Sequence
from dataclasses import replace
from datetime import date
from pathlib import Path
from types import SimpleNamespace

import pytest
import robot_cases
import yaml
from hints_said import advised, said

from atlantis_netcfg.cli import main
from atlantis_netcfg.core.errors import ExitCode, UsageError
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.inventory import load
from atlantis_netcfg.inventory.model import TelemetryTopic
from atlantis_netcfg.inventory.robots import reading
from atlantis_netcfg.inventory.robots.key_names import KeyNames
from atlantis_netcfg.links import LinkFinding
from atlantis_netcfg.operations import robots
from atlantis_netcfg.operations.fit import measured_telemetry
from atlantis_netcfg.operations.fit.measured_telemetry import (
    TelemetryUnknown,
    change,
    telemetry_of,
    with_telemetry,
    write,
)
from atlantis_netcfg.robots.observation import HeardWriter, RobotObservation, RobotReport, RobotState

SECONDS = 10.0
ROW = "- {topic: /a, data: numbers, rate_hz: 2, size_bytes: 60}"
TOPIC = {"topic": "/a", "data": "numbers", "rate_hz": 2, "size_bytes": 60}
BEFORE = "# of all\n---\nvehicles:\n  other:\n    kind: auv # kept\n"


@pytest.fixture
def inventory(tmp_path: Path) -> Path:
    return shutil.copytree(robot_cases.SHIPPED, tmp_path / "inventory")


def report(
    vehicle: str = "sparus", *findings: LinkFinding, rate_hz: float = 2.0, more: Sequence[str] = ()
) -> RobotReport:
    """Of a robot that publishes every topic of its file, 60 bytes large."""
    source = next(each for each in reading.read_declared(robot_cases.shipped(), KeyNames()) if each.vehicle == vehicle)
    assert source.robot is not None
    count = int(SECONDS * rate_hz)
    writers = [
        HeardWriter("key", name, "std_msgs/msg/String", messages=count, octets=60 * count, last_s=(count - 1) / rate_hz)
        for name in (*(topic.name for topic in source.robot.topics()), *more)
    ]
    return RobotReport(source.robot.name, RobotState.DECLARED, vehicle, findings, tuple(writers))


def build(inventory: Path, made: RobotReport) -> measured_telemetry.MeasuredTelemetry:
    declaration = load(inventory)
    sources, _ = reading.load_robots(declaration)
    robot = next(each.robot for each in sources if each.vehicle == made.vehicle)
    assert robot is not None
    assert made.vehicle is not None
    return telemetry_of("coastal", made, robot, declaration.vehicles[made.vehicle], SECONDS)


@pytest.mark.parametrize(
    ("entry", "gone"),
    [
        ("    kind: auv # its kind\n    table3: [wifi]\n", 0),
        ("    telemetry: [{topic: /x}, {topic: /y}] # EXAMPLE\n    kind: auv # its kind\n", 1),
        (
            "    kind: auv # its kind\n    telemetry: # old\n      - {topic: /x}\n      - data: z\n        topic: y\n",
            4,
        ),
        ("    telemetry:\n    # between\n    - {topic: /x}\n\n    # of the key below\n    kind: auv # its kind\n", 3),
        ("    kind: auv # its kind\n    key: !vault |\n      $ANSIBLE_VAULT;1.1;AES256\n      3031\n", 0),
        ("    kind: auv # its kind\n    partner:\n", 0),
    ],
)
@pytest.mark.parametrize("behind", ["", "\n  # of the next\n  next:\n    kind: asv\n"])
def test_rest_of_the_file_stays_unchanged(entry: str, gone: int, behind: str) -> None:
    text = f"{BEFORE}  sparus:\n{entry}{behind}"
    made = with_telemetry(text, ("vehicles", "sparus"), "as heard", [ROW])
    assert made is not None
    lines, kept = made.splitlines(), text.splitlines()
    at = lines.index("    telemetry: # as heard")
    assert lines[at + 1] == f"      {ROW}"
    assert [*lines[:at], *kept[at : at + gone], *lines[at + 2 :]] == kept
    document = yaml.safe_load(made.replace("!vault ", ""))["vehicles"]
    assert document["sparus"]["telemetry"] == [TOPIC]
    assert document["sparus"]["kind"] == "auv"
    assert list(document) == ["other", "sparus", *(["next"] if behind else [])]


def test_file_without_a_final_newline_gets_one() -> None:
    made = with_telemetry(f"{BEFORE}  sparus:\n    kind: auv", ("vehicles", "sparus"), "as heard", [ROW])
    assert made is not None
    assert made.endswith(f"    kind: auv\n    telemetry: # as heard\n      {ROW}\n")


@pytest.mark.parametrize("entry", ["  sparus: {kind: auv}\n", "  sparus:\n", "  zarco:\n    kind: asv\n"])
def test_entry_without_its_own_lines_is_not_edited(entry: str) -> None:
    assert with_telemetry(f"vehicles:\n{entry}", ("vehicles", "sparus"), "as heard", [ROW]) is None


def test_observed_topics_become_telemetry(inventory: Path) -> None:
    vehicles = inventory / "group_vars" / "all" / "vehicles.yml"
    text = vehicles.read_text().replace("size_bytes: 20000}", "size_bytes: 20000, least_hz: 0.01}")
    vehicles.write_text(text)
    made = report("girona500", more=("/rosout",))
    name = next(each.topic for each in made.topics if each.topic.endswith("image"))
    second = HeardWriter("key", name, "x", reliable=True, messages=20, octets=20 * 100, last_s=19.0)
    telemetry = build(inventory, replace(made, topics=(*made.topics, second)))
    image = next(each for each in telemetry.topics if each.topic == name)
    assert (image.rate_hz, image.size_bytes, image.reliable, image.least_hz) == (3.0, 80, True, 0.01)
    assert (image.data, telemetry.others) == ("images", ("/rosout",))
    others = [each for each in telemetry.topics if each is not image]
    assert {(each.rate_hz, each.size_bytes, each.reliable) for each in others} == {(2.0, 60, False)}


@pytest.mark.parametrize("spoil", ["nothing", "too few", "too quick", "one of two"])
def test_topic_with_unknown_rate_is_refused(inventory: Path, spoil: str) -> None:
    made = report(rate_hz=2.0)
    first = made.topics[0]
    wrong = {
        "nothing": (replace(first, messages=0, octets=0),),
        "too few": (replace(first, messages=2),),
        "too quick": (replace(first, last_s=0.001),),
        "one of two": (first, replace(first, messages=2)),
    }
    with pytest.raises(TelemetryUnknown, match=f"the rate of {first.topic} of `sparus` is still unknown after 10 s"):
        build(inventory, replace(made, topics=(*wrong[spoil], *made.topics[1:])))


def test_written_inventory_contains_the_observed_telemetry(inventory: Path) -> None:
    vehicles = inventory / "group_vars" / "all" / "vehicles.yml"
    vehicles.write_bytes(vehicles.read_bytes().replace(b"  stork:\n", b"  stork:\r\n"))
    declaration, telemetry = load(inventory), build(inventory, report("zarco"))
    made = change(declaration, telemetry, date(2026, 11, 29))
    assert made.difference[:3] == [
        "-    telemetry: # EXAMPLE",
        "-      - {topic: /zarco/pose, data: numbers, rate_hz: 1, size_bytes: 120}",
        "+    telemetry: # received at coastal on 2026-11-29, within 10 s",
    ]
    assert load(inventory).vehicles == declaration.vehicles, "nothing is written yet"
    write(declaration, telemetry, made)
    assert vehicles.read_bytes().count(b"\r\n") == 1
    after = load(inventory)
    assert after.vehicles["zarco"].telemetry == telemetry.topics
    assert {key: each for key, each in after.vehicles.items() if key != "zarco"} == {
        key: each for key, each in declaration.vehicles.items() if key != "zarco"
    }
    assert change(after, telemetry, date(2026, 12, 1)).difference == [], "the same again is no change"


@pytest.mark.parametrize("verdict", [Verdict.FAIL, Verdict.INCONCLUSIVE])
def test_robot_differing_from_its_file_is_not_written(inventory: Path, verdict: Verdict) -> None:
    finding = LinkFinding(verdict, "token", "its token differs from the one in its file", "ask")
    declaration, telemetry = load(inventory), build(inventory, report("sparus", finding))
    with pytest.raises(TelemetryUnknown, match="its token differs from the one in its file"):
        write(declaration, telemetry, change(declaration, telemetry, date(2026, 11, 29)))
    assert load(inventory).vehicles == declaration.vehicles


def test_file_changed_meanwhile_is_not_overwritten(inventory: Path) -> None:
    declaration, telemetry = load(inventory), build(inventory, report())
    made = change(declaration, telemetry, date(2026, 11, 29))
    vehicles = inventory / made.file
    vehicles.write_text(f"{vehicles.read_text()}# by somebody else\n")
    with pytest.raises(UsageError, match="changed in the meantime"):
        write(declaration, telemetry, made)
    assert "received at" not in vehicles.read_text()


def test_one_line_entry_is_shown_but_not_written(inventory: Path) -> None:
    declaration, telemetry = load(inventory), build(inventory, report())
    vehicles = inventory / "group_vars" / "all" / "vehicles.yml"
    document = yaml.safe_load(vehicles.read_text())
    vehicles.write_text(yaml.safe_dump(document, default_flow_style=True))
    made = change(declaration, telemetry, date(2026, 11, 29))
    assert len(made.difference) == len(telemetry.topics)
    with pytest.raises(UsageError, match="in a form that this command can edit"):
        write(declaration, telemetry, made)


def typed(inventory: Path, *more: str, vehicle: str = "sparus") -> list[str]:
    return ["measure", "fit", "site=coastal", f"vehicle={vehicle}", f"inventory={inventory}", *more]


def listening(monkeypatch: pytest.MonkeyPatch, *reports: RobotReport) -> None:
    monkeypatch.setattr(
        robots, "discover", lambda *_: (RobotObservation(SECONDS, {"key": "10.64.1.22"}), list(reports))
    )


def test_unobserved_vehicle_is_reported_with_those_present(
    inventory: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    listening(monkeypatch, report("zarco"))
    assert main(typed(inventory, "observed=10s", "--write")) == ExitCode.CHECKS_FAILED
    shown = capsys.readouterr().err
    assert "no messages of `sparus` received at coastal in 10 s" in shown
    (words,) = advised(said(shown, "`provision robot discover site={}` shows the received robots"))
    assert main(words) == ExitCode.DONE
    assert "zarco: declared" in capsys.readouterr().out


def test_difference_from_the_robot_file_is_shown_in_full(
    inventory: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    finding = LinkFinding(Verdict.FAIL, "token", "its token differs from the one in its file", "ask its partner")
    listening(monkeypatch, report("sparus", finding))
    assert main(typed(inventory, "observed=10s", "--write")) == ExitCode.CHECKS_FAILED
    shown = capsys.readouterr().err
    (words,) = advised(said(shown, "`provision robot discover site={}` shows all differences"))
    assert main(words) == ExitCode.CHECKS_FAILED
    assert "FAIL         its token differs from the one in its file" in capsys.readouterr().out


@pytest.mark.parametrize(("verdict", "code"), [(Verdict.FAIL, 6), (Verdict.INCONCLUSIVE, 6), (Verdict.WARN, 0)])
def test_robot_differing_from_its_file_determines_the_exit_code(
    verdict: Verdict, code: int, inventory: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    listening(monkeypatch, report("sparus", LinkFinding(verdict, "token", "its token is another one")))
    fits = SimpleNamespace(exit=ExitCode.DONE, as_json=lambda: {"exit": 0})
    monkeypatch.setattr("atlantis_netcfg.operations.fit.vehicle_fit", lambda *_, **__: fits)
    assert main(typed(inventory, "observed=10s", "--json")) == code
    assert json.loads(capsys.readouterr().out)["exit"] == code


def test_vehicle_without_a_file_is_reported_with_the_check_command(
    inventory: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = inventory / "robots" / "sparus.yml"
    text = file.read_text()
    file.unlink()
    assert main(typed(inventory, "observed=10s")) == ExitCode.NOTHING
    shown = capsys.readouterr().err
    file.write_text(text)
    (words,) = advised(said(shown, "see docs/robots.md; `provision robot validate vehicle={}` checks it"))
    assert main(words) == ExitCode.DONE


def test_observed_telemetry_is_judged_and_shown(
    inventory: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    warning = LinkFinding(Verdict.WARN, "topic-frozen", "/sparus/pose has the same value in all 20 messages")
    listening(monkeypatch, report("sparus", warning, more=("/rosout",)))
    assert main(typed(inventory, "link=wifi-ptp", "observed=10s")) == ExitCode.CHECKS_FAILED, "nobody measured it"
    shown = capsys.readouterr().out
    assert "sparus at coastal: 7 topics" in shown
    assert "WARN: /sparus/pose has the same value in all 20 messages" in shown
    assert "not counted, because not in its configuration: /rosout" in shown
    assert "group_vars/all/vehicles.yml, with `--write`:" in shown
    assert [
        line for line in shown.splitlines() if len(line) > 80 and "topic:" not in line and "voltage" not in line
    ] == []
    assert load(inventory).vehicles["sparus"].telemetry == ()
    assert main(typed(inventory, "link=wifi-ptp", "observed=10s", "--write", "--json")) == ExitCode.CHECKS_FAILED
    told = json.loads(capsys.readouterr().out)
    assert (told["written"], told["observed"]["others"]) == ("group_vars/all/vehicles.yml", ["/rosout"])
    topics = tuple(TelemetryTopic.model_validate(each) for each in told["observed"]["telemetry"])
    assert load(inventory).vehicles["sparus"].telemetry == topics
    assert main(typed(inventory, "link=wifi-ptp", "observed=10s", "--write", "--json")) == ExitCode.CHECKS_FAILED
    told = json.loads(capsys.readouterr().out)
    assert (told["written"], told["difference"]) == (None, [])


@pytest.mark.parametrize("more", ["--write", "address=127.0.0.1"])
def test_listening_duration_is_required(inventory: Path, more: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(typed(inventory, more)) == ExitCode.USAGE
    assert "add how long to listen: `observed=30s`" in capsys.readouterr().err
