"""What the engine and a rehearsal are told of a MikroTik LTE box, and of 4G units that are none."""

from dataclasses import replace
from pathlib import Path

import pytest

from atlantis_netcfg.core.errors import NoMatchError, UsageError
from atlantis_netcfg.core.events import ignore
from atlantis_netcfg.core.secret import Secret
from atlantis_netcfg.inventory import Host, load
from atlantis_netcfg.inventory.model import LteDriver, LteRouter, Sim
from atlantis_netcfg.operations import Request, Target
from atlantis_netcfg.operations.common.jobs import device_job
from atlantis_netcfg.operations.common.kinds import get_managed_device, is_supported
from atlantis_netcfg.operations.common.rehearsal import factory_spec, site_spec
from atlantis_netcfg.operations.common.terminals import PinRecorder, TriedPin
from atlantis_netcfg.runs import NoJournal, Store

DECLARATION = load(Path(__file__).parents[4] / "inventory")
BOX = DECLARATION.hosts["coastal-4g"]


def box(**changes: object) -> Host:
    assert isinstance(BOX.device, LteRouter)
    return replace(BOX, device=BOX.device.model_copy(update=changes))


def test_management_address_port_and_user() -> None:
    known = get_managed_device(DECLARATION, BOX)
    assert (str(known.access.address), known.access.port, known.access.user) == ("10.10.1.1", 8729, "provision")
    assert (known.place.address, known.place.port, known.place.technician) == ("10.10.1.1/29", "ether1", "10.10.1.2")
    assert known.certificates == ("atlantis-api",)


def test_custom_management_port() -> None:
    assert isinstance(BOX.device, LteRouter)
    assert BOX.device.access is not None
    assert (
        get_managed_device(DECLARATION, box(access=BOX.device.access.model_copy(update={"port": 18729}))).access.port
        == 18729
    )


@pytest.mark.parametrize("driver", [driver for driver in LteDriver if driver is not LteDriver.ROUTEROS])
def test_units_with_other_drivers_are_not_supported(driver: LteDriver) -> None:
    other = box(driver=driver)
    assert is_supported(BOX)
    assert not is_supported(other)
    with pytest.raises(NoMatchError, match="coastal-4g is a lte router"):
        get_managed_device(DECLARATION, other)


def test_emulator_has_the_declared_sim() -> None:
    sim = Sim.model_validate({"apn": "umts", "pin": "4321", "bands": [20, 31]})
    (twin,) = site_spec(DECLARATION, [box(sim=sim)]).emulators
    modem = twin.router.modem
    assert modem is not None
    assert modem.sim is not None
    assert modem.cell is not None
    assert (modem.sim.pin, modem.cell.apns, modem.cell.bands) == ("4321", ("umts",), (20, 31))
    assert {20, 31, 3} <= set(modem.bands)
    assert twin.router.ports == ("ether1",)


def test_adoption_cannot_be_rehearsed() -> None:
    with pytest.raises(
        UsageError, match="coastal-4g has only one port, and the laptop would cut its own connection"
    ) as caught:
        factory_spec(DECLARATION, BOX)
    assert caught.value.hint is not None


def test_tried_pin_is_remembered(tmp_path: Path) -> None:
    tried = TriedPin(Store(tmp_path).root, "coastal", "coastal-4g")
    request = Request(state=tmp_path)
    host = box(sim=Sim(pin=Secret("73951846")))
    job = device_job(DECLARATION, host, request, NoJournal(), ignore)
    assert job.desired_state.pin_refusal == ""
    assert isinstance(job.journal, PinRecorder)
    tried.remember()
    assert tried.path.stat().st_mode & 0o077 == 0
    assert "73951846" not in tried.path.read_text(encoding="ascii")
    assert str(tried.path) in device_job(DECLARATION, host, request, NoJournal(), ignore).desired_state.pin_refusal
    tried.forget()
    assert device_job(DECLARATION, host, request, NoJournal(), ignore).desired_state.pin_refusal == ""


def test_rehearsal_ignores_tried_pins(tmp_path: Path) -> None:
    TriedPin(Store(tmp_path, is_rehearsal=True).root, "coastal", "coastal-4g").remember()
    target = Target(host="127.0.0.1", port=1, pin="00")
    request = Request(state=tmp_path, rehearsed=True, targets={"coastal-4g": target})
    job = device_job(DECLARATION, BOX, request, NoJournal(), ignore)
    assert (job.desired_state.pin_refusal, type(job.journal)) == ("", NoJournal)


def test_unreadable_pin_record_blocks_the_pin(tmp_path: Path) -> None:
    tried = TriedPin(tmp_path, "coastal", "coastal-4g")
    tried.path.mkdir(parents=True)
    assert tried.why_not.startswith("the PIN was sent at an earlier time")
