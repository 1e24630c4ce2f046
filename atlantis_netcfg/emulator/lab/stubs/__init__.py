"""What stands in for things that cannot be had without the internet, so that the way to them is walked all the same."""

from atlantis_netcfg.emulator.lab.stubs.archive import (
    NOT_REHEARSED,
    Archive,
    StandInFailed,
    publish,
    ros_packages,
    why_no_archive,
)
from atlantis_netcfg.emulator.lab.stubs.packages import StandIn

__all__ = ["NOT_REHEARSED", "Archive", "StandIn", "StandInFailed", "publish", "ros_packages", "why_no_archive"]
