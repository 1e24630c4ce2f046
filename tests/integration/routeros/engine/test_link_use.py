"""A link in use for a time: the order moves, is told, and comes back by itself, whoever dies and whatever the clock."""

import asyncio
from collections.abc import Coroutine, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from engine_bench import Bench, Meddler, on
from test_sites import bench, declaration

from atlantis_netcfg.emulator.routeros import FaultKind, LinkFault
from atlantis_netcfg.emulator.routeros.spec import DeviceMode, DeviceModeName
from atlantis_netcfg.links.policy import LinkRoute, active_link
from atlantis_netcfg.operations.common.costs import ways_of
from atlantis_netcfg.routeros import DeviceResult, Endpoint, JobMode, Status, desired
from atlantis_netcfg.routeros.api import Command, Reply, Session, SessionLost, Unreachable
from atlantis_netcfg.routeros.apply import Channel, Patience
from atlantis_netcfg.routeros.desired import DesiredState
from atlantis_netcfg.routeros.guard import MENUS, WAY_BACK
from atlantis_netcfg.routeros.link_use import TICK_S, LinkUse, end_use, start_use
from atlantis_netcfg.routeros.observe import seconds

pytestmark = pytest.mark.slow

FOR_S = 600
RUNNING_S = 200
"""How long the router has run when a use begins."""
PTP = ("198.51.100.11", "198.51.100.12")
LTE = ("198.51.100.21", "198.51.100.22")
UNTIL = datetime(2026, 11, 25, 20, 30, tzinfo=UTC)
TOLD = "satellite is in use instead of the inventory's order until 2026-11-25 20:30 UTC (9 min left)"
GAP_S = 70.0
SHORT_S = 120
"""Of a use that is killed."""
HASTY = Patience(reach_s=30)
"""A dead laptop waits for nobody."""


def router(tmp_path: Path, **more: Any) -> Bench:  # noqa: ANN401 - fields of RouterSpec
    """The router of the coastal site, as declared; its own address is there since its adoption."""
    made = bench(tmp_path, "coastal-router", **more)
    adopted = "add address=10.64.101.1/24 "
    seed = "".join(line for line in made.text.splitlines(keepends=True) if not line.startswith(adopted))
    return bench(tmp_path, "coastal-router", seed=seed, **more)


def exported(bench: Bench) -> str:
    """The configuration; that a route is not checked may be written down, and means the same as nothing."""
    return bench.export().replace("\\\n    ", "").replace("check-gateway=none ", "")


@cache
def ways() -> tuple[LinkRoute, ...]:
    return ways_of(declaration(), declaration().hosts["coastal-router"])


async def rows(bench: Bench, menu: str, *queries: str) -> list[dict[str, str]]:
    answers = await bench.router.console([f"{menu}/print", *queries])
    return [dict(word[1:].partition("=")[::2] for word in each.words) for each in answers if each.kind == "!re"]


async def active(bench: Bench) -> str | None:
    return active_link(await rows(bench, "/ip/route"), ways())


async def armed(bench: Bench) -> bool:
    return bool(await rows(bench, "/system/scheduler", "?name=atlantis-use"))


async def uptime(bench: Bench) -> int:
    return int(seconds((await rows(bench, "/system/resource"))[0]["uptime"]) or 0)


async def use_of(bench: Bench, link: str, for_s: int = FOR_S) -> DesiredState:
    since = await uptime(bench)
    addresses = {way.name: way.address for way in ways()}
    return start_use(desired.read(bench.text), LinkUse(link, UNTIL, since + for_s), since, addresses)


async def begin(bench: Bench, link: str, for_s: int = FOR_S, **changes: Any) -> DeviceResult:  # noqa: ANN401 - of DeviceJob
    return await bench.converge(desired_state=await use_of(bench, link, for_s), **changes)


async def started(bench: Bench) -> str:
    """Let the router run for a while, and return its export."""
    await asyncio.sleep(RUNNING_S)
    assert await active(bench) == "wifi-ptp"
    return exported(bench)


@pytest.mark.smoke("4g-7.18.2")
@pytest.mark.parametrize("version", ["7.16", "7.18.2", "7.21.5"])
@pytest.mark.parametrize("link", ["4g", "satellite"])
def test_link_use_ends_automatically(tmp_path: Path, version: str, link: str) -> None:
    async def act(bench: Bench) -> None:
        before = await started(bench)
        changed = await begin(bench, link)
        assert changed.status is Status.CHANGED, changed.message
        assert await active(bench) == link
        await asyncio.sleep(FOR_S - 3 * TICK_S)
        assert await active(bench) == link
        await asyncio.sleep(3 * TICK_S)
        assert await active(bench) == "wifi-ptp"
        assert exported(bench) == before
        assert [row for row in await rows(bench, "/log") if row["topics"].startswith("script,error")] == []

    on(router(tmp_path, version=version), act)


def test_used_link_that_fails_is_left_and_used_again(tmp_path: Path) -> None:
    """One silent canary moves nothing, two do, to the next link as declared; a link that is back is in use again."""

    async def act(bench: Bench) -> None:
        before = await started(bench)
        await begin(bench, "4g", 1500)
        bench.router.silence(LTE[:1])
        await asyncio.sleep(120)
        assert await active(bench) == "4g"
        bench.router.silence([*LTE, *PTP])
        await asyncio.sleep(120)
        assert await active(bench) == "satellite"
        bench.router.silence(LTE)
        await asyncio.sleep(180)
        assert await active(bench) == "wifi-ptp"
        bench.router.silence([])
        await asyncio.sleep(240)
        assert await active(bench) == "4g"
        await asyncio.sleep(1500)
        assert (await active(bench), exported(bench)) == ("wifi-ptp", before)

    on(router(tmp_path), act)


@pytest.mark.smoke("1970-01-01 00:00:00-1")
@pytest.mark.parametrize("moment_s", [1, 35, 300, 595])
@pytest.mark.parametrize("clock", ["1970-01-01 00:00:00", "2031-05-05 05:05:05"])
def test_restart_ends_the_link_use_whatever_the_clock(tmp_path: Path, moment_s: int, clock: str) -> None:
    async def act(bench: Bench) -> None:
        before = await started(bench)
        assert (await begin(bench, "4g")).status is Status.CHANGED
        await asyncio.sleep(moment_s)
        await bench.router.console(["/system/reboot"])
        await asyncio.sleep(20)
        date, time = clock.split()
        await bench.router.console(["/system/clock/set", f"=date={date}", f"=time={time}"])
        await asyncio.sleep(2 * TICK_S)
        assert not await armed(bench)
        assert (await active(bench), exported(bench)) == ("wifi-ptp", before)

    on(router(tmp_path), act)


@pytest.mark.parametrize("clock", ["1970-01-01 00:00:00", "2031-05-05 05:05:05"])
def test_clock_jump_does_not_change_the_end_of_the_use(tmp_path: Path, clock: str) -> None:
    async def act(bench: Bench) -> None:
        before = await started(bench)
        await begin(bench, "4g")
        await asyncio.sleep(100)
        date, time = clock.split()
        await bench.router.console(["/system/clock/set", f"=date={date}", f"=time={time}"])
        await asyncio.sleep(FOR_S - 100 - 3 * TICK_S)
        assert await active(bench) == "4g"
        await asyncio.sleep(3 * TICK_S)
        assert (await active(bench), exported(bench)) == ("wifi-ptp", before)

    on(router(tmp_path), act)


def test_every_run_reports_the_use_and_leaves_it(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        await started(bench)
        await begin(bench, "satellite")
        await asyncio.sleep(60)
        during = exported(bench)
        for mode in (JobMode.PLAN, JobMode.APPLY, JobMode.RESUME, JobMode.DRIFT):
            found = await bench.converge(mode)
            assert (found.status, found.planned_count) == (Status.UNCHANGED, 0), (mode, found.message, found.diff)
            (note,) = [note for note in found.notes if "in use" in note]
            assert note.startswith(TOLD)
        assert exported(bench) == during
        bench.text = bench.text.replace("memory-lines=2000", "memory-lines=3000")
        assert (await bench.converge()).planned_count == 1
        assert await active(bench) == "satellite"

    on(router(tmp_path), act)


def test_use_without_its_job_is_drift_that_a_run_repairs(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        before = await started(bench)
        await begin(bench, "satellite")
        await bench.router.console(["/system/scheduler/remove", "=numbers=atlantis-use"])
        found = await bench.converge(JobMode.DRIFT)
        assert found.status is Status.DRIFTED
        assert [note for note in found.notes if "in use" in note] == []
        assert (await bench.converge()).status is Status.CHANGED
        assert (await active(bench), exported(bench)) == ("wifi-ptp", before)

    on(router(tmp_path), act)


@pytest.mark.smoke
def test_use_is_extended_shortened_moved_and_ended(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        before = await started(bench)
        await begin(bench, "4g", 120)
        await asyncio.sleep(30)
        longer = await begin(bench, "4g", 900)
        assert (longer.status, longer.planned_count) == (Status.CHANGED, 1), longer.diff
        await asyncio.sleep(600)
        assert await active(bench) == "4g"
        assert (await begin(bench, "satellite", 900)).status is Status.CHANGED
        assert await active(bench) == "satellite"
        await asyncio.sleep(30)
        assert (await begin(bench, "satellite", 60)).planned_count == 1
        await asyncio.sleep(60)
        assert (await active(bench), exported(bench)) == ("wifi-ptp", before)
        await begin(bench, "satellite", 900)
        await asyncio.sleep(30)
        over = await bench.converge(desired_state=end_use(desired.read(bench.text)))
        assert over.status is Status.CHANGED, over.message
        assert (await active(bench), exported(bench)) == ("wifi-ptp", before)
        again = await bench.converge(desired_state=end_use(desired.read(bench.text)))
        assert again.status is Status.UNCHANGED

    on(router(tmp_path), act)


@pytest.mark.parametrize("nth", [1, 2])
def test_the_job_may_run_while_the_use_is_ended(tmp_path: Path, nth: int) -> None:
    """Its first run moves the distances from 4 to 5: that is nobody else's change."""

    async def act(bench: Bench) -> None:
        before = await started(bench)
        await begin(bench, "satellite")
        meddler = Meddler("/ip/route/print", lambda: asyncio.sleep(TICK_S), nth=nth)
        over = await bench.converge(desired_state=end_use(desired.read(bench.text)), connect=meddler.connect)
        assert over.status is Status.CHANGED, over.message
        assert (await active(bench), exported(bench)) == ("wifi-ptp", before)

    on(router(tmp_path), act)


def test_router_that_forbids_the_scheduler_refuses_the_use(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        before = await started(bench)
        refused = await begin(bench, "4g")
        assert refused.status is Status.REFUSED
        assert "forbids the scheduler, so the job atlantis-use would never run" in refused.message
        assert exported(bench) == before

    on(router(tmp_path, device_mode=DeviceMode(mode=DeviceModeName.HOME)), act)


@pytest.mark.smoke
def test_link_that_does_not_carry_the_traffic_is_rolled_back(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        before = await started(bench)
        result = await begin(bench, "4g", shows=lambda _seen: "4g does not carry the traffic")
        assert result.status is Status.ROLLED_BACK
        assert "4g does not carry the traffic" in result.message
        assert exported(bench) == before

    on(router(tmp_path), act)


def test_router_that_deviates_from_the_inventory_refuses_the_use(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        refused = await begin(bench, "4g")
        assert refused.status is Status.REFUSED
        assert "0.0.0.0/0 via 198.51.100.21 does not exist in /ip route" in refused.message

    on(bench(tmp_path, "coastal-router"), act)


PREFLIGHT = {
    *("/system/identity/print", "/system/resource/print", "/safe-mode/print", "/user/active/print"),
    "/system/scheduler/print",
}
MARKS = "/ip/firewall/address-list"
"""The mark of a run is a row of it."""


def reads(bench: Bench, session: int) -> list[set[str]]:
    """Menus that were read in a session, and those that were counted."""
    said = [sentence for sentence in bench.router.connections()[session].sentences if sentence[0].endswith("/print")]
    return [{each[0] for each in said if ("=count-only=" in each) is counted} for counted in (False, True)]


def test_only_route_related_and_written_menus_are_read(tmp_path: Path) -> None:
    async def act(bench: Bench) -> tuple[list[set[str]], list[set[str]]]:
        await started(bench)
        assert (await begin(bench, "4g")).status is Status.CHANGED
        return reads(bench, -2), reads(bench, -1)

    (full, counted), (again, counted_again) = on(router(tmp_path), act)
    way = {f"{menu}/print" for menu in (*WAY_BACK, MARKS)}
    before_a_change = {"/user/print", "/user/group/print", "/system/device-mode/print"}
    written = {"/ip/route/print", "/system/scheduler/print"}
    assert full == way | PREFLIGHT | before_a_change
    assert counted == {"/system/history/print", "/system/scheduler/print"}
    assert again == written | {"/system/resource/print", "/safe-mode/print"}
    singletons = {"/routing/settings/print", "/system/identity/print"}
    assert counted_again == (way | {"/user/print", "/user/group/print"}) - written - singletons


ONE_ROUTE = '/system scheduler\n/ip route\nadd blackhole comment="atlantis: x" dst-address={}\n'
"""A text about routes and jobs alone, like those of a use."""


@pytest.mark.smoke("apply")
@pytest.mark.parametrize("mode", [JobMode.PLAN, JobMode.APPLY])
def test_route_change_that_affects_our_session_is_checked_by_the_guard(tmp_path: Path, mode: JobMode) -> None:
    """Refused in the words of a run that has read all of it at first."""

    async def act(bench: Bench) -> tuple[str, DeviceResult, list[set[str]]]:
        there = bench.export()
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("atlantis_netcfg.routeros.link_use.is_order", lambda _: False)
            whole = await bench.converge(mode, desired_state=desired.read(ONE_ROUTE.format("10.64.101.10/32")))
        refused = await bench.converge(mode, desired_state=desired.read(ONE_ROUTE.format("10.64.101.10/32")))
        assert bench.export() == there
        assert refused.message == whole.message
        return refused.message, refused, reads(bench, -1)

    message, refused, (full, _) = on(Bench(tmp_path), act)
    assert refused.status is Status.REFUSED
    assert "responses to you at 10.64.101.10 take 10.64.101.0/24 on ether8; after this change the route" in message
    assert full >= {f"{menu}/print" for menu in MENUS}


def test_route_change_that_spares_our_session_is_applied(tmp_path: Path) -> None:
    async def act(bench: Bench) -> set[str]:
        result = await bench.converge(desired_state=desired.read(ONE_ROUTE.format("203.0.113.0/24")))
        assert result.status is Status.CHANGED, result.message
        assert "203.0.113.0/24" in bench.export()
        return reads(bench, -2)[0]

    assert not {f"{menu}/print" for menu in UNREAD} & on(Bench(tmp_path), act)


UNREAD = {*MENUS} - {*WAY_BACK, MARKS, "/user", "/user/group"}


def test_the_mark_of_another_run_is_seen_before_anything_is_sent(tmp_path: Path) -> None:
    """Also by a run that reads little."""

    async def act(bench: Bench) -> None:
        before = await started(bench)
        row = ["=list=atlantis-run", "=address=192.0.2.1", "=timeout=1800", "=comment=run X of another"]
        await bench.router.console(["/ip/firewall/address-list/add", *row])
        left = await begin(bench, "4g")
        assert (left.status, "run X of another is active on this device" in left.message) == (
            Status.LEFT_AS_FOUND,
            True,
        )
        assert exported(bench) == before

    on(router(tmp_path), act)


# --- killed at every moment ------------------------------------------------------------------------------------------


@dataclass
class Laptop:
    """It dies when it has sent so many sentences: nothing is sent any more, and its connections are gone."""

    lives_for: int = 1_000_000
    sent: int = 0

    async def connect(self, endpoint: Endpoint) -> Channel:
        """In place of `Session.open`."""
        if self.sent >= self.lives_for:
            raise Unreachable("the laptop is dead")
        return _Mortal(await Session.open(endpoint), self)


class _Mortal:
    def __init__(self, session: Session, laptop: Laptop) -> None:
        self.traffic = session.traffic
        self._session = session
        self._laptop = laptop

    async def command(self, command: Command, *, silence_s: float | None = None) -> Reply:
        (reply,) = await self.flight([command], silence_s=silence_s)
        return reply

    async def flight(self, commands: Sequence[Command], *, silence_s: float | None = None) -> list[Reply]:
        laptop = self._laptop
        room = max(0, laptop.lives_for - laptop.sent)
        laptop.sent += min(room, len(commands))
        if room >= len(commands):
            return await self._session.flight(commands, silence_s=silence_s)
        if room:
            await self._session.flight(commands[:room], silence_s=silence_s)
        await self._session.close(wait=False)
        raise SessionLost("the laptop is dead", in_flight=True)

    async def close(self, *, wait: bool = True) -> None:
        await self._session.close(wait=wait)


@cache
def sentences(version: str) -> int:
    """How many a use takes that nothing disturbs."""

    async def act(bench: Bench) -> int:
        await started(bench)
        laptop = Laptop()
        await begin(bench, "4g", SHORT_S, connect=laptop.connect)
        return laptop.sent

    with TemporaryDirectory() as folder:
        return on(router(Path(folder), version=version), act)


async def in_its_order(bench: Bench, before: str, run: Coroutine[Any, Any, DeviceResult]) -> DeviceResult:
    """At the declared end the router is in its order, whatever has become of the run; and so it is for good."""
    task = asyncio.ensure_future(run)
    await asyncio.sleep(SHORT_S)
    assert await active(bench) == "wifi-ptp"
    result = await task
    await asyncio.sleep(SHORT_S)
    assert (await active(bench), exported(bench)) == ("wifi-ptp", before), result.message
    return result


def killed(tmp_path: Path, sentence: int, version: str) -> None:
    async def act(bench: Bench) -> DeviceResult:
        before = await started(bench)
        use = await use_of(bench, "4g", SHORT_S)
        return await in_its_order(
            bench, before, bench.converge(desired_state=use, connect=Laptop(sentence).connect, patience=HASTY)
        )

    result = on(router(tmp_path, version=version), act)
    assert result.status is not Status.CHANGED, sentence


OLD, NEW = "7.18.2", "7.21.5"


@pytest.mark.parametrize(("part", "version"), [(0.2, OLD), (0.5, NEW), (0.7, OLD), (0.8, NEW), (0.9, OLD)])
def test_killed_laptop_at_sampled_sentences(tmp_path: Path, part: float, version: str) -> None:
    killed(tmp_path, round(part * sentences(version)), version)


PARTS = 8
"""Of a campaign, so that each of its tests is over in time."""


@pytest.mark.campaign
@pytest.mark.parametrize("part", range(PARTS))
@pytest.mark.parametrize("version", [OLD, NEW])
def test_killed_laptop_at_every_sentence(tmp_path: Path, version: str, part: int) -> None:
    for sentence in range(part, sentences(version), PARTS):
        killed(tmp_path / str(sentence), sentence, version)


def cut(tmp_path: Path, sentence: int, kind: FaultKind, when: str, version: str) -> None:
    """Cut a use at one sentence; whoever gets through again, the order is back in time."""

    async def act(bench: Bench) -> DeviceResult:
        before = await started(bench)
        use = await use_of(bench, "4g", SHORT_S)
        fault = {"do": kind, "when": when, "sentence": sentence, "seconds": GAP_S}
        bench.router.arm(LinkFault.model_validate(fault))
        return await in_its_order(bench, before, bench.converge(desired_state=use))

    on(router(tmp_path, version=version), act)


def faults() -> Iterator[tuple[FaultKind, str]]:
    for kind in FaultKind:
        yield kind, "before"
        yield kind, "after"


@pytest.mark.parametrize(("kind", "when"), [(FaultKind.VANISH, "after"), (FaultKind.POWER, "before")])
@pytest.mark.parametrize(("part", "version"), [(0.7, OLD), (0.8, NEW), (0.9, OLD)])
def test_fault_at_sampled_sentences(tmp_path: Path, kind: FaultKind, when: str, part: float, version: str) -> None:
    cut(tmp_path, round(part * sentences(version)), kind, when, version)


@pytest.mark.campaign
@pytest.mark.parametrize("part", range(PARTS))
@pytest.mark.parametrize(("kind", "when"), list(faults()))
@pytest.mark.parametrize("version", [OLD, NEW])
def test_fault_at_every_sentence(tmp_path: Path, version: str, kind: FaultKind, when: str, part: int) -> None:
    for sentence in range(1 + part, sentences(version) + 1, PARTS):
        cut(tmp_path / str(sentence), sentence, kind, when, version)
