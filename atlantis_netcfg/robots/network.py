"""Participants of DDS on this computer: a listener that hears robots, and mock robots that are heard.

cyclonedds is driven by polling in one thread. A domain is configured once a process, before its first participant.
"""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final

from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.robots.listener import CycloneListener, OtherDomains, listen, open_domain
from atlantis_netcfg.robots.observation import read_heard

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from atlantis_netcfg.robots.message_types import MessageTypes
    from atlantis_netcfg.robots.observation import Observation

ANNOUNCE_S: Final = 10
_LEASE_S: Final = 120
"""Longer than a satellite is silent: after that messages come again, without finding each other anew."""


def profile(address: str, peers: Sequence[str], participants: int) -> str:
    """Cyclone's configuration of this computer: its address in the robots' network, and where robots may be.

    Multicast is left on for discovery alone, so that robots without a profile are heard as well.
    """
    rows = "".join(f'<Peer Address="{peer}"/>' for peer in dict.fromkeys((*peers, address)))
    return (
        '<CycloneDDS><Domain Id="any"><General><Interfaces>'
        f'<NetworkInterface address="{address}"/></Interfaces><AllowMulticast>spdp</AllowMulticast></General>'
        f"<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>{participants}"
        f"</MaxAutoParticipantIndex><SPDPInterval>{ANNOUNCE_S}s</SPDPInterval><LeaseDuration>{_LEASE_S}s</LeaseDuration>"
        f"<InitialLocatorPruneDelay>inf</InitialLocatorPruneDelay><Peers>{rows}</Peers></Discovery>"
        "<Tracing><Verbosity>none</Verbosity></Tracing></Domain></CycloneDDS>"
    )


@contextmanager
def domain(number: int, configuration: str) -> Iterator[int]:
    """A domain of DDS with a profile of its own, whatever this computer's environment says. Raises UsageError."""
    try:
        from cyclonedds.core import DDSException  # noqa: PLC0415 - there is none for aarch64
    except ImportError as error:
        hint = "PyPI has none for aarch64: use a laptop with an x86_64 processor"
        raise UsageError("cyclonedds is not installed on this computer", hint=hint) from error
    try:
        made = open_domain(number, configuration)
    except DDSException as error:
        hint = "is the address one of this computer's, and the interface up? `ip address` shows both"
        raise UsageError(f"no participant of DDS can be made here: {error}", hint=hint) from error
    try:
        yield number
    finally:
        del made


class RobotListener:
    """Hears every publisher of a domain, and counts the messages of those whose type is known."""

    def __init__(self, number: int, types: MessageTypes, configuration_topic: str, address: str | None = None) -> None:
        """`address`: of this computer, where other domains are listened to as well."""
        self._listener = CycloneListener(number, types, configuration_topic)
        self._others = OtherDomains(number, address) if address is not None else None

    def listen(self, seconds: float) -> Observation:
        """Listen so long, and say what was heard since the beginning."""
        return read_heard(listen(self._listener, seconds, self._others))


class Publisher:
    """One participant that publishes messages of ROS."""

    def __init__(self, number: int, types: MessageTypes) -> None:
        from cyclonedds.domain import DomainParticipant  # noqa: PLC0415 - as above

        self._participant = DomainParticipant(number)
        self._types = types
        self._writers: dict[str, Any] = {}

    def publish(self, topic: str, kind: str, message: Any, *, reliable: bool = False) -> None:  # noqa: ANN401 - a message
        """Send a message on a topic of ROS, whose publisher is made with the first one."""
        from cyclonedds.core import Policy, Qos  # noqa: PLC0415 - as above
        from cyclonedds.pub import DataWriter  # noqa: PLC0415 - as above
        from cyclonedds.topic import Topic  # noqa: PLC0415 - as above
        from cyclonedds.util import duration  # noqa: PLC0415 - as above

        if topic not in self._writers:
            reliability = (
                Policy.Reliability.Reliable(duration(seconds=1)) if reliable else Policy.Reliability.BestEffort
            )
            made = Topic(self._participant, f"rt{topic}", self._types.idl(kind))
            self._writers[topic] = DataWriter(self._participant, made, qos=Qos(reliability, Policy.History.KeepLast(5)))
        self._writers[topic].write(message)
