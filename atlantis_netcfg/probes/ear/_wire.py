"""Questions as the program gets them, and its answers as the probes get them."""

from __future__ import annotations

from base64 import b64decode
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Iterable, Mapping, Sequence

from atlantis_netcfg.probes.answers import Offer, Offered, Ran, Transcript, Trouble
from atlantis_netcfg.probes.questions import Listen, Probing, Run

if TYPE_CHECKING:
    from atlantis_netcfg.probes.answers import Answer
    from atlantis_netcfg.probes.questions import Question

__all__ = ["Batch", "batch", "heard"]

_BREATH_S = 1.0
"""Between two questions to the same port, and to spare."""
_DHCP_EXTRA_S = 10.0
"""To find the interface that has an address."""


@dataclass(frozen=True)
class Batch:
    """What the program is asked, and how long that takes at most."""

    asked: dict[str, Any] = field(repr=False)
    keys: tuple[str, ...]
    within_s: float


def batch(questions: Sequence[tuple[str, Question]]) -> Batch:
    """Make the program's questions; those that want the same end or the same turn wait for each other, in this order.

    ValueError for a question that is none of the program's.
    """
    within_s = {key: _patience_s(question) for key, question in questions}
    queues = _queues(questions)
    longest_s = max((sum(within_s[key] + _BREATH_S for key, _ in queue) for queue in queues), default=0.0)
    rows = [[_row(key, question) for key, question in queue] for queue in queues]
    return Batch({"queues": rows, "deadline_s": longest_s}, tuple(within_s), longest_s)


def _queues(questions: Sequence[tuple[str, Question]]) -> list[list[tuple[str, Question]]]:
    """Put together what must not be asked at once; of questions that belong to two queues these become one."""
    queues: list[tuple[set[object], list[str]]] = []
    for key, question in questions:
        wants, keys = _wants(key, question), [key]
        for one in [one for one in queues if one[0] & wants]:
            queues.remove(one)
            wants, keys = wants | one[0], one[1] + keys
        queues.append((wants, keys))
    place = {key: number for number, (key, _) in enumerate(questions)}
    by_key = dict(questions)
    return [[(key, by_key[key]) for key in sorted(keys, key=place.__getitem__)] for _, keys in queues]


def heard(told: Mapping[str, Any], question: Question, asked: float, now: float) -> Answer:
    """Read one answer of the program. `asked`, `now`: when the questions left and this answer came, seconds since 1970.

    Raises RuntimeError with the words of a fault of the program's own.
    """
    if "fault" in told:
        raise RuntimeError(f"the program that listens failed: {told['fault']}")
    trouble = Trouble(told["trouble"]) if told["trouble"] is not None else None
    words = str(told["words"])
    if isinstance(question, Listen):
        chunks = tuple((at, _bytes(data)) for at, data in told.get("chunks", ()))
        return Transcript(trouble, words, chunks, told.get("began", 0.0), told.get("ended_s", 0.0))
    if isinstance(question, Run):
        said = {name: told[name] for name in ("rc", "out", "err", "began") if name in told}
        return Ran(trouble, words, **said, asked=asked, heard=now)
    return Offered(trouble, words, tuple(_offers(told.get("offers", ()))))


def _offers(told: Iterable[Mapping[str, Any]]) -> Iterable[Offer]:
    return (Offer(**{name: one[name] for name in ("server", "mac", "address", "router")}) for one in told)


def _bytes(packed: str | list[str]) -> bytes:
    return packed.encode("latin-1") if isinstance(packed, str) else b64decode(packed[0])


def _wants(key: str, question: Question) -> set[object]:
    """What only one question at a time can have; a port that serves one client would turn the second away."""
    if not isinstance(question, Listen):
        return {key}
    turn: set[object] = {("turn", question.turn)} if question.turn else set()
    if question.transport == "serial":
        return {question.device, *turn}
    return {(question.transport, question.address if question.transport == "tcp" else "", question.port), *turn}


def _patience_s(question: Question) -> float:
    """How long it takes at most."""
    if isinstance(question, Listen):
        return question.connect_s + sum(say.within_s for say in question.say) + question.listen_s
    if isinstance(question, Run):
        return question.within_s
    if isinstance(question, Probing):
        return question.within_s + _DHCP_EXTRA_S
    raise ValueError(f"{type(question).__name__} is no question of the program that listens")


def _row(key: str, question: Question) -> dict[str, Any]:
    if isinstance(question, Listen):
        return {
            "key": key,
            "kind": question.transport,
            "address": question.address,
            "port": question.port,
            "device": question.device,
            "baud": question.baud,
            "say": [[one.data.decode("latin-1"), one.until.decode("latin-1"), one.within_s] for one in question.say],
            "listen_s": question.listen_s,
            "enough": question.enough.decode("latin-1"),
            "connect_s": question.connect_s,
            "max_bytes": question.max_bytes,
        }
    if isinstance(question, Run):
        return {"key": key, "kind": "run", "argv": list(question.argv), "within_s": question.within_s}
    assert isinstance(question, Probing)  # noqa: S101 - `_patience_s` has refused all others
    return {"key": key, "kind": "dhcp", "interface": question.interface, "within_s": question.within_s}
