"""Runs in which something goes wrong after the first change: the router ends as before or as declared, and says so."""

import asyncio
import shutil
from pathlib import Path
from typing import Any

import pytest
from engine_bench import TEXT, Bench, Meddler, leases, on

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.events import Event, Stage
from atlantis_netcfg.emulator.routeros import Execute, FaultKind, LinkFault, WireBehaviour
from atlantis_netcfg.emulator.routeros.answers import Answer
from atlantis_netcfg.routeros import DeviceResult, JobMode, Patience, Status, converge, fleet
from atlantis_netcfg.routeros.apply import _change, _settle
from atlantis_netcfg.runs import ActionAcknowledgement, Journal, JournalError, Record

pytestmark = pytest.mark.slow

MANAGEMENT = 'add address=10.64.101.1/24 comment="atlantis: management" interface=ether8\n'
LIST = "/ip firewall address-list\n" + "".join(
    f'add address=198.51.100.{each} comment="atlantis: x" list=other\n' for each in range(1, 100)
)
"""So many harmless rows that they go outside safe mode, before it."""
LAST = '/tool mac-server ping\nset enabled=no\n/ip ssh\nset host-key-type="ed25519 of another kind"\n'
"""A value that the router refuses, in the last layer."""


async def tried(bench: Bench, **changes: Any) -> tuple[DeviceResult, str, str]:  # noqa: ANN401 - fields of DeviceJob
    """Converge once: the result, and the router before and after."""
    before = bench.export()
    return await bench.converge(**changes), before, bench.export()


def console(bench: Bench, *sentences: list[str]) -> Any:  # noqa: ANN401 - a coroutine function
    async def act() -> list[Answer]:
        return [answer for words in sentences for answer in await bench.router.console(words)]

    return act


@pytest.mark.smoke("trap")
@pytest.mark.parametrize("execute", list(Execute))
def test_refused_line_is_rolled_back(tmp_path: Path, execute: Execute) -> None:
    bench = Bench(tmp_path, text=TEXT + LAST, spec={"execute": execute})
    result, before, now = on(bench, tried)
    assert (result.status, result.exit) == (Status.ROLLED_BACK, ExitCode.FAILED)
    assert now == before
    if execute is not Execute.TRAP:
        assert "the device refused to set /ip ssh settings in /ip ssh: " in result.message
    assert result.confirmed_count == 0


def test_failed_script_without_a_line_names_no_action(tmp_path: Path) -> None:
    bench = Bench(tmp_path, text=TEXT + LAST, spec={"execute": Execute.TRAP})
    result, _, _ = on(bench, tried)
    assert "the device says: " in result.message


@pytest.mark.parametrize("extra", [LIST, leases(99)], ids=["before safe mode", "after safe mode"])
@pytest.mark.parametrize("execute", [Execute.OUTPUT, Execute.NONE])
def test_changes_outside_safe_mode_are_undone_by_us(tmp_path: Path, extra: str, execute: Execute) -> None:
    """Harmless rows were permanent when the rest was refused."""
    twisted = extra.replace("02:00:00:01:00:62", "02:00:00:01:00:00").replace('of another kind"', '"') + LAST
    bench = Bench(tmp_path, text=TEXT + (LAST + extra if extra is LIST else twisted), spec={"execute": execute})

    async def act(bench: Bench) -> tuple[DeviceResult, str, str]:
        if extra is LIST:
            return await tried(bench)
        bench.text = TEXT + extra
        meddler = Meddler("/safe-mode/release", console(bench, ["/ip/dhcp-server/lease/add", *_TAKEN]))
        return await tried(bench, connect=meddler.connect)

    result, before, now = on(bench, act)
    assert result.status is Status.ROLLED_BACK
    assert result.message.startswith("restored by us, the device is as before: ")
    assert now == before


_TAKEN = ("=mac-address=02:00:00:01:00:30", "=address=10.64.9.9", "=server=lan")
"""A lease that another admin adds just before ours with the same card."""


@pytest.mark.smoke
def test_cut_access_despite_the_guard_is_rolled_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("atlantis_netcfg.routeros.guard.objections", lambda *_: ())
    result, before, now = on(Bench(tmp_path, text=TEXT.replace(MANAGEMENT, "")), tried)
    assert result.status is Status.ROLLED_BACK
    assert now == before


def test_blocked_new_sessions_despite_the_guard_are_rolled_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Our session lives on, and would not notice."""
    monkeypatch.setattr("atlantis_netcfg.routeros.guard.objections", lambda *_: ())
    text = TEXT.replace("set telnet disabled=yes\n", "set telnet disabled=yes\nset api-ssl disabled=yes\n")
    result, before, now = on(Bench(tmp_path, text=text), tried)
    assert result.status is Status.ROLLED_BACK
    assert "cannot log in to the device again:" in result.message
    assert now == before


def test_rows_that_stay_inactive_are_rolled_back(tmp_path: Path) -> None:
    text = TEXT.replace("interface=bridge-lan lease-time", "interface=ether4 lease-time")
    result, before, now = on(Bench(tmp_path, text=text), tried)
    assert result.status is Status.ROLLED_BACK
    assert "does not use them: lan in /ip dhcp-server" in result.message
    assert now == before


def test_row_that_was_inactive_before_is_only_noted(tmp_path: Path) -> None:
    bench = Bench(tmp_path)

    async def act(bench: Bench) -> DeviceResult:
        await bench.converge()
        await bench.router.console(["/interface/bridge/port/add", "=bridge=bridge-lan", "=interface=ether6"])
        await bench.router.console(
            ["/ip/dhcp-server/add", "=name=x", "=interface=ether6", "=comment=atlantis: x", "=address-pool=lan"]
        )
        bench.text = TEXT.replace("lease-time=1h", "lease-time=2h").replace(
            "name=lan\n/ip dhcp-server network",
            'name=lan\nadd address-pool=lan comment="atlantis: x" disabled=no'
            " interface=ether6 name=x\n/ip dhcp-server network",
            1,
        )
        return await bench.converge()

    result = on(bench, act)
    assert result.status is Status.CHANGED
    assert any("does not use x in /ip dhcp-server" in note for note in result.notes)


@pytest.mark.parametrize("nth", [2, 3, 4, 5])
def test_safe_mode_unrolled_by_another_admin(tmp_path: Path, nth: int) -> None:
    """Before we take it; before the script, which is permanent then; before the verification; before the release."""
    bench = Bench(tmp_path)

    async def act(bench: Bench) -> tuple[DeviceResult, str, str]:
        meddler = Meddler("/safe-mode/print", console(bench, ["/safe-mode/unroll"]), nth=nth, after=False)
        return await tried(bench, connect=meddler.connect)

    result, before, now = on(bench, act)
    assert result.status is (Status.CHANGED if nth <= 3 else Status.ROLLED_BACK)
    assert ("although: we no longer hold safe mode" in result.message) == (nth == 3)
    assert (now != before) == (result.status is Status.CHANGED)


@pytest.mark.smoke("3-/safe-mode/release")
@pytest.mark.parametrize("end", ["/safe-mode/release", "/safe-mode/unroll"])
@pytest.mark.parametrize("nth", [3, 4])
def test_another_admin_takes_safe_mode_from_us(tmp_path: Path, nth: int, end: str) -> None:
    """Before the script, which is theirs then, or after it, when it is permanent. We wait until they are done."""
    bench = Bench(tmp_path)

    async def hijack() -> None:
        await console(bench, ["/safe-mode/release"], ["/safe-mode/take"])()
        asyncio.get_running_loop().call_later(60, lambda: ends.append(asyncio.ensure_future(console(bench, [end])())))

    ends: list[asyncio.Future[Any]] = []

    async def act(bench: Bench) -> tuple[DeviceResult, str, str]:
        meddler = Meddler("/safe-mode/print", hijack, nth=nth, after=False)
        return await tried(bench, connect=meddler.connect)

    result, before, now = on(bench, act)
    undone = nth == 3 and end == "/safe-mode/unroll"
    assert len(ends) == 1
    assert result.status is (Status.ROLLED_BACK if undone else Status.CHANGED)
    assert "api:provision@10.64.101.10 has taken over safe mode from us" in result.message
    assert (now == before) == undone


def test_safe_mode_still_held_by_another_admin_gives_an_unknown_outcome(tmp_path: Path) -> None:
    """The declared rows are there, but whoever holds safe mode may yet undo them: nobody can say."""
    bench = Bench(tmp_path)

    async def act(bench: Bench) -> DeviceResult:
        hijack = console(bench, ["/safe-mode/release"], ["/safe-mode/take"])
        return await bench.converge(connect=Meddler("/ip/pool/print", hijack, nth=2, after=False).connect)

    result = on(bench, act)
    assert (result.status, result.exit) == (Status.UNKNOWN, ExitCode.UNKNOWN)
    assert "api:provision@10.64.101.10 still holds safe mode" in result.message
    assert result.hint is not None
    assert "provision recover resume site=coastal" in result.hint


def test_exhausted_history_ends_safe_mode_and_keeps_a_complete_change(tmp_path: Path) -> None:
    """The router left safe mode without a word: everything is permanent, and as it is all there, it may stay."""
    result, before, now = on(Bench(tmp_path, spec={"history_limit": 10}), tried)
    assert result.status is Status.CHANGED
    assert "although: we no longer hold safe mode in the middle of the change" in result.message
    assert now != before


def test_exhausted_history_before_a_refused_line_is_undone_by_us(tmp_path: Path) -> None:
    result, before, now = on(Bench(tmp_path, text=TEXT + LAST, spec={"history_limit": 10}), tried)
    assert result.status is Status.ROLLED_BACK
    assert "restored by us" in result.message
    assert now == before


@pytest.mark.smoke
def test_router_that_never_returns_has_an_unknown_outcome(tmp_path: Path) -> None:
    bench = Bench(tmp_path, knobs=WireBehaviour(boot_s=100_000))

    async def act(bench: Bench) -> DeviceResult:
        bench.router.arm(LinkFault(do=FaultKind.POWER, match="/execute", sentence=3, when="after"))
        return await bench.converge()

    result = on(bench, act)
    assert (result.status, result.exit) == (Status.UNKNOWN, ExitCode.UNKNOWN)
    assert result.hint is not None
    assert "provision recover resume site=coastal" in result.hint
    (run,) = bench.store.unfinished_runs("coastal")
    assert run.unsettled_devices == ("router",)


@pytest.mark.smoke
def test_resume_waits_until_the_router_has_rolled_back(tmp_path: Path) -> None:
    bench = Bench(tmp_path)

    async def act(bench: Bench) -> tuple[DeviceResult, DeviceResult, float]:
        clock = asyncio.get_running_loop().time
        bench.router.arm(LinkFault(do=FaultKind.VANISH, match="/execute", sentence=3, when="after"))
        hasty = Patience(reach_s=0, undo_s=1)
        lost = await bench.converge(patience=hasty)
        begun = clock()
        return lost, await bench.converge(JobMode.RESUME), clock() - begun

    lost, resumed, waited = on(bench, act)
    assert lost.status is Status.UNKNOWN
    assert resumed.status is Status.CHANGED
    assert 200 < waited < 600


def test_apply_is_refused_while_a_dead_session_holds_safe_mode(tmp_path: Path) -> None:
    bench = Bench(tmp_path)

    async def act(bench: Bench) -> DeviceResult:
        bench.router.arm(LinkFault(do=FaultKind.VANISH, match="/execute", sentence=3, when="after"))
        await bench.converge(patience=Patience(reach_s=0, undo_s=1))
        return await bench.converge()

    result = on(bench, act)
    assert result.status is Status.LEFT_AS_FOUND
    assert result.message.startswith("api-ssl:provision@10.64.101.10 holds safe mode")
    assert result.hint is not None
    assert "provision recover resume site=coastal" in result.hint


class Killed(BaseException):
    """Nothing is settled after it."""


class Deadly(Journal):
    """A journal whose run dies when the router has said that it has executed the changes."""

    def write(self, record: Record) -> None:
        super().write(record)
        if isinstance(record, ActionAcknowledgement):
            raise Killed


@pytest.mark.parametrize("version", ["7.18.2", "7.16"])
def test_repeated_command_waits_for_its_own_dead_run(tmp_path: Path, version: str) -> None:
    """By safe mode, or below 7.18 by the dead-man job: the journal says that the run is of this computer."""
    bench = Bench(tmp_path, spec={"version": version})

    async def act(bench: Bench) -> tuple[DeviceResult, DeviceResult, str]:
        with bench.journal() as opened:
            job = bench.job(journal=Deadly(opened.directory), run=opened.run)
        with pytest.raises(Killed):
            await converge(job)
        refused = await bench.converge()
        with bench.journal() as journal:
            history = bench.store.history("coastal", "router", current=journal.run)
            again = await converge(bench.job(journal=journal, run=journal.run, history=history))
        left = await bench.router.console(["/system/scheduler/print"])
        return refused, again, str(left) + str(await bench.router.console(["/ip/firewall/address-list/print"]))

    refused, again, left = on(bench, act)
    assert refused.status is Status.LEFT_AS_FOUND
    assert refused.hint is not None
    assert "provision recover resume site=coastal" in refused.hint
    assert again.status is Status.CHANGED, again.message
    assert "atlantis-dead-man" not in left
    assert "atlantis-run" not in left
    assert bench.store.unfinished_runs("coastal") == ()


def test_link_lost_before_the_first_change_can_be_resumed(tmp_path: Path) -> None:
    """Safe mode was asked for and nothing was written: what is advised then finds a run to go on with."""
    bench = Bench(tmp_path)

    async def act(bench: Bench) -> tuple[DeviceResult, list[str], DeviceResult, DeviceResult]:
        bench.router.arm(LinkFault(do=FaultKind.VANISH, match="/safe-mode/take", when="after"))
        lost = await bench.converge()
        open_runs = [run.id for run in bench.store.unfinished_runs("coastal")]
        refused = await bench.converge()
        again = await bench.converge(history=bench.store.history("coastal", "router"))
        return lost, open_runs, refused, again

    lost, open_runs, refused, again = on(bench, act)
    assert lost.status is Status.LEFT_AS_FOUND
    assert lost.hint is not None
    assert "provision recover resume site=coastal" in lost.hint
    assert len(open_runs) == 1
    assert refused.status is Status.LEFT_AS_FOUND
    assert again.status is Status.CHANGED
    assert bench.store.unfinished_runs("coastal") == ()


class FullDisk(Journal):
    """A journal that can write so many records and no more."""

    left = 0

    def write(self, record: Record) -> None:
        if self.left <= 0:
            raise JournalError("the journal cannot be written: No space left on device")
        self.left -= 1
        super().write(record)


class LostFolder(Journal):
    """A journal whose state folder is deleted before one of its records."""

    left = 0

    def write(self, record: Record) -> None:
        if self.left == 0:
            shutil.rmtree(self.directory.parents[2])
        self.left -= 1
        super().write(record)


@pytest.mark.smoke("full disk-0", "full disk-1")
@pytest.mark.parametrize("records", range(13))
@pytest.mark.parametrize(
    ("broken", "words"),
    [(FullDisk, "No space left on device"), (LostFolder, "was deleted or replaced")],
    ids=["full disk", "state folder deleted"],
)
def test_journal_failure_at_any_record_ends_safely(
    tmp_path: Path, broken: type[FullDisk | LostFolder], words: str, records: int
) -> None:
    """Nobody could go on with such a run: before the release it is taken back, after it the result is not green."""
    bench = Bench(tmp_path)

    async def act(bench: Bench) -> tuple[DeviceResult, str, str]:
        with bench.journal() as opened:
            journal = broken(opened.directory)
        journal.left = records
        before = bench.export()
        result = await converge(bench.job(journal=journal))
        journal.close()
        return result, before, bench.export()

    result, before, now = on(bench, act)
    assert (words in f"{result.message} {' '.join(result.notes)}") == (records < 12)
    assert (now != before) == (result.status is Status.CHANGED)
    assert (result.status is Status.CHANGED) == (records >= 8)
    changed = ExitCode.DONE if records >= 12 else ExitCode.CHECKS_FAILED
    assert result.exit is (changed if result.status is Status.CHANGED else ExitCode.FAILED)
    if broken is LostFolder:
        assert ("not recorded" in result.message) == (records < 12)
        assert not list(tmp_path.rglob("*.rsc")) or records >= 12


@pytest.mark.smoke("planned")
@pytest.mark.parametrize("stage", [Stage.CONNECTING, Stage.PLANNED, Stage.PROTECTED, Stage.APPLYING, Stage.VERIFYING])
def test_stop_by_hand_leaves_the_device_as_before(tmp_path: Path, stage: Stage) -> None:
    bench = Bench(tmp_path)

    async def act(bench: Bench) -> tuple[list[DeviceResult], str, str]:
        before = bench.export()

        def stop(event: Event) -> None:
            if event.stage is stage and not stopped:
                stopped.append(running.cancel())

        with bench.journal() as journal:
            running = asyncio.ensure_future(fleet.run([bench.job(journal=journal, events=stop)]))
            results = await running
        return results, before, bench.export()

    stopped: list[bool] = []
    (result,), before, now = on(bench, act)
    assert stopped == [True]
    touched = stage in (Stage.APPLYING, Stage.VERIFYING)
    assert result.status is (Status.ROLLED_BACK if touched else Status.LEFT_AS_FOUND)
    assert "stopped by the user" in result.message
    assert now == before


def test_internal_error_rolls_back_and_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async def broken(*_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(_change, "verify", broken)
    result, before, now = on(Bench(tmp_path), tried)
    assert (result.status, result.exit) == (Status.ROLLED_BACK, ExitCode.OUR_FAULT)
    assert isinstance(result.fault, ZeroDivisionError)
    assert now == before


def test_internal_error_while_settling_gives_an_unknown_outcome(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(_settle, "differing_menus", broken)
    result, before, now = on(Bench(tmp_path, text=TEXT + LAST), tried)
    assert (result.status, result.exit) == (Status.UNKNOWN, ExitCode.UNKNOWN)
    assert "the device refused to set /ip ssh settings" in result.message
    assert isinstance(result.fault, ZeroDivisionError)
    assert now == before


@pytest.mark.parametrize("end", ["/safe-mode/release", "/safe-mode/unroll"])
def test_another_admin_takes_safe_mode_between_two_pieces(tmp_path: Path, end: str) -> None:
    """Half of the plan is permanent; once they are done, and have changed nothing, the rest follows."""
    bench = Bench(tmp_path, text=TEXT + "/ip dns static\n" + "".join(NAMES))
    ends: list[asyncio.Future[Any]] = []

    async def hijack() -> None:
        await console(bench, ["/safe-mode/take"])()
        asyncio.get_running_loop().call_later(60, lambda: ends.append(asyncio.ensure_future(console(bench, [end])())))

    async def act(bench: Bench) -> tuple[DeviceResult, str, str]:
        return await tried(bench, connect=Meddler("/safe-mode/release", hijack).connect)

    result, before, now = on(bench, act)
    assert len(ends) == 1
    assert result.status is Status.CHANGED
    assert result.confirmed_count == result.planned_count
    assert any("api:provision@10.64.101.10 holds safe mode: waiting" in event.message for event in bench.events)
    assert now != before


NAMES = [f'add address=10.64.1.{each} comment="atlantis: x" name=host{each}.lan\n' for each in range(1, 100)]
"""Rows that are not harmless, more than one safe mode can remember."""
