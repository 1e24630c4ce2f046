"""A measured link for people: screen text, HTML page, PDF and plots."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from atlantis_netcfg.links.qualify.record import QualifyRecord

__all__ = ["write_pages"]


def write_pages(folder: Path) -> QualifyRecord:
    """Write `record.json`, `page.html` and `page.pdf` of a run from its samples; return the record.

    Raises JournalError, DamagedStateError, SamplesUnreadable.
    """
    from atlantis_netcfg.links.qualify.archive import keep_record, recompute  # noqa: PLC0415
    from atlantis_netcfg.records.qualify.pages import PAGE_FILE, PAPER_FILE, html, pdf  # noqa: PLC0415
    from atlantis_netcfg.records.qualify.plots import plots  # noqa: PLC0415
    from atlantis_netcfg.runs import os_errors_as, write_atomically  # noqa: PLC0415 - a page takes long to import

    record, samples = recompute(folder)
    drawings = plots(record, samples)
    keep_record(folder, record)
    with os_errors_as("the page of the measurement", folder):
        write_atomically(folder / PAGE_FILE, html(record, drawings))
        write_atomically(folder / PAPER_FILE, pdf(record, drawings))
    return record
