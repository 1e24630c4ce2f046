"""Stubs for things that need the internet, so that their installation can be rehearsed."""

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
