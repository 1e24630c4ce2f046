"""Observed robots, compared with their files. Pure: nothing here listens."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Final

from pydantic import TypeAdapter

from atlantis_netcfg.core.errors import nearest
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, conjunction, join, msg
from atlantis_netcfg.inventory.robots.reading import read_published
from atlantis_netcfg.inventory.rules.vehicles import beside_guideline
from atlantis_netcfg.links import LinkFinding

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from atlantis_netcfg.inventory.model.robot import PublishedTopic, RobotFile
    from atlantis_netcfg.inventory.robots.key_names import KeyNames
    from atlantis_netcfg.inventory.robots.reading import RobotSource

_CONFIGURATION_HZ: Final = (0.8, 1.25)
"""Accepted rates for the report's 1 Hz (3.4), with tolerance for a laptop's clock and a busy robot."""
_FEWEST: Final = 3
"""Minimum number of messages from which a rate is computed."""
_TOLERANCE: Final = 1.1
"""Tolerance factor for measured rates compared with a guideline."""
_CHECK_ITS_FILE: Final = "ask its partner for the published file, and check it: `provision robot validate`"
_MOST_FOREIGN: Final = 3
"""Maximum number of addresses in other domains that are reported for a missing robot."""
_SURELY_FROZEN: Final = 10
"""Number of identical messages from which coincidence is ruled out."""
_PAUSE_S: Final = 5.0
_PAUSE_PERIODS: Final = 5
"""A pause longer than both limits, while the robot's other topics continue, means that the topic has ended."""
_STALE_S: Final = 5.0
"""A larger difference between stamp and arrival time means a different clock or an old message."""


@dataclass(slots=True)
class HeardWriter:
    """One publisher of a topic, and what it sent during the observation."""

    participant: str
    topic: str
    type: str
    """Type name; in ROS notation if it is a ROS type."""
    reliable: bool = False
    transient_local: bool = False
    """Whether the last messages are kept for late joiners."""
    messages: int = 0
    octets: int = 0
    """Serialised bytes of all messages."""
    first_s: float = 0.0
    last_s: float = 0.0
    contents: set[bytes] = field(default_factory=set)
    """Short hashes of different messages, without the stamp; at most 3 are kept."""
    stamp_age_s: float | None = None
    """Largest age of a stamp on arrival; None: the messages have no stamp."""

    @property
    def rate_hz(self) -> float | None:
        """Messages per second; None if there are too few."""
        if self.messages < _FEWEST or self.last_s <= self.first_s:
            return None
        return (self.messages - 1) / (self.last_s - self.first_s)

    @property
    def size_bytes(self) -> int:
        """Average size of a message."""
        return round(self.octets / self.messages) if self.messages else 0


@dataclass(slots=True)
class HeardConfiguration:
    """A configuration published by a participant."""

    writer: HeardWriter
    text: bytes = field(repr=False)
    """The latest configuration. It contains the robot's token and is never shown."""


@dataclass(slots=True)
class RobotObservation:
    """Everything observed during one listening period."""

    seconds: float
    participants: dict[str, str] = field(default_factory=dict)
    """Maps a participant's key to the addresses that it announces."""
    writers: list[HeardWriter] = field(default_factory=list)
    configurations: list[HeardConfiguration] = field(default_factory=list)
    unread: dict[str, str] = field(default_factory=dict)
    """Topics whose type definition is unknown: detected, but their messages are not counted."""
    program: str = "cyclonedds"
    """Listening library: `cyclonedds`, or `rclpy`, which does not report a message's sender (`listener.py`)."""
    other_domains: dict[str, list[int]] = field(default_factory=dict)
    """Addresses whose participants were seen announcing themselves in other domains."""


class RobotState(StrEnum):
    """Status of a robot relative to this inventory."""

    DECLARED = "declared"
    UNKNOWN = "unknown"
    MISSING = "missing"


@dataclass(frozen=True, slots=True)
class RobotReport:
    """One robot: its status in the inventory, and the findings."""

    namespace: str
    state: RobotState
    vehicle: str | None
    findings: tuple[LinkFinding, ...]
    topics: tuple[HeardWriter, ...] = ()

    @property
    def verdict(self) -> Verdict:
        """The worst verdict of the findings; PASS if there are none."""
        order = (Verdict.FAIL, Verdict.INCONCLUSIVE, Verdict.WARN)
        return next(
            (verdict for verdict in order if any(each.verdict is verdict for each in self.findings)), Verdict.PASS
        )


def judge(
    observation: RobotObservation,
    sources: Sequence[RobotSource],
    expected_vehicles: Sequence[str],
    names: KeyNames,
    past_guests: Mapping[str, str] | None = None,
) -> list[RobotReport]:
    """Compare the observation with the robot files; `expected_vehicles` should be present.

    `past_guests`: former guest vehicles and the last day of each; they count as unknown again.
    """
    past = past_guests or {}
    sources_by_name = {source.robot.name: source for source in sources if source.robot is not None}
    introductions: dict[str, list[tuple[HeardConfiguration, RobotFile]]] = {}
    reports = []
    for configuration in observation.configurations:
        robot, error = read_published(configuration.text, names)
        if robot is None:
            who = observation.participants.get(configuration.writer.participant, "an unknown address")
            message = msg(f"{arg(who)} publishes a configuration that cannot be read: {arg(error)}")
            finding = LinkFinding(Verdict.FAIL, "configuration-unreadable", message, _CHECK_ITS_FILE)
            reports.append(RobotReport(who, RobotState.UNKNOWN, None, (finding,)))
        else:
            introductions.setdefault(robot.name, []).append((configuration, robot))
    for name, copies in introductions.items():
        configuration, robot = copies[-1]
        source = sources_by_name.get(name)
        findings = [*_check_duplicates(name, copies, observation), *_check_configuration_rate(configuration)]
        if source is None:
            findings.append(_unknown(name, sources_by_name))
        elif source.vehicle in past:
            findings.append(_past_guest(str(source.vehicle), past))
        else:
            findings += _against_the_file(robot, source)
        keys = {each.writer.participant for each, _ in copies}
        # Another process of the robot is another participant: what has the name of a topic of its file is its.
        topics = {topic.name for topic in robot.topics()}
        writers = [each for each in observation.writers if each.participant in keys or each.topic in topics]
        findings += [finding for _, finding in topic_findings(robot, writers, observation)]
        state = RobotState.UNKNOWN if source is None or source.vehicle in past else RobotState.DECLARED
        vehicle = source.vehicle if source is not None else None
        reports.append(RobotReport(name, state, vehicle, tuple(findings), tuple(writers)))
    here = {report.vehicle for report in reports}
    reports += [
        _missing_robot_report(source, observation)
        for source in sources_by_name.values()
        if source.vehicle in {*expected_vehicles} - here
    ]
    return sorted(reports, key=lambda report: (report.state != RobotState.DECLARED, report.namespace))


def _missing_robot_report(source: RobotSource, observation: RobotObservation) -> RobotReport:
    name = source.robot.name if source.robot is not None else str(source.vehicle)
    declared_topics = {topic.name for topic in source.robot.topics()} if source.robot is not None else set()
    topic = next((writer.topic for writer in observation.writers if writer.topic in declared_topics), None)
    message = msg(f"nothing was received from it in {arg(observation.seconds):.0f} s")
    hint = "check that it is switched on, in the network, and in the domain of `dds.domain`"
    findings = [LinkFinding(Verdict.INCONCLUSIVE, "robot-missing", message, hint)]
    if topic is not None:
        message = msg(f"a robot publishes {arg(topic)}, but its configuration was not received")
        hint = "a registered robot stops publishing it: restart its program"
        findings = [LinkFinding(Verdict.INCONCLUSIVE, "configuration-missing", message, hint)]
    for address, domains in list(observation.other_domains.items())[:_MOST_FOREIGN]:
        message = msg(
            f"{arg(address)} uses domain {arg(join(', ', map(str, domains)))}, which is not that of `dds.domain`"
        )
        hint = "if that is this robot: set its ROS_DOMAIN_ID as in the inventory, and restart its programs"
        findings.append(LinkFinding(Verdict.INCONCLUSIVE, "other-domain", message, hint))
    return RobotReport(name, RobotState.MISSING, source.vehicle, tuple(findings))


def _unknown(name: str, sources_by_name: Mapping[str, RobotSource]) -> LinkFinding:
    near = nearest(name, sources_by_name)
    message = msg(f"no robot of this inventory has the namespace `{arg(name)}`")
    if near is not None:
        message = msg(f"no robot of this inventory has the namespace `{arg(name)}`; did it mean `{arg(near)}`?")
    hint = msg(
        f"if a person approves it: `provision robot invite name={arg(vehicle_key(name))} partner=PARTNER kind=auv "
        f"until=DAY site=… cells=wifi` with its own values, then `provision robot discover site=… save={arg(name)}`"
    )
    return LinkFinding(Verdict.WARN, "robot-unknown", message, hint)


def vehicle_key(namespace: str) -> str:
    """Return a robot's key among the vehicles of the inventory, which is also the name of its file."""
    return re.sub(r"[^a-z0-9]+", "-", namespace.lower()).strip("-")


def _past_guest(vehicle: str, past: Mapping[str, str]) -> LinkFinding:
    message = msg(f"it was a guest until {arg(past[vehicle])}")
    return LinkFinding(
        Verdict.WARN, "robot-unknown", message, msg(f"`provision robot dismiss name={arg(vehicle)}` removes it")
    )


def _check_duplicates(
    name: str, copies: Sequence[tuple[HeardConfiguration, RobotFile]], observation: RobotObservation
) -> Iterator[LinkFinding]:
    keys = dict.fromkeys(configuration.writer.participant for configuration, _ in copies)
    if len(keys) > 1:
        where = conjunction(observation.participants.get(key, "an unknown address") for key in keys)
        message = msg(f"{arg(len(keys))} participants announce themselves as `{arg(name)}`: {arg(where)}")
        yield LinkFinding(Verdict.FAIL, "namespace-twice", message, "give each robot its own namespace")


def _check_configuration_rate(configuration: HeardConfiguration) -> Iterator[LinkFinding]:
    rate = configuration.writer.rate_hz
    low, high = _CONFIGURATION_HZ
    if rate is None:
        message = msg(
            f"its configuration was received {arg(configuration.writer.messages)} times: too few to determine the rate"
        )
        yield LinkFinding(Verdict.INCONCLUSIVE, "configuration-rate-unknown", message, "listen for longer: `for=60s`")
    elif not low <= rate <= high:
        message = msg(f"its configuration comes at {arg(rate):.2g} Hz; the report says 1 Hz")
        yield LinkFinding(Verdict.FAIL, "configuration-rate", message, "check the program that publishes it")


def _against_the_file(robot: RobotFile, source: RobotSource) -> Iterator[LinkFinding]:
    """Yield differences between a robot and its file; the token is compared if it could be decrypted."""
    file = source.robot
    if file is None:
        return
    if source.token_is_sealed:
        message = "its token is encrypted in the vault, and was not compared"
        hint = "`provision robot discover site=… --ask-vault-pass` compares it"
        yield LinkFinding(Verdict.WARN, "token-sealed", message, hint)
    elif robot.token != file.token:
        message = "its token differs from the one in its file"
        yield LinkFinding(Verdict.FAIL, "token", message, "ask its partner: another robot may be using its name")
    token_update = {"token": file.token}
    if robot.model_copy(update=token_update) != file:
        message = "its configuration differs from its file"
        yield LinkFinding(Verdict.FAIL, "configuration-differs", message, _CHECK_ITS_FILE)


def topic_findings(
    robot: RobotFile, writers: Sequence[HeardWriter], observation: RobotObservation
) -> Iterator[tuple[PublishedTopic, LinkFinding]]:
    """Yield findings on each topic in a robot's configuration; `writers` are that robot's publishers."""
    for topic in robot.topics():
        rows = [writer for writer in writers if writer.topic == topic.name]
        if not rows:
            message = msg(f"it does not publish {arg(topic.name)}, which its configuration lists")
            hint = "check the program that publishes it"
            yield topic, LinkFinding(Verdict.FAIL, "topic-missing", message, hint)
        elif observation.unread.get(topic.name) == topic.message_type:
            message = msg(f"the type of {arg(topic.name)} is unknown here, so its messages were not counted")
            hint = msg(f"put {arg(observation.unread[topic.name])} into robots/interfaces of the inventory")
            yield topic, LinkFinding(Verdict.INCONCLUSIVE, "topic-unread", message, hint)
        else:
            for writer in rows:
                yield from ((topic, finding) for finding in _check_topic(topic, writer, observation.seconds))
            yield from ((topic, finding) for finding in _check_silence(topic, rows, writers))


def _check_silence(
    topic: PublishedTopic, rows: Sequence[HeardWriter], writers: Sequence[HeardWriter]
) -> Iterator[LinkFinding]:
    """Report a topic that stopped while the robot's other topics continued; a robot switched off is not reported."""
    rates = [writer.rate_hz for writer in rows if writer.rate_hz]
    silence_s = max(writer.last_s for writer in writers) - max(writer.last_s for writer in rows)
    if rates and silence_s > max(_PAUSE_S, _PAUSE_PERIODS / min(rates)):
        message = msg(f"no message was received on {arg(topic.name)} in the last {arg(silence_s):.0f} s of the robot")
        yield LinkFinding(Verdict.FAIL, "topic-silent", message, "check the program that publishes it")


def _check_topic(topic: PublishedTopic, writer: HeardWriter, seconds: float) -> Iterator[LinkFinding]:
    if writer.type != topic.message_type:
        message = msg(
            f"{arg(topic.name)} has the type {arg(writer.type)}; its configuration says {arg(topic.message_type)}"
        )
        yield LinkFinding(Verdict.FAIL, "topic-type", message, "set `type:` of the topic, or correct the program")
        return
    rate = writer.rate_hz
    if not writer.messages:
        message = msg(f"no message was received on {arg(topic.name)} in {arg(seconds):.0f} s, although it is published")
        yield LinkFinding(Verdict.FAIL, "topic-silent", message, "check the program that publishes it")
        return
    if rate is None and beside_guideline(topic.kind.data, 0.0) is not None:
        message = msg(
            f"{arg(topic.name)} was received {arg(writer.messages)} times in {arg(seconds):.0f} s: too few to "
            "determine its rate"
        )
        yield LinkFinding(Verdict.INCONCLUSIVE, "topic-rate-unknown", message, "listen for longer: `for=60s`")
    if rate is not None:
        way, guideline = beside_guideline(topic.kind.data, rate) or ("", "")
        is_near = beside_guideline(topic.kind.data, rate / _TOLERANCE if way == "above" else rate * _TOLERANCE) is None
        if way and not is_near:
            message = msg(f"{arg(topic.name)} comes at {arg(rate):.2g} Hz, below the report's guideline")
            if way == "above":
                message = msg(f"{arg(topic.name)} comes at {arg(rate):.2g} Hz, above the report's guideline")
            yield LinkFinding(Verdict.WARN, f"topic-rate-{way}", message, msg(f"{arg(guideline)} (report, 3.3.3)"))
    if topic.kind.moves and writer.messages < _FEWEST and len(writer.contents) == 1:
        message = msg(
            f"{arg(topic.name)} was received {arg(writer.messages)} times: too few to tell whether it changes"
        )
        yield LinkFinding(Verdict.INCONCLUSIVE, "topic-frozen", message, "listen for longer: `for=60s`")
    elif topic.kind.moves and len(writer.contents) == 1:
        # A receiver on the quay may give one position a few times; ten in a row is nobody's navigation.
        verdict = Verdict.FAIL if writer.messages >= _SURELY_FROZEN else Verdict.WARN
        message = msg(f"{arg(topic.name)} has the same value in all {arg(writer.messages)} messages")
        hint = "a robot on the water is never completely still: check that its navigation is running"
        yield LinkFinding(verdict, "topic-frozen", message, hint)
    if writer.stamp_age_s is not None and abs(writer.stamp_age_s) > _STALE_S:
        message = msg(
            f"the stamps of {arg(topic.name)} are {arg(abs(writer.stamp_age_s)):.0f} s away from the listener's clock"
        )
        hint = "compare the clocks of the robot and of the computer that listens"
        yield LinkFinding(Verdict.FAIL, "topic-stale", message, hint)


def read_heard(values: object) -> RobotObservation:
    """Validate the result of a listener (`listener.listen`), possibly from another computer. Raises ValueError."""
    return TypeAdapter(RobotObservation).validate_python(values)
