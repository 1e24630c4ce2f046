"""What was written on which card: `<state>/real/<site>/images/<UTC time>-<host>.json`, one file a card.

The file is on disk before the first byte is written, with `outcome` `writing`: one that still says so tells of a card
that was cut off, which does not boot. No secret is in it.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from atlantis_netcfg import __version__
from atlantis_netcfg.core import paths
from atlantis_netcfg.core.errors import NetcfgError
from atlantis_netcfg.journal import Store, write_atomically

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from atlantis_netcfg.declaration import Declaration, Host
    from atlantis_netcfg.image import Disk, Expanded, Written

from contextlib import contextmanager

__all__ = ["Receipt"]


@dataclass(slots=True)
class Receipt:
    """One file, written anew at each step."""

    path: Path
    content: dict[str, Any]

    @classmethod
    def of(cls, state: Path, declaration: Declaration, host: Host, image: Mapping[str, str]) -> Receipt:
        """A receipt that is not yet on disk."""
        began = datetime.now(UTC)
        folder = paths.private_directory(Store(state).root / host.site / "images")
        path = folder / f"{began:%Y%m%dT%H%M%S.%fZ}-{host.name}.json"
        about = {"host": host.name, "site": host.site, "revision": declaration.revision, "tool": __version__}
        return cls(path, {**about, "image": dict(image), "began": began.isoformat()})

    @contextmanager
    def writing(self, disk: Disk) -> Iterator[None]:
        """Keep what begins, and how it ended if it failed."""
        values = {"name": disk.name, "label": disk.label, "serial": disk.serial, "size": disk.size, "bus": disk.bus}
        self._keep(device=values, outcome="writing")
        try:
            yield
        except NetcfgError as error:
            self._keep(outcome="failed", message=str(error), ended=datetime.now(UTC).isoformat())
            raise

    def written(self, written: Written) -> None:
        """Keep what was read back."""
        counts = {
            "data": written.data,
            "cleared": written.cleared,
            "skipped": written.skipped,
            "compared": written.compared,
            "seconds": round(written.seconds, 3),
        }
        self._keep(outcome="written", bytes=counts, ended=datetime.now(UTC).isoformat())

    def _keep(self, **more: object) -> None:
        self.content |= more
        write_atomically(self.path, f"{json.dumps(self.content, indent=1, ensure_ascii=False)}\n".encode())


def image_told(name: str, expanded: Expanded) -> dict[str, str]:
    """The vendor's file in a receipt."""
    return {"name": name, "sha256": expanded.sha256, "confirmed_by": expanded.told_by or "nobody"}
