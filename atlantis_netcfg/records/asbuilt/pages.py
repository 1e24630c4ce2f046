"""A record as text for the screen, and as a self-contained HTML page."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

from atlantis_netcfg.core import printable
from atlantis_netcfg.core.language import translate
from atlantis_netcfg.core.messages import arg, conjunction, join, msg
from atlantis_netcfg.core.times import time_text
from atlantis_netcfg.records.asbuilt.record import (
    FACTS,
    AsBuiltRecord,
    DeviceRecord,
    Fact,
    Origin,
    PortNeighbour,
    PortRecord,
    ReadState,
    ReportTable,
    neighbour_text,
    report_tables,
    title_of,
)
from atlantis_netcfg.runs.report import page_frame, signs
from atlantis_netcfg.runs.report.summary import count_limits

if TYPE_CHECKING:
    from collections.abc import Iterator

    from jinja2 import Environment

_COLUMN = 26
"""Column at which the values on a screen begin."""
_STYLES = {
    ReadState.READ: printable.Style.GOOD,
    ReadState.IN_PART: printable.Style.WARNING,
    ReadState.NOT_REACHED: printable.Style.BAD,
}
_REHEARSAL = "REHEARSAL: no real device was contacted. Devices and all their responses were emulated."
_SIGNS = {
    ReadState.READ: signs.ShownState.PASS,
    ReadState.IN_PART: signs.ShownState.WARN,
    ReadState.NOT_REACHED: signs.ShownState.FAIL,
}
_STATES = {
    ReadState.READ: "READ",
    ReadState.IN_PART: "READ IN PART",
    ReadState.NOT_REACHED: "NOT REACHED",
    ReadState.BY_HAND: "NOT QUERIED",
    ReadState.NOT_REHEARSED: "NOT REHEARSED",
    ReadState.LEFT_OUT: "LEFT OUT",
}


def state_word(state: ReadState) -> str:
    """Return a reading state in capitals, in the person's language."""
    return translate(_STATES[state])


def shown_state(state: ReadState) -> signs.ShownState:
    """Return the sign and colour of a reading state."""
    return _SIGNS.get(state, signs.ShownState.SKIP)


def heading(record: AsBuiltRecord) -> str:
    """Return the title of the record."""
    return msg(f"As built: {arg(record.title)} ({arg(record.site)})")


def subtitle(record: AsBuiltRecord) -> str:
    """Return the record's id and time."""
    return msg(f"record {arg(record.id)}, {arg(time_text(record.at, record.time_zone))}")


def what(record: AsBuiltRecord) -> str:
    """Return whether real devices were queried, as text."""
    return "emulated devices; no real device was contacted" if record.rehearsed else "nothing was changed"


def where(fact: Fact, zone: str) -> str:
    """Return the origin of a value as text."""
    at = time_text(fact.at, zone) if fact.at is not None else ""
    if fact.value is None:
        return msg(f"not read: {arg(fact.note)}" if fact.note else "not read")
    if fact.origin is Origin.READ:
        return "read in this run"
    if fact.origin is Origin.DECLARED:
        return fact.note or "declared"
    words = msg(f"stored on {arg(at)}" if at else "stored")
    return msg(f"{arg(words)}, {arg(fact.note)}") if fact.note else words


def checklist_words(fact: Fact, zone: str) -> str:
    """Return the last signed checklist of the site as text."""
    if fact.value is None:
        return msg(f"last signed checklist of the site: {arg(fact.note)}")
    return msg(f"last signed checklist of the site: {arg(fact.value)} ({arg(where(fact, zone))})")


def facts_of(device: DeviceRecord) -> list[tuple[str, Fact]]:
    """Return the values of a device, in their order."""
    return [(name, device.facts[name]) for name in FACTS if name in device.facts]


def read_words(device: DeviceRecord, zone: str) -> str:
    """Return when the ports were read if not in this run; empty otherwise."""
    if device.state in {ReadState.READ, ReadState.IN_PART}:
        return ""
    if device.read_at is None:
        return "it was never read on this computer"
    return msg(f"its last known values, read on {arg(time_text(device.read_at, zone))}")


def link_words(port: PortRecord) -> str:
    """Return a port's link as text: state, speed, MAC."""
    words = msg(f"link {arg(port.link)}, {arg(port.speed)}" if port.speed else f"link {arg(port.link)}")
    return msg(f"{arg(words)}, MAC {arg(port.mac)}") if port.mac else words


def neighbour_words(neighbour: PortNeighbour) -> str:
    """Return a neighbour and how it was detected, as text."""
    return msg(f"neighbour: {arg(neighbour_text(neighbour))}, from {arg(conjunction(neighbour.by))}")


def closing(record: AsBuiltRecord) -> str:
    """Return the summary in one sentence."""
    states = [device.state for device in record.devices]
    read, away = (states.count(state) for state in (ReadState.READ, ReadState.NOT_REACHED))
    part, rest = states.count(ReadState.IN_PART), len(states)
    if not read and not away and not part:
        return "No device was queried, so nothing was read"
    words = [msg(f"{arg(read)} of {arg(rest)} devices were read")]
    words += [msg(f"{arg(part)} in part")] if part else []
    words += [msg(f"{arg(away)} did not respond")] if away else []
    out = states.count(ReadState.LEFT_OUT)
    words += [msg(f"{arg(out)} were excluded")] if out else []
    other_count = rest - read - part - away - out
    words += [msg(f"{arg(other_count)} cannot be queried")] if other_count else []
    return join(", ", words)


def compared_words(record: AsBuiltRecord) -> str:
    """Return with which record this one is compared."""
    if record.since is None:
        return "There is no earlier record to compare with."
    if not record.changes:
        return msg(f"No differences from record {arg(record.since)} in what was read.")
    return msg(f"Differences from record {arg(record.since)}:")


def rows(record: AsBuiltRecord, location: str) -> Iterator[printable.Row]:
    """Yield the lines for the screen; `location`: the path of the record."""
    for row in _rows(record):
        text = printable.plain(row)
        yield from printable.wrap_row(
            row, printable.NARROW, _COLUMN if text.startswith("  ") and len(text) > _COLUMN else 2
        )
    yield translate(f"saved: {arg(location)}")
    yield translate(closing(record))


def _rows(record: AsBuiltRecord) -> Iterator[printable.Row]:
    yield printable.StyledText(translate(heading(record)), printable.Style.TITLE)
    yield translate(subtitle(record))
    yield translate(what(record))
    for device in record.devices:
        yield ""
        yield from _device(device, record.time_zone)
    yield ""
    if record.checklist is not None:
        yield translate(checklist_words(record.checklist, record.time_zone))
    yield translate(compared_words(record))
    yield from (
        (printable.StyledText("  ~ ", printable.Style.WARNING), translate(change.words)) for change in record.changes
    )
    yield from (translate(f"note: {arg(note)}") for note in record.notes)
    yield from (translate(f"cost of this run over {arg(name)}: {arg(words)}") for name, words in record.costs.items())
    if record.not_rehearsed:
        yield translate(count_limits(len(record.not_rehearsed)))
    yield ""


def _device(device: DeviceRecord, zone: str) -> Iterator[printable.Row]:
    word = state_word(device.state)
    kind = translate(device.kind.replace("_", " "))
    yield (
        printable.StyledText(device.name, printable.Style.TITLE),
        f": {kind}, ",
        printable.StyledText(word, _STYLES.get(device.state, printable.Style.QUIET)),
    )
    for words in (device.why, device.hint and f"→ {translate(device.hint)}", read_words(device, zone)):
        if words:
            yield f"  {translate(words)}"
    for name, fact in facts_of(device):
        value = f"{fact.value} ({translate(where(fact, zone))})" if fact.value else translate(where(fact, zone))
        yield _label(translate(title_of(name)), value)
    for port in device.ports:
        yield _label(translate(f"port {arg(port.name)}"), translate(link_words(port)))
        if port.belongs:
            yield f"{'':<{_COLUMN}}{translate(f'according to the inventory: {arg(port.belongs)}')}"
        yield from (f"{'':<{_COLUMN}}{translate(neighbour_words(item))}" for item in port.neighbours)
    for item in device.elsewhere:
        yield _label(translate("port not known"), translate(neighbour_words(item)))
    for name, version in device.packages.items():
        yield _label(translate(f"package {arg(name)}"), translate(version))
    yield from (f"  {translate(f'note: {arg(note)}')}" for note in device.notes)


def _label(title: str, value: str) -> str:
    """Return a value next to its title; a long title shifts it to the right."""
    return f"  {title:<{_COLUMN - 3}} {value}"


def anchor(name: str) -> str:
    """Return a device's anchor on the page, which the labels refer to."""
    return f"device-{name}"


def html(record: AsBuiltRecord, digest: str) -> bytes:
    """Return the page: no script, no request, the same for the same record. `digest`: SHA-256 of `as-built.json`."""
    states = {device.state for device in record.devices}
    order = (ReadState.NOT_REACHED, ReadState.IN_PART, ReadState.READ)
    state = next((state for state in order if state in states), ReadState.BY_HAND)
    header = page_frame.PageHeader(
        heading(record),
        subtitle(record),
        _REHEARSAL if record.rehearsed else "",
        page_frame.PageVerdict(shown_state(state), state_word(state), closing(record)),
    )
    words = {"record": record, "digest": digest, "tables": report_tables(record)}
    return page_frame.page(_environment(), "as-built.html.j2", header, **words)


def table_words(table: ReportTable) -> str:
    """Return a report table's number and title."""
    return msg(f"Table {arg(table.number)}: {arg(table.title)}")


@cache
def _environment() -> Environment:
    result = page_frame.environment("atlantis_netcfg.records.asbuilt")
    result.globals.update(
        where=where,
        facts_of=facts_of,
        title_of=title_of,
        state_word=state_word,
        tint=shown_state,
        read_words=read_words,
        link_words=link_words,
        neighbour_words=neighbour_words,
        checklist_words=checklist_words,
        compared_words=compared_words,
        table_words=table_words,
        anchor=anchor,
    )
    return result
