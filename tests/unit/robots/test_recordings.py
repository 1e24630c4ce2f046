"""Recordings: a bag is bounded, private and whole when it is cut; somebody else's bag is data, whatever is in it."""

import random
import sqlite3
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
import robot_cases
import yaml
from rosbags.rosbag2 import Reader

from atlantis_netcfg.cli import main
from atlantis_netcfg.core.errors import ExitCode, UsageError
from atlantis_netcfg.inventory.robots.key_names import KeyNames
from atlantis_netcfg.operations import robots
from atlantis_netcfg.robots import replay
from atlantis_netcfg.robots.message_types import MessageTypes
from atlantis_netcfg.robots.observation import HeardWriter, RobotObservation
from atlantis_netcfg.robots.recording import BagRecorder

pytest.importorskip("cyclonedds", reason="PyPI has no cyclonedds for this machine")
TYPES = MessageTypes(robot_cases.SHIPPED / "robots" / "interfaces")
NAMES = KeyNames()
DEPTH = HeardWriter("key", "/sparus/depth", "c4i_asset_msgs/msg/FloatTimestamped")
POSE = HeardWriter("key", "/sparus/pose", "geometry_msgs/msg/Pose", reliable=True, transient_local=True)
TEXT = HeardWriter("key", NAMES.configuration_topic, "std_msgs/msg/String")


def content(writer: HeardWriter, value: float | str = 0.0) -> bytes:
    message = TYPES.empty(writer.type)
    if hasattr(message, "data"):
        message.data = value
    data: bytes = message.serialize()
    return data


def configuration(name: str = "sparus") -> bytes:
    text = (robot_cases.SHIPPED / "robots" / "sparus.yml").read_text()
    return content(TEXT, text.replace("namespace: sparus", f"namespace: {name}"))


def record(folder: Path, *messages: tuple[HeardWriter, bytes]) -> BagRecorder:
    with BagRecorder(folder, TYPES, free=0) as recorder:
        for writer, data in messages:
            recorder.add(writer, data)
    return recorder


def contents(folder: Path) -> list[tuple[str, bytes]]:
    with Reader(folder) as reader:
        return [(connection.topic, data) for connection, _, data in reader.messages()]


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    folder = tmp_path / "bag"
    record(folder, (TEXT, configuration()), (DEPTH, content(DEPTH, 1.0)), (POSE, content(POSE)))
    return folder


def test_recording_is_private_and_readable_by_foxy(bag: Path) -> None:
    assert bag.stat().st_mode & 0o777 == 0o700
    metadata = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert (metadata["storage_identifier"], metadata["message_count"]) == ("sqlite3", 3)
    (file,) = metadata["relative_file_paths"]
    database = sqlite3.connect(bag / file)
    # What rosbag2 0.3 of Foxy asks for, and the numbers that it takes for a policy.
    rows = database.execute("SELECT name, type, serialization_format FROM topics ORDER BY id;").fetchall()
    assert rows == [(each.topic, each.type, "cdr") for each in (TEXT, DEPTH, POSE)]
    asked = (
        "SELECT data, timestamp, topics.name FROM messages JOIN topics ON messages.topic_id = topics.id "
        "ORDER BY messages.timestamp;"
    )
    assert [(name, data) for data, _, name in database.execute(asked)] == contents(bag)
    offered = {
        each["topic_metadata"]["name"]: yaml.safe_load(each["topic_metadata"]["offered_qos_profiles"])[0]
        for each in metadata["topics_with_message_count"]
    }
    assert (offered[POSE.topic]["reliability"], offered[POSE.topic]["durability"]) == (1, 1)
    assert (offered[DEPTH.topic]["reliability"], offered[DEPTH.topic]["durability"]) == (2, 2)


def test_interrupted_recording_is_complete(tmp_path: Path) -> None:
    def cut() -> None:
        with BagRecorder(tmp_path / "bag", TYPES, free=0) as recorder:
            recorder.add(DEPTH, content(DEPTH))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        cut()
    assert contents(tmp_path / "bag") == [(DEPTH.topic, content(DEPTH))]


def test_recording_stops_at_its_size_limit(tmp_path: Path) -> None:
    data = content(DEPTH)
    with BagRecorder(tmp_path / "bag", TYPES, most=3 * len(data), free=0) as recorder:
        for _ in range(5):
            recorder.add(DEPTH, data)
    assert (recorder.messages, recorder.reason) == (3, "it would be larger than 6e-05 MB")
    assert len(contents(tmp_path / "bag")) == 3


def test_recording_stops_before_the_disk_is_full(tmp_path: Path) -> None:
    with BagRecorder(tmp_path / "bag", TYPES, free=2**63) as recorder:
        recorder.add(DEPTH, content(DEPTH))
    assert recorder.reason.startswith("less than")
    assert not (tmp_path / "bag").exists(), "nothing was recorded"


def test_disk_error_stops_the_recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise sqlite3.OperationalError("database or disk is full")

    with BagRecorder(tmp_path / "bag", TYPES, free=0) as recorder:
        recorder.add(DEPTH, content(DEPTH))
        with monkeypatch.context() as patch:
            patch.setattr(recorder._bag, "write", full)
            recorder.add(DEPTH, content(DEPTH))
    assert (recorder.messages, recorder.reason) == (1, "database or disk is full")
    assert len(contents(tmp_path / "bag")) == 1


def test_recording_that_cannot_be_finished_is_reported_as_such(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(_: object) -> None:
        raise sqlite3.OperationalError("disk I/O error")

    monkeypatch.setattr("rosbags.rosbag2.Writer.close", full)
    recorder = record(tmp_path / "bag", (DEPTH, content(DEPTH)))
    monkeypatch.setattr(robots, "recorder", lambda *_: recorder)
    monkeypatch.setattr(robots, "discover", lambda *_: (RobotObservation(5.0, {"key": "10.64.1.22"}), []))
    assert main(["robot", "discover", "site=coastal", "record=anywhere"]) == ExitCode.CHECKS_FAILED
    shown = capsys.readouterr().out
    assert "the recording ended early: it could not be completed: disk I/O error" in shown
    assert "recorded in" not in shown


def test_existing_path_is_never_overwritten(bag: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="already"):
        BagRecorder(bag, TYPES)
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    with pytest.raises(UsageError, match="already"):
        BagRecorder(tmp_path / "link", TYPES)
    with pytest.raises(UsageError, match="cannot create"), BagRecorder(bag / "metadata.yaml" / "bag", TYPES):
        pass


def test_bag_is_replayed_with_the_recorded_topics_and_qos(bag: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[tuple[str, object]] = []
    people: list[Any] = []

    class Witness:
        def __init__(self, number: int, types: MessageTypes) -> None:
            assert (number, types) == (3, TYPES)
            self.offered: dict[str, tuple[str, bool, bool]] = {}
            people.append(self)

        def advertise(self, topic: str, kind: str, *, reliable: bool, transient_local: bool) -> None:
            self.offered[topic] = (kind, reliable, transient_local)

        def publish(self, topic: str, kind: str, message: Any) -> None:  # noqa: ANN401 - a message
            assert self.offered[topic][0] == kind
            said.append((topic, message.serialize()))

    monkeypatch.setattr(replay, "Publisher", Witness)
    read = replay.read_bag(bag, TYPES, NAMES)
    assert (set(read.robots.values()), read.left_out) == ({"sparus"}, {})
    player = replay.BagPlayer(read, TYPES, 3, NAMES.configuration_topic, loop=False)
    (witness,) = people
    assert witness.offered == {
        TEXT.topic: (TEXT.type, False, False),
        DEPTH.topic: (DEPTH.type, False, False),
        POSE.topic: (POSE.type, True, True),
    }
    begin = player.step(0.0)
    assert said == [], "whoever listens has time to find it"
    assert player.step(begin) > begin
    assert [topic for topic, _ in said] == [TEXT.topic]
    assert player.step(begin + read.seconds) == float("inf")
    assert said == contents(bag)


def test_replay_loops(bag: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Silent:
        def __init__(self, *_: object) -> None: ...

        def advertise(self, *_: object, **__: object) -> None: ...

        publish = advertise

    monkeypatch.setattr(replay, "Publisher", Silent)
    read = replay.read_bag(bag, TYPES, NAMES)
    player = replay.BagPlayer(read, TYPES, 3, NAMES.configuration_topic, loop=True)
    now = player.step(0.0)
    for _ in range(30):
        after = player.step(now)
        assert now < after < now + read.seconds + 3
        now = after
    assert player.sent.total() >= 30


def test_types_that_are_not_known_are_left_out(bag: Path) -> None:
    file = bag / "bag.db3"
    with sqlite3.connect(file) as database:
        rows = [(7, "/odd", "odd_msgs/msg/Odd"), (8, "no name", DEPTH.type), (9, POSE.topic, DEPTH.type)]
        database.executemany("INSERT INTO topics VALUES(?, ?, ?, 'cdr', '', '')", rows)
        for number, *_ in rows:
            database.execute(
                "INSERT INTO messages (topic_id, timestamp, data) VALUES(?, 9223372036854775807, x'00010000')", [number]
            )
    read = replay.read_bag(bag, TYPES, NAMES)
    assert read.left_out == {"/odd": "odd_msgs/msg/Odd", "no name": DEPTH.type, POSE.topic: DEPTH.type}
    assert list(read.topics) == [TEXT.topic, DEPTH.topic, POSE.topic]


def change(statement: str) -> Callable[[Path], None]:
    def changed(folder: Path) -> None:
        with sqlite3.connect(folder / "bag.db3") as database:
            database.execute(statement)

    return changed


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda folder: (folder / "bag.db3").unlink(), "is not a readable bag"),
        (lambda folder: (folder / "bag.db3").rename(folder / "bag.mcap"), "is not a readable bag"),
        (lambda folder: (folder / "bag.db3").rename(folder / "bag.db3.zstd"), "is not a readable bag"),
        (lambda folder: (folder / "bag.db3").write_bytes(b"not a database" * 100), "cannot be read as a bag"),
        (lambda folder: (folder / "bag.db3").write_bytes(b""), "cannot be read as a bag"),
        (change("DROP TABLE messages"), "cannot be read as a bag"),
        (change("DELETE FROM messages"), "contains no message of a known type"),
        (change("UPDATE topics SET type = 'odd_msgs/msg/Odd'"), "contains no message of a known type"),
        (change("UPDATE messages SET timestamp = 'soon'"), "cannot be read as a bag"),
        (change("UPDATE messages SET data = 7"), "cannot be read as a bag"),
        (change("UPDATE messages SET data = x'00'"), "does not match the type"),
        (change("UPDATE messages SET data = CAST(data || x'00000000' AS BLOB)"), "does not match the type"),
        (change("UPDATE messages SET data = substr(data, 1, 10)"), "does not match the type"),
        (change("UPDATE topics SET type = 'sensor_msgs/msg/Image'"), "does not match the type"),
        (change("UPDATE topics SET offered_qos_profiles = '[{'"), "cannot be read as a bag"),
    ],
)
def test_broken_bag_is_reported_and_nothing_is_published(
    bag: Path, spoil: Callable[[Path], None], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    spoil(bag)
    with pytest.raises(UsageError, match=message):
        replay.read_bag(bag, TYPES, NAMES)
    assert "Traceback" not in capsys.readouterr().err


def test_terminal_escapes_in_a_bag_are_not_printed(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    change("UPDATE topics SET offered_qos_profiles = '[\x1b]0;x\x07'")(bag)
    assert main(["robot", "mock", f"bag={bag}"]) == ExitCode.USAGE
    assert not {"\x1b", "\x07"} & {*capsys.readouterr().err}


def test_bag_without_metadata_can_be_read(bag: Path) -> None:
    (bag / "metadata.yaml").unlink()
    assert len(replay.read_bag(bag, TYPES, NAMES).topics) == 3
    assert len(replay.read_bag(bag / "bag.db3", TYPES, NAMES).topics) == 3


def test_files_of_a_bag_are_read_in_time_order(bag: Path, tmp_path: Path) -> None:
    later = tmp_path / "later"
    record(later, (DEPTH, content(DEPTH, 2.0)))
    (later / "later.db3").rename(bag / "a.db3")
    assert [file.name for file in replay.read_bag(bag, TYPES, NAMES).files] == ["bag.db3", "a.db3"]


def test_oversized_bag_is_refused(bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    record(tmp_path / "many", *[(TEXT, configuration(f"robot{number}")) for number in range(replay.MOST_ROBOTS + 1)])
    with pytest.raises(UsageError, match="has more than 15 robots"):
        replay.read_bag(tmp_path / "many", TYPES, NAMES)
    monkeypatch.setattr(replay, "LARGEST_BAG", 1000)
    with pytest.raises(UsageError, match="MB; the limit is"):
        replay.read_bag(bag, TYPES, NAMES)


@pytest.mark.parametrize("seed", range(60))
def test_corrupted_bytes_are_reported_or_harmless(bag: Path, seed: int) -> None:
    """Anywhere in the database: a bag that can still be read holds only messages of their types."""
    file, chance = bag / "bag.db3", random.Random(seed)  # noqa: S311 - the same each time
    data = bytearray(file.read_bytes())
    for _ in range(chance.choice((1, 20, 400))):
        data[chance.randrange(len(data))] = chance.randrange(256)
    file.write_bytes(data[: chance.choice((len(data), len(data), chance.randrange(len(data))))])
    try:
        topics = replay.read_bag(bag, TYPES, NAMES).topics
    except UsageError:
        return
    assert 1 <= len(topics) <= 3


@pytest.mark.parametrize(
    ("typed", "message"),
    [
        (("bag=bags/none",), "is not a readable bag"),
        (("bag=bags/none", "vehicle=sparus"), "a recording and `vehicle=` cannot be used together"),
        (("--loop",), "add it: `bag=FOLDER`"),
    ],
)
def test_invalid_arguments_are_reported(
    typed: Sequence[str], message: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(replay, "Publisher", lambda *_: pytest.fail("a participant was made"))
    assert main(["robot", "mock", *typed]) == ExitCode.USAGE
    assert message in " ".join(capsys.readouterr().err.split())
