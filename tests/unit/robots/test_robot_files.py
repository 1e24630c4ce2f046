"""Robots' files: the shipped ones are right, and whatever is wrong in one is told with its place."""

import random
import shutil
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import robot_cases

from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.inventory import load
from atlantis_netcfg.inventory.findings import MOST_SHOWN
from atlantis_netcfg.inventory.model.robot import CommandKind, TopicKind
from atlantis_netcfg.inventory.robots import reading
from atlantis_netcfg.inventory.robots.key_names import KeyNames

CASES = robot_cases.cases()
SIX = {"girona500", "sparus", "zarco", "stork", "mares", "eca-rov"}


def read(inventory: Path) -> dict[str | None, reading.RobotSource]:
    declaration = load(inventory)
    names, findings = reading.key_names(declaration)
    assert findings == []
    return {source.vehicle: source for source in reading.read_declared(declaration, names)}


def test_every_vehicle_of_table_3_has_a_valid_file() -> None:
    sources = read(robot_cases.SHIPPED)
    assert sources.keys() == SIX
    assert [(source.findings, source.warnings) for source in sources.values()] == [((), ())] * len(SIX)
    robots = [source.robot for source in sources.values() if source.robot is not None]
    assert {topic.kind for robot in robots for topic in robot.topics()} == set(TopicKind)
    assert {kind for robot in robots for kind, _, _ in robot.every_command()} == set(CommandKind)


def test_names_are_completed_with_the_namespace() -> None:
    robot = read(robot_cases.SHIPPED)["sparus"].robot
    assert robot is not None
    assert {topic.name: topic.message_type for topic in robot.topics()} == {
        "/sparus/pose": "geometry_msgs/msg/Pose",
        "/sparus/leak": "c4i_asset_msgs/msg/BoolTimestamped",
        "/sparus/at_surface": "c4i_asset_msgs/msg/BoolTimestamped",
        "/sparus/battery/voltage": "c4i_asset_msgs/msg/FloatTimestamped",
        "/sparus/depth": "c4i_asset_msgs/msg/FloatTimestamped",
        "/sparus/camera/image": "sensor_msgs/msg/Image",
        "/sparus/fix": "sensor_msgs/msg/NavSatFix",
    }
    assert {action.name: action.action_type.rpartition("/")[2] for action in robot.actions()} == {
        "/sparus/execute_plan": "ExecutePlan",
        "/sparus/surface": "CommandPlain",
        "/sparus/start_survey": "CommandPlain",
        "/sparus/go_to": "CommandWaypoint",
        "/sparus/follow": "CommandPath",
        "/sparus/dive_to": "CommandNumeric",
        "/sparus/lights": "CommandBool",
    }


def test_at_least_60_unique_cases_exist() -> None:
    assert len({case["case"] for case in CASES}) == len(CASES) >= 60
    assert all(case["told"] for case in CASES)


@pytest.mark.parametrize("case", CASES, ids=lambda case: str(case["case"]))
def test_broken_file_is_reported_with_its_location(case: dict[str, Any], tmp_path: Path) -> None:
    assert robot_cases.told(robot_cases.spoil(case, tmp_path)) == case["told"]


THEIRS = """\
robot_name: sparus
secret: EXAMPLE-sparus-token
interfaces:
  bool:
    - {name: leak, caption: Leak}
localisation: {name: pose}
executor: {server: execute_plan}
owner: somebody
"""


def test_file_in_the_partner_terminology_is_accepted(tmp_path: Path) -> None:
    inventory = tmp_path / "inventory"
    shutil.copytree(robot_cases.SHIPPED, inventory)
    (inventory / "robots" / "sparus.yml").write_text(THEIRS)
    keys = (
        "namespace: robot_name, token: secret, pose: localisation, mission_executor: executor, topic: name, "
        "label: caption, mission_executor.action: server, telemetry.booleans: interfaces.bool"
    )
    (inventory / "robots" / "keys.yml").write_text(f"keys: {{{keys}}}\nignored: [owner]\n")
    others = ("girona500", "mares", "stork", "zarco", "eca-rov")
    for vehicle in others:
        (inventory / "robots" / f"{vehicle}.yml").unlink()
    source = read(inventory)["sparus"]
    assert source.findings == ()
    assert source.robot is not None
    assert [topic.name for topic in source.robot.topics()] == ["/sparus/pose", "/sparus/leak"]
    assert [action.name for action in source.robot.actions()] == ["/sparus/execute_plan"]


def test_telemetry_topic_missing_from_the_robot_file_is_a_warning(tmp_path: Path) -> None:
    inventory = tmp_path / "inventory"
    shutil.copytree(robot_cases.SHIPPED, inventory)
    vehicles = inventory / "group_vars" / "all" / "vehicles.yml"
    vehicles.write_text(vehicles.read_text().replace("topic: /mares/battery/voltage", "topic: /mares/dept"))
    (warning,) = read(inventory)["mares"].warnings
    assert warning.message == "`telemetry:` of the vehicle mares has `/mares/dept`, this file does not"
    assert warning.hint == "did you mean `/mares/depth`?"


def test_real_inventory_refuses_example_values_in_robot_files() -> None:
    declaration = robot_cases.shipped()
    real = declaration.pilot.model_copy(update={"example_values": False})
    declaration = replace(declaration, pilot=real)
    (sparus,) = (each for each in reading.read_declared(declaration, KeyNames()) if each.vehicle == "sparus")
    lines = {finding.line for finding in sparus.findings}
    assert {5, 6, 7, 8, 11, 12, 14, 15} <= lines
    assert all("is still an example" in finding.message for finding in sparus.findings)


ODD = (b": ", b"\n- ", b"{", b"]", b'"', b"'", b"&a ", b"*a", b"!x ", b"\t", b"|\n")


def mutant(text: str, chance: random.Random) -> bytes:
    """The text with some bytes, lines or words spoiled."""
    data = bytearray(text.encode())
    for _ in range(chance.randint(1, 6)):
        place = chance.randrange(len(data))
        match chance.randrange(5):
            case 0:
                del data[place : place + chance.randint(1, 40)]
            case 1:
                data[place:place] = bytes(chance.choices(range(256), k=chance.randint(1, 8)))
            case 2:
                data[place:place] = chance.choice(ODD)
            case 3:
                data += data[place : place + chance.randint(1, 400)]
            case _:
                data[place] = chance.randrange(256)
    return bytes(data)


def test_malformed_file_never_causes_a_traceback(tmp_path: Path) -> None:
    declaration = robot_cases.shipped()
    texts = [path.read_text() for path in reading.robot_files(declaration).values()]
    chance, judged = random.Random(39), 0  # noqa: S311 - the same in each run
    for number in range(240):
        file = tmp_path / f"{number}.yml"
        file.write_bytes(mutant(chance.choice(texts), chance))
        (source,) = reading.read_given([file], declaration, KeyNames())
        assert source.robot is not None or source.findings
        assert all(finding.line >= 1 and finding.hint for finding in source.findings)
        judged += source.robot is None
    assert judged >= 100, "most of them are spoiled"


@pytest.mark.parametrize(
    "text",
    [
        "namespace: a\ntelemetry: {booleans: [" + "{topic: x}," * 10_000 + "]}\n",
        "namespace: " + "a" * 250_000 + "\n",
        "".join(f"k{number}: 1\n" for number in range(10_000)),
        "a: [" + "1," * 60_000 + "]\n",
    ],
    ids=["many topics", "a long name", "many keys", "a long list"],
)
def test_a_large_file_takes_little_memory(text: str, tmp_path: Path) -> None:
    """A megabyte at most is read; what is made of it is bounded, and no more is told than a person reads."""
    declaration = robot_cases.shipped()
    file = tmp_path / "large.yml"
    file.write_text(text)
    tracemalloc.start()
    (source,) = reading.read_given([file], declaration, KeyNames())
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert 1 <= len(source.findings) <= MOST_SHOWN + 1
    assert peak < 700 * len(text)


def test_vaulted_token_is_decrypted_with_the_inventory_password(tmp_path: Path) -> None:
    own = shutil.copytree(robot_cases.SHIPPED, tmp_path / "inventory")
    file = own / "robots" / "sparus.yml"
    sealed = "token: !vault |\n  $ANSIBLE_VAULT;1.1;AES256\n  3030"
    file.write_text(file.read_text().replace("token: EXAMPLE-sparus-token", sealed))

    def token(decrypt: Callable[[str], str] | None) -> object:
        (sparus,) = (each for each in reading.load_robots(load(own, decrypt=decrypt))[0] if each.vehicle == "sparus")
        assert sparus.robot is not None
        return None if sparus.token_is_sealed else sparus.robot.token

    assert token(None) is None
    assert token(lambda text: text[:14]) == Secret("$ANSIBLE_VAULT")
