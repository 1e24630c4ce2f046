"""Reading a router to say what differs: never anything else than reading, however it ends; and what runs keep."""

from pathlib import Path
from typing import NoReturn

import pytest
from engine_bench import TEXT, Bench, leases, on

from atlantis_netcfg.emulator.routeros import FaultKind, LinkFault
from atlantis_netcfg.routeros import DeviceResult, JobMode, Status, converge
from atlantis_netcfg.routeros.drift import DriftKind, Since

WANTED_MORE = TEXT + leases(1)


async def drift(bench: Bench, text: str | None = None) -> DeviceResult:
    """Read the router with what its runs have confirmed; `text` is declared by now."""
    kept, bench.text = bench.text, text or bench.text
    job = bench.job(confirmed_state=bench.store.last_confirmed("coastal", ["router"]).get("router"))
    bench.text = kept
    before = bench.export()
    result = await converge(job, mode=JobMode.DRIFT)
    assert bench.export() == before
    return result


def test_drift_costs_two_more_round_trips_only_if_there_is_any(tmp_path: Path) -> None:
    async def act(bench: Bench) -> list[DeviceResult]:
        await bench.converge()
        same = await drift(bench)
        await bench.router.console(["/ip/pool/set", "=.id=lan", "=ranges=10.64.1.7"])
        return [same, await drift(bench), await drift(bench)]

    same, first, second = on(Bench(tmp_path), act)
    assert (same.status, same.exit, same.message) == (Status.UNCHANGED, 0, "as in the inventory")
    assert (first.status, first.exit) == (Status.DRIFTED, 6)
    assert first.message == "1 difference from the inventory: 1 changed"
    assert first.round_trips == second.round_trips == same.round_trips + 2 <= 7
    assert first.comparison == second.comparison is not None
    (changed,) = first.comparison.differences if first.comparison else ()
    assert (changed.kind, changed.since) == (DriftKind.CHANGED, Since.AFTER)
    assert changed.deed is not None
    assert changed.deed.by == "provision"


DOORS = {
    "/ip/settings": ("=rp-filter=no", "/ip settings\nset accept-redirects=no accept-source-route=no rp-filter=loose\n"),
    "/snmp": ("=enabled=yes", "/snmp\nset enabled=no\n"),
    "/tool/romon": ("=enabled=yes", "/tool romon\nset enabled=no\n"),
}


@pytest.mark.smoke("/snmp")
@pytest.mark.parametrize("menu", DOORS)
def test_weakened_setting_is_drift_and_the_next_run_restores_it(tmp_path: Path, menu: str) -> None:
    opened, declared = DOORS[menu]

    async def act(bench: Bench) -> list[DeviceResult]:
        bench.text += declared
        first, again = await bench.converge(), await bench.converge()
        await bench.router.console([f"{menu}/set", opened])
        differs = await drift(bench)
        return [first, again, differs, await bench.converge(), await bench.converge(), await drift(bench)]

    first, again, differs, shut, once_more, same = on(Bench(tmp_path), act)
    assert [one.status for one in (first, again)] == [Status.CHANGED, Status.UNCHANGED]
    assert (differs.status, differs.exit) == (Status.DRIFTED, 6)
    assert differs.comparison is not None
    assert [one.menu for one in differs.comparison.differences] == ["/" + menu[1:].replace("/", " ")]
    assert [one.status for one in (shut, once_more, same)] == [Status.CHANGED, Status.UNCHANGED, Status.UNCHANGED]


def test_newly_declared_row_is_not_attributed_to_the_device(tmp_path: Path) -> None:
    async def act(bench: Bench) -> DeviceResult:
        await bench.converge()
        return await drift(bench, WANTED_MORE)

    result = on(Bench(tmp_path), act)
    assert result.comparison is not None
    assert [(one.kind, one.since) for one in result.comparison.differences] == [(DriftKind.MISSING, Since.ALREADY)]


@pytest.mark.smoke("drop-2", "reboot-20")
@pytest.mark.parametrize("nth", [1, 2, 20, 40])
@pytest.mark.parametrize("kind", [FaultKind.DROP, FaultKind.REBOOT])
def test_interrupted_reading_is_an_error_and_no_drift(tmp_path: Path, kind: FaultKind, nth: int) -> None:
    async def act(bench: Bench) -> DeviceResult:
        await bench.converge()
        bench.router.arm(LinkFault(do=kind, sentence=nth, when="before"))
        return await drift(bench)

    result = on(Bench(tmp_path), act)
    if result.status is not Status.UNCHANGED:  # it has fewer sentences
        assert (result.status, result.exit) == (Status.LEFT_AS_FOUND, 4)
        assert "could not be read: " in result.message
    assert nth > 20 or result.status is Status.LEFT_AS_FOUND


def test_incomparable_state_is_refused_with_a_reason(tmp_path: Path) -> None:
    async def act(bench: Bench) -> DeviceResult:
        return await drift(bench, TEXT + "/interface ethernet\nset [ find default-name=ether99 ] name=far\n")

    result = on(Bench(tmp_path), act)
    assert (result.status, result.exit) == (Status.REFUSED, 4)
    assert "ether99 does not exist in" in result.message


def test_drift_works_without_safe_mode(tmp_path: Path) -> None:
    result = on(Bench(tmp_path, spec={"version": "7.16"}), drift)
    assert result.status is Status.DRIFTED


def test_holder_of_safe_mode_is_reported(tmp_path: Path) -> None:
    async def act(bench: Bench) -> DeviceResult:
        await bench.converge()
        await bench.router.console(["/safe-mode/take"])
        await bench.router.console(["/ip/pool/set", "=.id=lan", "=ranges=10.64.1.7"])
        return await drift(bench)

    result = on(Bench(tmp_path), act)
    assert result.status is Status.DRIFTED
    assert any("holds safe mode" in note and "may still be rolled back" in note for note in result.notes)


def test_only_a_successful_run_saves_the_confirmed_state(tmp_path: Path) -> None:
    async def act(bench: Bench) -> list[DeviceResult]:
        results = [await bench.converge(), await bench.converge(), await bench.converge(JobMode.PLAN)]
        bench.text = WANTED_MORE
        bench.router.arm(LinkFault(do=FaultKind.DROP, match="/execute", sentence=1, when="after"))
        return [*results, await bench.converge(), await bench.converge(JobMode.BACKUP)]

    bench = Bench(tmp_path)
    results = on(bench, act)
    kept = [run.confirmed_state("router") for run in bench.store.runs("coastal")]
    ended_well = [one.status in (Status.CHANGED, Status.UNCHANGED) for one in results[:4]]
    assert [state is not None for state in kept] == [*ended_well, False]
    assert kept[0] is not None
    assert kept[1] is not None
    assert kept[0].path == kept[1].path


def test_unreadable_confirmed_state_leaves_the_time_unknown(tmp_path: Path) -> None:
    async def act(bench: Bench) -> DeviceResult:
        await bench.converge()
        await bench.router.console(["/ip/pool/set", "=.id=lan", "=ranges=10.64.1.7"])
        for state in bench.store.last_confirmed("coastal", ["router"]).values():
            state.path.write_text("nonsense")
        return await drift(bench)

    result = on(Bench(tmp_path), act)
    assert result.comparison is not None
    assert [one.since for one in result.comparison.differences] == [Since.UNKNOWN]
    assert [note for note in result.notes if "it was changed since" in note] == list(result.notes)


def test_unwritable_state_folder_is_reported_and_keeps_the_outcome(tmp_path: Path) -> None:
    async def act(bench: Bench) -> DeviceResult:
        (tmp_path / "state/real/coastal").mkdir(parents=True)
        (tmp_path / "state/real/coastal/confirmed").write_text("no folder")
        return await bench.converge()

    bench = Bench(tmp_path)
    result = on(bench, act)
    assert result.status is Status.CHANGED
    assert any("the confirmed state cannot be written" in note for note in result.notes)
    (run,) = bench.store.runs("coastal")
    assert run.outcomes["router"].status == "changed"


def test_internal_error_while_saving_the_state_keeps_the_outcome(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> NoReturn:
        raise ZeroDivisionError

    monkeypatch.setattr("atlantis_netcfg.routeros.snapshot.write", broken)
    bench = Bench(tmp_path)
    result = on(bench, lambda bench: bench.converge())
    assert (result.status, result.exit) == (Status.CHANGED, 0)
    assert result.notes[-1].endswith("cannot be written: provision failed with an internal error (ZeroDivisionError)")
    (run,) = bench.store.runs("coastal")
    assert run.outcomes["router"].status == "changed"
