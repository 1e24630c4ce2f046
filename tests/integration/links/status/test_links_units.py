"""The 4G link of te4sea as each driver reads it, well and sick: golden/te4sea-*.txt is what a technician reads."""

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from links_bench import Bench, bench, block, inventory, masked

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.emulator import modem, rutos
from atlantis_netcfg.emulator.routeros import CellSpec, EmulatorSpec, ModemSpec, SimSpec
from atlantis_netcfg.inventory import load
from atlantis_netcfg.operations.common.request import Target
from atlantis_netcfg.operations.common.terminals import TriedPin
from atlantis_netcfg.operations.lte.run import perform
from atlantis_netcfg.runs import Store
from atlantis_netcfg.runs.report.links import LinksReport

pytestmark = pytest.mark.slow

GOLDEN = Path(__file__).with_name("golden")
UNIT, BOX = "te4sea-4g", "coastal-4g"
FILE = f"host_vars/{UNIT}.yml"
HOME, FOREIGN = "26803", "20601"
SERIAL = f"""\
---
device:
  kind: lte_router
  address: 10.10.9.1
  powered_by: {{device: te4sea-router, port: ether1}}
  driver: at
  serial: {os.devnull}
  sim: {{apn: internet}}
"""
OTHERS = """\
---
device:
  kind: lte_router
  address: 10.10.9.1
  powered_by: {{device: te4sea-router, port: ether1}}
  driver: {driver}
"""
VAULTED = '!vault "$ANSIBLE_VAULT;1.1;AES256\\n6162\\n"'
"""A sealed PIN; `wrong` stands in for the vault's password."""


def wrong(_sealed: str) -> str:
    return "0000"


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    with bench(tmp_path_factory.mktemp("te4sea"), "te4sea") as opened:
        yield opened


@pytest.fixture
def te4sea(running: Bench) -> Iterator[Bench]:
    yield replace(running)
    running.heal()


@contextmanager
def unit(at: Bench, folder: Path, spec: Mapping[str, Any]) -> Iterator[Target]:
    """Another RutOS unit in the place of the declared one."""
    device = at.declaration.hosts[UNIT].device
    access = getattr(device, "access")  # noqa: B009 - of one kind of device only
    made = rutos.RutosSpec.model_validate(
        {
            "name": UNIT,
            "reader": access.user,
            "reader_password": access.password.reveal(),
            "admin": access.admin_user,
            "admin_password": access.admin_password.reveal(),
            **spec,
        }
    )
    with rutos.RunningRutos(made, folder / "unit") as started:
        ready = started.ready
        target = Target(
            host=ready["host"], port=ready["https"], pin=ready["pin"], ssh=ready["ssh"], host_key=ready["host_key"]
        )
        at.targets = {UNIT: target}
        yield target


def golden(name: str, report: LinksReport) -> None:
    path = GOLDEN / f"{name}.txt"
    shown = f"{block(masked(report.as_text()), '4g')}\nexit {int(report.exit)}\n"
    assert shown == path.read_text(encoding="utf-8"), f"{path}\n{shown}"


def codes(report: LinksReport) -> list[str]:
    return [f"{one['verdict']} {one['code']}" for one in report.bearers["4g"]["findings"]]


def test_healthy_vessel_passes(te4sea: Bench) -> None:
    report = te4sea.report()
    assert list(report.bearers) == ["4g", "satellite"]
    assert report.as_text().endswith("4g carries the traffic of te4sea: it is the preferred link")
    golden("te4sea-rutos", report)


def test_reading_over_a_metered_link_is_priced(te4sea: Bench) -> None:
    """The router of te4sea is declared to be reached over its satellite."""
    (cost,) = te4sea.report().as_json()["costs"].items()
    assert cost[0] == "satellite"
    assert 2_000 < cost[1]["payload_bytes"] < 30_000
    assert float(cost[1]["price"]) > 0
    assert "cost of a real run over satellite: " in te4sea.report().as_text()
    te4sea.request = te4sea.request.model_copy(update={"via": {"te4sea-router": "lan"}})
    assert te4sea.report().as_json()["costs"] == {}


SICK: dict[str, tuple[dict[str, Any], str]] = {
    "roams-and-may-not": ({"sim": {"home": HOME}, "network": {"plmn": FOREIGN}}, "FAIL roaming-not-allowed"),
    "asks-for-a-pin": ({"sim": {"pin": "1234"}}, "FAIL pin-needed"),
    "has-no-card": ({"sim": None}, "FAIL sim-missing"),
    "is-denied": ({"network": {"denies": True}}, "FAIL registration-denied"),
    "finds-no-network": ({"network": {"silent": True}}, "FAIL searching"),
}


@pytest.mark.parametrize("name", SICK)
def test_faulty_unit_is_reported(name: str, te4sea: Bench, tmp_path: Path) -> None:
    spec, code = SICK[name]
    with unit(te4sea, tmp_path, spec):
        te4sea.lose("4g")
        report = te4sea.report()
    golden(f"te4sea-{name}", report)
    assert codes(report)[0] == code
    assert report.exit is ExitCode.CHECKS_FAILED


def test_wrong_pin_is_reported_and_not_retried(te4sea: Bench, tmp_path: Path) -> None:
    root = inventory(tmp_path, {FILE: ("apn: internet # EXAMPLE\n", f"apn: internet\n    pin: {VAULTED}\n")})
    te4sea.declaration = load(root, decrypt=wrong)
    te4sea.request = te4sea.request.model_copy(update={"state": tmp_path / "state"})  # where the PIN is noted
    with unit(te4sea, tmp_path, {"sim": {"pin": "1234", "tries": 3}}) as target:
        asked = te4sea.request.model_copy(update={"targets": {UNIT: target}}).model_dump(mode="json")
        told = perform(root, [UNIT], asked, plan_only=False, decrypt=wrong)["per_host"][UNIT]
        assert told["exit"] != 0
        te4sea.lose("4g")
        first, second = te4sea.report(), te4sea.report()
    golden("te4sea-wrong-pin", first)
    assert codes(first) == codes(second) == ["FAIL pin-wrong"]
    assert first.as_json()["bearers"]["4g"]["findings"] == second.as_json()["bearers"]["4g"]["findings"]


def test_a_unit_that_cannot_be_read(te4sea: Bench) -> None:
    te4sea.away(UNIT)
    report = te4sea.report()
    golden("te4sea-unreachable", report)
    assert codes(report) == ["INCONCLUSIVE device-unreachable"]
    assert report.exit is ExitCode.CHECKS_FAILED


def test_a_modem_on_a_serial_line(te4sea: Bench, tmp_path: Path) -> None:
    te4sea.declaration = load(_declared(tmp_path, SERIAL))
    with modem.RunningModem(modem.AtModemSpec()) as started:
        te4sea.targets = {UNIT: Target(host="", port=0, pin="", serial=started.path)}
        report = te4sea.report()
        assert started.forbidden == []
    golden("te4sea-at", report)
    assert report.exit is ExitCode.DONE


@pytest.mark.parametrize(("driver", "codes_of"), [("manual", ["INCONCLUSIVE look-yourself"]), ("modemmanager", [])])
def test_drivers_without_an_emulator_are_reported(
    driver: str, codes_of: list[str], te4sea: Bench, tmp_path: Path
) -> None:
    te4sea.declaration = load(_declared(tmp_path, OTHERS.format(driver=driver)))
    te4sea.request = te4sea.request.model_copy(
        update={"targets": {name: one for name, one in te4sea.request.targets.items() if name != UNIT}}
    )
    report = te4sea.report()
    assert codes(report) == codes_of
    assert UNIT in report.not_asked
    assert report.bearers["4g"]["state"] == "up"


def _declared(folder: Path, text: str) -> Path:
    root = inventory(folder, {})
    (root / FILE).write_text(text, encoding="utf-8")
    return root


def with_modem(sick: ModemSpec) -> Callable[[EmulatorSpec], EmulatorSpec]:
    """Put another modem, card or network into the box."""

    def spoil(twin: EmulatorSpec) -> EmulatorSpec:
        return twin.model_copy(update={"router": twin.router.model_copy(update={"modem": sick})})

    return spoil


def test_forbidden_roaming_of_a_mikrotik_device_is_reported(tmp_path: Path) -> None:
    abroad = ModemSpec(sim=SimSpec(home="00101"), cell=CellSpec(plmn=FOREIGN))
    with bench(tmp_path, "coastal", BOX, spoil=with_modem(abroad)) as coastal:
        report = coastal.report(BOX)
    assert codes(report) == ["FAIL roaming-not-allowed"]
    assert report.bearers["4g"]["quality"]["registration"] == "registered_roaming"
    assert report.exit is ExitCode.CHECKS_FAILED


def test_pin_already_tried_on_a_mikrotik_device_is_reported_as_wrong(tmp_path: Path) -> None:
    with bench(tmp_path, "coastal", BOX, spoil=with_modem(ModemSpec(sim=SimSpec(pin="1234")))) as coastal:
        assert codes(coastal.report(BOX)) == ["FAIL pin-needed"]
        store = Store(coastal.request.state, is_rehearsal=True)
        TriedPin(store.root, "coastal", BOX).remember()
        assert codes(coastal.report(BOX)) == ["FAIL pin-wrong"]


def test_mikrotik_device_without_a_sim_card(tmp_path: Path) -> None:
    with bench(tmp_path, "coastal", BOX, spoil=with_modem(ModemSpec(sim=None))) as coastal:
        report = coastal.report(BOX)
    assert codes(report) == ["FAIL sim-missing"]
    assert report.round_trips[BOX] <= 6
