"""Participants of DDS on this computer: a listener that hears robots, and mock robots that are heard.

cyclonedds is driven by polling in one thread. A domain is configured once a process, before its first participant.
"""

from __future__ import annotations

import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.robots.message_types import ros_type_name, stamp_of, topic_name
from atlantis_netcfg.robots.observation import HeardConfiguration, HeardWriter, Observation, content_hash

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from cyclonedds.idl import IdlStruct

    from atlantis_netcfg.robots.message_types import MessageTypes

_POLL_S: Final = 0.02
_AT_ONCE: Final = 64
_KEPT: Final = 3
"""Different messages that are remembered of a topic."""
_MOST_WRITERS: Final = 2000
"""Publishers that are listened to: a network of robots has fewer."""
_DEPTH: Final = 10
"""Of a topic, as rmw has it."""
_BLOCK_MS: Final = 100
"""How long a reader that takes nothing may hold the robot up."""
_REQUESTS_AT_ONCE: Final = 32
"""Of one service; of more the oldest are lost, as in a node of ROS, which keeps 10."""
_LONGEST_REQUEST: Final = 1_000_000
_ALIGNMENT: Final = 4
"""Messages are padded to it."""
_SHORT: Final = 1000
"""Octets of a message whose length is told to the octet."""
CONFIGURATION_TYPE: Final = "std_msgs/msg/String"


def profile(address: str, peers: Sequence[str], participants: int) -> str:
    """Cyclone's configuration of this computer: its address in the robots' network, and where robots may be.

    Multicast is left on for discovery alone, so that robots without a profile are heard as well.
    """
    rows = "".join(f'<Peer Address="{peer}"/>' for peer in dict.fromkeys((*peers, address)))
    return (
        '<CycloneDDS><Domain Id="any"><General><Interfaces>'
        f'<NetworkInterface address="{address}"/></Interfaces><AllowMulticast>spdp</AllowMulticast></General>'
        f"<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>{participants}"
        f"</MaxAutoParticipantIndex><SPDPInterval>2s</SPDPInterval><Peers>{rows}</Peers></Discovery><Tracing><Verbosity>none</Verbosity></Tracing></Domain></CycloneDDS>"
    )


@contextmanager
def domain(number: int, configuration: str) -> Iterator[int]:
    """A domain of DDS with a profile of its own, whatever this computer's environment says. Raises UsageError."""
    try:
        from cyclonedds.core import DDSException  # noqa: PLC0415 - there is none for aarch64
        from cyclonedds.domain import Domain  # noqa: PLC0415 - as above
    except ImportError as error:
        hint = "PyPI has none for aarch64: use a laptop with an x86_64 processor"
        raise UsageError("cyclonedds is not installed on this computer", hint=hint) from error
    try:
        made = Domain(number, configuration)
    except DDSException as error:
        hint = "is the address one of this computer's, and the interface up? `ip address` shows both"
        raise UsageError(f"no participant of DDS can be made here: {error}", hint=hint) from error
    try:
        yield number
    finally:
        del made


class RobotListener:
    """Hears every publisher of a domain, and counts the messages of those whose type is known."""

    def __init__(
        self,
        number: int,
        types: MessageTypes,
        configuration_topic: str,
        keep: Callable[[HeardWriter, bytes], None] | None = None,
    ) -> None:
        """`keep` is given every message of a known type."""
        from cyclonedds.builtin import (  # noqa: PLC0415 - as above
            BuiltinDataReader,
            BuiltinTopicDcpsParticipant,
            BuiltinTopicDcpsPublication,
        )
        from cyclonedds.domain import DomainParticipant  # noqa: PLC0415 - as above

        self._participant = DomainParticipant(number)
        self._people = BuiltinDataReader(self._participant, BuiltinTopicDcpsParticipant)
        self._publications = BuiltinDataReader(self._participant, BuiltinTopicDcpsPublication)
        self._types = types
        self._topic = configuration_topic
        self._keep = keep
        self._readers: dict[tuple[str, str], Any] = {}
        self._writers: dict[str, HeardWriter] = {}
        self._handles: dict[int, str] = {}
        self._began = time.monotonic()
        self._texts: dict[str, bytes] = {}
        self._names: dict[str, str] = {}
        self._unread: dict[str, str] = {}

    def listen(self, seconds: float) -> Observation:
        """Listen so long, and say what was heard since the beginning."""
        until = time.monotonic() + seconds
        while (now := time.monotonic()) < until:
            self.poll()
            time.sleep(min(_POLL_S, max(0.0, until - now)))
        return self.observation()

    def observation(self) -> Observation:
        """What was heard up to now."""
        rows = [HeardConfiguration(self._writers[key], text) for key, text in self._texts.items()]
        silent = [
            writer for key, writer in self._writers.items() if key not in self._texts and writer.topic == self._topic
        ]
        rows += [HeardConfiguration(writer, b"") for writer in silent if writer.messages]
        seconds = time.monotonic() - self._began
        others = [writer for writer in self._writers.values() if writer.topic != self._topic]
        return Observation(seconds, dict(self._names), others, rows, dict(self._unread))

    def poll(self) -> None:
        """Take what has arrived."""
        guid = str(self._participant.guid)
        # Of who leaves there is a sample with its key alone.
        for sample in self._people.take(N=_AT_ONCE):
            if sample.sample_info.valid_data and str(sample.key) != guid:
                self._names[str(sample.key)] = _addresses(sample)
        for sample in self._publications.take(N=_AT_ONCE):
            if sample.sample_info.valid_data and str(sample.participant_key) != guid:
                self._publication(sample)
        for (_, kind), reader in list(self._readers.items()):
            for sample in reader.take(N=_AT_ONCE):
                if sample.sample_info.valid_data:
                    self._message(reader, self._types.idl(kind), sample)

    def _publication(self, sample: Any) -> None:  # noqa: ANN401 - cyclonedds' endpoint
        from cyclonedds.core import Policy  # noqa: PLC0415 - as above

        name, key = topic_name(sample.topic_name), str(sample.key)
        if name is None or key in self._writers or len(self._writers) >= _MOST_WRITERS:
            return
        kind = ros_type_name(sample.type_name) or sample.type_name
        reliable = isinstance(sample.qos[Policy.Reliability], Policy.Reliability.Reliable)
        is_kept = sample.qos[Policy.Durability] == Policy.Durability.TransientLocal
        self._writers[key] = HeardWriter(str(sample.participant_key), name, kind, reliable, is_kept)
        self._read(sample.topic_name, name, kind)

    def _read(self, dds_name: str, name: str, kind: str) -> None:
        from cyclonedds.core import Policy, Qos  # noqa: PLC0415 - as above

        if kind not in self._types:
            self._unread[name] = kind
        elif (dds_name, kind) not in self._readers:
            qos = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(_AT_ONCE))
            self._readers[dds_name, kind] = _reader(self._participant, dds_name, self._types.idl(kind), qos)

    def _message(self, reader: Any, kind: type[IdlStruct], sample: Any) -> None:  # noqa: ANN401 - of cyclonedds
        handle = sample.sample_info.publication_handle
        if handle not in self._handles:
            endpoint = reader.get_matched_publication_data(handle)
            self._handles[handle] = str(endpoint.key) if endpoint is not None else ""
        writer = self._writers.get(self._handles[handle])
        if writer is None:
            return
        message, now = _decoded(kind, sample.data), time.monotonic()
        # Cyclone fills a message up to a multiple of four: of a short one that would be a quarter.
        data = sample.data if message is None or len(sample.data) > _SHORT else message.serialize()
        writer.first_s = writer.first_s if writer.messages else now
        writer.last_s = now
        writer.messages += 1
        writer.octets += len(data)
        if self._keep is not None:
            self._keep(writer, data)
        stamp = stamp_of(message)
        if stamp is not None:
            age = time.time() - (stamp.sec + stamp.nanosec / 1e9)
            writer.stamp_age_s = age if writer.stamp_age_s is None else max(age, writer.stamp_age_s, key=abs)
            stamp.sec = stamp.nanosec = 0
        if len(writer.contents) < _KEPT:
            writer.contents.add(content_hash(message.serialize() if stamp is not None else data))
        if writer.topic == self._topic and writer.type == CONFIGURATION_TYPE:
            self._texts[self._handles[handle]] = str(message.data).encode() if message is not None else data


def _addresses(sample: Any) -> str:  # noqa: ANN401 - cyclonedds' participant
    """What a participant says of where it is, else its key."""
    from cyclonedds.core import Policy  # noqa: PLC0415, F401 - the policies are registered by it

    properties = {each.key: each.value for each in sample.qos if type(each).__name__ == "Property"}
    return properties.get("__NetworkAddresses") or properties.get("__Hostname") or str(sample.key)


class Publisher:
    """One participant that publishes messages of ROS, and offers services of ROS."""

    def __init__(self, number: int, types: MessageTypes) -> None:
        from cyclonedds.domain import DomainParticipant  # noqa: PLC0415 - as above

        self._participant = DomainParticipant(number)
        self._types = types
        self._writers: dict[str, Any] = {}

    def advertise(
        self, topic: str, kind: str, *, reliable: bool = False, transient_local: bool = False, depth: int = _DEPTH
    ) -> None:
        """Make the publisher of a topic; a transient-local one gives its last messages to those who come later."""
        from cyclonedds.core import Policy, Qos  # noqa: PLC0415 - as above
        from cyclonedds.util import duration  # noqa: PLC0415 - as above

        reliability = Policy.Reliability.Reliable(duration(milliseconds=_BLOCK_MS))
        qos = Qos(
            reliability if reliable else Policy.Reliability.BestEffort,
            Policy.Durability.TransientLocal if transient_local else Policy.Durability.Volatile,
            Policy.History.KeepLast(depth),
        )
        self._writers[topic] = _writer(self._participant, f"rt{topic}", self._types.idl(kind), qos)

    def publish(self, topic: str, kind: str, message: Any) -> None:  # noqa: ANN401 - a message
        """Send a message on a topic of ROS, whose publisher is made with the first one."""
        if topic not in self._writers:
            self.advertise(topic, kind)
        self.send(topic, message)

    def send(self, topic: str, message: Any) -> bool:  # noqa: ANN401 - a message
        """Send a message on an advertised topic; False: a reader of a reliable one takes nothing."""
        return _write(self._writers[topic], message)

    def service(self, name: str, kind: str) -> RosService:
        """Offer a service of ROS."""
        return RosService(self._participant, self._types, name, kind)


class _Octets:
    """A message as it came: who takes it decodes it, so that one that cannot be decoded takes no other along."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.sample_info: Any = None

    @classmethod
    def deserialize(cls, data: bytes) -> _Octets:
        """For cyclonedds, which asks the type of a topic."""
        return cls(data)

    deserialize_key = deserialize


class RosService:
    """One service of ROS, as rmw_cyclonedds sends requests and replies."""

    def __init__(self, participant: Any, types: MessageTypes, name: str, kind: str) -> None:  # noqa: ANN401 - of cyclonedds
        from cyclonedds.core import Policy, Qos  # noqa: PLC0415 - as above
        from cyclonedds.util import duration  # noqa: PLC0415 - as above

        reliable = Policy.Reliability.Reliable(duration(milliseconds=_BLOCK_MS))
        qos = Qos(reliable, Policy.History.KeepLast(_REQUESTS_AT_ONCE))
        self._type = types.idl(f"{kind}_Request")
        self._reader = _reader(participant, f"rq{name}Request", types.unchecked(f"{kind}_Request"), qos)
        self._writer = _writer(participant, f"rr{name}Reply", types.idl(f"{kind}_Response"), qos)

    def requests(self) -> Iterator[Any]:
        """What has come since; None for a request that is not in this form."""
        for sample in self._reader.take(N=_REQUESTS_AT_ONCE):
            if sample.sample_info.valid_data:
                data = sample.data if len(sample.data) <= _LONGEST_REQUEST else b""
                message = _decoded(self._type, data)
                is_whole = message is not None and 0 <= len(data) - len(message.serialize()) < _ALIGNMENT
                yield message if is_whole else None

    def reply(self, request: Any, message: Any) -> None:  # noqa: ANN401 - messages
        """Answer a request."""
        message.client, message.number = request.client, request.number
        _write(self._writer, message)


def _decoded(kind: type[IdlStruct], data: bytes) -> Any:  # noqa: ANN401 - a message
    """A message; None: it is none of this type."""
    try:
        return kind.deserialize(data)
    except Exception:  # noqa: BLE001 - cyclonedds and struct raise what they like
        return None


def _reader(participant: Any, name: str, kind: type[IdlStruct], qos: Any) -> Any:  # noqa: ANN401 - of cyclonedds
    from cyclonedds.sub import DataReader  # noqa: PLC0415 - as above
    from cyclonedds.topic import Topic  # noqa: PLC0415 - as above

    topic: Any = Topic(participant, name, kind)
    reader = DataReader(participant, topic, qos=qos)
    topic.data_type = _Octets
    return reader


def _writer(participant: Any, name: str, kind: type[IdlStruct], qos: Any) -> Any:  # noqa: ANN401 - of cyclonedds
    from cyclonedds.pub import DataWriter  # noqa: PLC0415 - as above
    from cyclonedds.topic import Topic  # noqa: PLC0415 - as above

    return DataWriter(participant, Topic(participant, name, kind), qos=qos)


def _write(writer: Any, message: Any) -> bool:  # noqa: ANN401 - of cyclonedds
    from cyclonedds.core import DDSException  # noqa: PLC0415 - as above

    try:
        writer.write(message)
    except DDSException as error:
        if error.code != DDSException.DDS_RETCODE_TIMEOUT:
            raise
        return False
    return True
