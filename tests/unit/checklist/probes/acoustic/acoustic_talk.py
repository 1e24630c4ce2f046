"""What a probe hears of an emulated modem: the twin's own talker without a socket and without waiting.

It keeps to the contract of `Say` and `Listen` as the ear does: a saying waits for its answer, a script stops at the
first that does not come, the listening goes on. Time is counted, not spent.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace

from atlantis_netcfg.checklist.probes import Answer, Listen, Probe, ProbeResult, Transcript, Trouble
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.emulator.acoustic import EvologicsSpec, RunningEvologics, RunningSeatrac, SeatracSpec
from atlantis_netcfg.emulator.acoustic._line import LineSpec

Twin = RunningEvologics | RunningSeatrac
STEP_S = 0.01


def twin_of(spec: LineSpec) -> Twin:
    if isinstance(spec, SeatracSpec):
        return RunningSeatrac(spec)
    assert isinstance(spec, EvologicsSpec)
    return RunningEvologics(spec)


def talk(twin: Twin, listen: Listen) -> Transcript:
    """Carry out a script."""
    spec = twin.spec
    if spec.refuses or spec.is_occupied:
        return Transcript(Trouble.REFUSED if spec.refuses else Trouble.CLOSED, "in the system's words")
    talker, chunks, now_s = twin.talker(), [(0.0, b"")], 0.0

    def heard_by(until_s: float, ends: bytes, since: int) -> Iterator[bool]:
        nonlocal now_s
        while True:
            told, then_s = talker.tell(now_s)
            if told and not spec.silent:
                chunks.append((now_s, told))
            so_far = b"".join(data for _, data in chunks)[since:]
            yield bool(ends) and re.search(ends, so_far) is not None
            if now_s >= until_s:
                return
            # Straight to when something comes.
            now_s = until_s if then_s is None else min(until_s, max(then_s, now_s + STEP_S))

    answers = 0
    for say in listen.say:
        since = sum(len(data) for _, data in chunks)
        said, _ = talker.hear(say.data)
        for answer in said:
            answers += 1
            if not spec.silent and (spec.mute_after is None or answers <= spec.mute_after):
                chunks.append((now_s, answer if spec.noise is None else spec.noise))
        if not any(heard_by(now_s + say.within_s, say.until, since)):
            break
    _ = any(heard_by(now_s + listen.listen_s, listen.enough, 0))
    return Transcript(None, "", tuple(chunk for chunk in chunks if chunk[1]), 1e9, now_s)


def bytewise(transcript: Transcript) -> Transcript:
    """The same, one byte at a time."""
    pieces = ((at, data[place : place + 1]) for at, data in transcript.chunks for place in range(len(data)))
    return replace(transcript, chunks=tuple(pieces))


def hear(probe: Probe, twins: Mapping[str, Twin]) -> dict[str, Answer]:
    """Ask each question of the twin that is at its address."""
    heard: dict[str, Answer] = {}
    for question in probe.asks():
        assert isinstance(question, Listen)
        heard[question.name] = talk(twins[question.address or question.device], question)
    return heard


def told(judged: ProbeResult) -> list[list[str]]:
    """Findings as the cases list them; whatever is not well says what to do."""
    assert all(one.hint for one in judged.findings if one.verdict is not Verdict.PASS)
    return [[str(one.verdict), one.code, one.message] for one in judged.findings]
