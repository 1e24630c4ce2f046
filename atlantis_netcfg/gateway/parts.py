"""The words in which the parts of a gateway are told to the modules `configure` and `packages` of the collection."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Protocol


class Part(Protocol):
    """What one role wants of one host."""

    def as_dict(self) -> dict[str, Any]:
        """The parameters of the role's modules, as JSON-able data, by the module's name."""
        ...


@dataclass(frozen=True, slots=True)
class Package:
    """A Debian package; `version` None takes what the archive has."""

    name: str
    version: str | None = None


@dataclass(frozen=True, slots=True)
class Directory:
    """A directory with a mode of its own; those above a file are made without being told."""

    path: str
    mode: str = "0755"
    owner: str = "root"
    group: str = "root"


@dataclass(frozen=True, slots=True)
class File:
    """A file, whole; `validate` is a program that accepts it, with `%s` for its name."""

    path: str
    content: str
    mode: str = "0644"
    owner: str = "root"
    group: str = "root"
    validate: tuple[str, ...] = ()
    hint: str = ""
    """What to do where the validator does not accept it."""
    finding: str = ""
    """What that means, where it stops nothing else; empty: then nothing is changed."""


@dataclass(frozen=True, slots=True)
class Link:
    """A symbolic link."""

    path: str
    target: str


@dataclass(frozen=True, slots=True)
class Step:
    """A program, run when the files in `after` are not what it last succeeded with."""

    name: str
    run: tuple[str, ...]
    after: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit of systemd; None leaves that as it is. It is restarted when the files in `after` are others."""

    name: str
    enabled: bool | None = None
    active: bool | None = None
    after: tuple[str, ...] = ()
    reload: bool = False
    wait: bool = True


@dataclass(frozen=True, slots=True)
class Brought:
    """A file that a person brings, and what is told as long as it is missing."""

    path: str
    note: str


@dataclass(frozen=True, slots=True)
class Check:
    """A program that only looks, in every run; where it does not succeed, the finding is told: no green end."""

    run: tuple[str, ...]
    finding: str
    hint: str = ""


@dataclass(frozen=True, slots=True)
class WayIn:
    """What must hold of the SSH session that brings all this: else nothing is changed."""

    admit: tuple[str, ...]
    port: int
    key: bool
    hint: str


@dataclass(frozen=True, slots=True)
class Configuration:
    """The parameters of `atlantis.netcfg.configure`."""

    directories: tuple[Directory, ...] = ()
    files: tuple[File, ...] = ()
    links: tuple[Link, ...] = ()
    absent: tuple[str, ...] = ()
    only: tuple[str, ...] = ()
    """Folders that are ours alone: whatever else stands in them goes."""
    steps: tuple[Step, ...] = ()
    units: tuple[Unit, ...] = ()
    brought: tuple[Brought, ...] = ()
    checks: tuple[Check, ...] = ()
    way_in: WayIn | None = None

    def as_dict(self) -> dict[str, Any]:
        """As JSON-able data; what is left out is the module's default."""
        return {key: _plain(value) for key, value in asdict(self).items() if value}


def _plain(result: Any) -> Any:  # noqa: ANN401 - JSON
    """Lists for tuples, and no keys without a value."""
    if isinstance(result, dict):
        return {key: _plain(value) for key, value in result.items() if value is not None}
    return [_plain(value) for value in result] if isinstance(result, list | tuple) else result
