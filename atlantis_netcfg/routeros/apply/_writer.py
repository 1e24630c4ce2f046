"""Sending actions: as scripts, which run in order and report their progress, or sentence by sentence.

No document defines the order in which a device executes tagged sentences, but script lines run in order. So a script
costs one round trip, while sentences of an ordered menu cost one each.

Assumption: execute-stops
Assumption: execute-error-text
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import groupby
from typing import TYPE_CHECKING, Protocol

from atlantis_netcfg.core.errors import DeviceError
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.routeros import api
from atlantis_netcfg.routeros._types import Action, Verb
from atlantis_netcfg.routeros.apply import _scripts
from atlantis_netcfg.routeros.commands import script_command, sentence
from atlantis_netcfg.routeros.menus import MENUS

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from atlantis_netcfg.routeros.api._values import Channel

_AT_ONCE = 8
"""Maximum number of scripts in one turn."""
_INDEPENDENT = frozenset({"/ip/dhcp-server/lease", "/ip/dns/static", "/ip/firewall/address-list", "/system/logging"})
"""Menus whose rows have no order and never refer to each other."""
_PLACE = re.compile(r"\(line (\d+) column \d+\)")


class ActionError(DeviceError):
    """The device refused one action; the actions before it were executed."""


@dataclass(frozen=True, slots=True)
class WriteResult:
    """Result of one turn of writing."""

    acknowledged_numbers: tuple[int, ...]
    refusal: str | None
    """The device's error message, with the action that caused it; None: no error."""
    beside: tuple[api.Reply, ...]
    """Replies to commands in the same round trip: before, after or while the actions were executed."""


class Writer(Protocol):
    """Sends actions in turns. A turn is journalled with its actions before it is sent."""

    def turns(self, actions: Sequence[Action]) -> Iterator[tuple[Action, ...]]:
        """Split actions into turns of one round trip each."""

    async def send(self, session: Channel, turn: Sequence[Action], beside: Sequence[api.Command] = ()) -> WriteResult:
        """Send one turn together with the commands in `beside`; return its result."""


class ScriptWriter:
    """Sends scripts; the device stops each one at its first error."""

    def turns(self, actions: Sequence[Action]) -> Iterator[tuple[Action, ...]]:
        """Split where a script would become too long; rows that are independent go into several scripts at once."""
        turn: list[Action] = []
        count = 0
        for _, inside in _scripts.scripts(actions):
            if turn and (count == _AT_ONCE or not _are_independent((*turn, *inside))):
                yield tuple(turn)
                turn, count = [], 0
            turn += inside
            count += 1
        if turn:
            yield tuple(turn)

    async def send(self, session: Channel, turn: Sequence[Action], beside: Sequence[api.Command] = ()) -> WriteResult:
        """Run the scripts of one turn."""
        parts = list(_scripts.scripts(turn))
        answers = await session.flight([*(script_command(text) for text, _ in parts), *beside])
        result = [_output(inside, reply) for (_, inside), reply in zip(parts, answers, strict=False)]
        executed_numbers = dict.fromkeys(number for numbers, _ in result for number in numbers)
        refusal = next((words for _, words in result if words is not None), None)
        return WriteResult(tuple(executed_numbers), refusal, tuple(answers[len(parts) :]))


class SentenceWriter:
    """For devices that cannot run our scripts: one sentence per action, several at once if the order is irrelevant."""

    def turns(self, actions: Sequence[Action]) -> Iterator[tuple[Action, ...]]:
        """Put additions to one unordered menu into one turn; every other action gets its own turn."""
        for (together, *_), group in groupby(actions, key=_kind):
            members = tuple(group)
            size = api.WINDOW - 1 if together else 1
            yield from (members[start : start + size] for start in range(0, len(members), size))

    async def send(self, session: Channel, turn: Sequence[Action], beside: Sequence[api.Command] = ()) -> WriteResult:
        """Send the sentences of one turn at once."""
        answers = await session.flight([*(api.Command(*sentence(action)) for action in turn), *beside])
        replies, others = answers[: len(turn)], answers[len(turn) :]
        executed_numbers = tuple(
            action.number for action, reply in zip(turn, replies, strict=True) if reply.trap is None
        )
        refusal = next(
            (_refusal(action, reply.trap.message) for action, reply in zip(turn, replies, strict=True) if reply.trap),
            None,
        )
        return WriteResult(executed_numbers, refusal, tuple(others))


def _kind(action: Action) -> tuple[bool, str, int]:
    """Return a key of actions that may share a turn; its first item tells if they may at all."""
    return action.verb is Verb.ADD and not MENUS[action.menu].is_ordered, action.menu, action.layer


def _are_independent(actions: Sequence[Action]) -> bool:
    return all(action.verb is Verb.ADD and action.menu in _INDEPENDENT for action in actions)


def _output(turn: Sequence[Action], reply: api.Reply) -> tuple[tuple[int, ...], str | None]:
    """Return the actions that a script acknowledged, and the refusal that stopped it, if any."""
    result = _scripts.output(reply.ret or "")
    if reply.trap is None and list(result.acknowledged_numbers) == [action.number for action in turn]:
        return result.acknowledged_numbers, None
    words = reply.trap.message if reply.trap is not None else result.words
    return result.acknowledged_numbers, _refusal(_culprit(turn, reply, len(result.acknowledged_numbers), words), words)


def _culprit(turn: Sequence[Action], reply: api.Reply, acknowledged_count: int, words: str) -> Action | None:
    """Find the action that stopped the script: by the reported line, else the one after the last acknowledged."""
    place = _PLACE.search(words)
    if place is not None:
        return _scripts.action_at(turn, int(place[1]))
    is_lost = reply.trap is not None and not acknowledged_count
    return None if is_lost or acknowledged_count >= len(turn) else turn[acknowledged_count]


def _refusal(action: Action | None, words: str) -> str:
    text = words or "it stopped without a message"
    if action is None:
        return msg(f"the device says: {arg(text)}")
    return msg(
        f"the device refused to {arg(action.verb.value)} {arg(action.subject)} in {arg(MENUS[action.menu].title)}: "
        f"{arg(text)}"
    )
