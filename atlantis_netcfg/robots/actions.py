"""Goals of a ROS 2 action from request to result, as a mock robot executes them. Pure: nothing here sends.

A command takes a few seconds, a plan one second per step. States and codes are those of action_msgs. Cancelling follows
rcl_action: requested, accepted (CANCELING), then done (CANCELED).
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from enum import IntEnum
from typing import TYPE_CHECKING, Any, Final

from atlantis_netcfg.core.messages import arg, msg

if TYPE_CHECKING:
    from collections.abc import Sequence

STEP_S: Final = 1.0
"""Duration of a plan's step, and interval of a command's feedback, in seconds."""
COMMAND_STEPS: Final = 3
MOST_GOALS: Final = 64
"""Maximum number of goals of one action, both active and finished with a stored result."""
RESULT_TIMEOUT_S: Final = 900.0
MOST_REQUESTS: Final = 8
"""Maximum number of requests that wait for the result of one goal."""
MOST_STEPS: Final = 200
MOST_PLAN_CHARACTERS: Final = 64_000
"""Maximum length of all steps of a plan: every feedback has the whole plan."""
_NO_GOAL: Final = bytes(16)


class GoalStatus(IntEnum):
    """State of a goal, as defined by `action_msgs/msg/GoalStatus`."""

    UNKNOWN = 0
    ACCEPTED = 1
    EXECUTING = 2
    CANCELING = 3
    SUCCEEDED = 4
    CANCELED = 5

    @property
    def is_terminal(self) -> bool:
        """True if the goal is finished."""
        return self in {GoalStatus.SUCCEEDED, GoalStatus.CANCELED}


class CancelCode(IntEnum):
    """Result of a cancel request, as defined by `action_msgs/srv/CancelGoal`."""

    NONE = 0
    UNKNOWN_GOAL = 2
    GOAL_TERMINATED = 3


class GoalRefusal(Exception):
    """Raised when a goal is rejected, with the reason for the user."""


@dataclass(frozen=True, slots=True)
class PlanStep:
    """One step of a plan, with the message that contained it."""

    index: int
    action: str
    data: str
    message: Any = None


def require_plan(steps: Sequence[PlanStep]) -> list[PlanStep]:
    """Return the steps sorted by index. Raises GoalRefusal if the plan is empty, too long or not valid."""
    if not steps:
        raise GoalRefusal("the plan has no steps")
    if len(steps) > MOST_STEPS or sum(len(step.action) + len(step.data) for step in steps) > MOST_PLAN_CHARACTERS:
        raise GoalRefusal(
            msg(f"the plan is too long: at most {arg(MOST_STEPS)} steps and {arg(MOST_PLAN_CHARACTERS)} characters")
        )
    order = sorted(steps, key=lambda step: step.index)
    if [step.index for step in order] != list(range(len(order))):
        raise GoalRefusal("the step indices do not count up from 0")
    for step in order:
        if not step.action:
            raise GoalRefusal(msg(f"step {arg(step.index)} names no action"))
        if not _is_json_object(step.data):
            raise GoalRefusal(msg(f"the data of step {arg(step.index)} are not a JSON object"))
    return order


def _is_json_object(text: str) -> bool:
    try:
        return isinstance(json.loads(text, parse_constant=_refuse_constant), dict)
    except (ValueError, RecursionError):
        return False


def _refuse_constant(name: str) -> None:
    raise ValueError(name)


@dataclass(slots=True)
class Goal:
    """One goal; times are in seconds of the monotonic clock, stamps in nanoseconds of the wall clock."""

    identity: bytes
    stamp_ns: int
    plan: Sequence[PlanStep]
    """Steps of the plan; empty for a command."""
    due: float = 0.0
    status: GoalStatus = GoalStatus.ACCEPTED
    stamps_ns: list[int] = field(default_factory=list)
    """Time at which the first step began, and the end of each step."""
    requests: list[Any] = field(default_factory=list)
    """Result requests that are answered when the goal ends."""

    @property
    def steps(self) -> int:
        """Number of steps of the goal."""
        return len(self.plan) or COMMAND_STEPS

    @property
    def completed_steps(self) -> int:
        """Number of completed steps."""
        return max(0, len(self.stamps_ns) - 1)


@dataclass(slots=True)
class ActionServer:
    """Goals of one action of one robot."""

    one_at_a_time: bool = False
    """Whether a second goal is refused while another is executed."""
    goals: dict[bytes, Goal] = field(default_factory=dict)

    def accept(self, identity: bytes, plan: Sequence[PlanStep], now: float, stamp_ns: int) -> Goal:
        """Accept a goal. Raises GoalRefusal."""
        active = [goal for goal in self.goals.values() if not goal.status.is_terminal]
        if identity == _NO_GOAL:
            raise GoalRefusal("its goal id is zero")
        if identity in self.goals:
            raise GoalRefusal("this goal id was used before")
        if active and self.one_at_a_time:
            raise GoalRefusal("another plan is still running")
        if len(active) >= MOST_GOALS:
            raise GoalRefusal(msg(f"{arg(MOST_GOALS)} goals are still running"))
        if len(self.goals) >= MOST_GOALS:
            del self.goals[next(key for key, goal in self.goals.items() if goal.status.is_terminal)]
        self.goals[identity] = Goal(identity, stamp_ns, plan, now)
        return self.goals[identity]

    def cancel(self, identity: bytes, stamp_ns: int) -> tuple[CancelCode, list[Goal]]:
        """Start to cancel one goal, all accepted up to a stamp, or all (id and stamp are zero)."""
        is_one, is_every = identity != _NO_GOAL and not stamp_ns, identity == _NO_GOAL and not stamp_ns
        if is_one and identity not in self.goals:
            return CancelCode.UNKNOWN_GOAL, []
        targets = [
            goal
            for goal in self.goals.values()
            if goal.status in {GoalStatus.ACCEPTED, GoalStatus.EXECUTING}
            and (is_every or goal.identity == identity or goal.stamp_ns <= stamp_ns)
        ]
        for goal in targets:
            goal.status = GoalStatus.CANCELING
        return CancelCode.GOAL_TERMINATED if is_one and not targets else CancelCode.NONE, targets

    def wait_for_result(self, identity: bytes, request: Any) -> bool:  # noqa: ANN401 - a message
        """Keep a result request until its goal is finished; return False if it must be answered now."""
        goal = self.goals.get(identity)
        if goal is None or goal.status.is_terminal or len(goal.requests) >= MOST_REQUESTS:
            return False
        goal.requests.append(request)
        return True

    def step(self, now: float, stamp_ns: int) -> list[Goal]:
        """Advance the goals to `now`; return those whose state changed. Each changes at most once."""
        changes = []
        for goal in list(self.goals.values()):
            if goal.status.is_terminal:
                if now - goal.due >= RESULT_TIMEOUT_S:
                    del self.goals[goal.identity]
            elif goal.status is GoalStatus.CANCELING:
                goal.status, goal.due = GoalStatus.CANCELED, now
                changes.append(goal)
            elif now >= goal.due:
                goal.status, goal.due = GoalStatus.EXECUTING, goal.due + STEP_S
                goal.stamps_ns.append(stamp_ns)
                if goal.completed_steps == goal.steps:
                    goal.status, goal.due = GoalStatus.SUCCEEDED, now
                changes.append(goal)
        return changes
