"""What a caller of `configure` declares, checked before anything is looked at."""

from __future__ import annotations

import posixpath
from dataclasses import dataclass, field
from typing import Any, Iterable, Mapping

from .errors import ModuleError


@dataclass(frozen=True)
class Owned:
    """What has a place, a mode and an owner."""

    path: str
    mode: int
    owner: str
    group: str


@dataclass(frozen=True)
class Directory(Owned):
    """A directory."""


@dataclass(frozen=True)
class File(Owned):
    """A file, whole; `validate` is a program that accepts it, with `%s` where the file's name belongs."""

    content: bytes
    validate: tuple[str, ...] = ()
    hint: str = ""
    """What to do where it is not accepted."""
    finding: str = ""
    """Told where it is not accepted, and everything else is done; empty: nothing is changed then."""
    secret: bool = False
    """Neither shown in a difference, nor in what a validator says."""


@dataclass(frozen=True)
class Link:
    """A symbolic link."""

    path: str
    target: str


@dataclass(frozen=True)
class ConvergeStep:
    """A program to be run when what is in `after` is not what it last succeeded with."""

    name: str
    run: tuple[str, ...]
    after: tuple[str, ...]


@dataclass(frozen=True)
class Unit:
    """A unit of systemd; None leaves it as it is, and an `active` of None restarts it only where it runs."""

    name: str
    enabled: bool | None
    active: bool | None
    after: tuple[str, ...]
    reload: bool
    wait: bool


@dataclass(frozen=True)
class Brought:
    """A file that a person brings, and what is told as long as it is missing."""

    path: str
    note: str


@dataclass(frozen=True)
class Check:
    """A program that only looks, in every run; where it does not succeed, `finding` is told."""

    run: tuple[str, ...]
    finding: str
    hint: str = ""


@dataclass(frozen=True)
class WayIn:
    """What must hold of the session that asks, before anything is changed."""

    admit: tuple[str, ...] = ()
    """Networks from which SSH is admitted afterwards."""
    port: int | None = None
    """On which SSH is admitted afterwards."""
    key: bool = False
    """Only a key opens a session afterwards."""
    hint: str = ""


@dataclass(frozen=True)
class DesiredState:
    """All that one call brings about."""

    directories: tuple[Directory, ...] = ()
    files: tuple[File, ...] = ()
    links: tuple[Link, ...] = ()
    absent: tuple[str, ...] = ()
    only: tuple[str, ...] = ()
    """Folders in which nothing may stand but what is declared here."""
    steps: tuple[ConvergeStep, ...] = ()
    units: tuple[Unit, ...] = ()
    brought: tuple[Brought, ...] = ()
    checks: tuple[Check, ...] = ()
    way_in: WayIn = field(default_factory=WayIn)

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> DesiredState:
        """Read the parameters of the module."""
        wishes = cls(
            directories=tuple(
                Directory(row["path"], _mode(row, "0755"), row.get("owner") or "root", row.get("group") or "root")
                for row in values.get("directories") or ()
            ),
            files=tuple(_file(row, values.get("secrets") or {}) for row in values.get("files") or ()),
            links=tuple(Link(row["path"], row["target"]) for row in values.get("links") or ()),
            absent=tuple(values.get("absent") or ()),
            only=tuple(values.get("only") or ()),
            steps=tuple(
                ConvergeStep(row["name"], tuple(row["run"]), tuple(row.get("after") or ()))
                for row in values.get("steps") or ()
            ),
            units=tuple(_unit(row) for row in values.get("units") or ()),
            brought=tuple(Brought(row["path"], row["note"]) for row in values.get("brought") or ()),
            checks=tuple(
                Check(tuple(row["run"]), row["finding"], row.get("hint") or "") for row in values.get("checks") or ()
            ),
            way_in=_way_in(values.get("way_in") or {}),
        )
        _check_paths(wishes)
        _check_once("step", (step.name for step in wishes.steps))
        _check_once("unit", (unit.name for unit in wishes.units))
        return wishes


def _file(row: Mapping[str, Any], secrets: Mapping[str, str]) -> File:
    secret = row.get("secret_content")
    content = secret if secret is not None else row.get("content")
    for word, value in secrets.items():
        if content is not None and word in content:
            content = secret = content.replace(word, value)
    if content is None:
        raise ModuleError(
            f"file {row['path']} has no content", "give `content`, or `secret_content`, or list it in `absent`"
        )
    validate = tuple(row.get("validate") or ())
    if row.get("finding") and not validate:
        raise ModuleError(f"file {row['path']}: nothing can be found of it without a validator", "give `validate`")
    if validate and not any("%s" in word for word in validate):
        raise ModuleError(f"file {row['path']}: its validator has no %s", "put %s where the name of the file belongs")
    return File(
        path=row["path"],
        content=content.encode(),
        mode=_mode(row, "0644"),
        owner=row.get("owner") or "root",
        group=row.get("group") or "root",
        validate=validate,
        hint=row.get("hint") or "",
        finding=row.get("finding") or "",
        secret=secret is not None,
    )


def _unit(row: Mapping[str, Any]) -> Unit:
    wait = row.get("wait")
    return Unit(
        name=row["name"],
        enabled=row.get("enabled"),
        active=row.get("active"),
        after=tuple(row.get("after") or ()),
        reload=bool(row.get("reload")),
        wait=True if wait is None else bool(wait),
    )


def _way_in(row: Mapping[str, Any]) -> WayIn:
    return WayIn(tuple(row.get("admit") or ()), row.get("port"), bool(row.get("key")), row.get("hint") or "")


def _mode(row: Mapping[str, Any], default: str) -> int:
    text = row.get("mode") or default
    try:
        mode = int(text, 8)
    except ValueError:
        mode = -1
    if not 0 <= mode <= 0o7777:  # noqa: PLR2004 - chmod(2)
        raise ModuleError(f"{row['path']}: `{text}` is no mode", 'a mode is four octal digits in quotes, like "0644"')
    return mode


def _check_paths(wishes: DesiredState) -> None:
    kinds = (wishes.directories, wishes.files, wishes.links)
    paths = [item.path for kind in kinds for item in kind] + list(wishes.absent)
    for path in (*paths, *wishes.only):
        if not path.startswith("/") or posixpath.normpath(path) != path or path == "/":
            raise ModuleError(f"`{path}` is no path from the root", "write it in full, like /etc/hosts")
    _check_once("path", paths)


def _check_once(what: str, names: Iterable[str]) -> None:
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise ModuleError(f"{what} {name} is declared twice", "declare it once")
        seen.add(name)
