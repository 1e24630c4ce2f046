"""Checks a robot's published data against its file, here and at the control centre, and its VPN membership.

All items of a list share one listening period. Each finding (`robots/observation.py`) belongs to exactly one item.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.checklist.probes import base
from atlantis_netcfg.checklist.report import ItemKind, Phase
from atlantis_netcfg.core.errors import fill_hint
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.inventory.model import ControlCentre
from atlantis_netcfg.inventory.model.robot import TopicKind
from atlantis_netcfg.links import LinkFinding
from atlantis_netcfg.robots.observation import RobotState, topic_findings

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping

    from atlantis_netcfg.checklist.probes.robot_files import RobotFiles
    from atlantis_netcfg.checklist.report import Evidence
    from atlantis_netcfg.inventory.model.robot import PublishedTopic
    from atlantis_netcfg.robots.observation import HeardWriter, RobotObservation, RobotReport


class RobotItem(StrEnum):
    """Items to which findings belong, by the last part of their ids."""

    DISCOVERED = "discovered"
    TELEMETRY = "telemetry"
    POSE = "pose"
    RATES = "rates"
    STRANGERS = "strangers"


_CODES: Mapping[RobotItem, tuple[str, ...]] = {
    RobotItem.DISCOVERED: (
        *("robot-missing", "other-domain", "namespace-twice", "token", "token-sealed"),
        *(f"configuration-{what}" for what in ("missing", "rate", "rate-unknown", "differs")),
    ),
    RobotItem.TELEMETRY: ("topic-missing", "topic-silent", "topic-type", "topic-unread", "topic-stale"),
    RobotItem.POSE: ("topic-frozen",),
    RobotItem.RATES: ("topic-rate-above", "topic-rate-below", "topic-rate-unknown"),
    RobotItem.STRANGERS: ("robot-unknown", "configuration-unreadable"),
}
ITEM_OF: Mapping[str, RobotItem] = {code: item for item, codes in _CODES.items() for code in codes}
"""Finding code -> item; telemetry findings on a pose or a position belong to the pose."""
MOVING: Final = frozenset(kind for kind in TopicKind if kind.moves)
_LONGER = "listen for longer: `for=60s`"
_TITLES: Mapping[RobotItem, str] = {
    RobotItem.TELEMETRY: "Its telemetry is received",
    RobotItem.POSE: "Its pose and position are received, and change",
    RobotItem.RATES: "It publishes at the rate that the report gives",
}


def item_of(code: str, kind: TopicKind) -> RobotItem:
    """Return the item to which a finding about a topic belongs."""
    item = ITEM_OF[code]
    return RobotItem.POSE if item is RobotItem.TELEMETRY and kind.moves else item


def steps(cell: base.Cell) -> tuple[base.Step, ...]:
    """Return a robot's steps, one per need of a control centre; for the location, that no unknown robot is detected."""
    if cell.robots is None:
        return ()
    if cell.vehicle is None:
        return (
            _automatic("strangers", "Only robots of the inventory are discovered", _Strangers(cell.robots, cell.site)),
        )
    if cell.vehicle not in cell.robots.sources:
        return (unreadable(cell),)
    return (
        vpn_step("vpn", cell),
        discovery_step("discovered", cell),
        _control_centre_step(cell),
        _topics_step(cell, RobotItem.TELEMETRY, frozenset(TopicKind) - MOVING),
        _topics_step(cell, RobotItem.POSE, MOVING),
        _topics_step(cell, RobotItem.RATES, frozenset(TopicKind)),
    )


def _automatic(name: str, title: str, probe: base.Probe, unless: str = "") -> base.Step:
    phase = Phase.QUAY if name == RobotItem.POSE else Phase.BENCH
    return base.Step(name, title, ItemKind.AUTOMATIC, phase, None if unless else probe, unless=unless)


def unreadable(cell: base.Cell) -> base.Step:
    """Return the only step of a robot whose file has errors, so that its expected data are unknown."""
    return _automatic("discovered", "It is discovered, and matches its file", _BrokenFile(cell.row))


def vpn_step(name: str, cell: base.Cell) -> base.Step:
    """Return the step for the robot's own VPN membership, if it has one."""
    behind = cell.site if cell.address(None) is not None else ""
    return _automatic(name, "Its VPN member is connected", _VpnOfRobot(cell.row, cell.name, behind))


def discovery_step(name: str, cell: base.Cell, host: str = "") -> base.Step:
    """Return the step that the robot announces itself as in its file; `host` listens, or this computer if empty."""
    assert cell.robots is not None  # noqa: S101 - the caller checks it
    title = "It is discovered at the control centre" if host else "It is discovered, and matches its file"
    return _automatic(name, title, _DiscoveryProbe(cell.robots, cell.row, cell.name, cell.site, host))


def _control_centre_step(cell: base.Cell) -> base.Step:
    hosts = cell.inventory.hosts.items()
    centre = next((name for name, host in hosts if isinstance(host.device, ControlCentre)), None)
    if centre is not None:
        return discovery_step("control-centre", cell, centre)
    return base.Step(
        name="control-centre",
        title="It is discovered at the control centre",
        kind=ItemKind.PERSON,
        phase=Phase.BENCH,
        do="The inventory has no control centre: check an operator's screen.",
        look_for="The robot is offered there under its name, and an operator can accept it.",
    )


def _topics_step(cell: base.Cell, item: RobotItem, kinds: frozenset[TopicKind]) -> base.Step:
    assert cell.robots is not None  # noqa: S101 - the caller checks it
    robot = cell.robots.robot(cell.row)
    if item is RobotItem.POSE and robot.pose.library and not any(topic.kind in kinds for topic in robot.topics()):
        return pose_of_the_library(item, Phase.QUAY)
    probe = _TopicsProbe(cell.robots, cell.row, cell.name, cell.site, kinds, frozenset({item}))
    unless = "" if probe.topics() else "its file names no such topic"
    return _automatic(item, _TITLES[item], probe, unless)


def pose_of_the_library(name: str, phase: Phase) -> base.Step:
    """Return the step for a pose in the library's format, whose topic is unknown here."""
    return base.Step(
        name=name,
        title="Its pose is shown, and changes",
        kind=ItemKind.PERSON,
        phase=phase,
        do="Its pose goes through the library, on an unknown topic: move the robot, and check an operator's map.",
        look_for="The map shows the robot where it is, and moving as it moves.",
    )


def topics_step(name: str, title: str, cell: base.Cell, kind: TopicKind) -> base.Step:
    """Return the step for one kind of topics: received, of the right type, current, at the right rate."""
    assert cell.robots is not None  # noqa: S101 - the caller checks it
    probe = _TopicsProbe(cell.robots, cell.row, cell.name, cell.site, frozenset({kind}), frozenset(RobotItem))
    return _automatic(name, title, probe)


def _observation(answer: base.Answer | None, host: str) -> RobotObservation | LinkFinding:
    if not isinstance(answer, base.RobotsHeardResult) or answer.observation is None:
        return replace(base.no_answer_finding(host or "this computer", answer), code="not-listened")
    return answer.observation


def _complete_hint(finding: LinkFinding, site: str) -> LinkFinding:
    """Complete a hint with a command that can be typed while a checklist is open."""
    again = msg(f"`provision robot discover site={arg(site)} for=60s` listens for longer")
    return replace(finding, hint=again if finding.hint == _LONGER else fill_hint(finding.hint or "", site=site))


def _evidence(writers: Collection[HeardWriter]) -> Iterator[Evidence]:
    for writer in writers:
        rate = "rate unknown" if writer.rate_hz is None else f"{writer.rate_hz:.2g} Hz"
        yield base.measured_evidence(
            writer.topic,
            msg(f"{arg(rate)}, {arg(writer.messages)} messages of {arg(writer.size_bytes)} bytes, {arg(writer.type)}"),
        )


@dataclass(frozen=True, slots=True)
class _BrokenFile:
    """Check that the robot's file is valid."""

    vehicle: str

    def asks(self) -> tuple[base.Question, ...]:
        return ()

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:  # noqa: ARG002 - as every probe has it
        message = msg(f"the file of {arg(self.vehicle)} has errors, so nothing can be compared with it")
        hint = msg(f"`provision robot validate vehicle={arg(self.vehicle)}` lists them")
        return base.ProbeResult((LinkFinding(Verdict.INCONCLUSIVE, "file-unreadable", message, hint),))


@dataclass(frozen=True, slots=True)
class _VpnOfRobot:
    """Check that the robot's own VPN member is connected."""

    vehicle: str
    name: str
    behind: str
    """The site in whose LAN it has an address; empty: none."""

    def asks(self) -> tuple[base.Question, ...]:
        return (base.VpnMembersRequest("members"),)

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        answer = results["members"]
        if not isinstance(answer, base.VpnMembersResult) or answer.trouble is not None:
            return base.ProbeResult((base.no_answer_finding("the VPN server", answer),))
        members = [member for member in answer.members if member.vehicle == self.vehicle]
        session = next((member for member in members if member.session), None)
        if session is not None:
            message = msg(f"{arg(session.name)} is connected to the VPN server")
            evidence = base.read("session at the VPN server", msg(f"{arg(session.name)} from {arg(session.session)}"))
            return base.ProbeResult((LinkFinding(Verdict.PASS, "member-connected", message),), (evidence,))
        if not members and self.behind:
            text = msg(
                f"{arg(self.name)} is not a VPN member: it is in the LAN of {arg(self.behind)}, behind its router"
            )
            return base.ProbeResult((LinkFinding(Verdict.SKIP, "behind-router", text),))
        return base.ProbeResult(
            (self._not_connected_finding([member.name for member in members if member.has_certificate]),)
        )

    def _not_connected_finding(self, member_names: Collection[str]) -> LinkFinding:
        status = "`provision vpn status` shows all members and who is connected"
        if not member_names:
            message = msg(f"{arg(self.name)} has no valid VPN certificate, and no address in the LAN of the site")
            if self.behind:
                message = msg(f"all VPN certificates of {arg(self.name)} are revoked")
            return LinkFinding(Verdict.FAIL, "no-member", message, status)
        message = msg(f"{arg(join(', ', member_names))} is not connected to the VPN server")
        return LinkFinding(Verdict.FAIL, "member-away", message, msg(f"start OpenVPN on the robot; {arg(status)}"))


@dataclass(frozen=True, slots=True)
class _OfRobot:
    """Base of the probes of one robot."""

    robots: RobotFiles
    vehicle: str
    name: str
    site: str


@dataclass(frozen=True, slots=True)
class _DiscoveryProbe(_OfRobot):
    """Check that the robot announces itself once a second, under a unique name, as in its file."""

    host: str = ""

    def asks(self) -> tuple[base.Question, ...]:
        return (base.RobotsHeardRequest("heard", self.host),)

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        observation = _observation(results["heard"], self.host)
        if isinstance(observation, LinkFinding):
            return base.ProbeResult((observation,))
        report = self.robots.report(self.vehicle, observation)
        wrong = [each for each in report.findings if ITEM_OF[each.code] is RobotItem.DISCOVERED]
        evidence = tuple(self._configuration_evidence(report, observation))
        if wrong:
            return base.ProbeResult(tuple(_complete_hint(each, self.site) for each in wrong), evidence)
        text = msg(f"{arg(self.name)} announces itself as its file says")
        return base.ProbeResult((LinkFinding(Verdict.PASS, "introduced", text),), evidence)

    @staticmethod
    def _configuration_evidence(report: RobotReport, observation: RobotObservation) -> Iterator[Evidence]:
        keys = {writer.participant for writer in report.topics}
        for configuration in observation.configurations:
            writer = configuration.writer
            if writer.participant in keys:
                where = observation.participants.get(writer.participant, "an unknown address")
                yield base.measured_evidence(
                    msg(f"configuration from {arg(where)}"),
                    msg(f"{arg(writer.messages)} in {arg(observation.seconds):.0f} s"),
                )


@dataclass(frozen=True, slots=True)
class _TopicsProbe(_OfRobot):
    """Check that topics in the robot's file are received from it as expected."""

    kinds: frozenset[TopicKind]
    items: frozenset[RobotItem]
    """Items whose findings count."""

    def topics(self) -> tuple[PublishedTopic, ...]:
        """Return the selected topics of the robot's file."""
        return tuple(topic for topic in self.robots.robot(self.vehicle).topics() if topic.kind in self.kinds)

    def asks(self) -> tuple[base.Question, ...]:
        return (base.RobotsHeardRequest("heard"),)

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        observation = _observation(results["heard"], "")
        if isinstance(observation, LinkFinding):
            return base.ProbeResult((observation,))
        report = self.robots.report(self.vehicle, observation)
        if report.state is RobotState.MISSING:
            message = msg(f"{arg(self.name)} was not discovered, so what it publishes is unknown")
            hint = "get it discovered first, then check again"
            return base.ProbeResult((LinkFinding(Verdict.INCONCLUSIVE, "not-introduced", message, hint),))
        names = [topic.name for topic in self.topics()]
        writers = [writer for writer in report.topics if writer.topic in names and writer.messages]
        wrong = tuple(
            _complete_hint(finding, self.site)
            for topic, finding in topic_findings(self.robots.robot(self.vehicle), report.topics, observation)
            if topic.kind in self.kinds and item_of(finding.code, topic.kind) in self.items
        )
        return base.ProbeResult(wrong or (self._summary_finding(names, writers),), tuple(_evidence(writers)))

    def _summary_finding(self, names: Collection[str], writers: Collection[HeardWriter]) -> LinkFinding:
        topics = {writer.topic for writer in writers}
        if not topics:
            message = msg(f"none of {arg(join(', ', names))} was received from {arg(self.name)}")
            hint = "check the program on the robot that publishes them"
            return LinkFinding(Verdict.INCONCLUSIVE, "not-heard", message, hint)
        text = msg(f"{arg(len(topics))} of {arg(len(names))} topics of {arg(self.name)} are as expected")
        return LinkFinding(Verdict.PASS, "heard", text)


@dataclass(frozen=True, slots=True)
class _Strangers:
    """Check that every robot that announces itself is in the inventory."""

    robots: RobotFiles
    site: str

    def asks(self) -> tuple[base.Question, ...]:
        return (base.RobotsHeardRequest("heard"),)

    def judge(self, results: Mapping[str, base.Answer]) -> base.ProbeResult:
        observation = _observation(results["heard"], "")
        if isinstance(observation, LinkFinding):
            return base.ProbeResult((observation,))
        reports = self.robots.reports(observation)
        every = [finding for report in reports for finding in report.findings]
        wrong = tuple(_complete_hint(each, self.site) for each in every if ITEM_OF[each.code] is RobotItem.STRANGERS)
        if wrong:
            return base.ProbeResult(wrong)
        if not observation.configurations:
            message = "no robot was discovered, so robots outside the inventory cannot be seen"
            hint = "check that this computer is in the robots' network and in the domain of `dds.domain`"
            return base.ProbeResult((LinkFinding(Verdict.INCONCLUSIVE, "nobody-heard", message, hint),))
        text = msg(f"{arg(len(observation.configurations))} robots discovered, all in the inventory")
        return base.ProbeResult((LinkFinding(Verdict.PASS, "all-known", text),))
