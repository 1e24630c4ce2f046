"""A run is cut at every sentence in every way: the router ends as before or as declared, as the status says."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from engine_bench import TEXT, Bench, leases, on

from atlantis_netcfg.emulator.routeros import Deviation, Execute, FaultKind, LinkFault
from atlantis_netcfg.routeros import DeviceResult, JobMode, Status

pytestmark = pytest.mark.slow

GAP_S = 70.0
LONG = TEXT + leases(70)
"""More than one safe mode can remember."""


@dataclass(frozen=True)
class Clean:
    """A run that nothing disturbs."""

    before: str
    after: str
    sentences: int


@cache
def clean(text: str, execute: Execute, seed: str = "", version: str = "7.18.2") -> Clean:
    async def act(bench: Bench) -> Clean:
        before = bench.export()
        await bench.converge()
        return Clean(before, bench.export(), bench.router.counters().sentences)

    with TemporaryDirectory() as folder:
        return on(Bench(Path(folder), text=text, spec={"execute": execute, "seed": seed, "version": version}), act)


def cut(  # noqa: PLR0913, PLR0917 - what is cut, and on what router
    tmp_path: Path,
    fault: LinkFault,
    text: str = TEXT,
    execute: Execute = Execute.OUTPUT,
    seed: str = "",
    version: str = "7.18.2",
    deviations: tuple[Deviation, ...] = (),
) -> DeviceResult:
    """Cut one run, hold it to its word, and see that the next one gets through."""

    async def act(bench: Bench) -> tuple[DeviceResult, str, DeviceResult, str]:
        bench.router.arm(fault)
        result = await bench.converge()
        then = bench.export()
        bench.router.disarm()
        return result, then, await bench.converge(JobMode.RESUME), bench.export()

    whole = clean(text, execute, seed, version)
    spec = {"execute": execute, "seed": seed, "version": version, "deviations": deviations}
    result, then, resumed, end = on(Bench(tmp_path, text=text, spec=spec), act)
    assert then == (whole.after if result.status is Status.CHANGED else whole.before), (fault, result.message)
    assert result.status in (Status.CHANGED, Status.ROLLED_BACK, Status.LEFT_AS_FOUND), (fault, result.message)
    assert resumed.status is (Status.UNCHANGED if result.status is Status.CHANGED else Status.CHANGED), fault
    assert end == whole.after
    return result


def faults() -> Iterator[tuple[FaultKind, str]]:
    for kind in FaultKind:
        yield kind, "before"
        yield kind, "after"


SAMPLE = [
    ("/login", 1, Status.LEFT_AS_FOUND),
    ("/ip/address/print", 1, Status.LEFT_AS_FOUND),
    ("/safe-mode/take", 1, Status.LEFT_AS_FOUND),
    ("/execute :parse", 1, Status.LEFT_AS_FOUND),
    ("/execute", 3, Status.ROLLED_BACK),
    ("/login", 2, None),
    ("/ip/address/print", 2, None),
    ("/safe-mode/release", 1, None),
]
"""Where it hurts, and how it ends unless the fault is only a gap; None where that depends on the fault."""


@pytest.mark.smoke(
    "drop-/login 1",
    "vanish-/execute 3",
    "truncate-/ip/address/print 2",
    "garbage-/safe-mode/take 1",
    "gap-/safe-mode/release 1",
)
@pytest.mark.parametrize(("path", "nth", "status"), SAMPLE, ids=[f"{path} {nth}" for path, nth, _ in SAMPLE])
@pytest.mark.parametrize(
    "kind", [FaultKind.DROP, FaultKind.VANISH, FaultKind.TRUNCATE, FaultKind.GARBAGE, FaultKind.GAP]
)
def test_fault_at_a_critical_point_has_the_expected_status(
    tmp_path: Path, kind: FaultKind, path: str, nth: int, status: Status | None
) -> None:
    result = cut(tmp_path, LinkFault(do=kind, match=path, sentence=nth, when="after", seconds=GAP_S))
    # A device that falls silent while it is only read is read again in smaller batches.
    goes_on = kind is FaultKind.GAP or (kind is FaultKind.VANISH and (path, nth) == ("/ip/address/print", 1))
    expected = Status.CHANGED if goes_on else status
    assert result.status is (expected or result.status)


@pytest.mark.smoke("/execute-before-power")
@pytest.mark.parametrize("kind", [FaultKind.REBOOT, FaultKind.POWER, FaultKind.HANG])
@pytest.mark.parametrize("when", ["before", "after"])
@pytest.mark.parametrize("path", ["/execute", "/safe-mode/release"])
def test_router_silent_during_apply_ends_as_expected(tmp_path: Path, kind: FaultKind, when: str, path: str) -> None:
    nth = 3 if path == "/execute" else 1
    result = cut(tmp_path, LinkFault.model_validate({"do": kind, "match": path, "sentence": nth, "when": when}))
    released = path == "/safe-mode/release" and when == "after"
    assert result.status is (Status.CHANGED if released else Status.ROLLED_BACK)


@pytest.mark.smoke("drop-4")
@pytest.mark.parametrize("nth", [3, 4, 5])
@pytest.mark.parametrize("kind", [FaultKind.DROP, FaultKind.POWER])
def test_long_plan_cut_between_its_parts_is_rolled_back_or_complete(tmp_path: Path, kind: FaultKind, nth: int) -> None:
    fault = LinkFault(do=kind, match="/execute", sentence=nth, when="after")
    assert cut(tmp_path, fault, LONG).status in (Status.ROLLED_BACK, Status.CHANGED)


@pytest.mark.smoke("script-after")
@pytest.mark.parametrize("when", ["before", "after"])
@pytest.mark.parametrize(
    ("where", "plan"),
    [
        (("/execute", 3), (TEXT, Execute.OUTPUT)),
        (("/safe-mode/release", 1), (TEXT, Execute.OUTPUT)),
        (("/execute", 4), (LONG, Execute.OUTPUT)),
        (("/ip/firewall/filter/add", 2), (TEXT, Execute.NONE)),
    ],
    ids=["script", "release", "long", "sentences"],
)
def test_power_loss_that_keeps_safe_mode_changes_still_ends_consistently(
    tmp_path: Path, where: tuple[str, int], when: str, plan: tuple[str, Execute]
) -> None:
    """Without `safe-mode-power-loss` the run reads what has stayed, and still ends as before or as declared."""
    fault = LinkFault.model_validate({"do": FaultKind.POWER, "match": where[0], "sentence": where[1], "when": when})
    cut(tmp_path, fault, *plan, deviations=(Deviation.POWER_LOSS,))


@pytest.mark.campaign
@pytest.mark.parametrize(("kind", "when"), list(faults()))
@pytest.mark.parametrize(
    ("text", "execute"),
    [(TEXT, Execute.OUTPUT), (LONG, Execute.OUTPUT), (TEXT, Execute.NONE), (TEXT, Execute.TRAP)],
    ids=["scripts", "long", "sentences", "traps"],
)
def test_fault_at_every_sentence_ends_consistently(
    tmp_path: Path, kind: FaultKind, when: str, text: str, execute: Execute
) -> None:
    for sentence in range(1, clean(text, execute).sentences + 1):
        fault = {"do": kind, "when": when, "sentence": sentence, "seconds": GAP_S}
        cut(tmp_path / str(sentence), LinkFault.model_validate(fault), text, execute)


@pytest.mark.campaign
@pytest.mark.parametrize("offset", [0, 1, 2, 3, 5, 8, 13, 21, 34, 55, 89])
@pytest.mark.parametrize("kind", [FaultKind.TRUNCATE, FaultKind.GARBAGE])
def test_corrupted_responses_end_consistently(tmp_path: Path, kind: FaultKind, offset: int) -> None:
    for sentence in range(1, clean(TEXT, Execute.OUTPUT).sentences + 1):
        cut(tmp_path / str(sentence), LinkFault(do=kind, when="after", sentence=sentence, offset=offset))
