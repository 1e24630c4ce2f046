"""Recordings transferred to the control centre: from gateways, and from robots through a gateway.

`inventory/group_vars/all/pilot.yml`, key `retrieval` of `pilot`.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Self

from pydantic import Field, StrictInt, model_validator

from atlantis_netcfg.inventory.model import _base
from atlantis_netcfg.inventory.model.computer import SshKey
from atlantis_netcfg.inventory.model.services import DataFolder, matching

COLLECTION_FOLDER = "/var/lib/atlantis/robots"
"""On a gateway: below it each robot has a folder with its name, of what is on its way to the control centre."""
_ROBOT_FOLDER = r"^(/[A-Za-z0-9_][A-Za-z0-9._-]*)+$"


class RetrievalPriority(StrEnum):
    """How much of a link recordings may take on their way to the control centre, beside all other traffic."""

    LOW = "low"
    NORMAL = "normal"
    HIGH = "high"


RobotFolder = Annotated[
    str,
    matching(_ROBOT_FOLDER, "is no folder", "its whole path, like /home/robot/bags"),
    _base.text_like(_ROBOT_FOLDER),
]
"""On a computer that is not ours."""


class RetrievalSource(_base.Model):
    """A folder on a gateway whose files are wanted at the control centre."""

    host: _base.HostName
    """The gateway; its `ssh.host_key` is declared, for that is how the control centre knows it."""
    folder: DataFolder = "/var/lib/svc-recording"
    """On the gateway; nothing in it is ever changed or removed."""
    priority: RetrievalPriority = RetrievalPriority.LOW
    """Of the upward rate that the link in use is declared with: `low` takes 20 %, `normal` 50 %, `high` 80 %."""

    @property
    def name(self) -> str:
        """Name of the source and of its folder at the control centre."""
        return self.host


class RetrievalRobot(_base.Model):
    """A folder on a robot whose files are wanted at the control centre: a gateway collects them in the LAN first."""

    robot: _base.Name
    """Key in `vehicles`."""
    host: _base.HostName
    """The gateway of the site where the robot is; the robot knows it by its `ssh.host_key`."""
    address: _base.Address | None = None
    """Of the robot, at that site; None: that of its DHCP reservation there."""
    port: Annotated[StrictInt, Field(ge=1, le=65535)] = 22
    """Of the robot's SSH server."""
    user: _base.Account
    """The account on the robot; it need not see more than the folder."""
    host_key: SshKey
    """Of the robot's SSH server, like the line of its `/etc/ssh/ssh_host_ed25519_key.pub`."""
    folder: RobotFolder
    """On the robot; nothing in it is ever changed or removed."""
    budget_mb: Annotated[StrictInt, Field(ge=1)]
    """So much may be on the way at once on the gateway, in 10^6 bytes; it must fit on its disk beside all else."""
    priority: RetrievalPriority = RetrievalPriority.LOW
    """As of a gateway's own recordings."""

    @property
    def name(self) -> str:
        """Name of the source and of its folder at the control centre."""
        return self.robot


class Retrieval(_base.Model):
    """Recordings that `provision robot retrieve` brings to the control centre, from gateways and robots, by VPN."""

    to: _base.HostName
    """The control centre; its `ssh.host_key` is declared, for that is how gateways know it."""
    folder: DataFolder = "/srv/recordings"
    """On the control centre: below it each gateway and robot has a folder with its name. Nothing else stands in it."""
    budget_mb: Annotated[StrictInt, Field(ge=1)]
    """No transfer begins that would make the folder hold more, in 10^6 bytes; nothing is removed."""
    sources: Annotated[tuple[RetrievalSource, ...], Field(min_length=1)] = ()
    """One for each gateway that has recordings of its own."""
    robots: tuple[RetrievalRobot, ...] = ()
    """One for each robot."""

    @model_validator(mode="after")
    def _require_source(self) -> Self:
        if not self.all_sources:
            raise _base.wrong("there is nothing to retrieve", "add `sources:` or `robots:`")
        return self

    @property
    def all_sources(self) -> tuple[RetrievalSource | RetrievalRobot, ...]:
        """All sources: gateways, then robots."""
        return (*self.sources, *self.robots)
