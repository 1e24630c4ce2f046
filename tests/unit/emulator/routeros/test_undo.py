"""Whatever is done can be undone exactly: content, position and id."""

from itertools import count
from pathlib import Path

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from atlantis_netcfg.emulator.routeros.answers import Caller
from atlantis_netcfg.emulator.routeros.device import Device
from atlantis_netcfg.emulator.routeros.spec import RouterSpec
from atlantis_netcfg.emulator.routeros.storage import Flash

NUMBERS = st.integers(0, 5)
RULES = "/ip/firewall/filter"


def _add(number: int) -> list[str]:
    return [f"{RULES}/add", "=chain=input", f"=comment=c{number}", f"=src-address=10.0.{number}.0/24"]


ACTIONS = st.one_of(
    NUMBERS.map(_add),
    NUMBERS.map(lambda n: [f"{RULES}/add", "=chain=forward", f"=place-before=*{n + 1:X}"]),
    NUMBERS.map(lambda n: [f"{RULES}/set", f"=.id=*{n + 1:X}", f"=log-prefix=p{n}"]),
    NUMBERS.map(lambda n: [f"{RULES}/set", f"=.id=*{n + 1:X}", "!src-address"]),
    NUMBERS.map(lambda n: [f"{RULES}/remove", f"=.id=*{n + 1:X}"]),
    st.tuples(NUMBERS, NUMBERS).map(
        lambda pair: [f"{RULES}/move", f"=numbers=*{pair[0] + 1:X}", f"=destination=*{pair[1] + 1:X}"]
    ),
    NUMBERS.map(lambda n: ["/interface/bridge/add", f"=name=b{n}"]),
    NUMBERS.map(lambda n: ["/interface/bridge/set", f"=.id=b{n}", f"=name=r{n}"]),
    NUMBERS.map(lambda n: ["/interface/bridge/remove", f"=.id=b{n}"]),
    NUMBERS.map(lambda n: ["/interface/bridge/port/add", f"=bridge=b{n}", f"=interface=ether{n + 1}"]),
    NUMBERS.map(lambda n: ["/interface/ethernet/disable", f"=.id=ether{n + 1}"]),
    NUMBERS.map(lambda n: ["/ip/address/add", f"=address=10.{n}.0.1/24", f"=interface=b{n}"]),
    NUMBERS.map(lambda n: ["/system/identity/set", f"=name=n{n}"]),
    st.just(["/ip/service/disable", "=numbers=telnet,ftp"]),
)


def _router() -> tuple[Device, Caller]:
    device = Device(
        RouterSpec(name="router", seed="/ip firewall filter\nadd chain=input\nadd chain=output\n"), lambda: 0.0
    )
    return device, device.login("provision", "", via="api-ssl", address="10.64.101.10")


def _look(device: Device, caller: Caller) -> list[list[object]]:
    menus = (RULES, "/interface/bridge", "/interface/bridge/port", "/interface/ethernet", "/ip/address", "/ip/service")
    return [list(device.run(caller, [f"{menu}/print"])) for menu in menus]


def _filled(tables: dict[str, list[object]]) -> dict[str, list[object]]:
    return {path: rows for path, rows in tables.items() if rows}


@settings(max_examples=60, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(ACTIONS, max_size=25))
def test_unroll_restores_the_router(actions: list[list[str]]) -> None:
    device, caller = _router()
    export, rows, flash = device.export(), _look(device, caller), device.snapshot()["configuration"]["tables"]
    device.run(caller, ["/safe-mode/take"])
    for action in actions:
        device.run(caller, action)
        assert _filled(device.snapshot()["configuration"]["tables"]) == _filled(flash)
    device.run(caller, ["/safe-mode/unroll"])
    assert device.export() == export
    assert _look(device, caller) == rows


@settings(max_examples=40, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(ACTIONS, max_size=20))
def test_undo_all_then_redo_all(actions: list[list[str]]) -> None:
    device, caller = _router()
    before = device.export()
    for action in actions:
        device.run(caller, action)
    after = device.export()
    count = len(device.run(caller, ["/system/history/print"])) - 1
    for _ in range(count):
        device.run(caller, ["/undo"])
    assert device.export() == before
    for _ in range(count):
        device.run(caller, ["/redo"])
    assert device.export() == after


@settings(max_examples=40, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(ACTIONS, max_size=25))
def test_an_export_goes_into_a_fresh_router(actions: list[list[str]]) -> None:
    device, caller = _router()
    for action in actions:
        device.run(caller, action)
    text = device.export(header=False)
    if "=*" in text:
        return
    adopted = 'add address=10.64.101.1/24 comment="atlantis: management" interface=ether8 \\\n    network=10.64.101.0\n'
    fresh = Device(RouterSpec(name="router", seed=text.replace(adopted, "")), lambda: 0.0)
    assert fresh.export(header=False) == text


KEPT = st.one_of(
    ACTIONS,
    NUMBERS.map(lambda n: ["/ip/firewall/address-list/add", "=list=a", f"=address=10.0.0.{n}", "=timeout=1d"]),
    st.sampled_from([["/undo"], ["/redo"], ["/safe-mode/take"], ["/safe-mode/release"], ["/safe-mode/unroll"]]),
)
FOLDERS = count()


@settings(max_examples=60, suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture])
@given(st.lists(KEPT, max_size=25))
def test_flash_matches_the_snapshot_after_every_action(tmp_path: Path, actions: list[list[str]]) -> None:
    """Line by line, and also where it is replaced."""
    device, caller = _router()
    folder = tmp_path / str(next(FOLDERS))
    flash = Flash(folder)
    for action in actions:
        device.run(caller, action)
        device.save_to(flash)
        kept, desired = Flash(folder).load(), device.snapshot()
        assert kept is not None
        for state in (kept, desired):
            state["configuration"]["tables"] = _filled(state["configuration"]["tables"])
        assert kept == desired
