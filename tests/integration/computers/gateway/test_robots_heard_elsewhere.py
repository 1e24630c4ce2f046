"""Robots that a control centre hears, asked by a real sshd: what it has, what is left there, and a link that is cut.

Mock robots speak in the network of that computer; cyclonedds lies there as `pip` would install it.
"""

import io
import subprocess
import sys
import tarfile
import threading
import time
from dataclasses import replace
from importlib.util import find_spec
from ipaddress import IPv4Address
from pathlib import Path

import pytest
from gateway_stand import NETWORK, ROUTER, SHIPPED, Key, Start, ground, machine, technician  # noqa: F401 - fixtures
from waiting import wait_until

from atlantis_netcfg.emulator.lab import Lab, Machine
from atlantis_netcfg.inventory.model import DdsPath
from atlantis_netcfg.inventory.robots.reading import load_robots
from atlantis_netcfg.operations.common.request import Request, Target
from atlantis_netcfg.operations.robots.remote import VENV, ListenError, listen_there
from atlantis_netcfg.robots.observation import judge

if find_spec("cyclonedds") is None:
    pytest.skip("PyPI has no cyclonedds for this machine", allow_module_level=True)
pytestmark = [pytest.mark.namespace, pytest.mark.slow]
CENTRE, ADDRESS = "scc-control", f"{NETWORK}10"
_DDS = SHIPPED.pilot.dds
assert _DDS is not None
OVER_LAN = _DDS.model_copy(update={"over": DdsPath.LAN})
_THERE = SHIPPED.hosts[CENTRE]
DECLARED = replace(
    SHIPPED,
    pilot=SHIPPED.pilot.model_copy(update={"dds": OVER_LAN}),
    hosts={
        **SHIPPED.hosts,
        CENTRE: replace(_THERE, device=_THERE.device.model_copy(update={"address": IPv4Address(ADDRESS)})),
    },
)
"""The control centre has an address of the stand; mock robots look for the gateway there, which is not in it."""
ROBOTS = Path(__file__).parents[2] / "robots" / "robots_there.py"


def packages() -> str:
    """The folders of PyPI's package, for a Python like this one."""
    spec = find_spec("cyclonedds")
    assert spec is not None
    assert spec.origin is not None
    return str(Path(spec.origin).parents[1])


def install(centre: Machine) -> None:
    """Lay cyclonedds down as the hint says, without an archive to fetch it from."""
    site, there = Path(packages()), f"{VENV}/lib/python3.{sys.version_info.minor}/site-packages"
    centre.run(f"python3 -m venv --without-pip {VENV} && mkdir -p {there}")
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w") as archive:
        for path in site.glob("cyclonedds*"):
            archive.add(path, path.name)
    centre.put_bytes("/root/cyclonedds.tar", buffer.getvalue())
    centre.run(f"tar -C {there} -xf /root/cyclonedds.tar && rm /root/cyclonedds.tar")


def test_control_centre_listens_for_robots(
    ground: Lab,  # noqa: F811 - fixtures
    machine: Start,  # noqa: F811
    technician: Key,  # noqa: F811
    tmp_path: Path,
) -> None:
    centre = machine(CENTRE, address=f"{ADDRESS}/24")
    (tmp_path / "known").write_text(f"{CENTRE} {centre.host_key}\n")
    target = Target(
        host="127.0.0.1", port=centre.port, known_hosts=str(tmp_path / "known"), identity=str(technician.file)
    )
    request = Request(state=tmp_path / "state", rehearsed=True, targets={CENTRE: target})
    host = DECLARED.hosts[CENTRE]
    with pytest.raises(ListenError, match=f"{CENTRE} cannot listen for robots: it has neither cyclonedds nor ROS 2"):
        listen_there(DECLARED, host, 5, request=request)
    install(centre)
    robots = subprocess.Popen([*ground.prefix(), sys.executable, "-P", str(ROBOTS), ROUTER, "40"])
    try:
        _hear(centre, request)
        _cut(centre, request)
    finally:
        robots.kill()
        robots.wait()


def _hear(centre: Machine, request: Request) -> None:
    before = centre.run("find / -xdev -type f -newer /etc/hostname | sort").stdout
    observation = listen_there(DECLARED, DECLARED.hosts[CENTRE], 8, sites=["coastal"], request=request)
    sources, names = load_robots(DECLARED)
    expected = [each.vehicle for each in sources if each.vehicle is not None]
    reports = judge(observation, sources, expected, names)
    assert {each.vehicle: (each.state.value, each.findings) for each in reports} == dict.fromkeys(
        expected, ("declared", ())
    )
    assert observation.program == "cyclonedds"
    after = centre.run("find / -xdev -type f -newer /etc/hostname | sort").stdout
    made = {*after.splitlines()} - {*before.splitlines()}
    assert [name for name in made if not name.startswith(("/var/log/", "/run/", "/proc/", "/sys/"))] == []
    assert centre.run("journalctl --no-pager | grep -c EXAMPLE-sparus-token", check=False).stdout == "0\n"


def _cut(centre: Machine, request: Request) -> None:
    """The connection ends while it listens: that is no observation, and nobody listens on there."""
    outcome: list[object] = []

    def listen() -> None:
        try:
            outcome.append(listen_there(DECLARED, DECLARED.hosts[CENTRE], 600, request=request))
        except ListenError as error:
            outcome.append(error)

    thread = threading.Thread(target=listen)
    thread.start()
    wait_until(lambda: centre.run("pgrep -f '[z]lib.decompress'", check=False).returncode == 0)
    time.sleep(1)  # its first line is under way
    centre.run("pkill -KILL -f '[s]shd: root@notty'")
    thread.join()
    (error,) = outcome
    assert isinstance(error, ListenError)
    assert f"the connection to {CENTRE} was lost before the listening time ended:" in str(error)
    wait_until(lambda: centre.run("pgrep -f '[z]lib.decompress'", check=False).returncode)
