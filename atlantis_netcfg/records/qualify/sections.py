"""The content of a measured run's report: sections with sentences, and tables of text cells, in order.

Screen, page and PDF show the same sections. All of it is English; each of them translates when printing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from atlantis_netcfg.core.events import Verdict
from atlantis_netcfg.core.messages import arg, join, msg
from atlantis_netcfg.core.times import time_text
from atlantis_netcfg.links.qualify import figures
from atlantis_netcfg.links.qualify.compare import clock_words, loss_shares
from atlantis_netcfg.links.qualify.session import EndReason

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from decimal import Decimal

    from atlantis_netcfg.links.qualify.measured_run import MeasuredRun
    from atlantis_netcfg.links.qualify.record import MeasuredRate, QualifyRecord

UNKNOWN: Final = "unknown"
_MILLI_BELOW_S: Final = 10.0
_FINE_BELOW_MS: Final = 10.0
_KILO, _MEGA = 1_000, 1_000_000
_COLUMNS: Final = {
    "verdicts": ("criterion", "measured", "limit", "verdict", "why"),
    "way": ("link", "packets up", "bytes up", "packets down", "bytes down", "port up", "port down"),
    "figures": ("figure", "without load", "under load"),
    "load": ("direction", "message size", "sent", "received", "offered", "goodput", "50 %", "95 %"),
    "grid": ("size", "Hz", "sent", "received", "up %", "down %", "50 %", "95 %", "MB/h", "verdict"),
    "highest": ("size", "highest rate", "limited by", "certainty", "on the wire"),
    "used": ("what", "amount"),
    "circumstances": ("what", "value"),
}
"""Columns of each table, by its content."""
_DIRECTIONS = {"up": "to the far end", "down": "from the far end"}
_LOSSES: Final = "up %, down %: loss each way; -: not known."
_SHARES: Final = ("FLR", "AVAIL")


@dataclass(frozen=True, slots=True)
class FigureTable:
    """A table of text cells; the first column names the row."""

    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    has_names: bool = False
    """Whether the first cells are names, which are not translated."""


@dataclass(frozen=True, slots=True)
class PageSection:
    """A heading with sentences, a table, and the names of its plots."""

    key: str
    title: str
    notes: tuple[str, ...] = ()
    table: FigureTable | None = None
    plots: tuple[str, ...] = ()


def heading(record: QualifyRecord) -> str:
    """Return the title of the report."""
    return msg(f"Measured link: {arg(record.run.link)} of {arg(record.run.site)}")


def subtitle(record: QualifyRecord) -> str:
    """Return the subtitle of the page: run id and start time in the run's time zone."""
    return msg(f"run {arg(record.run.id)}, {arg(time_text(record.run.begun, record.run.time_zone))}")


def closing_sentence(record: QualifyRecord) -> str:
    """Return one sentence on the result: how many criteria hold. The page prints the verdict before it."""
    verdicts = [item.verdict for item in record.judgements]
    if not verdicts:
        return "no criterion was checked: the run has no round trips without load"
    pass_count = verdicts.count(Verdict.PASS)
    words = msg(f"{arg(pass_count)} of {arg(len(verdicts))} criteria of `{arg(record.thresholds_name)}` are met")
    way = (
        "the traffic used this link"
        if record.run.way is Verdict.PASS
        else "it is not proved that the traffic used this link"
    )
    if record.run.way is Verdict.FAIL:
        way = "the traffic used another link"
    short = msg("" if record.run.reason == EndReason.DONE else f"; it ended early: {arg(record.run.reason)}")
    return msg(f"{arg(words)}; {arg(way)}{arg(short)}{'; over an emulated link' if record.run.emulated else ''}")


EMULATED_NOTICE: Final = "EMULATED LINK: these figures say nothing about a real link."


def sections(record: QualifyRecord) -> list[PageSection]:
    """Return all sections of the page: verdicts, link, figures, load, then telemetry."""
    page_sections = [_verdicts(record), _path_section(record), _figures(record), _load(record)]
    if record.telemetry:
        title = "Small telemetry, as Table 33 of the report may have been"
        page_sections.append(
            PageSection("telemetry", title, (record.grid_note, _LOSSES), _grid(record.telemetry), ("telemetry",))
        )
    if record.images:
        title = "Images, as Table 34 of the report may have been"
        page_sections.append(
            PageSection("images", title, (record.grid_note, _LOSSES), _grid(record.images), ("images",))
        )
    if record.highest_rates:
        page_sections.append(_highest_rate_section(record))
    return [*page_sections, _usage_section(record), _circumstances(record)]


def _verdicts(record: QualifyRecord) -> PageSection:
    rows = tuple(
        (
            item.criterion,
            _measure(item.criterion, item.measured, item.unit),
            _measure(item.criterion, item.limit, item.unit),
            item.verdict.value,
            item.reason,
        )
        for item in record.judgements
    )
    notes = [msg(f"Thresholds: {arg(record.thresholds_name)}. They are a proposal: the report gives none.")]
    if record.thresholds_name != record.run.thresholds_name:
        notes.append(msg(f"The run itself was judged by {arg(record.run.thresholds_name)}."))
    return PageSection(
        "verdicts",
        "Verdicts by thresholds",
        tuple(notes),
        FigureTable(_COLUMNS["verdicts"], rows) if rows else None,
    )


def _measure(criterion: str, value: float | None, unit: str) -> str:
    if value is None:
        return UNKNOWN
    if unit == "s":
        return format_seconds(value)
    return format_percentage(value) if criterion.startswith(_SHARES) else f"{value:.2f}"


def _path_section(record: QualifyRecord) -> PageSection:
    run = record.run
    rows = tuple(
        (
            item.link,
            *map(_count, (item.test_packets_up, item.test_bytes_up, item.test_packets_down, item.test_bytes_down)),
            *map(_count, (item.port_bytes_up, item.port_bytes_down)),
        )
        for item in run.counts
    )
    why = msg(f": {arg(run.way_reason)}" if run.way_reason else "")
    notes = [join("", (run.way.value, why))]
    if rows:
        whose = "this computer's tunnel" if run.far_end.over_vpn else "this run"
        notes.append(
            msg(
                f"From the router's counters: packets of {arg(whose)}, and all bytes through the port during that time."
            )
        )
    return PageSection(
        "way",
        "Which link carried it",
        tuple(notes),
        FigureTable(_COLUMNS["way"], rows, has_names=True) if rows else None,
    )


def _count(value: int | None) -> str:
    return "-" if value is None else str(value)


def _figures(record: QualifyRecord) -> PageSection:
    trains = [record.idle, record.under_load]
    rows = tuple((title, *("-" if train is None else take(train) for train in trains)) for title, take in _ROWS)
    notes = [msg(f"Loss each way: {arg(train.loss.why)}.") for train in trains[:1] if train is not None]
    if record.idle is not None and record.idle.reason != "done":
        notes.append(msg(f"The packet train without load ended early: {arg(record.idle.reason)}."))
    plots = ("idle-time", "loaded-time", "shares", "gaps", "loss")
    if record.idle is None and record.under_load is None:
        return PageSection("figures", "Round trips, loss and gaps", ("No round trips were measured.",))
    return PageSection(
        "figures",
        "Round trips, loss and gaps",
        tuple(notes),
        FigureTable(_COLUMNS["figures"], rows),
        plots,
    )


def _variation(take: Callable[[figures.DelayVariation], float], way: str) -> Callable[[figures.TrainFigures], str]:
    def words(train: figures.TrainFigures) -> str:
        variation = train.up if way == "up" else train.down
        return UNKNOWN if variation is None else format_seconds(take(variation))

    return words


def _rtt(name: str) -> Callable[[figures.TrainFigures], str]:
    return lambda train: UNKNOWN if train.rtt is None else format_seconds(getattr(train.rtt, name))


def _longest(train: figures.TrainFigures) -> str:
    is_open = train.gaps.open_end and train.gaps.above[0][1]
    return msg(f"{arg(format_seconds(train.gaps.longest_s))}{' or more' if is_open else ''}")


_ROWS: Final[tuple[tuple[str, Callable[[figures.TrainFigures], str]], ...]] = (
    ("packets sent", lambda train: str(train.loss.sent)),
    ("packets with a response", lambda train: str(train.loss.received)),
    ("round trip, shortest", _rtt("min")),
    ("round trip, 50 %", _rtt("p50")),
    ("round trip, 90 %", _rtt("p90")),
    ("round trip, 95 %", _rtt("p95")),
    ("round trip, 99 %", _rtt("p99")),
    ("round trip, longest", _rtt("max")),
    ("round trips a minute (RPM)", lambda train: UNKNOWN if train.rpm is None else f"{train.rpm:.0f}"),
    ("loss up", lambda train: format_percentage(loss_shares(train)[0])),
    ("loss down", lambda train: format_percentage(loss_shares(train)[1])),
    ("loss, both directions together", lambda train: format_percentage(train.loss.share)),
    ("lost in gaps", lambda train: str(train.flr.in_gaps)),
    ("loss up, outside of gaps", lambda train: format_percentage(train.flr.up)),
    ("loss down, outside of gaps", lambda train: format_percentage(train.flr.down)),
    ("late responses", lambda train: str(train.loss.late)),
    ("in flight at the end", lambda train: str(train.loss.in_flight)),
    ("refused by the reflector", lambda train: str(train.loss.limited)),
    ("duplicates up", lambda train: _count(train.loss.copies_up)),
    ("duplicates down", lambda train: str(train.loss.copies_down)),
    ("reordered up", lambda train: format_percentage(train.reordered_up)),
    ("reordered down", lambda train: format_percentage(train.reordered_down)),
    ("delay above the minimum up, 95 %", _variation(lambda each: each.above_min.p95, "up")),
    ("delay above the minimum down, 95 %", _variation(lambda each: each.above_min.p95, "down")),
    ("jitter up (RFC 3550)", _variation(lambda each: each.rfc3550_mean_s, "up")),
    ("jitter down (RFC 3550)", _variation(lambda each: each.rfc3550_mean_s, "down")),
    ("IPDV up, 95 %", _variation(lambda each: each.ipdv_p95_s, "up")),
    ("IPDV down, 95 %", _variation(lambda each: each.ipdv_p95_s, "down")),
    ("longest gap", _longest),
    *(
        (msg(f"gaps of more than {arg(limit)} s"), lambda train, limit=limit: str(dict(train.gaps.above).get(limit, 0)))
        for limit in figures.GAPS_S
    ),
)


def _load(record: QualifyRecord) -> PageSection:
    run = record.run
    rows = tuple(
        (
            _DIRECTIONS[row.way],
            f"{row.size} B",
            str(row.sent),
            str(row.received),
            format_rate(row.offered_bps),
            format_rate(row.goodput_bps),
            UNKNOWN if row.latency is None else format_seconds(row.latency.p50),
            UNKNOWN if row.latency is None else format_seconds(row.latency.p95),
        )
        for row in record.load
    )
    why = msg(f" ({arg(run.path_mtu_reason)})" if run.path_mtu_reason else "")
    path_mtus = (run.path_mtu_up, run.path_mtu_both)
    mtu = msg(f"Path MTU: up {arg(_octets(path_mtus[0]))}, both ways {arg(_octets(path_mtus[1]))}{arg(why)}.")
    doubts = [
        msg(f"Goodput {arg(_DIRECTIONS[row.way])}: {arg(row.verdict.value)}: {arg(row.doubt)}.")
        for row in record.load
        if row.doubt
    ]
    notes = [mtu, *doubts, *([] if rows else ["Goodput was not measured."])]
    return PageSection(
        "load", "Goodput at the receiver, path MTU", tuple(notes), FigureTable(_COLUMNS["load"], rows) if rows else None
    )


def _octets(value: int | None) -> str:
    return UNKNOWN if value is None else msg(f"{arg(value)} octets")


def _grid(rows: Sequence[MeasuredRate]) -> FigureTable:
    return FigureTable(
        _COLUMNS["grid"],
        tuple(
            (
                row.label,
                f"{row.rate_hz:g}",
                str(row.sent),
                str(row.received),
                _short(row.loss_up),
                _short(row.loss_down),
                "-" if row.p50_s is None else f"{row.p50_s:.2f} s",
                "-" if row.p95_s is None else f"{row.p95_s:.2f} s",
                f"{row.mb_per_hour:.1f}",
                row.verdict.value if row.reason == "sustained" else msg(f"{arg(row.verdict.value)}: {arg(row.reason)}"),
            )
            for row in rows
        ),
    )


def _short(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.1f}"


def _highest_rate_section(record: QualifyRecord) -> PageSection:
    rows = tuple(
        (
            row.label,
            UNKNOWN if row.rate_hz is None else f"{row.rate_hz:.3g} Hz",
            row.limited_by.value,
            "proved" if row.proved else "not proved",
            "-"
            if row.mb_per_hour is None
            else f"{row.mb_per_hour:.1f} MB/h{_format_hourly_price(row.price_per_hour, record.run)}",
        )
        for row in record.highest_rates
    )
    note = "Proved: this rate was sustained, and a higher one failed."
    return PageSection(
        "highest", "The highest rate that the link sustains", (note,), FigureTable(_COLUMNS["highest"], rows)
    )


def _format_hourly_price(price: Decimal | None, run: MeasuredRun) -> str:
    """Format the price per hour; empty if the inventory has no tariff."""
    return "" if price is None or run.tariff is None else f", {price:.2f} {run.tariff.currency}/h"


def _usage_section(record: QualifyRecord) -> PageSection:
    run = record.run
    duration_s = None if run.ended is None else (run.ended - run.begun).total_seconds()
    money = UNKNOWN if run.price is None else f"{run.price} {run.currency or ''}".rstrip()
    rows = [
        ("bytes sent, by this computer", str(run.sent_bytes)),
        ("bytes received, by this computer", str(run.received_bytes)),
        (
            "bytes per hour during the measurement",
            UNKNOWN if record.mb_per_hour is None else f"{record.mb_per_hour:.1f} MB/h",
        ),
        ("price of this run", money),
        (msg("duration"), UNKNOWN if duration_s is None else f"{duration_s:.0f} s"),
        ("reason for the end", run.reason),
    ]
    limits = run.budget
    rows += [("budget in bytes", str(limits.max_bytes))] if limits.max_bytes is not None else []
    rows += [("budget in seconds", f"{limits.max_seconds:g} s")] if limits.max_seconds is not None else []
    rows += [("budget in money", f"{limits.max_price} {run.currency or ''}")] if limits.max_price is not None else []
    return PageSection("used", "Data used, on the wire", (), FigureTable(_COLUMNS["used"], tuple(rows)))


def _circumstances(record: QualifyRecord) -> PageSection:
    run = record.run
    end = run.far_end
    rows = [
        ("kind of link", run.kind),
        ("far end", msg(f"{arg(end.name)}, {arg(end.address)} port {arg(end.port)}")),
        ("path to the far end", "through the VPN" if end.over_vpn else "outside the VPN"),
        ("test packets", "authenticated with a key" if end.authenticated else "not authenticated"),
        ("sent from", end.source),
        ("this computer's clock", clock_words(run)),
        (msg("start"), time_text(run.begun, run.time_zone)),
        (msg("end"), UNKNOWN if run.ended is None else time_text(run.ended, run.time_zone)),
        ("what was measured", run.selection.value),
        ("tool", f"atlantis-netcfg {run.tool}"),
        ("SHA-256 of samples.jsonl", record.samples_sha256),
        *run.facts.items(),
    ]
    return PageSection(
        "circumstances",
        "The link, and how it was measured",
        tuple(run.remarks),
        FigureTable(_COLUMNS["circumstances"], tuple(rows)),
    )


def format_seconds(value: float) -> str:
    """Format a duration: `0.8 ms`, `596 ms`, `70.1 s`."""
    if value >= _MILLI_BELOW_S:
        return f"{value:.1f} s"
    milli = 1000 * value
    return msg(f"{arg(milli):.1f} ms" if milli < _FINE_BELOW_MS else f"{arg(milli):.0f} ms")


def format_rate(bps: float | None) -> str:
    """Format a bit rate: `293 kbit/s`, `31.6 Mbit/s`; None is "unknown"."""
    if bps is None:
        return UNKNOWN
    return msg(f"{arg(bps / _MEGA):.1f} Mbit/s" if bps >= _MEGA else f"{arg(bps / _KILO):.0f} kbit/s")


def format_percentage(value: float | None) -> str:
    """Format a fraction as a percentage: `1.25 %`; None is "unknown"."""
    return UNKNOWN if value is None else f"{100 * value:.2f} %"


def format_figure(value: float | None, unit: str) -> str:
    """Format a figure of `compare.HEADLINES` in its unit."""
    if value is None:
        return UNKNOWN
    makers: dict[str, Callable[[float], str]] = {"s": format_seconds, "bit/s": format_rate, "": format_percentage}
    return makers[unit](value) if unit in makers else f"{value:.0f}"
