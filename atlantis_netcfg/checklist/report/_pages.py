"""The pages that are kept beside a signed document."""

from __future__ import annotations

from typing import TYPE_CHECKING

from atlantis_netcfg.checklist.report._junit import junit

if TYPE_CHECKING:
    from collections.abc import Mapping

    from atlantis_netcfg.checklist.report.document import Document


def pages(document: Document, files: Mapping[str, bytes]) -> Mapping[str, bytes]:
    """Make `report.html`, `report.pdf` and `junit.xml`; `files` are those that evidence names, by that name.

    They are the same bytes for the same document and files, as long as the libraries that write them are.
    """
    # fpdf2 and Jinja take half a second to import, and every probe imports this package.
    from atlantis_netcfg.checklist.report._html import html  # noqa: PLC0415 - see above
    from atlantis_netcfg.checklist.report._pdf import pdf  # noqa: PLC0415 - see above

    return {"report.html": html(document, files), "report.pdf": pdf(document, files), "junit.xml": junit(document)}
