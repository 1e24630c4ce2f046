"""Stand-ins for the packages of ROS 2: enough of them that a talker and a listener really talk, over the loopback."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from atlantis_netcfg.emulator.lab.stubs.packages import StandIn

if TYPE_CHECKING:
    from collections.abc import Iterable

__all__ = ["NOT_REHEARSED", "ros_packages"]

NOT_REHEARSED = (
    "ROS 2: packages of its names are installed that are not ROS; talker and listener talk UDP, not DDS",
    "the archive of ROS: a signed archive of stand-ins with a key of its own takes its place",
)
"""What a run against stand-ins says nothing about; the rehearsal's report prints it."""

_PROGRAMS = Path(__file__).parent / "programs"
"""They are files of packages, never modules of ours, and run on what Python a gateway has."""
_SETUP = """\
# stand-in, not ROS
export ROS_DISTRO={distribution} ROS_VERSION=2 AMENT_PREFIX_PATH={home}
PATH={home}/bin:$PATH
"""


def ros_packages(distribution: str, version: str = "0.9.2-1stand.in", more: Iterable[str] = ()) -> tuple[StandIn, ...]:
    """The packages that a gateway asks for, of a release such as foxy; `more`: names that are declared besides."""
    home = f"/opt/ros/{distribution}"
    setup = _SETUP.format(home=home, distribution=distribution)

    def program(name: str) -> str:
        text = (_PROGRAMS / f"{name}.py").read_text(encoding="utf-8")
        return "#!/usr/bin/python3\n" + text.replace("@HOME@", home)

    ros = f"ros-{distribution}"
    known = (
        StandIn(f"{ros}-ros-core", version, ("python3",), {f"{home}/bin/ros2": program("ros2")}),
        StandIn(
            f"{ros}-ros-base",
            version,
            (f"{ros}-ros-core",),
            {f"{home}/setup.sh": setup, f"{home}/setup.bash": f". {home}/setup.sh\n"},
        ),
        StandIn(
            f"{ros}-demo-nodes-cpp",
            version,
            (f"{ros}-ros-core",),
            {f"{home}/lib/demo_nodes_cpp/talker": program("talker")},
        ),
        StandIn(
            f"{ros}-demo-nodes-py",
            version,
            (f"{ros}-ros-core",),
            {f"{home}/lib/demo_nodes_py/listener": program("listener")},
        ),
        StandIn("python3-colcon-common-extensions", version, ("colcon",)),
    )
    names = {package.name for package in known}
    others = dict.fromkeys((f"{ros}-rmw-cyclonedds-cpp", *more))
    return (*known, *(StandIn(name, version) for name in others if name not in names))
