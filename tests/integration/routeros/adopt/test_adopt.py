"""First contact with a router in its box: what it leaves behind, what it refuses, what it says."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from carton import ROUTER, Carton, adopted_export, carton
from hints_said import advised, said
from test_hints_of_vpn import Laptop, laptop

from atlantis_netcfg.core.errors import ExitCode, NetcfgError
from atlantis_netcfg.emulator.routeros import DeviceMode, DeviceModeName, User
from atlantis_netcfg.routeros.console.types import ConsoleLoginError, HostKeyMismatch
from atlantis_netcfg.routeros.first_contact import steps
from atlantis_netcfg.routeros.first_contact.run import CutOff, NotFactoryFresh, PreflightError, StillToMove
from atlantis_netcfg.runs import ContactStep, ContactStepDone, Outcome, PinRecord, Store

__all__ = ["laptop"]
pytestmark = pytest.mark.slow


@pytest.fixture
def box(tmp_path: Path) -> Iterator[Carton]:
    with carton(tmp_path) as opened:
        yield opened


def golden(name: str) -> str:
    return Path(__file__).with_name("golden").joinpath(f"{name}.txt").read_text()


def words(error: NetcfgError) -> str:
    """What is told, without what is another in every run."""
    return re.sub(r"SHA256:\S{43}", "…", f"{error}\n{error.hint}\n")


@pytest.mark.smoke
def test_factory_router_is_adopted(box: Carton) -> None:
    result = box.adopt()
    assert (result.status, result.exit) == ("changed", ExitCode.DONE)
    assert box.export() == adopted_export()
    store = Store(box.state, is_rehearsal=True)
    info = box.site.do(ROUTER, "info")
    assert store.pins.get(ROUTER) == info["pin"]
    assert store.pins.host_key(ROUTER) == info["host_key"]
    (run,) = store.runs("scc")
    begun = [one.step for one in run.log.records if isinstance(one, ContactStep)]
    assert begun == ["clock", "user", "certificate", "api-ssl", "management", "clear", "users"]
    assert begun == [one.step for one in run.log.records if isinstance(one, ContactStepDone)]
    assert [one.certificate for one in run.log.records if isinstance(one, PinRecord)] == [info["pin"]]
    assert [one.status for one in run.log.records if isinstance(one, Outcome)] == ["changed"]
    saved = run.before(ROUTER)
    assert saved is not None
    assert "defconf" in saved.text()


def test_the_second_run_changes_nothing(box: Carton) -> None:
    box.adopt()
    before = box.export()
    result = box.adopt()
    assert (result.status, result.exit) == ("unchanged", ExitCode.DONE)
    assert result.message == "already adopted: nothing was changed"
    assert box.export() == before
    second = Store(box.state, is_rehearsal=True).runs("scc")[1]
    assert not [one for one in second.log.records if isinstance(one, ContactStep)]


def test_plan_changes_nothing(box: Carton) -> None:
    before = box.export()
    result = box.adoption().plan()
    assert result.exit is ExitCode.CHANGES
    assert result.steps[1:3] == ("add user provision (group full)", "create certificate atlantis-api on the device")
    assert box.export() == before
    store = Store(box.state, is_rehearsal=True)
    assert store.pins.host_key(ROUTER) is None
    assert store.runs("scc") == ()
    box.adopt()
    assert box.adoption().plan().exit is ExitCode.DONE


def test_new_access_port_is_announced_before_the_old_one_is_removed(box: Carton) -> None:
    box.adopt()
    move = "now plug the laptop into ether8, with address 10.64.100.10/24: "
    told = [place for place, message in enumerate(box.told) if message.startswith(move)]
    cleared = [place for place, message in enumerate(box.told) if message.startswith("remove the default")]
    assert told < cleared


def test_without_reconnection_both_access_ports_remain(box: Carton) -> None:
    locate = box.adoption().locate
    adoption = box.adoption(wait_s=0.0)
    adoption.locate = lambda address, port: ("127.0.0.1", 1) if address == "10.64.100.1" else locate(address, port)
    with pytest.raises(StillToMove, match=r"no response from 10\.64\.100\.1") as still:
        adoption.carry_out(lambda _: None)
    assert still.value.exit is ExitCode.FAILED
    assert "plug the laptop into ether8, give it the address 10.64.100.10/24" in str(still.value.hint)
    assert box.adopt().status == "changed"
    assert box.export() == adopted_export()
    assert [one.outcomes[ROUTER].status for one in Store(box.state, is_rehearsal=True).runs("scc")] == [
        "half-adopted",
        "changed",
    ]


def test_configured_router_is_not_touched(tmp_path: Path) -> None:
    seed = "/system identity set name=boat\n/ip firewall filter add action=drop chain=forward\n"
    with carton(tmp_path, seed=seed) as box:
        before = box.export()
        with pytest.raises(NotFactoryFresh) as refused:
            box.adopt()
        assert refused.value.exit is ExitCode.FAILED
        assert words(refused.value) == golden("not-factory-fresh")
        assert box.export() == before
        assert Store(box.state, is_rehearsal=True).pins.host_key(ROUTER) is None


def test_configured_router_is_taken_over_on_request(tmp_path: Path) -> None:
    rule = "/ip firewall filter add action=drop chain=input src-address=10.64.0.0/16\n"
    seed = f"{rule}/ip pool add name=boat ranges=10.1.0.2\n"
    users = (User(name="admin"), User(name="boss", password="b", group="full"))
    with carton(tmp_path, seed=seed, users=users) as box:
        assert box.adopt(take_over=True).status == "changed"
        assert box.export() == adopted_export()
        (run,) = Store(box.state, is_rehearsal=True).runs("scc")
        saved = run.before(ROUTER)
        assert saved is not None
        assert "name=boat" in saved.text()
        assert box.adopt().status == "unchanged"


def test_wrong_password_changes_nothing(tmp_path: Path) -> None:
    with carton(tmp_path, users=(User(name="admin", password="sticker"),)) as box:
        before = box.export()
        with pytest.raises(ConsoleLoginError) as failed:
            box.adopt()
        assert words(failed.value) == golden("wrong-password")
        assert box.export() == before
        assert box.adopt(passwords=("", "sticker")).status == "changed"


def test_another_host_key_is_refused(box: Carton) -> None:
    box.adopt()
    box.site.do(ROUTER, "rekey")
    with pytest.raises(HostKeyMismatch) as changed:
        box.adopt()
    assert words(changed.value) == golden("changed-host-key")
    pins, info = Store(box.state, is_rehearsal=True).pins, box.site.do(ROUTER, "info")
    with pytest.raises(ConsoleLoginError, match="so the password of provision was not tried"):
        box.adopt(is_replacement=True)  # it is no box from the factory, and nobody has agreed to this key
    pins.change(ROUTER, info["pin"])  # as `provision device trust` does
    pins.change_host_key(ROUTER, info["host_key"])
    assert box.adopt().status == "unchanged"
    assert pins.host_key(ROUTER) == info["host_key"]


def test_router_adopted_elsewhere_gets_no_password_before_it_is_pinned(box: Carton) -> None:
    """It has to be agreed to first: by what the inventory declares, or by `provision device trust`."""
    box.adopt()
    pins, info = Store(box.state, is_rehearsal=True).pins, box.site.do(ROUTER, "info")
    pins.change(ROUTER, None)
    pins.change_host_key(ROUTER, None)
    for looking in (box.adoption().plan, box.adopt):
        with pytest.raises(ConsoleLoginError, match="so the password of provision was not tried") as refused:
            looking()
        assert "provision device trust" in str(refused.value.hint)
    assert (pins.get(ROUTER), pins.host_key(ROUTER)) == (None, None)
    pins.change(ROUTER, info["pin"])
    assert box.adopt().status == "unchanged"


def test_a_laptop_on_the_management_port_is_told_to_move(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(steps, "PORT_S", 1.0)
    laptop = {"address": "192.168.88.1/24", "port": "ether8", "technician": "192.168.88.10"}
    with carton(tmp_path, first_contact=laptop) as box:
        with pytest.raises(CutOff, match="connection lost at: management address") as cut:
            box.adopt()
        assert "if the laptop is plugged into ether8, use another port" in str(cut.value.hint)
        while "interface=ether8" not in box.export():
            pass


@pytest.mark.parametrize("version", ["6.49.18", "7.12.2", "7.16", "7.17.1", "7.21.5"])
def test_every_version_is_adopted(tmp_path: Path, version: str) -> None:
    with carton(tmp_path, version=version) as box:
        assert box.adopt().status == "changed"
        assert "defconf" not in box.export()
        assert box.adopt().status == "unchanged"


def test_flagged_router_is_refused(tmp_path: Path) -> None:
    with carton(tmp_path, device_mode=DeviceMode(mode=DeviceModeName.HOME, is_flagged=True)) as box:
        before = box.export()
        with pytest.raises(PreflightError, match="device-mode has flagged this router"):
            box.adopt()
        assert box.export() == before


def test_router_is_adopted_over_its_serial_line(tmp_path: Path) -> None:
    with carton(tmp_path, serial=True) as box:
        result = box.adopt()
        assert result.status == "changed"
        assert box.export() == adopted_export()
        store = Store(box.state, is_rehearsal=True)
        assert store.pins.get(ROUTER) == box.site.do(ROUTER, "info")["pin"]
        assert store.pins.host_key(ROUTER) == box.site.do(ROUTER, "info")["host_key"]
        assert box.adopt().status == "unchanged"


def test_unverifiable_steps_over_the_serial_line_are_reported(tmp_path: Path, laptop: Laptop) -> None:
    hint = (
        "not verified, because the laptop is on the serial line: that {} responds on {}; plug into {} with "
        "address {}, and `provision site=…` verifies it"
    )
    with carton(tmp_path / "box", serial=True) as box:
        adoption = box.adoption()
        adoption.locate = lambda _address, _port: ("127.0.0.1", 1)
        result = adoption.carry_out(lambda _: None)
        assert result.status == "changed"
        (note,) = (note for note in result.notes if note.startswith("not verified"))
        assert "plug into ether8 with address 10.64.100.10/24" in note
        (words,) = advised(said(note, hint))
        laptop.type(*words)
        assert ROUTER in laptop.plays[0][0]
        pins = Store(box.state, is_rehearsal=True).pins
        assert pins.host_key(ROUTER) is None
        assert box.adopt(via="ssh").status == "unchanged"
        assert pins.host_key(ROUTER) == box.site.do(ROUTER, "info")["host_key"]


def test_router_reset_without_defaults_is_adopted_over_serial(tmp_path: Path) -> None:
    """No address is left on it: only the serial line leads in."""
    with carton(tmp_path, serial=True, factory=False, users=(User(name="admin"),), certificates=()) as box:
        assert box.adopt().status == "changed"
        assert box.export() == adopted_export()
