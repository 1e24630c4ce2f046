"""The measurement runs of a site on this computer: `<state>/<real|rehearsal>/<site>/qualify/<run>/`.

A run exists once its `run.json` does. `record.json` beside it is computed from the two files of the run; if it is
missing, of another version, or does not match the samples, the figures are computed again.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.core.errors import UsageError, nearest
from atlantis_netcfg.core.messages import arg, msg
from atlantis_netcfg.links.qualify import measured_run
from atlantis_netcfg.links.qualify.record import QualifyRecord, make_record
from atlantis_netcfg.links.qualify.samples import read
from atlantis_netcfg.runs import DamagedStateError, NoSuchRun, os_errors_as, write_atomically
from atlantis_netcfg.runs.files import component

if TYPE_CHECKING:
    from pathlib import Path

    from atlantis_netcfg.links.qualify.judgement import QualifyProfile
    from atlantis_netcfg.links.qualify.samples import Sample
    from atlantis_netcfg.runs import Store

RECORD_FILE: Final = "record.json"


@dataclass(frozen=True, slots=True)
class SavedRun:
    """A saved measurement run and its folder."""

    folder: Path
    run: measured_run.MeasuredRun


def folder_of(store: Store, site: str) -> Path:
    """Return the folder of a site's runs; raise UsageError if no site can have this name."""
    try:
        return store.root / component(site) / "qualify"
    except ValueError as error:
        raise UsageError(f"`{arg(site)}` is not a valid site name", hint="type its name: `site=coastal`") from error


def stored_runs(store: Store, site: str, link: str | None = None) -> list[SavedRun]:
    """Return the runs of a site, or of one link, oldest first; raise DamagedStateError for a broken `run.json`."""
    folder = folder_of(store, site)
    places = [path for path in folder.iterdir() if (path / measured_run.RUN_FILE).is_file()] if folder.is_dir() else []
    runs = [SavedRun(place, _run(place)) for place in places]
    return sorted(
        (item for item in runs if link in {None, item.run.link}), key=lambda item: (item.run.begun, item.run.id)
    )


def find_run(store: Store, site: str, run: str) -> SavedRun:
    """Return a run by its name; raise NoSuchRun or DamagedStateError."""
    folder = folder_of(store, site)
    names = (
        sorted(path.name for path in folder.iterdir() if (path / measured_run.RUN_FILE).is_file())
        if folder.is_dir()
        else []
    )
    if run not in names:
        option = " --rehearse" if store.is_rehearsal else ""
        near = nearest(run, names)
        suggestion = msg(f"did you mean `{arg(near)}`? " if near else "")
        hint = (
            msg(f"{arg(suggestion)}`provision measure history site={arg(site)}{arg(option)}` lists the measurements")
            if names
            else None
        )
        raise NoSuchRun(f"{arg(site)} has no measurement `{arg(run)}`", hint=hint)
    return SavedRun(folder / run, _run(folder / run))


def _run(folder: Path) -> measured_run.MeasuredRun:
    try:
        return measured_run.read_run(folder)
    except (OSError, ValueError) as error:
        raise DamagedStateError(
            f"the measurement in {arg(folder)} is damaged or was written by another version",
            hint="move this folder away and run the same command again",
        ) from error


def samples_of(folder: Path) -> list[Sample]:
    """Read the samples of a run; empty if it sent nothing. Raise SamplesUnreadable or DamagedStateError."""
    path = folder / measured_run.SAMPLES_FILE
    try:
        with path.open(encoding="utf-8") as lines:
            return [*read(lines, str(path))]
    except FileNotFoundError:
        return []
    except (OSError, UnicodeDecodeError) as error:
        hint = "move this folder away and run the same command again"
        raise DamagedStateError(f"the samples in {arg(folder)} are damaged", hint=hint) from error


def _digest(folder: Path) -> str:
    path = folder / measured_run.SAMPLES_FILE
    return hashlib.sha256(path.read_bytes() if path.is_file() else b"").hexdigest()


def record_of(saved_run: SavedRun, thresholds: tuple[str, QualifyProfile] | None = None) -> QualifyRecord:
    """Return the figures of a run: the saved ones if they match its samples, otherwise computed again."""
    digest = _digest(saved_run.folder)
    saved_record = _kept_record(saved_run.folder) if thresholds is None else None
    if saved_record is not None and saved_record.samples_sha256 == digest and saved_record.run == saved_run.run:
        return saved_record
    return make_record(saved_run.run, samples_of(saved_run.folder), digest, thresholds)


def recompute(folder: Path, thresholds: tuple[str, QualifyProfile] | None = None) -> tuple[QualifyRecord, list[Sample]]:
    """Compute a run's figures from its samples, return both; raise SamplesUnreadable or DamagedStateError."""
    samples = samples_of(folder)
    return make_record(_run(folder), samples, _digest(folder), thresholds), samples


def _kept_record(folder: Path) -> QualifyRecord | None:
    try:
        return QualifyRecord.from_json((folder / RECORD_FILE).read_bytes())
    except (OSError, ValueError):
        return None


def keep_record(folder: Path, record: QualifyRecord) -> None:
    """Write the figures beside the samples; raise JournalError."""
    with os_errors_as("the figures of the measurement", folder):
        write_atomically(folder / RECORD_FILE, record_json(record))


def record_json(record: QualifyRecord) -> bytes:
    """Return `record.json`: the same bytes for the same figures."""
    return f"{record.to_json(indent=1)}\n".encode()
