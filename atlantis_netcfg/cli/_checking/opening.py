"""The book of a sitting: where it lies, and what stands at its head."""

from __future__ import annotations

import shlex
import sys
from typing import TYPE_CHECKING

from atlantis_netcfg import __version__
from atlantis_netcfg.checklist import Book, Head
from atlantis_netcfg.checklist.topology import drawing
from atlantis_netcfg.cli._checking.listening import broken, not_rehearsed

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from atlantis_netcfg.checklist import Checklist
    from atlantis_netcfg.cli._session import Session
    from atlantis_netcfg.journal import Store


def folder_of(store: Store, site: str) -> Path:
    """Where the checklists of a site are kept."""
    return store.root / site / "checks"


def opened_book(opened: Session, checklist: Checklist, faults: Sequence[str], *, anew: bool) -> Book:
    """Go on with the open book, or begin one. Raises SiteBusy."""
    folder = folder_of(opened.store, opened.site)
    head = Head(
        rehearsed=opened.rehearsed,
        tool=__version__,
        inventory=opened.declaration.revision,
        drawing=drawing(opened.declaration, checklist),
        not_rehearsed=not_rehearsed(opened, checklist.entries),
        broken=broken(faults),
    )
    command = shlex.join(["provision", *sys.argv[1:]])
    return Book.open(folder, checklist, head, anew=anew, command=command)
