"""From the file that a robot's owner receives to a participant that the control centre sees: three commands.

They are those of the robot's page, typed as they stand there. OpenVPN, Cyclone DDS 0.10 and Fast DDS 2.9 are real;
Debian's versions of the two stand for Humble's. What a namespace cannot show stands in `robot_computer.py`: nothing
here was started by systemd.
"""

import subprocess
import threading
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from matrix_papers import guest, host
from matrix_stand import CENTRE, Vpn, vpn
from robot_computer import Robot, three_commands
from waiting import HANG_S

from atlantis_netcfg.computers.dds import profile_views, profiles
from atlantis_netcfg.inventory import Inventory, load
from atlantis_netcfg.inventory.model import RosDistribution
from atlantis_netcfg.vpn.enrolment_package import EnrolmentPackage, OneTimePassphrase, build_package, contents
from atlantis_netcfg.vpn.enrolment_package.profile import read_identity
from atlantis_netcfg.vpn.identity import Identity, MemberKind

pytestmark = [pytest.mark.namespace, pytest.mark.slow]
SHIPPED = Path(__file__).parents[4] / "inventory"
PROGRAMS = Path(__file__).parents[2] / "computers" / "dds" / "programs"
ROBOT, CONTACT = "iqua-sparus", "Example Person, +00 000"


def declared() -> Inventory:
    """The shipped pilot, in which `sparus` has Humble."""
    shipped = load(SHIPPED)
    sparus = shipped.vehicles["sparus"].model_copy(update={"distribution": RosDistribution.HUMBLE})
    return replace(shipped, vehicles={**shipped.vehicles, "sparus": sparus})


@dataclass(frozen=True)
class Peer:
    """A participant's program, and the file and the variable of its profile."""

    program: Path
    file: str
    variable: str
    scheme: str = ""


@pytest.fixture(scope="module")
def peers(tmp_path_factory: pytest.TempPathFactory) -> tuple[Peer, Peer]:
    """The participants, built from their sources."""
    built = tmp_path_factory.mktemp("peers")
    for command in (
        ["idlc", "-l", "c", "-x", "final", "-o", str(built), str(PROGRAMS / "proof.idl")],
        ["gcc", f"-I{built}", "-o", f"{built}/cyclone", f"{PROGRAMS}/cyclone_peer.c", f"{built}/proof.c", "-lddsc"],
        ["g++", "-o", f"{built}/fast", f"{PROGRAMS}/fast_peer.cpp", "-lfastrtps", "-lfastcdr"],
    ):
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    return (
        Peer(built / "cyclone", "cyclonedds.xml", "CYCLONEDDS_URI", "file://"),
        Peer(built / "fast", "fastdds.xml", "FASTRTPS_DEFAULT_PROFILES_FILE"),
    )


def received(made: Vpn, robot: Robot) -> tuple[EnrolmentPackage, list[str]]:
    """The file lies in the robot's home folder; and what its page says."""
    identity = issued(made)
    sent = build_package(made.declaration, identity, OneTimePassphrase(), contact=CONTACT)
    (robot.home / sent.file_name).write_bytes(sent.data)
    page = contents(made.declaration, identity, contact=CONTACT)["README.txt"]
    commands = three_commands(page)
    note = [line.strip() for line in sent.cover_note.splitlines() if line.startswith("    ")]
    assert note == commands[:2], "the note says the same as the page"
    return sent, commands


def issued(made: Vpn) -> Identity:
    return read_identity((made.folder / f"{ROBOT}.ovpn").read_text(encoding="utf-8"))


def heard(process: subprocess.Popen[str], said: str) -> threading.Event:
    """Set when a participant has said it."""
    event = threading.Event()

    def listen() -> None:
        assert process.stdout is not None
        with process.stdout:
            for line in process.stdout:
                if said in line:
                    event.set()

    threading.Thread(target=listen, daemon=True).start()
    return event


def test_three_commands_bring_a_robot_to_the_control_centre(tmp_path: Path, peers: tuple[Peer, Peer]) -> None:
    declaration = declared()
    wishes = [host(declaration, CENTRE), guest(declaration, "iqua", "sparus", MemberKind.ROBOT, "sparus")]
    with vpn(declaration, wishes, tmp_path / "stand") as made:
        robot = Robot(made, ROBOT, tmp_path / "robot")
        sent, commands = received(made, robot)
        assert len(commands) == 3
        opened, install, run = commands
        assert sent.passphrase is not None
        code, seen = robot.type(opened, answer=sent.passphrase.reveal())
        assert code == 0, seen
        code, seen = robot.type(install)
        assert (code, seen.splitlines()[-1]) == (0, f"{ROBOT} is in the VPN: 10.80.0.1 responds through the tunnel"), (
            seen
        )
        assert run.endswith(" YOUR_PROGRAM")
        for peer in peers:
            _meet(made, robot, run, peer)
            assert len(robot.typed) == 3 + peers.index(peer), "each program is one more"
        assert made.counter("p_spoofed") == 0
        _again(robot, install)


def _without_a_tunnel(robot: Robot, install: str) -> None:
    """Where nothing answers, it does not say that the robot is in the VPN."""
    robot.end()
    robot.program("systemctl", "#!/bin/sh\nexit 0\n")
    code, seen = robot.type(install)
    assert (code, "10.80.0.1 does not respond through the tunnel" in seen, "is in the VPN" in seen) == (5, True, False)


def _meet(made: Vpn, robot: Robot, run: str, peer: Peer) -> None:
    """The robot's program and one at the control centre's place, with the profile of `provision robot dds`."""
    view = profile_views(made.declaration, made.declaration.hosts[CENTRE], "humble")[0]
    file = made.folder / peer.file
    file.write_text(profiles(view)[f"{view.link}/{peer.file}"], encoding="utf-8")
    environment = {peer.variable: f"{peer.scheme}{file}"}
    centre = made.start(CENTRE, str(peer.program), "centre", "0", environment=environment)
    program = robot.start(run.replace("YOUR_PROGRAM", f"exec {peer.program} robot 0"))
    seen, mutual = heard(centre, " got robot "), heard(program, " got centre ")
    assert seen.wait(HANG_S), f"the control centre has not seen the robot: {peer.file}"
    assert mutual.wait(HANG_S), f"the robot has not seen the control centre: {peer.file}"
    for process in (centre, program):
        process.kill()
        process.wait()


def _again(robot: Robot, install: str) -> None:
    """The same again changes nothing, and the tunnel goes on; an older OpenVPN is refused before a file is written."""
    tunnel = (robot.state / "pid").read_text()
    code, seen = robot.type(install)
    assert (code, "unchanged" in seen, "written" in seen) == (0, True, False), seen
    assert (robot.state / "pid").read_text() == tunnel
    modes = "stat -c '%a %n' /etc/openvpn/client/*.conf /etc/atlantis/dds/*"
    assert robot.type(modes)[1].split()[::2] == ["600", "644", "644", "644", "644"]
    _without_a_tunnel(robot, install)
    robot.program("openvpn", "#!/bin/sh\necho 'OpenVPN 2.4.12 x86_64-pc-linux-gnu'\n")
    robot.type(f"rm {robot.home}/*/restart.conf; rm -r /etc/atlantis")
    code, seen = robot.type(install)
    assert (code, "OpenVPN 2.4 cannot read this profile" in seen) == (3, True), seen
    assert robot.type("ls /etc/atlantis")[0] != 0
