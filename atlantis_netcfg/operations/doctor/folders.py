"""Disk and folders: free space, permissions, leftovers of killed commands, unfinished runs.

Free space is what the file system grants this user. How much a command needs depends on the site: the limits below are
rules of thumb, and a command that needs more reports it itself.
"""

from __future__ import annotations

import os
import shlex
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from atlantis_netcfg.core import paths, temporary
from atlantis_netcfg.core.errors import NetcfgError, UsageError
from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.operations.doctor.items import DoctorItem, DoctorSection

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from atlantis_netcfg.runs import Run, Store

_MB = 1_000_000
_OTHERS = 0o077
_OTHERS_WRITE = 0o022


def _item(name: str, verdict: Verdict, observation: str, hint: str = "", commands: Sequence[str] = ()) -> DoctorItem:
    return DoctorItem(DoctorSection.FOLDERS, name, verdict, observation, hint, tuple(commands))


@dataclass(frozen=True, slots=True)
class SpaceRequirement:
    """The free space that a folder should have, in bytes."""

    name: str
    place: Path
    fail: int
    """Below this value commands fail."""
    warn: int
    purpose: str


def room_needs(state: Path, cache: Path) -> tuple[SpaceRequirement, ...]:
    """Return the folders that commands fill, with their space requirements."""
    return (
        SpaceRequirement("space for records", state, 50 * _MB, 500 * _MB, "journals and saved states"),
        SpaceRequirement(
            "space for the cache", cache, 50 * _MB, 2000 * _MB, "the Debian system of a rehearsal as root"
        ),
        SpaceRequirement(
            "space for images", temporary.large_temp_dir(), 50 * _MB, 8000 * _MB, "card images and bundles"
        ),
    )


def judge_room(need: SpaceRequirement, free: int) -> DoctorItem:
    """Judge whether the free space is sufficient."""
    free_text = f"{free / 1e9:.1f} GB" if free >= 1000 * _MB else f"{free / _MB:.0f} MB"
    if free < need.fail:
        observation = msg(f"{arg(free_text)} free at {arg(need.place)}, for {arg(need.purpose)}")
        return _item(need.name, Verdict.FAIL, observation, "delete what you no longer need")
    if free < need.warn:
        observation = msg(
            f"{arg(free_text)} free at {arg(need.place)}; {arg(need.warn / 1000000000.0):.1f} GB are recommended for "
            f"{arg(need.purpose)}"
        )
        return _item(need.name, Verdict.WARN, observation, "free disk space")
    return _item(need.name, Verdict.PASS, msg(f"{arg(free_text)} free at {arg(need.place)}"))


def _standing(place: Path) -> Path:
    """Return the folder, or its nearest existing parent."""
    return next((each for each in (place, *place.parents) if each.exists()), Path("/"))


def state_item(place: Path) -> DoctorItem:
    """Judge the folder of journals and certificates: owned by this user, closed to others, or still to be created."""
    name = "record folder"
    if not place.exists():
        above = _standing(place)
        if not os.access(above, os.W_OK | os.X_OK):
            return _item(
                name,
                Verdict.FAIL,
                msg(f"cannot create {arg(place)}: you cannot write to {arg(above)}"),
                "use your own folder: ATLANTIS_STATE=/some/folder, before the command",
            )
        return _item(name, Verdict.SKIP, msg(f"{arg(place)} will be created by the first run"))
    try:
        paths.require_own(place, "use your own folder: ATLANTIS_STATE=/some/folder, before the command")
    except UsageError as error:
        return _item(name, Verdict.FAIL, str(error), error.hint or "")
    if place.stat().st_mode & _OTHERS:
        return _item(
            name,
            Verdict.WARN,
            msg(f"other users can read {arg(place)}"),
            commands=[f"chmod 700 {shlex.quote(str(place))}"],
        )
    if not os.access(place, os.W_OK | os.X_OK):
        return _item(
            name, Verdict.FAIL, msg(f"{arg(place)} is not writable"), commands=[f"chmod 700 {shlex.quote(str(place))}"]
        )
    return _item(name, Verdict.PASS, msg(f"{arg(place)}, private"))


def checkout_item(root: Path) -> DoctorItem:
    """Report a checkout that others can change: whoever changes it controls what this laptop runs."""
    name = msg("checkout")
    open_to_all = [each for each in (root, root / ".venv") if each.is_dir() and each.stat().st_mode & _OTHERS_WRITE]
    if open_to_all:
        path_list = " ".join(shlex.quote(str(each)) for each in open_to_all)
        return _item(
            name,
            Verdict.WARN,
            msg(f"other users can write to {arg(path_list)} and change the programs that you run"),
            commands=[f"chmod go-w {path_list}"],
        )
    if not os.access(root, os.W_OK):
        return _item(name, Verdict.PASS, msg(f"{arg(root)}; updated by its owner, not writable by you"))
    return _item(name, Verdict.PASS, msg(f"{arg(root)}, writable by you"))


def leftovers_item(dead: Sequence[Path]) -> DoctorItem:
    """Report temporary folders of killed commands that could not be removed; all others are already gone."""
    if dead:
        path_list = join(", ", map(str, dead))
        words = " ".join(shlex.quote(str(each)) for each in dead)
        return _item(
            "leftovers",
            Verdict.WARN,
            msg(f"left by killed commands, and could not be removed: {arg(path_list)}"),
            "if it contains a mount (`findmnt`), unmount that first; then:",
            [f"sudo rm -r --one-file-system {words}"],
        )
    return _item("leftovers", Verdict.PASS, "none from killed commands")


def unfinished_item(runs: Sequence[Run]) -> DoctorItem:
    """Report runs whose outcome on a device is open."""
    if not runs:
        return _item("unfinished runs", Verdict.PASS, "none")
    first = runs[0]
    more = msg(f" (and {arg(len(runs) - 1)} more)" if len(runs) > 1 else "")
    devices = join(", ", sorted(first.unsettled_devices))
    return _item(
        "unfinished runs",
        Verdict.WARN,
        msg(f"{arg(first.id)} is unfinished on {arg(devices)}{arg(more)}"),
        "continue when the link is available:",
        [first.next_command],
    )


@dataclass(frozen=True, slots=True)
class RunsRead:
    """The runs found in this computer's journals."""

    runs: tuple[Run, ...]
    unfinished_runs: tuple[Run, ...]
    trouble: NetcfgError | None = None
    """Why the runs could not be read; None: no error."""


def read_runs(store: Store | None, site: str | None) -> RunsRead:
    """Read the journals of one site or all; create nothing if there are none."""
    if store is None:
        return RunsRead((), ())
    try:
        sites = [each for each in store.sites() if site in (None, each)]
        return RunsRead(
            tuple(run for each in sites for run in store.runs(each)),
            tuple(run for each in sites for run in store.unfinished_runs(each)),
        )
    except NetcfgError as error:
        return RunsRead((), (), error)


def folder_items(state: Path, root: Path, read: RunsRead) -> Iterator[DoctorItem]:
    """Check the disk of this computer."""
    for need in room_needs(state, paths.cache_place()):
        yield judge_room(need, shutil.disk_usage(_standing(need.place)).free)
    yield state_item(state)
    yield checkout_item(root)
    yield leftovers_item(temporary.orphaned_folders())
    if read.trouble is not None:
        yield _item("unfinished runs", Verdict.FAIL, str(read.trouble), read.trouble.hint or "")
    else:
        yield unfinished_item(read.unfinished_runs)
