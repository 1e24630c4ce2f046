"""TEST_ROBOT of the joined pilot under single faults: its listener hears exactly the robots that can be heard."""

import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from atlantis_netcfg.operations.pilot_network.robot import RobotProcess, run_robots
from atlantis_netcfg.vpn import client
from campaign import pilot_acts, pilot_stand
from campaign.pilot_faults import CENTRE, GATEWAYS, Fault
from campaign.pilot_stand import PilotStand

HEARD_S = 60.0
"""A robot that speaks each second is heard again within this time after its tunnel is back."""
SILENT_S = 5.0

pytestmark = [
    pytest.mark.namespace,
    pytest.mark.campaign,
    pytest.mark.skipif(os.geteuid() != 0, reason="making a network namespace needs root"),
]


@pytest.fixture(scope="module")
def stand(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PilotStand]:
    yield from pilot_stand.module_stand(tmp_path_factory)


@contextmanager
def robots(stand: PilotStand) -> Iterator[RobotProcess]:
    """A robot at each gateway, and the listener at the control centre."""

    def place(name: str) -> tuple[str, str]:
        return stand.machine(name).namespace, str(getattr(stand.inventory.hosts[name].device, "vpn_address", ""))

    speakers = [(name, *place(name)) for name in GATEWAYS.values()]
    with run_robots(stand.inventory, speakers, place(CENTRE)) as listener:
        assert heard(listener, HEARD_S) == {*GATEWAYS.values()}
        yield listener


def heard(listener: RobotProcess, within_s: float) -> set[str]:
    return {name for name in GATEWAYS.values() if listener.wait_for(name, within_s)}


def kill_robot(name: str) -> None:
    """End the robot of a gateway, which stands in its command line."""
    for file in Path("/proc").glob("[0-9]*/cmdline"):
        words = file.read_bytes().split(b"\0") if file.exists() else []
        if b"say" in words and any(f'"host": "{name}"'.encode() in word for word in words) and b"ip" not in words:
            os.kill(int(file.parent.name), signal.SIGKILL)


CASES = [
    (Fault("coastal-client-stopped", pilot_acts.stop("coastal-gateway", client.SERVICE)), "coastal"),
    (Fault("te4sea-client-stopped", pilot_acts.stop("te4sea-gateway", client.SERVICE)), "te4sea"),
    (Fault("wifi-cut", pilot_acts.cut("coastal", "wifi-ptp"), over=("coastal", "4g")), None),
    (Fault("4g-cut", pilot_acts.cut("te4sea", "4g"), over=("te4sea", "satellite")), "te4sea"),
]
"""Each fault, and the site whose robot is not heard meanwhile: DDS is kept off the satellite."""


@pytest.mark.timeout(1500)
def test_robots_are_heard_again_after_each_fault(stand: PilotStand) -> None:
    with robots(stand) as listener:
        for fault, silent in CASES:
            others = {name for site, name in GATEWAYS.items() if site != silent}
            strike, mend = fault.pair
            strike(stand)
            if fault.over is not None:
                assert stand.wait_for(dict([fault.over]), pilot_stand.GATEWAYS, 100) is not None, fault.name
            if silent is not None:
                time.sleep(SILENT_S)  # what was on its way has arrived
                assert not listener.wait_for(GATEWAYS[silent], SILENT_S), fault.name
            assert heard(listener, HEARD_S if silent is None else SILENT_S) >= others, fault.name
            mend(stand)
            assert stand.wait_for(stand.first_links(), pilot_stand.GATEWAYS, 200) is not None, fault.name
            assert heard(listener, HEARD_S) == {*GATEWAYS.values()}, fault.name


@pytest.mark.timeout(1500)
@pytest.mark.parametrize("name", GATEWAYS.values())
def test_robot_that_stops_is_missed_alone(stand: PilotStand, name: str) -> None:
    with robots(stand) as listener:
        kill_robot(name)
        time.sleep(1)
        assert heard(listener, SILENT_S) == {*GATEWAYS.values()} - {name}


@pytest.mark.timeout(1500)
def test_listener_that_stops_hears_nobody_and_another_one_does(stand: PilotStand) -> None:
    with robots(stand) as listener:
        listener.close()
        assert heard(listener, SILENT_S) == set()
    with robots(stand):
        pass
