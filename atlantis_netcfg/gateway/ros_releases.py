"""The releases of ROS 2 and the archives that have them. A new release is a row; nothing here is fetched.

Sources, read in November 2026:
- systems and ends of life: ros2/ros2_documentation, `Releases.rst`; where a month is told, its last day stands here;
- the live archive and its key: ros-infrastructure/ros-apt-source, `ros-apt-source/debian/rules` and
  `ros-apt-source/keys/ros2-archive-keyring.gpg` (made 2019-05-30, renewed 2025-04-30, good until 2030-06-01);
- the snapshots and their key: osrf/docker_images, `ros/foxy/ubuntu/focal/ros-core/Dockerfile` and issue 697. An archive
  called `final` is there only once a release has ended;
- localhost only: ROS 2 manual, Improved Dynamic Discovery (since Iron).

Nobody has asked these archives from here: whether they still have arm64 of focal, a run on a board tells.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import date
from typing import TYPE_CHECKING

from atlantis_netcfg.declaration.model import RosDistribution, RosOrigin

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["ARCHITECTURES", "RELEASES", "Archive", "Release"]

ARCHITECTURES = ("amd64", "arm64")


@dataclass(frozen=True, slots=True)
class Archive:
    """Where packages come from, and the key that signs them."""

    url: str
    key_file: str
    """Its name below `keys` of the inventory."""
    fingerprint: str
    key_url: str
    """Where a person fetches the key."""


@dataclass(frozen=True, slots=True)
class Release:
    """A release of ROS 2 and the Ubuntu that it is made for."""

    name: str
    codename: str
    ends: date
    archives: Mapping[RosOrigin, Archive]
    alone: Mapping[str, str]
    """Keeps a process on its computer: for the test of talker and listener, and for nothing else."""


_LIVE = Archive(
    url="http://packages.ros.org/ros2/ubuntu",
    key_file="ros2-archive-keyring.gpg",
    fingerprint="C1CF6E31E6BADE8868B172B4F42ED6FBAB17C654",
    key_url="https://raw.githubusercontent.com/ros/rosdistro/master/ros.key",
)
_SNAPSHOT_KEY = "4B63CF8FDE49746E98FA01DDAD19BAB3CBF125EA"
_FINAL_FOXY = Archive(
    url="http://snapshots.ros.org/foxy/final/ubuntu",
    key_file="ros-snapshots.asc",
    fingerprint=_SNAPSHOT_KEY,
    key_url=f"https://keyserver.ubuntu.com/pks/lookup?op=get&search=0x{_SNAPSHOT_KEY}",
)
_BEFORE_IRON = {"ROS_LOCALHOST_ONLY": "1"}
_SINCE_IRON = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}

RELEASES: Mapping[RosDistribution, Release] = {
    RosDistribution(release.name): release
    for release in (
        Release(
            "foxy",
            "focal",
            date(2023, 6, 20),
            {RosOrigin.LIVE: _LIVE, RosOrigin.SNAPSHOT: _FINAL_FOXY},
            _BEFORE_IRON,
        ),
        Release("humble", "jammy", date(2027, 5, 31), {RosOrigin.LIVE: _LIVE}, _BEFORE_IRON),
        Release("jazzy", "noble", date(2029, 5, 31), {RosOrigin.LIVE: _LIVE}, _SINCE_IRON),
    )
}
