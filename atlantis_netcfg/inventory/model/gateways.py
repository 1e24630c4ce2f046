"""What every gateway computer of the pilot runs. `group_vars/all/pilot.yml`, key `gateways`."""

from __future__ import annotations

import re
from enum import StrEnum
from typing import Annotated
from urllib.parse import urlsplit

from pydantic import BeforeValidator, Field, StrictInt

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory.model import _base


def _package(value: object) -> str:
    text = _base.plain(value)
    if not re.fullmatch(r"[a-z0-9][a-z0-9+.-]+", text):
        raise _base.wrong(
            msg(f"`{arg(text)}` is not a package name"), "use lower-case letters, digits, + - . (Debian Policy 5.6.1)"
        )
    return text


def _version(value: object) -> str:
    text = _base.plain(value)
    if not re.fullmatch(r"[0-9][A-Za-z0-9.+~:-]*\*?", text):
        raise _base.wrong(
            msg(f"`{arg(text)}` is not a package version"), 'write it in quotes, as apt prints it: "0.9.2-1*"'
        )
    return text


def _revision(value: object) -> str:
    text = _base.plain(value)
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._/-]{0,99}", text) or ".." in text or text.endswith((".lock", "/")):
        raise _base.wrong(msg(f"`{arg(text)}` is not a revision"), "use a tag, or a commit of 40 hex digits")
    return text


def _url(value: object) -> str:
    text = _base.plain(value)
    parts = urlsplit(text)
    like = "example of an address: https://gitlab.example.org/group/project.git"
    if parts.scheme not in ("https", "http") or not parts.hostname or not re.fullmatch(r"[!-~]+", text):
        raise _base.wrong(msg(f"`{arg(text)}` is not the address of a server"), like)
    if parts.username is not None or parts.password is not None:
        raise _base.wrong("this address contains a name or password", "remove it; a token has its own key: `token:`")
    return text


def _inside(value: object) -> str:
    text = _base.plain(value)
    if not re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9._/-]*", text) or ".." in text:
        raise _base.wrong(
            msg(f"`{arg(text)}` is not a path inside the build"), "example of a path: config/robot-config.yml"
        )
    return text


PackageName = Annotated[str, BeforeValidator(_package), _base.text_like("^[a-z0-9][a-z0-9+.-]+$")]
PackageVersion = Annotated[str, BeforeValidator(_version), _base.text_like(r"^[0-9][A-Za-z0-9.+~:-]*\*?$")]
"""As apt takes it after `=`; a `*` at its end stands for the rest."""
Revision = Annotated[str, BeforeValidator(_revision), _base.text_like("^[A-Za-z0-9][A-Za-z0-9._/-]{0,99}$")]
Url = Annotated[str, BeforeValidator(_url), _base.text_like("^https?://[^/@ ]+(/[!-~]*)?$")]
Inside = Annotated[str, BeforeValidator(_inside), _base.text_like("^[A-Za-z0-9_][A-Za-z0-9._/-]*$")]


class RosOrigin(StrEnum):
    """Which archive ROS 2 comes from."""

    LIVE = "live"
    """The archive of the day: releases that are still maintained."""
    SNAPSHOT = "snapshot"
    """The frozen archive of a release that has ended."""


class Pin(_base.Model):
    """A package and the version of it that is installed and kept."""

    package: PackageName
    """Its name in the archive."""
    version: PackageVersion
    """The version that is installed and kept."""


class Ros2(_base.Model):
    """ROS 2 on the gateways; its release stands in `dds.distribution`."""

    origin: RosOrigin
    """Which archive the packages come from."""
    mirror: Url | None = None
    """In place of the archive's own address."""
    ros1_mirror: Url | None = None
    """The same for the archive of ROS 1, from which a computer with `ros1_bridge` beside foxy has its half of it."""
    key_file: _base.Text | None = None
    """Below `keys` of the inventory: the key that signs the archive, where the shipped one does not."""
    packages: tuple[PackageName, ...] = ()
    """Besides ros-base, colcon and the demo nodes."""
    pins: tuple[Pin, ...] = ()
    """A package without one takes what the archive has."""


class Repository(_base.Model):
    """A git repository, at one revision."""

    url: Url
    """Where git fetches it, without user and password."""
    revision: Revision
    """A commit of 40 hex digits, or a tag."""
    token: _base.SecretText | None = None
    """Reads the repository and its submodules on the same server; None: everyone may read it."""


class ConnectionTest(_base.Model):
    """The robot that the report starts by hand when a gateway has been set up (4.6.2)."""

    program: Inside
    """Below the build of the examples."""
    config: Inside
    """Below the examples' sources."""


class InteropService(_base.Model):
    """The data gateway as a service of the computer."""

    command: _base.Text
    """With its arguments; the partner names it. Its folder is that of the current build."""
    memory_mb: Annotated[StrictInt, Field(ge=64)] = 1024
    """It is ended and started anew when it takes more."""
    cpu_percent: Annotated[StrictInt, Field(ge=10, le=800)] = 200
    """100 is one core."""


class Interop(_base.Model):
    """The UV-Interoperability library, its examples, and what runs of them."""

    library: Repository
    """The UV-Interoperability library."""
    examples: Repository | None = None
    """Its examples; the connection test is one of them. None: they are not built."""
    packages: tuple[PackageName, ...] = ("libyaml-cpp-dev", "build-essential")
    """What building them needs; the report's two."""
    connection_test: ConnectionTest | None = None
    """None: nothing is started after a build."""
    service: InteropService | None = None
    """None: the library is built, and nothing of it is started at boot."""


class Gateways(_base.Model):
    """What every gateway computer runs."""

    ros2: Ros2 | None = None
    """None: no ROS 2 is installed."""
    interop: Interop | None = None
    """None: no library is built."""
