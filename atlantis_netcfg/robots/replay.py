"""Replay of a rosbag2 bag with its original timing; the bag is treated as untrusted input.

Every message of a bag is checked before the first one is published. The bag's `metadata.yaml` is not read, because an
interrupted recording has none. Its type definitions are not read either: those of the inventory are used.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory.loader import shown_path
from atlantis_netcfg.inventory.robots.reading import read_published
from atlantis_netcfg.inventory.robots.ros_names import why_no_name
from atlantis_netcfg.robots.listener import CONFIGURATION_TYPE, content_hash
from atlantis_netcfg.robots.message_types import INTERFACES
from atlantis_netcfg.robots.network import Publisher
from atlantis_netcfg.robots.recording import LARGEST_BAG

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from atlantis_netcfg.inventory.robots.key_names import KeyNames
    from atlantis_netcfg.robots.message_types import MessageTypes

_MEET_S: Final = 2.0
"""Wait before the first message, so that present listeners miss none: announcements come every 2 s."""
_MOST_TOPICS: Final = 2000
MOST_ROBOTS: Final = 15
"""Maximum number of robots in a bag: each is a separate participant on this computer."""
_ANOTHER: Final = "ask whoever recorded it for another one; `ros2 bag info` shows its contents"
_PADDING: Final = 3
"""Maximum padding bytes after a message: writers fill it to a multiple of 4."""


@dataclass(frozen=True, slots=True)
class BagTopic:
    """A topic with its type and QoS as recorded."""

    name: str
    type: str
    reliable: bool
    transient_local: bool


@dataclass(frozen=True, slots=True)
class BagMessage:
    """One message of a bag."""

    time_ns: int
    topic: BagTopic
    data: bytes


@dataclass(slots=True)
class Bag:
    """A bag that can be published."""

    files: tuple[Path, ...]
    topics: dict[str, BagTopic] = field(default_factory=dict)
    left_out: dict[str, str] = field(default_factory=dict)
    """Maps a topic to its type, if the type is unknown or a second type of that topic."""
    owners: dict[str, str] = field(default_factory=dict)
    """Maps a topic to the namespace of the robot whose configuration names it."""
    robots: dict[str, str] = field(default_factory=dict)
    """Maps a short hash of each configuration to its namespace; empty: the configuration is unreadable."""
    first_ns: int = 2**63
    last_ns: int = 0

    @property
    def seconds(self) -> float:
        """From the first message to the last one."""
        return (self.last_ns - self.first_ns) / 1e9


def read_bag(folder: Path, types: MessageTypes, names: KeyNames) -> Bag:
    """Read and check every message. Raises UsageError if it is not a bag, or a message does not match its type."""
    bag = Bag(_files(folder))
    for message in _messages(bag.files):
        topic = message.topic
        is_known = topic.type in types and topic.name.startswith("/") and why_no_name(topic.name) is None
        if not is_known or bag.topics.setdefault(topic.name, topic).type != topic.type:
            bag.left_out[topic.name] = topic.type
            continue
        sample = sample_of(message, types)
        bag.first_ns = min(bag.first_ns, message.time_ns)
        bag.last_ns = max(bag.last_ns, message.time_ns)
        if topic.name == names.configuration_topic and topic.type == CONFIGURATION_TYPE:
            _introduce(bag, str(sample.data).encode(), content_hash(message.data), names)
        if len(bag.topics) + len(bag.left_out) > _MOST_TOPICS or len(bag.robots) > _MOST_TOPICS:
            raise UsageError(f"{arg(shown_path(folder))} has more than {arg(_MOST_TOPICS)} topics", hint=_ANOTHER)
        if len(set(bag.robots.values())) > MOST_ROBOTS:
            raise UsageError(f"{arg(shown_path(folder))} has more than {arg(MOST_ROBOTS)} robots", hint=_ANOTHER)
    if not bag.topics:
        raise UsageError(f"{arg(shown_path(folder))} contains no message of a known type", hint=_ANOTHER)
    return bag


def _introduce(bag: Bag, text: bytes, key: str, names: KeyNames) -> None:
    """Record which topics belong to which robot, from the robot's configuration."""
    if key not in bag.robots:
        robot, _ = read_published(text, names)
        bag.robots[key] = robot.name if robot is not None else ""
        bag.owners.update({topic.name: robot.name for topic in robot.topics()} if robot is not None else {})


def _files(folder: Path) -> tuple[Path, ...]:
    """Return the files of a bag, in the order of their first messages. Raises UsageError."""
    files = sorted(folder.glob("*.db3")) if folder.is_dir() else [folder]
    if not files or any(not each.is_file() or each.suffix != ".db3" for each in files):
        hint = "choose a folder with a rosbag2 bag stored as uncompressed sqlite3: its files end in .db3"
        raise UsageError(f"{arg(shown_path(folder))} is not a readable bag", hint=hint)
    if (size := sum(each.stat().st_size for each in files)) > LARGEST_BAG:
        raise UsageError(
            f"{arg(shown_path(folder))} has {arg(size / 1000000.0):.0f} MB; the limit is "
            f"{arg(LARGEST_BAG / 1000000.0):g}",
            hint=_ANOTHER,
        )
    firsts = {each: next((message.time_ns for message in _messages([each])), 0) for each in files}
    return tuple(sorted(files, key=firsts.__getitem__))


def _messages(files: Sequence[Path]) -> Iterator[BagMessage]:
    """Yield every message, ordered by time within each file. Raises UsageError."""
    from rosbags.interfaces import QosDurability, QosReliability  # noqa: PLC0415 - it brings numpy
    from rosbags.rosbag2 import Reader  # noqa: PLC0415 - as above

    for path in files:
        try:
            with Reader(path) as reader:
                for connection, time_ns, data in reader.messages():
                    if not isinstance(data, bytes) or not isinstance(time_ns, int):
                        raise TypeError("a message has no time, or no content")  # noqa: TRY301 - as all that is wrong
                    ext: Any = connection.ext
                    reliable = any(each.reliability is QosReliability.RELIABLE for each in ext.offered_qos_profiles)
                    is_kept = any(each.durability is QosDurability.TRANSIENT_LOCAL for each in ext.offered_qos_profiles)
                    topic = BagTopic(connection.topic, connection.msgtype, reliable, is_kept)
                    yield BagMessage(time_ns, topic, data)
        except UsageError:
            raise
        except Exception as error:
            reason = str(error).partition("\n")[0]
            raise UsageError(
                f"{arg(shown_path(path))} cannot be read as a bag: {arg(reason)}", hint=_ANOTHER
            ) from error


def sample_of(message: BagMessage, types: MessageTypes) -> Any:  # noqa: ANN401 - a message
    """Return the DDS message of a bag message. Raises UsageError if it does not match its type."""
    kind: Any = types.idl(message.topic.type)
    try:
        sample = kind.deserialize(message.data)
        rest = len(message.data) - len(sample.serialize())
    except Exception as error:
        raise _type_mismatch_error(message) from error
    if not 0 <= rest <= _PADDING:
        raise _type_mismatch_error(message)
    return sample


def _type_mismatch_error(message: BagMessage) -> UsageError:
    what = msg(
        f"a message of {arg(message.topic.name)} does not match the type {arg(message.topic.type)} as known here"
    )
    hint = msg(f"compare robots/{arg(INTERFACES)}/{arg(message.topic.type)}.msg of the inventory with the robot's own")
    return UsageError(what, hint=hint)


class BagPlayer:
    """Publishes a bag: one participant for each robot in it, and one for all other topics."""

    def __init__(self, bag: Bag, types: MessageTypes, number: int, configuration_topic: str, *, loop: bool) -> None:
        self.sent: Counter[str] = Counter()
        self._bag, self._types, self._topic, self._loop = bag, types, configuration_topic, loop
        self._publishers: dict[str, Publisher] = {}
        for each in bag.topics.values():
            for owner in set(bag.robots.values()) if self._is_configuration(each) else {bag.owners.get(each.name, "")}:
                publisher = self._publishers.get(owner) or self._publishers.setdefault(owner, Publisher(number, types))
                publisher.advertise(each.name, each.type, reliable=each.reliable, transient_local=each.transient_local)
        self._start_s = time.monotonic() + _MEET_S
        self._messages = _messages(bag.files)
        self._next: BagMessage | None = next(self._messages)

    def step(self, now: float) -> float:
        """Publish what is due at `now` (monotonic, seconds); return the next due time, infinity if there is none."""
        while self._next is not None and (due := self._due_at(self._next)) <= now:
            self._publish(self._next)
            self._next = next(self._messages, None)
            if self._next is None and self._loop:
                self._start_s = due + _MEET_S
                self._messages = _messages(self._bag.files)
                self._next = next(self._messages)
        return self._due_at(self._next) if self._next is not None else math.inf

    def _due_at(self, message: BagMessage) -> float:
        return self._start_s + (message.time_ns - self._bag.first_ns) / 1e9

    def _is_configuration(self, topic: BagTopic) -> bool:
        return (topic.name, topic.type) == (self._topic, CONFIGURATION_TYPE)

    def _publish(self, message: BagMessage) -> None:
        topic = message.topic
        if topic.name not in self._bag.topics or self._bag.topics[topic.name].type != topic.type:
            return
        owner = self._bag.owners.get(topic.name, "")
        if self._is_configuration(topic):
            owner = self._bag.robots.get(content_hash(message.data), "")
        self._publishers[owner].publish(topic.name, topic.type, sample_of(message, self._types))
        self.sent[topic.name] += 1
