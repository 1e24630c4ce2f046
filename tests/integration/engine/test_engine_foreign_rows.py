"""Rows of others by the hundred in a menu that is ours entirely: counted, told, agreed to apart, and gone."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from engine_bench import TEXT, Bench, Meddler, on

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.routeros import DeviceResult, Mode, Status
from atlantis_netcfg.routeros.estimate import Bearer

if TYPE_CHECKING:
    from pathlib import Path

OURS = "# atlantis:entire /ip firewall address-list\n" + TEXT
LISTS = "/ip/firewall/address-list"
SATELLITE = Bearer("satellite", 0.7, 352_000, 704_000, metered=True)


async def foreign(bench: Bench, number: int) -> None:
    """Let somebody add rows to a list that is ours entirely."""
    for each in range(number):
        words = (f"=address=198.18.{each // 250}.{1 + each % 250}", "=comment=blocked", "=list=sat-allow")
        await bench.router.console([f"{LISTS}/add", *words])


def left(bench: Bench) -> int:
    return bench.export().count("comment=blocked")


def test_a_hundred_go_as_ever(tmp_path: Path) -> None:
    async def act(bench: Bench) -> tuple[DeviceResult, int]:
        await bench.converge()
        await foreign(bench, 100)
        return await bench.converge(), left(bench)

    result, there = on(Bench(tmp_path, text=OURS), act)
    assert (result.status, result.planned, result.rows, there) == (Status.CHANGED, 1, 100, 0)
    assert result.message == "1 action on 100 rows read back and kept"
    assert result.foreign_words == ""


def test_more_than_a_hundred_are_agreed_to_apart(tmp_path: Path) -> None:
    words = "removes 101 rows that carry no mark of ours: 101 from /ip firewall address-list"

    async def act(bench: Bench) -> tuple[list[DeviceResult], list[int]]:
        await bench.converge()
        await foreign(bench, 101)
        results, there = [], []
        for mode, agreed in ((Mode.PLAN, False), (Mode.APPLY, False), (Mode.APPLY, True), (Mode.APPLY, False)):
            results.append(await bench.converge(mode, remove_foreign=agreed))
            there.append(left(bench))
        return results, there

    (planned, refused, done, again), there = on(Bench(tmp_path, text=OURS), act)
    assert there == [101, 101, 0, 0]
    assert (planned.status, planned.message) == (Status.PLANNED, "1 action on 101 rows planned")
    assert planned.notes[-1] == f"the plan {words}"
    assert planned.foreign_words == words
    assert (refused.status, refused.exit) == (Status.REFUSED, ExitCode.FAILED)
    assert refused.message == f"refused, nothing was changed: nobody has agreed that it {words}"
    assert refused.hint is not None
    assert "type the same with `--remove-foreign`" in refused.hint
    assert (done.status, done.rows, done.confirmed) == (Status.CHANGED, 101, 1)
    assert (again.status, again.rows, again.foreign_words) == (Status.UNCHANGED, 0, "")


def test_rows_of_ours_are_not_foreign(tmp_path: Path) -> None:
    """A declaration that shrinks by two hundred rows of its own needs no other word than the plan."""
    rows = "".join(f'add address=198.18.0.{each} comment="atlantis: b" list=sat-allow\n' for each in range(1, 201))

    async def act(bench: Bench) -> DeviceResult:
        await bench.converge()
        bench.text = OURS
        return await bench.converge()

    result = on(Bench(tmp_path, text=f"{OURS}/ip firewall address-list\n{rows}"), act)
    assert (result.status, result.rows, result.foreign_words) == (Status.CHANGED, 200, "")


def test_where_the_menu_is_not_ours_they_stay(tmp_path: Path) -> None:
    async def act(bench: Bench) -> tuple[DeviceResult, int]:
        await bench.converge()
        await foreign(bench, 150)
        return await bench.converge(), left(bench)

    result, there = on(Bench(tmp_path), act)
    assert (result.status, there, len(result.drift)) == (Status.UNCHANGED, 150, 150)


@pytest.mark.slow
def test_a_thousand_over_the_satellite_are_estimated_by_rows(tmp_path: Path) -> None:
    """What the plan says it costs is what it costs: bytes within a fiftieth, pieces of safe mode included."""

    async def act(bench: Bench) -> tuple[DeviceResult, DeviceResult]:
        await bench.converge()
        await foreign(bench, 1000)
        planned = await bench.converge(Mode.PLAN, bearer=SATELLITE)
        return planned, await bench.converge(bearer=SATELLITE, remove_foreign=True)

    planned, done = on(Bench(tmp_path, text=OURS), act)
    assert (planned.planned, planned.rows, done.status) == (1, 1000, Status.CHANGED)
    assert planned.estimate is not None
    assert planned.estimate.bytes == pytest.approx(done.sent + done.received, rel=0.02)
    assert planned.sessions == 1
    assert done.sessions == 1 + 1000 // 80 + 1


@pytest.mark.parametrize(
    ("words", "where"),
    [
        ((f"{LISTS}/add", "=address=198.19.0.1", "=list=sat-allow"), "/ip firewall address-list"),
        (("/ip/pool/add", "=name=theirs", "=ranges=10.9.0.1-10.9.0.9"), "/ip pool"),
    ],
)
def test_what_somebody_does_meanwhile_is_still_noticed(tmp_path: Path, words: tuple[str, ...], where: str) -> None:
    """Where history is full all is looked at again before the first change; of very many rows their number."""

    async def act(bench: Bench) -> tuple[DeviceResult, int]:
        await bench.converge()
        await foreign(bench, 150)
        meddler = Meddler("/certificate/print", lambda: bench.router.console(words))
        return await bench.converge(remove_foreign=True, connect=meddler.connect), left(bench)

    result, there = on(Bench(tmp_path, text=OURS), act)
    assert (result.status, there) == (Status.LEFT_AS_FOUND, 150)
    assert f"somebody else has changed the device since it was read ({where})" in result.message
