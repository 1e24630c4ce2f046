"""What stands in for things that cannot be had without the internet, so that the way to them is walked all the same."""

from atlantis_netcfg.emulator.lab.stubs.archive import (
    NOT_REHEARSED,
    StubArchive,
    StubError,
    StubPackage,
    publish,
    ros_packages,
    service_program,
    why_no_archive,
)
from atlantis_netcfg.emulator.lab.stubs.image import PODMAN_IN_A_MACHINE, service_image

__all__ = [
    "NOT_REHEARSED",
    "PODMAN_IN_A_MACHINE",
    "StubArchive",
    "StubError",
    "StubPackage",
    "publish",
    "ros_packages",
    "service_image",
    "service_program",
    "why_no_archive",
]
