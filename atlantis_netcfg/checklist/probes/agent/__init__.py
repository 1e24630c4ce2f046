"""The agent: a program that runs on a remote host, sends all requests there at once, and prints one line per result.

It uses Python 3.8 and the standard library, because a gateway with Ubuntu 20.04 has no more, and it leaves no files:
its source is sent over standard input together with the requests, compressed and without docstrings. It sends only the
requests that it is given; it does not disturb a serial port or UDP port that a program of the vehicle holds. A request
that fails, hangs or crashes does not affect the others.

This module packs the program and its requests, and parses its results; it is not sent itself.
"""

from __future__ import annotations

import ast
import functools
import json
import zlib
from base64 import b64decode
from dataclasses import dataclass, field
from importlib import resources
from typing import Any, Iterable, Mapping, Sequence

from atlantis_netcfg.checklist.probes.base import (
    Answer,
    CommandResult,
    DdsDiscoverRequest,
    DdsDiscoverResult,
    DhcpDiscoverRequest,
    DhcpOffer,
    DhcpOffers,
    Listen,
    Question,
    ReflectReply,
    ReflectRequest,
    ReflectResult,
    RouterAdvertisement,
    RouterAdvertisements,
    RouterSolicitRequest,
    RunProgram,
    Transcript,
    Trouble,
)

__all__ = ["BOOT", "MODULES", "Batch", "batch", "program", "read_result"]


BOOT = "import sys,zlib;exec(zlib.decompress(sys.stdin.buffer.read()))"
"""Program for `python3 -I -c`; the rest arrives on its standard input."""
MODULES = ("streams", "main")
"""Modules in import order."""
_PACKAGE = "atlantis_netcfg.checklist.probes.agent"
_LOADER = """
import json,sys,types
for name,text in {sources!r}:
 made=sys.modules[name]=types.ModuleType(name)
 exec(compile(text,name,"exec"),made.__dict__)
made.main(json.loads({asked!r}))
"""


def program(request: dict[str, Any]) -> bytes:
    """Pack the program together with its requests (`Batch.request`)."""
    words = json.dumps(request, separators=(",", ":"))
    return zlib.compress(_LOADER.format(sources=_sources(), asked=words).encode(), 9)


@functools.lru_cache(maxsize=1)
def _sources() -> tuple[tuple[str, str], ...]:
    here = resources.files(_PACKAGE)
    texts = ((name, (here / f"{name}.py").read_text(encoding="utf-8")) for name in MODULES)
    return tuple((f"{_PACKAGE}.{name}", _bare(text)) for name, text in texts)


def _bare(source: str) -> str:
    """Blank out docstrings; lines keep their numbers, so that tracebacks match the file."""
    lines = source.splitlines()
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Expr) or not isinstance(node.value, ast.Constant) or node.end_lineno is None:
            continue
        first, last = node.lineno - 1, node.end_lineno
        # Something has to stand where a docstring was all there is.
        lines[first:last] = [" " * node.col_offset + '""', *[""] * (last - first - 1)]
    return "\n".join(line.rstrip() for line in lines)


_BREATH_S = 1.0
"""Seconds between two requests to the same endpoint; also the spare time at the end."""
_SEGMENT_EXTRA_S = 10.0
"""Seconds to find the interface that has an address."""


@dataclass(frozen=True)
class Batch:
    """Requests for the program, and their maximum duration."""

    request: dict[str, Any] = field(repr=False)
    keys: tuple[str, ...]
    within_s: float


def batch(questions: Sequence[tuple[str, Question]]) -> Batch:
    """Build the program's batch; requests for the same endpoint or turn run one after the other, in this order.

    Raises ValueError for a request that the program does not support.
    """
    last: dict[object, int] = {}
    over_s: list[float] = []
    rows = []
    for number, (key, question) in enumerate(questions):
        wants = _wants(question)
        after = sorted({last[want] for want in wants if want in last})
        waits_s = max((over_s[item] + _BREATH_S for item in after), default=0.0)
        over_s.append(waits_s + _patience_s(question))
        last.update(dict.fromkeys(wants, number))
        rows.append({"key": key, "after": after, **_row(question)})
    within_s = max(over_s, default=0.0) + _BREATH_S
    return Batch({"questions": rows, "deadline_s": within_s}, tuple(key for key, _ in questions), within_s)


def read_result(result: Mapping[str, Any], question: Question, request_time: float, now: float) -> Answer:
    """Parse one result. `request_time`, `now`: when the requests were sent and it arrived, seconds since 1970.

    Raises RuntimeError with the message of an internal fault of the program.
    """
    if "fault" in result:
        raise RuntimeError(f"the program that listens failed: {result['fault']}")
    trouble = Trouble(result["trouble"]) if result["trouble"] is not None else None
    words = str(result["words"])
    if isinstance(question, Listen):
        chunks = tuple((at, _bytes(data)) for at, data in result.get("chunks", ()))
        times = (result.get("began", 0.0), result.get("ended_s", 0.0))
        return Transcript(trouble, words, chunks, *times, tuple(result.get("senders", ())))
    if isinstance(question, RunProgram):
        values = {name: result[name] for name in ("rc", "out", "err", "began") if name in result}
        return CommandResult(trouble, words, **values, request_time=request_time, response_time=now)
    if isinstance(question, DdsDiscoverRequest):
        datagrams = tuple((source, _bytes(data)) for source, data in result.get("datagrams", ()))
        return DdsDiscoverResult(trouble, words, bytes.fromhex(result.get("prefix", "")), datagrams)
    if isinstance(question, ReflectRequest):
        answers = tuple(
            ReflectReply(sender, interface, delay_s, _bytes(data))
            for sender, interface, delay_s, data in result.get("answers", ())
        )
        return ReflectResult(trouble, words, tuple(result.get("tokens", ())), answers)
    if isinstance(question, RouterSolicitRequest):
        rows = ({**row, "prefixes": tuple(row["prefixes"])} for row in result.get("routers", ()))
        return RouterAdvertisements(trouble, words, tuple(RouterAdvertisement(**row) for row in rows))
    return DhcpOffers(trouble, words, tuple(_offers(result.get("offers", ()))))


def _offers(result: Iterable[Mapping[str, Any]]) -> Iterable[DhcpOffer]:
    return (DhcpOffer(**{name: row[name] for name in ("server", "mac", "address", "router")}) for row in result)


def _bytes(payload: str | list[str]) -> bytes:
    return payload.encode("latin-1") if isinstance(payload, str) else b64decode(payload[0])


def _wants(question: Question) -> set[object]:
    """Return what only one request at a time can use; a port that serves one client would reject a second one."""
    word = question.turn if isinstance(question, Listen | RunProgram) else ""
    turn: set[object] = {("turn", word)} if word else set()
    if not isinstance(question, Listen):
        return turn
    if question.transport == "serial":
        return {question.device, *turn}
    return {(question.transport, question.address if question.transport == "tcp" else "", question.port), *turn}


def _patience_s(question: Question) -> float:
    """Return the maximum duration of a request."""
    if isinstance(question, Listen):
        return question.connect_s + sum(say.within_s for say in question.say) + question.listen_s
    if isinstance(question, RunProgram | DdsDiscoverRequest | ReflectRequest):
        return question.within_s
    if isinstance(question, DhcpDiscoverRequest | RouterSolicitRequest):
        return question.within_s + _SEGMENT_EXTRA_S
    raise ValueError(f"{type(question).__name__} is no question of the program that listens")


def _row(question: Question) -> dict[str, Any]:
    if isinstance(question, Listen):
        return {
            "kind": question.transport,
            "address": question.address,
            "port": question.port,
            "device": question.device,
            "baud": question.baud,
            "say": [[say.data.decode("latin-1"), say.until.decode("latin-1"), say.within_s] for say in question.say],
            "listen_s": question.listen_s,
            "enough": question.enough.decode("latin-1"),
            "connect_s": question.connect_s,
            "max_bytes": question.max_bytes,
        }
    if isinstance(question, RunProgram):
        return {"kind": "run", "argv": list(question.argv), "within_s": question.within_s}
    if isinstance(question, DdsDiscoverRequest):
        there = {"address": question.address, "domain": question.domain, "ports": list(question.ports)}
        return {"kind": "dds", **there, "within_s": question.within_s}
    if isinstance(question, ReflectRequest):
        there = {"source": question.source, "address": question.address, "port": question.port}
        return {"kind": "reflect", **there, "count": question.count, "within_s": question.within_s}
    if isinstance(question, RouterSolicitRequest):
        return {"kind": "routers", "interface": question.interface, "within_s": question.within_s}
    assert isinstance(question, DhcpDiscoverRequest)  # noqa: S101 - `_patience_s` has refused all others
    segment = {"interface": question.interface, "cards": list(question.cards)}
    return {"kind": "dhcp", **segment, "within_s": question.within_s}
