"""Workloads on a computer for partners and ROS: services with ports, programs, containers, recordings.

`host_vars/<host>.yml`, key `device`.
"""

from __future__ import annotations

import re
from enum import StrEnum
from ipaddress import IPv4Address
from typing import Annotated

from pydantic import BeforeValidator, Field, StrictInt

from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.inventory.model import _base


def _command(value: object) -> str:
    text = _base.plain(value)
    if not re.fullmatch(r"/[!-~]+( +[!-~]+)*", text) or any(sign in text for sign in "%$\\'\"`"):
        raise _base.wrong(
            msg(f"`{arg(text)}` is not a command"),
            "write the full path of the program and its arguments, for example /opt/backend/run --port 8443",
        )
    return text


def matching(pattern: str, what: str, hint: str) -> BeforeValidator:
    """Build a validator for texts that match a pattern; `what` says of another text what is wrong with it."""

    def validate(value: object) -> str:
        text = _base.plain(value)
        if ".." in text or not re.fullmatch(pattern.strip("^$"), text):
            raise _base.wrong(msg(f"`{arg(text)}` {arg(what)}"), hint)
        return text

    return BeforeValidator(validate)


def _master(value: object) -> str:
    text = _base.plain(value)
    match = re.fullmatch(r"http://([0-9.]+):[0-9]{1,5}/?", text)
    try:
        IPv4Address(match[1] if match else "")
    except ValueError:
        raise _base.wrong(
            msg(f"`{arg(text)}` is not a ROS 1 master"),
            "write its address and port, for example http://192.0.2.10:11311",
        ) from None
    return text.rstrip("/")


_ARCHIVE = "^[A-Za-z0-9][A-Za-z0-9._-]{0,99}$"
_INSIDE = "^/(data|home|mnt|opt|srv|var)(/[A-Za-z0-9_][A-Za-z0-9._-]*)*$"
_VARIABLE = "^[A-Z_][A-Z0-9_]{0,99}$"
_MESSAGE_TYPE = "^[a-z][a-z0-9_]*/msg/[A-Z][A-Za-z0-9]*$"
_ARGUMENTS = "^[A-Za-z0-9_./:=,@+-]+( +[A-Za-z0-9_./:=,@+-]+)*$"
_TOPIC = "^(/[A-Za-z_][A-Za-z0-9_]*)+$"
_FOLDER = r"^/(srv|var/lib|mnt)(/[A-Za-z0-9_][A-Za-z0-9._-]*)+$"
Topic = Annotated[
    str,
    matching(_TOPIC, "is no topic of ROS 2", "its whole name, like /girona500/pose"),
    _base.text_like(_TOPIC),
]
DataFolder = Annotated[
    str,
    matching(_FOLDER, "is no folder for a service's data", "its whole path below /srv, /var/lib or /mnt"),
    _base.text_like(_FOLDER),
]
ArchiveName = Annotated[
    str,
    matching(_ARCHIVE, "is no name of a file", "a file in `images` of the inventory, like backend.tar"),
    _base.text_like(_ARCHIVE),
]
ContainerPath = Annotated[
    str,
    matching(_INSIDE, "is no place in a container", "like /data, or below /home, /mnt, /opt, /srv or /var"),
    _base.text_like(_INSIDE),
]
VariableName = Annotated[
    str,
    matching(_VARIABLE, "is no name of a variable", "capitals, digits and _, like POSTGRES_DB"),
    _base.text_like(_VARIABLE),
]
Arguments = Annotated[
    str,
    matching(_ARGUMENTS, "is no line of arguments", "words without quotation marks, like --port 18082"),
    _base.text_like(_ARGUMENTS),
]
MessageType = Annotated[
    str,
    matching(_MESSAGE_TYPE, "is no type of ROS 2", "package, msg and name, like std_msgs/msg/String"),
    _base.text_like(_MESSAGE_TYPE),
]


class ServiceNetwork(StrEnum):
    """From which of our own networks a service is reached."""

    LAN = "lan"
    """The LAN of its site."""
    VPN = "vpn"
    """Our own computers in the VPN: the infrastructure's pool."""


class ServiceRestart(StrEnum):
    """systemd's words for `Restart=`."""

    ALWAYS = "always"
    ON_FAILURE = "on-failure"


class ServiceBounds(_base.Model):
    """Within which bounds a service runs."""

    user: _base.Account | None = None
    """None: an account of its own, `svc-` and the service's name."""
    data: DataFolder | None = None
    """Its folder, the only one that it may write to; None: `/var/lib/svc-` and the service's name."""
    memory_mb: Annotated[StrictInt, Field(ge=16)] = 1024
    """It is ended and started anew when it takes more."""
    restart: ServiceRestart = ServiceRestart.ALWAYS
    """When it is started anew after it has ended."""


class ServiceProgram(ServiceBounds):
    """A program that the computer starts for a service."""

    command: Annotated[str, BeforeValidator(_command), _base.text_like("^/[!-~ ]+$")]
    """With its arguments, from the root; a partner brings the program."""

    @property
    def path(self) -> str:
        """Path of the program, without arguments."""
        return self.command.split(" ", 1)[0]


class ImageArchive(_base.Model):
    """An image of a container, in one file of `docker save` or `podman save`; no registry is ever contacted."""

    archive: ArchiveName
    """Name of the file in the folder `images` of the inventory."""
    sha256: _base.Sha256
    """Of the file: `sha256sum` prints it. Another file is not loaded."""


class EnvironmentVariable(_base.Model):
    """A variable of a container's environment: a value that everybody may see, or a secret."""

    name: VariableName
    """As the image's maker calls it."""
    value: _base.Text | None = None
    """In one line."""
    secret: _base.SecretText | None = None
    """In its place: vaulted, or EXAMPLE-…. In one line."""


class ServiceContainer(ServiceBounds, ImageArchive):
    """A container that the computer starts for a service."""

    arguments: Arguments | None = None
    """For the image's own program; None: those that the image has."""
    data_at: ContainerPath = "/data"
    """Where its folder stands in the container; everything else there can only be read, but /tmp."""
    budget_mb: Annotated[StrictInt, Field(ge=1)]
    """More than this in its folder, in 10^6 bytes, is told in every run; nothing is removed."""
    environment: tuple[EnvironmentVariable, ...] = ()
    """What the container is told by its environment."""


class HostedService(_base.Model):
    """A service on a computer of ours: the port that is opened for it, for whom, and what runs."""

    name: Annotated[_base.Name, Field(max_length=20)]
    """Small letters, digits and hyphens, 20 characters at most: its unit and its account bear it."""
    transport: _base.Transport = _base.Transport.TCP
    """What the service speaks: web, REST, OGC, WebSocket and socket.IO are all `tcp`."""
    port: Annotated[StrictInt, Field(ge=1, le=65535)] | None = None
    """At which it listens; None: at none."""
    open_to: tuple[ServiceNetwork, ...] = ()
    """Which of our own networks reach its port; none: the computer itself alone."""
    partners: tuple[_base.Name, ...] = ()
    """Keys of `partners` whose devices reach its port through the VPN."""
    program: ServiceProgram | None = None
    """Neither this nor a container: whoever brings the service also starts it, and only its port is opened here."""
    container: ServiceContainer | None = None
    """In the place of a program."""

    @property
    def workload(self) -> ServiceProgram | ServiceContainer | None:
        """Program or container that the computer starts for the service, or None."""
        return self.program or self.container


class Recording(_base.Model):
    """Topics of ROS 2 that are written to the disk, as bags of rosbag2."""

    topics: Annotated[tuple[Topic, ...], Field(min_length=1)]
    """By their whole names."""
    folder: DataFolder = "/var/lib/svc-recording"
    """Nothing else stands in it."""
    budget_mb: Annotated[StrictInt, Field(ge=80)]
    """The oldest file goes before the folder holds more, in 10^6 bytes; it must fit on the disk beside all else."""


ROS1_BRIDGE = "ros1-bridge"
"""The name of the service that the bridge is."""


class BridgedTopic(_base.Model):
    """A topic of ROS 1 and of ROS 2, which have the same name."""

    topic: Topic
    """Its whole name."""
    type: MessageType
    """As ROS 2 calls it."""


class Ros1Bridge(_base.Model):
    """`ros1_bridge`: topics of a ROS 1 robot in ROS 2, and back. A package beside foxy, elsewhere in a container."""

    archive: ArchiveName | None = None
    """Of its image, in the folder `images` of the inventory; None: beside foxy, which has a package."""
    sha256: _base.Sha256 | None = None
    """Of that file: `sha256sum` prints it. Another file is not loaded."""
    master_uri: Annotated[str, BeforeValidator(_master), _base.text_like(r"^http://[0-9.]+:[0-9]{1,5}/?$")]
    """ROS_MASTER_URI: the master of ROS 1, by its address. That computer reaches the bridge at any port of its own."""
    topics: tuple[BridgedTopic, ...] = ()
    """None: all that there are on both sides."""
    memory_mb: Annotated[StrictInt, Field(ge=16)] = 512
    """It is ended and started anew when it takes more."""

    @property
    def master(self) -> IPv4Address:
        """Address of the ROS 1 master."""
        return IPv4Address(self.master_uri.removeprefix("http://").partition(":")[0])
