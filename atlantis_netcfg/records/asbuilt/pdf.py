"""A record on paper: the whole record as PDF, and a sheet of labels for ports and devices.

A label's QR code contains plain text and no URL: at the quay a telephone reaches neither the laptop nor the internet,
and a link to a file of another computer opens nowhere. Any reader shows the text: device and port, serial number, the
record with more data, the first digits of that record's SHA-256, and the page's path in the state folder of the laptop
that made it. It contains nothing secret: neither keys nor passwords, IMEI or ICCID.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby
from math import ceil
from typing import TYPE_CHECKING

import segno

from atlantis_netcfg.checklist.report._pdf import _sheet
from atlantis_netcfg.core.errors import UsageError
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.records.asbuilt import pages
from atlantis_netcfg.records.asbuilt.archive import FILE
from atlantis_netcfg.records.asbuilt.record import report_tables, title_of
from atlantis_netcfg.runs.report import page_frame

if TYPE_CHECKING:
    from collections.abc import Iterator

    from atlantis_netcfg.inventory.model import AsBuilt
    from atlantis_netcfg.records.asbuilt.record import AsBuiltRecord, DeviceRecord, Fact, ReportTable

_INDENT = 5.0
DIGITS = 16
"""Number of digits of the record's SHA-256 in a QR code and beside it."""
_A4 = (210.0, 297.0)
_EDGE = 2.5
"""Empty margin of a label in mm: sheets are cut, and printers do not hit them exactly."""


def pdf(record: AsBuiltRecord, digest: str) -> bytes:
    """Return the record as PDF, the same bytes for the same record. `digest`: SHA-256 of its `as-built.json`."""
    paper = _paper(record, digest)
    paper.add_page()
    paper.tell(translate(pages.heading(record)), size=17, bold=True)
    if page_frame.unread():
        paper.tell(page_frame.unread(), faint=True)
    paper.tell(translate(pages.subtitle(record)), faint=True)
    if record.rehearsed:
        paper.tell(translate("REHEARSAL: no real device was contacted."), size=13, bold=True)
    paper.tell(translate(pages.closing(record)), size=11, bold=True)
    if record.checklist is not None:
        paper.tell(translate(pages.checklist_words(record.checklist, record.time_zone)))
    paper.tell(f"{FILE}: SHA-256 {digest}", size=_sheet.SMALL)
    paper.head(translate("Differences"))
    paper.tell(translate(pages.compared_words(record)))
    for change in record.changes:
        paper.tell(f"• {translate(change.words)}", indent=_INDENT)
    for device in record.devices:
        _device(paper, device, record.time_zone)
    for table in report_tables(record):
        _table(paper, table)
    if record.not_rehearsed:
        paper.head(translate("Limits of the rehearsal"))
    for entry in record.not_rehearsed:
        paper.tell(translate(entry), indent=_INDENT)
    return paper.to_bytes()


def _paper(record: AsBuiltRecord, digest: str) -> _sheet.Paper:
    paper = _sheet.Paper(translate(pages.heading(record)), record.tool, record.at)
    words = [translate(f"{arg(record.site)}, record {arg(record.id)}"), f"SHA-256 {digest[:DIGITS]}…"]
    paper.head_line = join(
        "; ", [*words, *([translate("REHEARSED, no real device was contacted")] if record.rehearsed else [])]
    )
    paper.foot_line = translate(pages.closing(record))
    return paper


def _device(paper: _sheet.Paper, device: DeviceRecord, zone: str) -> None:
    paper.head(msg(f"{arg(device.name)}: {arg(pages.state_word(device.state))}"))
    for words in (device.why, device.hint and f"→ {translate(device.hint)}", pages.read_words(device, zone)):
        if words:
            paper.tell(translate(words), indent=_INDENT)
    for name, fact in pages.facts_of(device):
        paper.tell(f"{translate(title_of(name))}: {_value(fact, zone)}", size=_sheet.SMALL, indent=_INDENT)
    for port in device.ports:
        belongs = f"; {translate(f'according to the inventory: {arg(port.belongs)}')}" if port.belongs else ""
        paper.tell(
            f"{translate(f'port {arg(port.name)}')}: {translate(pages.link_words(port))}{belongs}",
            size=_sheet.SMALL,
            indent=_INDENT,
        )
        for item in port.neighbours:
            paper.tell(translate(pages.neighbour_words(item)), size=_sheet.SMALL, indent=2 * _INDENT)
    for item in device.elsewhere:
        paper.tell(
            f"{translate('port not known')}: {translate(pages.neighbour_words(item))}",
            size=_sheet.SMALL,
            indent=_INDENT,
        )
    for note in device.notes:
        paper.tell(translate(f"note: {arg(note)}"), size=_sheet.SMALL, indent=_INDENT)


def _value(fact: Fact, zone: str) -> str:
    origin = translate(pages.where(fact, zone))
    return msg(f"{arg(fact.value)} ({arg(origin)})") if fact.value else origin


def _table(paper: _sheet.Paper, table: ReportTable) -> None:
    paper.head(translate(pages.table_words(table)), size=11)
    if not table.rows:
        paper.tell(translate("nothing was read for this part"))
    for row in table.rows:
        pairs = zip(table.columns, row, strict=True)
        paper.tell(
            join("; ", (f"{translate(column)}: {cell}" for column, cell in pairs if cell)),
            size=_sheet.SMALL,
            indent=_INDENT,
        )


@dataclass(frozen=True, slots=True)
class Label:
    """One label: its printed text, and the content of its QR code."""

    device: str
    port: str | None
    """Port of the label; None: the label is for the device itself."""
    belongs: str
    serial: str
    text: str


def labels_of(record: AsBuiltRecord, digest: str, place: str) -> tuple[Label, ...]:
    """Return a label for each device of the site, and for each port with a purpose in the inventory.

    `place`: the record's path below the state folder.
    """
    return tuple(label for device in record.devices for label in _labels(record, device, digest, place))


def _labels(record: AsBuiltRecord, device: DeviceRecord, digest: str, place: str) -> Iterator[Label]:
    fact = device.facts.get("serial")
    serial = fact.value if fact is not None and fact.value else "not read"
    ports = [(port.name, port.belongs) for port in device.ports if port.belongs]
    for port, belongs in [(None, device.kind.replace("_", " ")), *ports]:
        lines = (
            f"ATLANTIS as built{' (REHEARSED)' if record.rehearsed else ''}",
            msg(f"{arg(record.site)}: {arg(device.name)}"),
            *([msg(f"port {arg(port)}: {arg(belongs)}")] if port else []),
            msg(f"serial {arg(serial)}"),
            msg(f"record {arg(record.id)}"),
            f"sha256 {digest[:DIGITS]}",
            f"{place}/as-built.html#{pages.anchor(device.name)}",
        )
        yield Label(device.name, port, belongs, serial, "\n".join(lines))


def labels_pdf(record: AsBuiltRecord, digest: str, place: str, sheet: AsBuilt) -> bytes:
    """Return A4 sheets of labels of the configured size; raise UsageError if a QR code does not fit."""
    width, height = sheet.label_width_mm, sheet.label_height_mm
    columns, lines = (int((whole + 0.01) // part) for whole, part in zip(_A4, (width, height), strict=True))
    margin_left, top = (_A4[0] - columns * width) / 2, (_A4[1] - lines * height) / 2
    labels = labels_of(record, digest, place)
    codes = [segno.make(label.text, error="m", micro=False) for label in labels]
    side = _side(width, height, max(len(code.matrix) for code in codes) + 2 * _QUIET)
    paper = LabelSheet(translate(pages.heading(record)), record.tool, record.at)
    paper.set_auto_page_break(False)
    for number, (label, code) in enumerate(zip(labels, codes, strict=True)):
        here = number % (columns * lines)
        if not here:
            paper.add_page()
        x, y = margin_left + here % columns * width, top + here // columns * height
        _code(paper, code.matrix, x + _EDGE, y + (height - side) / 2, side)
        _text(paper, _words(label, record), (x + _EDGE + side + 1, y + _EDGE + 1), x + width - _EDGE)
    return paper.to_bytes()


def _side(width: float, height: float, modules: int) -> float:
    """Return the side of a sheet's QR codes in mm; raise UsageError if the largest does not fit on a label."""
    side, least = min(height - 2 * _EDGE, width * _SHARE), modules * _MODULE_MM
    if side >= least:
        return side
    raise UsageError(
        f"labels of {arg(width):g} by {arg(height):g} mm are too small for their QR codes",
        hint=(
            f"set `label_width_mm` {arg(ceil(least / _SHARE))} and `label_height_mm` {arg(ceil(least + 2 * _EDGE))}, "
            "or more, under `asbuilt` in group_vars/all/pilot.yml"
        ),
    )


class LabelSheet(_sheet.Paper):
    """Pages without header and footer, filled to their edges."""

    def header(self) -> None:
        """Print no header: a label may be there."""

    def footer(self) -> None:
        """Print no footer: a label may be there."""


_QUIET = 4
"""White modules around a QR code (ISO/IEC 18004)."""
_SHARE = 0.5
"""Maximum share of a label's width for the QR code."""
_MODULE_MM = 0.4
"""Minimum size of a QR code's module. Rule of thumb: not tested with any telephone; zbar reads it at 300 dpi."""


def _text(paper: _sheet.Paper, words: Iterator[tuple[str, float, bool]], at: tuple[float, float], right: float) -> None:
    """Print lines from a point on, wrapped at the label's right edge."""
    paper.set_xy(*at)
    for text, size, bold in words:
        paper.set_font(_sheet.FAMILY, "B" if bold else "", size)
        paper.set_text_color(0)
        paper.set_x(at[0])
        line = paper.font_size * 1.25
        paper.multi_cell(right - at[0], line, _sheet.printable(text), align="L", new_x="LEFT", new_y="NEXT")


def _words(label: Label, record: AsBuiltRecord) -> Iterator[tuple[str, float, bool]]:
    """Yield the text beside the code, with font size and whether it is bold."""
    yield (label.device if label.port is None else f"{label.device} {label.port}"), 9.0, True
    yield translate(label.belongs), 7.5, False
    yield translate(f"serial {arg(label.serial)}"), 6.5, False
    yield record.id, 6.0, False
    if record.rehearsed:
        yield translate("REHEARSED"), 7.5, True


def _code(paper: _sheet.Paper, matrix: tuple[bytearray, ...], x: float, y: float, side: float) -> None:
    """Draw the dark modules, merging adjacent ones of a row; a quiet zone of four modules stays white."""
    module = side / (len(matrix) + 2 * _QUIET)
    paper.set_fill_color(0)
    for number, row in enumerate(matrix, start=_QUIET):
        column = _QUIET
        for dark, run in groupby(row):
            length = len(list(run))
            if dark:
                paper.rect(x + column * module, y + number * module, length * module, module, style="F")
            column += length
