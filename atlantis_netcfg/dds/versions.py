"""What the releases of ROS 2 bring as middleware, and how the versions of it differ. A new release is a row.

Sources: `ros2.repos` on each branch of ros2/ros2 for the versions; the schemas `etc/cyclonedds.xsd` and
`fastRTPS_profiles.xsd` of each version for the elements.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["RELEASES", "Cyclone", "Release"]


@dataclass(frozen=True, slots=True)
class Cyclone:
    """A line of Cyclone DDS. It does not start on an element that it does not know: one file cannot serve all."""

    version: str
    interfaces: bool
    """`General/Interfaces` names the interface; before, `General/NetworkInterfaceAddress` did."""
    lease_in_discovery: bool
    """`LeaseDuration` stands under `Discovery`; before, under `Internal`."""
    prunes: bool
    """Gives up the address of a peer that was silent for its lease and 30 s, unless it is told not to."""


@dataclass(frozen=True, slots=True)
class Release:
    """What one release of ROS 2 runs on; `pypi` is the laptop without ROS (`pip install cyclonedds`)."""

    name: str
    cyclone: Cyclone
    fast_dds: str | None
    """Version of Fast DDS; None: there is none."""
    environment: Mapping[str, str]
    """Set so that nothing narrows the profile."""


_CYCLONE_0_7 = Cyclone("0.7", interfaces=False, lease_in_discovery=False, prunes=False)
_CYCLONE_0_10 = Cyclone("0.10", interfaces=True, lease_in_discovery=True, prunes=False)
_CYCLONE_11 = Cyclone("11", interfaces=True, lease_in_discovery=True, prunes=True)
_BEFORE_IRON = {"ROS_LOCALHOST_ONLY": "0"}
"""1 would leave 127.0.0.1 only, and silently."""
_SINCE_IRON = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT"}
"""The other ranges overrule the profile (ROS 2 manual, Improved Dynamic Discovery)."""

RELEASES: Mapping[str, Release] = {
    release.name: release
    for release in (
        Release("foxy", _CYCLONE_0_7, "2.1", _BEFORE_IRON),
        Release("humble", _CYCLONE_0_10, "2.6", _BEFORE_IRON),
        Release("jazzy", _CYCLONE_0_10, "2.14", _SINCE_IRON),
        Release("pypi", _CYCLONE_11, None, {}),
    )
}
