"""What one run consists of, and in which order its devices have their turn."""

import asyncio
from dataclasses import replace
from pathlib import Path

import pytest

from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.inventory import Inventory
from atlantis_netcfg.inventory.model import Cpe, SignalBounds
from atlantis_netcfg.operations import Mode, Request
from atlantis_netcfg.operations.common.rehearsal import site_spec
from atlantis_netcfg.operations.common.schedule import far_link, members_of, pair_of, with_other_ends
from atlantis_netcfg.operations.common.session_link import site_link_of
from atlantis_netcfg.routeros import DeviceJob, DeviceResult, Endpoint, Status, fleet
from atlantis_netcfg.routeros.desired import read
from atlantis_netcfg.routeros.pair import Signal

BOTH = ("coastal-cpe", "scc-cpe")


def named(declaration: Inventory, *names: str, **said: object) -> dict[tuple[str, ...], tuple[str, ...]]:
    request = Request.model_validate({"state": Path("/nowhere"), **said})
    found = members_of(declaration, names, request)
    return {tuple(host.name for host in member.hosts): member.after for member in found}


def test_other_bridge_end_is_added_and_both_wait_for_the_routers(declaration: Inventory) -> None:
    assert named(declaration, "coastal-cpe", "coastal-router") == {BOTH: ("coastal-router",), ("coastal-router",): ()}
    assert named(declaration, "scc-cpe") == {BOTH[::-1]: ()}
    every = named(declaration, *declaration.hosts)
    assert every[BOTH[::-1]] == ("scc-router", "coastal-router"), "who asks for all stands at the control centre"


@pytest.mark.parametrize("mode", [Mode.PLAN, Mode.DRIFT])
def test_read_only_runs_wait_for_no_other_device(declaration: Inventory, mode: Mode) -> None:
    assert named(declaration, "coastal-router", "coastal-cpe", mode=mode) == {("coastal-router",): (), BOTH: ()}


def test_replacement_device_is_restored_alone(declaration: Inventory) -> None:
    assert named(declaration, "coastal-cpe", restore="20260101T000000Z") == {("coastal-cpe",): ()}


def test_bridge_end_without_saved_state_is_not_rolled_back(declaration: Inventory, tmp_path: Path) -> None:
    assert named(declaration, "coastal-cpe", state=tmp_path, back_to="20260101T000000Z") == {("coastal-cpe",): ()}


def test_other_ends_are_added_once(declaration: Inventory) -> None:
    hosts = [declaration.hosts[name] for name in ("coastal-router", *BOTH)]
    assert with_other_ends(declaration, hosts) == tuple(hosts)
    assert [host.name for host in with_other_ends(declaration, hosts[:2])] == ["coastal-router", *BOTH]
    assert with_other_ends(declaration, hosts[:1]) == (hosts[0],)


def test_pair_uses_the_stricter_limits_of_both_ends(declaration: Inventory) -> None:
    (member,) = members_of(declaration, ["coastal-cpe"], Request(state=Path("/nowhere")))
    assert member.bridge is not None
    near, far = (end.device for end in member.bridge.ends)
    assert isinstance(near, Cpe)
    assert isinstance(far, Cpe)
    changed = {"signal": SignalBounds(weakest_dbm=-70, strongest_dbm=-30), "link_timeout_s": 600}
    ptp = near.ptp.model_copy(update=changed)
    near_host = replace(member.bridge.near, device=near.model_copy(update={"ptp": ptp}))
    pair = pair_of(replace(member.bridge, near=near_host), job("near"), job("far"))
    assert pair.signal == Signal(weakest_dbm=-70, strongest_dbm=-35)
    assert pair.link_timeout_s == 600
    assert pair_of(member.bridge, job("near"), job("far")).link_timeout_s == 300


@pytest.mark.parametrize(("over", "name"), [("lan", "wifi-ptp"), ("satellite", "satellite")])
def test_far_end_session_is_as_slow_as_its_slowest_link(declaration: Inventory, over: str, name: str) -> None:
    (member,) = members_of(declaration, ["coastal-cpe"], Request(state=Path("/nowhere")))
    assert member.bridge is not None
    near = replace(job("near"), link=site_link_of(declaration, member.bridge.near, over))
    bearer = far_link(declaration, member.bridge, near)
    assert bearer is not None
    assert bearer.name == name


@pytest.mark.parametrize(
    ("asked", "via", "near"),
    [
        ("coastal-cpe", None, "coastal-cpe"),
        ("scc-cpe", None, "scc-cpe"),
        ("coastal-cpe", "wifi-ptp", "scc-cpe"),
        ("coastal-router", None, None),
    ],
)
def test_emulated_bridge_has_the_same_near_end_as_the_run(
    declaration: Inventory, asked: str, via: str | None, near: str | None
) -> None:
    hosts = with_other_ends(declaration, [declaration.hosts[asked]])
    spec = site_spec(declaration, hosts, via, {host.name for host in hosts} - {asked})
    request = Request(state=Path("/nowhere"), via={} if via is None else {asked: via})
    (member,) = members_of(declaration, [asked], request)
    assert (member.bridge and member.bridge.near.name) == near
    assert [pair.near for pair in spec.pairs] == ([near] if near else [])


def job(name: str) -> DeviceJob:
    """Where it leads to does not matter: the engine is replaced."""
    return DeviceJob(name, Endpoint("127.0.0.1", 1, "nobody", Secret("x"), None), read("", source="nothing"))


@pytest.mark.parametrize("how", ["ends", "fails to be made"])
def test_device_starts_after_the_one_it_waits_for(monkeypatch: pytest.MonkeyPatch, how: str) -> None:
    order: list[str] = []

    async def converge(job: DeviceJob, *, mode: object) -> DeviceResult:
        assert mode is not None
        order.append(f"{job.name} begins")
        for _ in range(5):
            await asyncio.sleep(0)
        order.append(f"{job.name} ends")
        return DeviceResult(job.name, Status.UNCHANGED, Status.UNCHANGED.exit, "")

    def refuse() -> DeviceJob:
        order.append("router ends")
        raise NetcfgError("somebody works there")

    monkeypatch.setattr("atlantis_netcfg.routeros.apply.converge", converge)
    first = fleet.PendingJob("router", (lambda: job("router")) if how == "ends" else refuse)
    waiting = [fleet.PendingJob("radio", lambda: job("radio"), after=("router", "of another run")), first]
    told: list[str] = []
    asyncio.run(fleet.stream(waiting, lambda result: told.append(result.name)))
    assert order.index("router ends") < order.index("radio begins")
    assert sorted(told) == ["radio", "router"]
