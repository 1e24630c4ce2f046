"""SSH on a wire that fails: what befalls API connections befalls these, and safe mode ends as it does there."""

import asyncio
from collections.abc import AsyncIterator, Coroutine
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any

import asyncssh
import pytest
from waiting import HANG_S

from atlantis_netcfg.emulator.routeros import (
    EmulatedRouter,
    FaultKind,
    LinkFault,
    RouterLink,
    RouterSpec,
    User,
    WireBehaviour,
)

PASSWORD = "open sesame"
ADD = "/ip pool add name=s ranges=10.0.0.1"


def run(test: Coroutine[Any, Any, None]) -> None:
    asyncio.run(asyncio.wait_for(test, HANG_S))


pytestmark = pytest.mark.coroutine(run=run)


@asynccontextmanager
async def router(tmp_path: Path, *, link: RouterLink | None = None, **spec: Any) -> AsyncIterator[EmulatedRouter]:  # noqa: ANN401
    wanted = {
        "name": "router",
        "users": (User(name="admin", password=PASSWORD), User(name="guest", password=PASSWORD)),
        "unroll_delay_s": 0.0,
        **spec,
    }
    knobs = WireBehaviour(boot_s=0.05)
    async with EmulatedRouter(RouterSpec.model_validate(wanted), state_dir=tmp_path, link=link, knobs=knobs) as twin:
        yield twin


async def connect(twin: EmulatedRouter, user: str = "admin") -> asyncssh.SSHClientConnection:
    return await asyncssh.connect(
        twin.host,
        twin.ports["ssh"],
        username=f"{user}+cet200w",
        password=PASSWORD,
        known_hosts=None,
        client_keys=None,
        config=None,
    )


async def until(condition: Any) -> None:  # noqa: ANN401 (a function without arguments)
    while not condition():  # noqa: ASYNC110 (the router tells nobody when it undoes)
        await asyncio.sleep(0.01)


class Console:
    def __init__(self, process: asyncssh.SSHClientProcess[str]) -> None:
        self.process = process

    @classmethod
    async def open(cls, connection: asyncssh.SSHClientConnection) -> "Console":
        console = cls(await connection.create_process(term_type="vt100", term_size=(80, 24)))
        await console.until("> ")
        return console

    async def until(self, wanted: str) -> str:
        return str(await self.process.stdout.readuntil(wanted))

    async def say(self, text: str, wanted: str) -> str:
        self.process.stdin.write(text)
        return await self.until(wanted)


async def held(twin: EmulatedRouter) -> tuple[str, asyncssh.SSHClientConnection, Console]:
    """A session that has changed something in safe mode, and the export from before."""
    before, connection = twin.export(header=False), await connect(twin)
    console = await Console.open(connection)
    await console.say("\x18", "<SAFE> ")
    await console.say(f"{ADD}\r", "<SAFE> ")
    assert twin.export(header=False) != before
    return before, connection, console


@pytest.mark.parametrize("how", ["close", "abort", "drop", "channel"])
async def test_visible_disconnect_undoes_safe_mode(tmp_path: Path, how: str) -> None:
    async with router(tmp_path, version="7.16") as twin:
        before, connection, console = await held(twin)
        if how == "close":
            connection.close()
        elif how == "abort":
            connection.abort()
        elif how == "drop":
            twin.drop()
        else:
            console.process.close()
        await until(lambda: twin.export(header=False) == before)
        connection.abort()
        await connection.wait_closed()


async def test_silent_connection_is_undone_after_the_timeout(tmp_path: Path) -> None:
    async with router(tmp_path, version="7.16", silent_timeout_s=0.3) as twin:
        before, connection, _ = await held(twin)
        twin.vanish()
        await asyncio.sleep(0.1)
        assert twin.export(header=False) != before
        await until(lambda: twin.export(header=False) == before)
        connection.abort()


@pytest.mark.parametrize("clean", [True, False])
async def test_reboot_undoes_safe_mode_and_router_comes_back(tmp_path: Path, clean: bool) -> None:  # noqa: FBT001
    async with router(tmp_path, version="7.16") as twin:
        before, connection, _ = await held(twin)
        twin.reboot(clean=clean)
        assert twin.export(header=False) == before
        if clean:
            await connection.wait_closed()
        again = await connect(twin)
        assert (await again.run("/system identity print")).stdout == "  name: MikroTik\r\n"
        again.close()
        connection.abort()


async def test_a_reboot_by_the_console(tmp_path: Path) -> None:
    async with router(tmp_path) as twin, await connect(twin) as connection:
        console = await Console.open(connection)
        await console.say("/system reboot\r", "[y/N]:")
        console.process.stdin.write("y")
        await connection.wait_closed()
        async with await connect(twin) as again:
            assert (await again.run(':put "up"')).stdout == "up\r\n"


@pytest.mark.parametrize("when", ["before", "after"])
async def test_connection_drop_at_a_command(tmp_path: Path, when: str) -> None:
    async with router(tmp_path) as twin, await connect(twin) as connection:
        twin.arm(LinkFault.model_validate({"do": FaultKind.DROP, "match": "/ip pool*", "when": when}))
        assert (await connection.run(':put "fine"')).stdout == "fine\r\n"
        with pytest.raises((asyncssh.Error, OSError)):
            await connection.run(ADD, check=True)
        assert ("name=s" in twin.export()) is (when == "after")


@pytest.mark.parametrize("when", ["before", "after"])
async def test_power_cut_at_an_upload(tmp_path: Path, when: str) -> None:
    async with router(tmp_path / "state") as twin, await connect(twin) as connection:
        (tmp_path / "package").write_bytes(bytes(range(256)) * 1000)
        twin.arm(LinkFault.model_validate({"do": FaultKind.POWER, "match": "sftp put package", "when": when}))
        files = await connection.start_sftp_client()
        with pytest.raises((asyncssh.Error, OSError, TimeoutError)):
            await asyncio.wait_for(files.put(tmp_path / "package", "package"), 0.5)
        connection.abort()
        async with await connect(twin) as again:
            there = await (await again.start_sftp_client()).listdir("/")
        assert ("package" in there) is (when == "after")


async def test_truncated_output(tmp_path: Path) -> None:
    async with router(tmp_path) as twin, await connect(twin) as connection:
        twin.arm(LinkFault(do=FaultKind.TRUNCATE, offset=4))
        assert (await connection.run(':put "0123456789"')).stdout == "0123\r\n"
        assert (await connection.run(':put "0123456789"')).stdout == "0123456789\r\n"


async def test_hanging_router(tmp_path: Path) -> None:
    async with router(tmp_path) as twin:
        twin.arm(LinkFault(do=FaultKind.HANG))
        connection = await connect(twin)
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(connection.run(ADD), 0.2)
        assert "name=s" not in twin.export()
        connection.abort()


async def test_a_gap_only_delays(tmp_path: Path) -> None:
    async with router(tmp_path) as twin, await connect(twin) as connection:
        twin.gap(0.2)
        start = asyncio.get_running_loop().time()
        assert (await connection.run(':put "late"')).stdout == "late\r\n"
        assert asyncio.get_running_loop().time() - start >= 0.2


async def test_disabled_service_keeps_sessions_but_accepts_no_new_ones(tmp_path: Path) -> None:
    async with router(tmp_path) as twin, await connect(twin) as connection:
        port = twin.ports["ssh"]
        await connection.run("/ip service disable ssh")
        assert "ssh" not in twin.ports
        with pytest.raises(ConnectionRefusedError):
            await asyncio.open_connection(twin.host, port)
        await connection.run("/ip service enable ssh")
        assert twin.ports["ssh"] == port


@pytest.mark.parametrize("service", ["api", "api-ssl", "ssh"])
async def test_service_for_other_addresses_accepts_then_closes(tmp_path: Path, service: str) -> None:
    """Manual, Services: `address` refuses only after the packet has arrived."""
    async with router(tmp_path) as twin:
        await twin.console(["/ip/service/set", f"=numbers={service}", "=address=192.0.2.0/24"])
        reader, writer = await asyncio.open_connection(twin.host, twin.ports[service])
        with suppress(ConnectionResetError):
            assert await reader.read(1) == b""
        writer.close()
        assert twin.counters().logins == 0


async def test_firewall_drops_silently(tmp_path: Path) -> None:
    async with router(tmp_path) as twin, await connect(twin) as connection:
        rule = ["/ip/firewall/filter/add", "=chain=input", "=protocol=tcp", "=dst-port=22", "=action=drop"]
        await twin.console(rule)
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(connection.run(':put "a"'), 0.2)
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(connect(twin), 0.2)
        await twin.console(["/ip/firewall/filter/remove", "=numbers=*1"])
        assert (await connection.run(':put "b"')).stdout == "b\r\n"
        connection.abort()


async def test_a_session_that_is_logged_out_closes(tmp_path: Path) -> None:
    async with router(tmp_path) as twin, await connect(twin) as connection:
        await Console.open(connection)
        answers = await twin.console(["/user/active/print", "?via=ssh"])
        number = answers[0].words[0].removeprefix("=.id=")
        await twin.console(["/user/active/request-logout", f"=numbers={number}"])
        await connection.wait_closed()


async def test_slow_link_costs_few_round_trips(tmp_path: Path) -> None:
    async with router(tmp_path, link=RouterLink(delay_s=0.02)) as twin:
        start = asyncio.get_running_loop().time()
        async with await connect(twin) as connection:
            await connection.run(':put "a"')
        turns = twin.counters().turns
        assert asyncio.get_running_loop().time() - start >= 0.04 * turns
        assert 5 <= turns <= 12


async def test_policy_and_settings_can_deny_login(tmp_path: Path) -> None:
    async with router(tmp_path, version="7.21.5") as twin:
        await twin.console(["/ip/ssh/set", "=password-authentication=no"])
        with pytest.raises(asyncssh.PermissionDenied):
            await connect(twin)
        await twin.console(["/ip/ssh/set", "=password-authentication=yes"])
        await twin.console(["/user/group/add", "=name=apis", "=policy=api,read"])
        await twin.console(["/user/set", "=numbers=guest", "=group=apis"])
        with pytest.raises(asyncssh.PermissionDenied):
            await connect(twin, "guest")
        (await connect(twin)).abort()


async def test_closed_connections_leave_no_sessions(tmp_path: Path) -> None:
    async with router(tmp_path) as twin:
        for _ in range(3):
            connections = [await connect(twin) for _ in range(4)]
            await asyncio.gather(*(one.run(':put "x"') for one in connections))
            for one in connections:
                one.close()
                await one.wait_closed()
        await until(lambda: not twin.device._core.sessions)
        assert twin.counters().connections == 12
