"""What was heard, beside the robots' files: each difference has its own finding."""

from collections.abc import Callable
from dataclasses import replace

import pytest
import robot_cases
from hints_said import advised, said

from atlantis_netcfg.cli import main
from atlantis_netcfg.core.errors import ExitCode, UsageError
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.inventory._yaml import SealedSecret
from atlantis_netcfg.inventory.model.robot import PublishedTopic, Telemetry, Topic, TopicKind
from atlantis_netcfg.inventory.robots import reading
from atlantis_netcfg.inventory.robots.key_names import KeyNames
from atlantis_netcfg.operations.robots import ending, seconds_of
from atlantis_netcfg.robots.mock import RATES_HZ
from atlantis_netcfg.robots.observation import (
    HeardConfiguration,
    HeardWriter,
    RobotObservation,
    RobotState,
    judge,
    topic_findings,
)

SECONDS = 30.0
Change = Callable[[RobotObservation], None]


def source() -> reading.RobotSource:
    return next(each for each in reading.read_declared(robot_cases.shipped(), KeyNames()) if each.vehicle == "sparus")


def writer(topic: str, kind: str, rate_hz: float) -> HeardWriter:
    count = int(SECONDS * rate_hz)
    row = HeardWriter("key", topic, kind, messages=count, octets=60 * count, first_s=0.0, last_s=(count - 1) / rate_hz)
    row.contents.update((b"1", b"2"))
    return row


def heard() -> RobotObservation:
    """Of a robot that does what its file says."""
    sparus = source()
    assert sparus.robot is not None
    observation = RobotObservation(SECONDS, {"key": "10.64.1.22"})
    observation.writers = [writer(each.name, each.message_type, RATES_HZ[each.kind]) for each in sparus.robot.topics()]
    configuration = writer("/atlantis/configuration", "std_msgs/msg/String", 1.0)
    observation.configurations = [HeardConfiguration(configuration, sparus.text().encode())]
    return observation


def of(observation: RobotObservation, short: str) -> HeardWriter:
    return next(each for each in observation.writers if each.topic.endswith(short))


def codes(observation: RobotObservation) -> list[str]:
    (report,) = judge(observation, [source()], ["sparus"], KeyNames())
    return [finding.code for finding in report.findings]


def test_robot_matching_its_file_has_no_finding() -> None:
    observation = heard()
    reports = judge(observation, [source()], ["sparus"], KeyNames())
    assert [(each.namespace, each.state, each.findings) for each in reports] == [("sparus", RobotState.DECLARED, ())]
    assert ending(reports, observation) == 0


CHANGES: dict[str, Change] = {
    "topic-missing": lambda seen: seen.writers.remove(of(seen, "leak")),
    "topic-silent": lambda seen: setattr(of(seen, "leak"), "messages", 0),
    "topic-type": lambda seen: setattr(of(seen, "depth"), "type", "std_msgs/msg/Float64"),
    "topic-unread": lambda seen: seen.unread.update({"/sparus/depth": "c4i_asset_msgs/msg/FloatTimestamped"}),
    "topic-frozen": lambda seen: of(seen, "pose").contents.discard(b"2"),
    "topic-stale": lambda seen: setattr(of(seen, "fix"), "stamp_age_s", -61.0),
    "topic-rate-above": lambda seen: setattr(of(seen, "depth"), "first_s", SECONDS - 3.0),
    "topic-rate-below": lambda seen: setattr(of(seen, "depth"), "first_s", SECONDS - 300.0),
    "topic-rate-unknown": lambda seen: setattr(of(seen, "depth"), "messages", 2),
    "configuration-rate": lambda seen: setattr(seen.configurations[0].writer, "last_s", 6.0),
    "configuration-rate-unknown": lambda seen: setattr(seen.configurations[0].writer, "messages", 2),
    "token": lambda seen: replace_text(seen, "EXAMPLE-sparus-token", "another"),
    "configuration-differs": lambda seen: replace_text(seen, "label: Leak", "label: Water"),
}


def replace_text(seen: RobotObservation, old: str, new: str) -> None:
    seen.configurations[0].text = seen.configurations[0].text.replace(old.encode(), new.encode())


@pytest.mark.parametrize("code", CHANGES)
def test_each_difference_has_its_finding(code: str) -> None:
    observation = heard()
    CHANGES[code](observation)
    assert codes(observation) == [code]


@pytest.mark.parametrize(("messages", "verdict"), [(3, Verdict.WARN), (9, Verdict.WARN), (10, Verdict.FAIL)])
def test_frozen_pose_fails_once_chance_is_excluded(messages: int, verdict: Verdict) -> None:
    observation = heard()
    pose = of(observation, "pose")
    pose.contents.discard(b"2")
    pose.messages, pose.first_s = messages, pose.last_s - (messages - 1) / 2
    (report,) = judge(observation, [source()], ["sparus"], KeyNames())
    assert [(each.code, each.verdict) for each in report.findings] == [("topic-frozen", verdict)]


def test_two_poses_are_too_few_for_rate_or_movement() -> None:
    observation = heard()
    pose = of(observation, "pose")
    pose.contents.discard(b"2")
    pose.messages = 2
    (report,) = judge(observation, [source()], ["sparus"], KeyNames())
    rows = [(each.code, each.verdict) for each in report.findings]
    assert rows == [("topic-rate-unknown", Verdict.INCONCLUSIVE), ("topic-frozen", Verdict.INCONCLUSIVE)]


def test_topic_that_stops_while_others_continue_fails() -> None:
    observation = heard()
    depth = of(observation, "depth")
    depth.messages, depth.last_s = 4, 1.5
    (report,) = judge(observation, [source()], ["sparus"], KeyNames())
    assert [(each.code, each.verdict, each.message) for each in report.findings] == [
        ("topic-silent", Verdict.FAIL, "no message was received on /sparus/depth in the last 28 s of the robot")
    ]
    observation.writers.append(replace(writer(depth.topic, depth.type, 2.0), participant="started again"))
    assert codes(observation) == []
    observation.writers = [
        replace(each, last_s=(each.messages // 10 - 1) / (each.rate_hz or 1.0), messages=each.messages // 10)
        for each in heard().writers
    ]
    assert codes(observation) == [], "the robot was switched off"


def test_unknown_other_type_is_reported_as_a_different_type() -> None:
    observation = heard()
    of(observation, "pose").type = "their_msgs/msg/Pose"
    observation.unread["/sparus/pose"] = "their_msgs/msg/Pose"
    assert codes(observation) == ["topic-type"]


@pytest.mark.parametrize(("factor", "found"), [(1.05, []), (1.2, ["topic-rate-above"])])
def test_a_measured_rate_may_be_a_little_above_the_guideline(factor: float, found: list[str]) -> None:
    observation = heard()
    depth = of(observation, "depth")
    depth.first_s = depth.last_s - (depth.messages - 1) / (4.0 * factor)
    assert codes(observation) == found


def test_two_participants_in_one_namespace_are_reported_with_addresses() -> None:
    observation = heard()
    observation.participants["other"] = "10.64.1.99"
    first = observation.configurations[0]
    observation.configurations.append(HeardConfiguration(replace(first.writer, participant="other"), first.text))
    (report,) = judge(observation, [source()], ["sparus"], KeyNames())
    assert [(each.code, each.message) for each in report.findings] == [
        ("namespace-twice", "2 participants announce themselves as `sparus`: 10.64.1.22 and 10.64.1.99")
    ]


def test_topics_may_come_from_another_process_of_the_robot() -> None:
    observation = heard()
    for each in observation.writers:
        each.participant = "driver"
    assert codes(observation) == []


def test_encrypted_token_is_not_compared_and_warns() -> None:
    observation = heard()
    replace_text(observation, "EXAMPLE-sparus-token", "another")
    sealed = source()
    assert sealed.robot is not None
    token = SealedSecret("$ANSIBLE_VAULT;1.1;AES256\n30")
    sealed = replace(sealed, robot=sealed.robot.model_copy(update={"token": token}))
    (report,) = judge(observation, [sealed], ["sparus"], KeyNames())
    assert [(each.verdict, each.code) for each in report.findings] == [(Verdict.WARN, "token-sealed")]


def test_unknown_and_missing_robots_fail() -> None:
    observation = heard()
    replace_text(observation, "namespace: sparus", "namespace: sparuss")
    reports = judge(observation, [source()], ["sparus"], KeyNames())
    assert [(each.namespace, each.state) for each in reports] == [
        ("sparus", RobotState.MISSING),
        ("sparuss", RobotState.UNKNOWN),
    ]
    assert "did it mean `sparus`?" in reports[1].findings[0].message
    assert ending(reports, observation) == 6


def test_telemetry_without_a_configuration_is_reported() -> None:
    observation = heard()
    observation.configurations.clear()
    (report,) = judge(observation, [source()], ["sparus"], KeyNames())
    assert [(each.verdict, each.code, each.message) for each in report.findings] == [
        (
            Verdict.INCONCLUSIVE,
            "configuration-missing",
            "a robot publishes /sparus/pose, but its configuration was not received",
        )
    ]
    assert ending([report], observation) == ExitCode.CHECKS_FAILED


def test_infrequent_point_cloud_meets_its_guideline() -> None:
    topic = PublishedTopic("/sparus/cloud", TopicKind.POINT_CLOUD, TopicKind.POINT_CLOUD.message_type, ())
    row = writer(topic.name, topic.message_type, 0.05)
    robot = source().robot
    assert robot is not None
    clouds = robot.model_copy(update={"telemetry": Telemetry(point_clouds=(Topic(topic=topic.name),))})
    seen = RobotObservation(SECONDS, writers=[*heard().writers, row])
    assert [*topic_findings(clouds, seen.writers, seen)] == []


def test_participant_in_another_domain_is_reported_if_a_robot_is_missing() -> None:
    observation = RobotObservation(SECONDS, {"key": "10.64.1.23"}, other_domains={"10.64.1.22": [7, 42]})
    reports = judge(observation, [source()], ["sparus"], KeyNames())
    assert [each.state for each in reports] == [RobotState.MISSING]
    assert [(each.verdict, each.code) for each in reports[0].findings] == [
        ("INCONCLUSIVE", "robot-missing"),
        ("INCONCLUSIVE", "other-domain"),
    ]
    assert "10.64.1.22 uses domain 7, 42" in reports[0].findings[1].message
    assert ending(reports, observation) == ExitCode.CHECKS_FAILED
    assert codes(replace(heard(), other_domains={"10.64.1.22": [7]})) == []


def test_silence_never_passes() -> None:
    silence = RobotObservation(SECONDS)
    assert ending(judge(silence, [source()], [], KeyNames()), silence) == 6


@pytest.mark.parametrize("text", [b"", b"\xff\xfe", b"a: [", b"namespace: x\n", b"- 1\n", b"x" * 1_000_001])
def test_unreadable_configuration_is_reported(text: bytes) -> None:
    observation = heard()
    observation.configurations[0].text = text
    reports = judge(observation, [source()], [], KeyNames())
    assert [finding.code for each in reports for finding in each.findings] == ["configuration-unreadable"]
    assert reports[0].namespace == "10.64.1.22"


def test_suggested_command_checks_the_robot_files(capsys: pytest.CaptureFixture[str]) -> None:
    observation = heard()
    replace_text(observation, "label: Leak", "label: Water")
    (report,) = judge(observation, [source()], ["sparus"], KeyNames())
    assert ending([report], observation) == ExitCode.CHECKS_FAILED, "it is not as its file says"
    (line,) = advised(said(report.findings[0].hint or "", str(report.findings[0].hint)))
    assert main(line) == ExitCode.DONE
    assert "6 robot files: no errors" in capsys.readouterr().out


@pytest.mark.parametrize(("text", "seconds"), [("30s", 30), ("30", 30), ("5m", 300)])
def test_listening_time_is_parsed(text: str, seconds: int) -> None:
    assert seconds_of(text) == seconds


@pytest.mark.parametrize("text", ["", "4s", "61m", "1h", "-5", "30 s"])
def test_invalid_listening_time_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="` is not a valid duration"):
        seconds_of(text)
