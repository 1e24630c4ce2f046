"""The dead-man job's script, run on a router on which any first part of a plan has happened: it is as before."""

from pathlib import Path

import pytest
from engine_bench import TEXT, Bench, leases, on

from atlantis_netcfg.routeros import Status, desired
from atlantis_netcfg.routeros._types import Observation, Plan
from atlantis_netcfg.routeros.api import Command, Session
from atlantis_netcfg.routeros.apply._inverse import CannotInvert, inverse
from atlantis_netcfg.routeros.apply._scripts import scripts
from atlantis_netcfg.routeros.guard import MENUS as GUARDED
from atlantis_netcfg.routeros.observe import observe
from atlantis_netcfg.routeros.planner import plan

pytestmark = pytest.mark.slow

FORWARD = 'add action=drop chain=forward comment="atlantis: costs'
RULES = "".join(
    f'add action=accept chain=input comment="atlantis: rule {each}" dst-port={each} protocol=tcp\n'
    for each in range(1, 6)
)
LONGER = TEXT.replace(FORWARD, RULES + FORWARD)
TURNED = TEXT.replace(FORWARD, "\n".join(reversed(RULES.strip().split("\n"))) + "\n" + FORWARD)
OTHER = (
    TEXT.replace("name=coastal-router", "name=other")
    .replace("interface=ether5\n", "interface=ether6\n")
    .replace("lease-time=1h", "lease-time=2h")
    .replace(" in-interface=bridge-lan protocol=icmp", " in-interface=bridge-lan protocol=udp")
    .replace('add action=accept chain=input comment="atlantis: rest"', "")
    .replace("set ftp disabled=yes\n", "")
)


def ran(text: str) -> Command:
    return Command("/execute", (("script", text), ("as-string", "")))


async def planned(bench: Bench, session: Session, text: str) -> tuple[Observation, Plan]:
    wanted = desired.read(text)
    seen = await observe(session, bench.job().endpoint, wanted.menus, GUARDED)
    return seen, plan("router", wanted, seen)


async def every_part(bench: Bench, text: str, step: int) -> int:
    """Carry out ever more of the plan, and go back each time, twice."""
    session = await Session.open(bench.job().endpoint)
    before = bench.export()
    number, size = 0, 1
    while number <= size:
        seen, aim = await planned(bench, session, text)
        size = len(aim.actions)
        back = inverse(seen, aim)
        for script, inside in scripts(aim.actions[:number]):
            reply = await session.command(ran(script))
            assert (reply.ret or "").count("ok ") == len(inside), reply
        for _ in range(2):
            reply = await session.command(ran(back))
            assert reply.trap is None, reply.trap
            assert bench.export() == before, (number, back)
        number += step
    await session.close()
    return size


@pytest.mark.smoke("everything-7.16")
@pytest.mark.parametrize("version", ["7.9", "7.16"])
@pytest.mark.parametrize(
    ("first", "second"),
    [("", TEXT), (TEXT, OTHER), (LONGER, TURNED), (TURNED, TEXT), (LONGER, OTHER)],
    ids=["everything", "changes", "moves", "removals", "all kinds"],
)
def test_rollback_works_after_any_part_of_a_plan(tmp_path: Path, first: str, second: str, version: str) -> None:
    bench = Bench(tmp_path, spec={"version": version})

    async def act(bench: Bench) -> int:
        if first:
            result = await bench.converge(desired_state=desired.read(first))
            assert result.status is Status.CHANGED
        return await every_part(bench, second, 1)

    assert on(bench, act) >= 1


@pytest.mark.smoke
def test_rollback_script_that_would_contain_a_password_is_refused(tmp_path: Path) -> None:
    """Anybody who may read the configuration could read it there."""
    client = '/interface ovpn-client\nadd comment="atlantis: vpn" connect-to=192.0.2.10 name=vpn password={} user=r\n'
    bench = Bench(tmp_path)

    async def act(bench: Bench) -> None:
        await bench.converge(desired_state=desired.read(TEXT + client.format("hush-hush")))
        session = await Session.open(bench.job().endpoint)
        seen, aim = await planned(bench, session, TEXT + client.format("another"))
        with pytest.raises(CannotInvert, match="would hold a password in clear"):
            inverse(seen, aim)
        await session.close()

    on(bench, act)
    assert "hush-hush" in bench.router.export(show_sensitive=True)


def test_rollback_script_that_is_too_long_is_refused(tmp_path: Path) -> None:
    bench = Bench(tmp_path)

    async def act(bench: Bench) -> str:
        session = await Session.open(bench.job().endpoint)
        seen, aim = await planned(bench, session, TEXT + leases(1000))
        await session.close()
        with pytest.raises(CannotInvert) as refused:
            inverse(seen, aim)
        return str(refused.value)

    assert on(bench, act) == "the way back is too long for one script"
