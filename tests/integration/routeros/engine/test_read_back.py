"""After a change of menus that nothing follows: these are read in full, the others counted, and what moved is read."""

import asyncio
from collections.abc import Callable, Coroutine, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from engine_bench import TEXT, Bench, Meddler, on

from atlantis_netcfg.core.events import Event, Stage
from atlantis_netcfg.routeros import DeviceResult, Endpoint, JobMode, Status, desired
from atlantis_netcfg.routeros._types import Observation
from atlantis_netcfg.routeros.api import Command, Reply, Session
from atlantis_netcfg.routeros.apply import Admission, Channel
from atlantis_netcfg.routeros.apply._state import SAVING
from atlantis_netcfg.routeros.estimate import Estimate, LinkMetrics

RULE = 'add action=passthrough chain=forward comment="atlantis: one more"\n'
MORE = TEXT.replace("/ip firewall nat\n", f"{RULE}/ip firewall nat\n")
SATELLITE = LinkMetrics("satellite", 0.7, 352e3, 704e3, is_metered=True)


def meddled(tmp_path: Path, words: Sequence[str], path: str = "/execute") -> tuple[DeviceResult, str, list[str]]:
    """Add a rule of the firewall while somebody else does something; the result, the export, and what was read back."""

    async def act(bench: Bench) -> tuple[DeviceResult, str, list[str]]:
        bench.text = TEXT
        await bench.converge()
        bench.text = MORE
        meddler = Meddler(path, lambda: bench.router.console(list(words)), nth=3)
        result = await bench.converge(connect=meddler.connect)
        last = bench.router.connections()[-1]
        return result, bench.export(), [sentence[0] for sentence in last.sentences if "=count-only=" not in sentence]

    return on(Bench(tmp_path), act)


def test_only_changed_menus_are_read_in_full(tmp_path: Path) -> None:
    result, _, full = meddled(tmp_path, ["/system/identity/print"])
    assert result.status is Status.CHANGED
    assert set(full) == {"/login", "/ip/firewall/filter/print", "/system/resource/print", "/safe-mode/print"}


def test_menu_with_a_concurrent_addition_is_read_too(tmp_path: Path) -> None:
    result, export, full = meddled(tmp_path, ["/ip/pool/add", "=name=theirs", "=ranges=10.0.0.1"])
    assert result.status is Status.CHANGED
    assert "name=theirs" in export
    assert "/ip/pool/print" in full


def test_concurrently_removed_row_is_detected(tmp_path: Path) -> None:
    result, export, _ = meddled(tmp_path, ["/ip/firewall/address-list/remove", "=.id=*1"])
    assert result.status is not Status.CHANGED, result.message
    assert "one more" not in export


@pytest.mark.parametrize(
    ("more", "kept"),
    [
        ("", {"/user/print", "/user/group/print"}),
        ("/user group\nadd comment=atlantis name=readers policy=read,api\n", {"/user/print"}),
    ],
    ids=["other menus", "a group"],
)
def test_users_are_read_back_only_if_the_text_contains_them(tmp_path: Path, more: str, kept: set[str]) -> None:
    """No other menu changes them; everything else may have followed a change of bridges and addresses."""

    async def act(bench: Bench) -> tuple[DeviceResult, set[str], set[str]]:
        result = await bench.converge(desired_state=desired.read(TEXT + more))
        first, last = ({each[0] for each in side.sentences} for side in bench.router.connections())
        return result, first, last

    result, first, last = on(Bench(tmp_path), act)
    assert result.status is Status.CHANGED, result.message
    read = {path for path in first - last if path.endswith("/print")}
    # Of the run itself, and of the router, which are known by then.
    assert read - kept == {
        *("/user/active/print", "/system/history/print", "/system/scheduler/print", "/system/device-mode/print"),
    }
    assert kept <= read


class Dear:
    """Refuses whatever would be sent."""

    def judge(self, observation: Observation, estimate: Estimate | None, *, spends: bool, is_plan: bool) -> Admission:  # noqa: ARG002
        return Admission((), "too dear" if spends else None)


@pytest.mark.parametrize("mode", [JobMode.APPLY, JobMode.RESUME])
def test_safe_mode_that_was_taken_for_a_refused_plan_is_released(tmp_path: Path, mode: JobMode) -> None:
    """Released, not taken back: what somebody else has done meanwhile is theirs."""

    async def act(bench: Bench) -> tuple[DeviceResult, str, DeviceResult]:
        pool = ["/ip/pool/add", "=name=theirs", "=ranges=10.0.0.1"]
        meddler = Meddler("/safe-mode/take", lambda: bench.router.console(pool))
        refused = await bench.converge(mode, connect=meddler.connect, cost_policy=Dear(), link=SATELLITE)
        assert meddler.count == 1
        return refused, bench.export(), await bench.converge()

    refused, export, then = on(Bench(tmp_path), act)
    assert (refused.status, refused.message) == (Status.REFUSED, "refused, nothing was changed: too dear")
    assert "name=theirs" in export
    assert then.status is Status.CHANGED


def test_a_plan_takes_no_safe_mode(tmp_path: Path) -> None:
    async def act(bench: Bench) -> list[str]:
        await bench.converge(JobMode.PLAN)
        return [sentence[0] for each in bench.router.connections() for sentence in each.sentences]

    assert "/safe-mode/take" not in on(Bench(tmp_path), act)


def asked(bench: Bench) -> int:
    """How often the state of the router was asked for."""
    words = SAVING[0].words()[1]
    return sum(words in sentence for each in bench.router.connections() for sentence in each.sentences)


def test_the_state_is_saved_in_the_round_trip_that_takes_safe_mode(tmp_path: Path) -> None:
    async def act(bench: Bench) -> tuple[DeviceResult, int, str]:
        await bench.converge()
        already = asked(bench)
        bench.text = MORE
        with bench.journal() as journal:
            result = await bench.converge(journal=journal)
        saved = bench.store.run("coastal", journal.run).before("router")
        assert saved is not None
        return result, asked(bench) - already, saved.text()

    result, times, text = on(Bench(tmp_path), act)
    assert (result.status, result.round_trips, times) == (Status.CHANGED, 13, 1)
    assert 'comment="atlantis: rest"' in text
    assert "one more" not in text


LOCKED_OUT = '/ip firewall filter\nadd action=drop chain=input comment="atlantis: everything"\n'


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"cost_policy": Dear(), "link": SATELLITE}, "too dear"),
        ({"agreed_hash": "another plan"}, "the device has changed since the plan was shown"),
        ({"desired_state": desired.read(LOCKED_OUT)}, "would drop your new sessions"),
    ],
    ids=["cost", "agreed", "guard"],
)
def test_no_state_is_read_if_the_plan_is_refused(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    async def act(bench: Bench) -> tuple[DeviceResult, int]:
        return await bench.converge(**changes), asked(bench)

    result, times = on(Bench(tmp_path), act)
    assert (result.status, times) == (Status.REFUSED, 0), result.message
    assert message in result.message


@dataclass
class Doubt:
    """Answers a question of the round trip that takes safe mode otherwise; before the next one somebody else acts."""

    path: str
    answer: Reply
    act: Callable[[], Coroutine[Any, Any, object]]
    steps: int = 0

    async def connect(self, endpoint: Endpoint) -> Channel:
        """In place of `Session.open`."""
        return _Doubted(await Session.open(endpoint), self)


class _Doubted:
    def __init__(self, session: Session, doubt: Doubt) -> None:
        self.traffic = session.traffic
        self._session, self._doubt = session, doubt

    async def command(self, command: Command, *, silence_s: float | None = None) -> Reply:
        (reply,) = await self.flight([command], silence_s=silence_s)
        return reply

    async def flight(self, commands: Sequence[Command], *, silence_s: float | None = None) -> list[Reply]:
        doubt, paths = self._doubt, [command.path for command in commands]
        takes = "/safe-mode/take" in paths
        doubt.steps += takes or doubt.steps > 0
        if doubt.steps == 2:
            await doubt.act()
        replies = await self._session.flight(commands, silence_s=silence_s)
        if takes:
            replies[paths.index(doubt.path)] = doubt.answer
        return replies

    async def close(self, *, wait: bool = True) -> None:
        await self._session.close(wait=wait)


@pytest.mark.parametrize(
    ("path", "answer"),
    [("/safe-mode/print", Reply(({"enabled": "false", "current": "false"},))), ("/console/inspect", Reply())],
    ids=["the holder is asked again", "a list is asked for whole"],
)
def test_change_while_safe_mode_is_taken_is_detected(tmp_path: Path, path: str, answer: Reply) -> None:
    """What somebody does in that round trip is noticed as before."""

    async def act(bench: Bench) -> tuple[DeviceResult, str, int]:
        await bench.converge()
        bench.text, already = MORE, asked(bench)
        pool = ["/ip/pool/add", "=name=theirs", "=ranges=10.0.0.1"]
        doubt = Doubt(path, answer, lambda: bench.router.console(pool))
        result = await bench.converge(connect=doubt.connect)
        return result, bench.export(), asked(bench) - already

    result, export, times = on(Bench(tmp_path), act)
    assert (result.status, times) == (Status.LEFT_AS_FOUND, 2)
    assert "somebody else has changed the device since it was read (/ip pool)" in result.message
    assert "name=theirs" in export
    assert "one more" not in export


@pytest.mark.parametrize("stage", [Stage.PLANNED, Stage.PROTECTED])
def test_stop_before_the_first_change_changes_nothing(tmp_path: Path, stage: Stage) -> None:
    async def act(bench: Bench) -> tuple[DeviceResult, list[Stage], str, str]:
        await bench.converge()
        bench.text, before = MORE, bench.export()
        stages: list[Stage] = []

        def listen(event: Event) -> None:
            stages.append(event.stage)
            if event.stage is stage:
                run.cancel()

        run = asyncio.ensure_future(bench.converge(events=listen))
        return await run, stages, before, bench.export()

    result, stages, before, export = on(Bench(tmp_path), act)
    assert (result.status, result.is_stopped) == (Status.LEFT_AS_FOUND, True)
    assert result.message == "nothing was changed: stopped by the user"
    assert Stage.APPLYING not in stages
    assert export == before
