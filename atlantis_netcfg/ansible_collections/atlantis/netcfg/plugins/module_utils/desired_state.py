"""Data model of the desired state of `configure`, for both ends of the link, with its checks on the computer."""

from __future__ import annotations

import posixpath
from dataclasses import dataclass, fields
from typing import Any, Iterable, Mapping, TypeVar

from atlantis_netcfg.core.messages import arg

from .errors import ModuleError


@dataclass(frozen=True)
class Directory:
    """A directory with its own mode; parent directories of files are created without an entry."""

    path: str
    mode: str = "0755"
    owner: str = "root"
    group: str = "root"


@dataclass(frozen=True)
class File:
    """A file with its whole content; `validate` is a program that checks it, with `%s` for the file's name."""

    path: str
    content: str
    mode: str = "0644"
    owner: str = "root"
    group: str = "root"
    validate: tuple[str, ...] = ()
    hint: str = ""
    """What to do if the file is rejected."""
    finding: str = ""
    """Reported if the file is rejected and all else is applied; empty: a rejection means that nothing is changed."""
    secret = False
    """Whether it is hidden in diffs and in validator output."""

    @property
    def data(self) -> bytes:
        """Content of the file as bytes on the disk."""
        return self.content.encode()


@dataclass(frozen=True)
class SecretFile(File):
    """A file that holds a secret."""

    secret = True


@dataclass(frozen=True)
class SymbolicLink:
    """A symbolic link; its target need not exist."""

    path: str
    target: str


@dataclass(frozen=True)
class ConvergeStep:
    """A program to run when the files in `after` differ from those of its last success."""

    name: str
    run: tuple[str, ...]
    after: tuple[str, ...] = ()


@dataclass(frozen=True)
class Unit:
    """A systemd unit, restarted when the files in `after` have changed.

    None leaves a setting as it is; `active` of None restarts the unit only if it runs.
    """

    name: str
    enabled: bool | None = None
    active: bool | None = None
    after: tuple[str, ...] = ()
    reload: bool = False
    wait: bool = True


@dataclass(frozen=True)
class UserSuppliedFile:
    """A file supplied by the user, and the note reported while it is missing."""

    path: str
    note: str


@dataclass(frozen=True)
class Check:
    """A read-only check program, run every time; if it fails, `finding` is reported and the run does not pass."""

    run: tuple[str, ...]
    finding: str
    hint: str = ""


@dataclass(frozen=True)
class SshRequirements:
    """Conditions for the SSH session of this call, checked before anything is changed."""

    admit: tuple[str, ...] = ()
    """Networks from which SSH is allowed after the change."""
    port: int | None = None
    """SSH port that is allowed after the change."""
    key: bool = False
    """Whether SSH accepts only keys after the change."""
    hint: str = ""


ROWS = {
    "directories": Directory,
    "files": File,
    "links": SymbolicLink,
    "steps": ConvergeStep,
    "units": Unit,
    "brought": UserSuppliedFile,
    "checks": Check,
}
"""Module parameter -> class of its rows."""


@dataclass(frozen=True)
class DesiredState:
    """The complete desired state of one call."""

    directories: tuple[Directory, ...] = ()
    files: tuple[File, ...] = ()
    links: tuple[SymbolicLink, ...] = ()
    absent: tuple[str, ...] = ()
    only: tuple[str, ...] = ()
    """Folders managed by this toolkit alone: everything else in them is removed."""
    steps: tuple[ConvergeStep, ...] = ()
    units: tuple[Unit, ...] = ()
    brought: tuple[UserSuppliedFile, ...] = ()
    checks: tuple[Check, ...] = ()
    way_in: SshRequirements | None = None

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> DesiredState:
        """Parse the parameters of the module."""
        rows: dict[str, Any] = {
            name: tuple(_file(row, values.get("secrets") or {}) if kind is File else _row(kind, row) for row in entries)
            for name, kind in ROWS.items()
            if (entries := values.get(name))
        }
        way_in = _row(SshRequirements, values["way_in"]) if values.get("way_in") else None
        paths = {name: tuple(values.get(name) or ()) for name in ("absent", "only")}
        wishes = cls(**rows, **paths, way_in=way_in)
        for directory in wishes.directories:
            mode_of(directory)
        for file in wishes.files:
            mode_of(file)
        _check_paths(wishes)
        _check_no_duplicates("step", (step.name for step in wishes.steps))
        _check_no_duplicates("unit", (unit.name for unit in wishes.units))
        return wishes


_Row = TypeVar("_Row")


def _row(kind: type[_Row], row: Mapping[str, Any]) -> _Row:
    """Parse one row; null counts as omitted."""
    names = [item.name for item in fields(kind)]  # type: ignore[arg-type]
    values = {name: row[name] for name in names if row.get(name) is not None}
    return kind(**{name: tuple(value) if isinstance(value, list) else value for name, value in values.items()})


def _file(row: Mapping[str, Any], secrets: Mapping[str, str]) -> File:
    secret = row.get("secret_content")
    content = secret if secret is not None else row.get("content")
    for word, value in secrets.items():
        if content is not None and word in content:
            content = secret = content.replace(word, value)
    if content is None:
        raise ModuleError(
            f"file {arg(row['path'])} has no content", "set `content` or `secret_content`, or list it in `absent`"
        )
    file = _row(File if secret is None else SecretFile, {**row, "content": content})
    if file.finding and not file.validate:
        raise ModuleError(f"file {arg(file.path)}: a finding needs a validator", "set `validate`")
    if file.validate and not any("%s" in word for word in file.validate):
        raise ModuleError(f"file {arg(file.path)}: its validator has no %s", "put %s in the place of the file name")
    return file


def mode_of(entry: Directory | File) -> int:
    """Return the mode of an entry as the integer for chmod(2). Raises ModuleError if it is not valid."""
    try:
        mode = int(entry.mode, 8)
    except ValueError:
        mode = -1
    if not 0 <= mode <= 0o7777:  # noqa: PLR2004 - chmod(2)
        raise ModuleError(
            f"{arg(entry.path)}: `{arg(entry.mode)}` is not a valid mode",
            'a mode is four octal digits in quotes, for example "0644"',
        )
    return mode


def _check_paths(wishes: DesiredState) -> None:
    kinds = (wishes.directories, wishes.files, wishes.links)
    paths = [item.path for kind in kinds for item in kind] + list(wishes.absent)
    for path in (*paths, *wishes.only):
        if not path.startswith("/") or posixpath.normpath(path) != path or path == "/":
            raise ModuleError(f"`{arg(path)}` is not an absolute path", "write the full path, for example /etc/hosts")
    _check_no_duplicates("path", paths)


def _check_no_duplicates(what: str, names: Iterable[str]) -> None:
    seen_names: set[str] = set()
    for name in names:
        if name in seen_names:
            raise ModuleError(f"{arg(what)} {arg(name)} is defined twice", "define it once")
        seen_names.add(name)
