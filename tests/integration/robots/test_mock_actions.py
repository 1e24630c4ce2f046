"""Mock robots take commands and plans of Debian's Fast DDS, which has discovery, QoS and CDR of its own."""

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import pytest
from dds_stand import Participant
from waiting import wait_until

if find_spec("cyclonedds") is None:
    pytest.skip("PyPI has no cyclonedds for this machine", allow_module_level=True)
pytestmark = [
    pytest.mark.namespace,
    pytest.mark.skipif(os.geteuid() != 0, reason="making a network namespace needs root"),
]
SOURCE = Path(__file__).parent / "programs" / "action_client.cpp"
PROVISION = Path(sys.executable).parent / "provision"
COMMANDS = {
    1: ("/sparus/surface", "CommandPlain"),
    2: ("/sparus/go_to", "CommandWaypoint -8.83 41.68 2"),
    3: ("/sparus/follow", "CommandPath -8.83 41.68 2 -8.84 41.69 3"),
    4: ("/zarco/loiter", "CommandNumeric 60"),
    5: ("/sparus/lights", "CommandBool 1"),
    6: ("/sparus/dive_to", "CommandNumeric 12.5"),
}
"""A command of each kind: plain, waypoint, path, time, switch, numeric."""
PLAN = ('0\tsubmerge\t{"depth": 2}', '1\tinspect\t{"point": [-8.83, 41.68], "target": "mooring"}', "2\tsend data\t{}")
STEPS = ("0=submerge{}", "1=inspect{}", "2=send data{}")


@dataclass
class Session:
    """What a control centre saw, and what the mock robots said."""

    client: Participant
    mock: Participant

    def send(self, line: str) -> None:
        assert self.client.process.stdin is not None
        self.client.process.stdin.write(f"{line}\n")
        self.client.process.stdin.flush()

    def goal(self, number: int, *steps: str) -> None:
        self.send("\t".join((f"goal {number} /sparus/execute_plan ExecutePlan {steps[0]}", *steps[1:])))

    def wait(self, line: str, count: int = 1) -> None:
        wait_until(lambda: self.about(line, count), why=lambda: [*self.client.lines, *self.mock.lines])

    def about(self, start: str, count: int = 1) -> bool:
        return sum(line.startswith(start) for line in self.client.lines) >= count

    def of(self, number: int, *kinds: str) -> list[str]:
        """Lines about a goal, without its number and the data of steps."""
        rows = [line.split(" ", 2) for line in self.client.lines if line.split(" ")[1:2] == [str(number)]]
        return [re.sub(r"\{[^}]*\}", "{}", " ".join((row[0], *row[2:]))) for row in rows if row[0] in kinds]


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    """Everything that is asked of the robots, in one go; the tests look at the replies."""
    program = tmp_path_factory.mktemp("client") / "action_client"
    command = ["g++", "-o", str(program), str(SOURCE), "-lfastrtps", "-lfastcdr"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    name = f"actions-{os.getpid()}"
    with ExitStack() as stack:
        subprocess.run(["ip", "netns", "add", name], check=True)
        stack.callback(subprocess.run, ["ip", "netns", "delete", name], check=True)
        subprocess.run(["ip", "-n", name, "link", "set", "lo", "up"], check=True)
        vehicles = "vehicle=sparus,zarco,eca-rov"
        mock = _start(stack, name, str(PROVISION), "robot", "mock", vehicles)
        client = _start(stack, name, str(program), "0")
        session = Session(client, mock)
        _converse(session)
        mock.process.send_signal(signal.SIGINT)
        assert mock.process.wait() == 0, mock.lines
        wait_until(lambda: any("zarco: goals accepted" in line for line in mock.lines))
        yield session


def _start(stack: ExitStack, namespace: str, *command: str) -> Participant:
    process = subprocess.Popen(
        ["ip", "netns", "exec", namespace, *command],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )

    def end() -> None:
        process.kill()
        process.wait()
        assert process.stdin is not None
        process.stdin.close()

    stack.callback(end)
    return Participant(command[0], process)


def _converse(session: Session) -> None:
    for number, (action, words) in COMMANDS.items():
        session.send(f"goal {number} {action} {words}")
    session.send("goal 7 /sparus/start_survey CommandPlain")
    session.goal(8, *PLAN)
    session.goal(9, *PLAN)
    session.send("bare 10 /sparus/surface CommandPlain")
    session.wait("result 8")
    session.goal(11, *PLAN)
    session.wait("feedback 11", 2)
    session.send("cancel 11 /sparus/execute_plan ExecutePlan")
    session.wait("result 11")
    session.send("cancel 11 /sparus/execute_plan ExecutePlan")
    session.send("cancel 77 /sparus/execute_plan ExecutePlan")
    session.send("result 8 /sparus/execute_plan ExecutePlan")
    session.send("result 99 /sparus/execute_plan ExecutePlan")
    session.goal(12, PLAN[1])
    session.goal(13, "0\tdive\t[2]")
    for number in (14, 15):
        session.send(f"goal {number} /sparus/lights CommandBool 0")
        session.wait(f"state {number} 2")
    session.send("cancel 0 /sparus/lights CommandBool")
    for line in ("cancel 0", "cancel 77", "goal 12", "goal 13", "result 14", "result 15", "result 99"):
        session.wait(line)
    for number in COMMANDS:
        session.wait(f"result {number} ")


def test_fast_dds_sees_topics_by_their_names_and_types_in_ros(session: Session) -> None:
    writers = {tuple(line.split()[1:]) for line in session.client.lines if line.startswith("writer")}
    assert {row for row in writers if row[0].startswith("rt/sparus/") and "/_action/" not in row[0]} == {
        ("rt/sparus/pose", "geometry_msgs::msg::dds_::Pose_"),
        ("rt/sparus/leak", "c4i_asset_msgs::msg::dds_::BoolTimestamped_"),
        ("rt/sparus/at_surface", "c4i_asset_msgs::msg::dds_::BoolTimestamped_"),
        ("rt/sparus/battery/voltage", "c4i_asset_msgs::msg::dds_::FloatTimestamped_"),
        ("rt/sparus/depth", "c4i_asset_msgs::msg::dds_::FloatTimestamped_"),
        ("rt/sparus/camera/image", "sensor_msgs::msg::dds_::Image_"),
        ("rt/sparus/fix", "sensor_msgs::msg::dds_::NavSatFix_"),
    }
    plan, types = "/sparus/execute_plan/_action", "c4i_asset_msgs::action::dds_::ExecutePlan"
    assert {row for row in writers if plan in row[0]} == {
        (f"rt{plan}/feedback", f"{types}_FeedbackMessage_"),
        (f"rt{plan}/status", "action_msgs::msg::dds_::GoalStatusArray_"),
        (f"rr{plan}/send_goalReply", f"{types}_SendGoal_Response_"),
        (f"rr{plan}/cancel_goalReply", "action_msgs::srv::dds_::CancelGoal_Response_"),
        (f"rr{plan}/get_resultReply", f"{types}_GetResult_Response_"),
    }
    readers = {tuple(line.split()[1:]) for line in session.client.lines if line.startswith("reader")}
    assert {row for row in readers if plan in row[0]} == {
        (f"rq{plan}/send_goalRequest", f"{types}_SendGoal_Request_"),
        (f"rq{plan}/cancel_goalRequest", "action_msgs::srv::dds_::CancelGoal_Request_"),
        (f"rq{plan}/get_resultRequest", f"{types}_GetResult_Request_"),
    }
    actions = {row[0].split("/_action/")[0] for row in readers}
    assert {action.rpartition("/")[2] for action in actions if action.startswith("rq/sparus/")} == {
        *("execute_plan", "surface", "start_survey", "go_to", "follow", "dive_to", "lights")
    }
    assert {action for action in actions if "eca_rov" in action} == {"rq/eca_rov/lights", "rq/eca_rov/hold_depth"}


@pytest.mark.parametrize("number", COMMANDS)
def test_a_command_of_each_kind_has_feedback_and_a_result(session: Session, number: int) -> None:
    assert session.of(number, "goal", "feedback", "result") == ["goal accepted", *["feedback 0"] * 4, "result 4 0"]
    assert session.of(number, "state") == ["state 1", "state 2", "state 4"]


def test_a_plan_is_carried_out_step_by_step(session: Session) -> None:
    one, two, three = STEPS
    assert session.of(8, "feedback") == [
        f"feedback [] [{one}] [{two},{three}]",
        f"feedback [{one}] [{two}] [{three}]",
        f"feedback [{one},{two}] [{three}] []",
        f"feedback [{one},{two},{three}] [] []",
    ]
    assert session.of(8, "state") == ["state 1", "state 2", "state 4"]
    first, second = session.of(8, "result")
    assert first == second, "asked before its end, and after"
    assert first.startswith("result 4 ")
    assert re.findall(r" (\d=[^@]*)@", first) == list(STEPS)
    assert all(float(seconds) > 0 for seconds in re.findall(r"@(\S+)", first))


def test_a_plan_is_cancelled(session: Session) -> None:
    assert session.of(11, "state") == ["state 1", "state 2", "state 3", "state 5"]
    assert session.of(11, "cancel") == ["cancel 0 11", "cancel 3"]
    (result,) = session.of(11, "result")
    assert re.fullmatch(r"result 5 0=submerge\{\}@\S+", result), "what was completed by then"
    assert session.of(77, "cancel") == ["cancel 2"]
    assert session.of(99, "result") == ["result 0"]


def test_all_goals_of_an_action_are_cancelled(session: Session) -> None:
    assert session.of(0, "cancel") == ["cancel 0 14 15"]
    assert [session.of(number, "result") for number in (14, 15)] == [["result 5 0"], ["result 5 0"]]


def test_refused_goals_have_a_reason(session: Session) -> None:
    assert [session.of(number, "goal", "feedback", "result") for number in (7, 9, 12, 13)] == [["goal refused"]] * 4
    assert session.of(10, "goal", "state") == []
    output = "\n".join(session.mock.lines)
    for line in (
        "/sparus/start_survey: goal refused: /sparus/at_surface must be true, but is not",
        "/sparus/execute_plan: goal refused: another plan is still running",
        "/sparus/execute_plan: goal refused: the step indices do not count up from 0",
        "/sparus/execute_plan: goal refused: the data of step 0 are not a JSON object",
        "/sparus/surface: request not understood: its sender needs rmw_cyclonedds_cpp",
        "/sparus/lights: goal cancelled",
        "eca_rov accepts no plans: its program receives them by a function",
        "sparus: goals accepted 9, refused 4, invalid 1",
        "zarco: goals accepted 1, refused 0, invalid 0",
    ):
        assert line in output
