"""A pair is one member of a run, beside single devices; kept as one, stopped as one."""

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from pair_bench import PairBench, Words, on, text

from atlantis_netcfg.routeros import DeviceResult, Endpoint, Status, desired, fleet
from atlantis_netcfg.routeros.api import Command, Reply, Session
from atlantis_netcfg.routeros.apply import Channel
from atlantis_netcfg.routeros.pair import Pair
from atlantis_netcfg.runs import Journal, LayerSent, Record

NEW = Words(ssid="new name")


def test_a_pair_gives_two_results_in_the_order_of_the_jobs(tmp_path: Path) -> None:
    async def act(bench: PairBench) -> tuple[list[DeviceResult], list[str], list[DeviceResult]]:
        told: list[str] = []
        pair = Pair(bench.job("near", NEW), bench.job("far", NEW))
        single = replace(bench.job("near", bench.words), name="single")
        first = await fleet.run([pair], on_result=lambda result: told.append(result.name))
        second = await fleet.run([single, pair], mode="plan", on_result=lambda result: told.append(result.name))
        return first, told, second

    first, told, second = on(PairBench(tmp_path), act)
    assert [(result.name, result.status) for result in first] == [("near", Status.CHANGED), ("far", Status.CHANGED)]
    assert [result.name for result in second] == ["single", "near", "far"]
    assert [result.status for result in second[1:]] == [Status.UNCHANGED] * 2
    assert sorted(told) == ["far", "far", "near", "near", "single"]


def test_stopped_by_hand_both_ends_are_as_before(tmp_path: Path) -> None:
    async def act(bench: PairBench) -> tuple[list[DeviceResult], bool]:
        before = bench.exports()
        pair = Pair(bench.job("near", NEW), bench.job("far", NEW))
        running = asyncio.create_task(fleet.run([pair]))
        while bench.link.up:  # noqa: ASYNC110 - in time that jumps
            await asyncio.sleep(0.01)
        running.cancel()
        results = await running
        return results, bench.exports() == before

    results, as_before = on(PairBench(tmp_path), act)
    assert as_before
    assert {result.status for result in results} <= {Status.ROLLED_BACK, Status.LEFT_AS_FOUND}
    assert all("stopped by the user" in result.message for result in results)


@dataclass
class Stop:
    """Cancels a run at its n-th moment: a record that is written, or a sentence that was answered."""

    journal: Journal
    nth: int
    running: asyncio.Task[list[DeviceResult]] | None = None
    count: int = 0

    def moment(self) -> None:
        self.count += 1
        if self.count == self.nth and self.running is not None:
            self.running.cancel()

    def write(self, record: Record) -> None:
        self.journal.write(record)
        self.moment()

    def save(self, device: str, text: str) -> None:
        self.journal.save(device, text)
        self.moment()

    def confirm(self, device: str, text: Callable[[], str]) -> None:
        self.journal.confirm(device, text)
        self.moment()

    async def connect(self, endpoint: Endpoint) -> Channel:
        session = await Session.open(endpoint)
        self.moment()
        return StoppingSession(session, self)


class StoppingSession:
    def __init__(self, session: Session, stop: Stop) -> None:
        self.traffic = session.traffic
        self._session, self._stop = session, stop

    async def command(self, command: Command, *, silence_s: float | None = None) -> Reply:
        (reply,) = await self.flight([command], silence_s=silence_s)
        return reply

    async def flight(self, commands: Sequence[Command], *, silence_s: float | None = None) -> list[Reply]:
        replies = await self._session.flight(commands, silence_s=silence_s)
        self._stop.moment()
        return replies

    async def close(self, *, wait: bool = True) -> None:
        self._stop.moment()
        await self._session.close(wait=wait)
        self._stop.moment()


WORDS = pytest.mark.parametrize("words", [NEW, Words()], ids=["radio", "one by one"])


@WORDS
def test_stopped_at_its_last_moments_report_journal_and_device_agree(tmp_path: Path, words: Words) -> None:
    moments = stopped_at(tmp_path / "whole", words, 0)
    for nth in range(moments - 9, moments + 1, 2):
        stopped_at(tmp_path / str(nth), words, nth)


@pytest.mark.slow
@WORDS
def test_stopped_at_any_moment_report_journal_and_device_agree(tmp_path: Path, words: Words) -> None:
    moments = stopped_at(tmp_path / "whole", words, 0)
    assert moments > 20
    for nth in range(1, moments + 1):
        stopped_at(tmp_path / str(nth), words, nth)


def stopped_at(folder: Path, words: Words, nth: int) -> int:
    """Stop a run at this moment; without a new radio it only names both devices. Returns how many moments it had."""
    identity = "" if words == NEW else "/system identity\nset name=quay\n"
    wishes = {
        name: desired.read(text("legacy", mode, words) + identity)
        for name, mode in (("near", "bridge"), ("far", "station-bridge"))
    }

    async def act(bench: PairBench) -> int:
        before = {name: bench.export(name) for name in ("near", "far")}
        with bench.journal() as journal:
            stop = Stop(journal, nth)
            near, far = (
                bench.job(name, words, desired_state=wish, journal=stop, connect=stop.connect)
                for name, wish in wishes.items()
            )
            stop.running = asyncio.create_task(fleet.run([Pair(near, far)]))
            results = await stop.running
        (run,) = bench.store.runs("quay")
        sent = {record.device for record in run.log.records if isinstance(record, LayerSent)}
        for result in results:
            place = (nth, result.name, result.status.value, result.message)
            if "nothing was changed" in result.message:
                assert result.name not in sent, place
                assert bench.export(result.name) == before[result.name], place
            if (outcome := run.outcomes.get(result.name)) is not None:
                assert outcome.status == result.status.value, place
            if result.status is Status.UNKNOWN:
                assert result.name in sent, place
        assert len({result.name for result in results}) == len(results) == 2
        return stop.count

    return on(PairBench(folder), act)
