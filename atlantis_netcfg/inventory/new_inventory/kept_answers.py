"""Answers of an interrupted `provision inventory init`, kept in the state directory; no secret is among them."""

from __future__ import annotations

import json
from contextlib import suppress
from hashlib import sha256
from typing import TYPE_CHECKING

from pydantic import TypeAdapter, ValidationError

from atlantis_netcfg.core import paths
from atlantis_netcfg.core.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

_ANSWERS = TypeAdapter(list[tuple[str, str]])


class KeptAnswers:
    """The answers for one new folder: key and typed text of each, in order."""

    def __init__(self, folder: Path) -> None:
        self._name = sha256(str(folder.resolve()).encode(errors="surrogateescape")).hexdigest()[:16]

    @property
    def path(self) -> Path:
        """The file. Raises UsageError if there is no place for a state directory."""
        return paths.state_place() / "init" / f"{self._name}.json"

    def read(self) -> list[tuple[str, str]]:
        """Return the kept answers; none if there are none, or if the file cannot be used."""
        try:
            return _ANSWERS.validate_json(self.path.read_bytes())
        except (OSError, UsageError, ValidationError):
            return []

    def write(self, answers: Sequence[tuple[str, str]]) -> None:
        """Keep the answers so far. Raises UsageError or OSError."""
        paths.private_directory(paths.state_dir() / self.path.parent.name)
        paths.write_private(self.path, json.dumps(list(answers)).encode())

    def remove(self) -> None:
        """Remove the file: the inventory is written, or the person starts again."""
        with suppress(OSError, UsageError):
            self.path.unlink(missing_ok=True)
