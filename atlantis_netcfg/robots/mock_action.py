"""One action of a mock robot at its five topics of DDS: goals, cancelling, results, feedback and states."""

from __future__ import annotations

from collections import Counter, deque
from typing import TYPE_CHECKING, Any, Final

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.robots import actions

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from atlantis_netcfg.inventory.model.robot import OfferedAction
    from atlantis_netcfg.robots.message_types import MessageTypes
    from atlantis_netcfg.robots.network import Publisher, RosService

_STATUS: Final = "action_msgs/msg/GoalStatus"
_NANO: Final = 1_000_000_000
_NOTICES: Final = 20


class MockAction:
    """One action of a robot file; `step` advances its goals and answers new requests."""

    def __init__(
        self, action: OfferedAction, publisher: Publisher, types: MessageTypes, require: Callable[[], None] | None
    ) -> None:
        """`require` raises GoalRefusal if a command may not be given; None: the action takes plans.

        Raises UsageError for an unknown type.
        """
        self.name, self._kind, self._types = action.name, action.action_type, types
        self._publisher, self._require = publisher, require
        self.counts: Counter[str] = Counter()
        """Number of requests by result: `accepted`, `refused` and `unreadable`."""
        self.notices: deque[str] = deque(maxlen=_NOTICES)
        """Latest messages for the user; `counts` contains all requests."""
        self._server = actions.ActionServer(one_at_a_time=require is None)
        self._results = publisher.service(f"{self.name}/_action/get_result", f"{self._kind}_GetResult")
        self._services: Mapping[RosService, Callable[[Any, float, int], Any]] = {
            publisher.service(f"{self.name}/_action/send_goal", f"{self._kind}_SendGoal"): self._accept,
            publisher.service(f"{self.name}/_action/cancel_goal", "action_msgs/srv/CancelGoal"): self._cancel,
            self._results: self._get_result,
        }
        publisher.advertise(f"{self.name}/_action/feedback", f"{self._kind}_FeedbackMessage", reliable=True)
        publisher.advertise(
            f"{self.name}/_action/status", f"{_STATUS}Array", reliable=True, transient_local=True, depth=1
        )
        self._publish_states()

    def step(self, now: float, stamp_ns: int) -> None:
        """Advance goals to `now` (monotonic, seconds), then answer requests."""
        changes = self._server.step(now, stamp_ns)
        if changes:
            self._publish_states()
        for goal in changes:
            self._announce(goal)
        is_idle = True
        for service, answer in self._services.items():
            for request in service.requests():
                is_idle = False
                if request is None:
                    self.counts["unreadable"] += 1
                    self.notices.append(
                        "request not understood: its sender needs rmw_cyclonedds_cpp and the same definitions"
                    )
                elif (reply := answer(request, now, stamp_ns)) is not None:
                    service.reply(request, reply)
        if not is_idle:
            self._publish_states()

    def _announce(self, goal: actions.Goal) -> None:
        if goal.status is not actions.GoalStatus.CANCELED:
            self._publish_feedback(goal)
        if goal.status.is_terminal:
            self.notices.append("goal succeeded" if goal.status is actions.GoalStatus.SUCCEEDED else "goal cancelled")
            for request in goal.requests:
                self._results.reply(request, self._result(goal))
            goal.requests.clear()

    def _accept(self, request: Any, now: float, stamp_ns: int) -> Any:  # noqa: ANN401 - messages
        reply = self._types.empty(f"{self._kind}_SendGoal_Response")
        try:
            goal = self._server.accept(bytes(request.goal_id.uuid), self._steps(request.goal), now, stamp_ns)
        except actions.GoalRefusal as refusal:
            self.counts["refused"] += 1
            self.notices.append(msg(f"goal refused: {arg(refusal)}"))
            return reply
        self.counts["accepted"] += 1
        self.notices.append("goal accepted")
        reply.accepted = True
        _set_time(reply.stamp, goal.stamp_ns)
        return reply

    def _steps(self, goal: Any) -> Sequence[actions.PlanStep]:  # noqa: ANN401 - a message
        """Return the steps of a plan; a command has none. Raises GoalRefusal."""
        if self._require is not None:
            self._require()
            return ()
        messages: Sequence[Any] = next((value for value in vars(goal).values() if isinstance(value, list)), ())
        return actions.require_plan(
            [
                actions.PlanStep(
                    getattr(each, "index", place), getattr(each, "action", "?"), getattr(each, "data", "{}"), each
                )
                for place, each in enumerate(messages)
            ]
        )

    def _cancel(self, request: Any, _now: float, _stamp_ns: int) -> Any:  # noqa: ANN401 - messages
        info = request.goal_info
        code, goals = self._server.cancel(bytes(info.goal_id.uuid), info.stamp.sec * _NANO + info.stamp.nanosec)
        reply = self._types.empty("action_msgs/srv/CancelGoal_Response")
        reply.return_code, reply.goals_canceling = code.value, [self._info(goal) for goal in goals]
        return reply

    def _get_result(self, request: Any, _now: float, _stamp_ns: int) -> Any:  # noqa: ANN401 - messages
        identity = bytes(request.goal_id.uuid)
        waits = self._server.wait_for_result(identity, request)
        return None if waits else self._result(self._server.goals.get(identity))

    def _result(self, goal: actions.Goal | None) -> Any:  # noqa: ANN401 - a message
        reply = self._types.empty(f"{self._kind}_GetResult_Response")
        if goal is not None:
            reply.status = goal.status.value
            self._fill(reply.result, "Result", "completed", goal, range(goal.completed_steps))
        return reply

    def _publish_feedback(self, goal: actions.Goal) -> None:
        message = self._types.empty(f"{self._kind}_FeedbackMessage")
        message.goal_id.uuid = list(goal.identity)
        completed_steps, total = goal.completed_steps, len(goal.plan)
        self._fill(message.feedback, "Feedback", "completed", goal, range(completed_steps))
        self._fill(
            message.feedback, "Feedback", "in_progress", goal, range(completed_steps, min(completed_steps + 1, total))
        )
        self._fill(message.feedback, "Feedback", "remaining", goal, range(completed_steps + 1, total))
        if not self._publisher.send(f"{self.name}/_action/feedback", message):
            self.notices.append("feedback was lost: one of its readers is too slow")

    def _publish_states(self) -> None:
        message = self._types.empty(f"{_STATUS}Array")
        for goal in self._server.goals.values():
            state = self._types.empty(_STATUS)
            state.goal_info, state.status = self._info(goal), goal.status.value
            message.status_list.append(state)
        self._publisher.send(f"{self.name}/_action/status", message)

    def _fill(self, message: Any, part: str, name: str, goal: actions.Goal, steps: range) -> None:  # noqa: ANN401 - a message
        """Fill a list of steps or completed steps, if the pilot's message type has one."""
        kind = self._types.items(f"{self._kind}_{part}", name)
        if kind is None or not goal.plan:
            return
        rows = []
        for place in steps:
            step, row = goal.plan[place].message, self._types.empty(kind)
            if isinstance(row, type(step)):
                row = step
            elif isinstance(getattr(row, "step", None), type(step)):
                row.step = step
            if hasattr(row, "start") and hasattr(row, "end"):
                _set_time(row.start, goal.stamps_ns[place])
                _set_time(row.end, goal.stamps_ns[place + 1])
            rows.append(row)
        setattr(message, name, rows)

    def _info(self, goal: actions.Goal) -> Any:  # noqa: ANN401 - a message
        info = self._types.empty("action_msgs/msg/GoalInfo")
        info.goal_id.uuid = list(goal.identity)
        _set_time(info.stamp, goal.stamp_ns)
        return info


def _set_time(time: Any, stamp_ns: int) -> None:  # noqa: ANN401 - `builtin_interfaces/Time`
    time.sec, time.nanosec = divmod(stamp_ns, _NANO)
