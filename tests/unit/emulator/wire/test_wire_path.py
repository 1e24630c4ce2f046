import asyncio
import hashlib
import re
import ssl
import sys
from pathlib import Path
from types import FrameType
from typing import Any

import pytest
from wire_helpers import Client, now, router, router_spec, run

from atlantis_netcfg.core.secret import MASK
from atlantis_netcfg.emulator.routeros import EmulatedRouter, FaultKind, LinkFault, WireBehaviour, WireCounters
from atlantis_netcfg.emulator.routeros.wire.link import Faults, WirePace, mask_words

pytestmark = pytest.mark.coroutine(run=run)
PRINT = "/system/identity/print"
DROP = ("/ip/firewall/filter/add", "=chain=input", "=action=drop", "=in-interface=ether8")


async def test_lockout_is_silent_and_undone_by_safe_mode(tmp_path: Path) -> None:
    async with router(tmp_path) as twin, Client(twin) as client:
        before = twin.export()
        await client.login()
        await client.talk("/safe-mode/take")
        start = now()
        client.write(DROP)
        await asyncio.sleep(100)
        assert client.silent
        async with Client(twin) as other:
            await other.login()
            assert now() - start == pytest.approx(540 + 2.15, abs=0.1)
            assert (await other.talk(PRINT))[-1] == ("!done", ())
        client.write((PRINT,))
        assert not await client.ends()
        assert twin.export().splitlines()[1:] == before.splitlines()[1:]


async def test_lockout_without_safe_mode_is_permanent(tmp_path: Path) -> None:
    async with router(tmp_path) as twin, Client(twin) as client:
        await client.login()
        client.write(DROP)
        await asyncio.sleep(10_000)
        assert client.silent
        async with Client(twin) as other:
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(other.login(), 1000)
        assert "chain=input" in twin.export()


async def test_disconnect_over_a_blocked_path_is_noticed_only_by_timeout(tmp_path: Path) -> None:
    async with router(tmp_path) as twin:
        async with Client(twin) as client:
            await client.login()
            await client.talk("/safe-mode/take")
            client.write(DROP)
            await asyncio.sleep(1)
        await asyncio.sleep(500)
        assert "action=drop" in twin.export()
        await asyncio.sleep(45)
        assert "action=drop" not in twin.export()


async def test_traffic_resumes_when_the_path_is_opened(tmp_path: Path) -> None:
    async with router(tmp_path) as twin, Client(twin) as client:
        await client.login()
        client.write((*DROP, ".tag=1"), (PRINT, ".tag=2"))
        await asyncio.sleep(60)
        assert client.silent
        await twin.console(["/ip/firewall/filter/disable", "=numbers=*1"])
        assert [(await client.answer())[-1][1][0] for _ in range(2)] == [".tag=1", ".tag=2"]
        assert (await client.talk(PRINT))[-1] == ("!done", ())


async def test_service_follows_its_configured_port(tmp_path: Path) -> None:
    async with router(tmp_path) as twin, Client(twin) as client:
        before = dict(twin.port_map)
        await client.login()
        await client.talk("/ip/service/set", "=numbers=api-ssl", "=port=8730")
        assert set(twin.port_map) == {22, 8728, 8730}
        assert twin.ports["api-ssl"] == twin.port_map[8730]
        async with Client(twin, "api-ssl") as moved:
            await moved.login()
        with pytest.raises(ConnectionRefusedError):
            await asyncio.open_connection(twin.host, before[8729])
        await client.talk("/ip/service/set", "=numbers=api-ssl", "=port=8729")
        assert twin.port_map == before


async def test_disabled_service_refuses_connections(tmp_path: Path) -> None:
    async with router(tmp_path) as twin, Client(twin, "api-ssl") as client:
        port = twin.ports["api"]
        await client.login()
        await client.talk("/ip/service/disable", "=numbers=api")
        assert "api" not in twin.ports
        with pytest.raises(ConnectionRefusedError):
            await asyncio.open_connection(twin.host, port)


async def test_a_service_for_other_addresses_does_not_answer(tmp_path: Path) -> None:
    async with router(tmp_path) as twin, Client(twin, "api-ssl") as client:
        await client.login()
        await client.talk("/ip/service/set", "=numbers=api", "=address=10.99.0.0/24")
        async with Client(twin) as other:
            other.write(("/login",))
            await asyncio.sleep(1000)
            assert other.transport.reader._buffer == b""


async def test_session_limit_is_enforced(tmp_path: Path) -> None:
    async with router(tmp_path) as twin, Client(twin) as client:
        await client.login()
        await client.talk("/ip/service/set", "=numbers=api", "=max-sessions=1")
        async with Client(twin) as other:
            other.write(("/login",))
            assert not await other.ends()
        assert (await client.talk(PRINT))[-1] == ("!done", ())


async def test_tls_version_and_certificate_of_the_service(tmp_path: Path) -> None:
    async with router(tmp_path) as twin, Client(twin) as plain:
        async with Client(twin, "api-ssl") as client:
            shown: ssl.SSLObject = client.transport.writer.get_extra_info("ssl_object")
            assert shown.version() == "TLSv1.2"
            der = shown.getpeercert(binary_form=True)
            assert der is not None
            assert hashlib.sha256(der).hexdigest() == twin.pin
        await plain.login()
        await plain.talk("/ip/service/set", "=numbers=api-ssl", "=certificate=none")
        assert twin.pin is None
        with pytest.raises(ssl.SSLError):
            await Client(twin, "api-ssl").__aenter__()


async def test_restart_keeps_only_saved_changes(tmp_path: Path) -> None:
    async with router(tmp_path) as twin:
        pin, ports = twin.pin, twin.ports
        async with Client(twin) as client:
            await client.login()
            await client.talk("/system/identity/set", "=name=kept")
            await client.talk("/safe-mode/take")
            await client.talk("/ip/pool/add", "=name=held", "=ranges=10.0.0.2-10.0.0.9")
            await twin.restart()
            assert await client.ends()
        assert "name=kept" in twin.export()
        assert "held" not in twin.export()
        assert (twin.pin, twin.ports) == (pin, ports)
    async with router(tmp_path) as again:
        assert "name=kept" in again.export()
        assert again.pin == pin


async def test_flash_is_written_while_it_runs_and_is_private(tmp_path: Path) -> None:
    async with router(tmp_path) as twin, Client(twin) as client:
        await client.login()
        await client.talk("/system/identity/set", "=name=kept")
        files = [path for path in (tmp_path / "flash").rglob("*") if path.is_file()]
        assert "kept" in (tmp_path / "flash" / "flash.json").read_text()
        assert {path.stat().st_mode & 0o777 for path in files} == {0o600}


async def test_occupied_port_is_an_error(tmp_path: Path) -> None:
    async with router(tmp_path) as twin:
        taken = twin.ports["api-ssl"]
        other = EmulatedRouter(router_spec(), state_dir=tmp_path / "other", ports={8729: taken})
        with pytest.raises(OSError, match="address already in use"):
            await other.start()
        assert other.ports == {}
    async with EmulatedRouter(router_spec(), state_dir=tmp_path / "other", ports={8729: taken}) as other:
        assert other.port_map[8729] == taken


def test_slowdown_starts_after_a_burst_and_ends_when_idle() -> None:
    knobs, pace = WireBehaviour(knee_after=2), WirePace()
    assert [pace.wait_s(knobs, 5.0) for _ in range(4)] == pytest.approx([0, 0, 0.02, 0.04])
    assert pace.wait_s(knobs, 5.1) == pytest.approx(0.02)
    assert pace.wait_s(knobs, 7.0) == 0


def test_stalled_nth_sentence_delays_the_rest() -> None:
    knobs, pace = WireBehaviour(stall_every=2, stall_s=7), WirePace()
    assert [pace.wait_s(knobs, 5.0) for _ in range(3)] == [0, 7, 7]


def test_a_fault_strikes_once_at_its_sentence() -> None:
    faults = Faults()
    faults.arm(LinkFault(do=FaultKind.DROP, sentence=2, match="/ip/firewall/*"))
    assert faults.upon("/ip/firewall/filter/add") == []
    assert faults.upon("/ip/address/add") == []
    assert [fault.do for fault in faults.upon("/ip/firewall/nat/add")] == [FaultKind.DROP]
    assert faults.upon("/ip/firewall/nat/add") == []
    assert faults.pending == ()


def test_disarmed_faults_do_not_strike() -> None:
    faults = Faults()
    faults.arm(LinkFault(do=FaultKind.GAP, seconds=1))
    faults.disarm()
    assert faults.upon("/login") == []


@pytest.mark.parametrize(
    ("word", "shown"),
    [
        ("=password=hunter2", f"=password={MASK}"),
        ("=wpa2-pre-shared-key=a=b c", f"=wpa2-pre-shared-key={MASK}"),
        ("=response=00ab", f"=response={MASK}"),
        ("=name=password", "=name=password"),
        ("=private-key=", "=private-key="),
        (
            '=script=/interface ovpn-client add name=x password="a \\" b" user=u\n:put "ok 1"',
            f'=script=/interface ovpn-client add name=x password={MASK} user=u\n:put "ok 1"',
        ),
    ],
)
def test_secrets_are_masked_in_the_log(word: str, shown: str) -> None:
    assert mask_words(["/x", word]) == ("/x", shown)


def test_counters_add_up() -> None:
    assert WireCounters(1, 2, 3, 4, 5, 6, 7, 8).plus(WireCounters(turns=1, wire_out=1)) == WireCounters(
        1, 2, 4, 4, 5, 6, 7, 9
    )


async def test_cost_of_a_row_does_not_grow_with_table_size(tmp_path: Path) -> None:
    """Steps of the interpreter and bytes to the flash, of which each row once took more than the one before."""
    steps = 0

    def count(frame: FrameType, event: str, _: object) -> Any:  # noqa: ANN401 - as settrace has it
        nonlocal steps
        frame.f_trace_lines, frame.f_trace_opcodes = False, True
        steps += event == "opcode"
        return count

    async def cost(twin: EmulatedRouter, first: int) -> tuple[int, int]:
        nonlocal steps
        steps, before = 0, _written()
        sys.settrace(count)
        for each in range(first, first + 100):
            address = f"=address=198.18.{each // 250}.{1 + each % 250}"
            await twin.console(["/ip/firewall/address-list/add", "=list=theirs", address])
        sys.settrace(None)
        return steps, _written() - before

    async with router(tmp_path) as twin:
        costs = [await cost(twin, first) for first in range(0, 1200, 100)]
        flash = (tmp_path / "flash" / "flash.json").stat().st_size
    assert costs[-1][0] < 1.05 * costs[1][0]
    assert sum(written for _, written in costs) < 4 * flash


def _written() -> int:
    """Bytes that this process has written so far."""
    return int(re.findall(r"(?m)^wchar: (\d+)$", Path("/proc/self/io").read_text())[0])
