import asyncio
from pathlib import Path
from typing import Literal

import pytest
from librouteros.exceptions import ConnectionClosed
from wire_helpers import Client, now, router, run

from atlantis_netcfg.emulator.routeros import EmulatedRouter, FaultKind, LinkFault, WireBehaviour

pytestmark = pytest.mark.coroutine(run=run)
PRINT = "/system/identity/print"
RENAME = ("/system/identity/set", "=name=renamed")
LOST = (ConnectionClosed, ConnectionResetError)


def renamed(twin: EmulatedRouter) -> bool:
    return "name=renamed" in twin.export()


@pytest.mark.parametrize("when", ["before", "after"])
async def test_connection_drop_at_the_nth_sentence(tmp_path: Path, when: Literal["before", "after"]) -> None:
    async with router(tmp_path) as twin, Client(twin) as client:
        twin.arm(LinkFault(do=FaultKind.DROP, sentence=3, when=when))
        await client.login()
        await client.talk(PRINT)
        client.write(RENAME, (PRINT,))
        with pytest.raises(LOST):
            await client.answer()
        assert renamed(twin) is (when == "after")
        assert [command[0] for command in twin.connections()[0].sentences] == ["/login", PRINT, RENAME[0]]


async def test_connection_drop_at_a_command_of_a_menu(tmp_path: Path) -> None:
    async with router(tmp_path) as twin, Client(twin) as client:
        twin.arm(LinkFault(do=FaultKind.DROP, match="/system/identity/*"))
        await client.login()
        await client.talk("/ip/pool/print")
        client.write(RENAME)
        assert not await client.ends()


async def test_a_clean_drop_undoes_safe_mode_two_seconds_later(tmp_path: Path) -> None:
    async with router(tmp_path) as twin, Client(twin) as client:
        await client.login()
        await client.talk("/safe-mode/take")
        await client.talk(*RENAME)
        twin.drop()
        await asyncio.sleep(2)
        assert renamed(twin)
        await asyncio.sleep(0.2)
        assert not renamed(twin)


async def test_pulled_cable_undoes_safe_mode_only_after_the_timeout(tmp_path: Path) -> None:
    async with router(tmp_path) as twin, Client(twin) as client:
        await client.login()
        await client.talk("/safe-mode/take")
        await client.talk(*RENAME)
        twin.vanish()
        client.write((PRINT,))
        await asyncio.sleep(539)
        assert renamed(twin)
        assert client.silent
        await asyncio.sleep(4)
        assert not renamed(twin)
        assert client.silent


async def test_truncated_reply(tmp_path: Path) -> None:
    async with router(tmp_path) as twin, Client(twin) as client:
        await client.login()
        twin.arm(LinkFault(do=FaultKind.TRUNCATE, offset=10))
        client.write((PRINT,))
        assert len(await client.transport.reader.read()) == 10


async def test_garbage_in_a_reply(tmp_path: Path) -> None:
    async with router(tmp_path) as twin, Client(twin) as client:
        await client.login()
        twin.arm(LinkFault(do=FaultKind.GARBAGE, data="ff00"))
        client.write((PRINT,))
        assert await client.transport.reader.readexactly(6) == b"\xff\x00\x03!re"


async def test_hanging_router(tmp_path: Path) -> None:
    async with router(tmp_path) as twin, Client(twin) as client, Client(twin) as other:
        await client.login()
        twin.arm(LinkFault(do=FaultKind.HANG))
        client.write((PRINT,), (PRINT,))
        await asyncio.sleep(1000)
        assert client.silent
        assert await other.login()


async def test_gap_after_nth_sentence_delays_its_reply(tmp_path: Path) -> None:
    async with router(tmp_path) as twin, Client(twin) as client:
        await client.login()
        twin.arm(LinkFault(do=FaultKind.GAP, seconds=70, when="after"))
        start = now()
        client.write(RENAME)
        await asyncio.sleep(1)
        assert renamed(twin)
        await client.answer()
        assert now() - start == pytest.approx(70)


async def test_gaps_that_overlap_end_with_the_last(tmp_path: Path) -> None:
    async with router(tmp_path) as twin, Client(twin) as client:
        await client.login()
        start = now()
        twin.gap(10)
        twin.gap(5)
        await client.talk(PRINT)
        assert now() - start == pytest.approx(10)


@pytest.mark.parametrize("asked", [True, False])
async def test_reboot_closes_the_connection_and_router_comes_back(tmp_path: Path, *, asked: bool) -> None:
    async with router(tmp_path, knobs=WireBehaviour(boot_s=40)) as twin, Client(twin) as client:
        await client.login()
        await client.talk(*RENAME)
        start = now()
        if asked:
            client.write(("/system/reboot",))
        else:
            twin.reboot()
        assert await client.ends()
        async with Client(twin) as again:
            await again.login()
            assert now() - start == pytest.approx(40, abs=0.1)
        assert renamed(twin)


async def test_old_connection_is_reset_after_a_power_cut(tmp_path: Path) -> None:
    async with router(tmp_path, knobs=WireBehaviour(boot_s=40)) as twin, Client(twin) as client:
        await client.login()
        await client.talk("/safe-mode/take")
        await client.talk(*RENAME)
        start = now()
        twin.reboot(clean=False)
        client.write((PRINT,))
        assert not await client.ends()
        assert now() - start == pytest.approx(40)
        assert not renamed(twin)


async def test_certificate_can_be_replaced(tmp_path: Path) -> None:
    async with router(tmp_path) as twin:
        before = twin.pin
        twin.recertify()
        assert twin.pin != before
        async with Client(twin, "api-ssl") as client:
            assert await client.login() == [("!done", ())]


SCRIPT = (
    '/ip pool add name=a ranges=10.0.0.2-10.0.0.9\n:put "ok 1"\n/ip pool add name=b \\\n    ranges=10.0.1.2-10.0.1.9'
)


@pytest.mark.parametrize(("lines", "pools"), [(0, []), (1, ["a"]), (2, ["a"]), (3, ["a", "b"]), (None, ["a", "b"])])
async def test_connection_drop_within_a_script(tmp_path: Path, lines: int | None, pools: list[str]) -> None:
    async with router(tmp_path) as twin, Client(twin) as client:
        await client.login()
        twin.arm(LinkFault(do=FaultKind.DROP, match="/execute", when="after", lines=lines))
        client.write(("/execute", f"=script={SCRIPT}", "=as-string="))
        assert not await client.ends()
        text = twin.export(menu="/ip/pool", header=False)
        assert [name for name in ("a", "b") if f"name={name} " in text] == pools


async def test_a_session_that_an_admin_removes_is_closed(tmp_path: Path) -> None:
    async with router(tmp_path) as twin, Client(twin) as client:
        await client.login()
        active = await client.talk("/user/active/print")
        number = dict(word[1:].split("=", 1) for word in active[0][1])[".id"]
        await twin.console(["/user/active/request-logout", f"=.id={number}"])
        assert await client.ends()
