"""The routers that the inventory declares, from adopted to configured, at the cost that is promised."""

from functools import cache
from pathlib import Path
from typing import Any

import pytest
from engine_bench import PASSWORD, Bench, leases, on

from atlantis_netcfg.emulator.routeros import FaultKind, LinkFault, RouterLink, User
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.operations.common.rehearsal import site_spec
from atlantis_netcfg.operations.common.session_link import site_link_of
from atlantis_netcfg.routeros import DeviceResult, JobMode, Status
from atlantis_netcfg.routeros.render import router

pytestmark = pytest.mark.slow

RTT_S = 0.7
ROUTERS = ("coastal-router", "scc-router", "te4sea-router")
NEWER = " configuration.installation=outdoor"
"""Of a radio, from RouterOS 7.17 on; an older device is refused."""


@cache
def declaration() -> Inventory:
    return load(Path(__file__).parents[4] / "inventory")


def bench(tmp_path: Path, name: str, extra: str = "", **more: Any) -> Bench:  # noqa: ANN401 - fields of RouterSpec
    host = declaration().hosts[name]
    (twin,) = site_spec(declaration(), [host]).emulators
    spec = {**dict(twin.router), "users": (User(name="provision", password=PASSWORD),), **more}
    text = router(declaration(), host)
    if spec["version"] == "7.16":
        text = text.replace(NEWER, "")
    return Bench(tmp_path, text=text + extra, spec=spec)


def reservations(number: int) -> str:
    """So many DHCP reservations more, in networks that no site has."""
    return leases(number).replace("server=lan", "server=dhcp-lan").replace("address=10.64.", "address=10.99.")


async def twice(bench: Bench) -> list[DeviceResult]:
    return [await bench.converge(), await bench.converge()]


@pytest.mark.smoke("coastal-router-300")
@pytest.mark.parametrize("number", [0, 300])
@pytest.mark.parametrize("name", ROUTERS)
def test_a_declared_router_converges_twice_at_the_promised_cost(tmp_path: Path, name: str, number: int) -> None:
    first, second = on(bench(tmp_path, name, reservations(number) if number else ""), twice)
    assert (first.status, second.status) == (Status.CHANGED, Status.UNCHANGED), first.message
    assert first.confirmed_count == first.planned_count > 100 + number
    assert first.round_trips <= 22
    assert second.round_trips == 5
    assert second.planned_count == 0


def test_unchanged_run_over_iridium_takes_five_round_trips(tmp_path: Path) -> None:
    """Three for TCP and TLS 1.2, one for the login, one for everything that is read."""

    async def act(bench: Bench) -> DeviceResult:
        await bench.converge()
        bench.router.set_link(RouterLink(delay_s=RTT_S / 2))
        return await bench.converge()

    idle = on(bench(tmp_path, "coastal-router"), act)
    assert idle.status is Status.UNCHANGED
    assert idle.seconds <= 5 * RTT_S + 0.05


@pytest.mark.parametrize("name", ROUTERS)
def test_estimate_matches_the_actual_cost(tmp_path: Path, name: str) -> None:
    bearer = site_link_of(declaration(), declaration().hosts[name])

    async def act(bench: Bench) -> tuple[DeviceResult, DeviceResult]:
        return await bench.converge(link=bearer), await bench.converge(link=bearer)

    for result in on(bench(tmp_path, name), act):
        assert result.estimate is not None
        assert result.estimate.round_trips == pytest.approx(result.round_trips, abs=1)
        assert result.estimate.bytes == pytest.approx(result.sent_bytes + result.received_bytes, rel=0.25)


@pytest.mark.smoke
def test_failed_run_restores_the_former_configuration(tmp_path: Path) -> None:
    async def act(bench: Bench) -> tuple[DeviceResult, str, str]:
        before = bench.export()
        bench.text += 'add address=10.99.2.1 comment="atlantis: twice" mac-address=02:00:00:02:00:00 server=dhcp-lan\n'
        return await bench.converge(), before, bench.export()

    result, before, now = on(bench(tmp_path, "coastal-router", reservations(300)), act)
    assert result.status is Status.ROLLED_BACK
    assert "restored by us" in result.message
    assert now == before


@pytest.mark.parametrize("nth", [3, 4, 5])
@pytest.mark.parametrize("kind", [FaultKind.DROP, FaultKind.REBOOT])
def test_declared_router_cut_between_its_parts_can_be_resumed(tmp_path: Path, kind: FaultKind, nth: int) -> None:
    async def act(bench: Bench) -> tuple[DeviceResult, str, str, DeviceResult]:
        before = bench.export()
        bench.router.arm(LinkFault(do=kind, match="/execute", sentence=nth, when="after"))
        result = await bench.converge()
        return result, before, bench.export(), await bench.converge(JobMode.RESUME)

    result, before, now, resumed = on(bench(tmp_path, "coastal-router", reservations(50)), act)
    assert result.status in (Status.ROLLED_BACK, Status.CHANGED)
    assert (now == before) == (result.status is Status.ROLLED_BACK)
    assert resumed.exit == 0


@pytest.mark.smoke
def test_results_and_files_contain_no_secret(tmp_path: Path) -> None:
    async def act(bench: Bench) -> Any:  # noqa: ANN401 - a result
        return await bench.converge()

    there = bench(tmp_path, "coastal-router")
    result = on(there, act)
    told = str(result.as_dict()) + str(there.events)
    kept = b"".join(path.read_bytes() for path in (tmp_path / "state").rglob("*") if path.is_file())
    for secret in ("EXAMPLE-vpn-coastal", PASSWORD):
        assert secret not in told
        assert secret.encode() not in kept


@pytest.mark.smoke("coastal-router-7.16-job")
@pytest.mark.parametrize("ssh", [True, False], ids=["console", "job"])
@pytest.mark.parametrize("version", ["7.16", "7.17.1"])
@pytest.mark.parametrize("name", ROUTERS)
def test_a_declared_router_converges_twice_below_7_18(tmp_path: Path, name: str, version: str, ssh: bool) -> None:  # noqa: FBT001
    """Under the protection that there is: safe mode of a console and a dead-man job, or the job alone."""

    async def act(bench: Bench) -> tuple[DeviceResult, DeviceResult, str]:
        keys: dict[str, Any] = {"ssh": bench.ssh} if ssh else {}
        first, second = await bench.converge(**keys), await bench.converge(**keys)
        return first, second, str(await bench.router.console(["/system/scheduler/print"]))

    first, second, jobs = on(bench(tmp_path, name, version=version), act)
    assert (first.status, first.protection) == (Status.CHANGED, "console-safe-mode" if ssh else "dead-man"), (
        first.message
    )
    assert (second.status, second.planned_count) == (Status.UNCHANGED, 0), second.message
    assert "atlantis-dead-man" not in jobs
