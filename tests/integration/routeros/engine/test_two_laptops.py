"""Two laptops without a lock in common change one router: one is told plainly, and nothing is half done."""

import asyncio
import re
from collections.abc import Callable, Coroutine, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from engine_bench import TEXT, Bench, leases, on

from atlantis_netcfg.routeros import DeviceResult, JobMode, Status, converge, desired
from atlantis_netcfg.routeros.api import Command, Endpoint, Reply, Session
from atlantis_netcfg.routeros.apply import Channel

pytestmark = pytest.mark.slow

OTHER = TEXT.replace("name=coastal-router", "name=other-router").replace(
    'comment="atlantis: lan" in-interface=bridge-lan protocol=icmp', 'comment="atlantis: lan" in-interface=bridge-lan'
)
LISTS = "/ip firewall address-list\n" + "".join(
    f'add address=198.51.100.{each} comment="atlantis: x" list=other\n' for each in range(1, 90)
)
LONG = TEXT + leases(70)
"""Harmless rows go behind safe mode."""
BROAD = TEXT + LISTS
"""Harmless rows go before it."""
NAMES = (
    TEXT
    + "/ip dns static\n"
    + "".join(f'add address=10.64.1.{each} comment="atlantis: x" name=host{each}.lan\n' for each in range(1, 100))
)
"""Two pieces."""
PLAIN = (Status.CHANGED, Status.UNCHANGED, Status.LEFT_AS_FOUND)


@dataclass
class Starter:
    """Does something before the n-th thing that one laptop does: it opens a session, or sends a batch of sentences."""

    nth: int
    act: Callable[[], Coroutine[Any, Any, object]]
    count: int = 0

    async def step(self) -> None:
        """Count, and act when it is time."""
        self.count += 1
        if self.count == self.nth:
            await self.act()

    async def connect(self, endpoint: Endpoint) -> Channel:
        """In place of `Session.open`."""
        await self.step()
        return _Started(await Session.open(endpoint), self)


class _Started:
    def __init__(self, session: Session, starter: Starter) -> None:
        self.traffic = session.traffic
        self._session = session
        self._starter = starter

    async def command(self, command: Command, *, silence_s: float | None = None) -> Reply:
        (reply,) = await self.flight([command], silence_s=silence_s)
        return reply

    async def flight(self, commands: Sequence[Command], *, silence_s: float | None = None) -> list[Reply]:
        await self._starter.step()
        return await self._session.flight(commands, silence_s=silence_s)

    async def close(self, *, wait: bool = True) -> None:
        await self._session.close(wait=wait)


@dataclass
class Meeting:
    """What came of two laptops."""

    before: str = ""
    now: str = ""
    ended: list[tuple[str, DeviceResult]] = field(default_factory=list)
    """In the order in which they ended."""
    begun: bool = False
    left: bool = False
    again: DeviceResult | None = None

    @property
    def results(self) -> dict[str, DeviceResult]:
        return dict(self.ended)


async def meet(bench: Bench, nth: int, second: str, *, at_once: bool, **changes: Any) -> Meeting:  # noqa: ANN401
    """Start another laptop before the n-th step of the first; `at_once`: it ends before the first one goes on.

    A `run` among the changes is the name of both.
    """
    meeting = Meeting(before=bench.export())
    tasks: list[asyncio.Task[None]] = []

    async def laptop(name: str, text: str, **more: Any) -> None:  # noqa: ANN401
        job = bench.job(desired_state=desired.read(text), **{"run": name, **changes, **more})
        meeting.ended.append((name, await converge(job)))

    async def start() -> None:
        meeting.begun = True
        tasks.append(asyncio.ensure_future(laptop("second", second)))
        if at_once:
            await tasks[0]

    await laptop("first", bench.text, connect=Starter(nth, start).connect)
    await asyncio.gather(*tasks)
    meeting.now = bench.export()
    meeting.left = "atlantis-run" in str(await bench.router.console(["/ip/firewall/address-list/print"]))
    last = next((name for name, result in reversed(meeting.ended) if result.status is Status.CHANGED), None)
    text = second if last == "second" else bench.text
    meeting.again = await bench.converge(JobMode.PLAN, desired_state=desired.read(text))
    return meeting


@cache
def states(text: str, version: str) -> tuple[str, str]:
    """The router before and after a run that nobody disturbs."""

    async def act(bench: Bench) -> tuple[str, str]:
        before = bench.export()
        result = await bench.converge()
        assert result.status is Status.CHANGED
        return before, bench.export()

    with TemporaryDirectory() as folder:
        return on(Bench(Path(folder), text=text, spec={"version": version}), act)


def judge(meeting: Meeting, first: str, second: str, version: str, where: object) -> None:
    """Hold both to what they were told."""
    told = [(name, result.status.value, result.message) for name, result in meeting.ended]
    for _, result in meeting.ended:
        assert result.status in PLAIN, (where, told)
        if result.status is Status.LEFT_AS_FOUND:
            assert int(result.exit) == 4
            assert "nothing was changed" in result.message, (where, told)
    last = next((name for name, result in reversed(meeting.ended) if result.status is Status.CHANGED), None)
    assert last is not None, (where, told)
    assert meeting.again is not None
    assert meeting.again.planned_count == 0, (where, told, meeting.again.diff)
    if sum(result.status is Status.CHANGED for _, result in meeting.ended) == 1:
        assert meeting.now == states(second if last == "second" else first, version)[1], (where, told)
    assert not meeting.left, (where, told)


def meetings(  # noqa: PLR0913 - who meets, when and how
    tmp_path: Path,
    first: str,
    second: str,
    numbers: Sequence[int] | None,
    *,
    at_once: bool,
    version: str = "7.18.2",
    **changes: Any,  # noqa: ANN401 - of `Bench.job`
) -> list[Meeting]:
    """Meet at these batches, or at every one."""
    found: list[Meeting] = []
    for nth in numbers or range(1, 60):
        bench = Bench(tmp_path / str(nth), text=first, spec={"version": version})
        meeting = on(bench, partial(meet, nth=nth, second=second, at_once=at_once, **changes))
        if not meeting.begun:
            break
        judge(meeting, first, second, version, nth)
        found.append(meeting)
    return found


@pytest.mark.smoke("same-at the same time")
@pytest.mark.parametrize("at_once", [True, False], ids=["one after the other", "at the same time"])
@pytest.mark.parametrize("second", [TEXT, OTHER], ids=["same", "other"])
def test_second_run_at_every_sentence(tmp_path: Path, second: str, at_once: bool) -> None:  # noqa: FBT001
    found = meetings(tmp_path, TEXT, second, None, at_once=at_once)
    assert len(found) > 5
    losers = [each for each in found if Status.LEFT_AS_FOUND in {result.status for result in each.results.values()}]
    words = {result.message for each in losers for result in each.results.values()}
    assert any("api-ssl:provision@10.64.101.10 holds safe mode" in each for each in words), words
    assert any("somebody else has changed the device since it was read" in each for each in words) or not at_once


@pytest.mark.parametrize("at_once", [True, False], ids=["one after the other", "at the same time"])
@pytest.mark.parametrize("first", [LONG, BROAD, NAMES], ids=["behind", "before", "pieces"])
def test_second_run_while_safe_mode_is_not_held(tmp_path: Path, first: str, at_once: bool) -> None:  # noqa: FBT001
    found = meetings(tmp_path, first, OTHER, [5, 6, 7, 8, 9, 10, 12], at_once=at_once)
    assert found


@pytest.mark.smoke("7.18.2")
@pytest.mark.parametrize("version", ["7.18.2", "7.16"])
def test_runs_with_the_same_id_behind_one_address(tmp_path: Path, version: str) -> None:
    """Both began in the same second, and a tunnel or a NAT gives both the same address."""
    found = meetings(
        tmp_path, BROAD, BROAD, [5, 6, 7, 8, 9, 10], at_once=False, version=version, run="20261126T055812Z"
    )
    ended = [sorted(result.status for _, result in each.ended) for each in found]
    assert [Status.CHANGED, Status.LEFT_AS_FOUND] in ended, ended


@pytest.mark.parametrize("second", [TEXT, OTHER], ids=["same", "other"])
def test_router_without_safe_mode_for_the_api(tmp_path: Path, second: str) -> None:
    found = meetings(tmp_path, TEXT, second, [4, 5, 6, 7, 9, 11], at_once=True, version="7.16")
    words = {result.message for each in found for result in each.results.values()}
    active = (
        r"run first of provision@10\.64\.101\.10 \([0-9a-f]{6}\) is active on this device, or was interrupted there"
    )
    assert any(re.search(active, each) for each in words), words


@pytest.mark.campaign
@pytest.mark.parametrize("version", ["7.18.2", "7.16"])
@pytest.mark.parametrize("at_once", [True, False], ids=["one after the other", "at the same time"])
@pytest.mark.parametrize("second", ["same", "other"])
@pytest.mark.parametrize("first", [TEXT, LONG, BROAD, NAMES], ids=["short", "behind", "before", "pieces"])
def test_every_combination_at_every_sentence(
    tmp_path: Path,
    first: str,
    second: str,
    at_once: bool,  # noqa: FBT001
    version: str,
) -> None:
    other = first if second == "same" else first.replace("name=coastal-router", "name=other-router")
    assert meetings(tmp_path, first, other, None, at_once=at_once, version=version)
