"""The text of a MikroTik LTE box, written to one on real sockets; what it amounts to is read by the bearer's reader."""

from pathlib import Path
from typing import Any

import pytest
from engine_bench import Bench, on

from atlantis_netcfg.emulator.routeros import (
    CellSpec,
    ControlError,
    EmulatedSite,
    ManagementSpec,
    ModemSpec,
    SimSpec,
    SiteSpec,
)
from atlantis_netcfg.emulator.routeros.control import execute
from atlantis_netcfg.inventory import load
from atlantis_netcfg.links import LinkFinding
from atlantis_netcfg.links.lte import Registration
from atlantis_netcfg.links.lte.judge import LteSubscription, judge
from atlantis_netcfg.links.lte.routeros import log_query, queries, read
from atlantis_netcfg.operations.links.session import ReadOnlySession
from atlantis_netcfg.operations.links.status import modem_reading
from atlantis_netcfg.routeros import JobMode, desired
from atlantis_netcfg.routeros.render import lte

DECLARATION = load(Path(__file__).parents[4] / "inventory")
HOST = DECLARATION.hosts["coastal-4g"]
WANTED = LteSubscription(apn="internet.example", bands=(3, 7, 20))
MANAGEMENT = ManagementSpec(address="10.10.1.1/29", port="ether1", technician="10.10.1.2")


def box(tmp_path: Path, version: str = "7.18.2", *, sim: SimSpec | None = SimSpec(), **cell: Any) -> Bench:  # noqa: ANN401, B008 - fields of CellSpec; frozen
    modem = ModemSpec(sim=sim, cell=CellSpec(**{"apns": ("internet.example",), **cell}))
    spec = {"version": version, "ports": ("ether1",), "poe_ports": (), "management": MANAGEMENT, "modem": modem}
    return Bench(tmp_path, lte(DECLARATION, HOST), spec=spec)


async def findings(bench: Bench) -> tuple[LinkFinding, ...]:
    """Ask as whoever has a session asks, and judge."""
    told = []
    for query in (*queries("lte1"), log_query()):
        answers = await bench.router.console([query.path, *(f"={name}={value}" for name, value in query.words)])
        rows = [one.words for one in answers if one.kind == "!re"]
        told.append([dict(word[1:].partition("=")[::2] for word in words) for words in rows])
    monitor, interfaces, profiles, addresses, log = told
    return judge(read(monitor[0], interfaces, profiles, addresses, log), WANTED)


@pytest.mark.parametrize("version", ["7.18.2", "7.21.5"])
def test_device_converges_and_has_the_declared_apn(tmp_path: Path, version: str) -> None:
    async def act(bench: Bench) -> None:
        assert {one.code for one in await findings(bench)} == {"apn-of-the-network", "no-address"}
        first = await bench.converge()
        assert (first.status, first.protection) == ("changed", "safe-mode")
        assert await findings(bench) == ()
        again = await bench.converge()
        assert (again.status, again.planned_count) == ("unchanged", 0)

    on(box(tmp_path, version), act)


def test_swapped_names_of_cable_and_modem_are_restored(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        assert (await bench.converge()).status == "changed"
        before = bench.export()
        for path, name, new in (("ethernet", "ether1", "x"), ("lte", "lte1", "ether1"), ("ethernet", "x", "lte1")):
            await bench.router.console([f"/interface/{path}/set", f"=.id={name}", f"=name={new}"])
        assert bench.export() != before
        again = await bench.converge()
        assert (again.status, again.planned_count) == ("changed", 3)
        assert bench.export() == before
        assert await findings(bench) == ()
        assert (await bench.converge()).status == "unchanged"

    on(box(tmp_path), act)


def test_a_renamed_modem_is_read_as_before(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        assert (await bench.converge()).status == "changed"
        door = ReadOnlySession("box", bench.job().endpoint)
        async with door.open_session() as session:
            before = await modem_reading(session)
        await bench.router.console(["/interface/lte/set", "=.id=lte1", "=name=starlink"])
        async with door.open_session() as session:
            assert await modem_reading(session) == before
        assert (before.state, before.address is not None) == (Registration.REGISTERED_HOME, True)

    on(box(tmp_path), act)


def test_rollback_restores_the_former_configuration(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        before = bench.export()
        saved = bench.router.export()
        assert (await bench.converge()).status == "changed"
        menus = desired.read(bench.text).menus
        back = await bench.converge(JobMode.ROLLBACK, desired_state=desired.from_export(saved, menus))
        assert back.status == "changed"
        assert bench.export() == before
        assert (
            await bench.converge(JobMode.ROLLBACK, desired_state=desired.from_export(saved, menus))
        ).planned_count == 0

    on(box(tmp_path), act)


@pytest.mark.parametrize(
    ("sim", "cell", "codes"),
    [
        (SimSpec(), {"plmn": "20601"}, {"roaming-not-allowed"}),
        (SimSpec(), {"apns": ("other",)}, {"no-address"}),
        (SimSpec(), {"bands": (28,)}, {"searching"}),
        (SimSpec(), {"denies": True}, {"registration-denied"}),
        (SimSpec(), {"rsrp_dbm": -110, "rsrq_db": -18, "sinr_db": -3}, {"weak-rsrp", "weak-rsrq", "weak-sinr"}),
        (SimSpec(pin="1234"), {}, {"pin-needed"}),
        (SimSpec(pin="1234", tries=0), {}, {"puk-needed"}),
        (None, {}, {"sim-missing"}),
    ],
)
def test_subscription_problems_are_reported(
    tmp_path: Path, sim: SimSpec | None, cell: dict[str, Any], codes: set[str]
) -> None:
    async def act(bench: Bench) -> None:
        assert (await bench.converge()).status == "changed"
        assert {one.code for one in await findings(bench)} == codes
        assert (await bench.converge()).planned_count == 0

    on(box(tmp_path, sim=sim, **cell), act)


def test_network_of_a_running_emulator_can_be_changed(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        await bench.converge()
        site = EmulatedSite(SiteSpec(name="coastal", emulators=()), tmp_path)
        site.routers = {"box": bench.router}
        told = await execute(site, "box", "modem", {"cell": {"plmn": "20601"}})
        assert told == {"phase": "registered", "tries_left": 3, "pins_entered": 0}
        assert {one.code for one in await findings(bench)} == {"roaming-not-allowed"}
        await bench.router.restart()
        assert {one.code for one in await findings(bench)} == {"roaming-not-allowed"}
        with pytest.raises(ControlError, match="colour"):
            await execute(site, "box", "modem", {"colour": {}})

    on(box(tmp_path), act)


def test_board_without_a_modem_is_refused_unchanged(tmp_path: Path) -> None:
    async def act(bench: Bench) -> None:
        before = bench.export()
        found = await bench.converge()
        assert found.status == "refused"
        assert "lte1 does not exist in /interface lte; the device has none" in found.message
        assert bench.export() == before

    bench = box(tmp_path)
    spec = {**bench.spec, "modem": None}
    on(Bench(tmp_path, bench.text, spec=spec), act)
