"""Goals of a mock robot with a simulated clock: accepted, refused, carried out, cancelled, and kept for a while."""

import pytest

from atlantis_netcfg.robots import actions
from atlantis_netcfg.robots.actions import ActionServer, CancelCode, Goal, GoalRefusal, GoalStatus, PlanStep

ONE, TWO = bytes([1] * 16), bytes([2] * 16)
ALL = bytes(16)
PLAN = [PlanStep(index, name, "{}") for index, name in enumerate(("submerge", "inspect", "send_data"))]


def run(server: ActionServer, seconds: float, start: float = 0.0) -> list[tuple[float, bytes, GoalStatus, int]]:
    """Step ten times a second; return what changed, and when."""
    moments = [round(start + tenth / 10, 1) for tenth in range(int(seconds * 10) + 1)]
    return [
        (now, goal.identity[:1], goal.status, goal.completed_steps)
        for now in moments
        for goal in server.step(now, int(now * 1e9))
    ]


def accept(server: ActionServer, identity: bytes = ONE, plan: list[PlanStep] | None = None, now: float = 0.0) -> Goal:
    return server.accept(identity, plan or [], now, int(now * 1e9))


def test_a_command_has_feedback_every_second_and_succeeds() -> None:
    server = ActionServer()
    assert accept(server).status is GoalStatus.ACCEPTED
    assert run(server, 10) == [
        (0.0, b"\x01", GoalStatus.EXECUTING, 0),
        (1.0, b"\x01", GoalStatus.EXECUTING, 1),
        (2.0, b"\x01", GoalStatus.EXECUTING, 2),
        (3.0, b"\x01", GoalStatus.SUCCEEDED, 3),
    ]


def test_plan_steps_run_in_sequence_with_timestamps() -> None:
    server = ActionServer(one_at_a_time=True)
    goal = accept(server, plan=PLAN)
    rows = run(server, 4)
    assert [(now, completed) for now, _, _, completed in rows] == [(0.0, 0), (1.0, 1), (2.0, 2), (3.0, 3)]
    assert goal.stamps_ns == [0, 1_000_000_000, 2_000_000_000, 3_000_000_000]
    assert goal.status is GoalStatus.SUCCEEDED


def test_commands_run_in_parallel_but_plans_do_not() -> None:
    commands, plans = ActionServer(), ActionServer(one_at_a_time=True)
    accept(commands)
    accept(commands, TWO)
    assert [row[1] for row in run(commands, 1)] == [b"\x01", b"\x02", b"\x01", b"\x02"]
    accept(plans, plan=PLAN)
    with pytest.raises(GoalRefusal, match="another plan is still running"):
        accept(plans, TWO, PLAN)
    run(plans, 3)
    assert accept(plans, TWO, PLAN, now=4.0).status is GoalStatus.ACCEPTED


def test_stalled_process_still_sends_all_feedback() -> None:
    server = ActionServer()
    accept(server)
    assert [goal.completed_steps for _ in range(5) for goal in server.step(60.0, 0)] == [0, 1, 2, 3]


@pytest.mark.parametrize("seconds", [None, 0.0, 1.5], ids=["accepted", "first step", "second step"])
def test_a_goal_is_cancelled_in_two_steps(seconds: float | None) -> None:
    server = ActionServer()
    goal = accept(server)
    if seconds is not None:
        run(server, seconds)
    assert server.cancel(ONE, 0) == (CancelCode.NONE, [goal])
    assert goal.status is GoalStatus.CANCELING
    assert server.cancel(ONE, 0) == (CancelCode.GOAL_TERMINATED, []), "as rcl_action says it"
    assert run(server, 5, start=2.0) == [(2.0, b"\x01", GoalStatus.CANCELED, int(seconds or 0))]
    assert server.cancel(ONE, 0) == (CancelCode.GOAL_TERMINATED, [])


def test_finished_or_unknown_goal_cannot_be_cancelled() -> None:
    server = ActionServer()
    accept(server)
    run(server, 3)
    assert server.cancel(ONE, 0) == (CancelCode.GOAL_TERMINATED, [])
    assert server.cancel(TWO, 0) == (CancelCode.UNKNOWN_GOAL, [])
    assert server.cancel(ALL, 0) == (CancelCode.NONE, [])


@pytest.mark.parametrize(
    ("identity", "stamp_ns", "expected"),
    [(ALL, 0, [ONE, TWO]), (ALL, 5_000_000_000, [ONE]), (TWO, 5_000_000_000, [ONE, TWO]), (ALL, 1, [])],
    ids=["all", "up to a stamp", "one and up to a stamp", "before all"],
)
def test_several_goals_are_cancelled_at_once(identity: bytes, stamp_ns: int, expected: list[bytes]) -> None:
    server = ActionServer()
    accept(server, now=5.0)
    accept(server, TWO, now=6.0)
    code, goals = server.cancel(identity, stamp_ns)
    assert (code, [goal.identity for goal in goals]) == (CancelCode.NONE, expected)


def test_result_request_waits_until_the_goal_ends() -> None:
    server = ActionServer()
    assert not server.wait_for_result(ONE, (7, 1)), "an unknown goal is answered at once"
    goal = accept(server)
    asked = [server.wait_for_result(ONE, (7, number)) for number in range(actions.MOST_REQUESTS + 1)]
    assert asked == [True] * actions.MOST_REQUESTS + [False]
    assert goal.requests[:2] == [(7, 0), (7, 1)]
    run(server, 3)
    assert not server.wait_for_result(ONE, (7, 9))


def test_results_are_kept_until_their_timeout() -> None:
    server = ActionServer()
    accept(server)
    run(server, 3)
    server.step(3.0 + actions.RESULT_TIMEOUT_S - 0.1, 0)
    assert ONE in server.goals
    server.step(3.0 + actions.RESULT_TIMEOUT_S, 0)
    assert not server.goals


def test_a_flood_of_goals_is_bounded() -> None:
    server = ActionServer()
    identities = [number.to_bytes(16, "big") for number in range(1, 200)]
    for identity in identities[: actions.MOST_GOALS]:
        accept(server, identity)
    with pytest.raises(GoalRefusal, match="64 goals are still running"):
        accept(server, identities[-1])
    run(server, 3)
    for identity in identities[actions.MOST_GOALS : actions.MOST_GOALS + 9]:
        accept(server, identity)
    assert list(server.goals) == identities[9 : actions.MOST_GOALS + 9], "the oldest results are forgotten"


@pytest.mark.parametrize(("identity", "message"), [(ALL, "its goal id is zero"), (ONE, "this goal id was used before")])
def test_goal_needs_a_unique_id(identity: bytes, message: str) -> None:
    server = ActionServer()
    accept(server)
    run(server, 3)
    with pytest.raises(GoalRefusal, match=message):
        accept(server, identity, now=5.0)


def test_plan_runs_in_order_of_its_indices() -> None:
    assert actions.require_plan(PLAN[::-1]) == PLAN


@pytest.mark.parametrize(
    ("plan", "message"),
    [
        ([], "the plan has no steps"),
        (PLAN[1:], "the step indices do not count up from 0"),
        ([*PLAN, PLAN[0]], "the step indices do not count up from 0"),
        ([PlanStep(0, "", "{}")], "step 0 names no action"),
        ([PLAN[0], PlanStep(1, "dive", "")], "the data of step 1 are not a JSON object"),
        ([PlanStep(0, "dive", "[1]")], "the data of step 0 are not a JSON object"),
        ([PlanStep(0, "dive", '{"depth": NaN}')], "the data of step 0 are not a JSON object"),
        ([PlanStep(0, "dive", '{"a":' * 30_000)], "too long"),
        ([PlanStep(0, "dive", "[" * 20_000)], "the data of step 0 are not a JSON object"),
        ([PlanStep(index, "dive", "{}") for index in range(201)], "at most 200 steps and 64000 characters"),
    ],
)
def test_invalid_plan_is_refused(plan: list[PlanStep], message: str) -> None:
    with pytest.raises(GoalRefusal, match=message):
        actions.require_plan(plan)
