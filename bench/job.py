"""What a contender is given for one run, and what it answers: a command, or why it cannot take part."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from bench.declared import Declared

__all__ = ["RACES", "Command", "Contender", "Job", "Scenario"]


class Scenario(StrEnum):
    """What is to be done."""

    FIRST = "first"
    """The whole configuration, on a router that was just adopted."""
    NOTHING = "no-op"
    """Nothing: the router is as declared, and that has to be found out."""
    FIREWALL = "firewall"
    """Twenty rules of the filter: fifteen are missing, five have another value."""
    USE = "use"
    """Another link for half an hour: a job of the scheduler and two routes. Only we have such a command."""


RACES = (Scenario.FIRST, Scenario.NOTHING, Scenario.FIREWALL)
"""What everybody is asked to do."""


@dataclass(frozen=True, slots=True)
class Job:
    """One run of one contender."""

    scenario: Scenario
    folder: Path
    """Its own, for whatever it writes."""
    host: str
    port: int
    """api-ssl, through the proxy."""
    ssh_port: int | None
    """None: the twin has no SSH."""
    pin: str
    ca: Path
    """The router's certificate, as a file to be trusted."""
    declared: Declared
    script: tuple[str, ...]
    """The change as console commands, for peers that send commands: written for this state of the router."""
    export: str
    """The router's own export once it is as declared."""
    real: bool
    """The router stands at its declared address."""

    def write(self, **more: Any) -> Path:  # noqa: ANN401 - JSON of any shape
        """Put it on disk for a program in another Python; return the file."""
        _, user, password = self.declared.access
        path = self.folder / "job.json"
        data = {
            "host": self.host,
            "port": self.port,
            "ssh_port": self.ssh_port,
            "user": user,
            "password": password,
            "ca": str(self.ca),
            **more,
        }
        path.write_text(json.dumps(data), encoding="utf-8")
        return path


@dataclass(frozen=True, slots=True)
class Command:
    """What to run and measure."""

    argv: tuple[str, ...]
    environment: Mapping[str, str] = field(default_factory=dict)
    """Added to the bench's own."""
    notes: tuple[str, ...] = ()
    """What the contender cannot express, or does in another way."""


class Contender(Protocol):
    """Somebody who configures routers."""

    name: str
    title: str

    def missing(self) -> str | None:
        """Why it cannot take part on this machine; None if it can."""

    def version(self) -> str:
        """Name and version of what is measured."""

    def command(self, job: Job) -> Command:
        """Write what it needs into `job.folder` and say what to run. Raises LookupError if it has no way to do it."""

    def notes_of(self, scenario: Scenario, text: str) -> tuple[str, ...]:
        """Notes that only its output gives."""
