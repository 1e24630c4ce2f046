"""Runs in which nothing goes wrong."""

import json
from pathlib import Path

import pytest
from engine_bench import TEXT, Bench, leases, on, without_header

from atlantis_netcfg.core.versions import NEWEST_KNOWN
from atlantis_netcfg.emulator.routeros import Execute, RouterLink, WireBehaviour
from atlantis_netcfg.routeros import DeviceResult, JobMode, Status, desired
from atlantis_netcfg.runs import (
    ActionConfirmation,
    DeviceObservation,
    LayerSent,
    Outcome,
    PlanRecord,
    ProtectionRecord,
    ReleaseRecord,
    RunStart,
    StateBackup,
)

HANDSHAKE = 3
"""Round trips of TCP's and of TLS 1.2's."""


async def twice(bench: Bench) -> tuple[DeviceResult, DeviceResult, int, int]:
    """Converge two times; the turns that the twin counted on its wire for each."""
    turns = []
    results = []
    for _ in range(2):
        bench.router.reset_counters()
        results.append(await bench.converge())
        turns.append(bench.router.counters().turns)
    return results[0], results[1], turns[0], turns[1]


def test_first_configuration_converges_and_second_run_is_unchanged(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    first, second, turns, idle = on(bench, twice)
    assert (first.status, first.message) == (Status.CHANGED, f"{first.planned_count} actions applied and verified")
    assert first.confirmed_count == first.planned_count > 20
    assert (second.status, second.planned_count, second.message) == (Status.UNCHANGED, 0, "no changes needed")
    assert first.round_trips == turns + first.sessions * HANDSHAKE <= 22
    assert second.round_trips == idle + HANDSHAKE <= 5


@pytest.mark.smoke("100")
@pytest.mark.parametrize("number", [0, 100, 300])
def test_round_trips_do_not_grow_with_the_number_of_items(tmp_path: Path, number: int) -> None:
    bench = Bench(tmp_path, text=TEXT + leases(number))
    first, second, turns, idle = on(bench, twice)
    assert (first.status, second.status) == (Status.CHANGED, Status.UNCHANGED)
    assert first.round_trips == turns + first.sessions * HANDSHAKE <= 22
    assert second.round_trips == idle + HANDSHAKE <= 5


def test_unchanged_run_takes_five_round_trips_over_a_slow_link(tmp_path: Path) -> None:
    """An idle run over 700 ms: the TCP and TLS handshakes, the login and the reading."""
    bench = Bench(tmp_path, link=RouterLink(delay_s=0.35))

    async def act(bench: Bench) -> tuple[DeviceResult, DeviceResult]:
        return await bench.converge(), await bench.converge()

    first, second = on(bench, act)
    assert (first.status, second.status) == (Status.CHANGED, Status.UNCHANGED)
    assert second.seconds <= (3 + 2) * 0.7 + 0.1


def test_reported_bytes_match_the_wire(tmp_path: Path) -> None:
    bench = Bench(tmp_path)

    async def act(bench: Bench) -> tuple[DeviceResult, int, int]:
        result = await bench.converge()
        counted = bench.router.counters()
        return result, counted.wire_in, counted.wire_out

    result, sent, received = on(bench, act)
    # The ends of the sessions are said after the result.
    assert sent - 3 * 40 <= result.sent_bytes <= sent
    assert received - 3 * 40 <= result.received_bytes <= received


def test_a_plan_changes_nothing(tmp_path: Path) -> None:
    bench = Bench(tmp_path)

    async def act(bench: Bench) -> tuple[DeviceResult, str, str]:
        before = bench.router.export(show_sensitive=True)
        result = await bench.converge(JobMode.PLAN)
        return result, before, bench.router.export(show_sensitive=True)

    result, before, now = on(bench, act)
    assert (result.status, int(result.exit)) == (Status.PLANNED, 2)
    assert result.planned_count > 20
    assert "+ add address=10.64.1.1/24" in result.diff
    assert without_header(before) == without_header(now)


def test_only_the_approved_plan_is_applied(tmp_path: Path) -> None:
    bench = Bench(tmp_path)

    async def act(bench: Bench) -> tuple[DeviceResult, DeviceResult, DeviceResult]:
        shown = await bench.converge(JobMode.PLAN)
        await bench.router.console(["/interface/bridge/add", "=name=bridge-lan"])
        late = await bench.converge(agreed_hash=shown.plan_hash)
        again = await bench.converge(JobMode.PLAN)
        return shown, late, await bench.converge(agreed_hash=again.plan_hash)

    shown, late, agreed = on(bench, act)
    assert (late.status, int(late.exit)) == (Status.REFUSED, 4)
    assert late.message == "the device has changed since the plan was shown: nothing was changed"
    assert late.plan_hash != shown.plan_hash
    assert agreed.status is Status.CHANGED


def test_journal_records_the_whole_run(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    result = on(bench, lambda bench: bench.converge())
    (run,) = bench.store.runs("coastal")
    kinds = [type(record) for record in run.log.records]
    for earlier, later in zip(
        (
            RunStart,
            DeviceObservation,
            PlanRecord,
            ProtectionRecord,
            StateBackup,
            LayerSent,
            ReleaseRecord,
            ActionConfirmation,
            Outcome,
        ),
        (
            DeviceObservation,
            PlanRecord,
            ProtectionRecord,
            StateBackup,
            LayerSent,
            ReleaseRecord,
            ActionConfirmation,
            Outcome,
            Outcome,
        ),
        strict=True,
    ):
        assert kinds.index(earlier) <= kinds.index(later)
    assert (
        run.confirmed_actions("router")
        == run.acknowledged_actions("router")
        == tuple(range(1, result.planned_count + 1))
    )
    assert run.settled_devices == {"router"}


def test_state_before_the_run_is_the_device_export(tmp_path: Path) -> None:
    bench = Bench(tmp_path)

    async def act(bench: Bench) -> str:
        before = bench.router.export()
        await bench.converge()
        return before

    before = on(bench, act)
    saved = bench.store.runs("coastal")[0].before("router")
    assert saved is not None
    assert without_header(saved.text()) == without_header(before)
    assert saved.path.stat().st_mode & 0o777 == 0o600


def test_saved_state_is_restored(tmp_path: Path) -> None:
    bench = Bench(tmp_path)

    async def act(bench: Bench) -> tuple[str, DeviceResult, str]:
        before = bench.export()
        await bench.converge()
        saved = bench.store.runs("coastal")[0].before("router")
        assert saved is not None
        menus = desired.read(bench.text).menus
        back = desired.from_export(saved.text(), menus, str(saved.path))
        return before, await bench.converge(JobMode.ROLLBACK, desired_state=back), bench.export()

    before, result, now = on(bench, act)
    assert result.status is Status.CHANGED
    assert now == before


def test_a_backup_is_saved_and_nothing_is_changed(tmp_path: Path) -> None:
    bench = Bench(tmp_path)

    async def act(bench: Bench) -> tuple[DeviceResult, str, str]:
        before = bench.export()
        return await bench.converge(JobMode.BACKUP), before, bench.export()

    result, before, now = on(bench, act)
    assert result.status is Status.UNCHANGED
    assert "without secrets and users" in result.message
    saved = bench.store.runs("coastal")[0].before("router")
    assert saved is not None
    assert without_header(saved.text()) == before == now


@pytest.mark.smoke("trap")
@pytest.mark.parametrize("execute", [Execute.TRAP, Execute.NONE])
def test_devices_with_other_script_output_converge_too(tmp_path: Path, execute: Execute) -> None:
    bench = Bench(tmp_path, spec={"execute": execute})
    first, second, _, idle = on(bench, twice)
    assert (first.status, second.status) == (Status.CHANGED, Status.UNCHANGED)
    assert idle <= 4


@pytest.mark.smoke("output-0", "output-1")
@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("execute", [Execute.OUTPUT, Execute.NONE])
def test_the_order_in_which_sentences_run_is_no_matter(tmp_path: Path, seed: int, execute: Execute) -> None:
    bench = Bench(tmp_path / "shuffled", knobs=WireBehaviour(shuffle=seed), spec={"execute": execute})
    plain = Bench(tmp_path / "plain")

    async def act(bench: Bench) -> tuple[DeviceResult, str]:
        return await bench.converge(), bench.export()

    result, shuffled = on(bench, act)
    assert result.status is Status.CHANGED
    assert sorted(shuffled.splitlines()) == sorted(on(plain, act)[1].splitlines())


def test_a_result_is_json(tmp_path: Path) -> None:
    bench = Bench(tmp_path)
    result = on(bench, lambda bench: bench.converge())
    data = json.loads(json.dumps(result.as_dict()))
    assert data["status"] == "changed"
    assert data["planned"] == data["confirmed"] == result.planned_count
    assert set(data["bytes"]) == {"sent", "received"}
    assert data["protection"] == "safe-mode"


def test_every_result_reports_an_unknown_newer_routeros(tmp_path: Path) -> None:
    """Where something is planned, done or has drifted, and where nothing is to do; a known one is told by none."""
    modes = (JobMode.DRIFT, JobMode.PLAN, JobMode.APPLY, JobMode.PLAN, JobMode.APPLY, JobMode.DRIFT)

    async def act(bench: Bench) -> list[DeviceResult]:
        return [await bench.converge(mode) for mode in modes]

    results = on(Bench(tmp_path / "newer", spec={"version": "7.25"}), act)
    statuses = [Status.DRIFTED, Status.PLANNED, Status.CHANGED, *[Status.UNCHANGED] * 3]
    assert [result.status for result in results] == statuses
    for result in results:
        told = [note for note in result.as_dict()["notes"] if "is newer than the newest known version," in note]
        assert len(told) == 1
        assert told[0].startswith(f"RouterOS 7.25 is newer than the newest known version, {NEWEST_KNOWN}: ")
    for result in on(Bench(tmp_path / "known", spec={"version": str(NEWEST_KNOWN)}), act):
        assert not [note for note in result.notes if "newer" in note]
