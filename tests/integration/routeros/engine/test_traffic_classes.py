"""Classes of traffic on an emulated router: converged twice, drift where somebody moves them, and taken away again."""

from dataclasses import replace
from pathlib import Path

from engine_bench import PASSWORD, Bench, on

from atlantis_netcfg.emulator.routeros import User
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.inventory.model import TrafficClass
from atlantis_netcfg.operations.common.rehearsal import site_spec
from atlantis_netcfg.routeros import DeviceResult, JobMode, Status
from atlantis_netcfg.routeros.render import router

ROUTER = "coastal-router"


def texts() -> tuple[Inventory, str, str]:
    """The shipped declaration, its router's text, and the text with a class for two robots."""
    declared = load(Path(__file__).parents[4] / "inventory")
    coastal = declared.sites["coastal"]
    given = {"zarco": TrafficClass.IMAGES, "sparus": TrafficClass.BULK}
    rows = [row.model_copy(update={"traffic": given.get(row.name, row.traffic)}) for row in coastal.lan.reservations]
    lan = coastal.lan.model_copy(update={"reservations": tuple(rows)})
    classed = replace(declared, sites={**declared.sites, "coastal": coastal.model_copy(update={"lan": lan})})
    plain, more = (router(one, one.hosts[ROUTER]) for one in (declared, classed))
    return declared, plain, more


def test_traffic_classes_are_added_kept_and_removed(tmp_path: Path) -> None:
    declared, plain, classed = texts()
    (twin,) = site_spec(declared, [declared.hosts[ROUTER]]).emulators
    spec = {**dict(twin.router), "users": (User(name="provision", password=PASSWORD),)}

    async def act(bench: Bench) -> list[DeviceResult]:
        results = [await bench.converge()]
        bench.text = classed
        results += [await bench.converge(JobMode.PLAN), await bench.converge(), await bench.converge()]
        await bench.router.console(["/queue/tree/set", "=.id=satellite-images", "=priority=1"])
        results += [await bench.converge(JobMode.DRIFT), await bench.converge()]
        bench.text = plain
        return [*results, await bench.converge(), await bench.converge()]

    first, planned, added, again, drifted, back, gone, last = on(Bench(tmp_path, text=plain, spec=spec), act)
    assert first.status is Status.CHANGED, first.message
    assert (planned.status, planned.planned_count) == (Status.PLANNED, 4)
    assert (added.status, added.confirmed_count) == (Status.CHANGED, 4), added.message
    assert (again.status, again.planned_count) == (Status.UNCHANGED, 0)
    assert drifted.status is Status.DRIFTED
    assert (back.status, back.confirmed_count) == (Status.CHANGED, 1), back.message
    assert (gone.status, gone.message) == (Status.CHANGED, "2 actions on 4 rows applied and verified")
    assert last.status is Status.UNCHANGED
