"""The record of coastal, read from twins: one session a device, differences, and devices that do not answer."""

import asyncio
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from links_bench import PATIENCE_S, Bench, bench
from waiting import HANG_S

from atlantis_netcfg.core.errors import ExitCode
from atlantis_netcfg.core.events import ignore
from atlantis_netcfg.inventory import choose
from atlantis_netcfg.inventory.model import NumberMask
from atlantis_netcfg.records.asbuilt.collect import SiteLook
from atlantis_netcfg.records.asbuilt.record import AsBuiltRecord, CableState, DeviceRecord, Origin, ReadState, compare
from atlantis_netcfg.runs import utc_now

pytestmark = pytest.mark.slow

ROUTER, NEAR, UNIT, TERMINAL, GATEWAY = "coastal-router", "coastal-cpe", "coastal-4g", "coastal-sat", "coastal-gateway"
MAC = "02:00:5E:00:01:23"
PROVISION = str(Path(sys.executable).with_name("provision"))


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bench]:
    with bench(tmp_path_factory.mktemp("coastal"), "coastal") as opened:
        yield opened


@pytest.fixture
def coastal(running: Bench) -> Iterator[Bench]:
    yield running
    running.heal()
    running.do(ROUTER, "around", plugged={}, cards={})


def looked(coastal: Bench, *only: str, name: str = "1") -> tuple[AsBuiltRecord, SiteLook]:
    request = coastal.request.model_copy(update={"targets": coastal.request.targets | coastal.targets})
    site = SiteLook(coastal.declaration, "coastal", request, ignore, {GATEWAY: "EXAMPLE reason"}, PATIENCE_S)
    devices = asyncio.run(site.devices(choose(coastal.declaration, "coastal", only)))
    made = AsBuiltRecord(
        id=name, site="coastal", title="Coastal testbed", at=utc_now(), tool="0", inventory="", rehearsed=True,
        mask=NumberMask.LAST4, devices=devices, spent=site.usage,
    )  # fmt: skip
    return made, site


def device(record: AsBuiltRecord, name: str) -> DeviceRecord:
    found = record.device(name)
    assert found is not None
    return found


def test_every_device_is_recorded_with_its_state(coastal: Bench) -> None:
    record, _ = looked(coastal)
    assert {item.name: item.state for item in record.devices} == {
        ROUTER: ReadState.READ,
        NEAR: ReadState.READ,
        UNIT: ReadState.READ,
        TERMINAL: ReadState.BY_HAND,
        GATEWAY: ReadState.NOT_REHEARSED,
    }
    assert record.exit is ExitCode.DONE
    serials = [device(record, name).facts["serial"].value for name in (ROUTER, NEAR, UNIT)]
    assert len(set(serials)) == 3
    assert device(record, GATEWAY).why == "EXAMPLE reason"
    assert device(record, TERMINAL).facts["serial"].origin is Origin.NOT_READ
    assert device(record, UNIT).facts["imei"].value == "***********0000"
    assert device(record, ROUTER).facts["certificate"].value == coastal.request.targets[ROUTER].pin


def test_device_is_read_in_one_session_of_five_round_trips(coastal: Bench) -> None:
    _, site = looked(coastal)
    assert set(site.sessions) == {ROUTER, NEAR, UNIT}
    assert {name: spent.round_trips for name, spent in site.usage.items()} == dict.fromkeys(site.sessions, 5)
    assert {name: session.connections for name, session in site.sessions.items()} == dict.fromkeys(site.sessions, 1)
    assert max(spent.bytes for spent in site.usage.values()) < 9_000


def test_cost_of_reading_is_reported(coastal: Bench) -> None:
    made = coastal.request.model_copy(update={"via": {ROUTER: "satellite"}})
    site = SiteLook(coastal.declaration, "coastal", made, ignore, {}, PATIENCE_S)
    asyncio.run(site.devices(choose(coastal.declaration, "coastal", (ROUTER,))))
    (name, words), *others = site.costs(1.0).items()
    assert (name, others) == ("satellite", [])
    assert "EUR" in words


def test_nothing_is_changed_on_a_device(coastal: Bench) -> None:
    def exports() -> list[str]:
        text = [str(coastal.do(name, "export")) for name in (ROUTER, NEAR, UNIT)]
        return [line for each in text for line in each.splitlines() if not line.startswith("#")]

    before = exports()
    looked(coastal)
    assert exports() == before


def test_new_device_on_a_port_is_a_difference(coastal: Bench) -> None:
    before, _ = looked(coastal, name="1")
    coastal.do(ROUTER, "around", plugged={"ether4": [MAC]})
    now, _ = looked(coastal, name="2")
    told = [change.words for change in compare(now, before).changes]
    # The inventory has a reservation for this card.
    assert told == [f"{ROUTER}: port ether4 now has {MAC} (zarco)"]
    assert compare(looked(coastal, name="3")[0], now).changes == ()


def test_a_port_without_a_link_is_a_difference(coastal: Bench) -> None:
    before, _ = looked(coastal, name="1")
    coastal.types(ROUTER, "/interface/ethernet/disable", "=numbers=ether5")
    now, _ = looked(coastal, name="2")
    coastal.types(ROUTER, "/interface/ethernet/enable", "=numbers=ether5")
    assert [change.words for change in compare(now, before).changes] == [
        f"{ROUTER}: link of port ether5 changed from up to down"
    ]
    assert next(port.link for port in device(now, ROUTER).ports if port.name == "ether5") is CableState.DOWN


def test_unreachable_device_is_not_green_and_keeps_its_last_facts(coastal: Bench) -> None:
    before, _ = looked(coastal, name="1")
    coastal.away(NEAR)
    record = compare(looked(coastal, name="2")[0], before)
    near = device(record, NEAR)
    assert (near.state, record.exit) == (ReadState.NOT_REACHED, ExitCode.CHECKS_FAILED)
    assert near.facts["serial"].origin is Origin.STORED
    assert near.read_at == device(before, NEAR).read_at
    assert {fact.origin for fact in near.facts.values()} <= {Origin.STORED, Origin.DECLARED, Origin.NOT_READ}
    assert near.why
    assert record.changes == ()


def test_device_with_another_certificate_is_not_read(coastal: Bench) -> None:
    """Another certificate than the pinned one: the password is not sent, and no value of it stands in the record."""
    target = coastal.request.targets[NEAR].model_copy(update={"pin": "0" * 64})
    coastal.targets = {NEAR: target}
    near = device(looked(coastal)[0], NEAR)
    assert near.state is ReadState.NOT_REACHED
    assert "certificate" in near.why
    assert near.read_at is None


def test_selection_without_readable_devices_is_not_green(coastal: Bench) -> None:
    record, site = looked(coastal, TERMINAL)
    assert (record.exit, site.usage) == (ExitCode.NOTHING, {})
    assert device(record, ROUTER).state is ReadState.LEFT_OUT


def provision(state: Path, *words: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "ATLANTIS_STATE": str(state)}
    command = [PROVISION, "report", "as-built", "site=coastal", f"device={ROUTER}", "--rehearse", *words]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=HANG_S, check=False)


def test_record_is_saved_compared_and_printed_with_labels(tmp_path: Path) -> None:
    first = provision(tmp_path, "--json", "--labels")
    assert first.returncode == 0, first.stderr
    told = json.loads(first.stdout)
    assert (told["exit"], told["errors"], told["since"], told["rehearsed"]) == (0, [], None, True)
    kept = Path(told["kept"])
    names = ["as-built.html", "as-built.json", "as-built.pdf", "labels.pdf"]
    assert sorted(path.name for path in kept.iterdir()) == names
    assert kept.is_relative_to(tmp_path / "rehearsal" / "coastal" / "asbuilt")
    second = provision(tmp_path)
    assert second.returncode == 0, second.stderr
    assert f"No differences from record {told['id']} in what was read." in second.stdout
    assert second.stdout.splitlines()[-1] == "1 of 5 devices were read, 4 were excluded"
