"""The records of a site on this computer: `<state>/<real|rehearsal>/<site>/asbuilt/<record>/`.

A record exists once its `as-built.json` does, which is written last: a folder without it comes from a killed command
and is ignored.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from atlantis_netcfg import runs
from atlantis_netcfg.core import stored_messages
from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.core.messages import arg
from atlantis_netcfg.records.asbuilt.record import AsBuiltRecord

if TYPE_CHECKING:
    from collections.abc import Mapping
    from datetime import datetime
    from pathlib import Path


FILE = "as-built.json"
_DERIVED_KEYS = ("exit", "errors", "tables")
"""Keys that `AsBuiltRecord.as_json` adds; they are derived from the rest."""


def folder_of(store: runs.Store, site: str) -> Path:
    """Return the folder of a site's records."""
    return store.root / site / "asbuilt"


def latest(folder: Path) -> AsBuiltRecord | None:
    """Return the newest record, None if there is none; raise DamagedStateError if it cannot be read."""
    names = [path.name for path in folder.iterdir() if (path / FILE).is_file()] if folder.is_dir() else []
    if not names:
        return None
    path = folder / max(names, key=runs.run_order) / FILE
    try:
        return parse_record(path.read_bytes())
    except (OSError, ValueError) as error:
        raise runs.DamagedStateError(
            f"the last record cannot be read: {arg(path)}",
            hint="move its folder away: the next record is then the first one, without differences",
        ) from error


def record_json(record: AsBuiltRecord) -> bytes:
    """Return `as-built.json`: the record with derived values, and the values of its messages."""
    document = record.as_json() | stored_messages.marked_texts(record)
    return json.dumps(document, ensure_ascii=False, indent=1).encode()


def parse_record(data: bytes) -> AsBuiltRecord:
    """Parse an `as-built.json`; raise ValueError if it is none."""
    document = stored_messages.parse(data)
    return AsBuiltRecord.model_validate({name: value for name, value in document.items() if name not in _DERIVED_KEYS})


def new_folder(folder: Path, now: datetime) -> Path:
    """Create the empty folder of a new record, named by the record's id; raise JournalError."""
    with runs.os_errors_as("the record", folder):
        return runs.new_run(runs.make_private(folder), now)


def keep(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write the files of a record, `as-built.json` last; raise JournalError."""
    if FILE not in files:
        raise NetcfgError(f"internal error: a record without {arg(FILE)} was about to be saved")
    with runs.os_errors_as("the record", folder):
        for name in sorted(files, key=lambda name: name == FILE):
            runs.write_atomically(folder / name, files[name])
