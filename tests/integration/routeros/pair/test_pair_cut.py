"""A run is cut at every sentence of either end in every way: both ends are as before, or both as declared."""

import asyncio
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from pair_bench import LINK_TIMEOUT_S, PairBench, Words, on, without_job

from atlantis_netcfg.emulator.routeros import Deviation, FaultKind, LinkFault
from atlantis_netcfg.routeros import DeviceResult, JobMode, Status

pytestmark = pytest.mark.slow

NEW = Words(ssid="new name", key="a new key for both ends", frequency=5520)
KINDS = (FaultKind.DROP, FaultKind.VANISH, FaultKind.REBOOT, FaultKind.POWER, FaultKind.GAP)
GAP_S = 20.0
LONG_S = 1200.0
"""More than the declared time, nine minutes of a dead session, and a reboot."""
ADVICE = 4
"""So many commands may follow one another until nothing is left to do."""
SETTLED = (Status.CHANGED, Status.ROLLED_BACK, Status.LEFT_AS_FOUND)

Exports = tuple[str, str]


@dataclass(frozen=True)
class Clean:
    """A run that nothing disturbs."""

    before: Exports
    after: Exports
    near: int
    far: int
    """Sentences of each end."""


@cache
def clean(family: str) -> Clean:
    async def act(bench: PairBench) -> Clean:
        before = bench.exports()
        results = await bench.converge(NEW)
        assert [result.status for result in results] == [Status.CHANGED] * 2, [result.message for result in results]
        near, far = (bench.router(name).counters().sentences for name in ("near", "far"))
        return Clean(before, bench.exports(), near, far)

    with TemporaryDirectory() as folder:
        return on(PairBench(Path(folder), family=family), act)


def state(bench: PairBench) -> Exports:
    near, far = bench.exports()
    return near, without_job(far)


def cut(
    tmp_path: Path, end: str, fault: LinkFault, family: str = "legacy", deviations: tuple[Deviation, ...] = ()
) -> tuple[DeviceResult, DeviceResult]:
    """Cut one run, hold it to its word, and see that both ends are alike, and that the next run gets through."""
    whole = clean(family)

    async def act(
        bench: PairBench,
    ) -> tuple[tuple[DeviceResult, DeviceResult], Exports, Exports, Exports, list[Status]]:
        bench.router(end).arm(fault)
        results = await bench.converge(NEW)
        then = state(bench)
        bench.router(end).disarm()
        await asyncio.sleep(LONG_S)
        later = state(bench)
        resumed = await bench.converge(NEW, JobMode.RESUME)
        again = await bench.converge(NEW)
        assert [result.status for result in again] == [Status.UNCHANGED] * 2, (fault, again[0].message)
        return results, then, later, bench.exports(), [result.status for result in resumed]

    results, then, later, finally_, resumed = on(
        PairBench(tmp_path, family=family, spec={"deviations": deviations}), act
    )
    words = [(result.status.value, result.message) for result in results]
    assert later in (whole.before, whole.after), (end, fault, words, later)
    if all(result.status in SETTLED for result in results):
        assert then == later, (end, fault, words)
        changed = {result.status is Status.CHANGED for result in results}
        assert changed == {then == whole.after}, (end, fault, words)
    assert finally_ == whole.after, (end, fault, words, resumed)
    assert set(resumed) <= {Status.CHANGED, Status.UNCHANGED}
    return results


SAMPLE = [
    ("far", "/system/scheduler/add", 1),
    ("far", "/safe-mode/take", 1),
    ("far", "/execute", 3),
    ("far", "/safe-mode/release", 1),
    ("far", "/system/scheduler/remove", 1),
    ("near", "/safe-mode/take", 1),
    ("near", "/execute", 3),
    ("near", "/safe-mode/release", 1),
]
"""Where it hurts."""


CUTS = [
    (kind, *place)
    for place in SAMPLE
    for kind in (FaultKind.DROP, FaultKind.VANISH, FaultKind.POWER)
    if kind is not FaultKind.DROP or place[1] in ("/execute", "/safe-mode/release")
]


@pytest.mark.smoke("vanish far /safe-mode/release", "power near /execute")
@pytest.mark.parametrize(
    ("kind", "end", "path", "nth"), CUTS, ids=[f"{kind} {end} {path}" for kind, end, path, _ in CUTS]
)
def test_fault_at_a_critical_point_ends_consistently(
    tmp_path: Path, kind: FaultKind, end: str, path: str, nth: int
) -> None:
    results = cut(tmp_path, end, LinkFault(do=kind, match=path, sentence=nth, when="after"))
    assert all(result.exit.value in (0, 4, 5) for result in results)


@pytest.mark.smoke("far /safe-mode/take")
@pytest.mark.parametrize(("end", "path", "nth"), SAMPLE, ids=[f"{end} {path}" for end, path, _ in SAMPLE])
def test_power_loss_that_keeps_safe_mode_changes_ends_consistently(
    tmp_path: Path, end: str, path: str, nth: int
) -> None:
    """Without `safe-mode-power-loss`."""
    fault = LinkFault(do=FaultKind.POWER, match=path, sentence=nth, when="after")
    results = cut(tmp_path, end, fault, deviations=(Deviation.POWER_LOSS,))
    assert all(result.exit.value in (0, 4, 5) for result in results)


def faults() -> Iterator[tuple[FaultKind, str]]:
    for kind in KINDS:
        yield kind, "before"
        yield kind, "after"


async def armed(bench: PairBench) -> list[str]:
    """What is armed or open on either end, read from the twins' own consoles."""
    found = []
    for name in ("near", "far"):
        jobs = str(await bench.router(name).console(["/system/scheduler/print"]))
        hold = str(await bench.router(name).console(["/safe-mode/print"]))
        found += [f"{name}: {word}" for word, text in (("atlantis-", jobs), ("=enabled=true", hold)) if word in text]
    return found


@pytest.mark.smoke("power far /execute")
@pytest.mark.parametrize(
    ("kind", "end", "path", "nth"), CUTS, ids=[f"{kind} {end} {path}" for kind, end, path, _ in CUTS]
)
def test_nothing_is_armed_when_the_advice_was_followed(
    tmp_path: Path, kind: FaultKind, end: str, path: str, nth: int
) -> None:
    """At once, without waiting for anything to run down: exit 5 says `resume`, exit 4 the same command again."""

    async def act(bench: PairBench) -> tuple[list[str], list[str], bool]:
        bench.router(end).arm(LinkFault(do=kind, match=path, sentence=nth, when="after"))
        results = await bench.converge(NEW)
        bench.router(end).disarm()
        told = []
        for _ in range(ADVICE):
            told += [f"{each.status.value}: {each.message}" for each in results]
            if all(each.exit.value == 0 for each in results):
                break
            resumes = any(each.exit.value == 5 or "resume" in (each.hint or "") for each in results)
            results = await bench.converge(NEW, JobMode.RESUME if resumes else JobMode.APPLY)
        assert all(each.exit.value == 0 for each in results), told
        left, before = await armed(bench), bench.exports()
        await asyncio.sleep(LONG_S)
        return told, left, bench.exports() == before

    told, left, stays = on(PairBench(tmp_path), act)
    assert left == [], told
    assert stays, told


@pytest.mark.campaign
@pytest.mark.timeout(3600)
@pytest.mark.parametrize(("kind", "when"), list(faults()))
@pytest.mark.parametrize("end", ["near", "far"])
@pytest.mark.parametrize("family", ["legacy", "wifi"])
def test_fault_at_every_sentence_ends_consistently(
    tmp_path: Path, family: str, end: str, kind: FaultKind, when: str
) -> None:
    whole = clean(family)
    assert LINK_TIMEOUT_S < LONG_S
    for sentence in range(1, (whole.near if end == "near" else whole.far) + 1):
        fault = LinkFault.model_validate({"do": kind, "when": when, "sentence": sentence, "seconds": GAP_S})
        cut(tmp_path / str(sentence), end, fault, family)
