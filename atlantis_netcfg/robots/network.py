"""DDS participants on this computer: a listener to robots, and publishers for mock robots.

cyclonedds is polled in one thread. A domain is configured once per process, before its first participant.
"""

from __future__ import annotations

import asyncio
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.messages import arg
from atlantis_netcfg.robots import listener, observation

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from cyclonedds.idl import IdlStruct

    from atlantis_netcfg.robots.message_types import MessageTypes

ANNOUNCE_S: Final = 10
_LEASE_S: Final = 120
"""DDS lease, longer than the gaps of a satellite link: messages continue afterwards without new discovery."""
_DEPTH: Final = 10
"""History depth of a topic, the default of rmw."""
_BLOCK_MS: Final = 100
"""Maximum milliseconds for which a reader that does not acknowledge may block the robot."""
_REQUESTS_AT_ONCE: Final = 32
"""Queue length of one service; older requests are lost, as in a ROS node, which keeps 10."""
_LONGEST_REQUEST: Final = 1_000_000
_ALIGNMENT: Final = 4
"""Messages are padded to a multiple of this many bytes."""


def profile(address: str, peers: Sequence[str], participants: int) -> str:
    """Return Cyclone's configuration: this computer's address in the robots' network, and its peers.

    Multicast stays enabled for discovery only, so that robots without a profile are also found.
    """
    rows = "".join(f'<Peer Address="{peer}"/>' for peer in dict.fromkeys((*peers, address)))
    return (
        '<CycloneDDS><Domain Id="any"><General><Interfaces>'
        f'<NetworkInterface address="{address}"/></Interfaces><AllowMulticast>spdp</AllowMulticast></General>'
        f"<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>{participants}"
        f"</MaxAutoParticipantIndex><SPDPInterval>{ANNOUNCE_S}s</SPDPInterval><LeaseDuration>{_LEASE_S}s</LeaseDuration><InitialLocatorPruneDelay>inf</InitialLocatorPruneDelay><Peers>{rows}</Peers></Discovery><Tracing><Verbosity>none</Verbosity></Tracing></Domain></CycloneDDS>"
    )


@contextmanager
def domain(number: int, configuration: str) -> Iterator[int]:
    """Open a DDS domain with its own profile, whatever the environment variables contain. Raises UsageError."""
    try:
        from cyclonedds.core import DDSException  # noqa: PLC0415 - there is none for aarch64
    except ImportError as error:
        hint = "PyPI has no package for aarch64: use a laptop with an x86_64 processor"
        raise UsageError("cyclonedds is not installed on this computer", hint=hint) from error
    try:
        participant = listener.open_domain(number, configuration)
    except DDSException as error:
        hint = "check that the address belongs to this computer, and that the interface is up: `ip address` shows both"
        raise UsageError(f"a DDS participant cannot be created here: {arg(error)}", hint=hint) from error
    try:
        yield number
    finally:
        del participant


class RobotListener:
    """Records every publisher of a domain, and counts the messages of known types."""

    def __init__(
        self,
        number: int,
        types: MessageTypes,
        configuration_topic: str,
        address: str | None = None,
        keep: Callable[[observation.HeardWriter, bytes], None] | None = None,
    ) -> None:
        """`address`: this computer's, to detect other domains too; `keep` is called with every message."""

        def keep_row(row: Mapping[str, Any], data: bytes) -> None:
            if keep is not None:
                names = ("participant", "topic", "type", "reliable", "transient_local")
                keep(observation.HeardWriter(*(row[name] for name in names)), data)

        self._listener = listener.CycloneListener(
            number, types, configuration_topic, keep_row if keep is not None else None
        )
        self._others = listener.OtherDomains(number, address) if address is not None else None

    def listen(self, seconds: float) -> observation.RobotObservation:
        """Listen for this many seconds; return everything received since the start."""
        return observation.read_heard(listener.listen(self._listener, seconds, self._others))

    async def listen_beside_others(self, seconds: float) -> observation.RobotObservation:
        """Listen for this many seconds without blocking other tasks."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self._listener.poll(pause_s=0)
            if self._others is not None:
                self._others.poll()
            await asyncio.sleep(listener.POLL_S)
        return observation.read_heard(listener.mapping_of(self._listener, self._others))


class Publisher:
    """One participant that publishes ROS messages and offers ROS services."""

    def __init__(self, number: int, types: MessageTypes) -> None:
        from cyclonedds.domain import DomainParticipant  # noqa: PLC0415 - as above

        self._participant = DomainParticipant(number)
        self._types = types
        self._writers: dict[str, Any] = {}

    def advertise(
        self, topic: str, kind: str, *, reliable: bool = False, transient_local: bool = False, depth: int = _DEPTH
    ) -> None:
        """Create the publisher of a topic; a transient-local one sends its last messages to late joiners."""
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
        """Send a message on a ROS topic; its publisher is created with the first message."""
        if topic not in self._writers:
            self.advertise(topic, kind)
        self.send(topic, message)

    def send(self, topic: str, message: Any) -> bool:  # noqa: ANN401 - a message
        """Send a message on an advertised topic; return False if a reliable reader does not accept it."""
        return _write(self._writers[topic], message)

    def service(self, name: str, kind: str) -> RosService:
        """Offer a ROS service."""
        return RosService(self._participant, self._types, name, kind)


class RosService:
    """One ROS service, with requests and replies in the format of rmw_cyclonedds."""

    def __init__(self, participant: Any, types: MessageTypes, name: str, kind: str) -> None:  # noqa: ANN401 - of cyclonedds
        from cyclonedds.core import Policy, Qos  # noqa: PLC0415 - as above
        from cyclonedds.util import duration  # noqa: PLC0415 - as above

        reliable = Policy.Reliability.Reliable(duration(milliseconds=_BLOCK_MS))
        qos = Qos(reliable, Policy.History.KeepLast(_REQUESTS_AT_ONCE))
        self._type = types.idl(f"{kind}_Request")
        self._reader = listener.octets_reader(
            participant, f"rq{name}Request", types.unchecked_type(f"{kind}_Request"), qos
        )
        self._writer = _writer(participant, f"rr{name}Reply", types.idl(f"{kind}_Response"), qos)

    def requests(self) -> Iterator[Any]:
        """Yield new requests; None for a request with an invalid format."""
        for sample in self._reader.take(N=_REQUESTS_AT_ONCE):
            if sample.sample_info.valid_data:
                data = sample.data if len(sample.data) <= _LONGEST_REQUEST else b""
                message = listener.decode(self._type, data)
                is_whole = message is not None and 0 <= len(data) - len(message.serialize()) < _ALIGNMENT
                yield message if is_whole else None

    def reply(self, request: Any, message: Any) -> None:  # noqa: ANN401 - messages
        """Send the reply to a request."""
        message.client, message.number = request.client, request.number
        _write(self._writer, message)


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
