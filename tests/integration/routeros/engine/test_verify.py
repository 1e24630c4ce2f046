"""`verify` on twins: everything holds, and whatever is turned off is told, alone."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from engine_bench import Bench, on

from atlantis_netcfg.core.errors import DeviceError
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.emulator.routeros import Deviation, Execute, ModemSpec, WireBehaviour
from atlantis_netcfg.routeros.api import Session
from atlantis_netcfg.routeros.assumptions import ASSUMPTIONS, READS
from atlantis_netcfg.routeros.verify import (
    CHECKS,
    MARK,
    TRIES,
    AssumptionFinding,
    SeenAnswers,
    fall_silent,
    read,
    try_out,
)

pytestmark = pytest.mark.slow

READING = {each.id for each in ASSUMPTIONS if each.proof == READS}
MODEM = ModemSpec()
SEED = "/tool netwatch add host=192.0.2.1 type=icmp\n"


def bench(tmp_path: Path, **changes: Any) -> Bench:  # noqa: ANN401 - fields of RouterSpec, and `knobs`
    """A router with a modem, a row of netwatch, and a history."""
    knobs = changes.pop("knobs", None)
    return Bench(tmp_path, knobs=knobs, spec={"seed": SEED, "modem": MODEM, **changes})


async def _with_history(bench: Bench) -> None:
    for comment in ("first", "second"):
        await bench.router.console(["/interface/set", "=.id=ether1", f"=comment={comment}"])


async def reading(bench: Bench) -> SeenAnswers:
    await _with_history(bench)
    return await read(bench.job().endpoint)


async def trying(bench: Bench) -> SeenAnswers:
    before = bench.export()
    seen = await reading(bench)
    before = bench.export()
    seen = seen.with_findings(await try_out(bench.job().endpoint))
    assert bench.export() == before
    assert MARK not in before
    return seen


def failed(seen: SeenAnswers) -> set[str]:
    return {finding.id for finding in seen.findings if finding.verdict in {Verdict.FAIL, Verdict.INCONCLUSIVE}}


def passed(seen: SeenAnswers) -> set[str]:
    return {finding.id for finding in seen.findings if finding.verdict is Verdict.PASS}


@pytest.mark.smoke("7.20.8")
@pytest.mark.parametrize("version", ["7.18.2", "7.20.8", "7.21.5"])
def test_all_assumptions_hold(tmp_path: Path, version: str) -> None:
    seen = on(bench(tmp_path, version=version), trying)
    assert (failed(seen), passed(seen)) == (set(), READING | set(TRIES))


def test_device_without_safe_mode_is_only_read(tmp_path: Path) -> None:
    async def act(bench: Bench) -> SeenAnswers:
        seen = await reading(bench)
        with pytest.raises(DeviceError, match="this device has no safe mode over the API"):
            await try_out(bench.job().endpoint)
        return seen

    seen = on(bench(tmp_path, version="7.16"), act)
    assert (failed(seen), passed(seen)) == (set(), READING)


def test_renamed_modem_is_read_under_its_new_name(tmp_path: Path) -> None:
    async def act(bench: Bench) -> SeenAnswers:
        await bench.router.console(["/interface/lte/set", "=.id=lte1", "=name=starlink"])
        return await reading(bench)

    seen = on(bench(tmp_path), act)
    assert (failed(seen), passed(seen)) == (set(), READING)


OFF_BY_READING: dict[str, dict[str, Any]] = {
    "api-flight-100": {"knobs": WireBehaviour(hang_at=25)},
    "tls-version": {"knobs": WireBehaviour(tls="1.3")},
    **{each: {"deviations": (Deviation(each),)} for each in CHECKS},
}


@pytest.mark.smoke("tls-version")
@pytest.mark.parametrize("name", OFF_BY_READING)
def test_violated_assumption_is_detected_by_reading(tmp_path: Path, name: str) -> None:
    seen = on(bench(tmp_path, **OFF_BY_READING[name]), reading)
    assert (failed(seen), passed(seen)) == ({name}, READING - {name})


OFF_BY_TRYING: dict[str, dict[str, Any]] = {
    "api-flight-24": {"knobs": WireBehaviour(hang_writes_at=24)},
    "api-tagged-order": {"knobs": WireBehaviour(shuffle=3)},
    "execute-error-text": {"execute": Execute.TRAP},
    "safe-mode-close": {"unroll_delay_s": 60.0},
    **{
        each: {"deviations": (Deviation(each),)}
        for each in TRIES
        if each not in {"api-flight-24", "api-tagged-order", "execute-error-text", "safe-mode-close"}
    },
}


@pytest.mark.smoke("api-tagged-order")
@pytest.mark.parametrize("name", OFF_BY_TRYING)
def test_violated_assumption_is_detected_by_trying(tmp_path: Path, name: str) -> None:
    seen = on(bench(tmp_path, **OFF_BY_TRYING[name]), trying)
    wrong = {finding.id for finding in seen.findings if finding.verdict is Verdict.FAIL}
    assert wrong == {name}
    if name != "api-flight-24":  # a session that was lost shows nothing after it
        assert failed(seen) == {name}


@pytest.mark.parametrize(
    ("silent_s", "verdict"), [(540.0, Verdict.PASS), (900.0, Verdict.FAIL), (5.0, Verdict.INCONCLUSIVE)]
)
def test_a_silent_session_is_noticed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, silent_s: float, verdict: Verdict
) -> None:
    async def act(bench: Bench) -> AssumptionFinding:
        # The emulated link is what has died: its time jumps, and the kernel's does not.
        monkeypatch.setattr(Session, "fall_silent", lambda _: bench.router.vanish())
        before = bench.export()
        found = await fall_silent(bench.job().endpoint)
        assert bench.export() == before
        return found

    found = on(bench(tmp_path, silent_timeout_s=silent_s), act)
    assert (found.id, found.verdict) == ("api-silent-session", verdict)


def test_holder_of_safe_mode_is_left_alone(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        await bench.router.console(["/safe-mode/take"])
        with pytest.raises(DeviceError, match="somebody else holds safe mode on this device"):
            await try_out(bench.job().endpoint)
        (row,) = [answer for answer in await bench.router.console(["/safe-mode/print"]) if answer.kind == "!re"]
        assert "=current=true" in row.words

    on(bench(tmp_path), act)


def test_scratch_rows_of_an_earlier_try_are_reported_with_a_command(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        await bench.router.console(["/interface/bridge/add", "=name=left", f"=comment={MARK}"])
        before = bench.export()
        with pytest.raises(DeviceError, match="1 scratch rows of an earlier try") as refused:
            await try_out(bench.job().endpoint)
        assert f'/interface bridge remove [find comment="{MARK}"]' in str(refused.value.hint)
        assert bench.export() == before

    on(bench(tmp_path), act)


@pytest.mark.smoke
def test_unpinned_device_is_refused(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        with pytest.raises(DeviceError, match="certificate"):
            await read(replace(bench.job().endpoint, pin=None))
        assert bench.router.counters().logins == 0

    on(bench(tmp_path), act)
